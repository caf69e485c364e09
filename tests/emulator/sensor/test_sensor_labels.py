"""Every event can say why it came about and what its pixel shows."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest

from evs.drivers.files import read
from evs.drivers.files.npz import NpzRecorder
from evs.drivers.run.config import load
from evs.emulator import EventCamera, Pixels, World
from evs.emulator.base.scene import F32
from evs.emulator.config import ModelConfig, SensorConfig
from evs.emulator.sensor import PlainModel, SensorParameters
from evs.msgs import LABEL_DTYPE, Cause, EvsError, take_labels

GREY: F32 = np.full((20, 30), 0.5, np.float32)

SCENE = """<mujoco><option gravity="0 0 0"/>
<visual><headlight ambient="0.4 0.4 0.4"/></visual>
<worldbody>
  <geom name="wall" type="box" pos="0 2 0" size="3 0.1 3" rgba="0.2 0.2 0.2 1"/>
  <body name="ball"><joint type="slide" axis="1 0 0"/>
    <geom name="ball" size="0.3" rgba="1 1 1 1"/></body>
  <camera name="eye" pos="0 -2 0" xyaxes="1 0 0 0 0 1"/>
</worldbody></mujoco>"""

NOISE = {
    Cause.LEAK: {"leak_rate_hz": 100.0},
    Cause.SHOT: {"shot_noise_rate_hz": 100.0},
    Cause.HOT: {"hot_leak_median_hz": 100.0, "hot_leak_cov_decades": 0.0},
}


def sensor(**terms: float) -> SensorParameters:
    return SensorParameters("test", 30, 20, 0.2, 0.2, 0.02, **terms)


def seen(pixel: SensorParameters, frames: list[F32], causes: bool) -> Any:
    model = PlainModel(pixel, 1, causes=causes)
    state, found = model.init(3), []
    for k, frame in enumerate(frames):
        events, state = model.step(frame, state, (k - 1) * 1000, k * 1000)
        found.append(events)
    return np.concatenate([events.view(np.uint8) for events in found]).view(found[0].dtype)


@pytest.mark.parametrize("cause", NOISE)
def test_still_light_has_the_noise_that_is_on(cause: Cause) -> None:
    events = seen(sensor(**NOISE[cause]), [GREY] * 100, True)
    labels = take_labels(events, np.zeros((20, 30), np.int32))
    assert len(labels) > 100
    assert set(labels["cause"]) == {cause}


def test_light_is_a_signal_among_all_noise() -> None:
    every = {key: value for terms in NOISE.values() for key, value in terms.items()}
    every |= {"hot_leak_median_hz": 0.1, "hot_leak_cov_decades": 1.15}
    events = seen(sensor(**every), [GREY] * 50 + [GREY * 4] * 50, True)
    step = events["t"] > 49_000
    step &= events["t"] <= 50_000
    causes = take_labels(events, np.zeros((20, 30), np.int32))["cause"]
    assert set(causes) == {Cause.SIGNAL, Cause.LEAK, Cause.SHOT, Cause.HOT}
    assert set(causes[~step]) == {Cause.LEAK, Cause.SHOT, Cause.HOT}
    assert np.count_nonzero(causes[step] == Cause.SIGNAL) > 0.95 * np.count_nonzero(step)


def test_causes_change_nothing_else_and_leave_the_padding_clean() -> None:
    every = {key: value for terms in NOISE.values() for key, value in terms.items()}
    frames = [GREY] * 5 + [GREY * 2] * 5
    with_causes, without = (seen(sensor(**every), frames, causes) for causes in (True, False))
    assert with_causes.tobytes() != without.tobytes()
    labels = take_labels(with_causes, np.arange(600, dtype=np.int32).reshape(20, 30))
    assert with_causes.tobytes() == without.tobytes()
    assert labels.dtype == LABEL_DTYPE
    np.testing.assert_array_equal(labels["geom_id"], without["y"] * 30 + without["x"])


def test_a_packet_says_the_geom_under_each_event() -> None:
    model = mujoco.MjModel.from_xml_string(SCENE)
    quiet = SensorConfig(preset="ideal", width=60, height=40)
    world = World(model, tick_us=1000)
    camera = world.add_camera("eye", sensor=quiet, model=ModelConfig(labels=True))
    plain = World(model, tick_us=1000)
    unlabelled = plain.add_camera("eye", sensor=quiet)
    geoms = set()
    for each in (world, plain):
        each.data.qvel[:] = 3.0
    for _ in range(40):
        (packet,), (other,) = world.step(), plain.step()
        assert packet.labels is not None
        assert packet.events.tobytes() == other.events.tobytes()
        truth = camera.ground_truth()
        events, labels = packet.events, packet.labels
        there = events["y"], events["x"]
        for name in ("geom_id", "depth", "flow"):
            np.testing.assert_array_equal(labels[name], getattr(truth, name)[there])
        names = [camera.info.classes[number] for number in labels["class_id"]]
        assert names == [model.geom(number).name for number in labels["geom_id"]]
        assert set(labels["cause"]) <= {Cause.SIGNAL}
        geoms |= set(labels["geom_id"].tolist())
    # what the ball covers now, and the wall that it has left
    assert geoms == {model.geom("ball").id, model.geom("wall").id}
    assert other.labels is None
    assert unlabelled.events == camera.events > 100


def test_in_a_loop_of_the_users_own() -> None:
    model = mujoco.MjModel.from_xml_string(SCENE)
    data = mujoco.MjData(model)
    data.qvel[:] = 3.0
    eye = EventCamera(model, "eye", sensor="ideal", model_config=ModelConfig(labels=True))
    assert eye.labels is None
    for _ in range(5):
        mujoco.mj_step(model, data)
        events = eye.observe(data)
    assert eye.labels is not None
    assert len(eye.labels) == len(events) > 0


def test_a_recording_keeps_them(tmp_path: Path) -> None:
    world = World(mujoco.MjModel.from_xml_string(SCENE))
    model = ModelConfig(labels=True, classes=("round=ball",))
    camera = world.add_camera("eye", sensor="ideal", model=model)
    world.data.qvel[:] = 3.0
    recorder = NpzRecorder(tmp_path / "a.npz")
    recorder.open([camera.info])
    parts = []
    for _ in range(5):
        (packet,) = world.step()
        recorder.write(packet)
        assert packet.labels is not None
        parts.append(packet.labels)
    recorder.close()
    labels = np.concatenate(parts)
    recording = read(tmp_path / "a.npz")
    assert recording.labels is not None
    assert len(recording) == len(labels) > 0
    for name in labels.dtype.names:
        np.testing.assert_array_equal(recording.labels[name], labels[name])
    assert recording.stream.classes == ["wall", "round"]
    with np.load(tmp_path / "a.npz") as file:
        arrays = dict(file)
    for name in labels.dtype.names:
        np.testing.assert_array_equal(arrays[name], labels[name])

    # an archive of less
    for name in ("class_id", "depth", "flow"):
        del arrays[name]
    np.savez(tmp_path / "old.npz", **arrays)
    old = read(tmp_path / "old.npz").labels
    assert old is not None
    np.testing.assert_array_equal(old["geom_id"], labels["geom_id"])
    assert set(old["class_id"]) == {-1}
    assert np.isnan(old["depth"]).all()
    assert np.isnan(old["flow"]).all()


@pytest.mark.parametrize(
    ("name", "column", "text"),
    [
        ("flow", np.zeros((3, 3)), "array 'flow' is .3, 3., not .3, 2."),
        ("depth", np.full(3, 0.1), "values that are no depth"),
        ("class_id", np.array([0, 1, 1 << 40]), "values that are no class_id"),
    ],
)
def test_labels_of_another_kind_are_refused(
    tmp_path: Path, name: str, column: Any, text: str
) -> None:
    arrays = {"t": [1, 2, 3], "x": [0, 0, 0], "y": [0, 0, 0], "p": [1, 1, 1]}
    labels = {"cause": np.ones(3, np.uint8), "geom_id": np.zeros(3, np.int32), name: column}
    np.savez(tmp_path / "a.npz", **arrays, **labels)
    with pytest.raises(EvsError, match=text):
        read(tmp_path / "a.npz")


def test_classes_without_labels_are_refused() -> None:
    world = World(mujoco.MjModel.from_xml_string(SCENE))
    with pytest.raises(EvsError, match=r"add model\.labels=true"):
        world.add_camera("eye", sensor="ideal", model=ModelConfig(classes=("a=ball",)))
    with pytest.raises(EvsError, match="frames have none"):
        Pixels("ideal", size=(8, 8), model=ModelConfig(labels=True, classes=("a=ball",)))


def test_a_recording_without_a_place_for_them_is_refused(tmp_path: Path) -> None:
    scene = tmp_path / "ball.xml"
    scene.write_text(SCENE)
    keys = {"scene.file": str(scene), "model.labels": "true", "record": "a.aedat4"}
    with pytest.raises(EvsError, match=r"at model.labels: only .npz recordings hold labels"):
        load(overrides=keys.items())
    assert load(overrides=(keys | {"record": "a.npz"}).items()).model.labels
