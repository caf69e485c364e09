// Balls around geoms: around each for the kernels, and those of what moved since the last tick.
#include <algorithm>
#include <cmath>
#include <cstring>

#include "caster.h"

namespace evs {
namespace {

constexpr float HUGE_RADIUS = 1e15f;  // of an infinite plane

// the widest kernel reads 32 at once
size_t padded(int count) { return static_cast<size_t>((count + 31) / 32) * 32; }

}  // namespace

void Caster::Spheres::reserve(int count) {
  for (std::vector<float>* part : {&x, &y, &z, &radius}) part->reserve(padded(count));
}

void Caster::Spheres::resize(int count) {
  size_t size = padded(count);
  x.assign(size, 0.0f);
  y.assign(size, 0.0f);
  z.assign(size, 0.0f);
  radius.assign(size, -1.0f);
}

void Caster::Spheres::set(int i, const Ball& s) {
  x[i] = s.center.x;
  y[i] = s.center.y;
  z[i] = s.center.z;
  radius[i] = s.radius;
}

Bounds Caster::Spheres::view() const {
  return {x.data(), y.data(), z.data(), radius.data(), static_cast<int>(x.size())};
}

Ball Caster::sphere_of(const Geom& g) const {
  const float* s = g.size;
  float r = 0;
  V3 c = g.position;
  switch (g.shape) {
    case PLANE:
      r = s[0] > 0 && s[1] > 0 ? std::hypot(s[0], s[1]) : HUGE_RADIUS;
      break;
    case SPHERE:
      r = s[0];
      break;
    case CAPSULE:
      r = s[0] + s[1];
      break;
    case CYLINDER:
      r = std::hypot(s[0], s[1]);
      break;
    case ELLIPSOID:
      r = std::max({s[0], s[1], s[2]});
      break;
    case BOX:
      r = std::sqrt(s[0] * s[0] + s[1] * s[1] + s[2] * s[2]);
      break;
    default: {
      const Tree& tree = mesh_data_[g.mesh]->tree;
      const float* m = g.rotation;
      V3 q = tree.center;
      c = {c.x + m[0] * q.x + m[1] * q.y + m[2] * q.z, c.y + m[3] * q.x + m[4] * q.y + m[5] * q.z,
           c.z + m[6] * q.x + m[7] * q.y + m[8] * q.z};
      r = tree.radius;
    }
  }
  // and the rounding of its place
  return {c, r * 1.0001f + (std::abs(c.x) + std::abs(c.y) + std::abs(c.z)) * 5e-7f};
}

Ball ball_around(const Ball* balls, size_t count) {
  if (count == 0) return {{0, 0, 0}, -1};
  double center[3] = {0, 0, 0}, radius = 0;
  for (size_t i = 0; i < count; i++) {
    center[0] += balls[i].center.x;
    center[1] += balls[i].center.y;
    center[2] += balls[i].center.z;
  }
  for (double& c : center) c /= static_cast<double>(count);
  for (size_t i = 0; i < count; i++) {
    V3 c = balls[i].center;
    double x = c.x - center[0], y = c.y - center[1], z = c.z - center[2];
    radius = std::max(radius, std::sqrt(x * x + y * y + z * z) + balls[i].radius);
  }
  // a pose that is not finite may have been anywhere
  bool finite = std::isfinite(center[0] + center[1] + center[2]) && radius < 1e29;
  if (!finite) center[0] = center[1] = center[2] = 0, radius = 1e29;
  return {
      {static_cast<float>(center[0]), static_cast<float>(center[1]), static_cast<float>(center[2])},
      static_cast<float>(radius * 1.0001)};
}

// The image of everything else in the only plane; more of them: too large to be anywhere.
Ball Caster::mirrored_in_plane() const {
  if (frame_.plane_count != 1) return {{0, 0, 0}, 1e30f};
  const Geom& plane = geoms_[0];
  Ball ball = frame_.around;
  V3 n = {plane.rotation[2], plane.rotation[5], plane.rotation[8]}, c = ball.center;
  V3 p = plane.position;
  float height = (c.x - p.x) * n.x + (c.y - p.y) * n.y + (c.z - p.z) * n.z;
  ball.center = {c.x - 2 * height * n.x, c.y - 2 * height * n.y, c.z - 2 * height * n.z};
  // the rounding of the places, and of rays that leave the plane from afar
  float away =
      std::abs(c.x) + std::abs(c.y) + std::abs(c.z) + std::abs(height) + std::hypot(p.x, p.y, p.z);
  if (ball.radius >= 0) ball.radius = ball.radius * 1.0001f + away * 1e-5f;
  if (!(ball.radius < 1e28f)) ball.radius = 1e30f;
  return ball;
}

// One rod that holds a geom's before and after it moved, or both if it moved far.
void Caster::add_moved(const Rod& before, const Rod& now) {
  auto length = [](V3 a, V3 b) { return std::hypot(a.x - b.x, a.y - b.y, a.z - b.z); };
  // no point of the axis went further
  float gone = length(now.center, before.center) + now.half * length(now.axis, before.axis);
  float thickest = std::max(before.radius, now.radius);
  if (gone < 0.5f * thickest && now.half == before.half) {
    moved_rods_.push_back({now.center, now.axis, now.half, (thickest + gone) * 1.00001f, 0, 0});
  } else {
    moved_rods_.push_back(before);
    moved_rods_.push_back(now);
  }
}

// Rods around every geom that moved, balls around those, and one around them all.
void Caster::find_moved() {
  moved_rods_.clear();
  for (size_t k = 0; k < geoms_.size(); k++) {
    // what has no radius, before and now, is not seen
    bool solid = geoms_[k].shape == PLANE || geoms_[k].mesh >= 0;
    if (!solid && !(geoms_[k].size[0] > 0) && !(previous_geoms_[k].size[0] > 0)) continue;
    bool deformed = geoms_[k].mesh >= 0 && deformed_[geoms_[k].mesh];
    if (!deformed && std::memcmp(&geoms_[k], &previous_geoms_[k], sizeof(Geom)) == 0) continue;
    add_moved(rod_of(previous_geoms_[k], previous_balls_[k]), rod_of(geoms_[k], balls_[k]));
  }
  moved_balls_.clear();
  moved_.resize(static_cast<int>(moved_rods_.size()));
  for (const Rod& rod : moved_rods_) {
    moved_balls_.push_back({rod.center, (rod.half + rod.radius) * 1.00001f});
    moved_.set(static_cast<int>(moved_balls_.size()) - 1, moved_balls_.back());
  }
  around_moved_ = ball_around(moved_balls_.data(), moved_balls_.size());
}

}  // namespace evs
