"""What a sink for ROS 2 can be told, by its own keys and by the real drivers' names."""

from __future__ import annotations

import re
import sys
from typing import Any

import pytest

from evs.drivers.ros2 import Ros2Publisher
from evs.drivers.run import config as pipeline
from evs.drivers.run.launcher.plan import read_plan
from evs.msgs import EventPacket, EvsError, StreamInfo

pytest.importorskip("cyclonedds")


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ({"send_queue_size": 0}, "send_queue_size is 0"),
        ({"wait_s": -1.0}, "wait_s is -1"),
        ({"encoding": "raw"}, "evt3"),
        ({"domain_id": 500}, "domain_id is 500"),
        ({"interface": "eth99"}, "no network interface 'eth99'"),
        ({"statistics_print_interval": -2.0}, "statistics_print_interval is -2"),
        ({"event_message_time_threshold": 1e9}, "event_message_time_threshold"),
    ],
)
def test_values_that_cannot_be_are_refused_before_anything_opens(
    options: dict[str, Any], says: str
) -> None:
    with pytest.raises(EvsError, match=says):
        Ros2Publisher(**options)


@pytest.mark.parametrize(
    ("streams", "options", "says"),
    [
        ([StreamInfo(346, 260, "left-eye")], {}, "set node = left_eye"),
        ([StreamInfo(2560, 1440, "eye")], {}, "set encoding = libcaer"),
        ([StreamInfo(9, 9, "a"), StreamInfo(9, 9, "b")], {"node": "x"}, "there are 2 cameras"),
        (
            [StreamInfo(9, 9, "a"), StreamInfo(9, 9, "b")],
            {"imu_frame_id": "x"},
            "imu_frame_id is 'x'",
        ),
        ([StreamInfo(9, 9, "a")], {"link_frame_id": "x", "camera_frame_id": "x"}, "are both 'x'"),
        ([StreamInfo(9, 9, "a")], {"world_frame": "a_link"}, "world_frame and .* 'a_link'"),
        ([StreamInfo(9, 9, "a"), StreamInfo(9, 9, "a")], {}, "two cameras would be one ROS node"),
    ],
)
def test_cameras_that_cannot_be_nodes(
    streams: list[StreamInfo], options: dict[str, Any], says: str
) -> None:
    sink = Ros2Publisher(**options)
    with pytest.raises(EvsError, match=says):
        sink.open(streams)
    assert sink.close()["messages_sent"] == {}
    with pytest.raises(EvsError, match="not open"):
        sink.write(EventPacket(0, 0, 1000, 9, 9, camera="eye"))


def test_parameters_of_the_drivers_reach_sink_and_sensor() -> None:
    words = {
        "node": "event_camera",
        "event_message_time_threshold": "5.0e-3",
        "reliable": "true",
        "send_queue_size": "7",
        "statistics_print_interval": "2.0",
        "camera_frame_id": "lens",
        "imu_frame_id": "gyro",
        "roi": "[80, 60, 160, 120]",
        "erc_mode": "enabled",
        "erc_rate": "20000000",
    }
    given = [("scene.file", "x.xml"), ("sink.0.type", "ros2"), ("sensor.preset", "imx636")]
    given += [("sensor.biases.bias_diff_on", "20")]
    given += [(f"sink.0.{key}", text) for key, text in words.items()]
    config = pipeline.load(overrides=given)
    readout = config.sensor.readout
    assert (readout.roi, readout.erc_rate_mevs) == ((80, 60, 160, 120), 20.0)
    assert isinstance(pipeline.make_sink(config.sink[0]), Ros2Publisher)
    # what is not said changes nothing
    plain = pipeline.load(overrides=given[:2])
    assert plain.sensor.readout.erc_rate_mevs is None


@pytest.mark.parametrize(
    ("more", "says"),
    [
        ({"erc_mode": "on"}, "at sink.0.erc_mode: "),
        ({"erc_rate": "0"}, "at sink.0.erc_rate: 0 events/s"),
        ({"file": "x.mcap"}, "at sink.0.file: a ros2 sink has only: domain_id, interface"),
    ],
)
def test_parameters_that_cannot_be(more: dict[str, str], says: str) -> None:
    given = [("scene.file", "x.xml"), ("sink.0.type", "ros2")]
    with pytest.raises(EvsError, match=says):
        pipeline.load(overrides=given + [(f"sink.0.{k}", v) for k, v in more.items()])


def test_what_is_said_twice_has_to_be_the_same() -> None:
    given = [("scene.file", "x.xml"), ("sink.0.type", "ros2"), ("sink.0.erc_mode", "disabled")]
    off = pipeline.load(overrides=[*given, ("sensor.readout.erc_rate_mevs", "0")])
    assert off.sensor.readout.erc_rate_mevs == 0
    with pytest.raises(EvsError, match=r"at sink\.0\.erc_mode: sensor\.readout\.erc_rate"):
        pipeline.load(overrides=[*given, ("sensor.readout.erc_rate_mevs", "5")])


def test_without_the_library_one_line_says_what_to_install(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setitem(sys.modules, "cyclonedds.core", None)
    with pytest.raises(EvsError, match=r"pip install 'evs\[ros2\]'"):
        Ros2Publisher()


def test_the_launch_file_runs_what_a_driver_would() -> None:
    given = ["domain_id:=7", "event_message_time_threshold:=0.005", "robot:=robot.xml"]
    (driver,) = read_plan("ros2", given).nodes
    words = [word.split("=", 1) for word in driver.run if re.match(r"[\w.]+=", word)]
    config = pipeline.load(overrides=[("scene.file", "robot.xml"), *map(tuple, words)])
    (sink,) = config.sinks()
    assert (sink.type, sink.domain_id, sink.event_message_time_threshold) == ("ros2", 7, 0.005)
    assert isinstance(pipeline.make_sink(sink), Ros2Publisher)
