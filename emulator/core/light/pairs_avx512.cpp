// Two packets of the `direct` integrator at once, in 32 lanes: what one waits for is the other's
// time.
#include <immintrin.h>

#include "scene.h"

// GCC's own AVX-512 headers set it off (PR 105593)
#pragma GCC diagnostic ignored "-Wmaybe-uninitialized"
#pragma GCC diagnostic ignored "-Wuninitialized"

#define EVS_INLINE [[gnu::always_inline]] inline
#define EVS_WIDTH 1024

namespace evs {
namespace avx512_pairs {
namespace {
#include "direct.inc"
#include "relight.h"
}  // namespace
}  // namespace avx512_pairs

void trace_pair_avx512(const Frame& f, int column, int row, const Outputs& out) {
  avx512_pairs::trace(f, column, row, out, nullptr);
}

void relight_pair_avx512(const Frame& f, int column, int row, const Outputs& out,
                         const KeptPatch* kept) {
  avx512_pairs::relight(f, column, row, out, kept);
}

}  // namespace evs
