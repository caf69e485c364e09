"""Events of a row of pixels, at any tick, by any event model of a pipeline."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np

from evs.emulator.base.scene import F32
from evs.emulator.camera.pixel_pipeline import make_event_model
from evs.emulator.config import ModelConfig, SensorConfig
from evs.emulator.evsnet.network_files import families, load_network, network_names
from evs.emulator.sensor import SensorParameters, resolve_sensor
from evs.msgs import Events, EvsError, join_events
from evs_lab.evaluation import models
from evs_lab.evaluation.clip import TICK_US
from evs_lab.sweep.frame_methods import FrameMethod, interpolate, quantise

LOW_PASS = ("cutoff_hz", "filter", "follower_hz")
"""keys of a point's sensor that its error is measured with; the reference's filter is exact"""


def metered_sensor(wanted: SensorConfig, preset: SensorConfig) -> SensorConfig:
    """The sensor that errors are measured with: ideal, except for a low pass that a point sets.

    Noise is no error of the light, so errors have none.
    """
    changed = {k: getattr(wanted, k) for k in LOW_PASS if getattr(wanted, k) != getattr(preset, k)}
    return dataclasses.replace(models.SENSOR, **changed)


def row_of(sensor: SensorConfig, pixels: int) -> SensorParameters:
    """Parameters of the sensor with so many pixels, in tiles of 4 x 4 as evaluation.models has."""
    size = models.sensor_of(pixels)
    return dataclasses.replace(resolve_sensor(sensor), width=size.width, height=size.height)


def network_model(model: ModelConfig, noisy_samples: int) -> models.ModelUnderTest:
    """The network of a pipeline; of a family, the member for light of so many samples."""
    how = models.RuntimeOptions(0, model.runtime, model.provider)
    shipped = network_names()
    if model.network in shipped or model.network in families(shipped):
        return models.models_under_test([model.network], None, how)[0][0].at(noisy_samples)
    return models.network(load_network(model.network), how)


def events_of(
    light: F32,
    times_us: Sequence[int],
    model: ModelConfig,
    sensor: SensorConfig,
    method: FrameMethod | None = None,
) -> Events:
    """Events of an event pixel; x is the number of the pixel, y is 0.

    Args:
        light: (k, n) at times_us; the first row only sets the reference.
        times_us: (k,) times of the rows.
        model: configuration of the event model.
        sensor: configuration of the sensor.
        method: method of another emulator that makes events from frames; None: ours.
    """
    if method is not None:
        light = quantise(light, method.code)
    row = row_of(sensor, light.shape[1])
    pixel = make_event_model(row, model)
    frames = models.frames_of(light)
    state = pixel.init(0)
    parts: list[Events] = []
    before, before_us = frames[0], times_us[0]
    some, state = pixel.step(before, state, before_us - 1, before_us)
    for frame, t_us in zip(frames[1:], times_us[1:], strict=True):
        steps = [(t_us, frame)]
        if method is not None and method.upsampled:
            steps = interpolate(before, frame, before_us, t_us)
        begin_us = before_us
        for end_us, shown in steps:
            some, state = pixel.step(np.ascontiguousarray(shown), state, begin_us, end_us)
            parts.append(some)
            begin_us = end_us
        before, before_us = frame, t_us
    return models.numbered(join_events(parts))


def network_events(
    light: F32, model: ModelConfig, noisy_samples: int, warm: F32 | None = None
) -> Events:
    """Events of a network, as `evs evaluate` runs it: ticks of 1 ms, its latency removed.

    Args:
        light: (ticks + latency, n).
        model: configuration of the event model.
        noisy_samples: fresh samples per pixel of the light.
        warm: light before the clip, where the scene is at rest, with fresh noise.
    """
    chosen = network_model(model, noisy_samples)
    return models.run(chosen, light, warm).events


def check_tick(model: ModelConfig, tick_us: int) -> None:
    """Raises EvsError for a network with other ticks than the 1 ms that it is trained for."""
    if model.name == "evsnet" and tick_us != TICK_US:
        raise EvsError(
            f"networks are for ticks of {TICK_US} us, not {tick_us}: take model.name=plain or "
            "adaptive"
        )
