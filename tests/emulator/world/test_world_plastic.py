"""Plastic deformation, MuJoCo 4's own state, in saved states and snapshots."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from evs.emulator import World

JOINT, TENDON, FLEX = (
    """<body pos="0 0 1"><joint axis="0 1 0" stiffness="5" springyield="2"/>
    <geom type="capsule" fromto="0 0 0 .4 0 0" size=".05"/></body>""",
    """<body pos="0 0 1"><joint name="j" axis="0 1 0"/>
    <geom type="capsule" fromto="0 0 0 .4 0 0" size=".05"/></body>""",
    """<flexcomp name="sheet" type="grid" dim="2" count="4 4 1" spacing=".1 .1 .1" pos="0 0 .6"
    radius=".01" mass=".5"><pin id="0 1 2 3"/><contact selfcollide="none"/>
    <elasticity young="3e3" damping=".001" poisson=".2" thickness=".02"
    elastic2d="both" yield="1e-4 1e-4"/></flexcomp>""",
)
CABLE = (
    '<tendon><fixed stiffness="5" springlength="0 0" springyield=".05"><joint joint="j" coef="1"/>'
    "</fixed></tendon>"
)


@pytest.mark.skipif(not hasattr(mujoco.MjModel, "nplastic"), reason="MuJoCo 4 brought it")
@pytest.mark.parametrize(
    ("body", "more"), [(JOINT, ""), (TENDON, CABLE), (FLEX, "")], ids=["joint", "tendon", "flex"]
)
def test_a_bent_spring_stays_bent_after_restore(body: str, more: str) -> None:
    model = mujoco.MjModel.from_xml_string(
        f"""<mujoco><option timestep=".001" solver="CG"/><worldbody><light pos="0 0 3"/>
        <camera name="eye" pos="0 -2 .5" xyaxes="1 0 0 0 .2 1"/>
        <geom type="plane" size="2 2 .1"/>{body}</worldbody>{more}</mujoco>"""
    )

    def world() -> World:
        made = World(model)
        made.add_camera("eye", sensor="ideal")
        return made

    one, other = world(), world()
    for _ in range(150):
        one.step()
    blob, bent = one.save(), np.array(one.data.plastic)
    assert np.abs(bent).max() > 0.0
    other.restore(blob)
    assert np.array_equal(other.data.plastic, bent)
    for _ in range(20):
        (a,), (b,) = one.step(), other.step()
        assert np.array_equal(a.events, b.events)
    assert np.array_equal(one.data.qpos, other.data.qpos)
    assert np.array_equal(one.data.plastic, other.data.plastic)
    # and a reset makes it straight again
    other.reset()
    assert not other.data.plastic.any()
