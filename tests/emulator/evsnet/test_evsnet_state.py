"""NetworkState is a value: copied, saved, restored and compared; what is damaged is refused."""

from __future__ import annotations

import io

import numpy as np
import pytest

from evs.emulator.base.scene import F32
from evs.emulator.evsnet.model import EvsNetModel
from evs.emulator.evsnet.state import NetworkState, identity
from evs.emulator.sensor import SensorParameters
from evs.msgs import EvsError
from reference.networks import random_network

SENSOR = SensorParameters("test", 13, 7, 0.2, 0.25)


def film(first: int, last: int) -> F32:
    frames = []
    for k in range(first, last):
        light = np.exp(np.random.default_rng(k).normal(-1, 1, (7, 13))).astype(np.float32)
        light[3, 4] = np.nan if k % 3 else 1.0
        frames.append(light)
    return np.stack(frames)


def model(**settings: object) -> EvsNetModel:
    return EvsNetModel(SENSOR, random_network(2, 4), runtime="reference", **settings)  # type: ignore[arg-type]


def advance(model: EvsNetModel, state: NetworkState, first: int, last: int) -> bytes:
    events, out = model.step_chunk(film(first, last), state, first * 1000, 1000)
    assert out is state
    return b"".join(tick.tobytes() for tick in events)


def test_restored_in_mid_stream_goes_on_with_the_same_bytes() -> None:
    state = model().init(5)
    whole = advance(model(), state, 0, 30)

    other = model().init(5)
    first = advance(model(), other, 0, 17)
    file = io.BytesIO()
    np.savez(file, **other.save())
    file.seek(0)
    # another process: nothing but sensor, network and the file
    with np.load(file) as saved:
        restored = NetworkState.restore(saved)
    assert restored == other
    second = advance(model(), restored, 17, 30)
    assert first + second == whole
    assert len(whole) > 16 * 100
    assert restored == state
    assert state.ticks == 30
    assert state.clamped == 20


def test_a_copy_is_its_own_and_saving_is_a_snapshot() -> None:
    state = model().init(0)
    advance(model(), state, 0, 3)
    kept, saved = state.copy(), state.save()
    assert kept == state
    advance(model(), state, 3, 4)
    assert kept != state
    assert NetworkState.restore(saved) == kept


def test_one_model_serves_many_states() -> None:
    one = model()
    alone = [advance(model(), model().init(seed), 0, 6) for seed in (1, 2)]
    assert alone[0] != alone[1]
    states, parts = [one.init(1), one.init(2)], [b"", b""]
    for k in range(6):
        for i in (0, 1):
            parts[i] += advance(one, states[i], k, k + 1)
    assert parts == alone


def test_comparison_sees_every_part() -> None:
    state = model().init(7)
    advance(model(), state, 0, 3)
    for name in state.arrays:
        other = state.copy()
        other.arrays[name].view(np.uint8)[(0,) * other.arrays[name].ndim] ^= 1
        assert other != state, name
    for name in ("seed", "ticks", "clamped", "x_clamped", "v_clamped"):
        other = state.copy()
        setattr(other, name, getattr(other, name) + 1)
        assert other != state, name
    for name in ("runtime", "network"):
        other = state.copy()
        setattr(other, name, "another")
        assert other != state, name
    other = state.copy()
    del other.arrays["fifo1"]
    assert other != state
    assert state != "another thing"
    # seeds count modulo 2^64
    other = state.copy()
    other.seed += 2**64
    assert other == state


@pytest.mark.parametrize(
    ("name", "value", "says"),
    [
        ("v", None, "saved network state lacks 'v'; save it with NetworkState.save"),
        ("ticks", None, "lacks 'ticks'"),
        ("runtime", None, "lacks 'runtime'"),
        ("v", np.full((7, 13), 65.0, np.float32), "v is invalid"),
        ("v", np.full((7, 13), np.nan, np.float32), "v is invalid"),
        ("v", np.zeros((7, 13)), "v is invalid"),
        ("v", np.zeros((7, 12), np.float32), "different shapes"),
        ("v", np.array("text"), "v is invalid"),
        ("last", np.full((7, 13), 4), "last is invalid"),
        ("last", np.full((7, 13), -1), "last is invalid"),
        ("last_log", np.full((7, 13), np.inf, np.float32), "last_log is invalid"),
        ("last_luminance", np.full((7, 13), np.nan, np.float32), "last_luminance is invalid"),
        ("fifo0", np.full((1, 6, 91), np.nan, np.float32), "fifo0 is invalid"),
        ("fifo0", np.full((1, 6, 91), 1e38, np.float32), "fifo0 is invalid"),
        ("ticks", np.array(-1), "ticks is invalid"),
        ("ticks", np.array(2**60), "ticks is invalid"),
        ("ticks", np.zeros(2, np.int64), "ticks is invalid"),
        ("ticks", np.array(3.0), "ticks is invalid"),
        ("runtime", np.array(3), "runtime is invalid"),
    ],
)
def test_what_cannot_be_is_refused(name: str, value: np.ndarray | None, says: str) -> None:
    state = model().init(0)
    advance(model(), state, 0, 3)
    saved = state.save()
    if value is None:
        del saved[name]
    else:
        saved[name] = value
    with pytest.raises(EvsError, match=says) as error:
        NetworkState.restore(saved)
    assert "\n" not in str(error.value)


def test_the_identity_is_of_all_that_shapes_events() -> None:
    from dataclasses import replace

    weights = random_network(2, 4, biased=True)
    known = identity(weights)
    assert known == identity(random_network(2, 4, biased=True))
    encoder = weights.encoder
    moved = encoder.weight.copy()
    moved[0, 0, 0] += np.float32(1e-3)
    assert encoder.bias is not None
    changed = [
        replace(weights, tau_s=0.51),
        replace(weights, threshold=0.21),
        replace(weights, linlog_dn=20.0),
        replace(weights, tick_us=500),
        replace(weights, last_bias=0.02),
        replace(weights, last=weights.last * np.float32(2)),
        replace(weights, encoder=replace(encoder, weight=moved)),
        replace(weights, encoder=replace(encoder, bias=encoder.bias * np.float32(2))),
        replace(weights, encoder=replace(encoder, bias=None)),
        replace(weights, encoder=replace(encoder, look_ahead=1)),
        replace(weights, blocks=weights.blocks[:-1]),
        replace(weights, name="other"),
    ]
    assert len({known, *map(identity, changed)}) == len(changed) + 1
