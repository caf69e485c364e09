"""More samples of `path` at the edges of geoms, a quarter of them elsewhere."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from evs.emulator.base.scene import F32
from evs.emulator.config import CameraConfig, RenderConfig
from evs.emulator.render import make_renderer
from reference.instants import Film

SIZE = 40
SPP = 16
EDGES = RenderConfig(renderer="path", spp=SPP, antialiasing="adaptive")
EVERYWHERE = replace(EDGES, antialiasing="fixed")
FEW = replace(EVERYWHERE, spp=SPP // 4)

# a wide bulb lights a floor and a box
SCENE = """<mujoco><visual><headlight active="0"/></visual><worldbody>
    <light type="point" pos="1 -1 3" attenuation="0 0 1" diffuse="3 3 3" bulbradius=".5"/>
    <geom type="plane" size="9 9 .1" rgba=".6 .6 .6 1"/>
    <geom type="box" size=".4 .4 .4" pos="-.3 0 .4" rgba=".2 .3 .9 1"/>
    </worldbody></mujoco>"""
SKY = """<mujoco><asset><texture type="skybox" builtin="gradient" rgb1="1 1 1" rgb2=".1 .2 .3"
    width="16" height="96"/></asset>
    <worldbody><geom size=".1" pos="0 99 0"/></worldbody></mujoco>"""
VIEW = CameraConfig(lookat=(0, 0, 0.4), distance=3, azimuth=80, elevation=-20)


class Pictures(Film):
    """Pictures of a scene at an instant."""

    def __init__(self, scene: str) -> None:
        super().__init__(scene, (SIZE, SIZE), VIEW)

    def picture(self, config: RenderConfig, seed: int) -> F32:
        renderer = make_renderer(self.scene, self.camera, config, 1, seed=seed)
        return renderer.render(self.shot, self.shot.cameras[0]).copy()

    def geoms(self) -> np.ndarray:
        """Geom at each pixel's centre."""
        renderer = make_renderer(self.scene, self.camera, RenderConfig(), 1)
        return renderer.ground_truth(self.shot, self.shot.cameras[0]).geom_id


def far_from_edges(geoms: np.ndarray) -> np.ndarray:
    """Where all geoms within three pixels are the same, and all within one pixel of those."""
    padded = np.pad(geoms, 3, mode="edge")
    near = np.lib.stride_tricks.sliding_window_view(padded, (7, 7))
    return (near == geoms[..., None, None]).all((2, 3))


@pytest.fixture(scope="module")
def pictures() -> Pictures:
    return Pictures(SCENE)


def noise(lights: np.ndarray, where: np.ndarray) -> float:
    """Standard deviation of log light over the pictures, in the mean over pixels."""
    return float(np.sqrt(np.log(lights + 0.01).var(0, ddof=1)[where].mean()))


def test_edges_have_the_noise_of_all_samples_and_the_rest_that_of_a_quarter(
    pictures: Pictures,
) -> None:
    edges, everywhere, few = (
        np.stack([pictures.picture(config, seed) for seed in range(48)])
        for config in (EDGES, EVERYWHERE, FEW)
    )
    geoms = pictures.geoms()
    flat = far_from_edges(geoms)
    outline = np.zeros_like(flat)
    outline[:, 1:] = geoms[:, 1:] != geoms[:, :-1]
    assert outline.sum() > 30
    # measured: edges 0.98 of everywhere, which has 0.39 of a quarter of the samples
    assert noise(edges, outline) < 1.1 * noise(everywhere, outline) < 0.5 * noise(few, outline)
    assert noise(edges, flat) == pytest.approx(noise(few, flat), rel=0.1)
    assert noise(everywhere, flat) < 0.6 * noise(edges, flat)


def test_samples_at_edges_leave_the_mean(pictures: Pictures) -> None:
    edges = np.stack([pictures.picture(EDGES, seed) for seed in range(200)])
    truth = pictures.picture(replace(EVERYWHERE, spp=4096), 1000)
    off = (edges.mean(0) - truth) / (edges.std(0, ddof=1) / np.sqrt(len(edges)) + 1e-3)
    # Sidak: of 1600 pixels none is 5 deviations off in 1 of 1000 runs, the truth's noise left out
    assert np.abs(off).max() < 5.5
    assert abs(edges.mean() / truth.mean() - 1) < 2e-3


def test_light_without_edges_takes_a_quarter_of_the_samples() -> None:
    sky = Pictures(SKY)
    one, other = (sky.picture(replace(EDGES, spp=spp), 3) for spp in (16, 4))
    few = sky.picture(FEW, 3)
    assert one.std() > 0.05
    # different points of the same smooth sky
    np.testing.assert_allclose(one, few, rtol=0.03)
    assert not np.array_equal(other, few)


def test_one_sample_is_one_sample(pictures: Pictures) -> None:
    one = pictures.picture(replace(EDGES, spp=1), 5)
    np.testing.assert_array_equal(one, pictures.picture(replace(EVERYWHERE, spp=1), 5))


def test_the_quarters_of_a_cycle_are_as_even_as_one_set_of_as_many_samples(
    pictures: Pictures,
) -> None:
    flat = far_from_edges(pictures.geoms())
    edges, quarter, sixteen = (
        noise(np.stack([pictures.picture(config, seed) for seed in range(48)]), flat)
        for config in (replace(EDGES, seeds="cycle"), replace(FEW, seeds="cycle"), EVERYWHERE)
    )
    # measured: 1.00 to 1.06 of each other; with quarters that are chosen at random, 1.2
    assert edges < 1.1 * quarter
    assert edges < 1.1 * sixteen
