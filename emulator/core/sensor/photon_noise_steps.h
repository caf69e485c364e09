// The steps of pixels with photon noise, side by side: NoisyComparators says what each does next.
// A step is a chain of divisions, roots and tables, which loops over pixels overlap. They have no
// branches, so that compilers vectorise them.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "sensor/photon_noise_comparator.h"

namespace evs {

// ROOM: for how many pixels.
template <size_t ROOM>
struct NoisySteps {
  // In: a pixel each
  alignas(64) double now[ROOM];
  alignas(64) double end[ROOM];
  alignas(64) double tick[ROOM];
  alignas(64) double decay[ROOM];
  alignas(64) double sigma[ROOM];
  alignas(64) double slow[ROOM];
  alignas(64) double shift[ROOM];
  alignas(64) double memory[ROOM];
  alignas(64) double mean[ROOM];
  alignas(64) double signal[ROOM];
  alignas(64) double reference[ROOM];
  alignas(64) double theta[2][ROOM];
  alignas(64) double from[ROOM];
  alignas(64) double moves[ROOM];  // what Response has of a line, and of the poles
  alignas(64) double slope[ROOM];
  alignas(64) double first[ROOM];
  alignas(64) double second[ROOM];
  alignas(64) float k[ROOM];
  alignas(64) float z[ROOM];
  alignas(64) double settling[ROOM];
  alignas(64) uint64_t bends[ROOM];
  // Out: NoiseStep
  alignas(64) double memory1[ROOM];
  alignas(64) double mean1[ROOM];
  alignas(64) double signal1[ROOM];
  alignas(64) double passages[ROOM];
  alignas(64) double x0[2][ROOM];
  alignas(64) double x1[2][ROOM];
  alignas(64) double random[2][ROOM];
  alignas(64) double moving[2][ROOM];
  // Of pixels that reach a level, In: which one, which nears the mean of the noise, and how much
  // of its hazard is used
  alignas(64) uint64_t up[ROOM];
  alignas(64) double used[ROOM];
  // Out: where the level is then, deviations; whether the noise reached it, not the way of the
  // level; and after which share of the step
  alignas(64) double place[ROOM];
  alignas(64) uint64_t by_noise[ROOM];
  alignas(64) double share[ROOM];
  // Of pixels with an event, In: as NoisyComparators has it
  alignas(64) double over[ROOM];
  alignas(64) uint64_t samples[ROOM];
  alignas(64) uint64_t key[ROOM];
  alignas(64) uint64_t normal_counter[ROOM];
  alignas(64) uint64_t budget_counter[ROOM];
  // Out: what it leaves; `mean`, `memory`, `signal` and `reference` are overwritten
  alignas(64) double budget[ROOM];
  // scratch
  NoisyComparators* places[ROOM];
  NoisyComparators* events[ROOM];
  alignas(64) uint64_t searching[ROOM];
  alignas(64) double lost[ROOM];      // loss where the level comes from
  alignas(64) double distance[ROOM];  // of the signal, to the place
  alignas(64) uint64_t bent[ROOM];    // ShareSearch finds the share
  alignas(64) double drift[ROOM];     // of the mean of the noise, in a tick
  alignas(64) double begin[ROOM];     // shares of the tick
  alignas(64) double reached[ROOM];
  alignas(64) double low[ROOM];
  alignas(64) double high[ROOM];
  alignas(64) double level[ROOM];  // by what the signal has moved there

  // Step pixels until at most so many have steps left; done(pixel) receives the others. Out: how
  // many are left, which come first.
  template <class Done>
  EVS_ALWAYS_INLINE size_t advance(NoisyComparators** pixels, size_t count, size_t at_most,
                                   std::vector<Crossing>& out, const Done& done) {
    while (count > at_most) {
      size_t unknown = 0;
      for (size_t i = 0; i < count; i++) {
        if (!pixels[i]->has_step) put(unknown++, *pixels[i]);
      }
      compute(unknown);
      unknown = 0;
      size_t left = 0;
      size_t found = 0;
      size_t fired = 0;
      auto sort_in = [&](NoisyComparators* p, NoisyComparators::Next next) {
        if (next == NoisyComparators::Next::PLACE) {
          places[found++] = p;
        } else if (next == NoisyComparators::Next::EVENT) {
          events[fired++] = p;
        } else if (next == NoisyComparators::Next::STEP) {
          pixels[left++] = p;
        } else {
          done(p);
        }
      };
      for (size_t i = 0; i < count; i++) {
        NoisyComparators* p = pixels[i];
        if (!p->has_step) p->step = get(unknown++);
        sort_in(p, p->take_step(out));
      }
      for (size_t i = 0; i < found; i++) put_place(i, *places[i]);
      find_places(found);
      find_shares(found);
      for (size_t i = 0; i < found; i++) {
        sort_in(places[i], places[i]->arrive(share[i], by_noise[i] != 0, out));
      }
      for (size_t i = 0; i < fired; i++) put_event(i, *events[i]);
      recover(fired);
      for (size_t i = 0; i < fired; i++) {
        get_event(i, *events[i]);
        sort_in(events[i], events[i]->go_on_after_event());
      }
      count = left;
    }
    return count;
  }

 private:
  EVS_ALWAYS_INLINE void put(size_t i, const NoisyComparators& p) {
    const Response& response = p.pixel.response;
    now[i] = p.now;
    end[i] = p.end;
    tick[i] = p.pixel.tick;
    decay[i] = p.band.decay;
    sigma[i] = p.band.sigma;
    slow[i] = p.band.slow;
    shift[i] = p.band.shift;
    memory[i] = p.memory;
    mean[i] = p.mean;
    signal[i] = p.signal;
    reference[i] = p.reference;
    theta[0][i] = p.pixel.theta_on;
    theta[1][i] = p.pixel.theta_off;
    from[i] = p.pixel.from;
    moves[i] = response.end;
    slope[i] = response.slope;
    first[i] = response.first;
    second[i] = response.second;
    k[i] = response.k;
    z[i] = response.z;
    settling[i] = response.settling;
    bends[i] = response.bends ? 1 : 0;
  }

  EVS_ALWAYS_INLINE NoiseStep get(size_t i) const {
    auto level = [&](size_t which) {
      return NoiseLevel{x0[which][i], x1[which][i], random[which][i], moving[which][i]};
    };
    return {memory1[i], mean1[i], signal1[i], passages[i], level(0), level(1)};
  }

  // In: a pixel with an event in the step that it has.
  EVS_ALWAYS_INLINE void put_place(size_t i, const NoisyComparators& p) {
    put(i, p);
    memory1[i] = p.step.memory1;
    mean1[i] = p.step.mean1;
    signal1[i] = p.step.signal1;
    passages[i] = p.step.passages;
    x0[0][i] = p.level().x0;
    x1[0][i] = p.level().x1;
    moving[0][i] = p.level().moving;
    up[i] = p.up ? 1 : 0;
    used[i] = p.used;
  }

  // In: a pixel that has just fired.
  EVS_ALWAYS_INLINE void put_event(size_t i, const NoisyComparators& p) {
    put(i, p);
    over[i] = p.over;
    samples[i] = p.samples ? 1 : 0;
    key[i] = p.draws.key;
    normal_counter[i] = p.normal_counter;
    budget_counter[i] = p.budget_counter;
  }

  EVS_ALWAYS_INLINE void get_event(size_t i, NoisyComparators& p) const {
    p.signal = signal[i];
    p.reference = reference[i];
    p.mean = mean[i];
    p.memory = memory[i];
    if (!p.is_blind) p.budget = budget[i];
  }

  EVS_ALWAYS_INLINE double signal_at(size_t i, double us) const {
    const double u = us / tick[i];
    const double bent = response_of(i, 0.0).template bent<false>(u);
    return from[i] + select((bends[i] != 0) & (u < 1.0), bent, moves[i] * u);
  }

  // What pixels come to by the end of their steps.
  EVS_ALWAYS_INLINE void compute(size_t count) {
    for (size_t i = 0; i < count; i++) signal1[i] = signal_at(i, end[i]);
    for (size_t i = 0; i < count; i++) {
      const double dt = end[i] - now[i];
      const NoiseMemory left = forget({memory[i], mean[i]}, decay[i], dt);
      memory1[i] = left.memory;
      mean1[i] = left.mean;
      passages[i] = slow[i] * dt / (1.0 - left.memory * left.memory + 0x1p-40);
    }
    for (size_t i = 0; i < count; i++) {
      const double scale0 = 1.0 / (sigma[i] * unknown_share(memory[i]) + 1e-12);
      const double scale1 = 1.0 / (sigma[i] * unknown_share(memory1[i]) + 1e-12);
      const double farthest = farthest_level(memory[i]);
      const double above0 = (signal[i] - reference[i]) + mean[i];
      const double above1 = (signal1[i] - reference[i]) + mean1[i];
      x0[0][i] = in_deviations((theta[0][i] - above0) * scale0, farthest);
      x1[0][i] = in_deviations((theta[0][i] - above1) * scale1, farthest);
      x0[1][i] = in_deviations((theta[1][i] + above0) * scale0, farthest);
      x1[1][i] = in_deviations((theta[1][i] + above1) * scale1, farthest);
    }
    for (size_t which = 0; which < 2; which++) {
      for (size_t i = 0; i < count; i++) {
        const double from = x0[which][i];
        const double to = x1[which][i];
        const double near = select(from < to, from, to);
        const double way = select(from < to, to - from, from - to);
        const bool is_near = near < FAR_LEVEL;
        const double passed = PASSAGE_TABLE.loss_at(to) - PASSAGE_TABLE.loss_at(from);
        const double moved = select(to < from, passed, 0.0);
        const double within = select(near > NEAREST, near, NEAREST);
        const double mean = mean_over_way(within, PASSAGE_TABLE.slope_at(within), way);
        const double rate = passages[i] * (PASSAGE_TABLE.rate_near(shift[i], within) * mean);
        random[which][i] = select(is_near, rate, 0.0);
        moving[which][i] = select(is_near, select(to < PASSED, CERTAIN, moved), 0.0);
      }
    }
  }

  // Find where on its way a level that nears the mean has used up a part of its hazard, which up to
  // x1 is at least that.
  EVS_ALWAYS_INLINE void find_places(size_t count) {
    for (size_t i = 0; i < count; i++) lost[i] = PASSAGE_TABLE.loss_at(x0[0][i]);
    for (size_t i = 0; i < count; i++) {
      place[i] = x1[0][i];
      if (moving[0][i] > used[i]) {
        place[i] = std::max(place[i], PASSAGE_TABLE.level_of_loss(lost[i] + used[i]));
      }
      by_noise[i] = 0;
      searching[i] = 1;
    }
    for (int n = 0; n < 4; n++) {
      uint64_t any = 0;
      for (size_t i = 0; i < count; i++) {
        const double from = x0[0][i];
        const double to = x1[0][i];
        const double at = place[i];
        const double within = select(at > NEAREST, at, NEAREST);
        const double gone = from - at;
        const double falls = PASSAGE_TABLE.slope_at(within);
        const double passing =
            passages[i] / (from - to) * PASSAGE_TABLE.rate_near(shift[i], within);
        const double by_random = passing * gone * mean_over_way(within, falls, gone);
        const bool goes_on = (searching[i] != 0) & !(by_random < 0.01 * used[i]);
        // from behind the place, the nearer of two estimates: for a hazard that is exponential in
        // x, and for one that is constant
        const double all = by_random + PASSAGE_TABLE.loss_at(at) - lost[i];
        const double exponential =
            gone - 2.0 * all * (all - used[i]) / ((all + used[i]) * (passing + falls));
        const double constant = gone * (used[i] / all);
        const bool nearer = (all > used[i]) & (exponential < constant);
        const double next = from - select(nearer, constant, exponential);
        const double farthest = select(from > FAR_LEVEL, double{FAR_LEVEL}, from);
        const double inside = select(next < to, to, select(farthest < next, farthest, next));
        place[i] = select(goes_on, inside, at);
        by_noise[i] = goes_on ? (passing > falls ? 1 : 0) : by_noise[i];
        searching[i] = (goes_on & !(all < 2.0 * used[i])) ? 1 : 0;
        any |= searching[i];
      }
      if (any == 0) break;
    }
  }

  // Find after which share of the step a level has come there. The noise fires at any time of the
  // step, the way of the level when it has come there.
  EVS_ALWAYS_INLINE void find_shares(size_t count) {
    uint64_t any = 0;
    for (size_t i = 0; i < count; i++) {
      const bool is_on = up[i] != 0;
      const double above0 = (signal[i] - reference[i]) + mean[i];
      const double above1 = (signal1[i] - reference[i]) + mean1[i];
      const double distance0 = select(is_on, theta[0][i] - above0, theta[1][i] + above0);
      const double nearer = select(is_on, above1 - above0, above0 - above1);
      const double line = (x0[0][i] - place[i]) / (x0[0][i] - x1[0][i]);
      double at = line;
      for (int n = 0; n < 2; n++) {
        const double known = memory[i] + (memory1[i] - memory[i]) * at;
        distance[i] = distance0 - place[i] * sigma[i] * unknown_share(known);
        at = share_of_all(distance[i] / nearer);
      }
      const bool nears = nearer > 0.0;
      share[i] = select(nears, at, line);
      bent[i] = (nears & (by_noise[i] == 0) & (bends[i] != 0)) ? 1 : 0;
      any |= bent[i];
    }
    if (any != 0) find_bent_shares(count);
  }

  // The same where the signal bends in the step.
  EVS_ALWAYS_INLINE void find_bent_shares(size_t count) {
    for (size_t i = 0; i < count; i++) {
      // the mean of the noise drifts, too
      drift[i] = (mean1[i] - mean[i]) / ((end[i] - now[i]) / tick[i]);
      begin[i] = now[i] / tick[i];
      const double moved = (signal[i] - from[i]) + ((moves[i] + drift[i]) - moves[i]) * begin[i];
      level[i] = select(up[i] != 0, moved + distance[i], moved - distance[i]);
      const ShareSearch search = ShareSearch::start<false>(response_of(i, drift[i]), level[i],
                                                           up[i] != 0, begin[i], moved);
      reached[i] = search.u;
      low[i] = search.low;
      high[i] = search.high;
      searching[i] = search.found ? 0 : bent[i];
    }
    for (int n = 0; n < ShareSearch::MOST; n++) {
      uint64_t any = 0;
      for (size_t i = 0; i < count; i++) {
        ShareSearch search = {reached[i], low[i], high[i], false};
        search.step<false>(response_of(i, drift[i]), level[i], up[i] != 0, tick[i],
                           n < ShareSearch::HALLEY);
        const bool goes_on = searching[i] != 0;
        reached[i] = select(goes_on, search.u, reached[i]);
        low[i] = select(goes_on, search.low, low[i]);
        high[i] = select(goes_on, search.high, high[i]);
        searching[i] = search.found ? 0 : searching[i];
        any |= searching[i];
      }
      if (any == 0) break;
    }
    for (size_t i = 0; i < count; i++) {
      const double part = (end[i] - now[i]) / tick[i];
      const double at = share_of_all((reached[i] - begin[i]) / part);
      share[i] = select(bent[i] != 0, at, share[i]);
    }
  }

  // What events leave: the noise is known, and sampled again after the refractory period.
  EVS_ALWAYS_INLINE void recover(size_t count) {
    for (size_t i = 0; i < count; i++) {
      signal[i] = signal_at(i, now[i]);
      signal1[i] = signal_at(i, over[i]);
    }
    for (size_t i = 0; i < count; i++) {
      budget[i] = NoiseDraws::budget_of(hash(key[i], budget_counter[i]));
      random[0][i] = NoiseDraws::normal_of(hash(key[i], normal_counter[i]));
    }
    for (size_t i = 0; i < count; i++) {
      const double level = reference[i];
      const NoiseMemory left = forget({1.0, level - signal[i]}, decay[i], over[i] - now[i]);
      const double value = left.mean + sigma[i] * unknown_share(left.memory) * random[0][i];
      const bool sampled = samples[i] != 0;
      reference[i] = select(sampled, on_grid(signal1[i] + value), level);
      mean[i] = select(sampled, value, left.mean);
      memory[i] = select(sampled, 1.0, left.memory);
      signal[i] = select(sampled, signal1[i], signal[i]);
    }
  }

  EVS_ALWAYS_INLINE static double share_of_all(double x) {
    const double most = select(1.0 < x, 1.0, x);
    return select(x < 0.0, 0.0, most);
  }

  // What Response has of a pixel, with another drift.
  EVS_ALWAYS_INLINE Response response_of(size_t i, double more) const {
    return {moves[i] + more, slope[i] + more, first[i], second[i], k[i], z[i], settling[i], true};
  }
};

}  // namespace evs
