// Events: their layout, sorting threshold crossings into events, and checking events from outside.
#pragma once

#include <algorithm>
#include <bit>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <memory>
#include <vector>

#include "sensor/comparator.h"

namespace evs {

// EVENT_DTYPE of msgs/event.py. The last bytes are zero in a packet; before that, the first of them
// holds the cause if labels are on.
struct Event {
  int64_t t;  // us
  int16_t x;
  int16_t y;
  int8_t p;  // 1 ON, 0 OFF
  int8_t cause;
  int8_t zero[2];
};
static_assert(sizeof(Event) == 16 && offsetof(Event, p) == 12);

struct EventBuffer {
  std::unique_ptr<Event[]> events;
  size_t count = 0;
};

inline constexpr uint32_t DIGIT_BITS = 11;
inline constexpr uint32_t DIGITS = 1u << DIGIT_BITS;

inline uint32_t digit(const Crossing& crossing, uint32_t pass) {
  return ((crossing.packed >> TAG_BITS) >> (pass * DIGIT_BITS)) & (DIGITS - 1);
}

// Offset of the first crossing with each digit.
template <class Parts>
std::vector<size_t> digit_offsets(const Parts& parts, uint32_t pass) {
  std::vector<size_t> offsets(DIGITS + 1, 0);
  for (const auto& part : parts) {
    for (const Crossing& crossing : part) offsets[digit(crossing, pass) + 1]++;
  }
  for (uint32_t i = 0; i < DIGITS; i++) offsets[i + 1] += offsets[i];
  return offsets;
}

// Sort threshold crossings into events by time stamp; ties keep their order (pixels row by row,
// then order of crossing). A radix sort with digits of 11 bits: one pass for a tick of up to 2 ms.
// In: parts in pixel order; tick_us < 2^28; `causes`, whether events hold their cause. Out: all
// events, with every byte written.
inline EventBuffer order_events(const std::vector<std::vector<Crossing>>& parts, int64_t t_begin_us,
                                uint32_t tick_us, uint32_t width, bool causes) {
  EventBuffer out;
  for (const auto& part : parts) out.count += part.size();
  if (out.count == 0) return out;
  out.events.reset(new Event[out.count]);
  const uint32_t passes = std::max(1u, (std::bit_width(tick_us) + DIGIT_BITS - 1) / DIGIT_BITS);

  const uint32_t cause_bits = causes ? 7u : 0u;

  // sort by low digits first, each pass stable; the last pass writes the events
  auto last_pass = [&](const auto& from, uint32_t pass) {
    std::vector<size_t> offset = digit_offsets(from, pass);
    for (const auto& part : from) {
      for (const Crossing& crossing : part) {
        out.events[offset[digit(crossing, pass)]++] =
            Event{t_begin_us + (crossing.packed >> TAG_BITS),
                  static_cast<int16_t>(crossing.pixel % width),
                  static_cast<int16_t>(crossing.pixel / width),
                  static_cast<int8_t>(crossing.packed & 1u),
                  static_cast<int8_t>((crossing.packed >> 1) & cause_bits),
                  {0, 0}};
      }
    }
  };
  if (passes == 1) {
    last_pass(parts, 0);
    return out;
  }
  std::vector<std::vector<Crossing>> sorted(1);
  for (uint32_t pass = 0; pass + 1 < passes; pass++) {
    std::vector<Crossing> next(out.count);
    auto scatter = [&](const auto& from) {
      std::vector<size_t> offset = digit_offsets(from, pass);
      for (const auto& part : from) {
        for (const Crossing& crossing : part) next[offset[digit(crossing, pass)]++] = crossing;
      }
    };
    if (pass == 0) {
      scatter(parts);
    } else {
      scatter(sorted);
    }
    sorted[0] = std::move(next);
  }
  last_pass(sorted, passes - 1);
  return out;
}

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
