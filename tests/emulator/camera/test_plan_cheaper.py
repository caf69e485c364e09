"""What is off costs less: counted in packets, trees, calls, numbers drawn and bytes, not in time.

Code paths of the tracer that only change what it computes for a ray (gloss, normals, fog, haze,
...) count nothing; their time is in lab/tests/bench/test_plan_cost.py.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from evs.emulator import _core
from evs.emulator.base.features import FEATURES, UNFORCED, Switches
from evs.emulator.evsnet.model import EvsNetModel
from evs.emulator.render import NativeRenderer
from evs.emulator.render.flicker import Flicker
from evs.emulator.sensor import SensorParameters, fixed_pattern
from evs.emulator.sensor.aps import Aps
from evs.emulator.sensor.imu import Imu
from evs.emulator.sensor.pixel import PlainModel
from evs.emulator.sensor.readout import Readout
from evs.emulator.simulation.world import World
from reference.networks import random_network
from reference.planned import NEEDS, PLAIN, Film, told

TICKS = 8


def both(film: Film, name: str, folder: Path) -> tuple[World, World]:
    """The film as it is, and with one code path forced on; both run."""
    worlds = film.world(folder), film.world(folder, on=[name])
    for world in worlds:
        told(world, TICKS)
    return worlds


def work(world: World) -> dict[str, int]:
    renderer: Any = world.cameras[0]._renderer
    return dict(renderer.work)


def test_only_what_moved_is_traced_again(tmp_path: Path) -> None:
    bare, idle = map(work, both(PLAIN, "full_retrace", tmp_path))
    whole = 12 * 9  # packets of 48 x 36 pixels
    assert idle == {
        "ticks": TICKS + 1, "packets_asked": 0, "packets_traced": whole * (TICKS + 1),
        "packets_relit": 0, "trees_built": 0, "trees_refitted": 0,
    }  # fmt: skip
    assert bare["packets_asked"] == whole * TICKS
    assert whole < bare["packets_traced"] < 0.8 * idle["packets_traced"]


def test_meshes_that_hold_still_are_built_once_and_never_fitted_again(tmp_path: Path) -> None:
    wedge = '<mesh name="wedge" vertex="0 0 0  .5 0 0  0 .5 0  0 0 .5"/>'
    shown = '<geom type="mesh" mesh="wedge" pos=".6 .5 .1"/>'
    falls = f'<body pos="0 .4 .7"><freejoint/>{shown}</body>'
    film = Film({"asset": wedge, "more": shown + falls, "rest": " 1 0 0 0 0 0"})
    bare, idle = both(film, "refits", tmp_path)
    # moved or not: one tree for both geoms, and only its pose is new
    for world in (bare, idle):
        assert (work(world)["trees_built"], work(world)["trees_refitted"]) == (1, 0)
    assert work(bare)["packets_traced"] > 12 * 9


def test_skins_that_hold_still_are_not_fitted_again(tmp_path: Path) -> None:
    cloth = NEEDS["refits"].xml
    # without gravity and thrown by nobody
    still = Film({**cloth, "rest": " 0" * 108, "tail": '<option gravity="0 0 0"/>'})
    bare, idle = map(work, both(still, "refits", tmp_path))
    assert (bare["trees_refitted"], idle["trees_refitted"]) == (1, TICKS + 1)
    assert bare["packets_traced"] < idle["packets_traced"]
    falling = NEEDS["refits"].world(tmp_path)
    told(falling, TICKS)
    assert work(falling)["trees_refitted"] == TICKS + 1


def test_grey_light_carries_one_number_and_not_four(tmp_path: Path) -> None:
    bare, idle = both(PLAIN, "colour", tmp_path)
    channels = [world.cameras[0]._renderer._caster.channels for world in (bare, idle)]  # type: ignore[attr-defined]
    assert channels == [1, 4]


def count(monkeypatch: pytest.MonkeyPatch, counts: Counter[str], owner: Any, name: str) -> None:
    """Count the calls of one function."""
    whole = getattr(owner, name)

    def counted(*args: Any, **named: Any) -> Any:
        counts[name] += 1
        return whole(*args, **named)

    monkeypatch.setattr(owner, name, counted)


@pytest.mark.parametrize(
    ("name", "owner", "function", "calls"),
    [
        ("ground_truth", NativeRenderer, "ground_truth", TICKS + 1),
        ("light_gains", Flicker, "gains", TICKS + 1),
        ("readout", Readout, "step", TICKS + 1),
        ("aps", Aps, "step", TICKS + 1),
        ("imu", Imu, "step", TICKS + 1),
    ],
)
def test_a_stage_that_is_off_is_never_called(
    name: str,
    owner: Any,
    function: str,
    calls: int,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    counts = Counter[str]()
    count(monkeypatch, counts, owner, function)
    told(PLAIN.world(tmp_path), TICKS)
    assert counts[function] == 0
    told(PLAIN.world(tmp_path, on=[name]), TICKS)
    assert counts[function] == calls


def test_a_pinhole_in_full_light_has_no_tables_and_no_sky_no_texture(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    seen: dict[str, list[Any]] = {"lens": [], "share": []}
    optics = _core.Optics

    def spied(**named: Any) -> _core.Optics:
        for key, values in seen.items():
            values.append(None if named[key] is None else named[key].nbytes)
        return optics(**named)

    monkeypatch.setattr(_core, "Optics", spied)
    PLAIN.world(tmp_path)
    PLAIN.world(tmp_path, on=["vignetting"])
    NEEDS["lens"].world(tmp_path)
    assert seen == {"lens": [None, None, 37 * 49 * 12], "share": [None, 36 * 48 * 4, None]}


SENSOR = SensorParameters("ideal", 40, 16, 0.2, 0.2)
TERMS = {
    # term -> random numbers drawn for each pixel, bytes of pattern and of state for each
    "threshold_spread": (2, 0, 0),
    "rate_spread": (0, 0, 0),
    "defects": (3, 4 + 4 + 1, 16 / 64),
    "high_pass": (0, 0, 16 / 64),
    "leak": (1, 4 + 4, 16 / 64),
    "parasitic_leak": (1, 4 + 4 + 4, 16 / 64),
    "shot_noise": (0, 4 + 4, 16 / 64),
    "refractory_spread": (0, 0, 0),
    "causes": (0, 0, 0),
}


@pytest.mark.parametrize("name", TERMS)
def test_a_term_at_zero_draws_no_number_and_has_no_memory(
    name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    drawn = Counter[str]()
    for function in ("pixel_normals", "pixel_uniforms"):
        count(monkeypatch, drawn, fixed_pattern, function)
    costs = []
    for switches in (UNFORCED, Switches(on=frozenset({name}))):
        drawn.clear()
        model = PlainModel(SENSOR, 1, switches=switches)
        pattern = model.pattern(1)
        arrays = [getattr(pattern, x.name) for x in fields(pattern)]
        sizes = [sum(a.nbytes for a in some if a is not None) / 640 for some in (
            arrays, model.init(1).arrays().values())]  # fmt: skip
        costs.append((drawn.total(), *sizes))
    least, most = costs
    assert least == (0, 8, 16)
    assert tuple(np.subtract(most, least)) == TERMS[name]


def test_the_terms_of_the_plan_are_all_here() -> None:
    idle = set(PlainModel(SENSOR).features)
    # a low pass, photon noise, a period and a mean cannot be there and do nothing
    assert idle - {feature.name for feature in FEATURES if feature.idle} == {*TERMS}


def test_no_candidate_of_shot_noise_is_drawn_at_zero() -> None:
    frame = np.full((16, 40), 0.5, np.float32)
    counts = []
    for rate, switches in ((0.0, UNFORCED), (0.0, Switches(on=frozenset({"shot_noise"}))),
                           (100.0, UNFORCED)):  # fmt: skip
        sensor = SensorParameters("ideal", 40, 16, 0.2, 0.2, shot_noise_rate_hz=rate)
        model = PlainModel(sensor, 1, switches=switches)
        state = model.init(0)
        for k in range(100):
            _, state = model.step(frame, state, 1000 * k, 1000 * k + 1000)
        counts.append(0 if state.shot_count is None else int(state.shot_count.max()))
    # asked for at no rate: a clock that is set once and never rings
    assert counts[:2] == [0, 1]
    assert counts[2] > 100


def test_cold_tiles_have_no_memory() -> None:
    sensor = SensorParameters("test", 40, 16, 0.2, 0.2, dark_lux=0.1)
    film = np.full((30, 16, 40), 0.5, np.float32)
    film[5:, 4:8, 4:8] = 0.7
    rows = []
    for switches in (UNFORCED, Switches(on=frozenset({"cold_tiles"}))):
        model = EvsNetModel(sensor, random_network(1), threads=1, switches=switches)
        state = model.init(0)
        for k, frame in enumerate(film):
            _, state = model.step(frame, state, 1000 * k, 1000 * k + 1000)
        rows.append(int((state.arrays["tile_row"] >= 0).sum()))
    assert rows == [1, 40]
