// Crossings into events: sorted by time, ties in the order in which they come (pixels row by row,
// then order of crossing). A radix sort over 11 bits of the stamp: one pass for a tick of up to 2
// ms.
#pragma once

#include <algorithm>
#include <bit>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <vector>

#include "comparator.h"

namespace evs {

// msgs/event.py's EVENT_DTYPE. The last bytes are zero; only between here and the packet may the
// first of them carry the cause, where somebody asked.
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
  return ((crossing.when >> kWhenBits) >> (pass * kDigitBits)) & (kDigits - 1);
}

// Where each digit's first crossing goes.
template <class Parts>
std::vector<size_t> first_places(const Parts& parts, uint32_t pass) {
  std::vector<size_t> places(kDigits + 1, 0);
  for (const auto& part : parts) {
    for (const Crossing& crossing : part) places[digit(crossing, pass) + 1]++;
  }
  for (uint32_t i = 0; i < kDigits; i++) places[i + 1] += places[i];
  return places;
}

// In: parts in pixel order; ticks of less than 2^28 us; whether events carry their cause. Out: all
// events, every byte written.
inline EventBuffer order_events(const std::vector<std::vector<Crossing>>& parts, int64_t t_begin_us,
                                uint32_t tick_us, uint32_t width, bool causes) {
  EventBuffer out;
  for (const auto& part : parts) out.count += part.size();
  if (out.count == 0) return out;
  out.events.reset(new Event[out.count]);
  const uint32_t passes = std::max(1u, (std::bit_width(tick_us) + kDigitBits - 1) / kDigitBits);

  const uint32_t cause_bits = causes ? 7u : 0u;

  // low digits first, each pass stable; the last one writes the events
  auto last_pass = [&](const auto& from, uint32_t pass) {
    std::vector<size_t> place = first_places(from, pass);
    for (const auto& part : from) {
      for (const Crossing& crossing : part) {
        out.events[place[digit(crossing, pass)]++] =
            Event{t_begin_us + (crossing.when >> kWhenBits),
                  static_cast<int16_t>(crossing.pixel % width),
                  static_cast<int16_t>(crossing.pixel / width),
                  static_cast<int8_t>(crossing.when & 1u),
                  static_cast<int8_t>((crossing.when >> 1) & cause_bits),
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
      std::vector<size_t> place = first_places(from, pass);
      for (const auto& part : from) {
        for (const Crossing& crossing : part) next[place[digit(crossing, pass)]++] = crossing;
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
