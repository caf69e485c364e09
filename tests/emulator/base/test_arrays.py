"""Where the arrays of the event pixels lie: 64 bytes that are loaded at once are one cache line."""

from __future__ import annotations

import numpy as np
import pytest

from evs.emulator.base.arrays import LINE, on_lines
from evs.emulator.sensor import PlainModel, PlainState, SensorParameters

SENSOR = SensorParameters("lines", 67, 45, 0.2, 0.2, 0.03, leak_rate_hz=1.0, follower_hz=300.0)


@pytest.mark.parametrize(
    "values", [np.arange(7.0), np.ones((3, 5), np.uint8), np.zeros((2, 3, 4), np.float32)]
)
def test_a_copy_begins_a_line(values: np.ndarray) -> None:
    for array in (values, values.T):
        copy = on_lines(array)
        assert copy.dtype == array.dtype
        assert copy.ctypes.data % LINE == 0
        assert copy.flags.c_contiguous
        assert not np.shares_memory(copy, array)
        np.testing.assert_array_equal(copy, array)


def test_states_and_patterns_begin_lines() -> None:
    model = PlainModel(SENSOR, 1)
    state = model.init(3)
    restored = PlainState.restore(state.save())
    for each in (state, state.copy(), restored):
        assert each == state
        for name, array in each.arrays().items():
            assert array.ctypes.data % LINE == 0, name
    pattern = model.pattern(3)
    for name in ("on", "off", "leak", "phase"):
        assert getattr(pattern, name).ctypes.data % LINE == 0, name
