#pragma once

#include <cstddef>
#include <cstdint>
#include <cstring>

#include "event_order.h"

namespace evs {

// Whether `bytes`, which need not be aligned, hold `count` valid events: sorted by t in
// (base_us, end_us], on the sensor, with polarity 0 or 1 and zero padding. Does not branch on
// events.
inline bool events_fit(const uint8_t* bytes, size_t count, int64_t base_us, int64_t end_us,
                       int64_t width, int64_t height) {
  if (count == 0) return true;
  int64_t before, last;
  std::memcpy(&before, bytes, sizeof(before));
  std::memcpy(&last, bytes + (count - 1) * sizeof(Event), sizeof(last));
  if (before <= base_us || last > end_us) return false;
  uint64_t bad = 0;
  for (size_t i = 0; i < count; i++) {
    int64_t t;
    uint64_t rest;
    std::memcpy(&t, bytes + i * sizeof(Event), sizeof(t));
    std::memcpy(&rest, bytes + i * sizeof(Event) + sizeof(t), sizeof(rest));
    // read as unsigned, a negative coordinate is too large
    const int64_t x = rest & 0xffff, y = rest >> 16 & 0xffff;
    bad |= uint64_t{t < before} | uint64_t{x >= width} | uint64_t{y >= height} |
           uint64_t{rest >> 32 > 1};
    before = t;
  }
  return bad == 0;
}

}  // namespace evs
