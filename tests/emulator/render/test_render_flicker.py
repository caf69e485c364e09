"""Flicker: the mean of a waveform over each tick, and that the light follows it."""

from __future__ import annotations

import re
from dataclasses import replace

import mujoco
import numpy as np
import pytest

from evs.emulator.config import FlickerConfig, RenderConfig
from evs.emulator.config.decoding import plain_config
from evs.emulator.render import NativeRenderer
from evs.emulator.render.flicker import Flicker, mean
from evs.emulator.simulation.world import World
from evs.emulator.world import extract_scene
from evs.msgs import EvsError
from reference.instants import Film

LAMPS = """<mujoco><visual><headlight ambient=".1 .1 .1" diffuse="0 0 0" specular="0 0 0"/></visual>
  <worldbody>
    <camera pos="0 0 3"/>
    <light name="left" type="directional" dir=".3 0 -1" diffuse=".5 .5 .5"/>
    <light type="directional" dir="-.3 0 -1" diffuse=".4 .4 .4"/>
    <geom type="plane" size="9 9 .1"/><geom size=".3" pos="0 0 .5"/>
  </worldbody></mujoco>"""


def waveform(table: FlickerConfig, t_s: np.ndarray) -> np.ndarray:
    """The gain at instants, from its definition."""
    if table.waveform == "mains":
        wave = np.cos(2 * np.pi * (2 * table.hz * t_s + table.phase))
        return 1 - table.depth * wave
    if table.waveform == "sine":
        return 1 + table.depth * np.sin(2 * np.pi * (table.hz * t_s + table.phase))
    on = (table.hz * t_s + table.phase) % 1 < table.duty
    return 1 - table.depth + np.where(on, table.depth / table.duty, 0.0)


@pytest.mark.parametrize("form", ["mains", "sine", "pwm"])
@pytest.mark.parametrize("hz", [0.3, 50.0, 60.0, 997.0, 12345.6])
def test_the_gain_is_the_mean_over_the_tick(form: str, hz: float) -> None:
    table = FlickerConfig(waveform=form, hz=hz, depth=0.7, duty=0.3, phase=0.2)
    points = 20_000
    # so far in, a phase in 32 bits would be lost; midpoints: a jump costs one point at most
    for begin_us in (0, 3_141_592, 36_000_000_000):
        at = (np.arange(points) + 0.5) / points * 1e-3
        # whole periods taken out first, exactly
        start = (begin_us * round(hz * 1e6)) % 10**12 / 10**12 / hz
        expected = waveform(table, start + at).mean()
        jumps = 2 * (hz * 1e-3 + 2) / points * 0.7 / 0.3 if form == "pwm" else 1e-6
        assert abs(mean(table, begin_us, begin_us + 1000) - expected) < jumps


@pytest.mark.parametrize("form", ["mains", "sine", "pwm"])
def test_the_mean_over_a_second_is_one_and_over_whole_periods_exactly(form: str) -> None:
    table = FlickerConfig(waveform=form, hz=50.0, depth=1.0, duty=0.25, phase=0.1)
    gains = [mean(table, k * 1000, k * 1000 + 1000) for k in range(1000)]
    assert np.mean(gains) == pytest.approx(1, abs=1e-12)
    assert min(gains) >= 0
    assert np.ptp(gains) > 1
    # 100 periods of 10 kHz a tick: as steady as light that does not flicker
    fast = replace(table, hz=100_000.0)
    assert {mean(fast, k * 1000, k * 1000 + 1000) for k in range(100)} == {1.0}


def test_mains_pulses_twice_in_a_period_of_the_voltage() -> None:
    table = FlickerConfig(hz=50.0, depth=0.5)
    gains = np.array([mean(table, k * 1000, k * 1000 + 1000) for k in range(200)])
    spectrum = np.abs(np.fft.rfft(gains - gains.mean()))
    # 200 ticks of 1 ms: bins of 5 Hz
    assert spectrum.argmax() * 5 == 100


def test_pwm_with_a_duty_of_one_or_no_depth_is_steady() -> None:
    for table in (
        FlickerConfig(waveform="pwm", hz=37.0, depth=1.0, duty=1.0),
        FlickerConfig(waveform="pwm", hz=37.0, depth=0.0, duty=0.3),
        FlickerConfig(waveform="sine", hz=37.0, depth=0.0),
    ):
        assert {mean(table, k * 1000, k * 1000 + 1000) for k in range(50)} == {1.0}


def test_an_instant_has_its_own_value() -> None:
    table = FlickerConfig(waveform="pwm", hz=1.0, depth=1.0, duty=0.25)
    assert [mean(table, t, t) for t in (0, 249_999, 250_000, 999_999)] == [4.0, 4.0, 0.0, 0.0]
    sine = FlickerConfig(waveform="sine", hz=1.0, depth=0.5)
    assert mean(sine, 250_000, 250_000) == pytest.approx(1.5, abs=1e-12)


def light_at(config: RenderConfig, t_us: int, exposure_us: int = 1000) -> np.ndarray:
    film = Film(LAMPS, (16, 16))
    shot = film.taker.snapshot(film.data, t_us, exposure_us)
    return NativeRenderer(film.scene, film.camera, config, 1).render(shot, shot.cameras[0])


def test_each_light_follows_its_own_table_and_a_name_beats_the_star() -> None:
    # on for the first half second only, and dark otherwise: gains of 2 and 0
    switched = FlickerConfig(waveform="pwm", hz=1.0, depth=1.0, duty=0.5)
    base = RenderConfig(spp=1)
    steady = light_at(base, 1000).astype(np.float64)
    none, left, others = (
        light_at(replace(base, flicker=tables), 600_000).astype(np.float64)
        for tables in (
            (switched,),
            (switched, FlickerConfig(light="left", depth=0.0)),
            (replace(switched, light="left"),),
        )
    )
    assert (none == 0).all()
    assert (left >= 0).all()
    assert left.max() > 0
    # light adds up
    np.testing.assert_allclose(left + others, steady, rtol=1e-5)
    numbered = replace(base, flicker=(switched, replace(switched, light="1", depth=0.0)))
    only = replace(base, flicker=(switched, replace(switched, light="headlight", depth=0.0)))
    ambient = light_at(only, 600_000).astype(np.float64)
    rest = light_at(numbered, 600_000).astype(np.float64)
    np.testing.assert_allclose(left + ambient + rest, steady, rtol=1e-5)


def test_kept_pixels_are_lit_anew_when_the_light_changes() -> None:
    film = Film(LAMPS, (40, 30))
    slow = FlickerConfig(light="left", waveform="pwm", hz=125.0, depth=1.0, duty=0.5)
    kept, full = (film.renderer(incremental=k, flicker=(slow,)) for k in (True, False))
    again = []
    for k in range(1, 20):
        shot = film.taker.snapshot(film.data, 1000 * k, 1000)
        pose = shot.cameras[0]
        before = kept.work
        assert kept.render(shot, pose).tobytes() == full.render(shot, pose).tobytes()
        after = kept.work
        again.append(sum(after[key] - before[key] for key in ("packets_traced", "packets_relit")))
    # four ticks on, four off: everything the lamp lights where the level changes, kept between
    assert again == [80 * (k % 4 == 0) for k in range(19)]


def test_a_world_gives_the_light_of_whole_ticks() -> None:
    pwm = FlickerConfig(waveform="pwm", hz=200.0, depth=1.0, duty=0.5)
    steady, flickering = (World(mujoco.MjModel.from_xml_string(LAMPS)) for _ in range(2))
    counts = []
    for world, tables in ((steady, ()), (flickering, (pwm,))):
        world.add_camera(sensor="ideal", render=RenderConfig(spp=1, flicker=tables))
        counts.append(sum(len(packets[0].events) for packets in world.run(0.03)))
    assert counts[0] == 0
    # the whole image goes on and off
    assert counts[1] > 100_000


@pytest.mark.parametrize(
    ("table", "said"),
    [
        ({"light": "lfet"}, "at render.flicker.0.light: no light 'lfet'; there is: left"),
        ({"light": "7"}, "at render.flicker.0.light"),
        ({"waveform": "square"}, "at render.flicker.0.waveform"),
        ({"hz": 0.0}, "at render.flicker.0.hz"),
        ({"hz": 1e7}, "at render.flicker.0.hz"),
        ({"depth": 1.5}, "at render.flicker.0.depth"),
        ({"duty": 0.0}, "at render.flicker.0.duty"),
        ({"phase": -1.0}, "at render.flicker.0.phase"),
    ],
)
def test_what_makes_no_sense_is_refused_with_the_key(table: dict[str, object], said: str) -> None:
    model = mujoco.MjModel.from_xml_string(LAMPS)
    with pytest.raises(EvsError, match=re.escape(said)) as error:
        Flicker(extract_scene(model).lights, (FlickerConfig(**table),))  # type: ignore[arg-type]
    assert "\n" not in str(error.value)


def test_two_tables_for_one_light_are_refused() -> None:
    lights = extract_scene(mujoco.MjModel.from_xml_string(LAMPS)).lights
    with pytest.raises(EvsError, match=r"at render.flicker.1.light: '\*' flickers twice"):
        Flicker(lights, (FlickerConfig(), FlickerConfig(hz=60.0)))


def test_tables_from_python_are_checked_too() -> None:
    config = RenderConfig(flicker=(FlickerConfig(hz=np.float32(60)),))  # type: ignore[arg-type]
    plain = plain_config(config, "render")
    assert type(plain.flicker[0].hz) is float
    for bad, says in (
        ((1,), "render.flicker.0 is 1; give a FlickerConfig"),
        (("mains",), "render.flicker.0 is 'mains'; give a FlickerConfig"),
        (FlickerConfig(), "give a tuple of FlickerConfig"),
    ):
        with pytest.raises(EvsError, match=says):
            plain_config(RenderConfig(flicker=bad), "render")  # type: ignore[arg-type]
    with pytest.raises(EvsError, match=r"render.flicker.0.hz is nan; give a finite number"):
        plain_config(RenderConfig(flicker=(FlickerConfig(hz=float("nan")),)), "render")
