#include "render/device_frame.h"

#include <algorithm>
#include <memory>
#include <vector>

#include "render/integrators/antialiasing_blend.h"

namespace evs {

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

Caster::Place DeviceFrame::copy_tick(const Poses& poses, uint64_t constant, uint64_t tick,
                                     char* out, DeviceArguments& arguments) const {
  Caster::Place place = caster_.place_for_device(poses);
  DeviceBlock stays(constant, nullptr), changes(tick, out);
  arguments = lay_out(stays, changes);
  return place;
}

uint64_t DeviceFrame::cache_bytes() const {
  DeviceBlock counted(0, nullptr);
  lay_out_cache(counted);
  return counted.bytes();
}

void DeviceFrame::copy_cache(bool edges, uint64_t address, uint64_t used_address, char* out,
                             uint8_t* used, DeviceArguments& arguments) const {
  using Cache = IrradianceCache;
  const Cache& cache =
      caster_.hybrid()->begin_device_pass(edges ? Cache::EDGES : Cache::ALL_PIXELS);
  DeviceBlock block(address, out);
  arguments.cache = lay_out_cache(block);
  arguments.cache.used = reinterpret_cast<uint8_t*>(used_address);
  std::copy(cache.used().begin(), cache.used().end(), used);
}

IrradianceView DeviceFrame::lay_out_cache(DeviceBlock& block) const {
  const IrradianceCache& cache = caster_.hybrid()->irradiance();
  Caster::DeviceInputs inputs = caster_.device_inputs();
  IrradianceView view = cache.view();
  view.slots = block.put(view.slots, cache.slot_count());
  view.light = block.put(view.light, 4 * static_cast<size_t>(cache.size()));
  view.lamp_x = block.put(view.lamp_x, LAMP_POINTS);
  view.lamp_y = block.put(view.lamp_y, LAMP_POINTS);
  size_t emitters = static_cast<size_t>(inputs.paths.emitter_count);
  view.lamp_points = block.put(view.lamp_points, emitters * LAMP_POINTS);
  view.tint = block.put(view.tint, 4 * inputs.appearance.surfaces.size());
  return view;
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
    if (!texture.words) continue;
    const TextureLevel& whole = texture.level[0];
    texture.words =
        constant.put(texture.words, static_cast<size_t>(whole.width + 2) * (whole.height + 2));
    texture.decoded = constant.put(texture.decoded, 3 * 256);
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
    one.edge_x = constant.put(one.edge_x, EDGE_RAYS);
    one.edge_y = constant.put(one.edge_y, EDGE_RAYS);
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
  return {f, first, p, {}};
}

namespace {

constexpr int PACKET = PACKET_WIDTH * PACKET_HEIGHT;

// How much all samples of a pixel count. In: untextured (h, w).
float weight_of_pixel(const Kernel& kernel, const Frame& frame, int x, int y,
                      const float* untextured) {
  float near[9][PACKET] = {}, weight[PACKET];
  const float* neighbours[9];
  for (int i = 0; i < 9; i++) {
    int column = std::clamp(x + i % 3 - 1, 0, frame.width - 1);
    int row = std::clamp(y + i / 3 - 1, 0, frame.height - 1);
    near[i][0] = untextured[static_cast<long>(row) * frame.width + column];
    neighbours[i] = near[i];
  }
  kernel.refinement_weight(neighbours, weight);
  return weight[0];
}

}  // namespace

void render_device_frame(const Kernel& kernel, const DeviceArguments& arguments, float* luminance) {
  const Frame &frame = arguments.frame, &first_pass = arguments.first_pass;
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
    float all[PACKET], weight = weight_of_pixel(kernel, frame, x, y, untextured.data());
    if (!(weight > 0)) return;
    int pixel = place_in_packet(x, y);
    kernel.refine(frame, x / PACKET_WIDTH, y / PACKET_HEIGHT, 1u << pixel, all, nullptr, nullptr);
    luminance[at(x, y)] = blend(luminance[at(x, y)], all[pixel], weight);
  });
}

void trace_device_pixels(const Kernel& kernel, const DeviceArguments& arguments, bool edges,
                         const DevicePixelLight& light, DeviceNodes& nodes) {
  const bool adaptive = arguments.first_pass.samples > 0;
  Frame frame = adaptive && !edges ? arguments.first_pass : arguments.frame;
  constexpr float EVERYWHERE = 1e30f;
  int columns = frame.packet_columns, rows = (frame.height + PACKET_HEIGHT - 1) / PACKET_HEIGHT;
  std::vector<RayCone> cones(static_cast<size_t>(rows) * columns);
  std::fill(cones.begin(), cones.end(),
            RayCone{{0, 0, 0}, {0, 0, -1}, EVERYWHERE, EVERYWHERE, 0.5f, 0.8660254f});
  frame.primary = cones.data();
  auto requests = std::make_unique<NodeRequests>();
  requests->forget_cells();
  requests->owner = &nodes;
  requests->keep = [](NodeRequests& r) {
    auto& to = *static_cast<DeviceNodes*>(r.owner);
    to.missing.insert(to.missing.end(), r.at, r.at + r.count);
    to.readers.insert(to.readers.end(), r.readers, r.readers + r.reader_count);
    r.count = r.reader_count = 0;
  };
  // the light without textures has a margin, which here is another line or column
  long stride = 4L * columns + 2;
  std::vector<float> untextured(static_cast<size_t>((rows * PACKET_HEIGHT + 2) * stride));
  Outputs out = {light.luminance, nullptr, light.untextured ? untextured.data() : nullptr, stride,
                 nullptr};
  auto at = [&](int x, int y) { return static_cast<long>(y) * frame.width + x; };
  for (int row = 0; row < rows && !edges; row++) {
    for (int column = 0; column < columns; column++) {
      kernel.trace_hybrid(frame, arguments.paths, arguments.cache, *requests, column, row, out,
                          nullptr);
      requests->complete = true;
    }
  }
  for (int y = 0; y < frame.height; y++) {
    for (int x = 0; x < frame.width; x++) {
      if (!edges && light.untextured) {
        light.untextured[at(x, y)] = untextured[static_cast<size_t>((y + 1) * stride + x + 1)];
      }
      if (!edges) continue;
      float refined[PACKET], weight = weight_of_pixel(kernel, frame, x, y, light.untextured);
      light.luminance[at(x, y)] = light.base[at(x, y)];
      if (!(weight > 0)) continue;
      int pixel = place_in_packet(x, y);
      kernel.refine_hybrid(frame, arguments.paths, arguments.cache, *requests, x / PACKET_WIDTH,
                           y / PACKET_HEIGHT, 1u << pixel, refined, nullptr, nullptr);
      requests->complete = true;
      light.luminance[at(x, y)] = blend(light.base[at(x, y)], refined[pixel], weight);
    }
  }
  requests->keep(*requests);
}

}  // namespace evs
