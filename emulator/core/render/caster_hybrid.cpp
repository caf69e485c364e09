// The part of the caster that belongs to `hybrid`: its irradiance cache, and its ticks.

#include <algorithm>
#include <atomic>
#include <cmath>

#include "render/caster.h"

namespace evs {
namespace {

constexpr size_t MOST_KEPT_BYTES = 512u << 20;
constexpr int KEPT_LANES = PACKET_WIDTH * PACKET_HEIGHT;

}  // namespace

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
  paths_.transparent_geoms = emitters_->transparent_geoms().data();
  paths_.transparent_count = static_cast<int>(emitters_->transparent_geoms().size());
  set_paths();
  paths_.world = frame_.camera_to_world;
  batches_ = std::make_unique_for_overwrite<PathBatch[]>(pool_->threads());
  // the lattice's spacing: of large images in pixels, of small ones as an angle
  constexpr float MAX_PX = 8, MIN_PX = 2, ANGLE = 0.03f;
  long pixels = static_cast<long>(optics.width) * optics.height;
  float pixel = static_cast<float>(1 / std::sqrt(optics.fx * optics.fy)), spacing = MAX_PX * pixel;
  if (!optics.orthographic) spacing = std::min(spacing, std::max(MIN_PX * pixel, ANGLE));
  size_t nodes = IrradianceCache::most_nodes(pixels);
  if (tracing.nodes > 0) nodes = static_cast<size_t>(tracing.nodes);
  irradiance_.emplace(nodes, spacing, pool_->threads());
  size_t packets = static_cast<size_t>(sampling_.rows) * sampling_.columns;
  incomplete_.resize(packets);
  // under a still camera keep what packets need to be lit again
  size_t samples = antialiasing_ ? 1 : static_cast<size_t>(tracing.samples);
  int channels = frame_.channels + (antialiasing_ ? 1 : 0);
  kept_floats_ = samples * kept_rows(channels) * KEPT_LANES;
  surface_floats_ = samples * surface_rows(channels) * KEPT_LANES;
  bool keeps = packets * (kept_floats_ + surface_floats_) * sizeof(float) <= MOST_KEPT_BYTES;
  if (incremental_ && keeps && !frame_.medium.fog && !forced_.off(CACHED_LIGHT)) {
    packet_cache_.emplace(sampling_, 0, appearance_.lights, frame_.shadows);
    kept_ = std::make_unique_for_overwrite<float[]>(packets * kept_floats_);
    // memory that is not used while lamps rest
    kept_surfaces_ = std::make_unique_for_overwrite<float[]>(packets * surface_floats_);
    kept_whole_.resize(packets);
    emitter_spheres_.resize(static_cast<size_t>(paths_.emitter_count));
  }
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
  paths_.world = frame_.camera_to_world;
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

// Find the packets that what moved can affect, apart from the nodes' light. Returns false where all
// have to be traced.
bool Caster::find_dirty_of_hybrid() {
  // what was kept of a lamp that moves is of no use
  for (int e = 0; e < paths_.emitter_count; e++) {
    int k = paths_.emitters[e].geom;
    const Geom& g = geoms_[k];
    if (has_changed(static_cast<size_t>(k))) return false;
    emitter_spheres_[e] = bounding_spheres_[k];
    if (g.shape == PLANE) emitter_spheres_[e] = {g.position, g.size[0] + g.size[1]};
  }
  find_moved();
  SceneChange change = moved_.change(), soft = moved_soft_.change();
  change.soft = &soft;
  change.emitters = emitter_spheres_.data();
  change.emitter_count = paths_.emitter_count;
  packet_cache_->find_dirty(*kernel_, frame_, change, *pool_);
  work_.packets_tested += static_cast<long>(sampling_.rows) * sampling_.columns;
  return true;
}

IrradianceCache::Tracer Caster::node_tracer() {
  return {*kernel_, colour_frame_, paths_, batches_.get(), *pool_};
}

// Begin a tick of the `hybrid` integrator. In: whether all is as it was in the last tick. Returns
// whether there is anything to trace.
bool Caster::begin_hybrid(bool same) {
  IrradianceCache& cache = *irradiance_;
  rest_ticks_ = same ? rest_ticks_ + 1 : 0;
  if (incremental_ && !forced_.on(FULL_RETRACE) && rest_ticks_ > IrradianceCache::REST_TICKS) {
    cache.skip_tick();
    traced_fraction_ = 0;
    return false;
  }
  place_hybrid();
  cache.next_tick(node_tracer());
  return true;
}

// Trace the pixels of a tick. In: whether only dirty packets are traced.
void Caster::trace_hybrid(bool selective, const Outputs& out) {
  IrradianceCache& cache = *irradiance_;
  IrradianceCache::Tracer tracer = node_tracer();
  bool cold = cache.size() == 0;
  bool records = kept_ && selective, lamps_move = !same_lights();
  Recording now = !records     ? Recording::NOTHING
                  : lamps_move ? Recording::SURFACES
                               : Recording::LIGHT;
  // a sweep asks each packet for its nodes
  selective = records && kept_of_last_ >= now && !cache.swept() && find_dirty_of_hybrid();
  if (records && !selective) packet_cache_->record_all();
  auto pass = [&] { return hybrid_passes(tracer, now, selective, out); };
  while (!pass()) cold = true, selective = false;
  // a view without surfaces has no nodes for ever
  if (cold && cache.size() > 0) {
    cache.settle(colour_frame_);
    pass();
  }
  // light alone is kept of packets that are traced while lamps rest
  kept_of_last_ = now;
}

// Trace all pixels with the light of the irradiance cache, or those of dirty packets; the others
// are lit again with what they have kept. Returns false where the cache's lattice became coarser on
// the way.
bool Caster::hybrid_passes(const IrradianceCache::Tracer& tracer, Recording now, bool selective,
                           const Outputs& out) {
  IrradianceCache& cache = *irradiance_;
  cache.begin_pass(IrradianceCache::ALL_PIXELS);
  const Outputs base_out = antialiasing_ ? antialiasing_->base() : out;
  const Frame base_frame = antialiasing_ ? antialiasing_->base_frame(frame_) : frame_;
  std::atomic<long> traced{0}, relit{0};
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
    using Dirty = PacketCache::Dirty;
    size_t first = static_cast<size_t>(row) * sampling_.columns;
    uint8_t *incomplete = incomplete_.data() + first, *whole = kept_whole_.data() + first;
    long own_traced = 0, own_relit = 0;
    bool complete = true, pairs = kernel_->trace_hybrid_pair && frame_.pairs;
    auto surfaces = [&](int column) {
      return now == Recording::SURFACES ? kept_surfaces_.get() + (first + column) * surface_floats_
                                        : nullptr;
    };
    // a packet that has not kept all is traced again and again: its rays are recorded already
    auto dirty_of = [&](int column) {
      if (now == Recording::NOTHING) return Dirty::RETRACE_UNRECORDED;
      Dirty dirty = selective ? packet_cache_->dirty(column, row) : Dirty::RETRACE;
      // the light of all lamps is found again
      if (now == Recording::SURFACES && dirty == Dirty::RELIGHT) dirty = Dirty::CLEAN;
      return dirty == Dirty::CLEAN && !whole[column] ? Dirty::RETRACE_UNRECORDED : dirty;
    };
    for (int column = 0; column < sampling_.columns; column++) {
      if (!incomplete[column]) continue;
      Dirty dirty = dirty_of(column);
      int count = 1;
      bool found = true;
      if (dirty == Dirty::CLEAN) {
        kernel_->relight_hybrid(base_frame, paths_, cache.view(), cache.requests(worker), column,
                                row, base_out, kept_.get() + (first + column) * kept_floats_,
                                surfaces(column));
        own_relit++;
      } else if (dirty == Dirty::RETRACE_UNRECORDED) {
        bool two = pairs && column % 2 == 0 && column + 1 < sampling_.columns &&
                   incomplete[column + 1] && dirty_of(column + 1) == dirty;
        if (two) {
          kernel_->trace_hybrid_pair(base_frame, paths_, cache.view(), cache.requests(worker),
                                     column, row, base_out);
        } else {
          kernel_->trace_hybrid(base_frame, paths_, cache.view(), cache.requests(worker), column,
                                row, base_out, nullptr);
        }
        count += two;
        found = cache.collect(worker);
        for (int k = 0; k < count && kept_; k++) whole[column + k] = 0;
      } else {
        KeptPacket kept = {packet_cache_->record(column, row),
                           kept_.get() + (first + column) * kept_floats_, surfaces(column), false};
        kernel_->trace_hybrid(base_frame, paths_, cache.view(), cache.requests(worker), column, row,
                              base_out, &kept);
        found = cache.collect(worker);
        whole[column] = kept.complete;
      }
      if (dirty != Dirty::CLEAN) own_traced += count;
      complete = complete && found;
      for (int k = 0; k < count; k++) {
        incomplete[column + k] = !found;
        if (antialiasing_) antialiasing_->traced(column + k, row);
      }
      column += count - 1;
    }
    traced += own_traced;
    relit += own_relit;
    return complete;
  });
  long packets = static_cast<long>(sampling_.rows) * sampling_.columns;
  work_.packets_traced += traced;
  work_.packets_relit += relit;
  traced_fraction_ = std::min(1.0, static_cast<double>(traced) / static_cast<double>(packets));
  if (fits && cache.swept()) cache.take_readers();
  if (!fits || !antialiasing_) return fits;
  cache.begin_pass(IrradianceCache::EDGES);
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

void Caster::trace_here(float* luminance) {
  trace_hybrid(false, {luminance, nullptr, nullptr, 0, nullptr});
}

const IrradianceCache& Caster::begin_device_pass(IrradianceCache::Pass pass) {
  irradiance_->begin_pass(pass);
  return *irradiance_;
}

bool Caster::take_from_device(const uint8_t* used, const NodeRequest* missing, size_t count) {
  irradiance_->set_used(used);
  if (count == 0) return true;
  // what fills an empty cache is averaged when all of it is there
  if (irradiance_->size() == 0) return false;
  irradiance_->request(missing, count);
  return irradiance_->add_requested(node_tracer());
}

bool Caster::restore_irradiance(long tick, int coarser, int nodes, const int32_t* ints,
                                const float* floats) {
  if (!irradiance_) return false;
  if (!irradiance_->restore(tick, coarser, nodes, ints, floats, geoms_)) return false;
  rest_ticks_ = 0;
  kept_of_last_ = Recording::NOTHING;
  return true;
}

void Caster::restart() {
  if (irradiance_) irradiance_->clear();
  rest_ticks_ = 0;
  kept_of_last_ = Recording::NOTHING;
}

}  // namespace evs
