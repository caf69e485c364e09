"""Packets that are traced two at once give the bytes of packets traced one by one."""

from __future__ import annotations

import numpy as np
import pytest

from evs.emulator import _core
from evs.emulator.config import RenderConfig
from evs.emulator.render import NativeRenderer, make_renderer
from reference.random_scenes import RandomStage

pytestmark = pytest.mark.property


@pytest.mark.parametrize("antialiasing", ["fixed", "adaptive"])
@pytest.mark.parametrize("rich", [False, True])
def test_a_frame_is_its_pixels_one_by_one(antialiasing: str, rich: bool) -> None:
    """AVX-512 traces whole frames in pairs; lists of pixels, and the others, one packet a time."""
    for seed in range(40):
        stage = RandomStage(seed, rich=rich)
        chosen = {"spp": (1, 2, 5)[seed % 3], "antialiasing": antialiasing, **stage.render}
        chosen["incremental"] = False
        renderers = [
            make_renderer(stage.scene, stage.camera, RenderConfig(**{**chosen, "isa": isa}), 1)
            for isa in _core.isa_available()
        ]
        width, height = stage.camera.width, stage.camera.height
        rows, columns = np.mgrid[:height, :width].astype(np.int32)
        pixels = np.stack([columns.ravel(), rows.ravel()], 1)
        for frame, pose in stage.film(2):
            light = [renderer.render(frame, pose).tobytes() for renderer in renderers]
            assert len(set(light)) == 1, seed
            fastest = renderers[0]
            assert isinstance(fastest, NativeRenderer)
            assert fastest.trace(frame, pose, pixels).tobytes() == light[0], seed


def test_pairs_under_a_long_lens() -> None:
    """There the axes of two packets differ by little more than their rounding."""
    for seed in range(1000, 1060):
        stage = RandomStage(seed, zoom=300.0)
        light = [
            stage.renderer(isa=isa, incremental=False).render(stage.snapshot(), stage.pose)
            for isa in _core.isa_available()
        ]
        assert len({frame.tobytes() for frame in light}) == 1, seed
