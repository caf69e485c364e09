// The native core without Python, for the sanitisers: every shape, light and texture, odd sizes,
// degenerate and absurd input. Prints what failed; the exit code is the number of failures.

#include <cmath>
#include <cstdio>
#include <cstring>
#include <limits>
#include <memory>
#include <random>
#include <stdexcept>
#include <tuple>

#include "base/thread_pool.h"
#include "tests/emulator/core/selftest.h"

namespace evs {
namespace {

// Every code path that changes no byte where nothing needs it.
ForcedFeatures everything_on(const SceneData& scene, bool hybrid) {
  FeatureFlags flags;
  for (const char* name : FEATURE_NAMES) flags[name] = true;
  flags.erase(FEATURE_NAMES[SHADOWS]);
  flags.erase(FEATURE_NAMES[TRANSPARENT]);
  if (hybrid) flags.erase(FEATURE_NAMES[HIERARCHY]);
  if (scene.skybox >= 0) flags.erase(FEATURE_NAMES[FOG]);
  return ForcedFeatures(flags);
}

void same_bytes_everywhere(const Tracing& how) {
  std::mt19937 random(1);
  for (float tint : {0.5f, 0.3f}) {
    SceneData scene = scene_of_everything(tint);
    Optics pinhole = {33, 17, 30, 30, 16.5, 8.5}, orthographic = {18, 21, 8, 8, 9, 10.5, true};
    for (auto [optics, samples, adaptive] : {std::tuple(Optics{1, 1, 1, 1, 0.5, 0.5}, 1, false),
                                             {pinhole, 3, true},
                                             {orthographic, 2, false}}) {
      size_t pixels = static_cast<size_t>(optics.width) * optics.height;
      Tracing tracing = how;
      tracing.samples = samples;
      tracing.adaptive = adaptive;
      Caster reference(scene, optics, tracing, 1, "portable");
      std::vector<float> expected(pixels);
      std::vector<std::vector<float>> light;
      std::vector<std::unique_ptr<Caster>> casters;
      for (const std::string& isa : isa_available()) {
        for (bool incremental : {false, true}) {
          for (bool idle : {false, true}) {
            tracing.incremental = incremental;
            tracing.forced = idle ? everything_on(scene, how.hybrid) : ForcedFeatures();
            casters.push_back(std::make_unique<Caster>(scene, optics, tracing, 2, isa));
            light.emplace_back(pixels);
          }
        }
      }
      Stage stage = stage_of(scene, random, 1);
      for (int tick = 0; tick < 6; tick++) {
        // one geom at a time, sometimes the camera
        stage.geom_pos[3 * (static_cast<size_t>(tick) % 8)] += 0.01;
        if (tick == 4) stage.camera_pos[0] += 0.01;
        reference.render(stage.poses(), expected.data(), nullptr);
        for (size_t i = 0; i < casters.size(); i++) {
          casters[i]->render(stage.poses(), light[i].data(), nullptr);
          check(
              std::memcmp(light[i].data(), expected.data(), pixels * sizeof(float)) == 0,
              "every instruction set, incremental or not, idle code paths or none: the same bytes");
        }
      }
    }
  }
}

void single_pixels_and_deforming_meshes(Tracing how) {
  std::mt19937 random(3);
  SceneData scene = scene_of_everything(0.5f);
  Optics optics = {21, 13, 20, 20, 10.5, 6.5};
  how.samples = 2;
  how.adaptive = how.incremental = true;
  std::vector<int32_t> x, y;
  for (int i = 0; i < 21 * 13; i++) {
    x.push_back(i % 21);
    y.push_back(i / 21);
  }
  std::vector<float> light(x.size()), single(x.size());
  std::vector<float> vertices, normals(15, 0.5f);
  for (const std::string& isa : isa_available()) {
    Caster caster(scene, optics, how, 2, isa);
    Stage stage = stage_of(scene, random, 1);
    for (int tick = 0; tick < 5; tick++) {
      vertices.clear();
      for (int i = 0; i < 15; i++)
        vertices.push_back(std::ldexp(static_cast<float>(random() % 1000), -9));
      if (tick == 3) vertices[4] = std::numeric_limits<float>::quiet_NaN();
      if (tick == 4) vertices[4] = std::numeric_limits<float>::infinity();
      caster.deform_mesh(0, vertices.data(), normals.data());
      caster.trace_pixels(stage.poses(), x.data(), y.data(), static_cast<int>(x.size()),
                          single.data());
      caster.render(stage.poses(), light.data(), nullptr);
      check(tick > 2 || light == single, "single pixels have the frame's light");
    }
  }
}

// No crash and no read out of bounds, whatever the poses; finite light for finite poses.
void absurd_poses(Tracing how) {
  std::mt19937 random(2);
  SceneData scene = scene_of_everything(0.5f);
  Optics optics = {24, 18, 20, 20, 12, 9};
  how.incremental = true;
  std::vector<float> light(24 * 18);
  std::vector<int32_t> geom(light.size()), triangle(light.size());
  std::vector<float> distance(light.size()), point(3 * light.size()), normal(3 * light.size()),
      barycentric(2 * light.size());
  Truth truth = {geom.data(),   distance.data(), point.data(),
                 normal.data(), triangle.data(), barycentric.data()};
  for (const std::string& isa : isa_available()) {
    Caster caster(scene, optics, how, 1, isa);
    for (double scale : {1e-6, 1.0, 1e5, 1e12}) {
      Stage stage = stage_of(scene, random, scale);
      caster.render(stage.poses(), light.data(), nullptr);
      caster.trace_truth(stage.poses(), truth);
      bool finite = true;
      for (float l : light) finite = finite && std::isfinite(l);
      check(finite, "finite poses give finite light");
      finite = true;
      for (float n : normal) finite = finite && std::isfinite(n);
      check(finite, "finite poses give finite normals");
    }
    for (double bad : {std::numeric_limits<double>::quiet_NaN(),
                       std::numeric_limits<double>::infinity(), 1e300}) {
      Stage stage = stage_of(scene, random, 1);
      for (size_t i = 0; i < stage.geom_pos.size(); i += 2) stage.geom_pos[i] = bad;
      stage.light_pos[0] = bad;
      caster.render(stage.poses(), light.data(), nullptr);
      stage.camera_pos[1] = bad;
      caster.trace_truth(stage.poses(), truth);
    }
  }
}

void degenerate_meshes() {
  // a thousand triangles in one place, and a thousand in a line: the tree stays shallow
  std::vector<float> vertices;
  std::vector<int32_t> faces;
  for (int i = 0; i < 1000; i++) {
    for (float x : {0.0f, 1.0f, 0.0f})
      vertices.insert(vertices.end(), {x, x == 0 ? 1.0f * (i % 2) : 0, 0});
    faces.insert(faces.end(), {3 * i, 3 * i + 1, 3 * i + 2});
  }
  Bvh pile = build_bvh(vertices.data(), 3000, faces.data(), 1000);
  for (int i = 0; i < 3000; i++)
    vertices[3 * static_cast<size_t>(i)] = std::ldexp(1.0f, -(i / 3) % 120);
  Bvh line = build_bvh(vertices.data(), 3000, faces.data(), 1000);
  for (const Bvh& bvh : {pile, line}) {
    std::vector<std::pair<int, int>> stack = {{0, 1}};
    int deepest = 0;
    size_t triangles = 0;
    while (!stack.empty()) {
      auto [node, depth] = stack.back();
      stack.pop_back();
      deepest = std::max(deepest, depth);
      for (int c = 0; c < 2; c++) {
        if (bvh.nodes[node].child[c] >= 0) {
          stack.push_back({bvh.nodes[node].child[c], depth + 1});
        } else {
          triangles += static_cast<size_t>(bvh.nodes[node].count[c]);
        }
      }
    }
    check(triangles == 1000, "every triangle is in one leaf");
    check(deepest < 90, "the tree is shallower than the kernels' stack");
  }
  bool refused = false;
  vertices[5] = std::numeric_limits<float>::infinity();
  try {
    make_mesh(vertices.data(), 3000, faces.data(), 1000, nullptr, nullptr);
  } catch (const std::invalid_argument&) {
    refused = true;
  }
  check(refused, "a vertex that is not finite is refused");
}

void pool_runs_each_job_once() {
  for (int threads : {1, 2, 5}) {
    ThreadPool pool(threads);
    for (int jobs : {0, 1, 2, 100}) {
      std::vector<int> done(static_cast<size_t>(jobs));
      pool.run(jobs, [&](int job, int) { done[static_cast<size_t>(job)]++; });
      bool once = true;
      for (int d : done) once = once && d == 1;
      check(once, "every job runs once");
    }
    bool thrown = false;
    try {
      pool.run(50, [](int job, int) {
        if (job == 7) throw std::runtime_error("job 7");
      });
    } catch (const std::runtime_error&) {
      thrown = true;
    }
    check(thrown, "a job's exception arrives");
  }
}

}  // namespace
}  // namespace evs

int main() {
  evs::lanes_depend_on_themselves_alone();
  evs::pool_runs_each_job_once();
  evs::degenerate_meshes();
  evs::Tracing direct, path;
  path.path = true;
  path.bounces = 3;
  for (const evs::Tracing& how : {direct, path}) {
    evs::same_bytes_everywhere(how);
    evs::single_pixels_and_deforming_meshes(how);
    evs::absurd_poses(how);
  }
  // its single pixels are those of a picture
  evs::Tracing hybrid;
  hybrid.hybrid = true;
  hybrid.bounces = 2;
  evs::same_bytes_everywhere(hybrid);
  evs::absurd_poses(hybrid);
  evs::ticks_allocate_nothing();
  evs::pixels_survive_any_light();
  evs::networks_survive_any_light();
  evs::readouts_lose_nothing_uncounted();
  evs::row_access_times_are_drawn_exactly();
  std::printf("%d failures\n", evs::failures);
  return evs::failures;
}
