"""The keys of a sink for ROS 2: its own, and the parameters of the real cameras' drivers.

The parameters of the sensor itself (roi, erc_mode, erc_rate) keep their drivers' names and are
passed on to it. Biases have their drivers' names in [sensor.biases].
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

from evs.emulator.config import SensorConfig
from evs.msgs import EvsError, unknown


@dataclass(frozen=True)
class DriverParameters:
    """The keys of a [[sink]] table for ROS 2, which the driver packages have as well."""

    type: str = ""
    node: str | None = None
    """ros2, rosbag2: name of the node, as in /NODE/events; the camera's name if not given"""
    namespace: str | None = None
    """ros2, rosbag2: namespace of the node, as in robot/head"""
    domain_id: int | None = None
    """ros2: domain, 0 ... 232, as ROS_DOMAIN_ID for ROS nodes; the environment variable is not
    read"""
    interface: str | None = None
    """ros2: network interface, by name or address; lo if not given (with insecure: any)"""
    reliable: bool | None = None
    """ros2: true: all topics have reliable QoS, lost messages are sent again; false: all but tf are
    best effort; not given: as in real drivers, images, camera_info and poses are reliable"""
    camera_frame_id: str | None = None
    """ros2, rosbag2: frame of events and images (x right, y down, z forward); NODE_optical_frame
    if not given"""
    imu_frame_id: str | None = None
    """ros2, rosbag2: frame of IMU samples; NODE_imu_frame if not given"""
    link_frame_id: str | None = None
    """ros2, rosbag2: the camera's body (x forward, y left, z up), the parent of these two on
    /tf_static; NODE_link if not given"""
    world_frame: str | None = None
    """ros2, rosbag2: reference frame of the poses"""
    clock: bool | None = None
    """ros2: publish /clock; only one of several publishers may"""
    tf: bool | None = None
    """ros2, rosbag2: publish the pose of the camera's body on /tf; false if a URDF has that
    frame"""
    tf_static: bool | None = None
    """ros2, rosbag2: publish the camera's frames within its body on /tf_static; as tf if not
    given"""
    event_message_time_threshold: float | None = None
    """ros2: shortest time span of an event message, s"""
    event_message_size_threshold: int | None = None
    """ros2: size at which an event message is sent before that time, bytes"""
    send_queue_size: int | None = None
    """ros2: messages per topic queued for a slow network before the oldest are dropped"""
    statistics_print_interval: float | None = None
    """ros2: interval of the statistics on stderr, s of the wall clock, as in real drivers; 0:
    none"""
    roi: tuple[int, ...] | None = None
    """ros2: sensor.readout.roi under the drivers' name, x y width height"""
    erc_mode: str | None = None
    """ros2: na | enabled: sensor.readout.erc_rate_mevs is erc_rate / 1e6 | disabled: it is 0"""
    erc_rate: int | None = None
    """ros2: highest rate of event rate control, events/s"""


OF_THE_SENSOR = ("roi", "erc_mode", "erc_rate")
"""keys that change the sensor, and not the sink"""

KEYS = (
    *("node", "namespace", "domain_id", "interface", "insecure", "reliable", "encoding"),
    *("camera_frame_id", "imu_frame_id", "link_frame_id", "world_frame", "clock"),
    *("tf", "tf_static", "send_queue_size", "wait_for", "wait_s"),
    *("event_message_time_threshold", "event_message_size_threshold"),
    *("statistics_print_interval", *OF_THE_SENSOR),
)
"""every key of such a sink"""

ERC_MODES = ("na", "enabled", "disabled")

ERC_RATE = 100_000_000
"""events/s: the drivers' default"""


def passed_on(sensor: SensorConfig, sinks: Iterable[DriverParameters]) -> SensorConfig:
    """Return the sensor with the drivers' parameters applied. EvsError: two of them disagree."""
    readout = sensor.readout
    for place, sink in enumerate(sinks):
        changes: dict[str, tuple[str, Any]] = {}
        if sink.roi:
            changes["roi"] = "roi", sink.roi
        rate = _erc_rate_mevs(sink, f"sink.{place}")
        if rate is not None:
            changes["erc_rate_mevs"] = "erc_mode", rate
        for key, (name, value) in changes.items():
            present = getattr(readout, key)
            if present not in (None, value):
                raise EvsError(
                    f"at sink.{place}.{name}: sensor.readout.{key} already has another value; "
                    "set only one of them"
                )
            readout = dataclasses.replace(readout, **{key: value})
    return dataclasses.replace(sensor, readout=readout)


def _erc_rate_mevs(sink: DriverParameters, path: str) -> float | None:
    """Return the rate of a sink's table, Mev/s; None if it has none."""
    mode = sink.erc_mode or "na"
    if mode not in ERC_MODES:
        raise EvsError(f"at {path}.erc_mode: {unknown('mode', mode, ERC_MODES)}")
    rate = ERC_RATE if sink.erc_rate is None else sink.erc_rate
    if rate < 1:
        raise EvsError(f"at {path}.erc_rate: {rate} events/s; give 1 or more, or erc_mode=disabled")
    return {"na": None, "enabled": rate / 1e6, "disabled": 0.0}[mode]
