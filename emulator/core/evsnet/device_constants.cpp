#include "evsnet/device_constants.h"

#include <algorithm>
#include <cstring>
#include <stdexcept>

#include "evsnet/device_pixel.h"

namespace evs {

// Regroup the filters: the weights of all outputs for an input and a tap lie together.
DeviceConstants::DeviceConstants(const NetworkArray& array) : array_(array) {
  const Network& net = array.settings().network;
  const size_t channels = static_cast<size_t>(net.channels), taps = FIFO_TAPS;
  const size_t stride = static_cast<size_t>(output_stride(net.channels));
  const float* from = net.weights;
  for (size_t k = 0; k < static_cast<size_t>(net.convolutions()); k++) {
    const size_t inputs = k == 0 ? 1 : channels, line = inputs * taps, first = weights_.size();
    weights_.resize(first + line * stride, 0.0f);
    for (size_t o = 0; o < channels; o++) {
      for (size_t i = 0; i < line; i++) weights_[first + i * stride + o] = from[o * line + i];
    }
    from += channels * line;
    biases_.resize((k + 1) * stride, 0.0f);
    std::copy_n(net.biases + k * channels, channels, &biases_[k * stride]);
  }
  DeviceBlock counted(0, nullptr);
  lay_out(counted);
  bytes_ = counted.bytes();
}

void DeviceConstants::copy(uint64_t address, char* out) const {
  DeviceBlock block(address, out);
  lay_out(block);
}

DeviceNetwork DeviceConstants::argument(uint64_t address, const DeviceNetworkArrays& arrays) const {
  DeviceBlock block(address, nullptr);
  DeviceNetwork device = lay_out(block);
  device.arrays = arrays;
  return device;
}

DeviceNetwork DeviceConstants::lay_out(DeviceBlock& block) const {
  const NetworkSettings& settings = array_.settings();
  DeviceNetwork device;
  device.network = settings.network;
  Network& net = device.network;
  net.weights = block.put(weights_.data(), weights_.size());
  net.biases = block.put(biases_.data(), biases_.size());
  net.delays = block.put(net.delays, static_cast<size_t>(net.blocks));
  net.pointwise = block.put(net.pointwise, static_cast<size_t>(net.channels));
  device.bilif = settings.bilif;
  device.bilif.decay_low = block.put(device.bilif.decay_low, DECAY_LOW);
  device.bilif.decay_high = block.put(device.bilif.decay_high, DECAY_HIGH);
  device.map = settings.map;
  device.unusable_from = array_.unusable_from();
  device.dense = settings.dense ? 1 : 0;
  device.width = array_.width();
  device.height = array_.height();
  device.tick_us = static_cast<double>(settings.tick_us);
  return device;
}

namespace {

// The arguments of a kernel, one after another.
class Arguments {
 public:
  Arguments(const std::vector<const void*>& at, size_t count) : at_(at) {
    if (at.size() != count) throw std::invalid_argument("the kernel has other arguments");
  }
  template <class T>
  T take() {
    T value;
    std::memcpy(&value, at_[taken_++], sizeof value);
    return value;
  }

 private:
  const std::vector<const void*>& at_;
  size_t taken_ = 0;
};

}  // namespace

void run_network_kernel(const std::string& kernel, size_t blocks, size_t threads,
                        const std::vector<const void*>& arguments) {
  const bool copies = kernel == "load_rows" || kernel == "store_rows";
  const bool scans = kernel == "scan_groups";
  const size_t count = copies || kernel == "step_pixels" ? 3 : kernel == "write_crossings" ? 2 : 1;
  Arguments given(arguments, count);
  const DeviceNetwork net = given.take<DeviceNetwork>();
  auto for_threads = [&](auto run) {
    for (size_t i = 0; i < blocks * threads; i++) run(i);
  };
  if (kernel == "step_pixels") {
    const int64_t tick = given.take<int64_t>();
    const float* luminance = given.take<const float*>();
    for_threads([&](size_t i) { network_device::step_pixel<0>(net, tick, luminance, i); });
  } else if (kernel == "sum_groups") {
    for_threads([&](size_t i) { network_device::sum_group(net, i); });
  } else if (scans) {
    if (threads != SCAN_THREADS) throw std::invalid_argument("a scan has 1024 threads");
    ScanSums<uint32_t> sums;
    for (size_t kind = 0; kind < blocks; kind++) network_device::scan_groups_of(net, kind, sums);
  } else if (kernel == "write_crossings") {
    Crossing* crossings = given.take<Crossing*>();
    for_threads([&](size_t i) { network_device::write_crossings_of(net, crossings, i); });
  } else if (copies) {
    const int32_t* tile_row = given.take<const int32_t*>();
    float* rows = given.take<float*>();
    for_threads([&](size_t i) {
      if (kernel == "load_rows") {
        network_device::copy_fifos<false>(net, tile_row, rows, i);
      } else {
        network_device::copy_fifos<true>(net, tile_row, rows, i);
      }
    });
  } else {
    throw std::invalid_argument("no kernel of EvSNet is called '" + kernel + "'");
  }
}

}  // namespace evs
