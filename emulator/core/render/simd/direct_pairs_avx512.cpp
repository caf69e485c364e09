// Two packets of the `direct` integrator at once, in 32 lanes: what one waits for is the other's
// time.
#define EVS_WIDTH 1024
#define EVS_SPACE avx512_pairs
#include "incremental/relight.inl"
#include "integrators/direct_pixels.inl"

namespace evs {

void trace_pair_avx512(const Frame& f, int column, int row, const Outputs& out) {
  avx512_pairs::trace(f, column, row, out, nullptr);
}

void relight_pair_avx512(const Frame& f, int column, int row, const Outputs& out,
                         const KeptPatch* kept) {
  avx512_pairs::relight(f, column, row, out, kept);
}

}  // namespace evs
