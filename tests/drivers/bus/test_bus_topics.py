"""Pose, ground truth, calibration and clock: on the bus while somebody listens, and right."""

from __future__ import annotations

import threading
from typing import Any

import mujoco
import numpy as np
import pytest

from evs.drivers.bus import Publisher, Subscription, subscribe
from evs.drivers.clock import sleep_s
from evs.drivers.run.run import run
from evs.emulator import World
from evs.emulator.base.scene import CameraPose
from evs.emulator.config import SensorConfig
from evs.emulator.optics.camera_info import pose_message
from evs.launch.main import main
from evs.msgs import (
    TRUTH_CHANNELS,
    EventPacket,
    ImuPacket,
    MessageError,
    Pose,
    StreamInfo,
    Truth,
    empty_imu,
    encode_camera_info,
    encode_pose,
    encode_truth,
)
from evs.msgs.camera_info import camera_info_of

SCENE = """<mujoco><worldbody><light pos="0 0 3"/><geom type="plane" size="5 5 .1"/>
<body pos="0 0 1"><freejoint/><geom type="box" size=".2 .2 .2"/></body>
<camera name="eye" pos="1 -2 1.5" xyaxes="1 .5 0 0 .2 1"/></worldbody></mujoco>"""
SMALL = SensorConfig("ideal", width=32, height=24)


def heard(stream: Subscription, into: dict[str, list[Any]]) -> None:
    for packet in stream:
        into["packets"].append(packet)
        into["poses"] += stream.poses
        into["truths"] += stream.truths
        into["clocks"].append(stream.clock)


def test_a_run_publishes_them_all(address: str) -> None:
    world = World(mujoco.MjSpec.from_string(SCENE))
    camera = world.add_camera("eye", sensor=SMALL)
    into: dict[str, list[Any]] = {"packets": [], "poses": [], "truths": [], "clocks": []}
    options = {"poses": True, "truths": True, "clock": True, "camera_info": True}
    with subscribe(address, "eye", timeout_s=20, **options) as stream:  # type: ignore[arg-type]
        listener = threading.Thread(target=heard, args=(stream, into))
        listener.start()
        run(world, [Publisher(address, wait_for=1, truth_hz=50.0)], 0.12)
        listener.join()
        assert stream.ended
        assert (len(into["packets"]), stream.bad_messages, stream.lost) == (120, 0, 0)
        # one pose a tick, at its end; the camera stands
        assert [pose.t_us for pose in into["poses"]] == [1000 * k for k in range(1, 121)]
        assert [pose.seq for pose in into["poses"]] == list(range(1, 121))
        assert len({pose.position for pose in into["poses"]}) == 1
        assert into["poses"][0].position == (1.0, -2.0, 1.5)
        # every 20 ms, and the last is what the camera says of the last tick
        assert [truth.t_us for truth in into["truths"]] == [20_000 * k for k in range(1, 7)]
        last, found = camera.ground_truth(), into["truths"][-1]
        for key in TRUTH_CHANNELS:
            np.testing.assert_array_equal(found.channels[key], getattr(last, key))
        # all events up to the clock have come
        clocks = [clock for clock in into["clocks"] if clock is not None]
        assert clocks[-1].t_us >= 119_000
        assert all(
            clock is None or clock.t_us <= packet.time_end_us
            for clock, packet in zip(into["clocks"], into["packets"], strict=True)
        )
        assert stream.camera_info["eye"] == camera_info_of(camera.info)
        assert {key: gaps.lost for key, gaps in stream.gaps.items()} == {
            ("pose", "eye"): 0,
            ("ground_truth", "eye"): 0,
        }


def test_nothing_is_worked_out_for_nobody() -> None:
    """Ground truth is a frame to trace: without a listener nobody asks the camera for it."""
    sender = Publisher("tcp://127.0.0.1:0")
    sender.open([StreamInfo(32, 24, "eye")])
    assert not sender.wants_pose("eye")
    assert not any(sender.wants_truth("eye", t_us) for t_us in range(0, 10**6, 1000))
    sender.close()


@pytest.mark.parametrize("seed", range(20))
def test_the_pose_turns_the_optical_frame_into_the_world(seed: int) -> None:
    random = np.random.default_rng(seed)
    quat = random.standard_normal(4)
    # near a half turn, where a naive formula divides by zero
    quat[0] *= 10.0 ** random.integers(-12, 1)
    quat /= np.linalg.norm(quat)
    matrix = np.zeros(9)
    mujoco.mju_quat2Mat(matrix, quat)
    said = pose_message(CameraPose(random.standard_normal(3), matrix), 3, 3000, "eye")
    x, y, z, w = said.orientation
    back = np.zeros(9)
    mujoco.mju_quat2Mat(back, np.array([w, x, y, z]))
    # x right, y down, z forward, where MuJoCo's camera has x right, y up, z back
    wanted = matrix.reshape(3, 3) @ np.diag([1.0, -1.0, -1.0])
    np.testing.assert_allclose(back.reshape(3, 3), wanted, atol=1e-12)
    encode_pose(said)


def test_the_loss_of_the_last_ones_is_counted(address: str) -> None:
    """A status says which IMU packet was the last, so none is missed unseen."""
    with subscribe(address, imu=True, timeout_s=20) as stream:
        sender = Publisher(address, wait_for=1)
        sender.open([StreamInfo(32, 24, "eye", imu=True)])
        for seq in range(250):
            sample = empty_imu(1)
            sample["t"] = 1000 * seq + 1
            if seq < 100 or seq % 2:
                sender.write_imu(ImuPacket(seq, sample, "eye"))
            else:
                # as a full queue leaves it: counted, and never sent
                sender._audience.channels["eye"].last["imu"] = seq
            sender.write(EventPacket(seq, 1000 * seq, 1000 * seq + 1000, 32, 24, camera="eye"))
            if seq == 248:
                sender._audience.channels["eye"].last["imu"] = 249
        closing = threading.Thread(target=sender.close)
        closing.start()
        assert sum(1 for _ in stream) == 250
        closing.join()
        gaps = stream.gaps["imu", "eye"]
        assert (gaps.count, gaps.lost) == (175, 75)


@pytest.mark.parametrize(
    "pose",
    [
        Pose(-1, 0, (0, 0, 0), (0, 0, 0, 1)),
        Pose(0, 0, (0, 0, float("nan")), (0, 0, 0, 1)),
        Pose(0, 0, (0, 0, 0), (0, 0, 0, 1.1)),
        Pose(0, 2**70, (0, 0, 0), (0, 0, 0, 1)),
        Pose(0, 0, (0, 0, 0), (0, 0, 0, 1), "a\nb"),
    ],
)
def test_a_pose_that_is_none_is_not_sent(pose: Pose) -> None:
    with pytest.raises(MessageError):
        encode_pose(pose)


def test_a_calibration_that_is_none_is_not_sent() -> None:
    info = {"width": 3, "height": 2, "distortion_model": "none", "d": [], "k": [1.0] * 9}
    whole = StreamInfo(3, 2, "eye", camera_info={**info, "r": [1] * 9, "p": (0,) * 12})
    found = camera_info_of(whole)
    assert found is not None
    encode_camera_info(found)
    assert camera_info_of(StreamInfo(3, 2, "eye")) is None
    with pytest.raises(MessageError, match="'r'"):
        camera_info_of(StreamInfo(3, 2, "eye", camera_info=info))
    with pytest.raises(MessageError, match="12 numbers"):
        camera_info_of(StreamInfo(3, 2, "eye", camera_info={**info, "r": [1] * 9, "p": [1]}))


def test_half_a_truth_is_not_sent() -> None:
    planes = {
        key: np.zeros((2, 3) if count == 1 else (2, 3, count), kind)
        for key, (kind, count) in TRUTH_CHANNELS.items()
    }
    encode_truth(Truth(0, 0, planes))
    with pytest.raises(MessageError, match="another shape"):
        encode_truth(Truth(0, 0, {**planes, "flow": np.zeros((2, 3, 3))}))
    del planes["flow"]
    with pytest.raises(MessageError, match="all of"):
        encode_truth(Truth(0, 0, planes))


def test_echo_shows_poses(address: str, capsys: pytest.CaptureFixture[str]) -> None:
    listening = threading.Thread(target=main, args=(["echo", address, "--poses", "--count", "1"],))
    listening.start()
    sender = Publisher(address, wait_for=1, wait_s=20, linger_s=1.0)
    sender.open([StreamInfo(32, 24, "eye")])
    while sender.wants_pose("eye") is False:
        sleep_s(0.01)
    sender.write_pose(Pose(0, 1000, (1.0, 2.0, 3.0), (0.0, 0.0, 0.0, 1.0), "eye"))
    sender.write(EventPacket(0, 0, 1000, 32, 24, camera="eye"))
    listening.join()
    sender.close()
    out = capsys.readouterr().out
    assert "eye pose  t 0.001000 s  at 1.0000 2.0000 3.0000 m  quaternion 0.0000" in out
