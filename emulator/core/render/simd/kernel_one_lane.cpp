// The kernel of one lane, for tests (EVS_ISA=one_lane): the code of a thread of a GPU. It renders
// every tick anew, whether incremental or not.
#define EVS_VECTOR_BITS 32
#define EVS_NAMESPACE one_lane
#include "render/simd/one_lane.inl"

namespace evs {
namespace one_lane {
namespace {

// Call pixel(x, y) for the pixels of packet (column, row).
template <class Pixel>
void for_packet(int column, int row, const Pixel& pixel) {
  for (int i = 0; i < PACKET_WIDTH * PACKET_HEIGHT; i++) {
    pixel(column * PACKET_WIDTH + i % PACKET_WIDTH, row * PACKET_HEIGHT + i / PACKET_WIDTH);
  }
}

// The same for those that lie in the image.
template <class Pixel>
void for_image(const Frame& f, int column, int row, const Pixel& pixel) {
  for_packet(column, row, [&](int x, int y) {
    if (x < f.width && y < f.height) pixel(x, y);
  });
}

void packet(const Frame& f, int column, int row, const Outputs& out, const PacketRecord*) {
  for_channels(f, [&]<int CHANNELS>() {
    for_image(f, column, row,
              [&](int x, int y) { trace_pixel<CHANNELS>(DirectShading{}, f, x, y, out); });
  });
}

void pixels(const Frame& f, const int32_t* x, const int32_t* y, int count, float* luminance,
            float* untextured) {
  for (int i = 0; i < count; i++) {
    trace_pixels(f, x + i, y + i, 1, luminance + i, untextured ? untextured + i : nullptr);
  }
}

void weights(const float* const* neighbours, float* weight) {
  for (int i = 0; i < PACKET_WIDTH * PACKET_HEIGHT; i++) {
    const float* near[9];
    for (int k = 0; k < 9; k++) near[k] = neighbours[k] + i;
    refinement_weight(near, weight + i);
  }
}

void truth(const Frame& f, int column, int row, const Truth& out) {
  for_image(f, column, row, [&](int x, int y) { trace_truth_pixel(f, x, y, out); });
}

void path_row(const Frame& f, const PathFrame& p, PathBatch& batch, int row, const Outputs& out) {
  for (int column = 0; column < f.packet_columns; column++) {
    for_image(f, column, row, [&](int x, int y) { trace_path_pixel(f, p, batch, x, y, out); });
  }
}

void path_pixels(const Frame& f, const PathFrame& p, PathBatch& batch, const int32_t* x,
                 const int32_t* y, int count, float* luminance) {
  for (int i = 0; i < count; i++) trace_path_pixels(f, p, batch, x + i, y + i, 1, luminance + i);
}

void geoms(const Frame& f, const PathFrame& p, const int32_t* x, const int32_t* y, int count,
           int32_t* out) {
  for (int i = 0; i < count; i++) first_geoms(f, p, x + i, y + i, 1, out + i);
}

void hybrid_packet(const Frame& f, const PathFrame& p, const IrradianceView& cache,
                   NodeRequests& requests, int column, int row, const Outputs& out, KeptPacket*) {
  // pixels beyond the image's edge, too: they ask for nodes, and decide where these lie
  HybridShading shading = {p, cache, requests};
  for_channels(f, [&]<int CHANNELS>() {
    for_packet(column, row, [&](int x, int y) { trace_pixel<CHANNELS>(shading, f, x, y, out); });
  });
}

}  // namespace
}  // namespace one_lane

// null: what only incremental ticks, pairs of packets and the tests of samplers call
const Kernel KERNEL_ONE_LANE = {one_lane::packet,
                                nullptr,
                                nullptr,
                                nullptr,
                                one_lane::pixels,
                                one_lane::weights,
                                one_lane::refine,
                                one_lane::truth,
                                nullptr,
                                one_lane::path_row,
                                one_lane::path_pixels,
                                one_lane::trace_marked_row,
                                one_lane::geoms,
                                nullptr,
                                one_lane::hybrid_packet,
                                nullptr,
                                nullptr,
                                one_lane::refine_hybrid,
                                one_lane::lamp_points,
                                one_lane::place_mesh_nodes,
                                one_lane::move_hidden_nodes,
                                one_lane::light_nodes,
                                nullptr,
                                nullptr,
                                nullptr,
                                nullptr,
                                nullptr};

}  // namespace evs
