// The frames of `direct` or `path` for a device with memory of its own: everything that they point
// to, in two blocks of memory, one that stays and one that each tick replaces.
#pragma once

#include <cstdint>

#include "caster.h"
#include "device_block.h"

namespace evs {

// The arguments of a device's kernels.
struct DeviceArguments {
  Frame frame;
  Frame first_pass;  // of adaptive antialiasing; else without samples
  PathFrame paths;   // of `path`
};

class DeviceFrame {
 public:
  // Of a caster of `direct` or `path`, which must outlive this. Its meshes must not be deformed,
  // nor, with `path`, its geoms resized.
  explicit DeviceFrame(Caster& caster);

  uint64_t constant_bytes() const { return constant_bytes_; }
  uint64_t tick_bytes() const { return tick_bytes_; }

  // Copy what stays. In: its address on the device. Out: constant_bytes().
  void copy_constant(uint64_t address, char* out) const;
  // Place everything for a tick and copy what it changes. In: the addresses of both blocks. Out:
  // tick_bytes().
  void copy_tick(const Poses& poses, uint64_t constant, uint64_t tick, char* out,
                 DeviceArguments& arguments) const;

 private:
  DeviceArguments lay_out(DeviceBlock& constant, DeviceBlock& tick) const;

  Caster& caster_;
  uint64_t constant_bytes_, tick_bytes_;
};

// Render a tick from its arguments, where all that they point to lies in this memory: what a device
// does. Out: luminance (h, w).
void render_device_frame(const Kernel& kernel, const DeviceArguments& arguments, float* luminance);

}  // namespace evs
