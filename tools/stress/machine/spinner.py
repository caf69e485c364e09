"""A bar that spins by physics alone, for the stress cases of the machine."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from evs.msgs import Events
from evs.tools.stress.capture import Capture, capture

SPINNER = """<mujoco><option gravity="0 0 0"/><visual><headlight active="0"/></visual><worldbody>
<light directional="true" dir="0.3 1 -0.2" diffuse="1 1 1" specular="0 0 0"/>
<camera name="eye" pos="0 -3 0" xyaxes="1 0 0 0 0 1" fovy="45"/>
<geom type="box" pos="0 1 0" size="9 .1 9" rgba=".8 .8 .8 1"/>
<body><joint type="hinge" axis="0 1 0"/><geom type="box" size=".6 .1 .06" rgba=".2 .3 .1 1"/></body>
<body pos="62 0 0"><joint type="slide" axis="1 0 0"/>
<geom type="box" size="40 .2 20" rgba="0 0 0 1"/></body>
</worldbody><keyframe><key name="calm" qvel="30 0"/><key name="doom" qvel="30 -1000"/></keyframe>
</mujoco>"""
"""Key calm: the bar spins. Key doom: besides, after 20 ms, all goes dark within 4 ms."""

DOOM_TICK = 20
"""so many ticks of it are as calm as the others"""

TABLES: dict[str, Any] = {
    "scene": {"keyframe": "calm"},
    "sensor": {"preset": "davis346", "width": 96, "height": 72},
}
"""of the pipeline: a DAVIS346's pixels with their noise, and its readout"""


def spun(seconds: float, tables: Mapping[str, Any] | None = None, **more: Any) -> Capture:
    """Capture it. In: tables, over TABLES; more, for `capture`."""
    return capture(SPINNER, seconds, {**TABLES, **(tables or {})}, **more)


def differing(a: Events, b: Events) -> int:
    """How many events of one are not those of the other; all are where there are none at all."""
    if not (len(a) and len(b)):
        return max(1, len(a), len(b))
    both = min(len(a), len(b))
    return int(np.count_nonzero(a[:both] != b[:both])) + abs(len(a) - len(b))
