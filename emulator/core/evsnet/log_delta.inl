// Luminance to the log intensity difference X_k = L_log(k) - L_log(k - 1) of one register of lanes
// (the paper's equation 1). Luminance is mapped as by `log_intensity` in sensor/pixel_front_end.h.
#pragma once

#include "base/simd.inl"
#include "evsnet/network_kernel.h"
#include "sensor/log_map.h"

namespace evs::EVS_NAMESPACE {
namespace {

struct LogDelta {
  Float x;         // clamped
  Mask usable;     // luminance is
  Mask nonzero;    // X is not 0
  Mask unclamped;  // X was not clamped
};

// In: `dn` and `part`, what to_dn and log_part give; `inside`, the lanes of the image. In/out: the
// last luminance that was usable, and its log.
EVS_INLINE LogDelta log_delta_lanes(const LogMap& map, Float luminance, Float dn, Float part,
                                    Mask inside, Float& last_luminance, Float& last_log) {
  LogDelta out;
  // map to log intensity, as is_usable and with_log_part; unusable light keeps the last one
  out.usable = (luminance > -BLACK) & (dn <= LARGEST);
  const Float below = min(dn * splat(map.slope), splat(map.ln_knee));
  const Float log_now = select(dn >= map.knee, part, below);
  const Float new_log = select(out.usable, log_now, last_log);
  // difference and clamp; the first light only sets L_log
  const Mask known = (last_log <= 0.0f) | (last_log >= 0.0f);
  const Float delta = select(known & inside, new_log - last_log, splat(0.0f));
  out.x = min(max(delta, splat(-LARGEST_X)), splat(LARGEST_X));
  out.nonzero = ~((out.x <= 0.0f) & (out.x >= 0.0f));
  out.unclamped = (out.x <= delta) & (delta <= out.x);
  last_log = new_log;
  last_luminance = select(out.usable, luminance, last_luminance);
  return out;
}

}  // namespace
}  // namespace evs::EVS_NAMESPACE
