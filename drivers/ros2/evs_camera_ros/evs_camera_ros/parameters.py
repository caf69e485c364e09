"""The parameters of the node: what is fixed once it is configured, and those of the sensor."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor

from evs.drivers.run.config import PipelineConfig, load
from evs.emulator.config import decoding
from evs.msgs import EvsError
from evs.msgs.codecs import PAYLOADS

PIPELINE = {
    "scene": ("scene.file", "", "MJCF, MJB or URDF of the world"),
    "camera": ("scene.camera", "", "camera of the model; empty: its first, else a free one"),
    "sensor": ("sensor.preset", "", "name of a sensor, as evs sensors lists them"),
    "renderer": ("render.renderer", "", "direct, hybrid, path or raster"),
    "spp": ("render.spp", 0, "samples per pixel"),
    "model": ("model.name", "", "what turns light into events"),
    "seed": ("seed", 0, "seed of every random number"),
    "threads": ("threads", 0, "worker threads"),
    "imu": ("sensor.imu.enabled", False, "publish IMU samples"),
    "frames": ("sensor.aps.enabled", False, "publish images"),
}
"""parameter -> key of evs's configuration, default, description; the default leaves the key as it
is in `config`"""

PUBLISHER = {
    "encoding": ("evt3", f"of events: {', '.join(PAYLOADS)}"),
    "camera_frame_id": ("", "frame of events and images; empty: NODE_optical_frame"),
    "imu_frame_id": ("", "frame of IMU samples; empty: NODE_imu_frame"),
    "link_frame_id": ("", "the camera's body; empty: NODE_link"),
    "world_frame": ("world", "frame of the poses"),
    "clock": (True, "publish /clock; only one node may"),
    "tf": (True, "publish the pose of the body on /tf; false if something else does"),
    "tf_static": (True, "publish the frames within the body on /tf_static"),
    "event_message_time_threshold": (1e-3, "minimum time span of an event message, s"),
    "event_message_size_threshold": (1_000_000, "size that completes an event message, bytes"),
    "send_queue_size": (1000, "messages per topic that wait before the oldest are dropped"),
}
"""parameter, an argument of Ros2Publisher -> default, description"""

OWN = {
    "config": ("", "a pipeline of evs: a TOML file, or the name of one that comes with evs"),
    "overrides": ([""], "KEY=VALUE of evs's configuration, as in sensor.cutoff_hz=200"),
    "speed": (1.0, "simulated seconds per second of the wall clock; 0: as fast as possible"),
}
"""parameter -> default, description"""

FIXED: dict[str, Any] = {
    **{name: rest for name, (_, *rest) in PIPELINE.items()},
    **PUBLISHER,
    **OWN,
}
"""parameter -> default, description; may change only while the node is unconfigured"""


def fixed_descriptor(name: str) -> ParameterDescriptor:
    """Describe a parameter of FIXED."""
    return ParameterDescriptor(
        description=FIXED[name][1],
        additional_constraints="changes only while the node is unconfigured",
    )


def sensor_name(key: str) -> str:
    """The parameter for a key of a sensor: biases have their drivers' names."""
    return key.removeprefix("biases.")


def sensor_descriptor(about: Mapping[str, Any]) -> ParameterDescriptor:
    """Describe a parameter of the sensor, as SensorControl.parameters() lists it."""
    text = f"{about['text']}, {about['unit']}" if about["unit"] else about["text"]
    lowest, highest = about["lowest"], about["highest"]
    if isinstance(about["value"], int):
        ranges = {"integer_range": [IntegerRange(from_value=lowest, to_value=highest, step=1)]}
    else:
        limits = FloatingPointRange(from_value=lowest, to_value=highest, step=0.0)
        ranges = {"floating_point_range": [limits]}
    return ParameterDescriptor(description=text, **ranges)


def pipeline(values: Mapping[str, Any]) -> PipelineConfig:
    """The configuration of evs that the parameters describe.

    Args:
        values: Of FIXED.

    Raises:
        EvsError: A value that cannot be.
    """
    if not (values["scene"] or values["config"]):
        raise EvsError("no scene: set the parameter scene to an MJCF, MJB or URDF file")
    words = [
        (key, str(values[name]).lower() if values[name] is True else str(values[name]))
        for name, (key, _, _) in PIPELINE.items()
        if values[name]
    ]
    words += [decoding.split_word(word) for word in values["overrides"] if word]
    config = load(values["config"] or None, words)
    if config.is_closed:
        raise EvsError("this node has no controllers: leave lockstep and realtime.serve out")
    if config.sinks():
        raise EvsError("this node publishes by itself: leave [[sink]], record and publish out")
    return config
