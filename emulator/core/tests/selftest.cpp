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

#include "pixel_array.h"
#include "selftest.h"

namespace evs {
namespace {

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
          tracing.incremental = incremental;
          casters.push_back(std::make_unique<Caster>(scene, optics, tracing, 2, isa));
          light.emplace_back(pixels);
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
          check(std::memcmp(light[i].data(), expected.data(), pixels * sizeof(float)) == 0,
                "every instruction set, incremental or not, gives the same bytes");
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
  Tree pile = build_tree(vertices.data(), 3000, faces.data(), 1000);
  for (int i = 0; i < 3000; i++)
    vertices[3 * static_cast<size_t>(i)] = std::ldexp(1.0f, -(i / 3) % 120);
  Tree line = build_tree(vertices.data(), 3000, faces.data(), 1000);
  for (const Tree& tree : {pile, line}) {
    std::vector<std::pair<int, int>> stack = {{0, 1}};
    int deepest = 0;
    size_t triangles = 0;
    while (!stack.empty()) {
      auto [node, depth] = stack.back();
      stack.pop_back();
      deepest = std::max(deepest, depth);
      for (int c = 0; c < 2; c++) {
        if (tree.nodes[node].child[c] >= 0) {
          stack.push_back({tree.nodes[node].child[c], depth + 1});
        } else {
          triangles += static_cast<size_t>(tree.nodes[node].count[c]);
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
    Pool pool(threads);
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

void pixels_survive_any_light() {
  constexpr int W = 37, H = 11, N = W * H, BLOCKS = (N + 63) / 64;
  std::vector<float> light(N, 0.5f), theta(N, 0.2f), leak(N, 0x1p-30f), rate(N, 500.0f);
  PixelSettings settings;
  settings.map = LogMap::linlog(255, 0.1f, 2.7182817f);
  settings.lowpass_low = 1e-5;
  settings.lowpass_slope = 1e-6;
  settings.follower = 1e-3;
  settings.highpass = 1e-6;
  settings.parasitic_slope = 1e-3;
  settings.refractory = 300;
  settings.noise_gain = settings.drift_gain = settings.least_gain = 0.1f;
  settings.average = settings.causes = true;
  settings.shot.on = settings.shot.off = rate.data();
  settings.shot.slope = 0.01;
  PixelPattern pattern;
  pattern.theta_on = pattern.theta_off = pattern.phase = theta.data();
  pattern.leak = pattern.parasitic = leak.data();
  PixelArray sensor(settings, pattern, W, H, 2, "auto");

  std::vector<float> last_log(N, std::numeric_limits<float>::quiet_NaN()), last_light(N, -1);
  std::vector<float> filtered(N), followed(N), mean(N), noise(N), drift(N);
  std::vector<double> reference(N, std::numeric_limits<double>::quiet_NaN());
  std::vector<int64_t> blind(N), due(BLOCKS), since(BLOCKS), next(BLOCKS), drawn(BLOCKS);
  PixelArrays pixels;
  pixels.reference = reference.data();
  pixels.last_log = last_log.data();
  pixels.last_luminance = last_light.data();
  pixels.filtered = filtered.data();
  pixels.followed = followed.data();
  pixels.blind_until = blind.data();
  pixels.average = {mean.data(), noise.data(), drift.data(), 0.1f, 0.1f, 0.1f, 1.0f};
  pixels.due_us = due.data();
  pixels.since_us = since.data();
  pixels.shot = {next.data(), drawn.data()};
  size_t clamped = 0, count = 0;
  const float values[] = {0.5f, 0, 1e9f, -1, std::numeric_limits<float>::quiet_NaN(), 1e-40f, 0.5f};
  int64_t t = 0;
  for (float value : values) {
    for (int i = 0; i < N; i += 3) light[static_cast<size_t>(i)] = value;
    count += sensor.step(pixels, {light.data(), t, 1000}, t, clamped).count;
    t += 1000;
  }
  check(count > 0, "light and noise make events");
  bool finite = true;
  for (float l : light) finite = finite && std::isfinite(l);
  check(finite, "finite poses give finite light");
  finite = true;
  for (float n : normal) finite = finite && std::isfinite(n);
  check(finite, "finite poses give finite normals");
}
for (double bad :
     {std::numeric_limits<double>::quiet_NaN(), std::numeric_limits<double>::infinity(), 1e300}) {
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
  Tree pile = build_tree(vertices.data(), 3000, faces.data(), 1000);
  for (int i = 0; i < 3000; i++)
    vertices[3 * static_cast<size_t>(i)] = std::ldexp(1.0f, -(i / 3) % 120);
  Tree line = build_tree(vertices.data(), 3000, faces.data(), 1000);
  for (const Tree& tree : {pile, line}) {
    std::vector<std::pair<int, int>> stack = {{0, 1}};
    int deepest = 0;
    size_t triangles = 0;
    while (!stack.empty()) {
      auto [node, depth] = stack.back();
      stack.pop_back();
      deepest = std::max(deepest, depth);
      for (int c = 0; c < 2; c++) {
        if (tree.nodes[node].child[c] >= 0) {
          stack.push_back({tree.nodes[node].child[c], depth + 1});
        } else {
          triangles += static_cast<size_t>(tree.nodes[node].count[c]);
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
    Pool pool(threads);
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

void pixels_survive_any_light() {
  constexpr int W = 37, H = 11, N = W * H;
  PlainSensor sensor(LogMap::linlog(255, 0.1f, 2.7182817f), W, H, 2, "auto");
  std::vector<float> light(N, 0.5f), on(N, 0.2f), off(N, 0.2f), last_log(N), last_light(N);
  std::vector<double> reference(N);
  PixelArrays pixels{light.data(),     on.data(),       off.data(),
                     reference.data(), last_log.data(), last_light.data()};
  size_t clamped = 0;
  const float values[] = {0.5f, 0, 1e9f, -1, std::numeric_limits<float>::quiet_NaN(), 1e-40f, 0.5f};
  int64_t t = 0;
  for (float value : values) {
    for (int i = 0; i < N; i += 3) light[static_cast<size_t>(i)] = value;
    EventBuffer events = sensor.step(pixels, t, 1000, clamped);
    t += 1000;
  }
  bool finite = true;
  for (double r : reference) finite = finite && !std::isinf(r);  // NaN: blind
  check(finite, "no light makes a reference infinite");
}

}  // namespace
}  // namespace evs

int main() {
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
  evs::ticks_allocate_nothing();
  evs::pixels_survive_any_light();
  std::printf("%d failures\n", evs::failures);
  return evs::failures;
}
