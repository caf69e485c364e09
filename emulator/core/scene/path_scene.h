// What the `path` kernels read besides a Frame: lights that can be aimed at, and how samples are
// drawn. Plain structures, as in scene.h.
#pragma once

#include "scene.h"

namespace evs {

enum SampleSet {
  SAMPLES_SOBOL = 0,
  SAMPLES_OWEN,
  SAMPLES_GLOBAL,
  SAMPLES_RANDOM,
  SAMPLES_ANCHORED
};

// A glowing geom; its share of the choice between all of them is end - begin.
struct Emitter {
  int geom;
  float begin, end;
  float area;               // m^2; of an ellipsoid 4 pi, the sphere it is stretched from
  const float* cumulative;  // of a mesh: share of the triangles up to and with each, by area
  int triangles;
};

// The sky's cube map in side x side cells a face, as a choice of rows and of a cell in each.
struct SkyTable {
  int side;              // 0: no sky that can be aimed at
  const float* rows;     // (6 side) cumulative
  const float* cells;    // (6 side, side) cumulative in each row
  const float* density;  // (6 side, side) probability per sr where the cube's face is nearest
  // where to begin to look in `rows`, and in each row of `cells`, for a number of each of as many
  // equal parts of 0 ... 1: never behind the place
  const int32_t *row_guide, *cell_guide;
};

struct PathFrame {
  int bounces;
  int sample_set;
  int seed;    // of this tick
  int digits;  // 2^digits samples or fewer
  bool transparent;
  bool glowing;     // a geom has light of its own
  bool open;        // what meets nothing meets light
  int lamp_count;   // lights but for images
  float dome[3];    // radiance of the uniform sky that stands for the lights' ambient part
  float sky_share;  // probability of aiming at the sky instead of an emitter
  SkyTable sky;
  const Emitter* emitters;
  int emitter_count;
  const int* emitter_of_geom;  // -1: found by chance only
};

}  // namespace evs
