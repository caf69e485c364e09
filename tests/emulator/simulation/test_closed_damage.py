"""Saved states that were damaged: refused in one line, whatever was damaged; never a crash."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from evs.emulator import ClosedLoop
from evs.emulator.config import (
    ApsConfig,
    ImuConfig,
    ModelConfig,
    ReadoutConfig,
    RenderConfig,
    SensorConfig,
)
from evs.emulator.config.schema import DelayConfig
from evs.emulator.state import pack, unpack
from evs.msgs import EvsError
from reference.worlds_alone import SWING

pytestmark = pytest.mark.property


def make():
    model = mujoco.MjModel.from_xml_string(SWING)
    sensor = SensorConfig(
        "davis346", width=12, height=9, latency_us=1500.0, shot_noise_rate_hz=100.0,
        aps=ApsConfig(enabled=True, rate_hz=150.0, exposure_us=4000), imu=ImuConfig(enabled=True),
        readout=ReadoutConfig(order="arbiter", column_ns=5000),
    )  # fmt: skip
    loop = ClosedLoop(model, "left", sensor=sensor, render=RenderConfig(spp=1), threads=1,
                delays=DelayConfig(2500, 500.0, 0.1, 1500, 300.0))  # fmt: skip
    loop.world.add_camera("right", sensor=sensor, render=RenderConfig(spp=1),
                          model=ModelConfig(name="evsnet"))  # fmt: skip
    return ClosedLoop.around(loop.world, delays=DelayConfig(2500, 500.0, 0.1, 1500, 300.0))


@pytest.fixture(scope="module")
def loop():
    return make()


@pytest.fixture(scope="module")
def blob(loop):
    loop.reset(seed=3)
    for tick in range(15):
        loop.step([np.sin(tick)])
    return loop.save()


@given(data=st.data())
@settings(max_examples=300)
def test_any_damage_is_seen(loop, blob, data):
    raw = bytearray(blob)
    way = data.draw(st.sampled_from(["flip", "cut", "more", "swap", "zero"]))
    place = data.draw(st.integers(0, len(raw) - 1))
    if way == "flip":
        raw[place] ^= 1 << data.draw(st.integers(0, 7))
    elif way == "cut":
        del raw[place:]
    elif way == "more":
        raw[place:place] = data.draw(st.binary(min_size=1, max_size=9))
    else:
        end = place + data.draw(st.integers(1, 64))
        raw[place:end] = raw[place:end][::-1] if way == "swap" else b"\0" * len(raw[place:end])
    if bytes(raw) == blob:
        return
    before = loop.t_us
    with pytest.raises(EvsError) as caught:
        loop.restore(bytes(raw))
    assert "\n" not in str(caught.value)
    assert loop.t_us == before


def step_if_restored(loop, blob):
    """Nothing but one line of an EvsError may come of it."""
    said = []
    try:
        loop.restore(blob)
        loop.step([0.3], ticks=3)
        loop.save()
    except EvsError as error:
        said.append(str(error))
    assert all(text and "\n" not in text for text in said)


EXTREMES = [0, 1, -1, 2**31, -(2**31), 2**62, -(2**62), 2**63 - 1, -(2**63), 7]


@pytest.mark.slow
@given(data=st.data())
@settings(max_examples=400)
def test_values_that_lie_under_a_right_checksum_do_no_harm(loop, blob, data):
    """Refused in one line, at once or when it steps; or it steps. Never a crash or a hang."""
    about, arrays = unpack(blob)
    name = data.draw(st.sampled_from([key for key, array in arrays.items() if array.size]))
    array = np.array(arrays[name])
    if array.dtype.kind == "U":
        array = np.array(data.draw(st.text(max_size=9)) or "-")
    else:
        flat = array.reshape(-1)
        place = (
            data.draw(st.integers(0, flat.size - 1)) if data.draw(st.booleans()) else slice(None)
        )
        if array.dtype.kind == "f":
            special = [np.nan, np.inf, -np.inf, 1e30, -1e30, 1e300, 5e-324, 0.0, -1.0]
            with np.errstate(over="ignore"):
                flat[place] = data.draw(st.sampled_from(special))
        else:
            least, most = np.iinfo(array.dtype).min, np.iinfo(array.dtype).max
            flat[place] = min(max(data.draw(st.sampled_from(EXTREMES)), least), most)
    step_if_restored(loop, pack(about, {**arrays, name: array}))


@pytest.mark.slow
@given(data=st.data())
@settings(max_examples=150)
def test_shapes_that_lie_under_a_right_checksum_do_no_harm(loop, blob, data):
    about, arrays = unpack(blob)
    name = data.draw(st.sampled_from(list(arrays)))
    array = arrays[name]
    ways = [array.reshape(-1), array[..., np.newaxis], np.concatenate([array, array])
            if array.ndim else np.array([array]), array[:0] if array.ndim else array.reshape(1),
            array[1:] if array.ndim else array, array.T]  # fmt: skip
    changed = data.draw(st.sampled_from(ways))
    if changed.shape == array.shape:
        return
    step_if_restored(loop, pack(about, {**arrays, name: changed}))
