// What the tests of the path integrator's samplers read: 16 draws at once, in plain structures.
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
  float direction[3][PROBE_LANES];   // unit
  float value[3][PROBE_LANES];       // weight of a BSDF sample; f cos; or radiance
  float pdf[PROBE_LANES];            // per sr
  float pdf_evaluated[PROBE_LANES];  // the pdf that the other technique evaluates for the direction
  int specular[PROBE_LANES], alive[PROBE_LANES];
};

}  // namespace evs
