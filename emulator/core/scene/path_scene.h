// What the `path` kernels read besides a Frame: emitters, the sampler's settings, and the path
// cache. Plain structures, as in scene.h.
#pragma once

#include "scene/scene.h"

namespace evs {

enum SampleSet {
  SAMPLES_SOBOL = 0,
  SAMPLES_OWEN,
  SAMPLES_GLOBAL,
  SAMPLES_RANDOM,
  SAMPLES_ANCHORED
};

// An emissive geom. Its selection probability is end - begin.
struct Emitter {
  int geom;
  float begin, end;
  float area;               // m^2; of an ellipsoid 4 pi, that of the sphere it is stretched from
  const float* cumulative;  // CDF of a mesh's triangles, by area
  int triangles;
  bool uniform;  // its radiance is the same everywhere
  int axis;      // 0 ... 2: of a uniform one that is the same however it turns about it; -1: none
};

// The environment as a piecewise constant distribution: side x side cells per cube face, as a
// marginal distribution of rows and a conditional one of cells.
struct EnvironmentDistribution {
  int side;            // 0: no environment to sample
  const float* rows;   // (6 side) CDF
  const float* cells;  // (6 side, side) CDF of each row
  const float* pdf;    // (6 side, side) per sr at the face's centre
  // guide tables of `rows`, and of each row of `cells`: where a search starts, never too late
  const int32_t *row_guide, *cell_guide;
};

// The bounding capsule (or sphere: half is 0) of a moving geom, camera frame.
struct BoundingCapsule {
  V3 center, axis;  // axis: unit
  float half, radius;
  float solid;   // radius up to which the geom certainly fills it; 0: none
  uint32_t bit;  // that stands for the geom
};

// Recorded rays of a unit of one sample that ends with its second ray; when its gap is used up they
// are rechecked before anything is traced. In words: the first hit; its distance, below 0: no rays
// recorded; direction and t_max of each secondary ray, t_max 0: none, below 0: it was occluded.
constexpr int SECONDARY_RAYS = 3, SECONDARY_RAY_WORDS = 4 + 4 * SECONDARY_RAYS;

constexpr int MAX_SINGLE_UNITS = 32;  // samples a pixel that are cached one by one

// The path cache: for every unit of a pixel's samples, its light and the motion until which one of
// its rays cannot touch anything new. A unit is one sample, or a block of samples whose light is
// summed before it joins the pixel's sum.
struct PathCacheView {
  const BoundingCapsule* capsules;  // around everything that has ever moved
  int capsule_count;
  float max_gap;  // no larger gap is measured
  int columns;    // of a row of units: the image's, rounded up to 32
  int units;      // per pixel
  int size;       // samples per unit, except the last
  // (height, units, columns) each
  float* light[3];
  // for units of one sample: the light of the first hit without MuJoCo's lights, and that of the
  // second hit; below 0: the path continued. Null: units are larger
  float* indirect[6];
  // while lights change, the first hit of each unit: distance, T_INFINITY for a miss, below 0 where
  // not known; albedo of a texture; and (height, units, columns / LANES) the geom of adjacent hits,
  // or a constant of cached_hits.inl. Null: not cached
  float *hit_distance, *albedo[3];
  int32_t* hit_geom;
  // bounding sphere of those hits: center, radius; and whether only steady lights reach them
  float* sphere[4];
  uint8_t* only_steady_light;
  float* valid_until;     // nothing changes before `motion` reaches this
  uint32_t* touched;      // bits of the capsules that its rays touched: dirty when one moves
  float* secondary_rays;  // (height, units, columns, SECONDARY_RAY_WORDS) or null
  // (height, units, columns) the geom of the first hits, as Outputs::geoms has it; or null
  int32_t* first_geom;
  // (height, columns / 32) one bit per pixel: those that are cached, and those of the last tick.
  // Null: all
  const uint32_t* marked;
  uint32_t* known;
  // (height, units, columns / LANES), for adjacent units: none expires before this motion, unless
  // one of these capsules moves; and the units that are dirty or expired in this tick
  float* next_expiry;
  uint32_t *touched_any, *dirty, *expired;
  uint8_t* changed;       // (packet rows, columns / LANES) image rows that changed, one bit each
  float motion;           // of the fastest geom, summed over the ticks
  uint32_t moved;         // bits of the capsules that moved since the last tick
  const int32_t* moving;  // (geoms) not 0: moved since the last tick
  uint32_t steady;        // the first lights, one bit each: unchanged, and without a shadow
  bool fewer_steady;      // than in the last tick
  bool relight_lamps;     // MuJoCo's lights are evaluated in every tick, outside `valid_until`
  bool trace_all;         // every unit is dirty
};

// Samples of a batch; fewer where each of many threads has a batch of its own.
#ifndef EVS_BATCH_ROOM
#define EVS_BATCH_ROOM 2048
#endif

// Samples that are traced together; after each bounce the paths that continue are compacted into
// full packets. The margin of one packet also keeps the arrays in different cache sets.
struct PathBatch {
  static constexpr int ROOM = EVS_BATCH_ROOM, MARGIN = ROOM < 32 ? ROOM : 32, WORDS = 20;
  alignas(64) float light[3][ROOM + MARGIN];
  float hit_distance[ROOM + MARGIN];  // of the first hit
  float direction[3][ROOM + MARGIN];  // of the camera ray; where there is haze
  float gap[ROOM + MARGIN];           // as in Clearance, and
  int32_t touched[ROOM + MARGIN];
  float indirect[6][ROOM + MARGIN];   // as in PathCacheView
  int32_t hit_geom[ROOM + MARGIN];    // geom of the first hit, where lights change
  int32_t first_geom[ROOM + MARGIN];  // geom of the first hit, -1 none
  float secondary_rays[SECONDARY_RAY_WORDS][ROOM + MARGIN];
  int32_t owner[ROOM + MARGIN];  // entries in PathCacheView, one per lane of each packet of units
  float paths[WORDS][ROOM + MARGIN];  // the queue
};

struct PathFrame {
  int bounces;
  int sample_set;
  int first_sample;  // of the point set
  int lobe_samples;  // between which the first vertex divides the lobes of a surface
  int seed;          // of this tick
  int log2_samples;  // at most 2^log2_samples samples
  int block;         // of the point set that these samples are
  int log2_blocks;   // the point set has at most 2^log2_blocks blocks
  bool quarters;     // the first quarter of a block's samples is used alone, too
  bool transparent;
  const int* transparent_geoms;  // where shadow rays look for these apart from opaque ones; or null
  int transparent_count;
  bool emits;                     // a geom emits light
  bool emissive;                  // ... or paths look for such geoms all the same
  bool has_environment;           // rays that miss may see light
  int lamp_count;                 // lights except image lights
  float ambient_radiance[3];      // uniform environment: the ambient part of the directional lights
  float environment_probability;  // of sampling it instead of an emitter
  EnvironmentDistribution environment;
  const Emitter* emitters;
  const float* world;  // camera to world, where directions must not turn with the camera; or null
  int emitter_count;
  const int* emitter_of_geom;  // -1: found by BSDF sampling only
};

}  // namespace evs
