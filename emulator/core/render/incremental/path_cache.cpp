#include "incremental/path_cache.h"

#include <algorithm>
#include <cmath>
#include <cstring>

namespace evs {
namespace {

constexpr int BLOCK = 64;                  // samples that trace_paths adds up before they join
constexpr size_t MOST_BYTES = 256u << 20;  // that are kept
constexpr size_t MOST_RODS = 128;          // more things that move are not followed
constexpr int RECOUNT = 256;               // ticks; sums of motion stay small, and exact
constexpr double TOO_MUCH = 0.75;          // share of samples at which keeping does not pay
constexpr double REACH = 32;               // ticks of motion that a gap found later has room for
constexpr int PAUSE = 32;                  // ticks without it then
constexpr int LAMPS_STILL = 8;             // ticks; lamps that stood so long are kept again
constexpr size_t REST = 6;                 // numbers of KeptLight::rest
constexpr size_t FIRST = 4;                // of its away and albedo
constexpr size_t MARGIN = 272;             // of one array to the next: apart in the caches
constexpr int BITS = 32;

// How far any point of the rod went, at most, and how much thicker or thinner it got.
double moved_by(const Rod& a, const Rod& b) {
  auto end = [&](double side) {
    double x = (b.center.x + side * b.axis.x * b.half) - (a.center.x + side * a.axis.x * a.half);
    double y = (b.center.y + side * b.axis.y * b.half) - (a.center.y + side * a.axis.y * a.half);
    double z = (b.center.z + side * b.axis.z * b.half) - (a.center.z + side * a.axis.z * a.half);
    return std::sqrt(x * x + y * y + z * z);
  };
  return std::max(end(1), end(-1)) + std::abs(static_cast<double>(b.radius) - a.radius);
}

}  // namespace

KeptPaths::KeptPaths(int width, int height, int samples, size_t geoms)
    : watched_(geoms), moving_(geoms) {
  light_.columns = (width + 31) / 32 * 32;
  // 2: what is noted of each packet
  size_t pixels = static_cast<size_t>(light_.columns) * height, bytes = 5 * sizeof(float) + 2;
  bool singly = samples <= MOST_SINGLE && pixels * samples * bytes <= MOST_BYTES;
  light_.size = singly ? 1 : BLOCK;
  light_.units = (samples + light_.size - 1) / light_.size;
  entries_ = pixels * light_.units;
  rods_.reserve(MOST_RODS);
  if (entries_ * bytes > MOST_BYTES) {
    entries_ = 0;
    return;
  }
  // not written, so that they take no memory until they are
  bool relit = light_.size == 1 && entries_ * (bytes + REST * sizeof(float)) <= MOST_BYTES;
  size_t numbers = relit ? 4 + REST : 4;
  bool points = relit && entries_ * (bytes + (REST + FIRST) * sizeof(float)) <= MOST_BYTES;
  size_t stride = entries_ + MARGIN;
  numbers_ = large_array<float>((numbers + (points ? FIRST : 0)) * stride);
  auto array = [&](size_t i) { return numbers_.get() + i * stride; };
  touched_ = large_array<uint32_t>(entries_);
  bytes += (REST + FIRST + FAN_WORDS) * sizeof(float);
  if (singly && entries_ * bytes <= MOST_BYTES) {
    fans_ = large_array<float>(FAN_WORDS * entries_);
  }
  int rows = (height + PACKET_HEIGHT - 1) / PACKET_HEIGHT;
  changed_.resize(static_cast<size_t>(rows) * light_.columns / 16);
  for (int c = 0; c < 3; c++) light_.light[c] = array(c);
  light_.until = array(3);
  for (size_t i = 0; i < REST && relit; i++) rest_[i] = array(4 + i);
  if (points) {
    seen_.resize(entries_ / 16);
    balls_.resize(entries_ / 4);
    unlit_.resize(entries_ / 16);
    for (size_t i = 0; i < 4; i++) light_.ball[i] = balls_.data() + i * entries_ / 16;
    light_.unlit = unlit_.data();
    light_.away = array(numbers);
    for (int c = 0; c < 3; c++) light_.albedo[c] = array(numbers + 1 + c);
    light_.seen = seen_.data();
  }
  soonest_.resize(entries_ / 16);
  for (std::vector<uint32_t>* packets : {&met_, &due_, &doubtful_}) packets->resize(entries_ / 16);
  light_.fans = fans_.get();
  light_.soonest = soonest_.data();
  light_.met = met_.data();
  light_.due = due_.data();
  light_.doubtful = doubtful_.data();
  light_.touched = touched_.get();
  light_.changed = changed_.data();
}

// Find what moved, and put a rod around it. Out: how far the fastest went; whether something moved
// for the first time. False: it cannot be followed.
bool KeptPaths::follow(const Places& p, double& farthest, bool& is_new) {
  rods_.clear();
  light_.moved = 0;
  farthest = 0;
  is_new = false;
  for (size_t k = 0; k < p.now.size(); k++) {
    const Geom& g = p.now[k];
    bool moved =
        (g.mesh >= 0 && p.deformed[g.mesh]) || std::memcmp(&g, &p.before[k], sizeof(Geom)) != 0;
    moving_[k] = moved;
    if (!moved && !watched_[k]) continue;
    // a plane is everywhere, and an emitter is aimed at from everywhere
    if (g.shape == PLANE || p.emitter_of_geom[k] >= 0 || rods_.size() == MOST_RODS) return false;
    is_new = is_new || !watched_[k];
    watched_[k] = true;
    Rod rod = rod_of(g, p.balls[k]);
    rod.bit = 1u << (k % BITS);
    if (moved) {
      light_.moved |= rod.bit;
      double far = moved_by(rod_of(p.before[k], p.balls_before[k]), rod);
      if (!std::isfinite(far)) return false;
      farthest = std::max(farthest, far);
    }
    rods_.push_back(rod);
  }
  light_.moving = moving_.data();
  light_.rods = rods_.data();
  light_.rod_count = static_cast<int>(rods_.size());
  return true;
}

// `until` counted from 0 again, and no number larger than it was.
void KeptPaths::start_again() {
  float travelled = light_.travelled;
  for (size_t i = 0; i < entries_; i++) {
    float left = light_.until[i] - travelled;
    light_.until[i] = left - (std::abs(left) + travelled) * 1e-6f;
  }
  soonest_.assign(soonest_.size(), -1.0f);
  travelled_ = 0;
  light_.travelled = 0;
  ticks_ = 0;
}

KeptPaths::Plan KeptPaths::plan(const Places& places, bool same, bool same_lamps, uint32_t steady) {
  double farthest;
  bool is_new;
  if (pause_ > 0) pause_--;
  lamps_still_ = same_lamps ? lamps_still_ + 1 : 0;
  bool can = entries_ && same && (same_lamps || rest_[0]);
  // of a camera that moves everything seems to
  if (!can || pause_ > 0 || !follow(places, farthest, is_new)) {
    valid_ = false;
    return Plan::FORGET;
  }
  bool settled = light_.relit && lamps_still_ >= LAMPS_STILL;
  // what is not MuJoCo's lights' is kept from the first tick on in which one of them is not as
  // before
  bool lamps_began = !same_lamps && !light_.rest[0];
  if (lamps_began) std::copy(rest_, rest_ + REST, light_.rest);
  light_.all = !valid_ || is_new || settled || lamps_began;
  if (light_.all) light_.relit = false;
  // what is near is asked again soon; the first time it may be far
  bool brief = light_.fans && !light_.all;
  light_.reach = brief ? static_cast<float>(farthest * REACH) : 1e30f;
  light_.relit = light_.relit || !same_lamps;
  light_.stirred = (light_.steady & ~steady) != 0;
  light_.steady = light_.all ? steady : light_.steady & steady;
  if (light_.all) {
    travelled_ = ticks_ = 0;
    light_.travelled = 0;
    valid_ = true;
    return Plan::ALL;
  }
  if (ticks_++ == RECOUNT) start_again();
  // and the rounding of the places
  travelled_ += farthest * 1.00001;
  light_.travelled = static_cast<float>(travelled_ * 1.000001);
  return Plan::SOME;
}

void KeptPaths::traced(double share) {
  if (share < TOO_MUCH || light_.all) return;
  valid_ = false;
  pause_ = PAUSE;
}

}  // namespace evs
