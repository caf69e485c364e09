"""The raster renderer beside ground truth and colour: it traces the one and refuses the other."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from evs.emulator.config import CameraConfig, RenderConfig
from evs.emulator.render import make_renderer
from evs.emulator.world import SnapshotTaker, bind_camera, extract_scene
from evs.msgs import EvsError

SCENE = """
<mujoco><worldbody>
  <light pos="0 0 3" dir="0 0 -1"/>
  <geom type="plane" size="0 0 .1"/>
  <body pos="0 0 .5"><freejoint/><geom type="sphere" size=".3"/></body>
</worldbody></mujoco>"""
VIEW = CameraConfig(lookat=(0, 0, 0.4), distance=2, elevation=-30)


def test_colour_is_refused_in_one_line() -> None:
    model = mujoco.MjModel.from_xml_string(SCENE)
    bound, config = bind_camera(model, "", 8, 8), RenderConfig(renderer="raster")
    with pytest.raises(EvsError, match=r"raster gives no colour.*render\.renderer=direct"):
        make_renderer(extract_scene(model), bound.model, config, 1, rgb=True)


@pytest.mark.slow
def test_ground_truth_is_the_tracers_own() -> None:
    model = mujoco.MjModel.from_xml_string(SCENE)
    data, bound = mujoco.MjData(model), bind_camera(model, "", 40, 30, VIEW)
    poser, scene = SnapshotTaker(model, [bound]), extract_scene(model)
    before = poser.snapshot(data, 0)
    data.qpos[0] = 0.01
    now = poser.snapshot(data, 1000)
    truths = [
        make_renderer(scene, bound.model, RenderConfig(renderer=name, spp=1), 1).ground_truth(
            now, now.cameras[0], (before, before.cameras[0])
        )
        for name in ("raster", "direct")
    ]
    assert (truths[1].body_id == 1).sum() > 50
    for name in ("depth", "normal", "geom_id", "flow"):
        np.testing.assert_array_equal(*(getattr(truth, name) for truth in truths))
