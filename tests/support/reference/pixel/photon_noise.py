"""Photon noise: core/sensor/photon_noise.h, photon_noise_block.h and photon_noise_comparator.h.

What a whole frame needs is NumPy in float32, what single pixels need Python's floats.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import cache
from typing import TypeVar

import numpy as np

from evs.emulator.base.scene import F32, F64
from evs.emulator.sensor.fixed_pattern import FixedPattern
from evs.emulator.sensor.parameters import SensorParameters
from evs.emulator.sensor.pixel import PlainState
from evs.emulator.sensor.random import Term
from evs.emulator.sensor.reference.filters import (
    SETTLED,
    at_most,
    bandwidth,
    one_minus_exp,
    share_of_tick,
)
from evs.emulator.sensor.reference.light import natural_log
from evs.emulator.sensor.reference.passage import (
    FAR,
    Band,
    loss_slope,
    one_pole_rate,
    passage_loss,
    polynomial,
    shifted_level,
)
from evs.msgs import Cause
from reference.pixel.comparators import PixelEvent, PixelTick
from reference.pixel.noise import ROW_READ, hash_bits, leak, on_grid, uniform

PASSED, NEAREST, CERTAIN = -7.0, -3.0, 30.0
FORGOTTEN, KNOWN = 2.0**-10, 0.1
LEAST_BUDGET = 2.0**-46
SHORT_STEP, LONG_STEP, FORGETS, STRAIGHT_PART = 0.25, 20.0, 7.0, 0.1
COARSE_PARTS = 50.0
CELLS = 512

_SINE = "-0x1.1e752p+6 0x1.45a272p+6 -0x1.4ab6cep+5 0x1.921fa2p+2"
_f = np.float32


def on_budget_grid(value: float) -> float:
    """The nearest multiple of 2^-46, for |value| < 32."""
    return (value + 96.0) - 96.0


def budget_left(budget: float, hazard: float) -> float:
    """What is left of a budget that lasts for a hazard."""
    left = budget - on_budget_grid(hazard)
    return left if left > 0.0 else LEAST_BUDGET


Real = TypeVar("Real", F32, float)


def mean_over_way(x: Real, slope: Real, length: Real) -> Real:
    """Mean over a straight way from x of a hazard that is 1 there."""
    fall = x + slope
    straight = fall * length
    bent = (1 - slope * fall) * length * length
    d = 3 + straight
    n = straight * d + bent
    square = n * n
    part = d * (12 * d + 3 * n) + 0.5 * square
    mean: Real = d * part / ((d + 0.5 * n) * part + square * (d + 0.25 * n))
    return mean


@cache
def _tables() -> tuple[list[float], list[float], list[float]]:
    x = np.arange(CELLS + 1, dtype=np.float32) * _f(16.0 / CELLS) - _f(8)
    within = np.clip(x, _f(-3), _f(7))
    return one_pole_rate(within).tolist(), loss_slope(within).tolist(), passage_loss(x).tolist()


def _read(table: list[float], x: float) -> float:
    place = (x + 8.0) * (CELLS / 16.0)
    cell = min(int(place), CELLS - 1)
    return table[cell] + (place - cell) * (table[cell + 1] - table[cell])


def rate_at(shift: float, x: float) -> float:
    """Rate of first passages at a level, in units of the slower pole, of one pixel."""
    if not x < FAR:
        return 0.0
    level = x + shift / (1.0 + 0.23 * max(x, 0.0) * shift)
    return _read(_tables()[0], level) if level < FAR else 0.0


def slope_at(x: float) -> float:
    """As loss_slope, of one pixel."""
    return _read(_tables()[1], x)


def loss_at(x: float) -> float:
    """As passage_loss, of one pixel."""
    return _read(_tables()[2], x) if x < FAR else 0.0


def level_of_loss(value: float) -> float:
    """Deviations at which the loss has a value."""
    table, low, high = _tables()[2], 0, CELLS
    while high - low > 1:
        half = (low + high) // 2
        if table[half] > value:
            low = half
        else:
            high = half
    part = (table[low] - value) / (table[low] - table[high])
    return (low + part) * (16.0 / CELLS) - 8.0


def deviations(x: float, farthest: float = 8.0) -> float:
    """Limited on both sides."""
    return max(-8.0, min(farthest, x))


def farthest_level(memory: float) -> float:
    """Where a level comes from, at most, deviations."""
    return 8.0 if memory > 0.0 else 1e4


def unknown_share(memory: float) -> float:
    """The deviation of noise that is known so far, over sigma."""
    return math.sqrt((1.0 - memory) * (1.0 + memory))


class Draws:
    """The random numbers of a pixel, by the times of its events."""

    def __init__(self, seed: int, pixel: int) -> None:
        key = hash_bits(seed % 2**64, Term.PHOTON_NOISE + 1)
        self.key, self.last_us, self.repeat = hash_bits(key, pixel + 1), -1, 0

    def _counter(self, us: int) -> int:
        return us << 8 | (self.repeat << 2 if us == self.last_us else 0)

    def renew(self, us: int) -> float:
        """The budget after an event at this time."""
        self.repeat = min(self.repeat + 1, 63) if us == self.last_us else 0
        self.last_us = us
        drawn = on_budget_grid(_minus_ln(hash_bits(self.key, self._counter(us))))
        return drawn if drawn > 0.0 else LEAST_BUDGET

    def normal(self, us: int) -> float:
        """A standard normal number."""
        bits = hash_bits(self.key, self._counter(us) + 1)
        half = bits & 0xFFFFFFFF
        turn = _f(half - 2**32 if half >= 2**31 else half) * _f(2.0**-32)
        up = _f(0.25) - abs(turn)
        sine = polynomial(_SINE, np.array([up * up], np.float32))[0] * up
        return float(np.sqrt(_f(2) * _f(_minus_ln(bits))) * sine)

    def polarity(self, us: int) -> float:
        """A number in [0, 1)."""
        return uniform(hash_bits(self.key, self._counter(us) + 2))


def _minus_ln(bits: int) -> float:
    uniform_number = np.array([(bits >> 40) + 1]).astype(np.float32) * _f(2.0**-24)
    return max(-float(natural_log(uniform_number)[0]), 0.0)


def first_noise(
    sensor: SensorParameters, state: PlainState, i: int, dn: float, us: int, on: float
) -> tuple[float, float]:
    """At the first light of pixel i with this ON threshold; into the state.

    Returns:
        The noise, which is known, and the share of the leak's phase that is left.
    """
    draws = Draws(state.seed, i)
    sigma = Band.at(sensor, dn).sigma
    noise = sigma * draws.normal(us)
    _store(state, i, draws.renew(us), noise, 1.0)
    return noise, max(0.0, 1.0 - 4.0 * sigma / on)


def _store(state: PlainState, i: int, budget: float, mean: float, memory: float) -> None:
    assert state.noise_budget is not None
    assert state.noise_mean is not None
    assert state.noise_memory is not None
    state.noise_budget.flat[i] = budget
    state.noise_mean.flat[i] = mean
    state.noise_memory.flat[i] = memory


@dataclass(frozen=True)
class Level:
    """A level in a step of time: deviations at its start and end, and its hazards."""

    x0: float
    x1: float
    random: float = 0.0
    moving: float = 0.0

    @property
    def hazard(self) -> float:
        """Of noise and movement."""
        return self.random + self.moving


@dataclass(frozen=True)
class Step:
    """A step of time of one pixel."""

    memory1: float
    mean1: float
    passages: float
    on: Level
    off: Level


@dataclass(frozen=True)
class Budgets:
    """What a tick makes of the budgets of all pixels."""

    left: np.ndarray
    """(h, w) bool, pixels whose budget does not last"""
    tick_us: int
    poles: tuple[F32, F32, F32, F32]
    """decay and slower pole, as z, shift, and 1 / sigma^2"""
    step: tuple[F32, F32, F32]
    """memory and mean at the end, and passages"""
    on: tuple[F32, F32, F32, F32]
    """as the fields of Level"""
    off: tuple[F32, F32, F32, F32]

    def band(self, i: int) -> Band:
        """Of pixel i."""
        decay, slow, shift, precision = (of.flat[i] for of in self.poles)
        us = float(self.tick_us)
        sigma = 1.0 / float(np.sqrt(precision))
        return Band(sigma, float(decay) / us, float(slow) / us, float(shift))

    def whole(self, i: int) -> Step:
        """The step of pixel i over the whole tick."""
        on, off = (Level(*(float(of.flat[i]) for of in level)) for level in (self.on, self.off))
        memory1, mean1, passages = (float(of.flat[i]) for of in self.step)
        return Step(memory1, mean1, passages, on, off)


def _level_hazard(x0: F32, x1: F32, shift: F32, passages: F32) -> tuple[F32, F32]:
    x = np.where(x0 < x1, x0, x1)
    fallen = np.where(x1 < x0, x0 - x1, _f(0))
    risen = np.where(x1 < x0, _f(0), x1 - x0)
    above = np.where(x > -3, x, _f(-3))
    within = np.where(above < 7, above, _f(7))
    slope = loss_slope(within)
    mean = mean_over_way(within, slope, fallen + risen)
    level = shifted_level(shift, within)
    rate = one_pole_rate(np.where(level < 7, level, _f(7)))
    moving = np.where(x < FAR, slope * fallen * mean, _f(0))
    random = np.where(x < FAR, passages * rate * mean, _f(0))
    return random, np.where(x1 < PASSED, _f(CERTAIN), moving)


def use_up_budgets(
    sensor: SensorParameters,
    pattern: FixedPattern,
    state: PlainState,
    dn: F32,
    signal: tuple[F32, F32],
    drift: F64,
    tick_us: int,
    candidates: np.ndarray,
) -> Budgets:
    """Step the pixels whose budget lasts through a tick."""
    assert state.noise_budget is not None
    assert state.noise_mean is not None
    assert state.noise_memory is not None
    start, end = signal
    z, follower_z = bandwidth(sensor, dn, tick_us), share_of_tick(sensor.follower_hz, tick_us)
    with np.errstate(all="ignore"):
        if sensor.cutoff_hz and sensor.follower_hz:
            slow, fast = np.minimum(z, follower_z), np.maximum(z, follower_z)
            decay = z * follower_z / (z + follower_z)
            shift = _f(1.43) * np.sqrt(slow / (fast + _f(0.39) * slow))
        else:
            decay = slow = z if sensor.cutoff_hz else np.full_like(dn, follower_z)
            shift = np.zeros_like(dn)
        scale = _f(sensor.photon_scale_us / tick_us)
        precision = dn / (scale * decay + _f(1e-24))
        kept = _f(1) - one_minus_exp(at_most(decay, SETTLED))
        memory0 = state.noise_memory
        left = memory0 * kept
        memory1 = np.where(left < FORGOTTEN, _f(0), left)
        mean1 = np.where(left < FORGOTTEN, _f(0), state.noise_mean * kept)
        unknown0 = (_f(1) - memory0) * (_f(1) + memory0) + _f(2.0**-24)
        unknown1 = _f(1) / ((_f(1) - memory1) * (_f(1) + memory1) + _f(2.0**-24))
        passages = (slow * unknown1).astype(np.float32)
        inverse = np.sqrt(precision / unknown0), np.sqrt(precision * unknown1)
        farthest = np.where(memory0 > 0, _f(8), _f(1e4))
        relaxes = (memory0 > kept) & (decay > _f(0.1))
        above = [
            (start.astype(np.float64) - state.reference).astype(np.float32) + state.noise_mean,
            (end.astype(np.float64) - (state.reference - drift)).astype(np.float32) + mean1,
        ]
        on = [_clip((pattern.on - a) * by, farthest) for a, by in zip(above, inverse, strict=True)]
        off = [
            _clip((pattern.off + a) * by, farthest) for a, by in zip(above, inverse, strict=True)
        ]
        on_hazard = _level_hazard(on[0], on[1], shift, passages)
        off_hazard = _level_hazard(off[0], off[1], shift, passages)
        random = on_hazard[0] + off_hazard[0]
        hazard = random + (on_hazard[1] + off_hazard[1])
    budget = state.noise_budget
    still = (memory0 == 0) & (start == end) & (sensor.highpass_hz == 0.0)
    least = np.maximum(hazard, np.where(relaxes, random * _f(COARSE_PARTS), _f(0)))
    lasts = (least < budget) & ~np.isnan(state.reference) & ~still & ~candidates
    used = np.where(lasts, hazard.astype(np.float64), 0.0)
    left = budget - ((used + 96.0) - 96.0)
    state.noise_budget = np.where(lasts & (left <= 0.0), LEAST_BUDGET, left)
    state.noise_memory = np.where(lasts, memory1, memory0)
    state.noise_mean = np.where(lasts, mean1, state.noise_mean)
    return Budgets(
        ~lasts,
        tick_us,
        (decay, slow, shift, precision),
        (memory1, mean1, passages),
        (on[0], on[1], *on_hazard),
        (off[0], off[1], *off_hazard),
    )


def _clip(x: F32, farthest: F32) -> F32:
    below = np.where(x < farthest, x, farthest)
    return np.where(below > -8, below, _f(-8))


@dataclass
class NoisyPixel:
    """The comparators of one pixel with noise through one tick."""

    p: PixelTick
    band: Band
    whole: Step | None
    """the step over the whole tick; None: there is none"""
    draws: Draws
    leak: float
    """log units per us"""
    still: bool
    """the signal stands still, and only the leak moves the reference"""
    budget: float
    mean: float
    memory: float
    events: list[PixelEvent] = field(default_factory=list)
    now: float = 0.0
    last: int = 1
    r: float = 0.0
    """reference at the start of the tick"""

    def run(self) -> tuple[list[PixelEvent], float, int]:
        """As comparators.compare."""
        p = self.p
        self.r = p.reference
        wake = p.blind_until_us - p.begin_us
        whole = None if math.isnan(self.r) else self.whole
        if math.isnan(self.r):
            if wake > p.tick_us:
                self._forget(float(p.tick_us))
                return [], math.nan, p.blind_until_us
            self._forget(float(wake))
            self._restart(wake)
        elif self.still and self.memory == 0.0:
            first_us = p.shots[0].offset_us if p.shots else p.tick_us
            if (blind := self._stand_still(first_us)) is not None:
                return self.events, math.nan, blind
        for shot in (*p.shots, None):
            until = float(p.tick_us if shot is None else shot.offset_us)
            is_whole = self.now == 0.0 and until == p.tick_us
            if (blind := self._advance(until, whole if is_whole else None)) is not None:
                return self.events, math.nan, blind
            if shot is None or shot.offset_us < self.now:
                continue
            if shot.lot_hz == ROW_READ:
                if not self._lifted():
                    continue
                self.events.append(PixelEvent(shot.offset_us, 1, Cause.APS))
            else:
                if shot.lot_hz >= p.shot_hz:
                    continue
                polarity = int(shot.lot_hz < p.shot_on_hz)
                self.events.append(PixelEvent(shot.offset_us, polarity, Cause.SHOT))
            self.last = shot.offset_us
            self._restart(shot.offset_us)
            if (blind := self._blind(shot.offset_us)) is not None:
                return self.events, math.nan, blind
        return self.events, self.r - p.drift, p.blind_until_us

    def _signal(self, us: float) -> float:
        return self.p.signal + self.p.response.moved(us / float(self.p.tick_us))

    def _forget(self, us: float) -> None:
        kept = self.band.keep(us)
        self.memory *= kept
        self.mean *= kept
        if self.memory < FORGOTTEN:
            self.memory = self.mean = 0.0

    def _renew(self, us: int) -> None:
        self.budget = self.draws.renew(self.p.begin_us + us)

    def _restart(self, us: int) -> None:
        """Sample the noise, and set the reference to signal and noise."""
        drawn = self.draws.normal(self.p.begin_us + us)
        noise = self.mean + self.band.sigma * unknown_share(self.memory) * drawn
        self.now = float(us)
        self.r = float(on_grid(self._signal(self.now) + noise))
        self.mean, self.memory = noise, 1.0
        self._renew(us)

    def _blind(self, stamp: int) -> int | None:
        """Until when the pixel is blind, if that is beyond the tick."""
        p = self.p
        if not p.refractory_us:
            return None
        until = stamp + p.refractory_us
        if until > p.tick_us:
            self._forget(float(p.tick_us) - self.now)
            return p.begin_us + until
        self._forget(float(until) - self.now)
        self._restart(until)
        return None

    def _fire(self, us: float, up: bool, cause: Cause) -> int | None:
        p = self.p
        stamp = min(max(math.ceil(us), self.last), p.tick_us)
        self.events.append(PixelEvent(stamp, int(up), cause))
        self.last = stamp
        self.r += p.on if up else -p.off
        if cause == Cause.SHOT:
            late = float(math.ceil(us))
            us = late if late > self.now else math.floor(self.now) + 1.0
        self.now = us = min(us, float(p.tick_us))
        self.mean, self.memory = self.r - self._signal(us), 1.0
        if not p.refractory_us:
            self._renew(stamp)
        return self._blind(stamp)

    def _lifted(self) -> bool:
        """Whether a row read fires the pixel; else it uses up some of the budget."""
        sigma = self.band.sigma * unknown_share(self.memory)
        distance = self.p.on - (self._signal(self.now) - self.r) - self.mean
        scale = 1.0 / (sigma + 1e-12)
        lifted = deviations((distance - self.p.crosstalk) * scale)
        passed = CERTAIN
        if not lifted < PASSED:
            passed = loss_at(lifted) - loss_at(deviations(distance * scale))
        if passed >= self.budget:
            return True
        self.budget = budget_left(self.budget, passed)
        return False

    def _stand_still(self, until: int) -> int | None:
        """From the start of the tick to its first event, or `until`: StillNoise::run."""
        p, band, begin = self.p, self.band, self.p.begin_us
        exponent = 20
        if self.leak > 0.0:
            exponent = min(max(math.frexp(0.25 * band.sigma / self.leak)[1] - 1, 0), 20)

        def on_level(us: float) -> float:
            reference = p.reference - self.leak * (us - float(begin))
            return deviations((reference + p.on - p.signal) / (band.sigma + 1e-12))

        def off_level(us: float) -> float:
            reference = p.reference - self.leak * (us - float(begin))
            return deviations((p.signal - (reference - p.off)) / (band.sigma + 1e-12))

        def loss(us: int) -> float:
            return 0.0 if self.leak == 0.0 else on_budget_grid(loss_at(on_level(float(us))))

        t, end_us = begin, begin + until
        if on_level(float(end_us)) > FAR + 0.5 and off_level(float(begin)) > FAR + 0.5:
            t = end_us
        before = loss(begin)
        while t < end_us:
            cell = t >> exponent
            end = min((cell + 1) << exponent, end_us)
            middle = (float(cell) + 0.5) * float(1 << exponent)
            on = band.slow * rate_at(band.shift, on_level(middle))
            off = band.slow * rate_at(band.shift, off_level(middle))
            rate = on_budget_grid(min(on + off, 1.0))
            after = rate * float(end - t) + (loss(end) - before)
            if after < self.budget:
                self.budget -= after
                before, t = loss(end), end
                continue
            # the first us whose hazard reaches the budget
            low, high = t, end
            while high - low > 1:
                half = low + (high - low) // 2
                if rate * float(half - t) + (loss(half) - before) < self.budget:
                    low = half
                else:
                    high = half
            leaked = loss(high) - loss(high - 1)
            up = self.draws.polarity(high) * (on + off + leaked) < on + leaked
            cause = (Cause.HOT if p.hot else Cause.LEAK) if leaked > on else Cause.SHOT
            self.now = float(high - begin)
            return self._fire(self.now, up, cause)
        self.now = float(until)
        return None

    def _level(self, x0: float, x1: float, passages: float) -> Level:
        x = min(x0, x1)
        if x >= FAR:
            return Level(x0, x1)
        within = max(x, NEAREST)
        mean = mean_over_way(within, slope_at(within), abs(x1 - x0))
        moving = loss_at(x1) - loss_at(x0) if x1 < x0 else 0.0
        random = passages * (rate_at(self.band.shift, within) * mean)
        return Level(x0, x1, random, CERTAIN if x1 < PASSED else moving)

    def _step_to(self, end: float) -> Step:
        p, band, dt = self.p, self.band, end - self.now
        kept = band.keep(dt)
        memory1 = self.memory * kept
        if memory1 < FORGOTTEN:
            memory1 = 0.0
        mean1 = self.mean * kept if memory1 > 0.0 else 0.0
        passages = band.slow * dt / (1.0 - memory1 * memory1 + 2.0**-40)
        scale0, scale1 = (
            1.0 / (band.sigma * unknown_share(memory) + 1e-12) for memory in (self.memory, memory1)
        )
        farthest = farthest_level(self.memory)
        above0 = (self._signal(self.now) - self.r) + self.mean
        above1 = (self._signal(end) - self.r) + mean1
        on = self._level(
            deviations((p.on - above0) * scale0, farthest),
            deviations((p.on - above1) * scale1, farthest),
            passages,
        )
        off = self._level(
            deviations((p.off + above0) * scale0, farthest),
            deviations((p.off + above1) * scale1, farthest),
            passages,
        )
        return Step(memory1, mean1, passages, on, off)

    def _place(self, level: Level, passages: float, used: float) -> tuple[float, bool]:
        """Where a falling level has used up a budget: deviations, and whether noise did it."""
        start = loss_at(level.x0)
        rate = passages / (level.x0 - level.x1)
        farthest = min(level.x0, FAR)
        place, by_noise = level.x1, False
        if level.moving > used:
            place = max(level.x1, level_of_loss(start + used))
        for _ in range(4):
            within, gone = max(place, NEAREST), level.x0 - place
            slope = slope_at(within)
            passing = rate * rate_at(self.band.shift, within)
            random = passing * gone * mean_over_way(within, slope, gone)
            if random < 0.01 * used:
                break
            every = random + loss_at(place) - start
            before = gone - 2.0 * every * (every - used) / ((every + used) * (passing + slope))
            if every > used:
                before = max(before, gone * (used / every))
            place = min(max(level.x0 - before, level.x1), farthest)
            by_noise = passing > slope
            if every < 2.0 * used:
                break
        return place, by_noise

    def _share(self, step: Step, up: bool, x: float, end: float, by_noise: bool) -> float:
        """Where in a step its level has come to x deviations, as a share of the step."""
        p, level = self.p, step.on if up else step.off
        share = (level.x0 - x) / (level.x0 - level.x1)
        above0 = (self._signal(self.now) - self.r) + self.mean
        above1 = (self._signal(end) - self.r) + step.mean1
        distance0 = p.on - above0 if up else p.off + above0
        nearer = above1 - above0 if up else above0 - above1
        if not nearer > 0.0:
            return share
        left = 0.0
        for _ in range(2):
            known = self.memory + (step.memory1 - self.memory) * share
            left = distance0 - x * self.band.sigma * unknown_share(known)
            share = max(0.0, min(1.0, left / nearer))
        response, tick_us = p.response, float(p.tick_us)
        if by_noise or not response.bends:
            return share
        # the mean of the noise drifts, too
        begin, part = self.now / tick_us, (end - self.now) / tick_us
        both = response.drifting((step.mean1 - self.mean) / part)
        moved = (self._signal(self.now) - p.signal) + (both.end - response.end) * begin
        at = both.share_at(moved + left if up else moved - left, up, begin, moved, p.tick_us)
        return max(0.0, min(1.0, (at - begin) / part))

    def _part_of_long(self, step: Step, end: float) -> float:
        """How much of a long step to step first, us."""
        p, band = self.p, self.band
        if self.memory > 0.0:
            return FORGETS / band.decay
        above = self._signal(self.now) - self.r
        moves = (self._signal(end) - self.r) - above
        distance = p.on - above if moves > 0.0 else p.off + above
        level = step.on if moves > 0.0 else step.off
        if not (level.x1 < PASSED and level.x0 > NEAREST):
            return end - self.now
        return (distance - NEAREST * band.sigma) / abs(moves) * (end - self.now)

    def _is_straight(self, end: float) -> bool:
        """Whether the signal is a line up to `end`, but for a part of the noise."""
        if not self.p.response.bends:
            return True
        middle = self._signal(0.5 * (self.now + end))
        sag = middle - 0.5 * (self._signal(self.now) + self._signal(end))
        return abs(sag) < STRAIGHT_PART * self.band.sigma

    def _advance(self, until: float, whole: Step | None) -> int | None:
        """Up to `until`; when the pixel is blind beyond the tick, until when."""
        p, band, end = self.p, self.band, until
        speed = (p.signal_end - p.signal) + p.drift
        while self.now < until:
            step = self._step_to(end) if whole is None else whole
            whole = None
            dt = end - self.now
            can_be_cut = end > self.now + 1.0
            random = step.on.random + step.off.random
            is_long = self.memory > KNOWN and band.decay * dt > SHORT_STEP and can_be_cut
            if is_long and random * COARSE_PARTS > self.budget:
                end = self.now + max(1.0, 0.9 * SHORT_STEP / band.decay)
                continue
            hazard = random + (step.on.moving + step.off.moving)
            is_long = can_be_cut and band.decay * dt > LONG_STEP
            if is_long and (self.memory > 0.0 or not hazard < self.budget):
                sooner = self._part_of_long(step, end)
                if sooner < dt:
                    end = self.now + max(1.0, sooner)
                    continue
            if hazard < self.budget:
                self.budget = budget_left(self.budget, hazard)
                self.now, self.mean, self.memory, end = end, step.mean1, step.memory1, until
                continue
            up = step.on.hazard > 0.0
            if up and step.on.hazard < hazard:
                drawn = self.draws.polarity(p.begin_us + int(self.now))
                up = drawn * hazard < step.on.hazard
            level = step.on if up else step.off
            share, cause = self.budget / hazard, Cause.SHOT
            if level.x1 < level.x0:
                place, by_noise = self._place(level, step.passages, share * level.hazard)
                if by_noise and can_be_cut and not self._is_straight(end):
                    end = self.now + 0.5 * dt
                    continue
                share = self._share(step, up, place, end, by_noise)
                moved = abs(speed) * (dt / float(p.tick_us)) >= abs(self.mean - step.mean1)
                if moved and not by_noise:
                    cause = self._moving_cause()
            if (blind := self._fire(self.now + share * dt, up, cause)) is not None:
                return blind
            end = until
        return None

    def _moving_cause(self) -> Cause:
        p = self.p
        if abs(p.drift) > abs(p.signal_end - p.signal):
            return Cause.HOT if p.hot else Cause.LEAK
        return Cause.SIGNAL


def step_pixel(
    sensor: SensorParameters,
    pattern: FixedPattern,
    state: PlainState,
    i: int,
    dn: F32,
    pixel: PixelTick,
    budgets: Budgets | None = None,
) -> tuple[list[PixelEvent], float, int]:
    """One pixel through a tick, its noise in the state; as comparators.compare.

    Without budgets, of a pixel that stands still.
    """
    assert state.noise_budget is not None
    assert state.noise_mean is not None
    assert state.noise_memory is not None
    still = pixel.signal == pixel.signal_end and sensor.highpass_hz == 0.0
    quiet = budgets is None or (still and state.noise_memory.flat[i] == 0.0)
    noisy = NoisyPixel(
        pixel,
        Band.at(sensor, float(dn.flat[i])) if budgets is None or quiet else budgets.band(i),
        None if budgets is None else budgets.whole(i),
        Draws(state.seed, i),
        leak=float(leak(sensor, pattern, dn).flat[i]),
        still=still,
        budget=float(state.noise_budget.flat[i]),
        mean=float(state.noise_mean.flat[i]),
        memory=float(state.noise_memory.flat[i]),
    )
    found = noisy.run()
    _store(state, i, noisy.budget, noisy.mean, noisy.memory)
    return found
