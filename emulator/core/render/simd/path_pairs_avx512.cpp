// The `path` integrator in 32 lanes: what one half waits for is the other's time.
#define EVS_WIDTH 1024
#define EVS_SPACE avx512_path_pairs
#include "incremental/dirty_set.inl"

namespace evs {

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
