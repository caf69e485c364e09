// The render path allocates nothing from tick to tick: every operator new of this program is
// counted.

#include <atomic>
#include <cstddef>
#include <cstdlib>
#include <new>
#include <string>

#include "tests/emulator/core/selftest.h"

namespace {

std::atomic<long> allocations{0};

void* counted(std::size_t size, std::size_t alignment) {
  allocations++;
  void* memory = nullptr;
  if (alignment <= alignof(std::max_align_t)) {
    memory = std::malloc(size > 0 ? size : 1);
  } else if (posix_memalign(&memory, alignment, size) != 0) {
    memory = nullptr;
  }
  if (memory == nullptr) throw std::bad_alloc();
  return memory;
}

}  // namespace

// operator new[] ends in these; a sanitiser would bring its own of the one that takes no exceptions
void* operator new(std::size_t size) { return counted(size, 0); }
void* operator new(std::size_t size, const std::nothrow_t&) noexcept {
  try {
    return counted(size, 0);
  } catch (const std::bad_alloc&) {
    return nullptr;
  }
}
void* operator new(std::size_t size, std::align_val_t alignment) {
  return counted(size, static_cast<std::size_t>(alignment));
}
void operator delete(void* memory) noexcept { std::free(memory); }
void operator delete(void* memory, std::size_t) noexcept { std::free(memory); }
void operator delete(void* memory, std::align_val_t) noexcept { std::free(memory); }
void operator delete(void* memory, std::size_t, std::align_val_t) noexcept { std::free(memory); }

namespace evs {
namespace {

constexpr int TICKS = 200;

struct How {
  const char* name;
  bool incremental, adaptive, rgb, path;
};

// Where the test moves to in tick k: one geom more in each, then all of them rest for a tick;
// sometimes a light and the camera.
void move(Stage& stage, int tick) {
  size_t geoms = stage.geom_pos.size() / 3, moving = static_cast<size_t>(tick) % (geoms + 1);
  for (size_t g = 0; g < moving; g++) stage.geom_pos[3 * g] += tick % 2 ? 0.01 : -0.01;
  if (tick % 29 == 5) stage.light_pos[0] += 0.01;
  if (tick % 31 == 7) stage.camera_pos[0] += 0.01;
}

void check_ticks(const How& how) {
  std::mt19937 random(4);
  SceneData scene = scene_of_everything(0.3f);
  Optics optics = {33, 17, 30, 30, 16.5, 8.5};
  size_t pixels = 33 * 17;
  Tracing tracing = {4, how.adaptive, true, how.incremental, how.rgb, how.path, false, 3};
  tracing.forced = as_with_many();
  // one lane, which "auto" takes where it is built, keeps nothing from tick to tick
  std::vector<std::string> sets = isa_available();
  Caster caster(scene, optics, tracing, 2, sets[0] == "one_lane" ? sets.at(1) : sets[0]);
  Stage stage = stage_of(scene, random, 1);
  std::vector<float> light(pixels), rgb(3 * pixels), single(40), gains(scene.lights.size(), 1.0f);
  std::vector<float> distance(pixels), point(3 * pixels), normal(3 * pixels), share(2 * pixels);
  std::vector<int32_t> x, y, geom(pixels), triangle(pixels);
  for (int i = 0; i < 40; i++) x.push_back(i % 33), y.push_back(i % 17);
  std::vector<float> vertices(15), normals(15, 0.5f);
  Truth truth = {geom.data(),   distance.data(), point.data(),
                 normal.data(), triangle.data(), share.data()};

  long before = 0;
  double traced = 0;
  for (int tick = 0; tick <= TICKS; tick++) {
    // the first tick may make room: which meshes deform is not known before
    if (tick == 1) before = allocations;
    move(stage, tick);
    for (float& v : vertices) v = static_cast<float>(random() % 1000) / 500;
    if (tick % 5 == 0) caster.deform_mesh(0, vertices.data(), normals.data());
    if (tick % 13 == 0) gains[0] = tick % 2 ? 0.5f : 1.0f;
    caster.set_light_gains(gains.data());
    caster.render(stage.poses(), light.data(), how.rgb ? rgb.data() : nullptr);
    traced += caster.traced_fraction();
    if (tick % 10 == 0) {
      caster.trace_pixels(stage.poses(), x.data(), y.data(), 40, single.data());
      caster.trace_truth(stage.poses(), truth);
    }
  }
  long count = allocations - before;
  std::string what = std::string(how.name) + ": " + std::to_string(count) + " allocations";
  check(count == 0, what.c_str());
  // and the scene was one that keeps it busy
  bool reused = traced < TICKS;
  check(traced > 0 && reused == how.incremental, "a moving scene is traced, in part or whole");
}

}  // namespace

void ticks_allocate_nothing() {
  long before = allocations;
  check(std::vector<Geom>(1).size() + std::vector<int>(1).size() == 2 && allocations - before == 2,
        "allocations are counted");
  for (const How& how : {How{"direct, full", false, false, false, false},
                         {"direct, incremental", true, false, true, false},
                         {"adaptive, full", false, true, false, false},
                         {"adaptive, incremental", true, true, true, false},
                         {"path, full", false, false, false, true},
                         {"path, incremental", true, false, true, true},
                         {"path at edges, full", false, true, true, true},
                         {"path at edges, incremental", true, true, false, true}}) {
    check_ticks(how);
  }
}

}  // namespace evs
