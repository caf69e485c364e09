// The CPU's side of the comparison with a GPU, as a library for measure.py: what single operations,
// rays and frames give here, and a frame's data as a GPU reads them.

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <memory>
#include <string>
#include <thread>
#include <vector>

#include "caster.h"
#include "math_ops.inl"
#include "ray_op.inl"
#include "thread_pool.h"

#define EVS_EXPORT extern "C" __attribute__((visibility("default")))

namespace evs {
namespace {

// Call part(k) for k = 0 ... threads - 1, in as many threads, with denormals flushed.
template <class Part>
void in_threads(int threads, const Part& part) {
  std::vector<std::thread> workers;
  for (int k = 0; k < threads; k++) {
    workers.emplace_back([&part, k] {
      FlushDenormals flush;
      part(k);
    });
  }
  for (std::thread& worker : workers) worker.join();
}

// A sphere with bumps.
SceneData::MeshData bumpy_sphere(int rows, int columns) {
  std::vector<float> vertices, uv;
  std::vector<int32_t> faces;
  for (int r = 0; r <= rows; r++) {
    for (int c = 0; c <= columns; c++) {
      double polar = M_PI * r / rows, turn = 2 * M_PI * (c % columns) / columns;
      double radius = 0.4 + 0.03 * std::sin(8 * polar) * std::cos(7 * turn);
      for (double v :
           {std::sin(polar) * std::cos(turn), std::sin(polar) * std::sin(turn), std::cos(polar)}) {
        vertices.push_back(static_cast<float>(radius * v));
      }
    }
  }
  auto add = [&](int a, int b, int c) {
    for (int v : {a, b, c}) {
      faces.push_back(v);
      uv.push_back(static_cast<float>(v % (columns + 1)) / static_cast<float>(columns));
      uv.push_back(static_cast<float>(v / (columns + 1)) / static_cast<float>(rows));
    }
  };
  for (int r = 0; r < rows; r++) {
    for (int c = 0; c < columns; c++) {
      int a = r * (columns + 1) + c, b = a + columns + 1;
      add(a, b, a + 1);
      add(a + 1, b, b + 1);
    }
  }
  return make_mesh(vertices.data(), static_cast<int>(vertices.size() / 3), faces.data(),
                   static_cast<int>(faces.size() / 3), nullptr, uv.data());
}

// A floor that mirrors, 24 shapes, 4 of them meshes of 9,216 triangles, textures, one transparent
// surface, three lights with shadows, and a sky. For paths one shape glows.
SceneData scene_of_shapes(bool path) {
  SceneData s;
  auto texture = [](int faces, int side) {
    SceneData::TextureData t = {{}, faces, side, side, 3, true};
    for (int i = 0; i < faces * side * side * 3; i++) {
      bool dark = (i / 3 % side / 8 + i / 3 / side / 8) % 2 != 0;
      t.data.push_back(static_cast<uint8_t>(dark ? 40 + i % 7 : 200 + i % 11));
    }
    return t;
  };
  s.textures = {texture(1, 256), texture(6, 64)};
  s.skybox = 1;
  auto surface = [&](float grey, int image, float reflectance, float alpha, float emission) {
    s.surfaces.push_back(
        {{grey, grey, grey, alpha}, image, {4, 4}, true, emission, 0.5f, 0.4f, reflectance});
  };
  surface(0.8f, 0, 0.2f, 1, 0);
  surface(0.7f, -1, 0, 1, 0);
  surface(0.5f, 0, 0, 1, 0);
  surface(0.6f, -1, 0, 0.6f, 0);
  surface(0.9f, -1, 0, 1, path ? 2.0f : 0.0f);
  s.meshes.push_back(std::make_shared<SceneData::MeshData>(bumpy_sphere(48, 96)));
  auto geom = [&](int shape, int look, float a, float b, float c) {
    s.geom_type.push_back(shape);
    s.geom_mesh.push_back(shape == MESH ? 0 : -1);
    s.geom_surface.push_back(look);
    for (float size : {a, b, c}) s.geom_size.push_back(size);
  };
  geom(PLANE, 0, 0, 0, 0);
  const int shapes[] = {SPHERE, CAPSULE, ELLIPSOID, CYLINDER, BOX, MESH};
  for (int i = 0; i < 24; i++) geom(shapes[i % 6], 1 + i % 2, 0.25f, 0.2f, 0.3f);
  s.geom_surface[4] = 3;
  s.geom_surface[1] = 4;
  for (int kind : {SPOT, DIRECTIONAL, POINT}) {
    s.lights.push_back({kind,
                        {0.05f, 0.05f, 0.05f},
                        {0.4f, 0.4f, 0.4f},
                        {0.3f, 0.3f, 0.3f},
                        true,
                        {1, 0.05f, 0},
                        50,
                        3,
                        0.05f,
                        0,
                        false});
  }
  return s;
}

// Numbers from -1 to 1.
struct Numbers {
  uint32_t state = 1;

  float next() {
    state = state * 1664525u + 1013904223u;
    return static_cast<float>(static_cast<int32_t>(state) >> 8) * 0x1p-23f;
  }
};

struct Stage {
  std::vector<double> geom_pos, geom_mat, light_pos, light_dir;
  std::vector<double> camera_pos = {0, -4, 1.2}, camera_mat = {1, 0, 0, 0, 0, -1, 0, 1, 0};

  explicit Stage(const SceneData& s) {
    Numbers numbers;
    for (size_t g = 0; g < s.geom_type.size(); g++) {
      double angle = 3 * numbers.next(), x = 2 * numbers.next(), y = 1.5 * numbers.next(),
             z = 1 + 0.8 * numbers.next();
      if (g == 0) angle = x = y = z = 0;
      for (double p : {x, y, z}) geom_pos.push_back(p);
      for (double m : {std::cos(angle), -std::sin(angle), 0.0, std::sin(angle), std::cos(angle),
                       0.0, 0.0, 0.0, 1.0}) {
        geom_mat.push_back(m);
      }
    }
    for (double x : {-2.0, 0.0, 2.0}) {
      for (double p : {x, -2.0, 4.0}) light_pos.push_back(p);
      for (double d : {0.0, 0.6, -0.8}) light_dir.push_back(d);
    }
  }
  // One shape moves.
  void tick() { geom_pos[3 * 7] += 0.002; }
  Poses poses() const {
    return {geom_pos.data(),  geom_mat.data(),   light_pos.data(),
            light_dir.data(), camera_pos.data(), camera_mat.data()};
  }
};

// Arrays one after another, as they will lie from address `base` on.
struct Arena {
  std::vector<char> bytes;
  uint64_t base;

  template <class T>
  const T* put(const T* from, size_t count) {
    if (!from || count == 0) return nullptr;
    bytes.resize((bytes.size() + 255) / 256 * 256);
    size_t at = bytes.size();
    const char* raw = reinterpret_cast<const char*>(from);
    bytes.insert(bytes.end(), raw, raw + count * sizeof(T));
    return reinterpret_cast<const T*>(base + at);
  }
};

}  // namespace

// A camera on the scene, and its frame on a GPU.
struct MeasuredCamera {
  Optics optics;
  Tracing tracing;
  SceneData scene;
  std::unique_ptr<Caster> rendering;  // and the poses of its next tick
  std::unique_ptr<Stage> stage;
  std::unique_ptr<Caster> caster;  // of the frame
  Arena constant, tick;            // what stays, and what each tick changes
  Frame frame;                     // with addresses of these
  PathFrame paths;
};

EVS_EXPORT MeasuredCamera* camera_make(int width, int height, int samples, int path) {
  auto* c = new MeasuredCamera;
  float focal = 0.9f * static_cast<float>(width);
  c->optics = {width,
               height,
               focal,
               focal,
               0.5f * static_cast<float>(width),
               0.5f * static_cast<float>(height)};
  c->tracing.samples = samples;
  c->tracing.path = path != 0;
  c->tracing.bounces = path ? 2 : 0;
  c->scene = scene_of_shapes(path != 0);
  return c;
}

// Begin to render, from the first tick on.
EVS_EXPORT void camera_begin(MeasuredCamera* c, const char* isa, int threads, int incremental) {
  Tracing how = c->tracing;
  how.incremental = incremental != 0;
  c->rendering = std::make_unique<Caster>(c->scene, c->optics, how, threads, isa);
  c->stage = std::make_unique<Stage>(c->scene);
}

// Render a tick. Out: luminance (h, w).
EVS_EXPORT void camera_render(MeasuredCamera* c, float* luminance) {
  c->rendering->render(c->stage->poses(), luminance, nullptr);
  c->stage->tick();
}

// Lay out the frame of the first tick for a GPU. Returns the bytes of what stays and, in `tick`, of
// what each tick changes; 0 where the scene has what this program does not copy.
EVS_EXPORT uint64_t camera_frame(MeasuredCamera* c, uint64_t constant_base, uint64_t tick_base,
                                 uint64_t* tick_bytes) {
  c->caster = std::make_unique<Caster>(c->scene, c->optics, c->tracing, 1, "auto");
  Stage stage(c->scene);
  Caster::KernelInputs inputs = c->caster->kernel_inputs(stage.poses());
  Frame f = inputs.frame;
  PathFrame p = inputs.paths;
  if (f.bvh.top > 0 || f.lens || f.vignette || f.channels != (c->tracing.path ? 3 : 1)) return 0;
  Arena& constant = c->constant = {{}, constant_base};
  std::vector<Mesh> meshes;
  for (int i = 0; i < c->caster->mesh_count(); i++) {
    const SceneData::MeshData& data = c->caster->mesh(i);
    Mesh mesh = f.meshes[i];
    mesh.nodes = constant.put(mesh.nodes, data.bvh.nodes.size());
    mesh.triangles = constant.put(mesh.triangles, data.bvh.triangles.size());
    mesh.corners = constant.put(mesh.corners, data.corners.size());
    meshes.push_back(mesh);
  }
  // textures are those of surfaces, each for its colour, and the sky
  int images = f.skybox + 1;
  size_t surfaces = c->scene.surfaces.size();
  for (size_t i = 0; i < surfaces; i++) images = std::max(images, f.surfaces[i].texture + 1);
  std::vector<Texture> textures;
  for (size_t i = 0; i < static_cast<size_t>(images); i++) {
    Texture texture = f.textures[i];
    size_t planes = static_cast<size_t>(texture.channels) * texture.channel_stride;
    texture.texels = constant.put(texture.texels, 2 * planes);
    textures.push_back(texture);
  }
  f.meshes = constant.put(meshes.data(), meshes.size());
  f.textures = constant.put(textures.data(), textures.size());
  f.surfaces = constant.put(f.surfaces, surfaces);
  size_t samples = static_cast<size_t>(f.samples), geoms = static_cast<size_t>(f.geom_count);
  f.sample_x = constant.put(f.sample_x, samples);
  f.sample_y = constant.put(f.sample_y, samples);
  f.tap_x = constant.put(f.tap_x, static_cast<size_t>(f.taps));
  f.tap_y = constant.put(f.tap_y, static_cast<size_t>(f.taps));
  f.primary = f.pairs = nullptr;
  size_t side = static_cast<size_t>(p.environment.side), rows = 6 * side, cells = rows * side;
  EnvironmentDistribution& sky = p.environment;
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
  Arena& tick = c->tick = {{}, tick_base};
  f.geoms = tick.put(f.geoms, geoms);
  size_t lights = static_cast<size_t>(f.light_count), spheres = static_cast<size_t>(f.bounds.count);
  for (const float** array : {&f.bounds.x, &f.bounds.y, &f.bounds.z, &f.bounds.radius}) {
    *array = tick.put(*array, spheres);
  }
  f.lights = tick.put(f.lights, lights);
  LightReachArray& r = f.reach;
  for (const float** array : {&r.x, &r.y, &r.z, &r.direction_x, &r.direction_y, &r.direction_z,
                              &r.cosine, &r.sine, &r.fade}) {
    *array = tick.put(*array, lights + 31);
  }
  p.world = tick.put(p.world, 9);
  c->frame = f;
  c->paths = p;
  *tick_bytes = tick.bytes.size();
  return constant.bytes.size();
}

EVS_EXPORT int frame_bytes() { return sizeof(Frame); }
EVS_EXPORT int paths_bytes() { return sizeof(PathFrame); }
EVS_EXPORT const void* camera_constant(MeasuredCamera* c) { return c->constant.bytes.data(); }
EVS_EXPORT const void* camera_tick(MeasuredCamera* c) { return c->tick.bytes.data(); }
EVS_EXPORT const void* camera_frame_struct(MeasuredCamera* c) { return &c->frame; }
EVS_EXPORT const void* camera_paths_struct(MeasuredCamera* c) { return &c->paths; }

// Trace the frame that was laid out, where base addresses are those of its bytes here: that all it
// points to was copied. Out: (h, w).
EVS_EXPORT void camera_trace_copy(MeasuredCamera* c, const char* isa, float* luminance) {
  FlushDenormals flush;
  auto batch = std::make_unique<PathBatch>();
  const Kernel& kernel = *kernel_of(isa);
  for (int y = 0; y < c->frame.height; y++) {
    for (int x = 0; x < c->frame.width; x++) {
      float* out = luminance + static_cast<long>(y) * c->frame.width + x;
      if (c->tracing.path) {
        kernel.trace_path_pixels(c->frame, c->paths, *batch, &x, &y, 1, out);
      } else {
        kernel.trace_pixels(c->frame, &x, &y, 1, out, nullptr);
      }
    }
  }
}

// Place everything for some ticks, then for the first one.
EVS_EXPORT void camera_place(MeasuredCamera* c, int ticks) {
  Stage stage(c->scene);
  for (int t = 0; t < ticks; t++) {
    stage.tick();
    c->caster->kernel_inputs(stage.poses());
  }
  Stage first(c->scene);
  c->caster->kernel_inputs(first.poses());
}

// Rays from points around the camera towards the shapes: (6, n).
EVS_EXPORT void rays_make(long n, float* rays) {
  Numbers numbers;
  for (long i = 0; i < n; i++) {
    float d[3] = {0.6f * numbers.next(), 0.5f * numbers.next(), -1};
    float length = std::sqrt(d[0] * d[0] + d[1] * d[1] + 1);
    for (int a = 0; a < 3; a++) {
      rays[a * n + i] = 0.3f * numbers.next();
      rays[(3 + a) * n + i] = d[a] / length;
    }
  }
}

// The hits of rays in the camera's first frame, in packets of 16.
EVS_EXPORT void rays_trace(MeasuredCamera* c, int threads, long n, const float* rays, float* out) {
  Stage stage(c->scene);
  const Frame f = c->caster->kernel_inputs(stage.poses()).frame;
  in_threads(threads, [&](int k) {
    for (long i = n / 16 * k / threads * 16; i < n / 16 * (k + 1) / threads * 16; i += 16) {
      portable::trace_rays(f, rays, n, i, out);
    }
  });
}

// What differs between numbers of a CPU and of a GPU.
struct Difference {
  uint64_t values;     // with other bits, but for
  uint64_t nan_only;   // those that are NaN in both
  uint64_t zero_only;  // of `values`: zeros of another sign
  uint64_t at;         // the first of `values`: its number, operands and results
  uint32_t a, b, cpu, gpu;
};

EVS_EXPORT int math_ops() { return portable::MATH_OPS; }

// Compare results of operation `op` for `count` operands from `first` on. In/out: `found`, zero
// before the first call.
EVS_EXPORT void math_compare(int op, uint64_t first, uint64_t count, const int32_t* gpu,
                             int threads, Difference* found) {
  std::vector<Difference> parts(static_cast<size_t>(threads), Difference{});
  in_threads(threads, [&](int k) {
    Difference& part = parts[static_cast<size_t>(k)];
    uint64_t begin = count / 16 * static_cast<uint64_t>(k) / static_cast<uint64_t>(threads) * 16;
    uint64_t end = count / 16 * static_cast<uint64_t>(k + 1) / static_cast<uint64_t>(threads) * 16;
    for (uint64_t at = begin; at < end; at += 16) {
      alignas(64) int a[16], b[16], cpu[16];
      for (int i = 0; i < 16; i++) {
        Operands in =
            operands(op >= portable::FIRST_BINARY_OP, first + at + static_cast<uint64_t>(i));
        a[i] = static_cast<int>(in.a), b[i] = static_cast<int>(in.b);
      }
      portable::store(cpu, portable::math_op(op, portable::load(a), portable::load(b)));
      if (std::memcmp(cpu, gpu + at, sizeof cpu) == 0) continue;
      for (int i = 0; i < 16; i++) {
        uint32_t here = static_cast<uint32_t>(cpu[i]),
                 there = static_cast<uint32_t>(gpu[at + static_cast<uint64_t>(i)]);
        if (here == there) continue;
        auto is_nan = [](uint32_t bits) { return (bits & 0x7fffffffu) > 0x7f800000u; };
        if (portable::gives_float(op) && is_nan(here) && is_nan(there)) {
          part.nan_only++;
          continue;
        }
        if (portable::gives_float(op) && ((here | there) & 0x7fffffffu) == 0) part.zero_only++;
        if (part.values++ == 0) {
          part.at = first + at + static_cast<uint64_t>(i);
          part.a = static_cast<uint32_t>(a[i]), part.b = static_cast<uint32_t>(b[i]);
          part.cpu = here, part.gpu = there;
        }
      }
    }
  });
  for (const Difference& part : parts) {
    found->nan_only += part.nan_only;
    found->zero_only += part.zero_only;
    if (found->values == 0 && part.values > 0) {
      uint64_t nan = found->nan_only, zero = found->zero_only;
      *found = part;
      found->nan_only = nan, found->zero_only = zero;
    } else {
      found->values += part.values;
    }
  }
}

}  // namespace evs
