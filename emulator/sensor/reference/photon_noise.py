"""Photon noise: core/sensor/photon_noise.h, noise_budgets.h and noisy_comparator.h.

What a whole frame needs is NumPy in float32, what single pixels need Python's floats.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import cache

import numpy as np

from evs.emulator.base.scene import F32, F64
from evs.emulator.sensor.fixed_pattern import FixedPattern
from evs.emulator.sensor.parameters import SensorParameters
from evs.emulator.sensor.pixel import PlainState
from evs.emulator.sensor.random import Term
from evs.emulator.sensor.reference.comparators import PixelEvent, PixelTick
from evs.emulator.sensor.reference.filters import (
    SETTLED,
    at_most,
    bandwidth,
    exp_minus,
    one_minus_exp,
    share_of_tick,
)
from evs.emulator.sensor.reference.noise import (
    ROW_READ,
    exponential,
    hash_bits,
    leak,
    normal,
    on_grid,
    uniform,
)
from evs.msgs import Cause

FAR, PASSED, CERTAIN = 6.0, -7.0, 30.0
FORGOTTEN = 2.0**-10
COARSE = 0.02
CELLS = 512

_RATE = (
    "-0x1.1ec48cp+3 -0x1.05ac36p+0 0x1.53adfep+4 0x1.4b056p+2 -0x1.291d9cp+4 "
    "-0x1.dc26c6p+3 -0x1.ed776cp+2 -0x1.8d04dep+2 -0x1.b1e422p-10"
)
_LOSS = (
    "-0x1.3bd722p+1 -0x1.0ffc32p+2 0x1.6cd316p+2 0x1.4ae1dp+3 -0x1.4366ap+2 "
    "-0x1.03d2a6p+4 -0x1.b3b8aep+3 -0x1.27535ep+3 -0x1.6f5184p-2"
)
_f = np.float32


def on_budget_grid(value: float) -> float:
    """The nearest multiple of 2^-46, for |value| < 32."""
    return (value + 96.0) - 96.0


def _from_fit(fit: str, t: F32) -> F32:
    """e to the fit at 8 t deviations."""
    first, *rest = (_f(float.fromhex(number)) for number in fit.split())
    p = np.full_like(t, first)
    for coefficient in rest:
        p = p * t + coefficient
    below = _f(4) - p
    value: F32 = _f(float.fromhex("0x1.b4c902p+5")) * exp_minus(
        np.where(below < SETTLED, below, SETTLED)
    )
    return value


def passage_rate(shift: F32, x: F32) -> F32:
    """Rate of first passages at a level x, in units of the slower pole."""
    level = x + shift / (_f(1) + _f(0.23) * np.where(x > 0, x, _f(0)) * shift)
    rate = _from_fit(_RATE, np.where(level < 7, level, _f(7)) * _f(0.125))
    return np.where(x < FAR, rate, _f(0))


def passage_loss(x: F32) -> F32:
    """-ln Phi."""
    return np.where(x < FAR, _from_fit(_LOSS, x * _f(0.125)), _f(0))


@cache
def _tables() -> tuple[list[float], list[float]]:
    x = np.arange(CELLS + 1, dtype=np.float32) * _f(16.0 / CELLS) - _f(8)
    return passage_rate(np.zeros_like(x), x).tolist(), passage_loss(x).tolist()


def _read(table: list[float], x: float) -> float:
    place = (x + 8.0) * (CELLS / 16.0)
    cell = min(int(place), CELLS - 1)
    return table[cell] + (place - cell) * (table[cell + 1] - table[cell])


def rate_at(shift: float, x: float) -> float:
    """As passage_rate, of one pixel."""
    if not x < FAR:
        return 0.0
    level = x + shift / (1.0 + 0.23 * x * shift) if x > 0.0 else x + shift
    return _read(_tables()[0], level) if level < FAR else 0.0


def mean_rate(shift: float, x0: float, x1: float) -> float:
    """Of a level that goes from x0 to x1 deviations."""
    rates = rate_at(shift, x0) + 4.0 * rate_at(shift, 0.5 * (x0 + x1)) + rate_at(shift, x1)
    return rates / 6.0


def loss_at(x: float) -> float:
    """As passage_loss, of one pixel."""
    return _read(_tables()[1], x) if x < FAR else 0.0


def level_of_loss(value: float) -> float:
    """Deviations at which the loss has a value."""
    table, low, high = _tables()[1], 0, CELLS
    while high - low > 1:
        half = (low + high) // 2
        if table[half] > value:
            low = half
        else:
            high = half
    part = (table[low] - value) / (table[low] - table[high])
    return (low + part) * (16.0 / CELLS) - 8.0


def deviations(distance: float, sigma: float) -> float:
    """A distance from the mean in deviations, limited to the tables."""
    return max(-8.0, min(8.0, distance / (sigma + 1e-12)))


def unknown_share(memory: float) -> float:
    """The deviation of noise that is known so far, over sigma."""
    return math.sqrt((1.0 - memory) * (1.0 + memory))


@dataclass(frozen=True)
class Band:
    """The noise of a pixel at one light."""

    sigma: float
    """log units"""
    decay: float
    """1 / us"""
    slow: float
    """the slower pole, 1 / us"""
    shift: float
    """by how much the faster pole moves a level away, deviations"""

    @classmethod
    def at(cls, sensor: SensorParameters, dn: float) -> Band:
        """At a light, DN."""
        turn = 2.0 * math.pi * 1e-6
        lux = sensor.bright_lux + sensor.dim_lux
        low = turn * sensor.cutoff_hz * sensor.dim_lux / lux
        slope = turn * sensor.cutoff_hz * sensor.lux_per_dn / lux
        first = low + slope * dn if sensor.cutoff_hz else 0.0
        second = turn * sensor.follower_hz
        if first > 0.0 and second > 0.0:
            slow, fast = min(first, second), max(first, second)
            decay, ratio = first * second / (first + second), slow / fast
            shift = 1.43 * math.sqrt(ratio / (1.0 + 0.39 * ratio))
        else:
            slow = decay = first or second
            shift = 0.0
        return cls(math.sqrt(sensor.photon_scale_us * decay / dn), decay, slow, shift)

    def keep(self, us: float) -> float:
        """How much memory is left after a time."""
        z = np.array([self.decay * us]).astype(np.float32)
        return 1.0 - float(one_minus_exp(at_most(z, SETTLED))[0])


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
        drawn = exponential(hash_bits(self.key, self._counter(us)))
        return max(on_budget_grid(min(drawn, 28.0)), 2.0**-46)

    def normal(self, us: int) -> float:
        """A standard normal number."""
        return normal(self.key, self._counter(us))

    def polarity(self, us: int) -> float:
        """A number in [0, 1)."""
        return uniform(hash_bits(self.key, self._counter(us) + 3))


def first_noise(sensor: SensorParameters, state: PlainState, i: int, dn: float, us: int) -> float:
    """The noise of pixel i at its first light, which is known; into the state."""
    draws = Draws(state.seed, i)
    noise = Band.at(sensor, dn).sigma * draws.normal(us)
    _store(state, i, draws.renew(us), noise, 1.0)
    return noise


def _store(state: PlainState, i: int, budget: float, mean: float, memory: float) -> None:
    assert state.noise_budget is not None
    assert state.noise_mean is not None
    assert state.noise_memory is not None
    state.noise_budget.flat[i] = budget
    state.noise_mean.flat[i] = mean
    state.noise_memory.flat[i] = memory


def use_up_budgets(
    sensor: SensorParameters,
    pattern: FixedPattern,
    state: PlainState,
    dn: F32,
    signal: tuple[F32, F32],
    drift: F64,
    tick_us: int,
    candidates: np.ndarray,
) -> np.ndarray:
    """Step the pixels whose budget lasts through a tick; (h, w) bool, which ones do not."""
    assert state.noise_budget is not None
    assert state.noise_mean is not None
    assert state.noise_memory is not None
    start, end = signal
    z, follower_z = bandwidth(sensor, dn, tick_us), share_of_tick(sensor.follower_hz, tick_us)
    with np.errstate(all="ignore"):
        if sensor.cutoff_hz and sensor.follower_hz:
            slow, fast = np.minimum(z, follower_z), np.maximum(z, follower_z)
            decay, ratio = z * follower_z / (z + follower_z), slow / fast
            shift = _f(1.43) * np.sqrt(ratio / (_f(1) + _f(0.39) * ratio))
        else:
            decay = slow = z if sensor.cutoff_hz else np.full_like(dn, follower_z)
            shift = np.zeros_like(dn)
        scale = _f(sensor.photon_scale_us / tick_us)
        sigma = np.sqrt(scale * decay / dn)
        kept = _f(1) - one_minus_exp(at_most(decay, SETTLED))
        memory0 = state.noise_memory
        left = memory0 * kept
        memory1 = np.where(left < FORGOTTEN, _f(0), left)
        mean1 = np.where(left < FORGOTTEN, _f(0), state.noise_mean * kept)
        passages = slow / (_f(1) - memory0 * memory1 + _f(2.0**-24))
        sigmas = [sigma * np.sqrt((_f(1) - m) * (_f(1) + m)) for m in (memory0, memory1)]
        coarse = (memory0 > kept) & (decay > _f(0.1))
        above = [
            (start.astype(np.float64) - state.reference).astype(np.float32) + state.noise_mean,
            (end.astype(np.float64) - (state.reference - drift)).astype(np.float32) + mean1,
        ]
        on = [pattern.on - each for each in above]
        off = [pattern.off + each for each in above]
        on_is_nearer = np.minimum(*on) < np.minimum(*off)
        random = hazard = np.zeros_like(dn)
        for nearer in (True, False):
            levels = [np.where(on_is_nearer == nearer, a, b) for a, b in zip(on, off, strict=True)]
            x0, x1 = (_clip(d / (s + _f(1e-12))) for d, s in zip(levels, sigmas, strict=True))
            rates = (
                passage_rate(shift, x0)
                + _f(4) * passage_rate(shift, _f(0.5) * (x0 + x1))
                + passage_rate(shift, x1)
            )
            noise = passages * (rates * _f(float.fromhex("0x1.555556p-3")))
            fallen = passage_loss(x1) - passage_loss(x0)
            moving = np.where(x1 < PASSED, _f(CERTAIN), np.where(fallen > 0, fallen, _f(0)))
            random, hazard = random + noise, hazard + (noise + moving)
            far = (x0 >= FAR) & (x1 >= FAR)
            coarse |= ((x1 - x0 > 1) | (x1 - x0 < -1)) & ~far
    budget = state.noise_budget
    still = (memory0 == 0) & (start == end) & (sensor.highpass_hz == 0.0)
    unclear = coarse & (random.astype(np.float64) > COARSE * budget)
    lasts = (hazard < budget) & ~np.isnan(state.reference) & ~still & ~unclear & ~candidates
    used = np.where(lasts, hazard.astype(np.float64), 0.0)
    state.noise_budget = budget - ((used + 96.0) - 96.0)
    state.noise_memory = np.where(lasts, memory1, memory0)
    state.noise_mean = np.where(lasts, mean1, state.noise_mean)
    remaining: np.ndarray = ~lasts
    return remaining


def _clip(x: F32) -> F32:
    above = np.where(x > -8, x, _f(-8))
    return np.where(above < 8, above, _f(8))


@dataclass
class NoisyPixel:
    """The comparators of one pixel with noise through one tick."""

    p: PixelTick
    band: Band
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
        if math.isnan(self.r):
            if wake > p.tick_us:
                self._forget(float(p.tick_us))
                return [], math.nan, p.blind_until_us
            self._forget(float(wake))
            self._restart(wake)
        elif self.still and self.memory == 0.0:
            until = p.shots[0].offset_us if p.shots else p.tick_us
            if (blind := self._stand_still(until)) is not None:
                return self.events, math.nan, blind
        for shot in (*p.shots, None):
            blind = self._advance(float(p.tick_us if shot is None else shot.offset_us))
            if blind is not None:
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
        speed = (self.p.signal_end - self.p.signal) + self.p.drift
        return self.p.signal + speed * (us / float(self.p.tick_us))

    def _forget(self, us: float) -> None:
        kept = self.band.keep(us)
        self.memory *= kept
        self.mean *= kept
        if self.memory < FORGOTTEN:
            self.memory = self.mean = 0.0

    def _know(self, noise: float, us: int) -> None:
        self.mean, self.memory = noise, 1.0
        self.budget = self.draws.renew(self.p.begin_us + us)

    def _restart(self, us: int) -> None:
        """Sample the noise, and set the reference to signal and noise."""
        drawn = self.draws.normal(self.p.begin_us + us)
        noise = self.mean + self.band.sigma * unknown_share(self.memory) * drawn
        self.now = float(us)
        self.r = float(on_grid(self._signal(self.now) + noise))
        self._know(noise, us)

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
            us = math.floor(us) + 1.0 if us < p.tick_us - 1.0 else float(p.tick_us)
        self.now = us
        self._know(self.r - self._signal(us), stamp)
        return self._blind(stamp)

    def _lifted(self) -> bool:
        """Whether a row read fires the pixel; else it uses up some of the budget."""
        sigma = self.band.sigma * unknown_share(self.memory)
        distance = self.p.on - (self._signal(self.now) - self.r) - self.mean
        lifted = deviations(distance - self.p.crosstalk, sigma)
        passed = CERTAIN
        if not lifted < PASSED:
            passed = loss_at(lifted) - loss_at(deviations(distance, sigma))
        if passed >= self.budget:
            return True
        self.budget -= on_budget_grid(passed)
        return False

    def _stand_still(self, until: int) -> int | None:
        """From the start of the tick to its first event, or `until`: StillNoise::run."""
        p, band, begin = self.p, self.band, self.p.begin_us
        exponent = 20
        if self.leak > 0.0:
            exponent = min(max(math.frexp(0.25 * band.sigma / self.leak)[1] - 1, 0), 20)

        def on_level(us: float) -> float:
            reference = p.reference - self.leak * (us - float(begin))
            return deviations(reference + p.on - p.signal, band.sigma)

        def off_level(us: float) -> float:
            reference = p.reference - self.leak * (us - float(begin))
            return deviations(p.signal - (reference - p.off), band.sigma)

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

    def _level(
        self, distance: tuple[float, float], sigma: tuple[float, float], passages: float
    ) -> tuple[float, float, float, float]:
        """(x0, x1, hazard of the noise, hazard of the moving level) of a step."""
        x0, x1 = deviations(distance[0], sigma[0]), deviations(distance[1], sigma[1])
        if x0 >= FAR and x1 >= FAR:
            return x0, x1, 0.0, 0.0
        fallen = loss_at(x1) - loss_at(x0)
        noise = passages * mean_rate(self.band.shift, x0, x1)
        return x0, x1, noise, CERTAIN if x1 < PASSED else max(fallen, 0.0)

    def _advance(self, until: float) -> int | None:
        """Up to `until`; when the pixel is blind beyond the tick, until when."""
        p, band, end = self.p, self.band, until
        while self.now < until:
            dt = end - self.now
            kept = band.keep(dt)
            memory1 = self.memory * kept
            if memory1 < FORGOTTEN:
                memory1 = 0.0
            mean1 = self.mean * kept if memory1 > 0.0 else 0.0
            sigma = band.sigma * unknown_share(self.memory), band.sigma * unknown_share(memory1)
            above = (
                (self._signal(self.now) - self.r) + self.mean,
                (self._signal(end) - self.r) + mean1,
            )
            distances = [(p.off + above[0], p.off + above[1]), (p.on - above[0], p.on - above[1])]
            passages = band.slow * dt / (1.0 - self.memory * memory1 + 2.0**-40)
            off, on = (self._level(distance, sigma, passages) for distance in distances)
            limit = COARSE * self.budget
            up = on[3] > off[3]
            moving = on if up else off
            if moving[3] >= self.budget:
                loss = self.budget
                place, known, x = self._crossing(moving[0], distances[up], memory1, loss, 0.5)
                passages = band.slow * (place * dt) / (1.0 - self.memory * known + 2.0**-40)
                earlier = passages * mean_rate(band.shift, moving[0], x)
                rough = moving[0] - x > 1.0 or (self.memory > kept and band.decay * dt > 0.1)
                if rough and place * dt > 1.0 and earlier > limit:
                    end = self.now + 0.5 * (place * dt)
                    continue
                cause = self._moving_cause()
                if earlier >= self.budget:
                    cause, place = Cause.SHOT, place * (self.budget / earlier)
                elif earlier > 0.1 * self.budget:
                    loss = self.budget - earlier
                    place, _, _ = self._crossing(moving[0], distances[up], memory1, loss, place)
                if (blind := self._fire(self.now + place * dt, up, cause)) is not None:
                    return blind
                end = until
                continue
            random = on[2] + off[2]
            coarse = (
                abs(on[1] - on[0]) > 1.0
                or abs(off[1] - off[0]) > 1.0
                or (self.memory > kept and band.decay * dt > 0.1)
            )
            if coarse and dt > 1.0 and random > limit:
                end = self.now + 0.5 * dt
                continue
            hazard = random + on[3] + off[3]
            if hazard < self.budget:
                self.budget -= on_budget_grid(hazard)
                self.now, self.mean, self.memory, end = end, mean1, memory1, until
                continue
            up = self.draws.polarity(p.begin_us + int(self.now)) * hazard < on[2] + on[3]
            moved = (on if up else off)[3] > random and sigma[1] == sigma[0]
            cause = self._moving_cause() if moved else Cause.SHOT
            blind = self._fire(self.now + self.budget / hazard * dt, up, cause)
            if blind is not None:
                return blind
            end = until
        return None

    def _moving_cause(self) -> Cause:
        p = self.p
        if abs(p.drift) > abs(p.signal_end - p.signal):
            return Cause.HOT if p.hot else Cause.LEAK
        return Cause.SIGNAL

    def _crossing(
        self, x0: float, distance: tuple[float, float], memory1: float, loss: float, place: float
    ) -> tuple[float, float, float]:
        """Where in a step a level has lost this: place (0 ... 1), memory and deviations there."""
        x, known = level_of_loss(loss_at(x0) + loss), self.memory
        for _ in range(2):
            known = self.memory + (memory1 - self.memory) * place
            left = distance[0] - x * self.band.sigma * unknown_share(known)
            place = max(0.0, min(1.0, left / (distance[0] - distance[1])))
        return place, known, x


def step_pixel(
    sensor: SensorParameters,
    pattern: FixedPattern,
    state: PlainState,
    i: int,
    dn: F32,
    pixel: PixelTick,
) -> tuple[list[PixelEvent], float, int]:
    """One pixel through a tick, its noise in the state; as comparators.compare."""
    assert state.noise_budget is not None
    assert state.noise_mean is not None
    assert state.noise_memory is not None
    noisy = NoisyPixel(
        pixel,
        Band.at(sensor, float(dn.flat[i])),
        Draws(state.seed, i),
        leak=float(leak(sensor, pattern, dn).flat[i]),
        still=pixel.signal == pixel.signal_end and sensor.highpass_hz == 0.0,
        budget=float(state.noise_budget.flat[i]),
        mean=float(state.noise_mean.flat[i]),
        memory=float(state.noise_memory.flat[i]),
    )
    found = noisy.run()
    _store(state, i, noisy.budget, noisy.mean, noisy.memory)
    return found
