// Luminance to log intensity. A luminance of 1 is white paper in unit light;
// DN = exposure * luminance + dark, where 255 DN is white and nothing is clipped.
#pragma once

#include "base/reproducible_math.h"

namespace evs {

enum class LogKind {
  LINLOG,   // ln DN from the knee on, (ln knee / knee) DN below it
  LOG_EPS,  // ln(DN / 255 + eps)
  LN,       // ln DN: photocurrent and dark current; `dark` is above 0
};

struct LogMap {
  LogKind kind = LogKind::LINLOG;
  float exposure = 255.0f;  // DN per unit of luminance
  float dark = 0.0f;        // DN
  float eps = 0.0f;
  float knee = 0.0f;     // DN, over 1
  float ln_knee = 0.0f;  // ln(knee)
  float slope = 0.0f;    // ln(knee) / knee

  static LogMap linlog(float exposure, float dark, float knee) {
    const float ln_knee = ln(knee);
    return {LogKind::LINLOG, exposure, dark, 0.0f, knee, ln_knee, ln_knee / knee};
  }
  static LogMap log_eps(float exposure, float dark, float eps) {
    return {LogKind::LOG_EPS, exposure, dark, eps, 0.0f, 0.0f, 0.0f};
  }
  static LogMap physical(float exposure, float dark) {
    return {LogKind::LN, exposure, dark, 0.0f, 0.0f, 0.0f, 0.0f};
  }
};

// Values closer to zero than this, of either sign, count as black. So no denormal enters the
// arithmetic, and the result does not depend on whether this thread flushes them.
inline constexpr float BLACK = 0x1p-64f;
inline constexpr float LARGEST = 0x1.fffffep127f;

// DN of a luminance. Unusable luminance gives a negative number, NaN or Inf.
EVS_ALWAYS_INLINE float to_dn(const LogMap& map, float luminance) {
  return flush_to_zero(luminance, BLACK) * map.exposure + map.dark;
}

// False for a luminance that is negative, NaN, Inf, or so large that its DN overflows.
EVS_ALWAYS_INLINE bool is_usable(float luminance, float dn) {
  return (luminance > -BLACK) & (dn <= LARGEST);
}

// The logarithmic branch of the map; meaningless for a DN on the other branch.
template <LogKind KIND>
EVS_ALWAYS_INLINE float log_part(const LogMap& map, float dn) {
  return ln(KIND == LogKind::LOG_EPS ? dn / 255.0f + map.eps : dn);
}

// Log intensity of a DN, given its logarithmic branch. Monotone, also across the knee.
template <LogKind KIND>
EVS_ALWAYS_INLINE float with_log_part(const LogMap& map, float dn, float part) {
  if constexpr (KIND != LogKind::LINLOG) {
    return part;
  } else {
    const float line = map.slope * dn;
    const float below = line < map.ln_knee ? line : map.ln_knee;
    return dn >= map.knee ? part : below;
  }
}

template <LogKind KIND>
EVS_ALWAYS_INLINE float to_log(const LogMap& map, float dn) {
  return with_log_part<KIND>(map, dn, log_part<KIND>(map, dn));
}

// The same for a kind that is known only at run time.
inline float to_log(const LogMap& map, float dn) {
  if (map.kind == LogKind::LINLOG) return to_log<LogKind::LINLOG>(map, dn);
  if (map.kind == LogKind::LOG_EPS) return to_log<LogKind::LOG_EPS>(map, dn);
  return to_log<LogKind::LN>(map, dn);
}

}  // namespace evs
