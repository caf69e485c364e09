#include <atomic>
#include <cmath>

#include "render/integrators.h"

namespace evs {
namespace {

constexpr size_t MOST_KEPT_BYTES = 512u << 20;
constexpr int KEPT_LANES = PACKET_WIDTH * PACKET_HEIGHT;

}  // namespace

HybridIntegrator::HybridIntegrator(const IntegratorParts& parts) : PathFollower(parts) {
  const Tracing& tracing = parts.tracing;
  if (tracing.adaptive && tracing.samples > 1) {
    antialiasing_.emplace(parts.optics, scene_.sampling, tracing.rgb);
  }
  choose_channels(tracing);
  const Appearance& colours = colours_ ? *colours_ : scene_.appearance;
  set_emitters(parts.data, colours);
  paths_.bounces = tracing.bounces;
  paths_.sample_set = SAMPLES_OWEN;
  paths_.lobe_samples = 1;
  while ((1 << paths_.log2_samples) < IrradianceCache::SAMPLES) paths_.log2_samples++;
  paths_.transparent_geoms = emitters_->transparent_geoms().data();
  paths_.transparent_count = static_cast<int>(emitters_->transparent_geoms().size());
  update_paths();
  paths_.world = scene_.frame.camera_to_world;
  make_cache(parts.optics, tracing);
  keep_packets(tracing);
  add_lamps(colours);
}

// Choose the channels of nodes, always three, and of pixels: with grey lights these are rendered as
// luminance, and in colour beside it if that is wanted.
void HybridIntegrator::choose_channels(const Tracing& tracing) {
  Frame& frame = scene_.frame;
  const bool rgb = tracing.rgb || forced_.on(COLOUR);
  if (scene_.appearance.channels == 4) {
    colours_ = select_channels(scene_.appearance, true);
    if (!rgb) {
      luminance_ = select_channels(scene_.appearance, false);
      frame.channels = 1;
      frame.surfaces = luminance_->surfaces.data();
      frame.textures = luminance_->textures.data();
      frame.lights = luminance_->lights.data();
      frame.medium = scene_.appearance.medium = luminance_->medium;
    }
  }
  const Appearance& colours = colours_ ? *colours_ : scene_.appearance;
  const float* weights = colours.weights;
  for (const Surface& surface : colours.surfaces) {
    float mean[3], luminance = 0;
    mean_colour(surface, colours, mean);
    for (int c = 0; c < 3; c++) luminance += weights[c] * mean[c];
    for (int c = 0; c < 3; c++)
      tint_.push_back(luminance > 0 ? weights[c] * mean[c] / luminance : weights[c]);
    tint_.push_back(0);
  }
}

void HybridIntegrator::make_cache(const Optics& optics, const Tracing& tracing) {
  // the lattice's spacing: of large images in pixels, of small ones as an angle
  constexpr float MAX_PX = 8, MIN_PX = 2, ANGLE = 0.03f;
  long pixels = static_cast<long>(optics.width) * optics.height;
  float pixel = static_cast<float>(1 / std::sqrt(optics.fx * optics.fy)), spacing = MAX_PX * pixel;
  if (!optics.orthographic) spacing = std::min(spacing, std::max(MIN_PX * pixel, ANGLE));
  size_t nodes = IrradianceCache::most_nodes(pixels);
  if (tracing.nodes > 0) nodes = static_cast<size_t>(tracing.nodes);
  irradiance_.emplace(nodes, spacing, pool_.threads());
}

// Make room for what packets need to be lit again under a still camera.
void HybridIntegrator::keep_packets(const Tracing& tracing) {
  const Frame& frame = scene_.frame;
  size_t packets = static_cast<size_t>(scene_.packets());
  incomplete_.resize(packets);
  size_t samples = antialiasing_ ? 1 : static_cast<size_t>(tracing.samples);
  int channels = frame.channels + (antialiasing_ ? 1 : 0);
  kept_floats_ = samples * kept_rows(channels) * KEPT_LANES;
  surface_floats_ = samples * surface_rows(channels) * KEPT_LANES;
  size_t bytes = (kept_floats_ + surface_floats_) * sizeof(float) + sizeof(KeptNodes);
  bool keeps = packets * bytes <= MOST_KEPT_BYTES;
  if (!incremental_ || !keeps || frame.medium.fog || forced_.off(CACHED_LIGHT)) return;
  packet_cache_.emplace(scene_.sampling, 0, scene_.appearance.lights, frame.shadows);
  kept_ = std::make_unique_for_overwrite<float[]>(packets * kept_floats_);
  kept_nodes_ = std::make_unique<KeptNodes[]>(packets);
  // memory that is not used while lamps rest
  kept_surfaces_ = std::make_unique_for_overwrite<float[]>(packets * surface_floats_);
  kept_whole_.resize(packets);
  emitter_spheres_.resize(static_cast<size_t>(paths_.emitter_count));
}

// Spread points over glowing geoms, as if at the camera.
void HybridIntegrator::add_lamps(const Appearance& colours) {
  lamp_points_.resize(static_cast<size_t>(paths_.emitter_count) * LAMP_POINTS);
  std::vector<Geom> placed = scene_.geoms;
  for (Geom& g : placed) g.rotation[0] = g.rotation[4] = g.rotation[8] = 1;
  Frame frame = scene_.frame;
  frame.geoms = placed.data();
  frame.surfaces = colours.surfaces.data();
  frame.textures = colours.textures.data();
  frame.bounds = scene_.first_bounds();
  for (int e = 0; e < paths_.emitter_count; e++) irradiance_->add_lamp(kernel_, frame, paths_, e);
}

void HybridIntegrator::update_paths() {
  PathFollower::update_paths();
  // the light of a lamp that is forgotten is kept nowhere
  kept_of_last_ = Recording::NOTHING;
}

Frame HybridIntegrator::first_pass(const Frame& frame) const {
  return antialiasing_ ? antialiasing_->base_frame(frame) : Frame{};
}

double HybridIntegrator::trace(const RenderTick& tick, WorkCounters& work, const Outputs& out) {
  set_seed(tick.seed);
  const bool same_seed = tick.seed == previous_seed_;
  previous_seed_ = tick.seed;
  bool same = tick.still && same_seed && scene_.same_lights() && scene_.same_geoms();
  if (!begin(same)) return 0;
  trace_tick(tick.selective && same_seed, work, out);
  return traced_fraction_;
}

bool HybridIntegrator::begin_device_tick(const Poses& poses) {
  set_seed(poses.seed);
  bool same = scene_.is_still(poses) && poses.seed == previous_seed_ && scene_.same_lights() &&
              scene_.same_geoms();
  previous_seed_ = poses.seed;
  scene_.end_tick();
  kept_of_last_ = Recording::NOTHING;
  return begin(same);
}

// The frame in which nodes are lit, and the points of glowing geoms.
void HybridIntegrator::place() {
  paths_.world = scene_.frame.camera_to_world;
  colour_frame_ = scene_.frame;
  node_lights_ = scene_.appearance.lights;
  for (size_t i = 0; i < node_lights_.size(); i++) {
    // nodes are lit at gain 1, the mean of a light that flickers: they follow too slowly
    Light& l = node_lights_[i];
    std::copy_n(scene_.full_lights[i].ambient, MAX_CHANNELS, l.ambient);
    std::copy_n(scene_.full_lights[i].diffuse, MAX_CHANNELS, l.diffuse);
    std::copy_n(scene_.full_lights[i].specular, MAX_CHANNELS, l.specular);
    if (luminance_) select_channels(scene_.appearance.lights[i], false, luminance_->lights[i]);
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
    irradiance_->spread(kernel_, colour_frame_, paths_, e,
                        lamp_points_.data() + static_cast<long>(e) * LAMP_POINTS);
  }
  irradiance_->set_surfaces(tint_.data(), lamp_points_.data(), forced_.off(CACHED_LIGHT));
}

// Find the packets that what moved can affect, apart from the nodes' light. Returns false where all
// have to be traced.
bool HybridIntegrator::find_dirty(WorkCounters& work) {
  // what was kept of a lamp that moves is of no use
  for (int e = 0; e < paths_.emitter_count; e++) {
    int k = paths_.emitters[e].geom;
    const Geom& g = scene_.geoms[k];
    if (scene_.has_changed(static_cast<size_t>(k))) return false;
    emitter_spheres_[e] = scene_.bounding_spheres[k];
    if (g.shape == PLANE) emitter_spheres_[e] = {g.position, g.size[0] + g.size[1]};
  }
  scene_.find_moved(true);
  SceneChange change = scene_.moved(), soft = scene_.moved_soft();
  change.soft = &soft;
  change.emitters = emitter_spheres_.data();
  change.emitter_count = paths_.emitter_count;
  if (!scene_.same_lights()) change.lights = last_lights_.data();
  packet_cache_->find_dirty(kernel_, scene_.frame, change, pool_);
  work.packets_tested += scene_.packets();
  return true;
}

IrradianceCache::Tracer HybridIntegrator::node_tracer() {
  return {kernel_, colour_frame_, paths_, batches_.get(), pool_};
}

// Begin a tick of the `hybrid` integrator. In: whether all is as it was in the last tick. Returns
// whether there is anything to trace.
bool HybridIntegrator::begin(bool same) {
  IrradianceCache& cache = *irradiance_;
  rest_ticks_ = same ? rest_ticks_ + 1 : 0;
  if (incremental_ && !forced_.on(FULL_RETRACE) && rest_ticks_ > IrradianceCache::REST_TICKS) {
    cache.skip_tick();
    return false;
  }
  place();
  cache.next_tick(node_tracer());
  return true;
}

// Trace the pixels of a tick. In: whether only dirty packets are traced.
void HybridIntegrator::trace_tick(bool selective, WorkCounters& work, const Outputs& out) {
  IrradianceCache& cache = *irradiance_;
  IrradianceCache::Tracer tracer = node_tracer();
  bool cold = cache.size() == 0;
  bool records = kept_ && selective, lamps_move = !scene_.same_lights();
  Recording now = !records     ? Recording::NOTHING
                  : lamps_move ? Recording::SURFACES
                               : Recording::LIGHT;
  // a sweep asks each packet for its nodes
  selective = records && kept_of_last_ >= now && !cache.swept() && find_dirty(work);
  if (records && !selective) packet_cache_->record_all();
  auto pass = [&] { return trace_passes(tracer, now, selective, work, out); };
  while (!pass()) cold = true, selective = false;
  // a view without surfaces has no nodes for ever
  if (cold && cache.size() > 0) {
    cache.settle(colour_frame_);
    pass();
  }
  last_lights_.assign(scene_.frame.lights, scene_.frame.lights + scene_.frame.light_count);
  // light alone is kept of packets that are traced while lamps rest
  kept_of_last_ = now;
}

// Trace all pixels with the light of the irradiance cache, or those of dirty packets; the others
// are lit again with what they have kept. Returns false where the cache's lattice became coarser on
// the way.
bool HybridIntegrator::trace_passes(const IrradianceCache::Tracer& tracer, Recording now,
                                    bool selective, WorkCounters& work, const Outputs& out) {
  IrradianceCache& cache = *irradiance_;
  cache.begin_pass(IrradianceCache::ALL_PIXELS);
  const Outputs base_out = antialiasing_ ? antialiasing_->base() : out;
  const Frame base_frame = antialiasing_ ? antialiasing_->base_frame(scene_.frame) : scene_.frame;
  std::atomic<long> traced{0}, relit{0};
  // call job(row, worker) for all rows, and again for those that missed nodes
  std::fill(incomplete_.begin(), incomplete_.end(), uint8_t{1});
  auto complete_rows = [&](auto job) {
    for (;;) {
      std::atomic<bool> complete{true};
      pool_.run(scene_.sampling.rows, [&](int row, int worker) {
        if (!job(row, worker)) complete = false;
      });
      if (complete) return true;
      if (!cache.add_requested(tracer)) return false;
    }
  };
  bool fits = complete_rows([&](int row, int worker) {
    using Dirty = PacketCache::Dirty;
    size_t first = static_cast<size_t>(row) * scene_.sampling.columns;
    uint8_t *incomplete = incomplete_.data() + first, *whole = kept_whole_.data() + first;
    long own_traced = 0, own_relit = 0;
    bool complete = true, pairs = kernel_.trace_hybrid_pair && scene_.frame.pairs;
    auto surfaces = [&](int column) {
      return now == Recording::SURFACES ? kept_surfaces_.get() + (first + column) * surface_floats_
                                        : nullptr;
    };
    // a packet that has not kept all is traced again and again: its rays are recorded already
    auto dirty_of = [&](int column) {
      if (now == Recording::NOTHING) return Dirty::RETRACE_UNRECORDED;
      Dirty dirty = selective ? packet_cache_->dirty(column, row) : Dirty::RETRACE;
      // without its surface, its light cannot be found again
      if (now == Recording::LIGHT && dirty == Dirty::RELIGHT) dirty = Dirty::RETRACE;
      bool keeps = dirty == Dirty::CLEAN || dirty == Dirty::RELIGHT;
      return keeps && !whole[column] ? Dirty::RETRACE_UNRECORDED : dirty;
    };
    for (int column = 0; column < scene_.sampling.columns; column++) {
      if (!incomplete[column]) continue;
      Dirty dirty = dirty_of(column);
      int count = 1;
      bool found = true;
      bool keeps = dirty == Dirty::CLEAN || dirty == Dirty::RELIGHT;
      if (dirty == Dirty::CLEAN && !cache.any_changed(kept_nodes_[first + column])) {
        // its pixels are those of the last tick, and so are those that were refined
        incomplete[column] = 0;
        continue;
      }
      if (keeps) {
        const float* lamps = dirty == Dirty::RELIGHT ? surfaces(column) : nullptr;
        kernel_.relight_hybrid(base_frame, paths_, cache.view(), cache.requests(worker), column,
                               row, base_out, kept_nodes_[first + column],
                               kept_.get() + (first + column) * kept_floats_, lamps);
        own_relit++;
      } else if (dirty == Dirty::RETRACE_UNRECORDED) {
        bool two = pairs && column % 2 == 0 && column + 1 < scene_.sampling.columns &&
                   incomplete[column + 1] && dirty_of(column + 1) == dirty;
        if (two) {
          kernel_.trace_hybrid_pair(base_frame, paths_, cache.view(), cache.requests(worker),
                                    column, row, base_out);
        } else {
          kernel_.trace_hybrid(base_frame, paths_, cache.view(), cache.requests(worker), column,
                               row, base_out, nullptr);
        }
        count += two;
        found = cache.collect(worker);
        for (int k = 0; k < count && kept_; k++) whole[column + k] = 0;
      } else {
        KeptNodes* nodes = &kept_nodes_[first + column];
        nodes->count = 0;
        KeptPacket kept = {packet_cache_->record(column, row), nodes,
                           kept_.get() + (first + column) * kept_floats_, surfaces(column), false};
        kernel_.trace_hybrid(base_frame, paths_, cache.view(), cache.requests(worker), column, row,
                             base_out, &kept);
        found = cache.collect(worker);
        whole[column] = kept.complete;
      }
      if (!keeps) own_traced += count;
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
  long packets = scene_.packets();
  work.packets_traced += traced;
  work.packets_relit += relit;
  traced_fraction_ = std::min(1.0, static_cast<double>(traced) / static_cast<double>(packets));
  if (fits && cache.swept()) cache.take_readers();
  if (!fits || !antialiasing_) return fits;
  cache.begin_pass(IrradianceCache::EDGES);
  antialiasing_->close_margin();
  fits = complete_rows([&](int row, int worker) {
    auto refine = [&](int column, int, unsigned pixels, float* luminance, float* rgb) {
      size_t packet = static_cast<size_t>(row) * scene_.sampling.columns + column;
      bool keeps = now != Recording::NOTHING && kept_whole_[packet];
      KeptPacket kept = {};
      if (keeps)
        kept = {packet_cache_->record(column, row), &kept_nodes_[packet], nullptr, nullptr, false};
      kernel_.refine_hybrid(scene_.frame, paths_, cache.view(), cache.requests(worker), column, row,
                            pixels, luminance, rgb, keeps ? &kept : nullptr);
      bool found = cache.collect(worker);
      if (keeps && found) kept_whole_[packet] = kept.complete;
      return found;
    };
    return antialiasing_->finish_row(kernel_, row, out, refine);
  });
  antialiasing_->next_tick();
  return fits;
}

void HybridIntegrator::trace_here(float* luminance) {
  WorkCounters counted_already;
  trace_tick(false, counted_already, {luminance, nullptr, nullptr, 0, nullptr});
}

const IrradianceCache& HybridIntegrator::begin_device_pass(IrradianceCache::Pass pass) {
  irradiance_->begin_pass(pass);
  return *irradiance_;
}

bool HybridIntegrator::take_from_device(const uint8_t* used, const NodeRequest* missing,
                                        size_t count) {
  irradiance_->set_used(used);
  if (count == 0) return true;
  // what fills an empty cache is averaged when all of it is there
  if (irradiance_->size() == 0) return false;
  irradiance_->request(missing, count);
  return irradiance_->add_requested(node_tracer());
}

bool HybridIntegrator::restore_irradiance(long tick, int coarser, int nodes, const int32_t* ints,
                                          const float* floats) {
  if (!irradiance_->restore(tick, coarser, nodes, ints, floats, scene_.geoms)) return false;
  rest_ticks_ = 0;
  kept_of_last_ = Recording::NOTHING;
  return true;
}

void HybridIntegrator::restart() {
  irradiance_->clear();
  rest_ticks_ = 0;
  kept_of_last_ = Recording::NOTHING;
}

}  // namespace evs
