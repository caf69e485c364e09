// The kernel of one lane, for tests (EVS_ISA=one_lane): the code of a thread of a GPU. It renders
// every tick anew, whether incremental or not.
#define EVS_VECTOR_BITS 32
#define EVS_NAMESPACE one_lane
#include "render/integrators/antialiasing.inl"
#include "render/integrators/direct.inl"
#include "render/integrators/ground_truth.inl"
#include "render/integrators/hybrid.inl"
#include "render/integrators/wavefront.inl"
#include "render/irradiance/node_light.inl"

namespace evs {
namespace one_lane {
namespace {

// The ray through a point of a pixel, rounded as in its packet.
EVS_INLINE Rays pixel_ray(const Frame& f, int x, int y, float sub_x, float sub_y) {
  return rays_through(f, pixel_point(&x, sub_x, PACKET_WIDTH),
                      pixel_point(&y, sub_y, PACKET_HEIGHT));
}

// Write the light of a pixel, averaged over the samples, if it lies in the image.
template <int CHANNELS>
void write_pixel(const Frame& f, int x, int y, Float luminance, const Float* light,
                 const Outputs& out) {
  if (x >= f.width || y >= f.height) return;
  long at = static_cast<long>(y) * f.width + x;
  out.luminance[at] = vignetted(f, at, lane(luminance, 0));
  for (int c = 0; c < 3 && CHANNELS >= 3 && out.rgb; c++) {
    out.rgb[3 * at + c] = vignetted(f, at, lane(light[f.colour + c], 0));
  }
  if (out.untextured) {
    out.untextured[(y + 1) * out.untextured_stride + (x + 1)] = lane(light[CHANNELS - 1], 0);
  }
}

// trace_packet of one pixel.
template <int CHANNELS, class Shading>
void trace_pixel(const Shading& shading, const Frame& f, int x, int y, const Outputs& out) {
  Float sum = splat(0.0f), sums[CHANNELS];
  for (int c = 0; c < CHANNELS; c++) sums[c] = sum;
  Mask all = mask_from_bits(ALL_LANES);
  for (int s = 0; s < f.samples; s++) {
    Rays rays = pixel_ray(f, x, y, f.sample_x[s], f.sample_y[s]);
    RayCone cone = camera_cone(f, rays);
    Float light[CHANNELS];
    radiance<CHANNELS, 0>(shading, f, rays, cone, all, splat(0.0f), nullptr, light);
    sum = sum + luminance_of<CHANNELS>(f, light);
    for (int c = 0; c < CHANNELS; c++) sums[c] = sums[c] + light[c];
  }
  float share = 1.0f / static_cast<float>(f.samples);
  for (int c = 0; c < CHANNELS; c++) sums[c] = sums[c] * share;
  write_pixel<CHANNELS>(f, x, y, sum * share, sums, out);
}

void trace_path_pixel(const Frame& f, const PathFrame& p, PathBatch& batch, int x, int y,
                      const Outputs& out) {
  auto place = [&](int, Int& column, Int& row) -> const RayCone* {
    column = splat(x);
    row = splat(y);
    return nullptr;
  };
  trace_packets(f, p, batch, 1, out.geoms, place, [&](int, const Float* mean, Int geom) {
    Outputs light = {out.luminance, out.rgb, nullptr, 0, nullptr};
    write_pixel<3>(f, x, y, luminance_of<3>(f, mean), mean, light);
    if (out.geoms) out.geoms[static_cast<long>(y) * f.width + x] = lane(geom, 0);
  });
}

void trace_truth_pixel(const Frame& f, int x, int y, const Truth& out) {
  Rays rays = pixel_ray(f, x, y, 0.5f, 0.5f);
  Mask all = mask_from_bits(ALL_LANES);
  RayCone cone = ray_cone(rays.origin, rays.direction, all, T_INFINITY);
  write_truth(f, rays, intersect(f, rays, cone, all, from(near_distance(f, rays.direction))), x, y,
              1, 1, out);
}

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
