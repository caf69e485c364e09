"""Paths under a still camera: what is kept equals what would be traced anew, bit for bit."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from evs.emulator import _core
from evs.emulator.base.scene import CameraPose, SceneSnapshot, Shape
from reference.random_scenes import PULSE, RandomStage, check_film, random_turn

pytestmark = pytest.mark.property

TICKS, SIZE = 12, (29, 22)


def still_film(
    stage: RandomStage, ticks: int, lamps: bool = False
) -> list[tuple[SceneSnapshot, CameraPose]]:
    """Film a scene in which geoms move: steadily, some faster or at times only; rarely, one jumps.

    Args:
        stage: The scene; its geoms and lamps are moved.
        ticks: The length of the film.
        lamps: Whether lamps move, too, except in ticks 10 to 21, in which all of them stand still.

    Returns:
        The snapshot and the pose of the camera of each tick.
    """
    rng, count, frames = stage.rng, len(stage.geom_pos), []
    # a plane or a lamp that moves changes everything, so only in a few scenes does one move
    glow = np.array([surface.emission > 0 for surface in stage.scene.surfaces])
    everywhere = (stage.scene.geom_type == Shape.PLANE) | glow[stage.scene.geom_surface]
    free = np.flatnonzero(~everywhere | (rng.random() < 0.2))
    speed = rng.normal(size=(count, 3)) * 10.0 ** rng.uniform(-4, -1.5, (count, 1))
    fast = np.isin(np.arange(count), free) & (rng.random(count) < 0.5)
    for tick in range(ticks):
        frames.append((stage.snapshot(1000 * tick), stage.pose))
        stage.geom_pos += speed * (fast & (rng.random(count) < 0.7))[:, np.newaxis]
        if len(free) and rng.random() < 0.15:
            stage.geom_pos[rng.choice(free)] += rng.normal(size=3) * 10.0 ** rng.uniform(-6, 0)
        if lamps and not 10 <= tick < 22 and rng.random() < 0.9:
            stage.light_pos[rng.integers(len(stage.light_pos))] += rng.normal(size=3) * 0.01
        if len(free) and rng.random() < 0.15:
            stage.geom_mat[rng.choice(free)] = random_turn(rng)
    return frames


def shares(
    seeds: range,
    ticks: int,
    spp: int = 0,
    lamps: bool = False,
    flicker: tuple[object, ...] = (),
    point_sets: str = "fixed",
    antialiasing: str = "fixed",
    **stage: object,
) -> list[float]:
    """Return the traced shares of all ticks but the first.

    With one thread or more, any instruction set, and one sample per pixel or several, the bytes
    are those of the full trace.
    """
    found = []
    for seed in seeds:
        scene = RandomStage(seed, **stage)  # type: ignore[arg-type]
        isa = _core.isa_available()[seed % len(_core.isa_available())]
        render = {
            "renderer": "path",
            "spp": spp or (1, 2, 3, 5)[seed % 4],
            "bounces": seed % 5,
            "sampler": ("owen", "sobol", "global", "random", "anchored")[seed % 5],
            "flicker": flicker,
            "seeds": point_sets,
            "antialiasing": antialiasing,
            "cycle_ticks": 2 + seed % 4,
        }
        full = scene.renderer(threads=2, incremental=False, **render)
        kept = [scene.renderer(threads=1 + seed % 3, **render), scene.renderer(isa=isa, **render)]
        film = still_film(scene, ticks, lamps and len(scene.light_pos) > 0)
        for tick, (frame, pose) in enumerate(film):
            light = full.render(frame, pose)
            for other in kept:
                assert other.render(frame, pose).tobytes() == light.tobytes(), (seed, tick)
                found += [other.traced_fraction] if tick else []  # type: ignore[attr-defined]
    return found


@pytest.mark.parametrize(("decades", "zoom"), [(1.0, 1.0), (6.0, 1.0), (1.0, 300.0), (1.0, 0.01)])
def test_kept_paths_are_those_of_the_full_trace(decades: float, zoom: float) -> None:
    found = shares(range(7), TICKS, decades=decades, zoom=zoom, size=SIZE)
    # neither everything nor nothing
    assert 0.0 < np.mean(found) < 0.8, np.mean(found)
    assert min(found) < 0.1


def test_kept_paths_among_physical_materials_in_fog_are_those_of_the_full_trace() -> None:
    found = shares(range(40, 47), TICKS, rich=True, size=SIZE)
    assert 0.0 < np.mean(found) < 0.8


def test_blocks_of_samples_are_kept_as_a_whole() -> None:
    found = shares(range(60, 64), TICKS, spp=66, size=(9, 7))
    assert 0.0 < np.mean(found) < 0.8


@pytest.mark.slow
def test_of_lamps_that_move_their_own_light_alone_is_traced() -> None:
    found = shares(range(7), 26, lamps=True, size=SIZE)
    assert 0.0 < np.mean(found) < 0.8, np.mean(found)
    assert min(found) < 0.1


def test_of_lamps_that_move_in_fog_and_haze_their_own_light_alone_is_traced() -> None:
    found = shares(range(40, 47), 26, lamps=True, rich=True, size=SIZE)
    assert 0.0 < np.mean(found) < 0.8, np.mean(found)


def test_of_lamps_that_flicker_their_own_light_alone_is_traced() -> None:
    found = shares(range(40, 44), TICKS, flicker=(PULSE,), rich=True, size=SIZE)
    assert 0.0 < np.mean(found) < 0.8, np.mean(found)


def test_lamps_move_where_there_is_no_geom() -> None:
    assert len(RandomStage(8106, rich=True, size=SIZE).geom_pos) == 0
    shares(range(8106, 8107), 4, lamps=True, rich=True, size=SIZE)


def test_each_point_set_of_a_cycle_keeps_its_paths() -> None:
    found = shares(range(20, 26), 24, point_sets="cycle", size=SIZE)
    assert 0.0 < np.mean(found) < 0.8, np.mean(found)
    assert min(found) < 0.1


@pytest.mark.parametrize("more", [{"lamps": True}, {"flicker": (PULSE,)}])
def test_point_sets_of_a_cycle_under_lamps_that_change(more: dict[str, Any]) -> None:
    shares(range(40, 44), 24, point_sets="cycle", rich=True, size=SIZE, **more)


@pytest.mark.slow
@pytest.mark.parametrize("point_sets", ["fixed", "cycle"])
def test_more_samples_at_edges_are_those_of_the_full_trace(point_sets: str) -> None:
    more = {"antialiasing": "adaptive", "point_sets": point_sets, "size": SIZE}
    found = []
    for spp, seed in ((4, 70), (7, 72), (16, 74), (66, 76)):
        found += shares(range(seed, seed + 2), 24, spp=spp, **more)
    assert 0.0 < np.mean(found) < 0.8, np.mean(found)
    assert min(found) < 0.1
    shares(range(40, 42), 24, spp=8, lamps=True, rich=True, **more)
    shares(range(42, 44), 24, spp=8, flicker=(PULSE,), rich=True, **more)
    # a quarter of the samples is cached in blocks, too
    shares(range(78, 79), TICKS, spp=300, **{**more, "size": (9, 7)})


def test_blocks_of_samples_under_lamps_that_move() -> None:
    shares(range(60, 64), TICKS, spp=66, lamps=True, size=(9, 7))


def test_kept_paths_where_cameras_and_lights_move_too() -> None:
    check_film(range(300, 306), 10, lambda seed: {"renderer": "path", "bounces": seed % 4})


@pytest.mark.slow
@pytest.mark.campaign
@pytest.mark.parametrize(("decades", "zoom"), [(1.0, 1.0), (6.0, 1.0), (3.0, 0.03)])
def test_kept_paths_in_many_scenes(decades: float, zoom: float) -> None:
    shares(range(8000, 8040), 40, decades=decades, zoom=zoom)


@pytest.mark.slow
@pytest.mark.campaign
def test_more_samples_at_edges_in_many_scenes() -> None:
    shares(range(8000, 8030), 40, spp=12, antialiasing="adaptive")
