// What the tests of the path integrator's samplers see: 16 draws at once. Plain structures.
#pragma once

namespace evs {

constexpr int PROBE_LANES = 16;

// A surface with its normal along z.
struct ProbeSurface {
  float albedo[3], f0[3];
  float metallic, alpha, mirror;
  float eye[3];  // unit, towards the eye
};

struct ProbeLanes {
  float direction[3][PROBE_LANES];  // unit
  float light[3][PROBE_LANES];      // throughput; f times cosine; or radiance
  float density[PROBE_LANES];       // per sr
  float again[PROBE_LANES];         // the density that a ray along the direction is told
  int mirrored[PROBE_LANES], alive[PROBE_LANES];
};

}  // namespace evs
