"""The contract of everything resumable: it goes on with the same bytes, or nothing has changed."""

from __future__ import annotations

import struct
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np
import pytest

import evs
from evs.emulator.state import Resumable, pack, unpack
from evs.msgs import EvsError
from reference.worlds_alone import SWING

SENSOR = evs.SensorConfig(
    "davis346", width=16, height=12, latency_us=900.0, shot_noise_rate_hz=100.0,
    aps=evs.ApsConfig(enabled=True, rate_hz=150.0, exposure_us=4000),
    readout=evs.ReadoutConfig(order="arbiter", column_ns=900, jitter_ns=30.0),
)  # fmt: skip
MOVING = evs.SensorConfig(**{**vars(SENSOR), "imu": evs.ImuConfig(enabled=True)})


@dataclass(frozen=True)
class Kind:
    """How to make one, and what it gives from one tick to another."""

    make: Callable[..., Any]
    step: Callable[[Any, int], Any]


def world(seed: int = 1, threads: int = 1, **options: Any) -> evs.World:
    made = evs.World(mujoco.MjModel.from_xml_string(SWING), seed=seed, threads=threads, **options)
    made.add_camera("left", sensor=MOVING)
    made.add_camera("right", sensor=SENSOR, model=evs.ModelConfig(name="evsnet"))
    return made


def loop(seed: int = 1, threads: int = 1, transport_us: int = 2500) -> evs.ClosedLoop:
    delays = evs.DelayConfig(transport_us, 500.0, 0.1, 1500, 300.0)
    made = evs.ClosedLoop.around(world(seed, threads), limits={"angle": (-9, 9)}, delays=delays)
    made.reset()
    return made


def event_camera(seed: int = 1, threads: int = 1, **options: Any) -> evs.EventCamera:
    model = mujoco.MjModel.from_xml_string(SWING)
    given = {"sensor": MOVING, "model_config": evs.ModelConfig("adaptive"), **options}
    return evs.EventCamera(model, "left", seed=seed, threads=threads, **given)


def pixels(seed: int = 1, threads: int = 1, **options: Any) -> evs.Pixels:
    return evs.Pixels(SENSOR, seed=seed, threads=threads, **options)


def observe(camera: evs.EventCamera, tick: int) -> Any:
    data = mujoco.MjData(camera._model)
    data.time, data.qpos[0] = 1e-3 * tick, np.sin(tick / 5)
    mujoco.mj_kinematics(camera._model, data)
    mujoco.mj_camlight(camera._model, data)
    return camera.observe(data), camera.frames, camera.imu


def see(one: evs.Pixels, tick: int) -> Any:
    light = np.random.default_rng(tick).uniform(0.1, 1, (12, 16)).astype(np.float32)
    return one.observe(light, 1000 * tick), one.frames


def step(one: evs.World, tick: int) -> Any:
    packets = one.step([np.sin(tick)])
    return [(p, c.frames, c.imu) for p, c in zip(packets, one.cameras, strict=True)]


KINDS = {
    "world": Kind(world, step),
    "loop": Kind(loop, lambda one, tick: one.step([np.sin(tick)])),
    "sensor": Kind(event_camera, observe),
    "pixels": Kind(pixels, see),
}
OTHERS: dict[str, tuple[Callable[[], Any], str]] = {
    "world": (lambda: world(tick_us=2000), "scene.tick_us was 1000, here it is 2000"),
    "loop": (lambda: loop(transport_us=0), "loop.delays.transport_us was 2500, here it is 0"),
    "sensor": (lambda: event_camera(sensor=SENSOR), "sensor.imu.enabled was True, here it is"),
    "pixels": (lambda: pixels(unit="dn"), "frames.unit was auto, here it is dn"),
}


def plain(value: Any) -> Any:
    """Something that is equal where every byte is."""
    if isinstance(value, np.ndarray):
        return value.tobytes()
    if isinstance(value, list | tuple):
        return [plain(one) for one in value]
    return plain(list(vars(value).values())) if hasattr(value, "__dataclass_fields__") else value


def drive(kind: Kind, one: Any, begin: int, end: int) -> list[Any]:
    return [plain(kind.step(one, tick)) for tick in range(begin, end)]


@pytest.fixture(scope="module", params=KINDS)
def name(request: pytest.FixtureRequest) -> str:
    return str(request.param)


@pytest.fixture(scope="module")
def saved(name: str) -> bytes:
    """In the middle of exposures, delays and a readout."""
    one = KINDS[name].make(seed=5)
    drive(KINDS[name], one, 1, 14)
    return bytes(one.save())


@pytest.mark.parametrize("compress", [False, True])
@pytest.mark.parametrize("cut", [1, 14], ids=["begin", "middle"])
def test_it_goes_on_with_the_same_bytes(name: str, cut: int, compress: bool) -> None:
    kind = KINDS[name]
    one, other = kind.make(seed=5), kind.make(seed=8, threads=2)
    assert isinstance(one, Resumable)
    drive(kind, one, 1, cut)
    blob = one.save(compress)
    assert one.save(compress) == blob
    rest = drive(kind, one, cut, 30)
    # another one, of another seed, that has been elsewhere
    drive(kind, other, 1, 6)
    other.restore(blob)
    assert other.save(compress) == blob
    assert drive(kind, other, cut, 30) == rest
    assert other.save() == one.save()
    # and back in the one that went on
    one.restore(blob)
    assert drive(kind, one, cut, 30) == rest


def refused(one: Any, blob: Any, says: str = ".") -> None:
    before = one.save()
    with pytest.raises(EvsError, match=says) as caught:
        one.restore(blob)
    assert "\n" not in str(caught.value)
    assert one.save() == before


@pytest.mark.parametrize(
    ("spoil", "says"),
    [
        (lambda b: b"", "no saved state of evs"),
        (lambda b: b"PK\x03\x04" + b, "no saved state of evs"),
        (lambda b: b[:8] + struct.pack("<I", 2) + b[12:], "format 2, this evs reads 1"),
        (lambda b: b[:-1], "is damaged: its checksum"),
        (lambda b: b + b"\0", "is damaged: its checksum"),
        (lambda b: "text", "a saved state is bytes, not str"),
    ],
)
def test_bytes_that_are_none_are_refused(
    name: str, saved: bytes, spoil: Callable[[bytes], Any], says: str
) -> None:
    refused(KINDS[name].make(), spoil(saved), says)


def test_a_state_of_something_else_is_refused(name: str, saved: bytes) -> None:
    for other, kind in KINDS.items():
        if other != name:
            refused(kind.make(), saved, f"saved by a {name}, this is a {other}")
    make, says = OTHERS[name]
    refused(make(), saved, says)


@pytest.mark.parametrize(
    "name",
    ["sensor", "pixels", *(pytest.param(n, marks=pytest.mark.slow) for n in ("world", "loop"))],
    indirect=True,
    scope="module",
)
def test_damage_that_a_checksum_hides_changes_nothing(name: str, saved: bytes) -> None:
    """Every array in turn is left out, is of another kind or another shape."""
    one = KINDS[name].make()
    drive(KINDS[name], one, 1, 3)
    about, arrays = unpack(saved)
    for key, array in arrays.items():
        # any word may be the reason of an end, and what has not begun has no time
        changes = [np.zeros((*array.shape, 2), np.float32)]
        changes += [] if key == "done" else [np.array("?")]
        changes += (
            [array.reshape(-1)[:0]]
            if array.size and not key.endswith(("t_us", "next_index"))
            else []
        )
        refused(one, pack(about, {k: v for k, v in arrays.items() if k != key}))
        for change in changes:
            refused(one, pack(about, {**arrays, key: change}))
