"""Light that pulses faster than half the ticks is told of, by name and with the fix."""

from __future__ import annotations

import warnings
from pathlib import Path

import pytest

from evs.emulator import LeftOutWarning, World
from evs.emulator.base.scene import Light, LightKind
from evs.emulator.config import FlickerConfig, RenderConfig
from evs.emulator.render import flicker_warnings

LAMPS = """<mujoco><visual><headlight active="0"/></visual><worldbody><camera pos="0 0 3"/>
<light name="left" dir=".3 0 -1"/><light name="right" dir="-.3 0 -1"/>
<geom type="plane" size="9 9 .1"/></worldbody></mujoco>"""


@pytest.mark.parametrize(
    ("hz", "form", "tick_us", "told"),
    [
        (10_000.0, "pwm", 1000, "scene.tick_us to 50 or less"),
        (501.0, "sine", 1000, "scene.tick_us to 998 or less"),
        (251.0, "mains", 1000, "502 times a second"),
        (1e6, "sine", 1000, "no tick is short enough"),
        (500.0, "sine", 1000, ""),
        (250.0, "mains", 1000, ""),
        (10_000.0, "pwm", 50, ""),
        (50.0, "mains", 10_000, "scene.tick_us to 5000 or less"),
    ],
)
def test_over_half_the_ticks_is_told_of(
    tmp_path: Path, hz: float, form: str, tick_us: int, told: str
) -> None:
    scene = tmp_path / "lamps.xml"
    scene.write_text(LAMPS)
    render = RenderConfig(flicker=(FlickerConfig(light="left", waveform=form, hz=hz),))
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        world = World(scene, tick_us=tick_us)
        world.add_camera(render=render)
        world.add_camera(render=render)
    assert [warning.category for warning in said] == [LeftOutWarning] * (2 if told else 0)
    # two cameras of the same light have one line
    assert len(world.left_out) == bool(told)
    for line in world.left_out:
        assert line.startswith("light 'left' pulses")
        assert told in line
        assert {str(warning.message) for warning in said} == {line}


@pytest.mark.parametrize(
    "tables",
    [
        (FlickerConfig(light="lamp", hz=1e4, depth=0.0),),
        (FlickerConfig(light="lamp", hz=1e4, waveform="pwm", duty=1.0),),
        # every light has a table of its own, so "*" is nobody's
        (FlickerConfig(light="*", hz=1e4), FlickerConfig(light="lamp", hz=10.0)),
    ],
)
def test_light_that_does_not_pulse_is_not(tables: tuple[FlickerConfig, ...]) -> None:
    lamp = Light(LightKind.POINT, name="lamp")
    assert flicker_warnings([lamp], RenderConfig(flicker=tables), 1000) == ()


def test_a_headlight_that_is_off_is_not() -> None:
    head = Light(LightKind.DIRECTIONAL, name="headlight", headlight=True)
    tables = (FlickerConfig(light="headlight", hz=1e4),)
    assert flicker_warnings([head], RenderConfig(flicker=tables, headlight="off"), 1000) == ()
    assert len(flicker_warnings([head], RenderConfig(flicker=tables), 1000)) == 1
