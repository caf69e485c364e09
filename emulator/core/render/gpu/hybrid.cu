// The `hybrid` integrator: a pixel a thread, 8 x 4 pixels a warp; with adaptive antialiasing in two
// passes, as in antialiasing.h. Nodes that the irradiance cache lacks are put in a list: the host
// lights them, and the pass is launched again. Another list says from where nodes are read, in the
// ticks in which the cache asks for that.
#define EVS_ON_DEVICE 1
#define EVS_OUTLINE_IN_PATHS __noinline__
#include "base/gpu/prelude.h"

#include "scene/irradiance.h"

namespace evs {

// What threads say of nodes, in lists that all of them share.
struct NodeLists {
  uint32_t* counts;      // of missing nodes and of readers: more, where there is no more room
  NodeRequest* missing;  // (missing_room)
  CellReader* readers;   // (reader_room)
  uint32_t missing_room, reader_room;
};

// Where a thread asks for nodes, as on the host.
struct NodeRequests {
  const NodeLists& lists;
  bool complete = true;
  CellNodes cell = {{-1, 0, 0, 0, 0, 0}, {}, 0};  // found last
  NodeRequest surplus_request = {};            // what there is no room for
  CellReader surplus_reader = {};

  CellNodes& cell_of(const NodeKey&) { return cell; }
  NodeRequest& next_request() {
    uint32_t at = atomicAdd(lists.counts, 1u);
    return at < lists.missing_room ? lists.missing[at] : surplus_request;
  }
  CellReader& next_reader() {
    uint32_t at = atomicAdd(lists.counts + 1, 1u);
    return at < lists.reader_room ? lists.readers[at] : surplus_reader;
  }
};

}  // namespace evs

#include "render/gpu/image_threads.cuh"
#include "render/integrators/antialiasing_blend.h"
#include "render/integrators/hybrid.inl"
#include "render/irradiance/first_readers.h"

// channels of the frame
#ifndef EVS_CHANNELS
#define EVS_CHANNELS 1
#endif
// whether there are two passes
#ifndef EVS_ADAPTIVE
#define EVS_ADAPTIVE 0
#endif

namespace evs {

// The light of a pixel, averaged over the samples, and what it has without textures.
template <int CHANNELS>
EVS_INLINE void light_of_pixel(const cuda::HybridShading& shading, const Frame& frame, int x, int y,
                               cuda::Float& luminance, cuda::Float& untextured) {
  luminance = untextured = cuda::splat(0.0f);
  cuda::Mask all = cuda::mask_from_bits(cuda::ALL_LANES);
  for (int s = 0; s < frame.samples; s++) {
    cuda::Rays rays =
        cuda::rays_through(frame, cuda::pixel_point(&x, frame.sample_x[s], PACKET_WIDTH),
                           cuda::pixel_point(&y, frame.sample_y[s], PACKET_HEIGHT));
    cuda::Float light[CHANNELS];
    RayCone cone = cuda::camera_cone(frame, rays);
    cuda::radiance<CHANNELS, 0>(shading, frame, rays, cone, all, cuda::splat(0.0f), nullptr, light);
    luminance = luminance + cuda::luminance_of<CHANNELS>(frame, light);
    untextured = untextured + light[CHANNELS - 1];
  }
  float share = 1.0f / static_cast<float>(frame.samples);
  luminance = luminance * share;
  untextured = untextured * share;
}

// Every pixel, and those beyond the image's edge that belong to its packets: they ask for nodes,
// and decide where these lie. In/out: lists. Out: luminance, and untextured where there are two
// passes, (h, w) each.
extern "C" __global__ void __launch_bounds__(128, EVS_BLOCKS)
    hybrid(const __grid_constant__ Frame frame, const __grid_constant__ PathFrame paths,
           const __grid_constant__ IrradianceView cache, const __grid_constant__ NodeLists lists,
           float* luminance, float* untextured) {
  int x, y;
  bool shown = pixel_of_thread(frame, x, y);
  if (x >= (frame.width + PACKET_WIDTH - 1) / PACKET_WIDTH * PACKET_WIDTH) return;
  if (y >= (frame.height + PACKET_HEIGHT - 1) / PACKET_HEIGHT * PACKET_HEIGHT) return;
  NodeRequests requests = {lists};
  cuda::HybridShading shading = {paths, cache, requests};
  cuda::Float light, plain;
  light_of_pixel<EVS_CHANNELS + EVS_ADAPTIVE>(shading, frame, x, y, light, plain);
  if (!shown) return;
  long at = static_cast<long>(y) * frame.width + x;
  luminance[at] = cuda::vignetted(frame, at, light.v);
  if (EVS_ADAPTIVE) untextured[at] = plain.v;
}

#if EVS_ADAPTIVE

// All samples of the pixels at an edge. In: base, untextured (h, w), of the first pass. The rest as
// above.
extern "C" __global__ void __launch_bounds__(128, EVS_BLOCKS)
    hybrid_at_edges(const __grid_constant__ Frame frame, const __grid_constant__ PathFrame paths,
                    const __grid_constant__ IrradianceView cache,
                    const __grid_constant__ NodeLists lists, const float* base,
                    const float* untextured, float* luminance) {
  int x, y;
  if (!pixel_of_thread(frame, x, y)) return;
  long at = static_cast<long>(y) * frame.width + x;
  float weight = weight_of_pixel(frame, x, y, untextured);
  if (!(weight > 0)) {
    luminance[at] = base[at];
    return;
  }
  NodeRequests requests = {lists};
  cuda::HybridShading shading = {paths, cache, requests};
  luminance[at] = blend(base[at], cuda::refined_pixel<EVS_CHANNELS>(shading, frame, x, y), weight);
}

#endif

// Offer word `word` of each reader to the nodes that it reads. In/out: first (nodes, HIT_WORDS).
extern "C" __global__ void __launch_bounds__(128)
    offer_readers(const CellReader* readers, unsigned count, int word, uint64_t* first) {
  unsigned i = blockIdx.x * blockDim.x + threadIdx.x;
  if (i >= count) return;
  offer_word(readers[i], word, first, [](uint64_t* place, uint64_t value) {
    atomicMin(reinterpret_cast<unsigned long long*>(place), value);
  });
}

}  // namespace evs
