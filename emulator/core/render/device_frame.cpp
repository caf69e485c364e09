#include "device_frame.h"

#include <algorithm>
#include <memory>
#include <vector>

#include "integrators/blend.h"

namespace evs {

Caster::DeviceInputs Caster::device_inputs() const {
  DeviceInputs inputs = {frame_, {}, paths_, appearance_, {}, bvh_->geoms()};
  inputs.frame.bounds = spheres_.view();
  inputs.frame.bvh = bvh_->view();
  if (antialiasing_) inputs.first_pass = antialiasing_->base_frame(inputs.frame);
  for (int level = 0; level < GeomBvh::LEVELS; level++) {
    inputs.bvh_boxes[level] = bvh_->boxes(level);
  }
  return inputs;
}

void Caster::place_for_device(const Poses& poses) {
  place_geoms(poses);
  place_lights(poses);
  place_medium();
  paths_.seed = poses.seed;
  work_.ticks++;
  work_.packets_traced += static_cast<long>(sampling_.rows) * sampling_.columns;
  traced_fraction_ = 1;
}

DeviceFrame::DeviceFrame(Caster& caster) : caster_(caster) {
  DeviceBlock constant(0, nullptr), tick(0, nullptr);
  lay_out(constant, tick);
  constant_bytes_ = constant.bytes();
  tick_bytes_ = tick.bytes();
}

void DeviceFrame::copy_constant(uint64_t address, char* out) const {
  DeviceBlock constant(address, out), tick(0, nullptr);
  lay_out(constant, tick);
}

void DeviceFrame::copy_tick(const Poses& poses, uint64_t constant, uint64_t tick, char* out,
                            DeviceArguments& arguments) const {
  caster_.place_for_device(poses);
  DeviceBlock stays(constant, nullptr), changes(tick, out);
  arguments = lay_out(stays, changes);
}

DeviceArguments DeviceFrame::lay_out(DeviceBlock& constant, DeviceBlock& tick) const {
  Caster::DeviceInputs inputs = caster_.device_inputs();
  Frame f = inputs.frame;
  const Appearance& appearance = inputs.appearance;
  // what stays
  std::vector<Mesh> meshes;
  for (int i = 0; i < caster_.mesh_count(); i++) {
    const SceneData::MeshData& data = caster_.mesh(i);
    Mesh mesh = f.meshes[i];
    mesh.nodes = constant.put(mesh.nodes, data.bvh.nodes.size());
    mesh.triangles = constant.put(mesh.triangles, data.bvh.triangles.size());
    mesh.corners = constant.put(mesh.corners, data.corners.size());
    meshes.push_back(mesh);
  }
  std::vector<Texture> textures = appearance.textures;
  for (Texture& texture : textures) {
    size_t texels = static_cast<size_t>(texture.channels) * texture.channel_stride;
    texture.texels = constant.put(texture.texels, 2 * texels);
  }
  size_t width = static_cast<size_t>(f.width), height = static_cast<size_t>(f.height);
  f.meshes = constant.put(meshes.data(), meshes.size());
  f.textures = constant.put(textures.data(), textures.size());
  f.surfaces = constant.put(f.surfaces, appearance.surfaces.size());
  f.lens = constant.put(f.lens, 3 * (width + 1) * (height + 1));
  f.vignette = constant.put(f.vignette, width * height);
  auto put_samples = [&](Frame& one) {
    one.sample_x = constant.put(one.sample_x, static_cast<size_t>(one.samples));
    one.sample_y = constant.put(one.sample_y, static_cast<size_t>(one.samples));
    one.tap_x = constant.put(one.tap_x, static_cast<size_t>(one.taps));
    one.tap_y = constant.put(one.tap_y, static_cast<size_t>(one.taps));
  };
  put_samples(f);
  // bounds of packets, which a pixel alone does not need
  f.primary = f.pairs = nullptr;
  // what a tick changes
  size_t geoms = static_cast<size_t>(f.geom_count), lights = appearance.lights.size();
  f.geoms = tick.put(f.geoms, geoms);
  f.lights = tick.put(f.lights, lights);
  size_t spheres = static_cast<size_t>(f.bounds.count);
  for (const float** array : {&f.bounds.x, &f.bounds.y, &f.bounds.z, &f.bounds.radius}) {
    *array = tick.put(*array, spheres);
  }
  for (int level = 0; level < GeomBvh::LEVELS; level++) {
    BoundingBoxArray& b = f.bvh.boxes[level];
    for (const float** array : {&b.x, &b.y, &b.z, &b.half_x, &b.half_y, &b.half_z}) {
      *array = tick.put(*array, inputs.bvh_boxes[level]);
    }
  }
  f.bvh.geoms = tick.put(f.bvh.geoms, inputs.bvh_geoms);
  LightReachArray& r = f.reach;
  for (const float** array : {&r.x, &r.y, &r.z, &r.direction_x, &r.direction_y, &r.direction_z,
                              &r.cosine, &r.sine, &r.fade}) {
    *array = tick.put(*array, lights + 31);
  }
  // the first pass differs in its samples only
  Frame first = inputs.first_pass;
  if (first.samples > 0) {
    put_samples(first);
    first.meshes = f.meshes, first.textures = f.textures, first.surfaces = f.surfaces;
    first.lens = f.lens, first.vignette = f.vignette;
    first.primary = first.pairs = nullptr;
    first.geoms = f.geoms, first.lights = f.lights;
    first.bounds = f.bounds, first.bvh = f.bvh, first.reach = f.reach;
  }
  // what paths need besides
  PathFrame p = inputs.paths;
  EnvironmentDistribution& sky = p.environment;
  size_t side = static_cast<size_t>(sky.side), rows = 6 * side, cells = rows * side;
  sky.rows = constant.put(sky.rows, rows);
  sky.cells = constant.put(sky.cells, cells);
  sky.pdf = constant.put(sky.pdf, cells);
  sky.row_guide = constant.put(sky.row_guide, rows);
  sky.cell_guide = constant.put(sky.cell_guide, cells);
  std::vector<Emitter> emitters(p.emitters, p.emitters + p.emitter_count);
  for (Emitter& e : emitters) {
    e.cumulative = constant.put(e.cumulative, static_cast<size_t>(e.triangles));
  }
  p.emitters = constant.put(emitters.data(), emitters.size());
  p.emitter_of_geom = constant.put(p.emitter_of_geom, geoms);
  p.transparent_geoms = constant.put(p.transparent_geoms, static_cast<size_t>(p.transparent_count));
  p.world = tick.put(p.world, 9);
  return {f, first, p};
}

void render_device_frame(const Kernel& kernel, const DeviceArguments& arguments, float* luminance) {
  const Frame &frame = arguments.frame, &first_pass = arguments.first_pass;
  constexpr int PACKET = PACKET_WIDTH * PACKET_HEIGHT;
  bool adaptive = first_pass.samples > 0, path = arguments.paths.lobe_samples > 0;
  std::vector<float> untextured(adaptive ? static_cast<size_t>(frame.width) * frame.height : 0);
  auto at = [&](int x, int y) { return static_cast<long>(y) * frame.width + x; };
  auto for_image = [&](auto pixel) {
    for (int y = 0; y < frame.height; y++) {
      for (int x = 0; x < frame.width; x++) pixel(x, y);
    }
  };
  auto batch = path ? std::make_unique<PathBatch>() : nullptr;
  for_image([&](int x, int y) {
    float *out = luminance + at(x, y),
          *plain = adaptive ? &untextured[static_cast<size_t>(at(x, y))] : nullptr;
    if (path) {
      kernel.trace_path_pixels(frame, arguments.paths, *batch, &x, &y, 1, out);
    } else {
      kernel.trace_pixels(adaptive ? first_pass : frame, &x, &y, 1, out, plain);
    }
  });
  if (!adaptive) return;
  for_image([&](int x, int y) {
    float near[9][PACKET] = {}, weight[PACKET], all;
    const float* neighbours[9];
    for (int i = 0; i < 9; i++) {
      int column = std::clamp(x + i % 3 - 1, 0, frame.width - 1);
      int row = std::clamp(y + i / 3 - 1, 0, frame.height - 1);
      near[i][0] = untextured[static_cast<size_t>(at(column, row))];
      neighbours[i] = near[i];
    }
    kernel.refinement_weight(neighbours, weight);
    if (!(weight[0] > 0)) return;
    kernel.trace_pixels(frame, &x, &y, 1, &all, nullptr);
    luminance[at(x, y)] = blend(luminance[at(x, y)], all, weight[0]);
  });
}

}  // namespace evs
