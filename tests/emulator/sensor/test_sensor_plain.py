"""The plain pixel on light whose events can be told by hand."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from evs.emulator.base.scene import F32
from evs.emulator.sensor import PlainModel, SensorParameters
from evs.emulator.sensor.fixed_pattern import draw_pattern
from evs.emulator.sensor.random import Term, pixel_normals
from evs.msgs import EVENT_DTYPE, Events, EvsError

KNEE = 8.61316967010498
"""Here linlog's linear part is L_log = DN / 4 exactly, so that light on a grid stays exact."""


def linear_sensor(width: int, height: int) -> SensorParameters:
    """Log light is luminance / 4 exactly, up to 2.15."""
    return SensorParameters("linear", width, height, 0.25, 0.25, linlog_dn=KNEE, exposure_dn=1.0)


def run(sensor: SensorParameters, begin: object, end: object, tick_us: int = 1000) -> Events:
    """Events of a tick in which log light goes from one level to another; scalars or (h, w)."""
    model = PlainModel(sensor, 1)
    state, found = model.init(0), []
    for k, level in enumerate((begin, end)):
        light = 4.0 * np.broadcast_to(np.asarray(level, np.float32), (sensor.height, sensor.width))
        events, state = model.step(light.astype(np.float32), state, (k - 1) * tick_us, k * tick_us)
        found.append(events)
    assert len(found[0]) == 0
    return found[1]


def test_upward_ramp_in_closed_form() -> None:
    events = run(linear_sensor(1, 1), 0.0, 2.0)
    # levels .25, .5 ... 2.0; the last one is reached exactly at the end, and counts
    assert events["t"].tolist() == [125, 250, 375, 500, 625, 750, 875, 1000]
    assert events["p"].tolist() == [1] * 8


def test_order_is_time_then_pixel_then_crossing() -> None:
    light = np.zeros((2, 3))
    light[0, 1] = light[1, 2] = 1.0
    events = run(linear_sensor(3, 2), 0.0, light, tick_us=2)
    # levels at .5, 1, 1.5 and 2 us of two pixels
    assert events["t"].tolist() == [1] * 4 + [2] * 4
    assert list(zip(events["x"], events["y"], strict=True)) == [(1, 0), (1, 0), (2, 1), (2, 1)] * 2


def test_events_are_sixteen_bytes_with_zero_padding() -> None:
    events = run(linear_sensor(70, 3), 0.0, 2.0)
    assert events.dtype == EVENT_DTYPE
    assert len(events) == 8 * 210
    raw = events.view(np.uint8).reshape(-1, 16)
    assert not raw[:, 13:].any()
    assert raw[:, 12].min() == raw[:, 12].max() == 1


def test_no_events_is_an_empty_array_of_events() -> None:
    events = run(linear_sensor(2, 2), 1.0, 1.0)
    assert events.dtype == EVENT_DTYPE
    assert events.shape == (0,)


def test_light_in_other_layouts() -> None:
    sensor = linear_sensor(5, 4)
    light = np.arange(20, dtype=np.float32).reshape(4, 5) / 4
    found = []
    for frame in (light, np.asfortranarray(light), np.repeat(light, 2, axis=1)[:, ::2]):
        model = PlainModel(sensor, 1)
        _, state = model.step(np.zeros((4, 5), np.float32), model.init(0), -1000, 0)
        before = frame.copy()
        events, _ = model.step(frame, state, 0, 1000)
        assert np.array_equal(frame, before)
        found.append(events.tobytes())
    assert len(found[0]) > 0
    assert found[0] == found[1] == found[2]


def test_refusals() -> None:
    sensor = linear_sensor(5, 4)
    model = PlainModel(sensor, 1)
    light: F32 = np.zeros((4, 5), np.float32)
    with pytest.raises(EvsError, match=r"luminance is \(5, 4\), the sensor .* is \(4, 5\)"):
        model.step(light.T, model.init(0), 0, 1000)
    with pytest.raises(EvsError, match=r"tick \(5, 5\] us does not go forward"):
        model.step(light, model.init(0), 5, 5)
    with pytest.raises(EvsError, match="use shorter ones"):
        model.step(light, model.init(0), 0, 2**28)
    with pytest.raises(EvsError, match="call init again"):
        model.step(light, PlainModel(linear_sensor(4, 5), 1).init(0), 0, 1000)


def test_no_threshold_is_drawn_below_its_floor_or_its_mean() -> None:
    for mean, lowest in ((0.2, 0.01), (0.01, 0.01), (0.002, 0.002)):
        sensor = SensorParameters("test", 40, 30, mean, mean, sigma_thres=0.3)
        assert draw_pattern(sensor, 1).on.min() == np.float32(lowest)
    assert np.all(draw_pattern(replace(sensor, sigma_thres=0.0), 1).on == np.float32(0.002))


def test_numbers_of_pixels_do_not_depend_on_how_many_rows_are_drawn_at_once() -> None:
    wide = pixel_normals(3, Term.LEAK_RATE, 3000, 7)
    assert np.array_equal(wide[:, :40], pixel_normals(3, Term.LEAK_RATE, 40, 7))
    assert np.array_equal(wide[5:, :1], pixel_normals(3, Term.LEAK_RATE, 1, 9000)[5:7])
