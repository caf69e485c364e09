// The `path` integrator in 32 lanes: what one half waits for is the other's time.
#include <immintrin.h>

#include "path_scene.h"
#include "scene.h"

// GCC's own AVX-512 headers set it off (PR 105593)
#pragma GCC diagnostic ignored "-Wmaybe-uninitialized"
#pragma GCC diagnostic ignored "-Wuninitialized"

#define EVS_INLINE [[gnu::always_inline]] inline
#define EVS_WIDTH 1024

namespace evs {
namespace avx512_path_pairs {
namespace {
#include "direct.inc"
#include "paths.inc"
}  // namespace
}  // namespace avx512_path_pairs

void trace_path_row_avx512(const Frame& f, const PathFrame& p, PathBatch& batch, int row,
                           const Outputs& out) {
  avx512_path_pairs::trace_path_row(f, p, batch, row, out);
}

void trace_path_pixels_avx512(const Frame& f, const PathFrame& p, PathBatch& batch,
                              const int32_t* x, const int32_t* y, int count, float* luminance) {
  avx512_path_pairs::trace_path_pixels(f, p, batch, x, y, count, luminance);
}

long retrace_paths_avx512(const Frame& f, const PathFrame& p, PathBatch& batch,
                          const KeptLight& kept, int begin, int end, const Outputs& out) {
  return avx512_path_pairs::retrace_paths(f, p, batch, kept, begin, end, out);
}

}  // namespace evs
