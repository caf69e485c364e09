"""Noise that is anchored to surfaces moves with them, and with nothing else."""

from __future__ import annotations

import numpy as np
import pytest

from evs.emulator.base.scene import F32
from reference.instants import Film

SIDE = 128
PIXEL = 2 / SIDE
TABLE = """<mujoco><visual><headlight ambient=".5 .5 .5" diffuse="0 0 0" specular="0 0 0"/>
    </visual><worldbody>
    <camera name="eye" pos="0 -1 2" xyaxes="1 0 0 0 .8 .5" projection="orthographic" fovy="2"/>
    {first}<body pos="{shift}">
      <geom type="{shape}" size="8 8 .25" rgba=".5 .5 .5 1"/></body></worldbody></mujoco>"""


def see(
    sampler: str,
    shift: tuple[float, float, float],
    shape: str = "box",
    spp: int = 1,
    first: str = "",
) -> F32:
    """Render a table under an even sky: luminance, (128, 128) float32; a pixel is 1/64 m wide.

    Args:
        sampler: The sampler of `path`.
        shift: Where the table is moved to, m.
        shape: The shape of the table: a box or a plane.
        spp: Samples per pixel.
        first: MJCF of a geom that is declared before the table.
    """
    xml = TABLE.format(shape=shape, first=first, shift="{:.9f} {:.9f} {:.9f}".format(*shift))
    return Film(xml, (SIDE, SIDE)).light(renderer="path", sampler=sampler, spp=spp)


def correlation(a: F32, b: F32) -> float:
    return float(np.corrcoef(a.ravel(), b.ravel())[0, 1])


@pytest.mark.parametrize("spp", [1, 4])
def test_noise_moves_with_the_surface(spp: int) -> None:
    pixels = 5
    moved = (pixels * PIXEL, 0.0, 0.0)
    least = 4.5 / SIDE  # the deviation of Pearson's r of 128 x 128 independent numbers is 1 / 128
    anchored, later = see("anchored", (0, 0, 0), spp=spp), see("anchored", moved, spp=spp)
    assert correlation(anchored[:, :-pixels], later[:, pixels:]) > 2 * least
    assert abs(correlation(anchored, later)) < least
    # the noise of owen stays with the pixels
    np.testing.assert_allclose(see("owen", (0, 0, 0), spp=spp), see("owen", moved, spp=spp), 1e-5)


@pytest.mark.parametrize("shape", ["box", "plane"])
def test_a_hair_of_motion_keeps_the_noise(shape: str) -> None:
    # a plane lies at z = 0 of its frame, and the table's top at 8 cells: values round either way
    before, after = (see("anchored", (0.3 + d, 0.2 - d, 1e-3 + d), shape) for d in (0.0, 2e-7))
    assert np.std(before) > 0.005
    assert np.mean(np.abs(after - before) > 1e-5) < 0.01


def test_every_geom_has_its_own_noise() -> None:
    one = see("anchored", (0, 0, 0))
    other = see("anchored", (0, 0, 0), first='<geom type="sphere" size=".01" pos="0 0 -99"/>')
    assert abs(correlation(one, other)) < 4.5 / SIDE
