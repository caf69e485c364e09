#include "render/caster.h"

#include <algorithm>
#include <atomic>
#include <cmath>
#include <cstring>

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

bool has_shading(const CachedShading& shading) { return shading.numbers && *shading.geom >= 0; }

// Can two packets be relit at once? In: the first has cached shading.
bool alike(const CachedShading& a, const CachedShading& b) {
  return has_shading(b) && *a.geom == *b.geom && a.lights == b.lights;
}

}  // namespace

Caster::Caster(const SceneData& scene, const Optics& optics, const Tracing& tracing, int threads,
               const std::string& isa, const Caster* before)
    : kernel_(kernel_of(isa)),
      pool_(before ? before->pool_ : std::make_shared<ThreadPool>(threads)),
      incremental_(tracing.incremental && kernel_->find_dirty_packets),
      forced_(tracing.forced),
      mesh_data_(scene.meshes),
      appearance_(make_appearance(scene, tracing.rgb || tracing.hybrid || tracing.forced.on(COLOUR),
                                  tracing.path, tracing.forced.off(COLOUR),
                                  before ? &before->appearance_ : nullptr)) {
  for (const auto& m : mesh_data_) {
    bool shared = before && std::count(before->mesh_data_.begin(), before->mesh_data_.end(), m) > 0;
    work_.bvhs_built += !shared;
    meshes_.push_back(mesh_view(*m));
  }
  int count = static_cast<int>(scene.geom_type.size());
  for (int pass = 0; pass < 3; pass++) {
    for (int g = 0; g < count; g++) {
      bool is_mesh = scene.geom_type[g] == MESH || scene.geom_type[g] == HFIELD;
      int its_pass = is_mesh ? 2 : scene.geom_type[g] == PLANE ? 0 : 1;
      if (its_pass == pass) order_.push_back(g);
    }
  }
  place_.resize(count);
  for (int k = 0; k < count; k++) place_[order_[k]] = k;
  geoms_.resize(count);
  std::memset(static_cast<void*>(geoms_.data()), 0, count * sizeof(Geom));
  for (int k = 0; k < count; k++) {
    int g = order_[k];
    geoms_[k].shape = scene.geom_type[g];
    geoms_[k].mesh = scene.geom_mesh[g];
    geoms_[k].surface = scene.geom_surface[g];
    geoms_[k].rank = g;
    for (int a = 0; a < 3; a++) geoms_[k].size[a] = scene.geom_size[3 * g + a];
  }
  // reserve here what a tick needs: it allocates nothing
  previous_geoms_ = geoms_;
  spheres_.resize(count);
  bounding_spheres_.resize(count);
  previous_spheres_.resize(count);
  moved_.reserve(count);
  moved_soft_.reserve(count);
  previous_lights_ = appearance_.lights;
  camera_.reserve(12);
  deformed_.resize(mesh_data_.size());
  shapes_.resize(mesh_data_.size());
  const bool at_edges = tracing.path && tracing.adaptive && tracing.samples > 1;
  const int samples = at_edges ? EdgeSampling::base_samples(tracing.samples) : tracing.samples;
  set_optics(optics, samples, sampling_, frame_);
  frame_.geoms = geoms_.data();
  frame_.geom_count = count;
  frame_.plane_count = static_cast<int>(
      std::count_if(geoms_.begin(), geoms_.end(), [](const Geom& g) { return g.shape == PLANE; }));
  int others = count - frame_.plane_count;
  bvh_.emplace(frame_.plane_count, forced_.decide(HIERARCHY, others > FEW_GEOMS) ? others : 0);
  frame_.bvh = bvh_->view();
  frame_.meshes = meshes_.data();
  frame_.surfaces = appearance_.surfaces.data();
  frame_.textures = appearance_.textures.data();
  frame_.lights = appearance_.lights.data();
  frame_.light_count = static_cast<int>(appearance_.lights.size());
  reaches_.resize(appearance_.lights.size());
  frame_.reach = reaches_.view();
  auto bounded = std::count_if(appearance_.lights.begin(), appearance_.lights.end(),
                               [](const Light& light) { return light.reach().bounded(); });
  frame_.cull_lights = forced_.decide(LIGHT_REACH, bounded > FEW_LIGHTS);
  frame_.skybox = appearance_.skybox;
  // direct light knows no sky
  frame_.sky_shines = appearance_.sky_shines && (tracing.path || tracing.hybrid);
  frame_.channels = appearance_.channels;
  std::copy(appearance_.weights, appearance_.weights + MAX_CHANNELS, frame_.weights);
  frame_.lobes = forced_.decide(LOBES, appearance_.layered || tracing.path || tracing.hybrid);
  if (forced_.decide(TEXTURE_FILTER, appearance_.textured)) frame_.probes = probes_of(samples);
  frame_.normal_mapped = forced_.decide(NORMAL_MAPS, appearance_.normal_mapped);
  if (forced_.off(FOG)) appearance_.medium.fog = false;
  if (forced_.off(HAZE)) appearance_.medium.haze = false;
  if (forced_.on(FOG) && !appearance_.medium.fog) add_clear_fog(appearance_.medium);
  frame_.medium = appearance_.medium;
  // the first infinite plane has the horizon
  for (int k = count - 1; k >= 0; k--) {
    bool endless = geoms_[k].size[0] <= 0 && geoms_[k].size[1] <= 0;
    if (geoms_[k].shape == PLANE && endless) haze_plane_ = k;
  }
  full_lights_ = appearance_.lights;
  gains_.assign(appearance_.lights.size(), 1.0f);
  frame_.colour = frame_.channels == 3 ? 0 : 1;
  frame_.shadows = forced_.decide(SHADOWS, tracing.shadows);
  if (tracing.adaptive && !tracing.path && tracing.samples > 1) {
    antialiasing_.emplace(optics, sampling_, tracing.rgb);
  }
  if (incremental_ && !tracing.path && !tracing.hybrid) {
    // a packet's shading can be cached with one sample a pixel
    int channels = antialiasing_ ? frame_.channels + 1 : tracing.samples == 1 ? frame_.channels : 0;
    packet_cache_.emplace(sampling_, channels, appearance_.lights, frame_.shadows);
  }
  if (tracing.hybrid) set_hybrid(optics, tracing, scene);
  if (tracing.path) {
    emitters_.emplace(scene, appearance_, order_);
    paths_.bounces = tracing.bounces;
    paths_.sample_set = tracing.sample_set;
    paths_.lobe_samples = samples;
    while ((1 << paths_.log2_samples) < tracing.samples) paths_.log2_samples++;
    paths_.quarters = at_edges && 1 << paths_.log2_samples == tracing.samples && samples > 1;
    paths_.block = tracing.block;
    while ((1 << paths_.log2_blocks) < tracing.blocks) paths_.log2_blocks++;
    set_paths();
    batches_ = std::make_unique_for_overwrite<PathBatch[]>(pool_->threads());
    if (at_edges) edges_.emplace(optics.width, optics.height, tracing.samples, tracing.rgb);
    if (incremental_)
      path_cache_.emplace(optics.width, optics.height, samples, geoms_.size(), nullptr, at_edges);
    if (incremental_ && at_edges)
      edge_cache_.emplace(optics.width, optics.height, tracing.samples - samples, geoms_.size(),
                          edges_->edges(), false);
  }
}

// Copy the emitters' part into the path frame.
void Caster::set_paths() {
  PathFrame f = emitters_->frame();
  f.bounces = paths_.bounces;
  f.sample_set = paths_.sample_set;
  f.lobe_samples = paths_.lobe_samples;
  f.quarters = paths_.quarters;
  f.transparent_geoms = paths_.transparent_geoms;
  f.transparent_count = paths_.transparent_count;
  f.log2_samples = paths_.log2_samples;
  f.block = paths_.block;
  f.log2_blocks = paths_.log2_blocks;
  f.emits = f.emissive;
  f.emissive = forced_.decide(EMISSIVE, f.emissive);
  f.transparent = forced_.decide(TRANSPARENT, f.transparent);
  paths_ = f;
  // the light of a lamp that is forgotten is kept nowhere
  kept_of_last_ = Recording::NOTHING;
}

void Caster::deform_mesh(int index, const float* vertices, const float* normals) {
  std::shared_ptr<SceneData::MeshData>& data = mesh_data_.at(index);
  if (data.use_count() > 1) data = std::make_shared<SceneData::MeshData>(*data);
  SceneData::MeshData& mesh = *data;
  // a body at rest costs only a comparison
  size_t count = 3 * static_cast<size_t>(mesh.vertex_count);
  std::vector<float>& last = shapes_[index];
  bool same = last.size() == 2 * count && std::equal(vertices, vertices + count, last.begin()) &&
              std::equal(normals, normals + count, last.begin() + static_cast<long>(count));
  if (!forced_.decide(REFITS, !same)) return;
  work_.bvhs_refitted++;
  last.assign(vertices, vertices + count);
  last.insert(last.end(), normals, normals + count);
  deform(mesh, vertices, normals);
  meshes_[index] = mesh_view(mesh);
  deformed_[index] = true;
  if (emitters_) {
    emitters_->forget_mesh(index);
    set_paths();
  }
}

void Caster::resize_geoms(const int32_t* geoms, const float* sizes, int count) {
  bool forgotten = false;
  for (int i = 0; i < count; i++) {
    int k = place_[geoms[i]];
    std::copy(sizes + 3 * i, sizes + 3 * i + 3, geoms_[k].size);
    forgotten = (emitters_ && emitters_->forget_geom(k)) || forgotten;
  }
  if (forgotten) set_paths();
}

void Caster::place_geoms(const Poses& p) {
  const double* cm = p.camera_mat;
  for (size_t k = 0; k < geoms_.size(); k++) {
    Geom& g = geoms_[k];
    const double *pos = p.geom_pos + 3 * order_[k], *mat = p.geom_mat + 9 * order_[k];
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
    bounding_spheres_[k] = bounding_sphere_of(g);
    spheres_.set(static_cast<int>(k), bounding_spheres_[k]);
  }
  frame_.bounds = spheres_.view();
  bvh_->update(geoms_.data(), meshes_.data());
  frame_.bvh = bvh_->view();
  frame_.finite_bounds = sphere_around(bounding_spheres_.data() + frame_.plane_count,
                                       geoms_.size() - static_cast<size_t>(frame_.plane_count));
  frame_.mirrored_bounds = mirrored_in_plane();
  for (int i = 0; i < 9; i++) frame_.camera_to_world[i] = static_cast<float>(cm[i]);
}

uint32_t Caster::non_occluding_planes(const Light& l) const {
  uint32_t non_occluders = 0;
  if (forced_.on(PLANE_SHADOWS)) return non_occluders;
  if (forced_.off(PLANE_SHADOWS)) return ~non_occluders;
  for (size_t k = 0; k < std::min<size_t>(geoms_.size(), 32); k++) {
    const Geom& g = geoms_[k];
    if (g.shape != PLANE) break;
    V3 w = {-l.direction.x, -l.direction.y, -l.direction.z};
    if (!l.is_delta_direction()) {
      w = {l.position.x - g.position.x, l.position.y - g.position.y, l.position.z - g.position.z};
    }
    float height = w.x * g.rotation[2] + w.y * g.rotation[5] + w.z * g.rotation[8];
    // exclude rounding errors and, where lights are bulbs, their radius
    float part = emitters_ && !l.is_delta_direction() ? l.radius : 0;
    if (height > 1e-5f * std::hypot(w.x, w.y, w.z) + part) non_occluders |= 1u << k;
  }
  return non_occluders;
}

void Caster::place_lights(const Poses& p) {
  for (size_t i = 0; i < appearance_.lights.size(); i++) {
    Light& l = appearance_.lights[i];
    const Light& full = full_lights_[i];
    for (int c = 0; c < MAX_CHANNELS; c++) {
      l.ambient[c] = full.ambient[c] * gains_[i];
      l.diffuse[c] = full.diffuse[c] * gains_[i];
      l.specular[c] = full.specular[c] * gains_[i];
    }
    if (appearance_.headlight[i]) {
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

void Caster::set_light_gains(const float* gains) {
  std::copy(gains, gains + gains_.size(), gains_.begin());
}

// Haze is drawn only from a camera above the plane; an orthographic camera has no horizon.
void Caster::place_medium() {
  Medium& medium = frame_.medium;
  medium = appearance_.medium;
  medium.haze = appearance_.medium.haze && haze_plane_ >= 0 && !frame_.orthographic;
  if (medium.haze) {
    const Geom& plane = geoms_[haze_plane_];
    medium.haze_up = {plane.rotation[2], plane.rotation[5], plane.rotation[8]};
    medium.haze_elevation = plane.camera.z / medium.haze_radius;
    medium.haze = medium.haze_elevation > 0;
  }
  if (!medium.haze && forced_.on(HAZE)) add_clear_haze(medium);
}

void Caster::render(const Poses& poses, float* luminance, float* rgb) {
  place_geoms(poses);
  place_lights(poses);
  place_medium();
  bool first = camera_.empty(), still = is_still(poses);
  bool selective = incremental_ && still && !forced_.on(FULL_RETRACE);
  work_.ticks++;
  if (!first && forced_.off(FULL_RETRACE)) {
    traced_fraction_ = 0;
    return;
  }

  Outputs out = {luminance, rgb, nullptr, 0, nullptr};
  if (irradiance_) {
    paths_.seed = poses.seed;
    bool same = still && poses.seed == previous_seed_ && same_lights() && same_scene();
    if (begin_hybrid(same)) trace_hybrid(selective && poses.seed == previous_seed_, out);
    previous_seed_ = poses.seed;
  } else if (emitters_) {
    paths_.seed = poses.seed;
    bool same_lamps = same_lights();
    trace_paths(first, selective && poses.seed == previous_seed_ && (same_lamps || same_images()),
                same_lamps, out);
    previous_seed_ = poses.seed;
  } else {
    trace_direct(still, selective, out);
  }
  end_tick();
}

// Is the camera where it was in the last call?
bool Caster::is_still(const Poses& poses) {
  bool first = camera_.empty();
  camera_.resize(12);
  bool still = !first && std::equal(camera_.begin(), camera_.begin() + 3, poses.camera_pos) &&
               std::equal(camera_.begin() + 3, camera_.end(), poses.camera_mat);
  std::copy(poses.camera_pos, poses.camera_pos + 3, camera_.begin());
  std::copy(poses.camera_mat, poses.camera_mat + 9, camera_.begin() + 3);
  return still;
}

bool Caster::same_lights() const {
  size_t bytes = appearance_.lights.size() * sizeof(Light);
  return bytes == 0 || std::memcmp(appearance_.lights.data(), previous_lights_.data(), bytes) == 0;
}

// Are all geoms where they were in the last tick, in the same shape?
bool Caster::same_scene() const {
  size_t bytes = geoms_.size() * sizeof(Geom);
  return std::find(deformed_.begin(), deformed_.end(), true) == deformed_.end() &&
         (bytes == 0 || std::memcmp(geoms_.data(), previous_geoms_.data(), bytes) == 0);
}

// Are the image lights those of the last tick?
bool Caster::same_images() const {
  for (size_t i = 0; i < appearance_.lights.size(); i++) {
    const Light& l = appearance_.lights[i];
    if (l.is_image() && std::memcmp(&l, &previous_lights_[i], sizeof l) != 0) return false;
  }
  return true;
}

// Find which of the first 32 lights are unchanged and cast no shadow, one bit each.
uint32_t Caster::steady_lights() const {
  uint32_t steady = 0;
  for (size_t i = 0; i < std::min<size_t>(appearance_.lights.size(), 32); i++) {
    const Light& l = appearance_.lights[i];
    bool same = std::memcmp(&l, &previous_lights_[i], sizeof l) == 0;
    if (same && !(l.castshadow && frame_.shadows)) steady |= 1u << i;
  }
  return steady;
}

void Caster::end_tick() {
  previous_geoms_ = geoms_;
  previous_spheres_ = bounding_spheres_;
  deformed_.assign(deformed_.size(), false);
  previous_lights_ = appearance_.lights;
}

void Caster::trace_truth(const Poses& poses, const Truth& out) {
  place_geoms(poses);
  pool_->run(sampling_.rows, [&](int row, int) {
    for (int column = 0; column < sampling_.columns; column++) {
      kernel_->trace_truth(frame_, column, row, out);
    }
    // map the kernel's order of geoms and triangles to the scene's
    long begin = static_cast<long>(row) * PACKET_HEIGHT * frame_.width;
    long end = std::min<long>(begin + PACKET_HEIGHT * frame_.width,
                              static_cast<long>(frame_.width) * frame_.height);
    for (long i = begin; i < end; i++) {
      if (out.geom[i] < 0) continue;
      const Geom& g = geoms_[out.geom[i]];
      if (out.triangle[i] >= 0) out.triangle[i] = mesh_data_[g.mesh]->bvh.order[out.triangle[i]];
      out.geom[i] = order_[out.geom[i]];
    }
  });
}

void Caster::trace_pixels(const Poses& poses, const int32_t* x, const int32_t* y, int count,
                          float* luminance) {
  place_geoms(poses);
  place_lights(poses);
  place_medium();
  paths_.seed = poses.seed;
  Frame base = antialiasing_ ? antialiasing_->base_frame(frame_) : frame_;
  constexpr int PACKET = PACKET_WIDTH * PACKET_HEIGHT, PACKETS_A_JOB = 16;
  constexpr int PIXELS_A_JOB = PACKET * PACKETS_A_JOB;
  pool_->run((count + PIXELS_A_JOB - 1) / PIXELS_A_JOB, [&](int job, int worker) {
    int end = std::min(count, (job + 1) * PIXELS_A_JOB);
    for (int i = job * PIXELS_A_JOB; i < end; i += PACKET) {
      int n = std::min(PACKET, end - i);
      if (edges_) {
        edges_->trace_pixels(*kernel_, frame_, paths_, batches_[worker], x + i, y + i, n,
                             luminance + i);
      } else if (emitters_) {
        kernel_->trace_path_pixels(frame_, paths_, batches_[worker], x + i, y + i, n,
                                   luminance + i);
      } else if (antialiasing_) {
        antialiasing_->trace_pixels(*kernel_, frame_, base, x + i, y + i, n, luminance + i);
      } else {
        kernel_->trace_pixels(frame_, x + i, y + i, n, luminance + i, nullptr);
      }
    }
  });
}

// One tick of the `direct` integrator. In: whether the camera stands still, and whether only dirty
// packets are traced then.
void Caster::trace_direct(bool still, bool selective, const Outputs& out) {
  bool recording = packet_cache_ && (work_.ticks == 1 || still);
  selective = selective && recorded_ &&
              !packet_cache_->drop_changed_lights(appearance_.lights, previous_lights_);
  recorded_ = recording;
  long packets = static_cast<long>(sampling_.rows) * sampling_.columns;
  if (selective) {
    work_.packets_tested += packets;
    find_moved();
    bool lights_stay = same_lights();
    if (moved_.capsules.empty() && lights_stay) {
      traced_fraction_ = 0;
      return;
    }
    SceneChange change = moved_.change();
    change.lights = lights_stay ? nullptr : previous_lights_.data();
    packet_cache_->find_dirty(*kernel_, frame_, change, *pool_);
  } else if (recording) {
    packet_cache_->record_all();
  }

  Outputs first_out = antialiasing_ ? antialiasing_->base() : out;
  Frame first_frame = antialiasing_ ? antialiasing_->base_frame(frame_) : frame_;
  std::atomic<long> traced{0}, relit{0};
  bool pairs = kernel_->trace_pair && frame_.pairs;
  pool_->run(sampling_.rows, [&](int row, int) {
    using Dirty = PacketCache::Dirty;
    long retraced = 0, lit = 0;
    auto dirty_of = [&](int column) {
      if (selective) return packet_cache_->dirty(column, row);
      return recording ? Dirty::RETRACE : Dirty::RETRACE_UNRECORDED;
    };
    for (int column = 0; column < sampling_.columns; column++) {
      if (selective && column % BLOCK_WIDTH == 0 && !packet_cache_->any_dirty(column, row)) {
        column += BLOCK_WIDTH - 1;
        continue;
      }
      Dirty dirty = dirty_of(column);
      if (dirty == Dirty::CLEAN) continue;
      bool even = column % 2 == 0 && column + 1 < sampling_.columns;
      if (pairs && even && dirty == Dirty::RETRACE_UNRECORDED &&
          dirty_of(column + 1) == Dirty::RETRACE_UNRECORDED) {
        kernel_->trace_pair(first_frame, column, row, first_out);
        for (int k = 0; k < 2 && antialiasing_; k++) antialiasing_->traced(column + k, row);
        retraced += 2;
        column++;
        continue;
      }
      PacketRecord record = {};
      if (recording) record = packet_cache_->record(column, row);
      if (dirty == Dirty::RELIGHT && has_shading(record.shading)) {
        CachedShading cached[2] = {record.shading, {}};
        if (kernel_->relight_pair && column + 1 < sampling_.columns &&
            dirty_of(column + 1) == Dirty::RELIGHT) {
          cached[1] = packet_cache_->record(column + 1, row).shading;
        }
        if (alike(cached[0], cached[1])) {
          kernel_->relight_pair(first_frame, column, row, first_out, cached);
          if (antialiasing_) antialiasing_->traced(column, row);
          column++;
          lit++;
        } else {
          kernel_->relight(first_frame, column, row, first_out, cached);
        }
        lit++;
      } else {
        // where only light changes, the recorded rays stay valid
        bool recording_rays = recording && dirty == Dirty::RETRACE;
        kernel_->trace(first_frame, column, row, first_out, recording_rays ? &record : nullptr);
        retraced++;
      }
      if (antialiasing_) antialiasing_->traced(column, row);
    }
    traced += retraced;
    relit += lit;
  });
  if (antialiasing_ && traced + relit > 0) {
    antialiasing_->close_margin();
    pool_->run(sampling_.rows, [&](int row, int) {
      antialiasing_->finish_row(*kernel_, frame_, row, out, recording ? &*packet_cache_ : nullptr);
    });
    antialiasing_->next_tick();
  }
  work_.packets_traced += traced;
  work_.packets_relit += relit;
  traced_fraction_ = static_cast<double>(traced) / static_cast<double>(packets);
}

// One pass of the `path` integrator over all pixels, or over those whose bit in `marked` is set.
// Out: the number of samples traced.
long Caster::trace_pass(const Frame& f, const PathFrame& p, PathCache* cache, PathCache::Plan plan,
                        const uint32_t* marked, const Outputs& out) {
  std::atomic<long> traced{0};
  if (plan == PathCache::Plan::TRACE_UNCACHED) {
    pool_->run(sampling_.rows, [&](int row, int worker) {
      if (marked) {
        traced += f.samples * kernel_->trace_marked_row(f, p, batches_[worker], row, marked, out);
      } else {
        kernel_->trace_path_row(f, p, batches_[worker], row, out);
      }
    });
    return marked ? traced.load() : static_cast<long>(f.width) * f.height * f.samples;
  }
  // several rows per job fill the packets; more jobs than workers balance the load
  int rows = std::clamp(sampling_.rows / (8 * pool_->threads()), 1, 8);
  pool_->run((sampling_.rows + rows - 1) / rows, [&](int job, int worker) {
    int begin = job * rows, end = std::min(begin + rows, sampling_.rows);
    traced += kernel_->update_cached_paths(f, p, batches_[worker], cache->view(), begin, end, out);
  });
  return traced;
}

// One tick of the `path` integrator. In: whether camera, environment and seed are those of the last
// tick; and whether MuJoCo's lights are.
void Caster::trace_paths(bool first, bool same, bool same_lamps, const Outputs& out) {
  auto plan = PathCache::Plan::TRACE_UNCACHED, edge_plan = plan;
  if (path_cache_ && !first) {
    PathCache::GeomStates states = {
        geoms_,    previous_geoms_,       bounding_spheres_, previous_spheres_,
        deformed_, paths_.emitter_of_geom};
    find_moved();
    if (same && same_lamps && moved_.capsules.empty()) {
      traced_fraction_ = 0;
      return;
    }
    plan = path_cache_->plan(states, same, same_lamps, steady_lights());
    if (edges_) edge_plan = edge_cache_->plan(states, same, same_lamps, steady_lights());
  }
  const double pixels = static_cast<double>(frame_.width) * frame_.height;
  const Outputs base = edges_ ? edges_->base() : out;
  PathCache* cache = path_cache_ ? &*path_cache_ : nullptr;
  double traced = static_cast<double>(trace_pass(frame_, paths_, cache, plan, nullptr, base));
  double samples = pixels * frame_.samples;
  if (plan != PathCache::Plan::TRACE_UNCACHED) path_cache_->traced(traced / samples);
  if (edges_) {
    std::atomic<long> edges{0};
    pool_->run(sampling_.rows, [&](int row, int) {
      int top = row * PACKET_HEIGHT, bottom = std::min(top + PACKET_HEIGHT, frame_.height);
      for (int y = top; y < bottom; y++) edges += edges_->find_edges(y);
    });
    Frame f = edges_->rest_frame(frame_);
    cache = edge_cache_ ? &*edge_cache_ : nullptr;
    long rest = trace_pass(f, edges_->rest_paths(paths_), cache, edge_plan, edges_->edges(),
                           edges_->rest());
    double rest_samples = static_cast<double>(edges) * f.samples;
    if (edge_plan != PathCache::Plan::TRACE_UNCACHED && edges > 0)
      edge_cache_->traced(static_cast<double>(rest) / rest_samples);
    pool_->run(sampling_.rows, [&](int row, int) {
      int top = row * PACKET_HEIGHT, bottom = std::min(top + PACKET_HEIGHT, frame_.height);
      for (int y = top; y < bottom; y++) edges_->combine(y, out);
    });
    traced += static_cast<double>(rest);
    samples += rest_samples;
  }
  traced_fraction_ = traced / samples;
  long packets = static_cast<long>(sampling_.rows) * sampling_.columns;
  // as many packets as those samples fill
  if (plan == PathCache::Plan::TRACE_DIRTY) work_.packets_tested += packets;
  work_.packets_traced += static_cast<long>(static_cast<double>(packets) * traced_fraction_);
}

}  // namespace evs
