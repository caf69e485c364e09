"""Flicker: how strong each light is in a tick, the mean of its waveform over the tick.

A mean and no sample: light that is switched far faster than the tick looks steady, and nothing
beats with the tick. Phases are counted in whole numbers from t_us, so nothing accumulates.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from evs.emulator.base.scene import F32, Light, SceneSnapshot
from evs.emulator.config import FlickerConfig, RenderConfig
from evs.msgs import EvsError, unknown

WAVEFORMS = ("mains", "sine", "pwm")
EVERY = "*"
MAX_HZ = 1e6

CYCLE = 10**12
"""One period in the unit of phases: us times uHz."""


class Flicker:
    """The gains of a scene's lights."""

    def __init__(self, lights: Sequence[Light], tables: Sequence[FlickerConfig]) -> None:
        """Raises EvsError with the key where a table makes no sense, or names no light."""
        names = [light.name for light in lights]
        for place, table in enumerate(tables):
            _check(table, f"render.flicker.{place}", names)
        named = [table.light for table in tables]
        for place, name in enumerate(named):
            if name in named[:place]:
                raise EvsError(f"at render.flicker.{place}.light: '{name}' flickers twice")
        by_name = {table.light: table for table in tables}
        # a light's own table counts, not that of every light
        self._tables = [by_name.get(name, by_name.get(EVERY)) for name in names]
        self.steady = not any(self._tables)

    def gains(self, snapshot: SceneSnapshot) -> F32:
        """(nl,) float32: the mean of each light's waveform over the snapshot's exposure."""
        end_us = snapshot.t_us
        begin_us = end_us - snapshot.exposure_us
        return np.array(
            [1.0 if table is None else mean(table, begin_us, end_us) for table in self._tables],
            np.float32,
        )


def flicker_warnings(
    lights: Sequence[Light], config: RenderConfig, tick_us: int
) -> tuple[str, ...]:
    """One line for each table whose light pulses faster than half the ticks: what is lost, the fix.

    By the sampling theorem; what the mean over a tick leaves of such a pulse beats with the ticks.
    """
    lit = {light.name for light in lights if config.headlight == "model" or not light.headlight}
    own = {table.light for table in config.flicker}
    return tuple(
        f"light '{table.light}' pulses {pulse_hz(table):g} times a second, more than half the "
        f"tick rate ({1e6 / tick_us:g} per second): each tick sees only the mean, so the events do "
        f"not show the pulses; {_shorter(table)}"
        for table in config.flicker
        if (table.light in lit or (table.light == EVERY and lit - own))
        and table.depth > 0.0
        and not (table.waveform == "pwm" and table.duty == 1.0)
        and 2.0 * pulse_hz(table) * tick_us > 1e6
    )


def pulse_hz(table: FlickerConfig) -> float:
    """How often the light itself pulses."""
    return table.hz * (2.0 if table.waveform == "mains" else 1.0)


def _shorter(table: FlickerConfig) -> str:
    """What would show it."""
    longest = int(0.5e6 / pulse_hz(table))
    return f"set scene.tick_us to {longest} or less" if longest else "no tick is short enough"


def mean(table: FlickerConfig, begin_us: int, end_us: int) -> float:
    """Mean of a waveform over (begin_us, end_us]; its value where they are one.

    The mean over a whole period is 1, so the model's light is the mean. mains: 1 - depth cos(2 pi
    2 hz t), the power, which is low twice in a period of the voltage. sine: 1 + depth sin(2 pi hz
    t). pwm: 1 - depth, but in the first `duty` of each period more, by as much as makes up for it.
    """
    rate = round(table.hz * 1e6) * (2 if table.waveform == "mains" else 1)
    shift = round(table.phase * CYCLE)
    begin, end = begin_us * rate + shift, end_us * rate + shift
    if table.waveform == "pwm":
        on = round(table.duty * CYCLE)
        share = _on_share(begin, end, on)
        return 1.0 - table.depth + table.depth * share * (CYCLE / on)

    # the mean of a wave is its middle value times sin(x) / x of half the angle passed
    middle = 2.0 * math.pi * (((begin + end) % (2 * CYCLE)) / (2 * CYCLE))
    left = 1.0
    if end > begin:
        half = math.sin(math.pi * (((end - begin) % (2 * CYCLE)) / CYCLE))
        left = half / (math.pi * ((end - begin) / CYCLE))
        # whole periods leave nothing; math.sin(math.pi) does
        left = 0.0 if (end - begin) % CYCLE == 0 else left
    if table.waveform == "mains":
        return 1.0 - table.depth * left * math.cos(middle)
    return 1.0 + table.depth * left * math.sin(middle)


def _on_share(begin: int, end: int, on: int) -> float:
    """Share of the phases (begin, end] that lie in the first `on` of a period."""
    if end == begin:
        return float(end % CYCLE < on)

    def on_until(phase: int) -> int:
        return phase // CYCLE * on + min(phase % CYCLE, on)

    return (on_until(end) - on_until(begin)) / (end - begin)


def _check(table: FlickerConfig, path: str, names: Sequence[str]) -> None:
    if table.light != EVERY and table.light not in names:
        raise EvsError(f"at {path}.light: {unknown('light', table.light, [*names, EVERY])}")
    if table.waveform not in WAVEFORMS:
        raise EvsError(f"at {path}.waveform: {unknown('waveform', table.waveform, WAVEFORMS)}")
    if not 1e-6 <= table.hz <= MAX_HZ:
        raise EvsError(f"at {path}.hz: {table.hz} is not over 0 and at most {MAX_HZ:g} Hz")
    if not 0.0 <= table.depth <= 1.0:
        raise EvsError(f"at {path}.depth: {table.depth} is not 0 ... 1")
    if not 1e-6 <= table.duty <= 1.0:
        raise EvsError(f"at {path}.duty: {table.duty} is not over 0 and at most 1")
    if not 0.0 <= table.phase <= 1.0:
        raise EvsError(f"at {path}.phase: {table.phase} is not 0 ... 1")
