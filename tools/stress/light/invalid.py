"""Light that cannot be: NaN, infinite or negative numbers in a model, a renderer that breaks."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from evs.emulator import World
from evs.emulator.base.scene import F32
from evs.msgs import EvsError
from evs.tools.stress.capture import capture, differing
from evs.tools.stress.grid_target import FLASH_PX, capture_flashes
from evs.tools.stress.stress_case import Measurement, StressCase

PLACES = {
    "emission of material 'wall'": '<material name="wall" emission="{}"/>',
    "rgba of material 'wall'": '<material name="wall" rgba="1 {} 1 1"/>',
    "diffuse of light 'lamp'": '<light name="lamp" diffuse="{} 1 1"/>',
    "reflectance of material 'wall'": '<material name="wall" reflectance="{}"/>',
}
"""what is bad -> how a model says it"""

SCENE = """<mujoco><visual><headlight active="{}"/></visual><asset>{}</asset><worldbody>{}
<camera name="eye" pos="0 0 9"/><geom size="3" material="wall"/>
<body mocap="true"><geom size=".5"/></body></worldbody></mujoco>"""

NO_LIGHT = (math.nan, math.inf, -math.inf, -1.0, 3e38)
"""what no light is; the last is no float32 any more once it is in DN"""


def _scene(part: str, headlight: int = 1) -> str:
    if part.startswith("<material"):
        return SCENE.format(headlight, part, "")
    return SCENE.format(headlight, '<material name="wall"/>', part)


def _bad_material(short: bool) -> Measurement:
    """How many bad numbers are neither refused by name nor shown as what they are cut to."""
    missed, messages = 0, []
    places = dict(list(PLACES.items())[:2]) if short else PLACES
    for what, part in places.items():
        for number in ("nan", "inf", "-inf"):
            try:
                capture(_scene(part.format(number)), 0.002)
                missed += 1
            except EvsError as refusal:
                line = str(refusal)
                messages.append(line)
                # in one line, by its name and with what to give
                missed += not (what in line and "give" in line and "\n" not in line)
        # MuJoCo's viewer cuts it to 0
        below, zero = (
            capture(_scene(part.format(number)), 0.002).world.cameras[0].luminance
            for number in ("-1", "0")
        )
        missed += not np.array_equal(below, zero)
    usual = capture(_scene('<material name="wall"/>'), 0.002)
    return Measurement(
        missed, 0, "bad numbers", tuple(dict.fromkeys(messages)), usual.report.clamps == 0
    )


class _FaultyRenderer:
    """A renderer whose light is spoilt in some ticks; all else is the renderer's own."""

    def __init__(self, renderer: Any, is_faulty: Callable[[int], bool]) -> None:
        self._renderer, self._degraded, self._calls = renderer, is_faulty, -1

    def __getattr__(self, name: str) -> Any:
        return getattr(self._renderer, name)

    def render(self, *scene: Any) -> F32:
        """Rows 1 to 5 are no light."""
        self._calls += 1
        light: F32 = np.array(self._renderer.render(*scene))
        if self._degraded(self._calls):
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
    lines = [
        line for line in broken.capture.warnings if "were impossible and were replaced" in line
    ]
    value = wrong + abs(clamps - expected) + abs(len(lines) - 1) + clean.capture.report.clamps
    messages = (*broken.capture.warnings, f"clamps {clamps:,}")
    return Measurement(value, 0, "events or clamps", messages, broken.is_explained)


CASES = (
    StressCase(
        "bad-material",
        "light",
        "NaN, infinite and negative numbers in materials and lights",
        "each is refused in one line that names it; a negative one is shown as 0, as MuJoCo's "
        "viewer does",
        _bad_material,
    ),
    StressCase(
        "no-light-at-all",
        "light",
        "a renderer that gives NaN, infinite, negative or far too large light for a while",
        "each is replaced by the pixel's last light and counted, one by one; one warning; the "
        "events are those of a film in which nothing broke",
        _broken_renderer,
    ),
)
