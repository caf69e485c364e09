// What the kernels of a device read of a network, in a block of its memory, and those kernels on
// the CPU.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "base/device_block.h"
#include "evsnet/device_network.h"
#include "evsnet/network_array.h"

namespace evs {

class DeviceConstants {
 public:
  // Of an array, which must outlive this.
  explicit DeviceConstants(const NetworkArray& array);

  uint64_t bytes() const { return bytes_; }
  // Copy them. In: their address on the device. Out: bytes().
  void copy(uint64_t address, char* out) const;
  // The argument of the kernels. In: the address of the constants, and those of the arrays.
  DeviceNetwork argument(uint64_t address, const DeviceNetworkArrays& arrays) const;

 private:
  DeviceNetwork lay_out(DeviceBlock& block) const;

  const NetworkArray& array_;
  std::vector<float> weights_, biases_;
  uint64_t bytes_;
};

// Run a kernel of evsnet/gpu/network.cu, thread after thread, in this memory: what a device does.
// In: where each of its arguments is. Throws std::invalid_argument for another name or number.
void run_network_kernel(const std::string& kernel, size_t blocks, size_t threads,
                        const std::vector<const void*>& arguments);

}  // namespace evs
