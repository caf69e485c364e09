// Sort threshold crossings into events by time stamp; ties keep their order (pixels row by row,
// then order of crossing). A radix sort with digits of 11 bits: one pass for a tick of up to 2 ms.
#pragma once

#include <algorithm>
#include <bit>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <vector>

#include "comparator.h"

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

inline constexpr uint32_t kDigitBits = 11;
inline constexpr uint32_t kDigits = 1u << kDigitBits;

inline uint32_t digit(const Crossing& crossing, uint32_t pass) {
  return ((crossing.packed >> kTagBits) >> (pass * kDigitBits)) & (kDigits - 1);
}

// Offset of the first crossing with each digit.
template <class Parts>
std::vector<size_t> digit_offsets(const Parts& parts, uint32_t pass) {
  std::vector<size_t> offsets(kDigits + 1, 0);
  for (const auto& part : parts) {
    for (const Crossing& crossing : part) offsets[digit(crossing, pass) + 1]++;
  }
  for (uint32_t i = 0; i < kDigits; i++) offsets[i + 1] += offsets[i];
  return offsets;
}

// In: parts in pixel order; tick_us < 2^28; `causes`, whether events hold their cause. Out: all
// events, with every byte written.
inline EventBuffer order_events(const std::vector<std::vector<Crossing>>& parts, int64_t t_begin_us,
                                uint32_t tick_us, uint32_t width, bool causes) {
  EventBuffer out;
  for (const auto& part : parts) out.count += part.size();
  if (out.count == 0) return out;
  out.events.reset(new Event[out.count]);
  const uint32_t passes = std::max(1u, (std::bit_width(tick_us) + kDigitBits - 1) / kDigitBits);

  const uint32_t cause_bits = causes ? 7u : 0u;

  // sort by low digits first, each pass stable; the last pass writes the events
  auto last_pass = [&](const auto& from, uint32_t pass) {
    std::vector<size_t> offset = digit_offsets(from, pass);
    for (const auto& part : from) {
      for (const Crossing& crossing : part) {
        out.events[offset[digit(crossing, pass)]++] =
            Event{t_begin_us + (crossing.packed >> kTagBits),
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

}  // namespace evs
