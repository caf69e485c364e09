"""A kinematic scene through MuJoCo: the same bytes on every MuJoCo and NumPy that evs supports.

The digest changes only when light or pixel are meant to change: look at the pictures first, then
write the new one here. `sh .ci/versions.sh` runs this on the other versions.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterator

import mujoco
import numpy as np
import pytest

from evs.emulator import EventCamera
from evs.emulator.config import CameraConfig, RenderConfig, SensorConfig
from evs.emulator.world import ORTHOGRAPHIC
from evs.msgs import Events, join_events

pytestmark = pytest.mark.golden

DIGESTS = {
    "direct": "9a1b040282f98b49",
    "path": "52476f0b4e82de3e",
    "path cycle": "7fe0e03e9a8cf5b6",
    "path cycle adaptive": "0fe667a7f13ab907",
}
"""renderer, seeds and antialiasing -> digest of the light and events of all cameras"""

MOTION_TICKS = 30

# numbers that floats hold exactly, so that no compiler rounds them in its own way
SCENE = f"""<mujoco>
<compiler angle="radian"/><statistic extent="4" center="0 0 0.5"/>
<visual><headlight ambient=".125 .125 .125" diffuse=".25 .25 .25" specular="0 0 0"/></visual>
<asset>
<texture name="checker" type="2d" builtin="checker" rgb1=".25 .25 .25" rgb2=".75 .75 .75"
 width="16" height="16"/>
<material name="floor" texture="checker" texrepeat="2 2" texuniform="true" reflectance=".25"/>
<material name="paint" rgba=".75 .5 .25 1" specular=".5" shininess=".25"/>
<mesh name="block" vertex="-.25 -.25 -.25 .25 -.25 -.25 -.25 .25 -.25 .25 .25 -.25
 -.25 -.25 .25 .25 -.25 .25 -.25 .25 .25 .25 .25 .25"/>
<hfield name="hill" nrow="3" ncol="3" size="1 1 .5 .25" elevation="0 0 0 0 1 0 0 0 0"/>
</asset>
<worldbody>
<light directional="true" dir="0 0 -1" pos="0 0 4" diffuse=".25 .25 .25" specular="0 0 0"/>
<light pos="0 -.5 3" dir="0 0 -1" diffuse=".5 .5 .5" cutoff="60" exponent="2"/>
<geom type="plane" size="4 4 .125" material="floor"/>
<geom type="hfield" hfield="hill" pos="1 2 0" material="paint"/>
<camera name="fixed" pos="0 -3 1.5" xyaxes="1 0 0 0 .5 1" fovy="60"/>
<camera name="flat" pos="0 0 4" {ORTHOGRAPHIC} fovy="4"/>
<body pos="-1 0 .5"><joint type="slide" axis="1 0 0"/>
<geom type="sphere" size=".25" rgba="1 0 0 1"/>
<body pos="0 .5 0"><joint type="slide" axis="0 0 1"/>
<geom type="capsule" size=".125 .25" material="paint"/></body></body>
<body pos="1 0 .5"><joint type="slide" axis="0 1 0"/><geom type="box" size=".25 .125 .25"/>
<geom type="cylinder" size=".125 .25" pos="0 -.5 0" rgba="0 .5 1 .5"/>
<camera name="carried" pos="0 -2 .5" xyaxes="1 0 0 0 0 1" fovy="45"/></body>
<body pos="0 0 1"><joint type="slide" axis="0 1 0"/>
<geom type="ellipsoid" size=".25 .125 .5"/></body>
<body pos="0 1 .5" mocap="true"><geom type="mesh" mesh="block" material="paint"/></body>
</worldbody></mujoco>"""

CAMERAS = (
    "fixed",
    "flat",
    "carried",
    CameraConfig(lookat=(0, 0, 0.5), distance=3, azimuth=90, elevation=0),
)


def seen(
    renderer: str, seeds: str = "fixed", antialiasing: str = "fixed"
) -> Iterator[tuple[bytes, Events]]:
    """Last light and all events of each camera."""
    model = mujoco.MjModel.from_xml_string(SCENE)
    for camera in CAMERAS:
        data = mujoco.MjData(model)
        sensor = EventCamera(
            model,
            camera,
            sensor=SensorConfig("ideal", width=48, height=36),
            render=RenderConfig(
                renderer=renderer,
                spp=4 if antialiasing == "adaptive" else 2,
                antialiasing=antialiasing,
                seeds=seeds,
            ),
            threads=1,
        )
        parts = []
        for tick in range(MOTION_TICKS + 1):
            data.time = tick * 1e-3
            data.qpos[:] = np.array([1, 2, -1, 3]) * tick / 256
            data.mocap_pos[0] = (tick / 512, 1, 0.5)
            parts.append(sensor.observe(data))
        yield sensor.luminance.tobytes(), join_events(parts)


@pytest.mark.parametrize("renderer", DIGESTS)
def test_a_kinematic_scene_has_the_bytes_it_always_had(renderer: str) -> None:
    digest, count = hashlib.sha256(), 0
    for light, events in seen(*renderer.split()):
        digest.update(light)
        digest.update(events.tobytes())
        count += len(events)
    assert count > 1000
    assert digest.hexdigest()[:16] == DIGESTS[renderer]
