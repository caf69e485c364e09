"""Any coefficients: a lens whose every ray leads back to its pixel, or one clear line."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from evs.emulator.base.scene import CameraModel
from evs.emulator.optics import MODELS, Lens, make_lens, project
from evs.msgs import EvsError

pytestmark = pytest.mark.property

WIDTH, HEIGHT = 23, 17
SIZES = st.sampled_from([1e-6, 1e-3, 0.1, 1.0, 30.0, 1e6, 1e160, 1e308])


@st.composite
def cameras(draw: st.DrawFn) -> CameraModel:
    """A small camera with a wide or narrow view, and coefficients from tame to absurd."""
    model = draw(st.sampled_from(["plumb_bob", "rational_polynomial", "equidistant"]))
    size = draw(SIZES)
    count = len(MODELS[model].split())
    parts = draw(st.lists(st.floats(-1, 1), min_size=count, max_size=count))
    focal = draw(st.floats(2.0, 100.0))
    return CameraModel(
        WIDTH,
        HEIGHT,
        focal,
        focal * draw(st.floats(0.7, 1.4)),
        draw(st.floats(-5.0, WIDTH + 5.0)),
        draw(st.floats(-5.0, HEIGHT + 5.0)),
        False,
        model,
        tuple(size * part for part in parts),
    )


@pytest.mark.slow
@settings(max_examples=600, deadline=None)
@given(cameras())
def test_every_ray_leads_back_to_its_pixel_or_the_lens_is_refused(camera: CameraModel) -> None:
    refusal, lens = "", Lens()
    try:
        lens = make_lens(camera)
    except EvsError as error:
        refusal = str(error)
    if refusal:
        assert "\n" not in refusal
        assert "camera." in refusal
        return
    if lens.directions is None:
        assert not any(camera.distortion)
        return
    assert np.isfinite(lens.directions).all()
    rays = lens.directions.astype(np.float64)
    x, y = np.meshgrid(np.arange(WIDTH + 1.0), np.arange(HEIGHT + 1.0))
    inside = np.ones(rays.shape[:2], bool)
    if lens.outside is not None:
        # a corner is inside where all four pixels around it are
        inside[:] = False
        inside[1:-1, 1:-1] = ~(
            lens.outside[1:, 1:] | lens.outside[1:, :-1] | lens.outside[:-1, 1:]
            | lens.outside[:-1, :-1]
        )  # fmt: skip
    image = project(camera, rays.reshape(-1, 3)).reshape(HEIGHT + 1, WIDTH + 1, 2)
    off = np.hypot(image[..., 0] - x, image[..., 1] - y)[inside]
    # the table is float32: a ray moves by 1e-7, its image by that times focal length and slope;
    # just before the fold, the image of a moved ray may be none
    seen = off[np.isfinite(off)]
    assert (seen < 0.02).all()
    assert len(seen) >= 0.9 * len(off)
