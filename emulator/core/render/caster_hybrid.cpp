// The part of the caster that belongs to `hybrid`: its irradiance cache, and its ticks.

#include <algorithm>
#include <atomic>
#include <cmath>

#include "caster.h"

namespace evs {

// Prepare the irradiance cache. Its nodes are lit in three channels; with grey lights pixels are
// rendered as luminance, and in colour beside it if that is wanted.
void Caster::set_hybrid(const Optics& optics, const Tracing& tracing, const SceneData& scene) {
  const bool rgb = tracing.rgb || forced_.on(COLOUR);
  if (appearance_.channels == 4) {
    colours_ = select_channels(appearance_, true);
    if (!rgb) {
      luminance_ = select_channels(appearance_, false);
      frame_.channels = 1;
      frame_.surfaces = luminance_->surfaces.data();
      frame_.textures = luminance_->textures.data();
      frame_.lights = luminance_->lights.data();
      frame_.medium = appearance_.medium = luminance_->medium;
    }
  }
  const Appearance& colours = colours_ ? *colours_ : appearance_;
  const float* weights = colours.weights;
  for (const Surface& surface : colours.surfaces) {
    float mean[3], luminance = 0;
    mean_colour(surface, colours, mean);
    for (int c = 0; c < 3; c++) luminance += weights[c] * mean[c];
    for (int c = 0; c < 3; c++)
      tint_.push_back(luminance > 0 ? weights[c] * mean[c] / luminance : weights[c]);
    tint_.push_back(0);
  }
  emitters_.emplace(scene, colours, order_);
  paths_.bounces = tracing.bounces;
  paths_.sample_set = SAMPLES_OWEN;
  paths_.lobe_samples = 1;
  while ((1 << paths_.log2_samples) < IrradianceCache::SAMPLES) paths_.log2_samples++;
  set_paths();
  batches_ = std::make_unique_for_overwrite<PathBatch[]>(pool_->threads());
  // the lattice's spacing: of large images in pixels, of small ones as an angle
  constexpr float MAX_PX = 8, MIN_PX = 2, ANGLE = 0.03f;
  long pixels = static_cast<long>(optics.width) * optics.height;
  float pixel = static_cast<float>(1 / std::sqrt(optics.fx * optics.fy)), spacing = MAX_PX * pixel;
  if (!optics.orthographic) spacing = std::min(spacing, std::max(MIN_PX * pixel, ANGLE));
  size_t nodes = IrradianceCache::most_nodes(pixels);
  if (tracing.nodes > 0) nodes = static_cast<size_t>(tracing.nodes);
  irradiance_.emplace(nodes, spacing, pool_->threads());
  incomplete_.resize(static_cast<size_t>(sampling_.rows) * sampling_.columns);
  // spread points over glowing geoms, as if at the camera
  lamp_points_.resize(static_cast<size_t>(paths_.emitter_count) * LAMP_POINTS);
  std::vector<Geom> placed = geoms_;
  for (Geom& g : placed) g.rotation[0] = g.rotation[4] = g.rotation[8] = 1;
  Frame frame = frame_;
  frame.geoms = placed.data();
  frame.surfaces = colours.surfaces.data();
  frame.textures = colours.textures.data();
  if (!geoms_.empty()) spheres_.set(0, {{0, 0, 0}, 0});
  frame.bounds = spheres_.view();
  for (int e = 0; e < paths_.emitter_count; e++) irradiance_->add_lamp(*kernel_, frame, paths_, e);
}

// The frame in which nodes are lit, and the points of glowing geoms.
void Caster::place_hybrid() {
  colour_frame_ = frame_;
  node_lights_ = appearance_.lights;
  for (size_t i = 0; i < node_lights_.size(); i++) {
    // nodes are lit at gain 1, the mean of a light that flickers: they follow too slowly
    Light& l = node_lights_[i];
    std::copy_n(full_lights_[i].ambient, MAX_CHANNELS, l.ambient);
    std::copy_n(full_lights_[i].diffuse, MAX_CHANNELS, l.diffuse);
    std::copy_n(full_lights_[i].specular, MAX_CHANNELS, l.specular);
    if (luminance_) select_channels(appearance_.lights[i], false, luminance_->lights[i]);
    if (colours_) select_channels(Light(l), true, l);
  }
  colour_frame_.lights = node_lights_.data();
  if (colours_) {
    colour_frame_.surfaces = colours_->surfaces.data();
    colour_frame_.textures = colours_->textures.data();
    std::copy(colours_->weights, colours_->weights + 3, colour_frame_.weights);
    colour_frame_.channels = 3;
    colour_frame_.colour = 0;
  }
  for (int e = 0; e < paths_.emitter_count; e++) {
    irradiance_->spread(*kernel_, colour_frame_, paths_, e,
                        lamp_points_.data() + static_cast<long>(e) * LAMP_POINTS);
  }
  irradiance_->set_surfaces(tint_.data(), lamp_points_.data(), forced_.off(CACHED_LIGHT));
}

// One tick of the `hybrid` integrator. In: whether all is as it was in the last tick.
void Caster::trace_hybrid(bool same, const Outputs& out) {
  IrradianceCache& cache = *irradiance_;
  rest_ticks_ = same ? rest_ticks_ + 1 : 0;
  if (incremental_ && !forced_.on(FULL_RETRACE) && rest_ticks_ > IrradianceCache::REST_TICKS) {
    cache.skip_tick();
    traced_fraction_ = 0;
    return;
  }
  place_hybrid();
  IrradianceCache::Tracer tracer = {*kernel_, colour_frame_, paths_, batches_.get(), *pool_};
  cache.next_tick(tracer);
  bool cold = cache.size() == 0;
  while (!hybrid_passes(tracer, out)) cold = true;
  if (cold) {
    cache.settle(colour_frame_);
    hybrid_passes(tracer, out);
  }
  work_.packets_traced += static_cast<long>(sampling_.rows) * sampling_.columns;
  traced_fraction_ = 1;
}

// Trace all pixels with the light of the irradiance cache. Returns false where its lattice became
// coarser on the way.
bool Caster::hybrid_passes(const IrradianceCache::Tracer& tracer, const Outputs& out) {
  IrradianceCache& cache = *irradiance_;
  const Outputs base_out = antialiasing_ ? antialiasing_->base() : out;
  const Frame base_frame = antialiasing_ ? antialiasing_->base_frame(frame_) : frame_;
  // call job(row, worker) for all rows, and again for those that missed nodes
  std::fill(incomplete_.begin(), incomplete_.end(), uint8_t{1});
  auto complete_rows = [&](auto job) {
    for (;;) {
      std::atomic<bool> complete{true};
      pool_->run(sampling_.rows, [&](int row, int worker) {
        if (!job(row, worker)) complete = false;
      });
      if (complete) return true;
      if (!cache.add_requested(tracer)) return false;
    }
  };
  bool fits = complete_rows([&](int row, int worker) {
    uint8_t* incomplete = incomplete_.data() + static_cast<long>(row) * sampling_.columns;
    bool complete = true, pairs = kernel_->trace_hybrid_pair && frame_.pairs;
    for (int column = 0; column < sampling_.columns; column++) {
      if (!incomplete[column]) continue;
      bool two =
          pairs && column % 2 == 0 && column + 1 < sampling_.columns && incomplete[column + 1];
      (two ? kernel_->trace_hybrid_pair : kernel_->trace_hybrid)(
          base_frame, paths_, cache.view(), cache.requests(worker), column, row, base_out);
      bool whole = cache.collect(worker);
      complete = complete && whole;
      for (int end = column + two;; column++) {
        incomplete[column] = !whole;
        if (antialiasing_) antialiasing_->traced(column, row);
        if (column == end) break;
      }
    }
    return complete;
  });
  if (!fits || !antialiasing_) return fits;
  antialiasing_->close_margin();
  fits = complete_rows([&](int row, int worker) {
    auto refine = [&](int column, int, unsigned pixels, float* luminance, float* rgb) {
      kernel_->refine_hybrid(frame_, paths_, cache.view(), cache.requests(worker), column, row,
                             pixels, luminance, rgb);
      return cache.collect(worker);
    };
    return antialiasing_->finish_row(*kernel_, row, out, refine);
  });
  antialiasing_->next_tick();
  return fits;
}

bool Caster::restore_irradiance(long tick, int coarser, int nodes, const int32_t* ints,
                                const float* floats) {
  if (!irradiance_) return false;
  if (!irradiance_->restore(tick, coarser, nodes, ints, floats, geoms_)) return false;
  rest_ticks_ = 0;
  return true;
}

void Caster::restart() {
  if (irradiance_) irradiance_->clear();
  rest_ticks_ = 0;
}

}  // namespace evs
