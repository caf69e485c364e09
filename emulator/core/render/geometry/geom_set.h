// A set of geoms that can be read in ascending order. Making one is cheap: words are cleared on
// first use.
#pragma once

#include "base/simd_target.h"
#include "scene/scene.h"

namespace evs {

struct GeomSet {
  static constexpr int WORDS = GeomBvh::MAX_GEOMS / 64;
  uint64_t used[WORDS / 64];  // words that have members
  uint64_t words[WORDS];

  EVS_INLINE GeomSet() : used{} {}

  EVS_INLINE void add(int geom) {
    int word = geom / 64;
    uint64_t bit = uint64_t{1} << word % 64, member = uint64_t{1} << geom % 64;
    words[word] = used[word / 64] & bit ? words[word] | member : member;
    used[word / 64] |= bit;
  }
  // Call visit(geom) for each, until it returns true.
  template <class Visit>
  EVS_INLINE void visit(Visit visit) const {
    for (int i = 0; i < WORDS / 64; i++) {
      for (uint64_t left = used[i]; left; left &= left - 1) {
        int word = i * 64 + __builtin_ctzll(left);
        for (uint64_t members = words[word]; members; members &= members - 1) {
          if (visit(word * 64 + __builtin_ctzll(members))) return;
        }
      }
    }
  }
};

// The walk of `geom_bvh_traversal.inl` in 16 lanes, for kernels in 32.
void find_geoms_avx512(const GeomBvh&, const RayCone&, GeomSet&);

}  // namespace evs
