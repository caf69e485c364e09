"""The state is a value: copied, saved, restored and compared."""

from __future__ import annotations

import numpy as np
import pytest

from evs.emulator.base.scene import F32
from evs.emulator.sensor import PlainModel, PlainState, SensorParameters
from evs.msgs import EvsError

SENSOR = SensorParameters("test", 31, 17, 0.1, 0.12, 0.02)


def frame(k: int) -> F32:
    light = np.exp(np.random.default_rng(k).normal(-1, 1, (17, 31))).astype(np.float32)
    light[3, 4] = np.nan if k % 3 else 1.0
    return light


def advance(
    model: PlainModel, state: PlainState, first: int, last: int
) -> tuple[bytes, PlainState]:
    parts = []
    for k in range(first, last):
        events, state = model.step(frame(k), state, k * 1000, (k + 1) * 1000)
        parts.append(events.tobytes())
    return b"".join(parts), state


def test_one_model_serves_many_states() -> None:
    model = PlainModel(SENSOR, 1)
    alone = [advance(model, model.init(seed), 0, 6)[0] for seed in (1, 2)]
    assert alone[0] != alone[1]
    states, parts = [model.init(1), model.init(2)], [b"", b""]
    for k in range(6):
        for i in (0, 1):
            events, states[i] = advance(model, states[i], k, k + 1)
            parts[i] += events
    assert parts == alone


def test_a_copy_is_its_own() -> None:
    model = PlainModel(SENSOR, 1)
    _, state = advance(model, model.init(0), 0, 3)
    kept = state.copy()
    assert kept == state
    advance(model, state, 3, 4)
    assert kept != state


def test_saving_is_a_snapshot() -> None:
    model = PlainModel(SENSOR, 1)
    _, state = advance(model, model.init(0), 0, 3)
    kept, saved = state.copy(), state.save()
    advance(model, state, 3, 4)
    assert PlainState.restore(saved) == kept


def test_comparison_sees_every_part() -> None:
    model = PlainModel(SENSOR, 1)
    _, state = advance(model, model.init(0), 0, 3)
    assert state.clamped == 2
    for name in ("reference", "last_log", "last_luminance"):
        other = state.copy()
        getattr(other, name)[2, 2] += 1
        assert other != state
    other = state.copy()
    other.clamped += 1
    assert other != state
    other = state.copy()
    other.seed += 1
    assert other != state
    assert model.init(-1) == model.init(2**64 - 1)
    assert model.init(0) == model.init(0)  # all NaN
    assert model.init(0) != "state"


def test_unfit_saves_are_refused() -> None:
    saved = PlainModel(SENSOR, 1).init(0).save()
    with pytest.raises(EvsError, match="lacks 'reference'"):
        PlainState.restore({k: v for k, v in saved.items() if k != "reference"})
    with pytest.raises(EvsError, match="different shapes"):
        PlainState.restore(saved | {"last_log": np.zeros((2, 2), np.float32)})
    for damaged in (np.inf, -1e6):
        with pytest.raises(EvsError, match="is damaged"):
            PlainState.restore(saved | {"reference": np.full((17, 31), damaged)})
