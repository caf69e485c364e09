"""The whole event pixel in NumPy and plain Python, written for reading: the oracle of core/sensor.

It gives the native pixel's events and state byte for byte, and takes nothing native but the empty
arrays of its first state. It is written from the contracts in the headers, it leaves no pixel out,
and it is slow. `ReferenceModel` takes a whole frame's tick, term by term.
"""

from __future__ import annotations

import math
from dataclasses import replace
from functools import lru_cache

import numpy as np

from evs.emulator.base.scene import F32, F64
from evs.emulator.sensor import running_mean
from evs.emulator.sensor.aps_crosstalk import RowReads
from evs.emulator.sensor.fixed_pattern import FixedPattern, draw_pattern
from evs.emulator.sensor.parameters import SensorParameters
from evs.emulator.sensor.pixel import BLOCK, PlainModel, PlainState, check_tick
from evs.emulator.sensor.reference.filters import (
    FOR_EVER,
    SLOWEST,
    STRAIGHT,
    apart_from,
    at_most,
    bandwidth,
    follow,
    follower_lag,
    large_signal_rate,
    share_of_tick,
    shares,
)
from evs.emulator.sensor.reference.light import is_light, log_light, to_dn
from evs.emulator.sensor.running_mean import RunningMeanConstants, RunningMeanState
from evs.msgs import Events, make_events
from reference.pixel import photon_noise
from reference.pixel.comparators import PixelEvent, PixelTick, compare
from reference.pixel.noise import (
    NEVER,
    ROW_READ,
    UNITS,
    Candidate,
    candidates,
    leak,
    most_shot_hz,
    on_grid,
    shot_share,
)
from reference.pixel.response import Filters


class ReferenceModel:
    """EventModel with the bytes of PlainModel, and none of its speed."""

    def __init__(
        self,
        sensor: SensorParameters,
        *,
        average: RunningMeanConstants | None = None,
        causes: bool = False,
    ) -> None:
        self.sensor, self.average, self.causes = sensor, average, causes
        self._pattern = lru_cache(maxsize=1)(lambda seed: draw_pattern(sensor, seed))

    def init(self, seed: int) -> PlainState:
        """The state before the first tick."""
        return PlainModel(self.sensor, 1, average=self.average).init(seed)

    def take_over(self, state: PlainState, before: ReferenceModel) -> PlainState:
        """As PlainModel.take_over; this one leaves the state handed in as it was."""
        state = state.copy()
        if state.shot_next is not None and state.ticks:
            for block, following in enumerate(state.shot_next.tolist()):
                pixels = slice(block * BLOCK, (block + 1) * BLOCK)
                old, new = (
                    most_shot_hz(one._pattern(state.seed % 2**64), pixels) for one in (before, self)
                )
                now = state.clock_us * UNITS
                left = math.ceil((following - now) * (old / new)) if new else NEVER
                state.shot_next[block] = min(now + left, NEVER)
        state.all_due = 1
        return state

    def step(
        self, luminance: F32, state: PlainState, t_begin_us: int, t_end_us: int
    ) -> tuple[Events, PlainState]:
        """As PlainModel.step; this one leaves the state handed in as it was.

        No block is ever left out: the state's due_us and since_us are its clock.
        """
        check_tick(self.sensor, luminance, state, t_begin_us, t_end_us)
        state, tick_us = state.copy(), t_end_us - t_begin_us
        pattern = self._pattern(state.seed % 2**64)
        begins = np.isnan(state.last_log)

        light, seen = self._light(luminance, state)
        dn = to_dn(seen, self.sensor)
        log = np.where(seen > -running_mean.BLACK, log_light(seen, self.sensor), state.last_log)
        filters = self._filter(log, dn, state, begins, tick_us)
        start, end = filters.signal
        drift = self._drift(start, end, dn, state, pattern, tick_us)
        shots = self._shots(state, pattern, tick_us)
        self._add_row_reads(shots, t_begin_us, t_end_us)

        budgets = None
        if state.noise_budget is not None:
            shots = {i: of for i, of in shots.items() if self._accepts(of, pattern, dn, i)}
            candidates = np.zeros(dn.shape, bool)
            candidates.reshape(-1)[list(shots)] = True
            budgets = photon_noise.use_up_budgets(
                self.sensor, pattern, state, dn, (start, end), drift, tick_us, candidates
            )

        events: list[tuple[PixelEvent, int]] = []
        reference = state.reference.reshape(-1)
        for i in range(reference.size):
            if begins.flat[i]:
                # the first light only sets the reference
                phase = 0.0 if pattern.phase is None else float(pattern.phase.flat[i])
                noise = 0.0
                if state.noise_budget is not None and not np.isnan(end.flat[i]):
                    first_us = state.clock_us + tick_us
                    dn_of_pixel = float(dn.flat[i])
                    noise, share = photon_noise.first_noise(
                        self.sensor, state, i, dn_of_pixel, first_us, float(pattern.on.flat[i])
                    )
                    phase *= share
                reference[i] = on_grid(float(end.flat[i]) - phase + noise)
                continue
            if budgets is not None and not budgets.left.flat[i]:
                reference[i] -= float(drift.flat[i])
                continue
            pixel = PixelTick(
                on=float(pattern.on.flat[i]),
                off=float(pattern.off.flat[i]),
                reference=float(reference[i]),
                blind_until_us=0 if state.blind_until is None else int(state.blind_until.flat[i]),
                signal=float(start.flat[i]),
                signal_end=float(end.flat[i]),
                drift=float(drift.flat[i]),
                begin_us=state.clock_us,
                tick_us=tick_us,
                refractory_us=(
                    self.sensor.refractory_us
                    if pattern.refractory_us is None
                    else int(pattern.refractory_us.flat[i])
                ),
                hot=pattern.hot is not None and bool(pattern.hot.flat[i]),
                bent=filters.response(i, float(drift.flat[i]), tick_us),
            )
            if i in shots:
                pixel = replace(
                    pixel, shots=tuple(shots[i]), crosstalk=float(self.sensor.aps.crosstalk)
                )
            if i in shots and state.shot_next is not None:
                assert pattern.shot_on is not None
                assert pattern.shot_off is not None
                share = shot_share(self.sensor, float(dn.flat[i]))
                on, off = float(pattern.shot_on.flat[i]), float(pattern.shot_off.flat[i])
                pixel = replace(pixel, shot_on_hz=on * share, shot_hz=(on + off) * share)
            if state.noise_budget is None:
                found, reference[i], blind_until_us = compare(pixel)
            else:
                found, reference[i], blind_until_us = photon_noise.step_pixel(
                    self.sensor, pattern, state, i, dn, pixel, budgets
                )
            events += [(event, i) for event in found]
            if state.blind_until is not None:
                state.blind_until.reshape(-1)[i] = blind_until_us

        state.last_log, state.last_luminance = log, light
        state.clock_us += tick_us
        state.tick_us = tick_us
        state.ticks += 1
        state.all_due = 0
        for blocks in (state.due_us, state.since_us):
            if blocks is not None:
                blocks[:] = state.clock_us
        return self._packet(events, t_begin_us), state

    def _light(self, luminance: F32, state: PlainState) -> tuple[F32, F32]:
        """Each pixel's last light, and what the pixel makes of it: that, or its running mean."""
        usable = is_light(luminance, self.sensor)
        if self.average is not None:
            usable &= luminance <= running_mean.LARGEST_LIGHT
        state.clamped += int(np.count_nonzero(~usable))
        light: F32 = np.where(usable, luminance, state.last_luminance)
        if self.average is None:
            return light, light
        assert state.mean is not None
        assert state.noise is not None
        assert state.drift is not None
        last = np.where(np.abs(state.last_luminance) < running_mean.BLACK, 0, state.last_luminance)
        before = RunningMeanState(
            state.ticks, 0, last.astype(np.float32), state.mean, state.noise, state.drift
        )
        mean, after = running_mean.step(light, before, self.average)
        state.mean, state.noise, state.drift = after.mean, after.noise, after.drift
        return light, mean

    def _filter(
        self, log: F32, dn: F32, state: PlainState, begins: np.ndarray, tick_us: int
    ) -> Filters:
        """The filters over the tick; their outputs into the state."""
        start, end, law = state.last_log, log, self.sensor.filter
        light = start, end
        photoreceptor = rate = follower_z = None
        if state.filtered is not None:
            z = bandwidth(self.sensor, dn, tick_us)
            after = follow(z, state.filtered, start, end, law)
            start, end = state.filtered, np.where(begins, log, after)
            start = np.where(begins, log, start)
            state.filtered = end
            photoreceptor = start, end
            if law == "large_signal":
                rate = large_signal_rate(z, start, light[0])
            else:
                rate = at_most(np.where(np.abs(z) < SLOWEST, np.float32(0), z), FOR_EVER)
        if state.followed is not None:
            follower_z = share_of_tick(self.sensor.follower_hz, tick_us)
            short_of: F32 | None = None
            if rate is not None and law != "euler" and follower_z > STRAIGHT:
                rate = apart_from(rate, follower_z)
                bend = (light[1] - light[0]) - (end - start)
                short_of = bend * follower_lag(rate, follower_z)
            z = np.full_like(log, follower_z)
            # the follower is a linear pole in front of any comparator
            linear = "euler" if law == "euler" else "exact"
            after = follow(z, state.followed, start, end, linear, short_of)
            start, end = state.followed, np.where(begins, log, after)
            start = np.where(begins, log, start)
            state.followed = end
        return Filters(light, (start, end), photoreceptor, rate, follower_z, euler=law == "euler")

    def _drift(
        self,
        start: F32,
        end: F32,
        dn: F32,
        state: PlainState,
        pattern: FixedPattern,
        tick_us: int,
    ) -> F64:
        """How far references sink in the tick; the high pass draws them towards the signal."""
        drift = leak(self.sensor, pattern, dn) * float(tick_us)
        if not self.sensor.highpass_hz:
            return drift
        z = np.array([share_of_tick(self.sensor.highpass_hz, tick_us)])
        a, b = (share.astype(np.float64) for share in shares(z))
        x0, x1 = start.astype(np.float64), end.astype(np.float64)
        rise = on_grid(a * (x0 - state.reference) + b * (x1 - x0))
        return np.where(np.isnan(rise), drift, drift - rise)  # blind pixels only leak

    def _shots(
        self, state: PlainState, pattern: FixedPattern, tick_us: int
    ) -> dict[int, list[Candidate]]:
        """Candidates for shot noise in the tick, by pixel, in order."""
        found: dict[int, list[Candidate]] = {}
        if state.shot_next is None or state.shot_count is None:
            return found
        for block in range(len(state.shot_next)):
            first = block * BLOCK
            pixels = min(BLOCK, state.reference.size - first)
            most = most_shot_hz(pattern, slice(first, first + pixels))
            clock = int(state.shot_next[block]), int(state.shot_count[block])
            end_us = state.clock_us + tick_us
            shots, clock = candidates(
                state.seed, block, pixels, most, clock, state.clock_us, end_us
            )
            state.shot_next[block], state.shot_count[block] = clock
            for shot in shots:
                found.setdefault(first + shot.pixel, []).append(shot)
        return found

    def _add_row_reads(
        self, shots: dict[int, list[Candidate]], t_begin_us: int, t_end_us: int
    ) -> None:
        """Add the reads of rows in the tick to the candidates, each after noise of its us."""
        aps, width = self.sensor.aps, self.sensor.width
        if not (aps.enabled and aps.crosstalk):
            return
        reads = RowReads(aps, self.sensor.height).within(t_begin_us, t_end_us)
        for row, offset_us in reads.tolist():
            for pixel in range(row * width, (row + 1) * width):
                found = shots.setdefault(pixel, [])
                found.append(Candidate(pixel % BLOCK, offset_us, ROW_READ))
                found.sort(key=lambda shot: shot.offset_us)

    def _accepts(self, shots: list[Candidate], pattern: FixedPattern, dn: F32, i: int) -> bool:
        """Whether some candidate of pixel i is a row read, or below its rate at this light."""
        if any(shot.lot_hz == ROW_READ for shot in shots):
            return True
        assert pattern.shot_on is not None
        assert pattern.shot_off is not None
        rate_hz = float(pattern.shot_on.flat[i]) + float(pattern.shot_off.flat[i])
        share = shot_share(self.sensor, float(dn.flat[i]))
        return any(shot.lot_hz < rate_hz * share for shot in shots)

    def _packet(self, events: list[tuple[PixelEvent, int]], t_begin_us: int) -> Events:
        """By time; ties by pixel, then in the order in which the pixel had them."""
        events.sort(key=lambda event: event[0].offset_us)
        y, x = np.divmod(np.array([pixel for _, pixel in events], np.int64), self.sensor.width)
        packet = make_events(
            [t_begin_us + event.offset_us for event, _ in events],
            x,
            y,
            [event.polarity for event, _ in events],
        )
        if self.causes:
            causes = np.array([event.cause for event, _ in events], np.uint8)
            packet.view(np.uint8).reshape(-1, packet.itemsize)[:, 13] = causes
        return packet


def at_clock(state: PlainState, clock_us: int) -> PlainState:
    """A new sensor whose clock does not begin at 0."""
    state.clock_us = clock_us
    for blocks, unit in ((state.due_us, 1), (state.since_us, 1), (state.shot_next, 1024)):
        if blocks is not None:
            blocks[:] = clock_us * unit
    return state


def caught_up(sensor: SensorParameters, state: PlainState) -> PlainState:
    """A native state as if no block had been left out: what has leaked is in the references."""
    state = state.copy()
    if state.since_us is None or state.due_us is None:
        return state
    pattern = draw_pattern(sensor, state.seed)
    light = state.last_luminance if state.mean is None else state.mean
    owed_us = np.repeat(state.clock_us - state.since_us, BLOCK)[: light.size].reshape(light.shape)
    dn = to_dn(light, sensor)
    owed = leak(sensor, pattern, dn) * owed_us
    if state.noise_budget is not None:
        _use_up_owed_budgets(sensor, pattern, state, dn, owed_us, owed)
    state.reference = state.reference - owed
    state.since_us[:] = state.due_us[:] = state.clock_us
    return state


def _use_up_owed_budgets(
    sensor: SensorParameters,
    pattern: FixedPattern,
    state: PlainState,
    dn: F32,
    owed_us: np.ndarray,
    owed: F64,
) -> None:
    """Photon noise of the time for which blocks were left out: no budget ends in it."""
    signal = state.filtered if state.followed is None else state.followed
    assert signal is not None
    for i in range(dn.size):
        us, reference = int(owed_us.flat[i]), float(state.reference.flat[i])
        if us == 0 or np.isnan(reference):
            continue
        pixel = PixelTick(
            on=float(pattern.on.flat[i]),
            off=float(pattern.off.flat[i]),
            reference=reference,
            blind_until_us=0,
            signal=float(signal.flat[i]),
            signal_end=float(signal.flat[i]),
            drift=float(owed.flat[i]),
            begin_us=state.clock_us - us,
            tick_us=us,
        )
        found, _, _ = photon_noise.step_pixel(sensor, pattern, state, i, dn, pixel)
        assert not found
