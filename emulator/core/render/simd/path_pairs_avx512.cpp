// The `path` integrator in 32 lanes: while one half waits for a result, the other half computes.
#define EVS_VECTOR_BITS 1024
#define EVS_NAMESPACE avx512_path_pairs
#include "render/incremental/dirty_set.inl"
#include "render/irradiance/node_light.inl"

namespace evs {

void trace_path_row_avx512(const Frame& f, const PathFrame& p, PathBatch& batch, int row,
                           const Outputs& out) {
  avx512_path_pairs::trace_path_row(f, p, batch, row, out);
}

void trace_path_pixels_avx512(const Frame& f, const PathFrame& p, PathBatch& batch,
                              const int32_t* x, const int32_t* y, int count, float* luminance) {
  avx512_path_pairs::trace_path_pixels(f, p, batch, x, y, count, luminance);
}

long trace_marked_row_avx512(const Frame& f, const PathFrame& p, PathBatch& batch, int row,
                             const uint32_t* marked, const Outputs& out) {
  return avx512_path_pairs::trace_marked_row(f, p, batch, row, marked, out);
}

void first_geoms_avx512(const Frame& f, const PathFrame& p, const int32_t* x, const int32_t* y,
                        int count, int32_t* geoms) {
  avx512_path_pairs::first_geoms(f, p, x, y, count, geoms);
}

long update_cached_paths_avx512(const Frame& f, const PathFrame& p, PathBatch& batch,
                                const PathCacheView& cache, int begin, int end,
                                const Outputs& out) {
  return avx512_path_pairs::update_cached_paths(f, p, batch, cache, begin, end, out);
}

void lamp_points_avx512(const Frame& f, const PathFrame& p, int emitter, const float* x,
                        const float* y, LampPoint* points) {
  avx512_path_pairs::lamp_points(f, p, emitter, x, y, points);
}

void place_mesh_nodes_avx512(const Frame& f, const NodeArray& nodes, int begin, int end) {
  avx512_path_pairs::place_mesh_nodes(f, nodes, begin, end);
}

void move_hidden_nodes_avx512(const Frame& f, const NodeArray& nodes) {
  avx512_path_pairs::move_hidden_nodes(f, nodes);
}

void light_nodes_avx512(const Frame& f, const PathFrame& p, PathBatch& batch,
                        const NodeArray& nodes, int first, int count, float* sums) {
  avx512_path_pairs::light_nodes(f, p, batch, nodes, first, count, sums);
}

}  // namespace evs
