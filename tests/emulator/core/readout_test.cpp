// The readout at ordinary and at extreme settings, on storms of events: every lost event is
// counted, stamps are sorted and in their tick, and any division into ticks gives the same events.

#include <cstring>
#include <limits>
#include <random>
#include <vector>

#include "sensor/readout.h"
#include "tests/emulator/core/selftest.h"

namespace evs {
namespace {

constexpr int WIDTH = 70, HEIGHT = 67;

ReadoutSettings any_settings(std::mt19937& random, bool extreme) {
  auto pick = [&](auto... values) {
    const int64_t all[] = {static_cast<int64_t>(values)...};
    return all[random() % (sizeof(all) / sizeof(all[0]))];
  };
  ReadoutSettings settings;
  settings.width = WIDTH;
  settings.height = HEIGHT;
  settings.latency_us = static_cast<double>(extreme ? 1'000'000 : pick(0, 7, 900));
  settings.latency_sigma_us = static_cast<double>(extreme ? 1'000'000 : pick(0, 0, 50));
  settings.order = static_cast<ReadoutOrder>(random() % 3);
  settings.arbiter = extreme ? ArbiterTimes{1'000'000'000, 1'000'000'000, 1e9, 999}
                             : ArbiterTimes{pick(0, 500, 20'000), pick(0, 83, 900),
                                            static_cast<double>(pick(0, 300)), pick(0, 999)};
  const int64_t scan_ns = 1000 * (extreme ? 1'000'000 : pick(1, 130, 2500));
  settings.scan = ScanTimes{scan_ns, random() % 3 ? scan_ns / WIDTH : 0, random() % 2 == 0,
                            extreme ? pick(1, 1'000'000) : pick(1, 1, 3),
                            extreme ? pick(1, int64_t{1} << 31) : pick(0, 1, 100)};
  settings.rate =
      RateControl{extreme ? pick(1, 8'000'000'000) : pick(0, 3, 40),
                  extreme ? 1'000'000 : pick(1, 100, 333), static_cast<ErcDrop>(random() % 3)};
  settings.link = Link{extreme ? pick(1, 8'000'000'000) : pick(0, 20'000, 1'000'003),
                       extreme ? pick(1, int64_t{1} << 31) : pick(1, 17, 5000), random() % 2 == 0};
  if (random() % 2) {
    for (int i = 0; i < WIDTH * HEIGHT; i++) {
      settings.fates.push_back(i % 5 ? KEPT : static_cast<uint8_t>(i % 2));
    }
  }
  return settings;
}

std::vector<Event> storm(std::mt19937& random, int64_t begin_us, int64_t end_us) {
  std::vector<Event> events(random() % 700);
  for (Event& event : events) {
    const auto span = static_cast<uint64_t>(end_us - begin_us);
    event = Event{};
    event.t = begin_us + 1 + static_cast<int64_t>(random() % span);
    event.x = static_cast<int16_t>(random() % WIDTH);
    event.y = static_cast<int16_t>(random() % 4 ? random() % 3 : random() % HEIGHT);
    event.p = static_cast<int8_t>(random() % 2);
  }
  std::sort(events.begin(), events.end(), [](auto& a, auto& b) { return a.t < b.t; });
  return events;
}

// A readout and its state, stepped through a stream.
struct Run {
  Readout readout;
  ReadoutClock clock = {};
  std::vector<Request> waiting;
  std::vector<Event> all;
  size_t came = 0;

  Run(const ReadoutSettings& settings, uint64_t seed) : readout(settings) {
    clock[CLOCK_SEED] = static_cast<int64_t>(seed);
    clock[FREE_NS] = clock[NEXT_SCAN] = std::numeric_limits<int64_t>::min();
    clock[LAST_ROW] = clock[ACCESS_ROW] = -1;
  }

  void step(const std::vector<Event>& events, int64_t begin_us, int64_t end_us) {
    EventBuffer out;
    readout.step(events.data(), events.size(), clock, waiting, begin_us, end_us, out);
    int64_t last = begin_us + 1;
    for (size_t i = 0; i < out.count; i++) {
      const int64_t t_us = out.events[i].t;
      check(t_us >= last && t_us <= end_us, "stamps are sorted and in their tick");
      last = t_us;
    }
    all.insert(all.end(), out.events.get(), out.events.get() + out.count);
    came += events.size();
    int64_t dropped = 0;
    for (size_t cause = DROP_ROI; cause <= DROP_FIFO; cause++) dropped += clock[cause];
    check(came == all.size() + waiting.size() + static_cast<size_t>(dropped),
          "every event is output, waits or is counted");
  }
};

}  // namespace

void readouts_lose_nothing_uncounted() {
  std::mt19937 random(11);
  constexpr int64_t LATEST = int64_t{1} << 52;
  for (int turn = 0; turn < 300; turn++) {
    const bool extreme = turn % 3 == 0;
    const ReadoutSettings settings = any_settings(random, extreme);
    const uint64_t seed = uint64_t{random()} << 32 | random();
    Run fine(settings, seed), coarse(settings, seed);
    const int64_t step_us = extreme ? 1'000'000 : 500;
    const int64_t begins[] = {0, -LATEST, LATEST - 8 * step_us, -3 * step_us};
    const int64_t begin_us = begins[turn % 4];
    std::vector<Event> whole;
    for (int64_t k = 0; k < 8; k++) {
      const int64_t at_us = begin_us + k * step_us;
      const std::vector<Event> events = storm(random, at_us, at_us + step_us);
      whole.insert(whole.end(), events.begin(), events.end());
      fine.step(events, at_us, at_us + step_us);
    }
    coarse.step(whole, begin_us, begin_us + 8 * step_us);
    check(fine.all.size() == coarse.all.size() &&
              (fine.all.empty() || std::memcmp(fine.all.data(), coarse.all.data(),
                                               fine.all.size() * sizeof(Event)) == 0) &&
              std::memcmp(fine.clock, coarse.clock, sizeof(fine.clock)) == 0,
          "any division into ticks gives the same events and the same state");
  }
}

void row_access_times_are_drawn_exactly() {
  const uint64_t key = term_key(11, TERM_ARBITER);
  // the wider the jitter, the more of the batch is drawn again: a fifth at 1e6 ns, all at 1e9
  for (const double jitter_ns : {0.3, 10.0, 1e4, 1e6, 3e6, 1e9}) {
    const ArbiterTimes times{4'000'000, 0, jitter_ns, 0};
    RowAccessTimes drawn;
    // numbers near 0, whose error is larger, are rare
    const int64_t count = jitter_ns == 1e6 ? 3'000'000 : 20'000;
    for (int64_t access = 0; access < count; access++) {
      const double ns = 4e6 + jitter_ns * normal(key, static_cast<uint64_t>(access) << 1);
      check(drawn.duration_ns(times, key, access) == round_ns(ns),
            "a batch has the durations of single draws");
    }
  }
}

}  // namespace evs
