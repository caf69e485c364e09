// Bounding volumes: of each geom for the kernels, and of the geoms that moved since the last tick.
#include <algorithm>
#include <cmath>
#include <cstring>

#include "base/reproducible_math.h"
#include "render/caster.h"
#include "scene/light.h"

namespace evs {
namespace {

constexpr float HUGE_RADIUS = 1e15f;  // of an infinite plane

// the widest kernel reads 32 at a time
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

void Caster::Spheres::set(int i, const BoundingSphere& s) {
  x[i] = s.center.x;
  y[i] = s.center.y;
  z[i] = s.center.z;
  radius[i] = s.radius;
}

BoundingSphereArray Caster::Spheres::view() const {
  return {x.data(), y.data(), z.data(), radius.data(), static_cast<int>(x.size())};
}

void Caster::Reaches::resize(size_t lights) {
  // the widest kernel reads 32 from any light on
  for (std::vector<float>& part : parts) part.assign(lights + 31, 0.0f);
}

void Caster::Reaches::set(size_t i, const Light& light) {
  V3 p = light.position, d = light.direction;
  LightReach reach = light.reach();
  const float values[9] = {p.x, p.y, p.z, d.x, d.y, d.z, reach.cosine, reach.sine, reach.fade};
  for (int k = 0; k < 9; k++) parts[k][i] = values[k];
}

LightReachArray Caster::Reaches::view() const {
  const std::vector<float>* a = parts;
  return {a[0].data(), a[1].data(), a[2].data(), a[3].data(), a[4].data(),
          a[5].data(), a[6].data(), a[7].data(), a[8].data()};
}

BoundingSphere Caster::bounding_sphere_of(const Geom& g) const {
  const float* s = g.size;
  float r = 0;
  V3 c = g.position;
  switch (g.shape) {
    case PLANE:
      r = s[0] > 0 && s[1] > 0 ? hypotenuse(s[0], s[1]) : HUGE_RADIUS;
      break;
    case SPHERE:
      r = s[0];
      break;
    case CAPSULE:
      r = s[0] + s[1];
      break;
    case CYLINDER:
      r = hypotenuse(s[0], s[1]);
      break;
    case ELLIPSOID:
      r = std::max({s[0], s[1], s[2]});
      break;
    case BOX:
      r = std::sqrt(s[0] * s[0] + s[1] * s[1] + s[2] * s[2]);
      break;
    default: {
      const Bvh& bvh = mesh_data_[g.mesh]->bvh;
      const float* m = g.rotation;
      V3 q = bvh.center;
      c = {c.x + m[0] * q.x + m[1] * q.y + m[2] * q.z, c.y + m[3] * q.x + m[4] * q.y + m[5] * q.z,
           c.z + m[6] * q.x + m[7] * q.y + m[8] * q.z};
      r = bvh.radius;
    }
  }
  // add the rounding of its position
  return {c, r * 1.0001f + (std::abs(c.x) + std::abs(c.y) + std::abs(c.z)) * 5e-7f};
}

BoundingSphere sphere_around(const BoundingSphere* spheres, size_t count) {
  if (count == 0) return {{0, 0, 0}, -1};
  double center[3] = {0, 0, 0}, radius = 0;
  for (size_t i = 0; i < count; i++) {
    center[0] += spheres[i].center.x;
    center[1] += spheres[i].center.y;
    center[2] += spheres[i].center.z;
  }
  for (double& c : center) c /= static_cast<double>(count);
  for (size_t i = 0; i < count; i++) {
    V3 c = spheres[i].center;
    double x = c.x - center[0], y = c.y - center[1], z = c.z - center[2];
    radius = std::max(radius, std::sqrt(x * x + y * y + z * z) + spheres[i].radius);
  }
  // a non-finite pose may have been anywhere
  bool finite = std::isfinite(center[0] + center[1] + center[2]) && radius < 1e29;
  if (!finite) center[0] = center[1] = center[2] = 0, radius = 1e29;
  return {
      {static_cast<float>(center[0]), static_cast<float>(center[1]), static_cast<float>(center[2])},
      static_cast<float>(radius * 1.0001)};
}

// Return the mirror image of everything else in the only plane; with more planes, an infinite
// sphere.
BoundingSphere Caster::mirrored_in_plane() const {
  if (frame_.plane_count != 1) return {{0, 0, 0}, 1e30f};
  const Geom& plane = geoms_[0];
  BoundingSphere sphere = frame_.finite_bounds;
  V3 n = {plane.rotation[2], plane.rotation[5], plane.rotation[8]}, c = sphere.center;
  V3 p = plane.position;
  float height = (c.x - p.x) * n.x + (c.y - p.y) * n.y + (c.z - p.z) * n.z;
  sphere.center = {c.x - 2 * height * n.x, c.y - 2 * height * n.y, c.z - 2 * height * n.z};
  // add the rounding of the positions, and of rays that leave the plane from far away
  float away =
      std::abs(c.x) + std::abs(c.y) + std::abs(c.z) + std::abs(height) + std::hypot(p.x, p.y, p.z);
  if (sphere.radius >= 0) sphere.radius = sphere.radius * 1.0001f + away * 1e-5f;
  if (!(sphere.radius < 1e28f)) sphere.radius = 1e30f;
  return sphere;
}

void Caster::Moved::reserve(int geoms) {
  capsules.reserve(2 * static_cast<size_t>(geoms));
  spheres.reserve(2 * static_cast<size_t>(geoms));
  view.reserve(2 * geoms);
}

// Add one capsule that bounds a geom before and after its motion, or two if it moved far.
void Caster::Moved::add(const BoundingCapsule& before, const BoundingCapsule& now) {
  auto length = [](V3 a, V3 b) { return std::hypot(a.x - b.x, a.y - b.y, a.z - b.z); };
  // no point of the axis moved further
  float gone = length(now.center, before.center) + now.half * length(now.axis, before.axis);
  float thickest = std::max(before.radius, now.radius);
  if (gone < 0.5f * thickest && now.half == before.half) {
    capsules.push_back({now.center, now.axis, now.half, (thickest + gone) * 1.00001f, 0, 0});
  } else {
    capsules.push_back(before);
    capsules.push_back(now);
  }
}

// Bound the capsules by spheres, and all of them by one sphere.
void Caster::Moved::finish() {
  spheres.clear();
  view.resize(static_cast<int>(capsules.size()));
  for (const BoundingCapsule& capsule : capsules) {
    spheres.push_back({capsule.center, (capsule.half + capsule.radius) * 1.00001f});
    view.set(static_cast<int>(spheres.size()) - 1, spheres.back());
  }
  around = sphere_around(spheres.data(), spheres.size());
}

SceneChange Caster::Moved::change() const {
  return {capsules.data(), view.view(), around, nullptr, nullptr, nullptr, 0};
}

// Has a geom moved since the last tick, or changed its shape?
bool Caster::has_changed(size_t k) const {
  const Geom& g = geoms_[k];
  bool deformed = g.mesh >= 0 && deformed_[g.mesh];
  return deformed || std::memcmp(&g, &previous_geoms_[k], sizeof(Geom)) != 0;
}

// Bound every geom that moved.
void Caster::find_moved() {
  moved_.capsules.clear();
  moved_soft_.capsules.clear();
  for (size_t k = 0; k < geoms_.size(); k++) {
    const Geom& g = geoms_[k];
    // a geom without a radius, before and now, is invisible
    bool solid = g.shape == PLANE || g.mesh >= 0;
    if (!solid && !(g.size[0] > 0) && !(previous_geoms_[k].size[0] > 0)) continue;
    if (!has_changed(k)) continue;
    moved_.add(bounding_capsule(previous_geoms_[k], previous_spheres_[k]),
               bounding_capsule(g, bounding_spheres_[k]));
    if (!kept_) continue;
    auto outline = [](const Geom& shape, const BoundingSphere& s) {
      if (shape.shape == CAPSULE) return bounding_capsule(shape, s);
      return BoundingCapsule{s.center, {0, 0, 1}, 0, s.radius, 0, 0};
    };
    moved_soft_.add(outline(previous_geoms_[k], previous_spheres_[k]),
                    outline(g, bounding_spheres_[k]));
  }
  moved_.finish();
  if (kept_) moved_soft_.finish();
}

}  // namespace evs
