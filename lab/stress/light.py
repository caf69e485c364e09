"""Stress cases of light: any strength, the sun, lamps that pulse, numbers that are no light."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from evs.emulator import World
from evs.emulator.base.scene import F32, F64
from evs.emulator.world import ORTHOGRAPHIC
from evs.msgs import EvsError
from evs_lab.stress.capture import Capture, capture, differing
from evs_lab.stress.closed_form import count_error, residual_thresholds
from evs_lab.stress.grid_target import FLASH_PX, GridCapture, capture_flashes, capture_grid
from evs_lab.stress.stress_case import Measurement, StressCase

SUN = 1.6e9 * math.pi / 1000.0
"""The sun's disc, 1.6e9 cd/m^2, in units of light: white under 1000 lux is 1."""

USUAL = (0.5, 0.05, 0.9, 0.9, 0.004, 0.5, 1.0)
"""ordinary light, which a stream has to get right after an extreme"""

DARK_LINE = "sees no lit surface"


def _judged(shown: GridCapture, warnings: int = 0, more: tuple[str, ...] = ()) -> Measurement:
    """Count the wrong events, and one more for each unexpected or missing warning and clamp."""
    seen = shown.capture
    unexpected = abs(len(seen.warnings) - warnings) + seen.report.clamps
    messages = (*seen.warnings, f"{seen.report.events:,} events", *more)
    return Measurement(shown.wrong + unexpected, 0, "wrong events", messages, shown.is_explained)


def _no_light(short: bool) -> Measurement:
    shown = capture_flashes([0.0] * (10 if short else 100) + list(USUAL))
    measurement = _judged(shown, warnings=1)
    return measurement if DARK_LINE in "".join(measurement.messages) else Measurement(math.inf, 0)


def _denormal(short: bool) -> Measurement:
    denormal = [1e-40, 0.0, 1e-44, 1e-39, 1e-38, 1.4e-45] * (2 if short else 20)
    return _judged(capture_flashes([*denormal, *USUAL]), warnings=1)


def _decades(short: bool) -> Measurement:
    levels = [10.0**k for k in range(-9, 7)]
    width = len(levels) // 2
    # to the left and back, a plate a tick
    firsts = [width - abs(width - k % (2 * width)) for k in range(17 if short else 161)]
    return _judged(capture_grid(levels, firsts, width))


def _black_to_sun(short: bool) -> Measurement:
    times = 1 if short else 10
    shown = capture_flashes([*[0.0, 0.0, SUN, SUN, 0.0] * times, *USUAL])
    events = shown.capture.events
    sun = events[(events["t"] > 2000) & (events["t"] <= 3000)]
    # all of them inside the tick, in order, and not all at one instant
    crowded = float(len(np.unique(sun["t"])) < 50 or bool((np.diff(events["t"]) < 0).any()))
    measurement = _judged(shown, warnings=1)
    each = len(sun) // shown.light[0].size
    more = (*measurement.messages, f"{each} events per pixel in the tick of the sun")
    return Measurement(measurement.value + crowded, 0, "wrong events", more, measurement.recovered)


SUN_WIDTH_PX, SUN_HEIGHT_PX, SUN_TICK_US = 32, 24, 1000
SUN_DISTANCE_M, SUN_RADIUS_M = 1000.0, 4.65
"""how far away, and how large at that distance: 0.533 degrees across"""

SUN_SCENE = f"""<mujoco><option timestep="1000"/><statistic extent="1" center="0 0 0"/><asset>
<material name="sun" rgba="1 1 1 1" emission="{SUN!r}"/><material name="cloth" rgba=".6 .5 .4 1"/>
</asset><worldbody><camera name="eye" pos="0 0 0" xyaxes="1 0 0 0 0 1" fovy="8"/>
<geom type="plane" size="0 0 1" pos="0 0 -3"/><geom type="box" size="400 1 400" pos="0 900 0"
 rgba=".3 .4 .6 1"/>
<body name="sun" mocap="true"><geom size="{SUN_RADIUS_M}" material="sun"/></body>
<body name="box" mocap="true"><geom type="box" size=".5 .5 .5" material="cloth"/></body>
</worldbody></mujoco>"""
"""8 degrees over 24 px: the disc is 1.6 px wide; a sky as a wall behind, before which it stands"""


def _capture_sun(ticks: int, sun: bool) -> tuple[Capture, F64]:
    """Capture the scene with or without the sun; its light has the shape (ticks + 1, h, w)."""
    light: list[F64] = []

    def act(tick: int, world: World) -> None:
        if tick:
            light.append(np.asarray(world.cameras[0].luminance, np.float64))
        # from left to right in two thirds of the time
        along = 1.5 * tick / ticks
        x = (-140.0 + 280.0 * along) if sun and along < 1.0 else 5000.0
        world.data.mocap_pos[0] = 0.8 * np.array([x, SUN_DISTANCE_M, 30.0])
        world.data.mocap_pos[1] = (-1.0 + 2.0 * tick / ticks, 30.0, -1.5)

    sensor = {"width": SUN_WIDTH_PX, "height": SUN_HEIGHT_PX}
    seen = capture(SUN_SCENE, ticks * SUN_TICK_US / 1e6, {"sensor": sensor}, act)
    return seen, np.array([light[0], *light])


def _sun_disc(short: bool) -> Measurement:
    ticks = 60 if short else 600
    (shone, light), (usual, plain) = (_capture_sun(ticks, sun) for sun in (True, False))
    touched = (light != plain).any(0)
    outside = np.setxor1d(
        *(one.events[~touched[one.events["y"], one.events["x"]]] for one in (shone, usual))
    )
    wrong = count_error(shone.events, light, SUN_TICK_US)
    # a pixel in the middle of the disc sees the sun's own light, nothing is clipped
    clipped = not np.isclose(light.max(), SUN, rtol=1e-5)
    path = float(touched.mean())
    value = len(outside) + wrong + clipped + (not 0.05 < path < 0.5)
    same_end = bool(np.array_equal(light[-1], plain[-1]))
    explained = residual_thresholds(shone.events, light[0], light[-1]) < 1.001
    messages = (
        *shone.warnings,
        f"{shone.report.events:,} events, without the sun {usual.report.events:,}",
        f"{100 * path:.0f} % of the pixels are on its path",
    )
    return Measurement(value, 0, "wrong events", messages, explained and same_end)


LAMP_PX = 8

LAMP_SCENE = f"""<mujoco><option timestep="1000"/><visual><headlight active="0"/></visual>
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
"""A lamp on white; a shutter whose two halves glow and also reflect the lamp."""

LIT, GLOW, CLOSED_TICKS = 0.5, {0: 3.0, 1: 0.2}, 12
"""the lamp's light on white without pulses; the halves of the shutter; ticks at the end"""


def _pulsing(
    hz: float, waveform: str, tick_us: int, ticks: int, depth: float, warned: bool
) -> Measurement:
    """Show the lamp alone, then each half of the shutter: wrong events and warnings."""
    table = {"light": "lamp", "waveform": waveform, "hz": hz, "depth": depth, "duty": 0.5}
    total = ticks + CLOSED_TICKS

    def act(tick: int, world: World) -> None:
        half = tick // 3 % 2
        world.data.mocap_pos[0] = (-30.0 * half, 0, 4) if tick >= ticks else (50, 0, 4)

    seen = capture(
        LAMP_SCENE,
        total * tick_us / 1e6,
        {
            "sensor": {"width": LAMP_PX, "height": LAMP_PX},
            "scene": {"tick_us": tick_us},
            "render": {"flicker": [table]},
        },
        act,
    )
    level = LIT * _means(hz, waveform, depth, tick_us, total)
    for tick in range(ticks + 1, total + 1):
        level[tick] = GLOW[(tick - 1) // 3 % 2] + level[tick]
    light = np.repeat(np.repeat(level[:, None, None], LAMP_PX, 1), LAMP_PX, 2)
    wrong = count_error(seen.events, light, tick_us)
    lines = [line for line in seen.warnings if "light 'lamp' pulses" in line]
    unexpected = abs(len(lines) - warned) + len(seen.warnings) - len(lines)
    return Measurement(
        wrong + unexpected,
        0,
        "wrong events",
        (*seen.warnings, f"{seen.report.events:,} events"),
        residual_thresholds(seen.events, light[0], light[-1]) < 1.001,
    )


def _means(hz: float, waveform: str, depth: float, tick_us: int, ticks: int) -> F64:
    """Mean of the waveform over each tick, by its integral.

    Returns:
        (ticks + 1,), the first over (-tick, 0].
    """
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


PLACES = {
    "emission of material 'wall'": '<material name="wall" emission="{}"/>',
    "rgba of material 'wall'": '<material name="wall" rgba="1 {} 1 1"/>',
    "diffuse of light 'lamp'": '<light name="lamp" diffuse="{} 1 1"/>',
    "reflectance of material 'wall'": '<material name="wall" reflectance="{}"/>',
}
"""what is invalid, as an error names it -> MJCF"""

INVALID_SCENE = """<mujoco><visual><headlight active="{}"/></visual><asset>{}</asset><worldbody>{}
<camera name="eye" pos="0 0 9"/><geom size="3" material="wall"/>
<body mocap="true"><geom size=".5"/></body></worldbody></mujoco>"""

NO_LIGHT = (math.nan, math.inf, -math.inf, -1.0, 3e38)
"""values that no light has; the last one overflows float32 once it is in DN"""


def _invalid_scene(part: str, headlight: int = 1) -> str:
    if part.startswith("<material"):
        return INVALID_SCENE.format(headlight, part, "")
    return INVALID_SCENE.format(headlight, '<material name="wall"/>', part)


def _bad_material(short: bool) -> Measurement:
    """Count the bad numbers that are neither refused by name nor shown as their clipped value."""
    missed, messages = 0, []
    places = dict(list(PLACES.items())[:2]) if short else PLACES
    for what, part in places.items():
        for number in ("nan", "inf", "-inf"):
            try:
                capture(_invalid_scene(part.format(number)), 0.002)
                missed += 1
            except EvsError as refusal:
                line = str(refusal)
                messages.append(line)
                # in one line, by its name and with what to give
                missed += not (what in line and "give" in line and "\n" not in line)
        # MuJoCo's viewer cuts it to 0
        below, zero = (
            capture(_invalid_scene(part.format(number)), 0.002).world.cameras[0].luminance
            for number in ("-1", "0")
        )
        missed += not np.array_equal(below, zero)
    usual = capture(_invalid_scene('<material name="wall"/>'), 0.002)
    return Measurement(
        missed, 0, "bad numbers missed", tuple(dict.fromkeys(messages)), usual.report.clamps == 0
    )


class _FaultyRenderer:
    """A renderer whose light is invalid in some ticks; all else is the renderer's own."""

    def __init__(self, renderer: Any, is_faulty: Callable[[int], bool]) -> None:
        self._renderer, self._is_faulty, self._calls = renderer, is_faulty, -1

    def __getattr__(self, name: str) -> Any:
        return getattr(self._renderer, name)

    def render(self, *scene: Any) -> F32:
        """Render; while the renderer is broken, rows 1 to 5 hold NO_LIGHT."""
        self._calls += 1
        light: F32 = np.array(self._renderer.render(*scene))
        if self._is_faulty(self._calls):
            light[1 : 1 + len(NO_LIGHT)] = np.array(NO_LIGHT, np.float32)[:, None]
        return light


def _broken_renderer(short: bool) -> Measurement:
    ticks = 5 if short else 100
    levels = [*[0.5] * (ticks + 3), 0.05, 0.9, 0.004, 0.5, 1.0]

    def corrupt(world: World) -> None:
        camera = world.cameras[0]
        # no scene makes our renderers give this: one that breaks is put in its place
        seen = camera._viewpoint
        faulty = _FaultyRenderer(seen.renderer, lambda call: 2 <= call < 2 + ticks)
        camera._viewpoint = seen._replace(renderer=faulty)

    clean, broken = capture_flashes(levels), capture_flashes(levels, first=corrupt)
    wrong = differing(clean.capture, broken.capture)
    clamps = broken.capture.report.clamps
    expected = ticks * len(NO_LIGHT) * FLASH_PX
    lines = [line for line in broken.capture.warnings if "out of range and were replaced" in line]
    value = wrong + abs(clamps - expected) + abs(len(lines) - 1) + clean.capture.report.clamps
    messages = (*broken.capture.warnings, f"clamps: {clamps:,}")
    return Measurement(value, 0, "wrong events or clamps", messages, broken.is_explained)


CASES = (
    StressCase(
        "no-light",
        "light",
        "a picture without any light, then normal light",
        "no events without light, then events that match ln(light) one by one; one warning that "
        "no lit surface is in view",
        _no_light,
    ),
    StressCase(
        "denormal-light",
        "light",
        "light of 1e-45 ... 1e-38 (denormal in float32) that changes every ms, then normal light",
        "no events in denormal light, because log light is linear below e DN and its changes are "
        "1e-36 of a threshold; then events that match ln(light) one by one",
        _denormal,
    ),
    StressCase(
        "fifteen-decades",
        "light",
        "stripes of light from 1e-6 to 1e9 lux (1e-9 to 1e6 times white) that move back and "
        "forth, so that each pixel's light changes by a decade per ms",
        "ln(10) / threshold = 11.5 events per decade: each pixel's event count in each tick is "
        "that of the exact logarithm",
        _decades,
    ),
    StressCase(
        "black-to-sun",
        "light",
        "from darkness to the sun's disc (1.6e9 cd/m2) on every pixel in one tick, and back",
        "floor(ln(DN) / threshold) = 104 events per pixel within the tick, and as many on the way "
        "back; then normal light, with events that match ln(light) one by one",
        _black_to_sun,
    ),
    StressCase(
        "sun-in-view",
        "light",
        "the sun's disc (1.6e9 cd/m2, 0.53 degrees, 1.6 px wide) crosses a lit scene",
        "pixels off its path give the same bytes as without the sun; the events of the pixels on "
        "its path match ln(light) one by one; the centre of the disc has its full luminance; "
        "afterwards, the picture is the same as without the sun",
        _sun_disc,
    ),
    StressCase(
        "strobe-10-khz",
        "light",
        "a lamp that pulses at 10 kHz and is dark between its pulses, in ticks of 1 ms",
        "no events, because the light of a tick is the mean over 10 whole pulses; a warning names "
        "the lamp and the tick length that would show the pulses; then a shutter closes, and its "
        "events match ln(light) one by one",
        _strobe,
    ),
    StressCase(
        "strobe-aliased",
        "light",
        "a lamp that pulses at 640 Hz, in ticks of 1 ms: a tick is not a whole number of pulses, "
        "so ticks and pulses beat",
        "the events match the waveform's integral over each tick one by one; the same warning",
        _strobe_beats,
    ),
    StressCase(
        "strobe-followed",
        "light",
        "the 10 kHz lamp in ticks of 25 us, four per pulse",
        "the events match the waveform's integral over each tick one by one; no warning",
        _strobe_seen,
    ),
    StressCase(
        "mains",
        "light",
        "a lamp on 50 Hz mains, whose light swings by 30 % a hundred times per second",
        "the events match the waveform's integral over each tick one by one; no warning",
        _mains,
    ),
    StressCase(
        "mains-slow-ticks",
        "light",
        "the same lamp in ticks of 10 ms, one per pulse",
        "no events, and a warning that recommends a tick length; then a shutter closes, and its "
        "events match ln(light) one by one",
        _mains_slow_ticks,
    ),
    StressCase(
        "bad-material",
        "light",
        "NaN, infinite and negative numbers in materials and lights",
        "NaN and infinite numbers are rejected with a one-line message that names the material or "
        "light; negative numbers are shown as 0, as in MuJoCo's viewer",
        _bad_material,
    ),
    StressCase(
        "no-light-at-all",
        "light",
        "a renderer that returns NaN, infinite, negative or far too strong light for a while",
        "each such value is replaced by the pixel's last light and counted; one warning; the "
        "events are those of a run without faults",
        _broken_renderer,
    ),
)
