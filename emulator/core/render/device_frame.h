// The frames of `direct` for a device with memory of its own: everything that they point to, in two
// blocks of memory, one that stays and one that each tick replaces.
#pragma once

#include <cstdint>

#include "caster.h"

namespace evs {

class DeviceFrame {
 public:
  // Of a caster of `direct`, which must outlive this and whose meshes must not be deformed.
  explicit DeviceFrame(Caster& caster);

  uint64_t constant_bytes() const { return constant_bytes_; }
  uint64_t tick_bytes() const { return tick_bytes_; }

  // Copy what stays. In: its address on the device. Out: constant_bytes().
  void copy_constant(uint64_t address, char* out) const;
  // Place everything for a tick and copy what it changes. In: the addresses of both blocks. Out:
  // tick_bytes(); `frame`, and with adaptive antialiasing the frame of its first pass.
  void copy_tick(const Poses& poses, uint64_t constant, uint64_t tick, char* out, Frame& frame,
                 Frame& first_pass) const;

 private:
  class Block;
  void lay_out(Block& constant, Block& tick, Frame& frame, Frame& first_pass) const;

  Caster& caster_;
  uint64_t constant_bytes_, tick_bytes_;
};

// Render a tick from its frames, where all that they point to lies in this memory: what a device
// does. In: `first_pass`, without samples if there is none. Out: luminance (h, w).
void render_device_frame(const Kernel& kernel, const Frame& frame, const Frame& first_pass,
                         float* luminance);

}  // namespace evs
