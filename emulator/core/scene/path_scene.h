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

// A ball (half 0) or capsule around a geom that moves, camera frame.
struct Rod {
  V3 center, axis;  // axis: unit
  float half, radius;
  float solid;   // radius up to which the geom fills it, 0: no geom is sure to
  uint32_t bit;  // that stands for the geom
};

// Of a unit that is one sample and ends with its second ray its rays are kept too: when its gap is
// used up, they are asked for a new one before anything is traced. In words: the first point; how
// far it is, below 0: no rays are kept; direction and limit of each ray that leaves it, limit 0:
// there is none, below 0: it was barred.
constexpr int FAN_RAYS = 3, FAN_WORDS = 4 + 4 * FAN_RAYS;

constexpr int MOST_SINGLE = 32;  // samples a pixel that are kept one by one

// What is kept of every unit of a pixel's samples while the camera stands: its light, and how far
// everything may move until one of its rays could meet something else. A unit is one sample, or a
// block of them whose light is added up before it joins the sum.
struct KeptLight {
  const Rod* rods;  // around everything that has ever moved
  int rod_count;
  float reach;  // no gap is looked for that is larger
  int columns;  // of a row of units: the image's, rounded up to 32
  int units;    // a pixel
  int size;     // samples a unit, but for the last
  // (height, units, columns) each
  float* light[3];
  // of a unit that is one sample: what its first point got from all but MuJoCo's lights, and what
  // was seen from there; below 0: no more is known. Null: units are larger
  float* rest[6];
  // of each unit's first point, while lamps move: its distance, FAR for none, below 0 where nothing
  // is known; the colour of a texture there; and (height, units, columns / LANES) the geom that all
  // points side by side lie on, or as in kept_points.h. Null: nothing is kept of it
  float *away, *albedo[3];
  int32_t* seen;
  // a ball around those points: center, radius; and whether no light but steady ones shone on them
  float* ball[4];
  uint8_t* unlit;
  float* until;       // to this much motion in all: before `travelled` is there, nothing changes
  uint32_t* touched;  // bits of the rods that its rays met: what happens when one moves is unknown
  float* fans;        // (height, units, columns, FAN_WORDS) or null
  // (height, units, columns / LANES) of units side by side: before this much motion none is due,
  // unless one of these rods moves; and those that are in this tick: to be traced, or to be asked
  float* soonest;
  uint32_t *met, *due, *doubtful;
  uint8_t* changed;  // (packet rows, columns / LANES) image rows of as many pixels that changed
  float travelled;   // by the fastest of them, in all
  uint32_t moved;    // bits of the rods that moved since the last tick
  const int32_t* moving;  // (geoms) not 0: it moved since the last tick
  uint32_t steady;        // the first lights, one bit each: as ever, and without a shadow
  bool stirred;           // fewer are than in the last tick
  bool relit;  // MuJoCo's lights are asked anew in every unit, and `until` does not cover that
  bool all;    // every unit is to be traced
};

// Samples that are traced together: the paths that go on are gathered into full packets behind each
// bounce. A margin of one packet, which also keeps the arrays apart in the caches.
struct PathBatch {
  static constexpr int ROOM = 2048, MARGIN = 32, WORDS = 20;
  alignas(64) float light[3][ROOM + MARGIN];
  float away[ROOM + MARGIN];          // of the first surface
  float direction[3][ROOM + MARGIN];  // towards it; where there is haze
  float gap[ROOM + MARGIN];           // as in Clearance, and
  int32_t touched[ROOM + MARGIN];
  float rest[6][ROOM + MARGIN];  // as in KeptLight
  int32_t seen[ROOM + MARGIN];   // geom of the first surface
  float fans[FAN_WORDS][ROOM + MARGIN];
  int32_t owner[ROOM + MARGIN];       // places in KeptLight, a lane's for each packet of units
  float paths[WORDS][ROOM + MARGIN];  // those under way
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
  float dome[3];    // radiance of the uniform sky that stands for the ambient part of the
                    // directional lights
  float sky_share;  // probability of aiming at the sky instead of an emitter
  SkyTable sky;
  const Emitter* emitters;
  int emitter_count;
  const int* emitter_of_geom;  // -1: found by chance only
};

}  // namespace evs
