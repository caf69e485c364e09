#include "render/placed_scene.h"

#include <algorithm>
#include <cmath>
#include <cstring>

#include "base/reproducible_math.h"
#include "render/geometry/bounding_capsule.h"
#include "render/integrators/edge_sampling.h"
#include "scene/light.h"

namespace evs {
namespace {

// To scan so few geoms, or lights with a cone or a range, is as fast as to cull them.
constexpr int FEW_GEOMS = 128, FEW_LIGHTS = 4;

struct D3 {
  double x, y, z;
};

// m^T v for a row-major 3x3 m
D3 transposed_times(const double* m, D3 v) {
  return {m[0] * v.x + m[3] * v.y + m[6] * v.z, m[1] * v.x + m[4] * v.y + m[7] * v.z,
          m[2] * v.x + m[5] * v.y + m[8] * v.z};
}

D3 minus(const double* a, const double* b) { return {a[0] - b[0], a[1] - b[1], a[2] - b[2]}; }

V3 to_float(D3 v) {
  return {static_cast<float>(v.x), static_cast<float>(v.y), static_cast<float>(v.z)};
}

Mesh mesh_view(const SceneData::MeshData& m) {
  return {m.bvh.nodes.data(), m.bvh.triangles.data(),
          m.corners.data(),   static_cast<int>(m.bvh.nodes.size()),
          m.has_texcoords,    m.bvh.center,
          m.bvh.radius};
}

constexpr float HUGE_RADIUS = 1e15f;  // of an infinite plane

// the widest kernel reads 32 at a time
size_t padded(int count) { return static_cast<size_t>((count + 31) / 32) * 32; }

}  // namespace

int Tracing::base_samples() const {
  return paths_at_edges() ? EdgeSampling::base_samples(samples) : samples;
}

PlacedScene::PlacedScene(const SceneData& data, const Optics& optics, const Tracing& tracing,
                         const PlacedScene* before)
    : appearance(make_appearance(data, tracing.rgb || tracing.hybrid || tracing.forced.on(COLOUR),
                                 tracing.path, tracing.forced.off(COLOUR),
                                 before ? &before->appearance : nullptr)),
      mesh_data(data.meshes),
      forced_(tracing.forced),
      has_bulbs_(tracing.path || tracing.hybrid) {
  for (const auto& m : mesh_data) {
    bool shared = before && std::count(before->mesh_data.begin(), before->mesh_data.end(), m) > 0;
    bvhs_built += !shared;
    meshes_.push_back(mesh_view(*m));
  }
  order_geoms(data);
  reserve_tick();
  set_frame(optics, tracing);
}

// Put the geoms into the kernels' order.
void PlacedScene::order_geoms(const SceneData& data) {
  int count = static_cast<int>(data.geom_type.size());
  for (int pass = 0; pass < 3; pass++) {
    for (int g = 0; g < count; g++) {
      bool is_mesh = data.geom_type[g] == MESH || data.geom_type[g] == HFIELD;
      int its_pass = is_mesh ? 2 : data.geom_type[g] == PLANE ? 0 : 1;
      if (its_pass == pass) order.push_back(g);
    }
  }
  index.resize(count);
  for (int k = 0; k < count; k++) index[order[k]] = k;
  geoms.resize(count);
  std::memset(static_cast<void*>(geoms.data()), 0, count * sizeof(Geom));
  for (int k = 0; k < count; k++) {
    int g = order[k];
    geoms[k].shape = data.geom_type[g];
    geoms[k].mesh = data.geom_mesh[g];
    geoms[k].surface = data.geom_surface[g];
    geoms[k].rank = g;
    for (int a = 0; a < 3; a++) geoms[k].size[a] = data.geom_size[3 * g + a];
  }
}

// Reserve what a tick needs: it allocates nothing.
void PlacedScene::reserve_tick() {
  const int count = static_cast<int>(geoms.size());
  previous_geoms = geoms;
  spheres_.resize(count);
  bounding_spheres.resize(count);
  previous_spheres.resize(count);
  moved_.reserve(count);
  moved_soft_.reserve(count);
  previous_lights = appearance.lights;
  camera_.reserve(12);
  deformed.resize(mesh_data.size());
  shapes_.resize(mesh_data.size());
}

void PlacedScene::set_frame(const Optics& optics, const Tracing& tracing) {
  const int count = static_cast<int>(geoms.size()), samples = tracing.base_samples();
  set_optics(optics, samples, sampling, frame);
  frame.geoms = geoms.data();
  frame.geom_count = count;
  frame.plane_count = static_cast<int>(
      std::count_if(geoms.begin(), geoms.end(), [](const Geom& g) { return g.shape == PLANE; }));
  int others = count - frame.plane_count;
  bvh_.emplace(frame.plane_count, forced_.decide(HIERARCHY, others > FEW_GEOMS) ? others : 0);
  frame.bvh = bvh_->view();
  frame.meshes = meshes_.data();
  frame.surfaces = appearance.surfaces.data();
  frame.textures = appearance.textures.data();
  frame.lights = appearance.lights.data();
  frame.light_count = static_cast<int>(appearance.lights.size());
  reaches_.resize(appearance.lights.size());
  frame.reach = reaches_.view();
  auto bounded = std::count_if(appearance.lights.begin(), appearance.lights.end(),
                               [](const Light& light) { return light.reach().bounded(); });
  frame.cull_lights = forced_.decide(LIGHT_REACH, bounded > FEW_LIGHTS);
  frame.skybox = appearance.skybox;
  // direct light knows no sky
  frame.sky_shines = appearance.sky_shines && (tracing.path || tracing.hybrid);
  frame.channels = appearance.channels;
  std::copy(appearance.weights, appearance.weights + MAX_CHANNELS, frame.weights);
  frame.lobes = forced_.decide(LOBES, appearance.layered || tracing.path || tracing.hybrid);
  if (forced_.decide(TEXTURE_FILTER, appearance.textured)) frame.probes = probes_of(samples);
  const bool pinhole = !frame.lens && !frame.orthographic;
  bool outlines = std::any_of(geoms.begin(), geoms.end(),
                              [](const Geom& g) { return g.shape != MESH && g.shape != HFIELD; });
  frame.outlines = pinhole && forced_.decide(OUTLINES, outlines && !tracing.path);
  if (frame.outlines && !(tracing.adaptive && samples > 1)) set_cells(samples, frame);
  const bool meshes = frame.plane_count < count && geoms.back().mesh >= 0;  // they come last
  if (meshes && tracing.adaptive && samples == PACKET_WIDTH * PACKET_HEIGHT)
    set_edge_rays(sampling, frame);
  frame.normal_mapped = forced_.decide(NORMAL_MAPS, appearance.normal_mapped);
  if (forced_.off(FOG)) appearance.medium.fog = false;
  if (forced_.off(HAZE)) appearance.medium.haze = false;
  if (forced_.on(FOG) && !appearance.medium.fog) add_clear_fog(appearance.medium);
  frame.medium = appearance.medium;
  // the first infinite plane has the horizon
  for (int k = count - 1; k >= 0; k--) {
    bool endless = geoms[k].size[0] <= 0 && geoms[k].size[1] <= 0;
    if (geoms[k].shape == PLANE && endless) haze_plane_ = k;
  }
  full_lights = appearance.lights;
  gains_.assign(appearance.lights.size(), 1.0f);
  frame.colour = frame.channels == 3 ? 0 : 1;
  frame.shadows = forced_.decide(SHADOWS, tracing.shadows);
}

bool PlacedScene::deform_mesh(int mesh_index, const float* vertices, const float* normals) {
  std::shared_ptr<SceneData::MeshData>& data = mesh_data.at(mesh_index);
  if (data.use_count() > 1) data = std::make_shared<SceneData::MeshData>(*data);
  SceneData::MeshData& mesh = *data;
  // a body at rest costs only a comparison
  size_t count = 3 * static_cast<size_t>(mesh.vertex_count);
  std::vector<float>& last = shapes_[mesh_index];
  bool same = last.size() == 2 * count && std::equal(vertices, vertices + count, last.begin()) &&
              std::equal(normals, normals + count, last.begin() + static_cast<long>(count));
  if (!forced_.decide(REFITS, !same)) return false;
  bvhs_refitted++;
  last.assign(vertices, vertices + count);
  last.insert(last.end(), normals, normals + count);
  deform(mesh, vertices, normals);
  meshes_[mesh_index] = mesh_view(mesh);
  deformed[mesh_index] = true;
  return true;
}

void PlacedScene::resize_geom(int k, const float* size) {
  std::copy(size, size + 3, geoms[k].size);
}

void PlacedScene::place_geoms(const Poses& p) {
  const double* cm = p.camera_mat;
  for (size_t k = 0; k < geoms.size(); k++) {
    Geom& g = geoms[k];
    const double *pos = p.geom_pos + 3 * order[k], *mat = p.geom_mat + 9 * order[k];
    // subtract in double: precision does not depend on the distance from the origin
    g.position = to_float(transposed_times(cm, minus(pos, p.camera_pos)));
    g.camera = to_float(transposed_times(mat, minus(p.camera_pos, pos)));
    for (int i = 0; i < 3; i++) {
      for (int j = 0; j < 3; j++) {
        double sum = 0;
        for (int a = 0; a < 3; a++) sum += cm[3 * a + i] * mat[3 * a + j];
        g.rotation[3 * i + j] = static_cast<float>(sum);
      }
    }
    bounding_spheres[k] = bounding_sphere_of(g);
    spheres_.set(static_cast<int>(k), bounding_spheres[k]);
  }
  frame.bounds = spheres_.view();
  bvh_->update(geoms.data(), meshes_.data());
  frame.bvh = bvh_->view();
  frame.finite_bounds = sphere_around(bounding_spheres.data() + frame.plane_count,
                                      geoms.size() - static_cast<size_t>(frame.plane_count));
  frame.mirrored_bounds = mirrored_in_plane();
  for (int i = 0; i < 9; i++) frame.camera_to_world[i] = static_cast<float>(cm[i]);
}

uint32_t PlacedScene::non_occluding_planes(const Light& l) const {
  uint32_t non_occluders = 0;
  if (forced_.on(PLANE_SHADOWS)) return non_occluders;
  if (forced_.off(PLANE_SHADOWS)) return ~non_occluders;
  for (size_t k = 0; k < std::min<size_t>(geoms.size(), 32); k++) {
    const Geom& g = geoms[k];
    if (g.shape != PLANE) break;
    V3 w = {-l.direction.x, -l.direction.y, -l.direction.z};
    if (!l.is_delta_direction()) {
      w = {l.position.x - g.position.x, l.position.y - g.position.y, l.position.z - g.position.z};
    }
    float height = w.x * g.rotation[2] + w.y * g.rotation[5] + w.z * g.rotation[8];
    // exclude rounding errors and, where lights are bulbs, their radius
    float part = has_bulbs_ && !l.is_delta_direction() ? l.radius : 0;
    if (height > 1e-5f * std::hypot(w.x, w.y, w.z) + part) non_occluders |= 1u << k;
  }
  return non_occluders;
}

void PlacedScene::place_lights(const Poses& p) {
  for (size_t i = 0; i < appearance.lights.size(); i++) {
    Light& l = appearance.lights[i];
    const Light& full = full_lights[i];
    for (int c = 0; c < MAX_CHANNELS; c++) {
      l.ambient[c] = full.ambient[c] * gains_[i];
      l.diffuse[c] = full.diffuse[c] * gains_[i];
      l.specular[c] = full.specular[c] * gains_[i];
    }
    if (appearance.headlight[i]) {
      l.position = {0, 0, 0};
      l.direction = {0, 0, -1};
    } else {
      const double* d = p.light_dir + 3 * i;
      l.position =
          to_float(transposed_times(p.camera_mat, minus(p.light_pos + 3 * i, p.camera_pos)));
      l.direction = to_float(transposed_times(p.camera_mat, {d[0], d[1], d[2]}));
    }
    l.non_occluders = non_occluding_planes(l);
    reaches_.set(i, l);
  }
}

void PlacedScene::set_light_gains(const float* gains) {
  std::copy(gains, gains + gains_.size(), gains_.begin());
}

// Haze is drawn only from a camera above the plane; an orthographic camera has no horizon.
void PlacedScene::place_medium() {
  Medium& medium = frame.medium;
  medium = appearance.medium;
  medium.haze = appearance.medium.haze && haze_plane_ >= 0 && !frame.orthographic;
  if (medium.haze) {
    const Geom& plane = geoms[haze_plane_];
    medium.haze_up = {plane.rotation[2], plane.rotation[5], plane.rotation[8]};
    medium.haze_elevation = plane.camera.z / medium.haze_radius;
    medium.haze = medium.haze_elevation > 0;
  }
  if (!medium.haze && forced_.on(HAZE)) add_clear_haze(medium);
}

void PlacedScene::place(const Poses& poses) {
  place_geoms(poses);
  place_lights(poses);
  place_medium();
}

bool PlacedScene::is_still(const Poses& poses) {
  bool first = camera_.empty();
  camera_.resize(12);
  bool still = !first && std::equal(camera_.begin(), camera_.begin() + 3, poses.camera_pos) &&
               std::equal(camera_.begin() + 3, camera_.end(), poses.camera_mat);
  std::copy(poses.camera_pos, poses.camera_pos + 3, camera_.begin());
  std::copy(poses.camera_mat, poses.camera_mat + 9, camera_.begin() + 3);
  return still;
}

bool PlacedScene::same_lights() const {
  size_t bytes = appearance.lights.size() * sizeof(Light);
  return bytes == 0 || std::memcmp(appearance.lights.data(), previous_lights.data(), bytes) == 0;
}

bool PlacedScene::same_geoms() const {
  size_t bytes = geoms.size() * sizeof(Geom);
  return std::find(deformed.begin(), deformed.end(), true) == deformed.end() &&
         (bytes == 0 || std::memcmp(geoms.data(), previous_geoms.data(), bytes) == 0);
}

bool PlacedScene::same_images() const {
  for (size_t i = 0; i < appearance.lights.size(); i++) {
    const Light& l = appearance.lights[i];
    if (l.is_image() && std::memcmp(&l, &previous_lights[i], sizeof l) != 0) return false;
  }
  return true;
}

uint32_t PlacedScene::steady_lights() const {
  uint32_t steady = 0;
  for (size_t i = 0; i < std::min<size_t>(appearance.lights.size(), 32); i++) {
    const Light& l = appearance.lights[i];
    bool same = std::memcmp(&l, &previous_lights[i], sizeof l) == 0;
    if (same && !(l.castshadow && frame.shadows)) steady |= 1u << i;
  }
  return steady;
}

void PlacedScene::end_tick() {
  previous_geoms = geoms;
  previous_spheres = bounding_spheres;
  deformed.assign(deformed.size(), false);
  previous_lights = appearance.lights;
}

void PlacedScene::Spheres::reserve(int count) {
  for (std::vector<float>* part : {&x, &y, &z, &radius}) part->reserve(padded(count));
}

void PlacedScene::Spheres::resize(int count) {
  size_t size = padded(count);
  x.assign(size, 0.0f);
  y.assign(size, 0.0f);
  z.assign(size, 0.0f);
  radius.assign(size, -1.0f);
}

void PlacedScene::Spheres::set(int i, const BoundingSphere& s) {
  x[i] = s.center.x;
  y[i] = s.center.y;
  z[i] = s.center.z;
  radius[i] = s.radius;
}

BoundingSphereArray PlacedScene::Spheres::view() const {
  return {x.data(), y.data(), z.data(), radius.data(), static_cast<int>(x.size())};
}

void PlacedScene::Reaches::resize(size_t lights) {
  // the widest kernel reads 32 from any light on
  for (std::vector<float>& part : parts) part.assign(lights + 31, 0.0f);
}

void PlacedScene::Reaches::set(size_t i, const Light& light) {
  V3 p = light.position, d = light.direction;
  LightReach reach = light.reach();
  const float values[9] = {p.x, p.y, p.z, d.x, d.y, d.z, reach.cosine, reach.sine, reach.fade};
  for (int k = 0; k < 9; k++) parts[k][i] = values[k];
}

LightReachArray PlacedScene::Reaches::view() const {
  const std::vector<float>* a = parts;
  return {a[0].data(), a[1].data(), a[2].data(), a[3].data(), a[4].data(),
          a[5].data(), a[6].data(), a[7].data(), a[8].data()};
}

BoundingSphere PlacedScene::bounding_sphere_of(const Geom& g) const {
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
      const Bvh& bvh = mesh_data[g.mesh]->bvh;
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
BoundingSphere PlacedScene::mirrored_in_plane() const {
  if (frame.plane_count != 1) return {{0, 0, 0}, 1e30f};
  const Geom& plane = geoms[0];
  BoundingSphere sphere = frame.finite_bounds;
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

void PlacedScene::Moved::reserve(int geoms) {
  capsules.reserve(2 * static_cast<size_t>(geoms));
  spheres.reserve(2 * static_cast<size_t>(geoms));
  view.reserve(2 * geoms);
}

// Add one capsule that bounds a geom before and after its motion, or two if it moved far.
void PlacedScene::Moved::add(const BoundingCapsule& before, const BoundingCapsule& now) {
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
void PlacedScene::Moved::finish() {
  spheres.clear();
  view.resize(static_cast<int>(capsules.size()));
  for (const BoundingCapsule& capsule : capsules) {
    spheres.push_back({capsule.center, (capsule.half + capsule.radius) * 1.00001f});
    view.set(static_cast<int>(spheres.size()) - 1, spheres.back());
  }
  around = sphere_around(spheres.data(), spheres.size());
}

SceneChange PlacedScene::Moved::change() const {
  return {capsules.data(), view.view(), around, nullptr, nullptr, nullptr, 0};
}

bool PlacedScene::has_changed(size_t k) const {
  const Geom& g = geoms[k];
  return (g.mesh >= 0 && deformed[g.mesh]) ||
         std::memcmp(&g, &previous_geoms[k], sizeof(Geom)) != 0;
}

void PlacedScene::find_moved(bool soft) {
  moved_.capsules.clear();
  moved_soft_.capsules.clear();
  for (size_t k = 0; k < geoms.size(); k++) {
    const Geom& g = geoms[k];
    // a geom without a radius, before and now, is invisible
    bool solid = g.shape == PLANE || g.mesh >= 0;
    if (!solid && !(g.size[0] > 0) && !(previous_geoms[k].size[0] > 0)) continue;
    if (!has_changed(k)) continue;
    moved_.add(bounding_capsule(previous_geoms[k], previous_spheres[k]),
               bounding_capsule(g, bounding_spheres[k]));
    if (!soft) continue;
    auto outline = [](const Geom& shape, const BoundingSphere& s) {
      if (shape.shape == CAPSULE) return bounding_capsule(shape, s);
      return BoundingCapsule{s.center, {0, 0, 1}, 0, s.radius, 0, 0};
    };
    moved_soft_.add(outline(previous_geoms[k], previous_spheres[k]),
                    outline(g, bounding_spheres[k]));
  }
  moved_.finish();
  if (soft) moved_soft_.finish();
}

BoundingSphereArray PlacedScene::first_bounds() {
  if (!geoms.empty()) spheres_.set(0, {{0, 0, 0}, 0});
  return spheres_.view();
}

}  // namespace evs
