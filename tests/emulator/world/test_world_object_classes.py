"""Everything that has a geom_id belongs to a class: its object, or what patterns say."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from evs.emulator.world import object_classes
from evs.msgs import EvsError

SCENE = """<mujoco>
<worldbody>
  <geom name="floor" type="plane" size="1 1 1"/>
  <geom type="box" size="1 1 1"/>
  <body name="robot">
    <joint type="slide"/>
    <geom name="trunk" size="0.1"/>
    <body name="hand">
      <geom name="palm" size="0.1"/>
      <body name="finger_1"><geom name="tip" size="0.1"/><site name="end"/></body>
    </body>
    <site name="base"/>
  </body>
  <body><geom size="0.1"/><geom name="lid" size="0.1"/></body>
  <body name="crank"><joint name="turn"/><geom name="wheel" size="0.1"/>
    <site name="pin" pos="0.1 0 0"/></body>
</worldbody>
<tendon><spatial name="string"><site site="base"/><site site="end"/></spatial></tendon>
<actuator>
  <motor name="push" tendon="string"/>
  <general name="slider" slidersite="base" cranksite="pin" cranklength="1"/>
</actuator>
</mujoco>"""
MODEL = mujoco.MjModel.from_xml_string(SCENE)


def classes(*patterns: str) -> dict[int | str, str]:
    """The class of every geom by its name or number, and of what lies below."""
    found = object_classes(MODEL, patterns)
    assert len(found.of_geom) == MODEL.ngeom + 1 + 3 + 1 + 2
    assert found.of_geom[-1] == -1
    assert found.of_geom.dtype == np.int32
    below = range(-2, -8, -1)
    names = {MODEL.geom(i).name or i: found.of_geom[i] for i in range(MODEL.ngeom)}
    numbers = names | {i: found.of_geom[i] for i in below}
    return {key: "" if number < 0 else found.names[number] for key, number in numbers.items()}


def test_an_object_is_what_hangs_on_one_body_of_the_world() -> None:
    geoms = {"floor": "floor", 1: "geom 1", 5: "body 4", "lid": "body 4", "wheel": "crank"}
    robot = dict.fromkeys(("trunk", "palm", "tip"), "robot")
    # sites, tendon, motor, slider-crank
    others = {-2: "robot", -3: "robot", -4: "crank", -5: "string", -6: "", -7: "slider"}
    assert classes() == geoms | robot | others


def test_patterns_take_geoms_and_bodies_with_all_they_carry() -> None:
    found = classes("thumb=finger_?", "hand=hand", "arm=trunk", "rest=*")
    assert found["tip"] == "thumb"
    assert found["palm"] == "hand"
    assert found["trunk"] == "arm"
    assert {found[key] for key in ("floor", 1, 5, "lid", "wheel", -5, -7)} == {"rest"}
    # their order counts, not which name is nearer
    assert classes("hand=palm", "arm=robot")["palm"] == "hand"
    assert classes("arm=trunk", "hand=hand", "rest=robot")["tip"] == "hand"
    # one class of two patterns
    assert len(object_classes(MODEL, ("a=floor", "a=robot")).names) < len(
        object_classes(MODEL).names
    )


@pytest.mark.parametrize(
    ("pattern", "text"),
    [
        ("x=nothing", "at model.classes: 'x=nothing' matches nothing else; there is: .*floor"),
        ("floor", "'floor' is not NAME=PATTERN; for example"),
        ("=floor", "'=floor' is not"),
        ("x=", "'x=' is not"),
        ("a\nb=floor", "is not NAME=PATTERN"),
    ],
)
def test_a_wrong_pattern_is_one_line(pattern: str, text: str) -> None:
    with pytest.raises(EvsError, match=text):
        object_classes(MODEL, [pattern])


def test_a_pattern_behind_one_that_takes_all_is_refused() -> None:
    with pytest.raises(EvsError, match="'thumb=tip' matches nothing else"):
        object_classes(MODEL, ["all=*", "thumb=tip"])
