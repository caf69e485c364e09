// How long before its stamp each request comes, within a us: see arbiter.h.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "base/isa.h"
#include "sensor/random.h"
#include "sensor/readout_state.h"

namespace evs {

// The phases of requests. Each depends on the seed, pixel and event alone, so they are drawn in
// batches.
class RequestPhases {
 public:
  // Draw the phases of events, in [0, phase_ns]. In: key, from the seed and the term.
  void draw(uint64_t key, int64_t phase_ns, const Event* events, size_t count) {
    const uint64_t phases = static_cast<uint64_t>(phase_ns) + 1;
    ns_.resize(count);
    uint64_t pixels[BATCH], counters[BATCH];
    for (size_t first = 0; first < count; first += BATCH) {
      const size_t batch = std::min(count - first, BATCH);
      for (size_t i = 0; i < batch; i++) {
        const Event& event = events[first + i];
        pixels[i] = pixel_counter(event);
        counters[i] = static_cast<uint64_t>(event.t) << 1 | (event.p ? 1u : 0u);
      }
      draw_(key, phases, pixels, counters, batch, &ns_[first]);
    }
  }

  // The phases that were drawn last, ns.
  const int32_t* ns() const { return ns_.data(); }

  // Free the memory for more than so many.
  void free_beyond(size_t count) {
    if (ns_.capacity() > count) std::vector<int32_t>().swap(ns_);
  }

 private:
  static constexpr size_t BATCH = 64;
  using Draw = void (*)(uint64_t key, uint64_t phases, const uint64_t* pixels,
                        const uint64_t* counters, size_t count, int32_t* out);

  EVS_ALWAYS_INLINE static void draw_batch(uint64_t key, uint64_t phases, const uint64_t* pixels,
                                           const uint64_t* counters, size_t count, int32_t* out) {
    for (size_t i = 0; i < count; i++) {
      // a multiplication and shift: evenly spread over [0, phases)
      const uint64_t bits = hash(hash(key, pixels[i]), counters[i]);
      out[i] = static_cast<int32_t>((bits >> 32) * phases >> 32);
    }
  }
  static void draw_portable(uint64_t key, uint64_t phases, const uint64_t* pixels,
                            const uint64_t* counters, size_t count, int32_t* out) {
    draw_batch(key, phases, pixels, counters, count, out);
  }
#if EVS_X86
  EVS_AVX512 static void draw_avx512(uint64_t key, uint64_t phases, const uint64_t* pixels,
                                     const uint64_t* counters, size_t count, int32_t* out) {
    draw_batch(key, phases, pixels, counters, count, out);
  }
#endif

  static Draw choose() {
#if EVS_X86
    // AVX2 has no 64-bit products
    if (isa_available().front() == "avx512") return draw_avx512;
#endif
    return draw_portable;
  }

  Draw draw_ = choose();
  std::vector<int32_t> ns_;
};

}  // namespace evs
