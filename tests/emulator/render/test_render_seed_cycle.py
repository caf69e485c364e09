"""A cycle of point sets: the light of the last ticks, each traced with a set of its own."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from evs.emulator import _core
from evs.emulator.config import RenderConfig
from evs.emulator.render import NativeRenderer, make_renderer
from evs.msgs import EvsError
from reference import path_stages
from reference.random_scenes import RandomStage
from reference.stage import Stage

CYCLE = RenderConfig(renderer="path", spp=4, seeds="cycle")
SAMPLERS = ("owen", "sobol", "global", "random", "anchored")


def film_of(stage: RandomStage, ticks: int) -> list:
    """Instants at which the geoms have moved, with a camera that stands still."""
    frames = []
    for tick in range(ticks):
        frames.append((stage.snapshot(1000 * tick), stage.pose))
        stage.geom_pos += stage.rng.normal(size=stage.geom_pos.shape) * 0.03
    return frames


def combined(planes: np.ndarray, before: np.ndarray, newest: int) -> np.ndarray:
    """What combine_cycle does, array by array."""
    one, m = np.float32, len(planes)
    share, free = one(1) / one(m), one(1) / one(m - 1)
    mean, variance = planes[0].copy(), np.zeros_like(planes[0])
    for plane in planes[1:]:
        mean += plane
    mean *= share
    for plane in planes:
        variance += (plane - mean) ** 2
    change = (planes[newest] - before) ** 2
    step = one(0.25) * one(m) * free
    noise = np.maximum(variance * free - step * change, one(0)) * one(4) + one(1e-24)
    middle = one(0.5) * (planes[newest - (m - 1) // 2] + planes[newest - m // 2])
    return mean + (one(1) - noise / (noise + change)) * (middle - mean)


@pytest.mark.parametrize("m", [2, 3, 4, 7])
def test_light_is_that_of_the_sets_of_the_last_ticks(m: int) -> None:
    stage = RandomStage(3, size=(23, 17))
    config = replace(CYCLE, cycle_ticks=m, bounces=2)
    model, camera = stage.scene, stage.camera
    cycle = make_renderer(model, camera, config, 1, seed=5)
    sets = [NativeRenderer(model, camera, config, 1, seed=5, point_set=k) for k in range(m)]
    film = film_of(stage, 2 * m + 1)
    # before the first tick nothing has ever moved
    planes = np.stack([one.render(*film[0]) for one in sets])
    for tick, instant in enumerate(film):
        before = planes[tick % m].copy()
        planes[tick % m] = sets[tick % m].render(*instant)
        expected = combined(planes, before, tick % m)
        assert cycle.render(*instant).tobytes() == expected.tobytes(), tick
        if tick == 0:
            np.testing.assert_allclose(expected, planes.mean(0), rtol=1e-6)


def light_of(planes: np.ndarray, before: np.ndarray, newest: int) -> np.ndarray:
    light = np.zeros(planes.shape[1:], np.float32)
    _core.combine_cycle(planes, before, newest, light)
    return light


@pytest.mark.parametrize("m", [2, 3, 4, 16])
def test_edges_stay_sharp_and_noise_is_averaged(m: int) -> None:
    rng = np.random.default_rng(m)
    fixed = rng.uniform(0.5, 1.5, (m, 20, 600)).astype(np.float32)
    newest = m - 1
    # sets that give the same light again are averaged, however much they differ
    still = light_of(fixed, fixed[newest], newest)
    np.testing.assert_allclose(still, fixed.mean(0), rtol=1e-5)
    assert still.tobytes() == light_of(fixed, fixed[newest], newest).tobytes()
    # noise is of no account beside an edge that came by: light is what it was half a cycle ago
    ticks = np.arange(m)[:, np.newaxis, np.newaxis]
    for came in range(m):
        edge = np.where(ticks >= came, 10.0, 1.0) + 0.02 * fixed
        found = light_of(edge.astype(np.float32), np.ones_like(fixed[0]), newest)
        middle = {newest - (m - 1) // 2, newest - m // 2}
        expected = np.mean([10.0 if tick >= came else 1.0 for tick in middle])
        assert np.abs(found - expected).max() < 0.6, came


def test_impossible_light_stays_in_its_pixel() -> None:
    planes = np.ones((4, 1, 600), np.float32)
    planes[1, 0, :3] = np.nan, np.inf, 1e30
    found = light_of(planes, planes[2], 2)
    assert (found[0, 3:] == 1).all()
    assert not np.isfinite(found[0, :2]).any()


@pytest.mark.parametrize("sampler", SAMPLERS)
def test_threads_and_instruction_sets_change_no_byte(sampler: str) -> None:
    stage = RandomStage(11, rich=True, size=(23, 17))
    film = film_of(stage, 6)
    config = replace(CYCLE, sampler=sampler, bounces=3)
    ways = [(3, "auto"), *((1, isa) for isa in _core.isa_available())]
    lights = [
        [one.render(*instant).tobytes() for instant in film]
        for one in (
            make_renderer(stage.scene, stage.camera, replace(config, isa=isa), threads)
            for threads, isa in ways
        )
    ]
    assert all(light == lights[0] for light in lights[1:])


def test_single_pixels_are_those_of_the_picture() -> None:
    stage = RandomStage(3, size=(23, 17))
    film = film_of(stage, 7)
    whole, single = (make_renderer(stage.scene, stage.camera, CYCLE, 1) for _ in range(2))
    pixels = np.array([[0, 0], [22, 16], [7, 3]], np.int32)
    for instant in film:
        expected = whole.render(*instant)[pixels[:, 1], pixels[:, 0]]
        assert single.trace(*instant, pixels).tobytes() == expected.tobytes()  # type: ignore[attr-defined]


def test_a_restart_forgets_what_was_seen() -> None:
    stage = RandomStage(3, size=(23, 17))
    film = film_of(stage, 4)
    used, new = (make_renderer(stage.scene, stage.camera, CYCLE, 1) for _ in range(2))
    for instant in film[:3]:
        used.render(*instant)
    assert used.render(*film[3]).tobytes() != new.render(*film[3]).tobytes()
    used.restart()
    assert used.render(*film[3]).tobytes() == new.render(*film[3]).tobytes()


def test_colour_is_the_mean_of_the_sets_too() -> None:
    stage = RandomStage(11, size=(23, 17))
    one = make_renderer(stage.scene, stage.camera, CYCLE, 1, rgb=True)
    light = one.render(*film_of(stage, 1)[0])
    assert one.rgb is not None
    np.testing.assert_allclose(one.rgb @ [0.2126, 0.7152, 0.0722], light, rtol=1e-5, atol=1e-6)


def noise_of(stage: Stage, config: RenderConfig, seeds: range) -> float:
    """Root of the mean variance of a pixel's light over seeds."""
    lights = [
        make_renderer(stage.scene, stage.camera, config, 0, seed=seed).render(
            stage.shot, stage.pose
        ).astype(np.float64)
        for seed in seeds
    ]  # fmt: skip
    return float(np.sqrt(np.var(lights, axis=0, ddof=1).mean()))


@pytest.mark.statistical
@pytest.mark.parametrize("name", ["bulb", "sky", "tiles"])
def test_a_cycle_of_four_has_the_noise_of_four_times_the_samples(name: str) -> None:
    stage = getattr(path_stages, name)()
    few = replace(CYCLE, bounces=stage.bounces)
    many = replace(few, seeds="fixed", spp=16)
    # 1728 px and 23 degrees of freedom; neighbours share little, so 1 % of error each
    assert noise_of(stage, few, range(24)) < 1.05 * noise_of(stage, many, range(24))


@pytest.mark.parametrize("sampler", ["owen", "sobol", "global"])
@pytest.mark.parametrize("log2_samples", [0, 2, 3])
def test_blocks_are_even_alone_and_together(sampler: str, log2_samples: int) -> None:
    log2_blocks, pixels = 2, np.array([0, 5, 91], np.int32)
    points = np.zeros((1 << log2_blocks, 1 << log2_samples, len(pixels), 2), np.float32)
    for block, of_block in enumerate(points):
        for index, out in enumerate(of_block):
            _core.probe_sampler(
                sampler, index, 6, pixels, out, seed=7, log2_samples=log2_samples,
                block=block, log2_blocks=log2_blocks,
            )  # fmt: skip

    def strips(found: np.ndarray) -> None:
        # one point in each strip of each axis; a shift per pixel (sobol) turns the strips
        count = len(found)
        for axis in np.moveaxis(found.astype(np.float64), 0, -1).reshape(-1, count):
            gaps = np.diff(np.sort(axis), append=np.sort(axis)[0] + 1)
            if sampler == "sobol":
                np.testing.assert_allclose(gaps, 1 / count, atol=1e-6)
            else:
                assert sorted((axis * count).astype(int)) == list(range(count))

    for of_block in points:
        strips(of_block)
    strips(points.reshape(-1, len(pixels), 2))


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"cycle_ticks": 1}, "render.cycle_ticks is 1; it must be 2 ... 16"),
        ({"cycle_ticks": 17}, "render.cycle_ticks is 17; it must be 2 ... 16"),
        ({"renderer": "direct"}, "cycle"),
    ],
)
def test_bad_values_are_refused(changed: dict, message: str) -> None:
    stage = RandomStage(3, size=(23, 17))
    with pytest.raises(EvsError, match=message):
        make_renderer(stage.scene, stage.camera, replace(CYCLE, **changed), 1)
