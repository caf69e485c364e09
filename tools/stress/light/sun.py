"""The sun's disc goes through the picture of a scene that is lit as usual."""

from __future__ import annotations

import numpy as np

from evs.emulator import World
from evs.emulator.base.scene import F64
from evs.tools.stress.capture import Capture, capture
from evs.tools.stress.closed_form import count_error, residual_thresholds
from evs.tools.stress.light.levels import SUN
from evs.tools.stress.stress_case import Measurement, StressCase

WIDTH_PX, HEIGHT_PX, TICK_US = 32, 24, 1000
SUN_M, SUN_RADIUS_M = 1000.0, 4.65
"""how far away, and how large at that distance: 0.533 degrees across"""

SCENE = f"""<mujoco><option timestep="1000"/><statistic extent="1" center="0 0 0"/><asset>
<material name="sun" rgba="1 1 1 1" emission="{SUN!r}"/><material name="cloth" rgba=".6 .5 .4 1"/>
</asset><worldbody><camera name="eye" pos="0 0 0" xyaxes="1 0 0 0 0 1" fovy="8"/>
<geom type="plane" size="0 0 1" pos="0 0 -3"/><geom type="box" size="400 1 400" pos="0 900 0"
 rgba=".3 .4 .6 1"/>
<body name="sun" mocap="true"><geom size="{SUN_RADIUS_M}" material="sun"/></body>
<body name="box" mocap="true"><geom type="box" size=".5 .5 .5" material="cloth"/></body>
</worldbody></mujoco>"""
"""8 degrees over 24 px: the disc is 1.6 px wide; a sky as a wall behind, before which it stands"""


def _captured(ticks: int, sun: bool) -> tuple[Capture, F64]:
    """The capture and its light, (ticks + 1, h, w), with or without the sun."""
    light: list[F64] = []

    def act(tick: int, world: World) -> None:
        if tick:
            light.append(np.asarray(world.cameras[0].luminance, np.float64))
        # from left to right in two thirds of the time
        along = 1.5 * tick / ticks
        x = (-140.0 + 280.0 * along) if sun and along < 1.0 else 5000.0
        world.data.mocap_pos[0] = 0.8 * np.array([x, SUN_M, 30.0])
        world.data.mocap_pos[1] = (-1.0 + 2.0 * tick / ticks, 30.0, -1.5)

    seen = capture(
        SCENE, ticks * TICK_US / 1e6, {"sensor": {"width": WIDTH_PX, "height": HEIGHT_PX}}, act
    )
    return seen, np.array([light[0], *light])


def _sun_disc(short: bool) -> Measurement:
    ticks = 60 if short else 600
    (shone, light), (usual, plain) = (_captured(ticks, sun) for sun in (True, False))
    touched = (light != plain).any(0)
    outside = np.setxor1d(
        *(one.events[~touched[one.events["y"], one.events["x"]]] for one in (shone, usual))
    )
    wrong = count_error(shone.events, light, TICK_US)
    # a pixel in the middle of the disc sees the sun's own light, nothing is clipped
    clipped = not np.isclose(light.max(), SUN, rtol=1e-5)
    path = float(touched.mean())
    value = len(outside) + wrong + clipped + (not 0.05 < path < 0.5)
    same_end = bool(np.array_equal(light[-1], plain[-1]))
    explained = residual_thresholds(shone.events, light[0], light[-1]) < 1.001
    messages = (
        *shone.warnings,
        f"events {shone.report.events:,}, without the sun {usual.report.events:,}",
        f"{100 * path:.0f} % of the pixels are in its way",
    )
    return Measurement(value, 0, "events", messages, explained and same_end)


CASES = (
    StressCase(
        "sun-in-view",
        "light",
        "the sun's disc (1.6e9 cd/m2, 0.53 degrees, 1.6 px wide) crosses a lit scene",
        "pixels beside its way give the bytes of a film without it; those in it the events of "
        "ln(light), one by one; its middle has its whole light; then the picture is as before",
        _sun_disc,
    ),
)
