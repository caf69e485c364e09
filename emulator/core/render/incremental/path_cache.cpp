#include "render/incremental/path_cache.h"

#include <algorithm>
#include <cmath>
#include <cstring>

namespace evs {
namespace {

constexpr int SUM_BLOCK = 64;  // samples of a unit, summed before they join the pixel's sum
constexpr size_t MAX_BYTES = 256u << 20;   // of cached data
constexpr size_t MAX_CAPSULES = 128;       // more moving geoms are not tracked
constexpr int REBASE_TICKS = 256;          // keeps sums of motion small and precise
constexpr double MAX_TRACED_SHARE = 0.75;  // of the samples; above it the cache does not pay
constexpr double GAP_TICKS = 32;           // ticks of motion that a rechecked gap covers
constexpr int PAUSE_TICKS = 32;            // ticks without the cache then
constexpr int STILL_LAMP_TICKS = 8;        // ticks; lights still for so long are cached again
constexpr size_t INDIRECT_WORDS = 6;       // numbers of PathCacheView::indirect
constexpr size_t HIT_WORDS = 4;            // of its hit_distance and albedo
constexpr size_t MARGIN = 272;             // between arrays: different cache sets
constexpr int BITS = 32;

// Return an upper bound of the motion of any point of the capsule, and of its change in radius.
double motion_of(const BoundingCapsule& a, const BoundingCapsule& b) {
  auto end = [&](double side) {
    double x = (b.center.x + side * b.axis.x * b.half) - (a.center.x + side * a.axis.x * a.half);
    double y = (b.center.y + side * b.axis.y * b.half) - (a.center.y + side * a.axis.y * a.half);
    double z = (b.center.z + side * b.axis.z * b.half) - (a.center.z + side * a.axis.z * a.half);
    return std::sqrt(x * x + y * y + z * z);
  };
  return std::max(end(1), end(-1)) + std::abs(static_cast<double>(b.radius) - a.radius);
}

}  // namespace

PathCache::PathCache(int width, int height, int samples, size_t geoms, const uint32_t* marked,
                     bool first_geoms)
    : tracked_(geoms), moving_(geoms) {
  view_.columns = (width + 31) / 32 * 32;
  // 2: the data of each packet
  size_t pixels = static_cast<size_t>(view_.columns) * height, bytes = 5 * sizeof(float) + 2;
  if (first_geoms) bytes += sizeof(int32_t);
  bool singly = !marked && samples <= MAX_SINGLE_UNITS && pixels * samples * bytes <= MAX_BYTES;
  view_.size = singly ? 1 : SUM_BLOCK;
  view_.units = (samples + view_.size - 1) / view_.size;
  entries_ = pixels * view_.units;
  capsules_.reserve(MAX_CAPSULES);
  if (entries_ * bytes > MAX_BYTES) {
    entries_ = 0;
    return;
  }
  // untouched pages take no memory
  bool relight_lamps =
      view_.size == 1 && entries_ * (bytes + INDIRECT_WORDS * sizeof(float)) <= MAX_BYTES;
  size_t numbers = relight_lamps ? 4 + INDIRECT_WORDS : 4;
  bool hits = relight_lamps &&
              entries_ * (bytes + (INDIRECT_WORDS + HIT_WORDS) * sizeof(float)) <= MAX_BYTES;
  size_t stride = entries_ + MARGIN;
  numbers_ = large_array<float>((numbers + (hits ? HIT_WORDS : 0)) * stride);
  auto array = [&](size_t i) { return numbers_.get() + i * stride; };
  touched_ = large_array<uint32_t>(entries_);
  if (first_geoms) first_geoms_ = large_array<int32_t>(entries_);
  view_.first_geom = first_geoms_.get();
  view_.marked = marked;
  known_.resize(marked ? pixels / 32 : 0);
  view_.known = known_.data();
  bytes += (INDIRECT_WORDS + HIT_WORDS + SECONDARY_RAY_WORDS) * sizeof(float);
  if (singly && entries_ * bytes <= MAX_BYTES) {
    secondary_rays_ = large_array<float>(SECONDARY_RAY_WORDS * entries_);
  }
  int rows = (height + PACKET_HEIGHT - 1) / PACKET_HEIGHT;
  changed_.resize(static_cast<size_t>(rows) * view_.columns / 16);
  for (int c = 0; c < 3; c++) view_.light[c] = array(c);
  view_.valid_until = array(3);
  for (size_t i = 0; i < INDIRECT_WORDS && relight_lamps; i++) indirect_[i] = array(4 + i);
  if (hits) {
    hit_geoms_.resize(entries_ / 16);
    hit_spheres_.resize(entries_ / 4);
    only_steady_light_.resize(entries_ / 16);
    for (size_t i = 0; i < 4; i++) view_.sphere[i] = hit_spheres_.data() + i * entries_ / 16;
    view_.only_steady_light = only_steady_light_.data();
    view_.hit_distance = array(numbers);
    for (int c = 0; c < 3; c++) view_.albedo[c] = array(numbers + 1 + c);
    view_.hit_geom = hit_geoms_.data();
  }
  next_expiry_.resize(entries_ / 16);
  for (std::vector<uint32_t>* packets : {&touched_any_, &dirty_, &expired_})
    packets->resize(entries_ / 16);
  view_.secondary_rays = secondary_rays_.get();
  view_.next_expiry = next_expiry_.data();
  view_.touched_any = touched_any_.data();
  view_.dirty = dirty_.data();
  view_.expired = expired_.data();
  view_.touched = touched_.get();
  view_.changed = changed_.data();
}

// Find the geoms that moved and bound them by capsules. Out: the largest motion; whether a geom
// moved for the first time. False: the motion cannot be tracked.
bool PathCache::track_motion(const GeomStates& p, double& max_motion, bool& is_new) {
  capsules_.clear();
  view_.moved = 0;
  max_motion = 0;
  is_new = false;
  for (size_t k = 0; k < p.now.size(); k++) {
    const Geom& g = p.now[k];
    bool moved =
        (g.mesh >= 0 && p.deformed[g.mesh]) || std::memcmp(&g, &p.before[k], sizeof(Geom)) != 0;
    moving_[k] = moved;
    if (!moved && !tracked_[k]) continue;
    // planes are unbounded, and emitters are sampled from everywhere
    if (g.shape == PLANE || p.emitter_of_geom[k] >= 0 || capsules_.size() == MAX_CAPSULES)
      return false;
    is_new = is_new || !tracked_[k];
    tracked_[k] = true;
    BoundingCapsule capsule = bounding_capsule(g, p.spheres[k]);
    capsule.bit = 1u << (k % BITS);
    if (moved) {
      view_.moved |= capsule.bit;
      double far = motion_of(bounding_capsule(p.before[k], p.spheres_before[k]), capsule);
      if (!std::isfinite(far)) return false;
      max_motion = std::max(max_motion, far);
    }
    capsules_.push_back(capsule);
  }
  view_.moving = moving_.data();
  view_.capsules = capsules_.data();
  view_.capsule_count = static_cast<int>(capsules_.size());
  return true;
}

// Rebase `valid_until` to 0, rounding down.
void PathCache::rebase_motion() {
  float motion = view_.motion;
  for (size_t i = 0; i < entries_; i++) {
    float left = view_.valid_until[i] - motion;
    view_.valid_until[i] = left - (std::abs(left) + motion) * 1e-6f;
  }
  next_expiry_.assign(next_expiry_.size(), -1.0f);
  motion_ = 0;
  view_.motion = 0;
  ticks_ = 0;
}

PathCache::Plan PathCache::plan(const GeomStates& states, bool same, bool same_lamps,
                                uint32_t steady) {
  double max_motion;
  bool is_new;
  if (pause_ > 0) pause_--;
  still_lamp_ticks_ = same_lamps ? still_lamp_ticks_ + 1 : 0;
  bool can = entries_ && same && (same_lamps || indirect_[0]);
  // under a moving camera every geom moves
  if (!can || pause_ > 0 || !track_motion(states, max_motion, is_new)) {
    valid_ = false;
    return Plan::TRACE_UNCACHED;
  }
  bool settled = view_.relight_lamps && still_lamp_ticks_ >= STILL_LAMP_TICKS;
  // cache the indirect light from the first tick on in which a light changes
  bool lamps_began = !same_lamps && !view_.indirect[0];
  if (lamps_began) std::copy(indirect_, indirect_ + INDIRECT_WORDS, view_.indirect);
  view_.trace_all = !valid_ || is_new || settled || lamps_began;
  if (view_.trace_all) view_.relight_lamps = false;
  // near units are rechecked soon, so a short gap suffices; the first gap is unlimited
  bool brief = view_.secondary_rays && !view_.trace_all;
  view_.max_gap = brief ? static_cast<float>(max_motion * GAP_TICKS) : 1e30f;
  view_.relight_lamps = view_.relight_lamps || !same_lamps;
  view_.fewer_steady = (view_.steady & ~steady) != 0;
  view_.steady = view_.trace_all ? steady : view_.steady & steady;
  if (view_.trace_all) {
    motion_ = ticks_ = 0;
    view_.motion = 0;
    valid_ = true;
    return Plan::TRACE_ALL;
  }
  if (ticks_++ == REBASE_TICKS) rebase_motion();
  // add the rounding of the positions
  motion_ += max_motion * 1.00001;
  view_.motion = static_cast<float>(motion_ * 1.000001);
  return Plan::TRACE_DIRTY;
}

void PathCache::traced(double share) {
  if (share < MAX_TRACED_SHARE || view_.trace_all) return;
  valid_ = false;
  pause_ = PAUSE_TICKS;
}

}  // namespace evs
