// The event pixel: its settings, fixed pattern and state, and the constants of one tick.
//
// Stages: luminance, running mean, log intensity, photoreceptor and source follower bandwidth, leak
// and high pass (pixel_front_end.h), then ON and OFF comparators, shot noise and refractory period
// (comparator.h). A term that is off is a null pointer or a zero and costs no loop, no memory and
// no random number.
#pragma once

#include <cstddef>
#include <cstdint>
#include <limits>

#include "sensor/aps_crosstalk.h"
#include "sensor/log_map.h"
#include "sensor/lowpass.h"
#include "sensor/photon_noise.h"
#include "sensor/running_mean.h"
#include "sensor/shot_noise.h"

// The terms that a sensor may have. A GPU's kernels are compiled without those that it has not.
#ifndef EVS_PHOTON_NOISE
#define EVS_PHOTON_NOISE 1
#endif
#ifndef EVS_SHOT_NOISE
#define EVS_SHOT_NOISE 1
#endif
#ifndef EVS_RUNNING_MEAN
#define EVS_RUNNING_MEAN 1
#endif
// its LogKind; -1: any
#ifndef EVS_LOG
#define EVS_LOG -1
#endif
// how its filters step, 0: as poles, 1: euler, 2: large_signal; -1: any
#ifndef EVS_FILTER
#define EVS_FILTER -1
#endif

namespace evs {

// The parameters that all pixels of a sensor share.
struct PixelSettings {
  LogMap map;
  bool euler = false;         // filters step as in v2e
  bool large_signal = false;  // the photoreceptor does not step as a pole
  // photoreceptor bandwidth, 2 pi f = low + slope DN, 1 / us; both 0: unlimited
  double lowpass_low = 0.0;
  double lowpass_slope = 0.0;
  double follower = 0.0;         // source follower, 2 pi f, 1 / us; 0: off
  double highpass = 0.0;         // 2 pi f, 1 / us; 0: off
  double parasitic_slope = 0.0;  // parasitic leak is parasitic * this * DN; 0: off
  uint32_t refractory = 0;       // us
  float noise_gain = 0.0f;       // of the running mean
  float drift_gain = 0.0f;
  float least_gain = 0.0f;
  float noise_weight = 0.0f;
  bool running_mean = false;
  bool causes = false;         // events hold their cause
  double aps_crosstalk = 0.0;  // of the read of a row of a frame, log units
  ShotNoise shot;
  PhotonNoise photon;

  LogKind log() const { return EVS_LOG < 0 ? map.kind : static_cast<LogKind>(EVS_LOG); }
  bool steps_as_euler() const { return EVS_FILTER < 0 ? euler : EVS_FILTER == 1; }
  bool steps_by_large_signal() const { return EVS_FILTER < 0 ? large_signal : EVS_FILTER == 2; }
  bool averages() const { return EVS_RUNNING_MEAN && running_mean; }
  bool lowpass() const { return lowpass_low > 0.0 || lowpass_slope > 0.0; }
  // Whether a high pass moves references; one that is forced on and idle has a rate of 1e-300.
  bool references_follow() const { return highpass > 1e-290; }

  // Visit each setting by its name in PlainModel of emulator/sensor/pixel.py. Those of the log map
  // and the seed need bindings/sensor.cpp.
  template <class Visit>
  void each(Visit&& visit) {
    visit("euler", euler);
    visit("large_signal", large_signal);
    visit("lowpass_low", lowpass_low);
    visit("lowpass_slope", lowpass_slope);
    visit("follower", follower);
    visit("highpass", highpass);
    visit("parasitic_slope", parasitic_slope);
    visit("refractory_us", refractory);
    visit("causes", causes);
    visit("noise_gain", noise_gain);
    visit("drift_gain", drift_gain);
    visit("least_gain", least_gain);
    visit("noise_weight", noise_weight);
    visit("shot_bright", shot.bright);
    visit("shot_inverse", shot.inverse);
    visit("shot_slope", shot.slope);
    visit("shot_offset", shot.offset);
    visit("shot_dim_dn", shot.dim_dn);
    visit("aps_crosstalk", aps_crosstalk);
    visit("photon_scale", photon.scale);
  }
};

// The fixed pattern, row by row. Null: the term is off.
struct PixelPattern {
  const float* theta_on = nullptr;       // at least 2^-20; infinite: the pixel is dead
  const float* theta_off = nullptr;      // at least 2^-20
  const float* leak = nullptr;           // log units per us, multiples of 2^-43
  const float* parasitic = nullptr;      // the same, in proportion to light
  const float* phase = nullptr;          // log units from the first reference up to the first light
  const uint8_t* hot = nullptr;          // 1: the cause of its leak events is `hot`
  const float* shot_on = nullptr;        // Hz in the dark
  const float* shot_off = nullptr;       // Hz
  const uint32_t* refractory = nullptr;  // us, in [1, 2^30]; null: that of the settings

  // Visit each array by its name in FixedPattern of emulator/sensor/fixed_pattern.py.
  template <class Visit>
  void each(Visit&& visit) {
    visit("on", theta_on);
    visit("off", theta_off);
    visit("leak", leak);
    visit("parasitic", parasitic);
    visit("phase", phase);
    visit("hot", hot);
    visit("shot_on", shot_on);
    visit("shot_off", shot_off);
    visit("refractory_us", refractory);
  }
};

// The state of all pixels, row by row, all In/out. Null: the term is off.
struct PixelArrays {
  double* reference = nullptr;      // log intensity; NaN without light or while refractory
  float* last_log = nullptr;        // NaN before the first light
  float* last_luminance = nullptr;  // last usable luminance; -1 before the first
  float* filtered = nullptr;        // photoreceptor output
  float* followed = nullptr;        // source follower output
  int64_t* blind_until = nullptr;   // end of the refractory period, us of the sensor's clock
  // photon noise; null: off
  double* noise_budget = nullptr;  // hazard up to the next event, a multiple of 2^-46
  float* noise_mean = nullptr;     // of the noise, log units
  float* noise_memory = nullptr;   // correlation with the noise at the last event
  RunningMean running_mean;
  // of each block, us of the sensor's clock
  int64_t* due_us = nullptr;    // no event before this time if light is constant
  int64_t* since_us = nullptr;  // the references include the leak up to this time
  ShotClock shot{nullptr, nullptr};

  bool photon_noise() const { return EVS_PHOTON_NOISE && noise_budget != nullptr; }
  bool shot_noise() const { return EVS_SHOT_NOISE && shot.next != nullptr; }
};

// The table of the state: visit(name, array, pixels, first, on) each array. It has a number for
// each `pixels` pixels, at first this one, and is null unless the terms that are on need it.
template <class Visit>
void each_array(PixelArrays& a, const PixelSettings& settings, const PixelPattern& pattern,
                Visit&& visit) {
  constexpr double NONE = std::numeric_limits<double>::quiet_NaN();
  const bool low_pass = settings.lowpass(), follower = settings.follower > 0.0;
  const bool refractory = settings.refractory > 0, photon_noise = settings.photon.scale > 0.0;
  const bool running_mean = settings.running_mean, shot_noise = pattern.shot_on != nullptr;
  // whether anything happens with time in blocks that are skipped
  const bool skips = pattern.leak != nullptr || settings.highpass > 0.0 || low_pass || follower ||
                     refractory || running_mean;
  visit("reference", a.reference, 1, NONE, true);
  visit("last_log", a.last_log, 1, NONE, true);
  visit("last_luminance", a.last_luminance, 1, -1.0, true);
  visit("filtered", a.filtered, 1, 0.0, low_pass);
  visit("followed", a.followed, 1, 0.0, follower);
  visit("blind_until", a.blind_until, 1, 0.0, refractory);
  visit("noise_budget", a.noise_budget, 1, 0.0, photon_noise);
  visit("noise_mean", a.noise_mean, 1, 0.0, photon_noise);
  visit("noise_memory", a.noise_memory, 1, 0.0, photon_noise);
  visit("mean", a.running_mean.mean, 1, NONE, running_mean);
  visit("noise", a.running_mean.noise, 1, 0.0, running_mean);
  visit("drift", a.running_mean.drift, 1, 0.0, running_mean);
  visit("due_us", a.due_us, BLOCK_PIXELS, 0.0, skips);
  visit("since_us", a.since_us, BLOCK_PIXELS, 0.0, skips);
  visit("shot_next", a.shot.next, BLOCK_PIXELS, 0.0, shot_noise);
  visit("shot_count", a.shot.count, BLOCK_PIXELS, 0.0, shot_noise);
}

struct Tick {
  const float* luminance;
  int64_t begin_us;  // by the sensor's clock, the sum of all ticks so far
  uint32_t us;
  RowReads rows = {};
  bool all_due = false;  // skip no block: a parameter has changed since the last tick
};

// The refractory period of a pixel, us; 0: none.
inline uint32_t refractory_us(const PixelSettings& settings, const PixelPattern& pattern,
                              size_t pixel) {
  return pattern.refractory == nullptr ? settings.refractory : pattern.refractory[pixel];
}

// The inputs and constants of one tick: plain values and pointers, as a GPU takes them.
struct PixelStep {
  PixelSettings settings;
  PixelPattern pattern;
  PixelArrays arrays;
  const double* shot_bounds;  // Hz, of each block
  Tick tick;
  float safe_below;     // luminance in [0, this) is usable whatever the settings
  float lowpass_low;    // z at DN 0
  float lowpass_slope;  // z per DN
  float follower_z;
  float photon_scale;  // sigma^2 DN / z
  LowpassStep follower;
  LowpassStep highpass;
  bool curves;  // signals are not lines inside the tick

  // Whether the follower sees the output of a photoreceptor that bends inside the tick.
  bool bends() const { return settings.lowpass() && follower_z > STRAIGHT; }
};

inline PixelStep prepare_step(const PixelSettings& settings, const PixelPattern& pattern,
                              const PixelArrays& arrays, const double* shot_bounds, Tick tick) {
  // flush denormals, whose effect in the workers depends on the machine
  auto in_a_tick = [&](double rate) {
    return flush_to_zero(static_cast<float>(rate * tick.us), std::numeric_limits<float>::min());
  };
  const float follower_z = in_a_tick(settings.follower);
  const bool curves = !settings.steps_as_euler() && tick.us > 1 &&
                      (settings.lowpass() || follower_z > STRAIGHT) &&
                      (settings.follower == 0.0 || follower_z > STRAIGHT);
  return {settings,
          pattern,
          arrays,
          shot_bounds,
          tick,
          is_usable(LARGEST_MEAN, to_dn(settings.map, LARGEST_MEAN)) ? LARGEST_MEAN : 0.0f,
          in_a_tick(settings.lowpass_low),
          in_a_tick(settings.lowpass_slope),
          follower_z,
          static_cast<float>(settings.photon.scale / tick.us),
          lowpass_step(follower_z),
          lowpass_step(in_a_tick(settings.highpass)),
          curves};
}

}  // namespace evs
