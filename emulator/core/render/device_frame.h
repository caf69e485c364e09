// The frames of a renderer for a device with memory of its own: everything that they point to, in
// two blocks of memory, one that stays and one that each tick replaces; and of `hybrid` a third
// one, the irradiance cache, which each pass over the pixels replaces.
#pragma once

#include <cstdint>
#include <vector>

#include "base/device_block.h"
#include "render/caster.h"
#include "scene/irradiance.h"

namespace evs {

// The arguments of a device's kernels.
struct DeviceArguments {
  Frame frame;
  Frame first_pass;      // of adaptive antialiasing; else without samples
  PathFrame paths;       // of `path` and `hybrid`
  IrradianceView cache;  // of `hybrid`
};

class DeviceFrame {
 public:
  // Of a caster which must outlive this. Its meshes must not be deformed, nor, with `path` and
  // `hybrid`, its geoms resized.
  explicit DeviceFrame(Caster& caster);

  uint64_t constant_bytes() const { return constant_bytes_; }
  uint64_t tick_bytes() const { return tick_bytes_; }

  // Copy what stays. In: its address on the device. Out: constant_bytes().
  void copy_constant(uint64_t address, char* out) const;
  // Place everything for a tick and copy what it changes. In: the addresses of both blocks. Out:
  // tick_bytes(). Returns where the tick's pixels are traced.
  Caster::Place copy_tick(const Poses& poses, uint64_t constant, uint64_t tick, char* out,
                          DeviceArguments& arguments) const;

  // Of `hybrid`, for a pass over all pixels or over those at edges, after copy_tick: bytes of the
  // cache as it is now; and copy it. In: the addresses of the cache, and of `used`. Out:
  // cache_bytes(); `used`, (nodes) the passes that read each, to which the device adds.
  uint64_t cache_bytes() const;
  void copy_cache(bool edges, uint64_t address, uint64_t used_address, char* out, uint8_t* used,
                  DeviceArguments& arguments) const;
  const Caster& caster() const { return caster_; }
  // After the pass: see HybridIntegrator.
  bool take_from_device(const uint8_t* used, const NodeRequest* missing, size_t count) const {
    return caster_.hybrid()->take_from_device(used, missing, count);
  }
  void take_first_readers(const uint64_t* words) const {
    caster_.hybrid()->take_first_readers(words);
  }
  void trace_here(float* luminance) const { caster_.hybrid()->trace_here(luminance); }

 private:
  DeviceArguments lay_out(DeviceBlock& constant, DeviceBlock& tick) const;
  IrradianceView lay_out_cache(DeviceBlock& block) const;

  Caster& caster_;
  uint64_t constant_bytes_, tick_bytes_;
};

// Render a tick from its arguments, where all that they point to lies in this memory: what a device
// does. Out: luminance (h, w).
void render_device_frame(const Kernel& kernel, const DeviceArguments& arguments, float* luminance);

// Where the light of `hybrid` goes, (h, w) each.
struct DevicePixelLight {
  const float* base;  // of the first pass, in the second one
  float *untextured, *luminance;
};

// What a pass of `hybrid` says of nodes: those that are missing, and from where others are read.
struct DeviceNodes {
  std::vector<NodeRequest> missing;
  std::vector<CellReader> readers;
};

// Trace a pass of `hybrid` in the same way. Out: light, nodes.
void trace_device_pixels(const Kernel& kernel, const DeviceArguments& arguments, bool edges,
                         const DevicePixelLight& light, DeviceNodes& nodes);

}  // namespace evs
