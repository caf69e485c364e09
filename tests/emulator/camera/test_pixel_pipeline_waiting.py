"""Light that waits for the rest of its chunk."""

from __future__ import annotations

import numpy as np
import pytest

from evs.emulator.base.scene import F32
from evs.emulator.camera.pixel_pipeline import PixelPipeline
from evs.emulator.config import ModelConfig
from evs.emulator.sensor import SensorParameters
from evs.msgs import EvsError

SENSOR = SensorParameters("test", 9, 6, 0.2, 0.2)
TICKS = 21


def pixels() -> PixelPipeline:
    return PixelPipeline(SENSOR, ModelConfig(name="evsnet", chunk=8), seed=0)


def film() -> F32:
    walk = np.random.default_rng(0).normal(0, 0.5, (TICKS, 6, 9))
    return np.exp(np.cumsum(walk, axis=0)).astype(np.float32)


def test_an_array_that_is_used_again_for_each_frame_is_as_one_of_its_own() -> None:
    frame = np.empty((6, 9), np.float32)
    again, fresh = pixels(), pixels()
    found, expected = [], []
    for k, light in enumerate(film()):
        frame[:] = light
        found += again.see(frame, 1000 * k, 1000 * k + 1000)
        frame[:] = np.nan
        expected += fresh.see(light, 1000 * k, 1000 * k + 1000)
    found += again.finish()
    expected += fresh.finish()
    assert len(found) == TICKS
    assert sum(len(tick.events) for tick in found) > 100
    assert [t.events.tobytes() for t in found] == [t.events.tobytes() for t in expected]
    assert again.clamps == 0


def test_a_chunk_knows_nothing_of_the_one_before() -> None:
    """Its memory is used again: what is left in it of longer chunks is no light."""
    whole, parts = pixels(), pixels()
    found, expected = [], []
    for k, light in enumerate(film()):
        expected += whole.see(light, 1000 * k, 1000 * k + 1000)
        found += parts.see(light, 1000 * k, 1000 * k + 1000)
        if k % 5 == 3:
            found += parts.finish()
            assert parts.save()["waiting_light"].shape == (0, 6, 9)
    found += parts.finish()
    expected += whole.finish()
    assert [t.events.tobytes() for t in found] == [t.events.tobytes() for t in expected]


def test_light_of_another_shape_is_refused_at_once() -> None:
    camera = pixels()
    light = film()
    camera.see(light[0], 0, 1000)
    camera.see(light[1], 1000, 2000)
    with pytest.raises(EvsError, match=r"luminance is \(1, 9\), the sensor .* is \(6, 9\)"):
        camera.see(light[2, :1], 2000, 3000)
