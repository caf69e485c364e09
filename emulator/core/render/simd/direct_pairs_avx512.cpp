// The `direct` integrator on two packets at once, in 32 lanes: while one half waits for a result,
// the other half computes.
#define EVS_VECTOR_BITS 1024
#define EVS_NAMESPACE avx512_pairs
#include "render/incremental/relight.inl"
#include "render/integrators/direct.inl"
#include "render/integrators/hybrid.inl"

namespace evs {

void trace_pair_avx512(const Frame& f, int column, int row, const Outputs& out) {
  avx512_pairs::trace(f, column, row, out, nullptr);
}

void relight_pair_avx512(const Frame& f, int column, int row, const Outputs& out,
                         const CachedShading* cache) {
  avx512_pairs::relight(f, column, row, out, cache);
}

void trace_hybrid_pair_avx512(const Frame& f, const PathFrame& p, const IrradianceView& cache,
                              NodeRequests& requests, int column, int row, const Outputs& out) {
  avx512_pairs::trace_hybrid(f, p, cache, requests, column, row, out, nullptr);
}

}  // namespace evs
