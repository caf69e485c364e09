"""Light that pulses: a strobe that no tick can follow, and lamps on the mains."""

from __future__ import annotations

import math

import numpy as np

from evs.emulator import World
from evs.emulator.base.scene import F64
from evs.emulator.world import ORTHOGRAPHIC
from evs.tools.stress.capture import capture
from evs.tools.stress.closed_form import count_error, residual_thresholds
from evs.tools.stress.stress_case import Measurement, StressCase

SIDE_PX = 8

LAMP = f"""<mujoco><option timestep="1000"/><visual><headlight active="0"/></visual>
<asset><material name="chalk" rgba="1 1 1 1" specular="0" shininess="0"/>
<material name="bright" rgba="1 1 1 1" emission="3"/>
<material name="dim" rgba="1 1 1 1" emission=".2"/></asset><worldbody>
<camera name="eye" pos="0 0 9" {ORTHOGRAPHIC} fovy="8"/>
<light name="lamp" directional="true" dir="0 0 -1" diffuse=".5 .5 .5" ambient="0 0 0"
 specular="0 0 0" castshadow="false"/>
<geom type="box" size="9 9 .1" material="chalk"/>
<body name="shutter" mocap="true" pos="50 0 4">
<geom type="box" size="5 9 .1" pos="0 0 0" material="bright"/>
<geom type="box" size="5 9 .1" pos="30 0 0" material="dim"/></body></worldbody></mujoco>"""
"""A lamp on white; a shutter whose two halves glow beside what they reflect of the lamp."""

LIT, GLOW, CLOSED_TICKS = 0.5, {0: 3.0, 1: 0.2}, 12
"""the lamp's light on white without pulses; the halves of the shutter; ticks at the end"""


def _pulsing(
    hz: float, waveform: str, tick_us: int, ticks: int, depth: float, warned: bool
) -> Measurement:
    """The lamp alone, then the shutter's halves in turn: events wrong, warnings wrong."""
    table = {"light": "lamp", "waveform": waveform, "hz": hz, "depth": depth, "duty": 0.5}
    total = ticks + CLOSED_TICKS

    def act(tick: int, world: World) -> None:
        half = tick // 3 % 2
        world.data.mocap_pos[0] = (-30.0 * half, 0, 4) if tick >= ticks else (50, 0, 4)

    seen = capture(
        LAMP,
        total * tick_us / 1e6,
        {
            "sensor": {"width": SIDE_PX, "height": SIDE_PX},
            "scene": {"tick_us": tick_us},
            "render": {"flicker": [table]},
        },
        act,
    )
    level = LIT * _means(hz, waveform, depth, tick_us, total)
    for tick in range(ticks + 1, total + 1):
        level[tick] = GLOW[(tick - 1) // 3 % 2] + level[tick]
    light = np.repeat(np.repeat(level[:, None, None], SIDE_PX, 1), SIDE_PX, 2)
    wrong = count_error(seen.events, light, tick_us)
    lines = [line for line in seen.warnings if "light 'lamp' pulses" in line]
    unexpected = abs(len(lines) - warned) + len(seen.warnings) - len(lines)
    return Measurement(
        wrong + unexpected,
        0,
        "events",
        (*seen.warnings, f"events {seen.report.events:,}"),
        residual_thresholds(seen.events, light[0], light[-1]) < 1.001,
    )


def _means(hz: float, waveform: str, depth: float, tick_us: int, ticks: int) -> F64:
    """(ticks + 1,) mean of the waveform over each tick, by its integral; over (-tick, 0] first."""
    ends = np.arange(-1, ticks + 1) * (tick_us * 1e-6)
    if waveform == "mains":
        turn = 2.0 * math.pi * 2.0 * hz
        integral = ends - depth / turn * np.sin(turn * ends)
    else:
        # on for half of each period, at twice the mean
        whole, rest = np.divmod(ends * hz + 1e-9, 1.0)
        integral = (1.0 - depth) * ends + depth * 2.0 * (whole / 2 + np.minimum(rest, 0.5)) / hz
    means: F64 = np.diff(integral) / (tick_us * 1e-6)
    return means


def _strobe(short: bool) -> Measurement:
    return _pulsing(10_000.0, "pwm", 1000, 20 if short else 500, 1.0, True)


def _strobe_beats(short: bool) -> Measurement:
    return _pulsing(640.0, "pwm", 1000, 25 if short else 500, 1.0, True)


def _strobe_seen(short: bool) -> Measurement:
    return _pulsing(10_000.0, "pwm", 25, 40 if short else 2000, 0.9, False)


def _mains(short: bool) -> Measurement:
    return _pulsing(50.0, "mains", 1000, 20 if short else 500, 0.3, False)


def _mains_slow_ticks(short: bool) -> Measurement:
    return _pulsing(50.0, "mains", 10_000, 10 if short else 200, 0.3, True)


CASES = (
    StressCase(
        "strobe-10-khz",
        "light",
        "a lamp switched at 10 kHz, dark between its pulses, ticks of 1 ms",
        "no event: a tick's light is the mean over 10 whole pulses; a warning names the lamp and "
        "the tick that would show it; then a shutter, event by event",
        _strobe,
    ),
    StressCase(
        "strobe-aliased",
        "light",
        "a lamp switched at 640 Hz, ticks of 1 ms: what is left of it beats with the ticks",
        "the events of the waveform's integral over each tick, one by one, and the same warning",
        _strobe_beats,
    ),
    StressCase(
        "strobe-followed",
        "light",
        "the 10 kHz lamp in ticks of 25 us, four a pulse",
        "the events of the waveform's integral over each tick, one by one, no warning",
        _strobe_seen,
    ),
    StressCase(
        "mains",
        "light",
        "a lamp on 50 Hz mains, light that swings by 30 % a hundred times a second",
        "the events of the waveform's integral over each tick, one by one, no warning",
        _mains,
    ),
    StressCase(
        "mains-slow-ticks",
        "light",
        "the same lamp in ticks of 10 ms, one a pulse",
        "no event, a warning that gives the tick to take; then a shutter, event by event",
        _mains_slow_ticks,
    ),
)
