// EvSNet, a pixel a thread; then a scan that says where the crossings of each pixel go.
#include "base/gpu/prelude.h"

#include "evsnet/device_pixel.h"

// channels of the network
#ifndef EVS_CHANNELS
#define EVS_CHANNELS 8
#endif

namespace evs {

EVS_INLINE size_t thread_index() {
  return static_cast<size_t>(blockIdx.x) * blockDim.x + threadIdx.x;
}

// Step every pixel by a tick. In: luminance (h, w).
extern "C" __global__ void __launch_bounds__(128)
    step_pixels(const __grid_constant__ DeviceNetwork net, int64_t tick, const float* luminance) {
  cuda::step_pixel<EVS_CHANNELS>(net, tick, luminance, thread_index());
}

// Count what each group of pixels did.
extern "C" __global__ void __launch_bounds__(128)
    sum_groups(const __grid_constant__ DeviceNetwork net) {
  cuda::sum_group(net, thread_index());
}

// Sum the counts of the groups before each, a block for each kind of count.
extern "C" __global__ void __launch_bounds__(SCAN_THREADS)
    scan_groups(const __grid_constant__ DeviceNetwork net) {
  __shared__ ScanSums<uint32_t> sums;
  cuda::scan_groups_of(net, blockIdx.x, sums);
}

// Write the crossings of every pixel. Out: as many as totals[0].
extern "C" __global__ void __launch_bounds__(128)
    write_crossings(const __grid_constant__ DeviceNetwork net, Crossing* crossings) {
  cuda::write_crossings_of(net, crossings, thread_index());
}

// Copy the FIFOs of every pixel from the rows of tiles, or to there.
extern "C" __global__ void __launch_bounds__(128)
    load_rows(const __grid_constant__ DeviceNetwork net, const int32_t* tile_row, float* rows) {
  cuda::copy_fifos<false>(net, tile_row, rows, thread_index());
}
extern "C" __global__ void __launch_bounds__(128)
    store_rows(const __grid_constant__ DeviceNetwork net, const int32_t* tile_row, float* rows) {
  cuda::copy_fifos<true>(net, tile_row, rows, thread_index());
}

}  // namespace evs
