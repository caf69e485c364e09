"""[[sink]]: the configuration of every kind of sink, a class each; the key `type` chooses.

To add a sink, write its class here and a row in SINKS. A recording format is a row of
drivers/files/formats.py; it needs a class here only if it has keys of its own.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

from evs.drivers.files import formats
from evs.emulator.config.declaration import any_path, parameter
from evs.emulator.config.keywords import named_keywords
from evs.msgs import EvsError, registry, unknown
from evs.msgs.topics import EVENTS

if TYPE_CHECKING:
    from evs.drivers.sink import Sink


def is_key_file(text: str) -> bool:
    """Whether a public key is a file, and not written out."""
    return len(text) != 40


class SinkConfig:
    """[[sink]]: one destination of the packets. Any number of tables; `type` has further keys."""

    type: str
    worker: bool | None
    worker_mb: float
    worker_cores: tuple[int, ...]
    # what a table without these keys has
    address, file = "", ""
    overwrite: bool | None = False

    variants: ClassVar[dict[str, Any]] = {}
    """type -> its class"""
    target: ClassVar[str] = ""
    """module:class of the sink, imported at first use; its arguments are the keys"""
    needs: ClassVar[str] = ""
    """the key that every such table needs, and the first argument of the class; empty: none"""
    writes: ClassVar[str] = ""
    """the key of the file that it writes; empty: none"""
    of_the_sensor: ClassVar[tuple[str, ...]] = ()
    """keys that change the sensor, and not the sink"""

    @staticmethod
    def of(type: str, **keys: Any) -> SinkConfig:  # noqa: A002
        """The table of a type with these keys. Raises EvsError as a pipeline does."""
        if type not in SINKS:
            raise unknown("sink type", type, SINKS)
        made: SinkConfig = SINKS[type](type=type, **keys)
        return made

    @property
    def path(self) -> str:
        """The file that it writes, whatever its key; empty: none."""
        return str(getattr(self, self.writes)) if self.writes else ""

    def at(self, path: str) -> SinkConfig:
        """The same sink that writes another file."""
        return self.having(**{self.writes: path})

    def having(self, **keys: Any) -> SinkConfig:
        """The same sink with other values."""
        table: Any = self
        changed: SinkConfig = dataclasses.replace(table, **keys)
        return changed

    def gives(self, key: str) -> bool:
        """Whether the table has this key, with another value than its default."""
        return bool(getattr(self, key) != getattr(type(self), key))

    def check(self, table: str, in_worker: bool = True) -> None:
        """Refuse a table that lacks what it needs.

        Args:
            table: Name of the table for messages, such as `sink.0`.
            in_worker: Whether it has a process of its own.

        Raises:
            EvsError: With the key.
        """
        if self.needs and not getattr(self, self.needs):
            raise EvsError(f"at {table}.{self.needs}: missing; a {self.type} sink needs it")
        for key in ("worker_mb", "worker_cores"):
            if self.gives(key) and not in_worker:
                raise EvsError(f"at {table}.{key}: needs worker = true")

    def readout(self, table: str) -> dict[str, tuple[str, Any]]:  # noqa: ARG002
        """Key of [sensor.readout] -> (key here, the value that it gives). EvsError as `check`."""
        return {}

    def make(self) -> Sink:
        """Make the sink, not yet open, in this process. Its library is imported here."""
        sink: Sink = registry.load(self.target)(*self._arguments[0], **self._arguments[1])
        return sink

    @property
    def _arguments(self) -> tuple[list[Any], dict[str, Any]]:
        other = {*vars(_Sink()), *self.of_the_sensor, "overwrite"}
        own = {key: value for key, value in vars(self).items() if key not in other}
        return [own.pop(self.needs)] if self.needs else [], own


@dataclass(frozen=True)
class _Sink(SinkConfig):
    type: str = ""
    """zmq | dv | ros2 | rerun | foxglove, or the format of a recording: aedat4 | ... (evs convert
    --help)"""
    worker: bool | None = None
    """true: run the sink in its own process, so it costs the camera only a copy; not given: the
    setting of the run"""
    worker_mb: float = 64.0
    """worker: size of the buffer of packets for that process, MB"""
    worker_cores: tuple[int, ...] = ()
    """worker: processor cores that the process may use; none: the cores of the camera"""


@dataclass(frozen=True)
class _Served(_Sink):
    wait_for: int = 0
    """subscribers of events to wait for before the first tick"""
    wait_s: float = 10.0
    """time to wait for them, s"""
    insecure: bool = False
    """true: other machines may subscribe without a key, and the traffic is not encrypted"""


@dataclass(frozen=True)
class _Writing(_Sink):
    overwrite: bool | None = None
    """true: replace an existing file; not given: the setting of the run"""


@named_keywords
@dataclass(frozen=True)
class ZmqSink(_Served):
    """[[sink]] type = "zmq": publish; `evs echo ADDRESS` prints the packets."""

    type: str = "zmq"
    address: str = parameter("", "address to bind", example="tcp://127.0.0.1:5560")
    queue: int = EVENTS.queue
    """packets queued for a slow subscriber before packets are dropped"""
    control: str = ""
    """control port, which describes the camera and its topics and takes requests (evs topics)"""
    latest: str = ""
    """address of the newest state; any free port if only control is given"""
    truth_hz: float = 10.0
    """ground-truth messages per simulated second, while the topic has subscribers; each traces a
    frame"""
    key: str = parameter(
        "",
        "file of the publisher's secret key (evs keygen makes one); encrypts all traffic",
        is_path=any_path,
    )
    allow: tuple[str, ...] = parameter(
        (),
        "public keys of the clients that may subscribe (files, folders, or the keys themselves); "
        "none: every client that has the publisher's public key",
        is_path=is_key_file,
    )

    target = "evs.drivers.bus:Publisher"
    needs = "address"


@named_keywords
@dataclass(frozen=True)
class DvSink(_Served):
    """[[sink]] type = "dv": a server for iniVation's software."""

    type: str = "dv"
    address: str = parameter(
        "",
        "port of the events; frames, imu, triggers are on the next ones",
        example="tcp://127.0.0.1:7777",
    )
    compression: str = "none"
    """none | lz4 | zstd"""
    queue: int = 1000
    """packets queued for a slow client before the oldest are dropped"""

    target = "evs.drivers.dv:DvServer"
    needs = "address"


@named_keywords
@dataclass(frozen=True)
class RerunSink(_Writing):
    """[[sink]] type = "rerun": events, rates, luminance, frames and poses for Rerun's viewer."""

    type: str = "rerun"
    rrd: str = parameter("", "the file to write", is_path=any_path, example="run.rrd")
    period_us: int = 20_000
    """simulated time between two pictures, us"""
    points: int = 0
    """maximum number of points of each picture's cloud of events in x, y and time; 0: no cloud"""

    target = "evs.drivers.viewer:ViewSink"
    needs = writes = "rrd"


@named_keywords
@dataclass(frozen=True)
class FoxgloveSink(_Served, _Writing):
    """[[sink]] type = "foxglove": pictures, rates, events, calibration and poses for Foxglove."""

    type: str = "foxglove"
    address: str = parameter(
        "",
        "port to serve; in Foxglove, open the connection ws://HOST:PORT",
        example="tcp://127.0.0.1:8765",
    )
    mcap: str = parameter(
        "",
        "the file to write, instead of address",
        is_path=any_path,
        example="run.mcap",
    )
    period_us: int = 20_000
    """simulated time between two pictures, rates and messages of events, us"""
    encoding: str = "evt3"
    """encoding of event_camera_msgs (docs/reference/wire.md lists them)"""
    queue: int = 1000
    """messages queued for a slow client before the oldest are dropped"""

    target = "evs.drivers.viewer:FoxgloveSink"
    writes = "mcap"


ERC_MODES = ("na", "enabled", "disabled")


@dataclass(frozen=True)
class _RosNames(_Sink):
    """Names as the real cameras' driver packages have them."""

    node: str = ""
    """name of the node, as in /NODE/events; empty: the camera's name"""
    namespace: str = ""
    """namespace of the node, as in robot/head"""
    camera_frame_id: str = ""
    """frame of events and images (x right, y down, z forward); empty: NODE_optical_frame"""
    imu_frame_id: str = ""
    """frame of IMU samples; empty: NODE_imu_frame"""
    link_frame_id: str = ""
    """the camera's body (x forward, y left, z up), the parent of these two on /tf_static; empty:
    NODE_link"""
    world_frame: str = "world"
    """reference frame of the poses"""
    tf: bool = True
    """publish the pose of the camera's body on /tf; false if a URDF has that frame"""
    tf_static: bool | None = None
    """publish the camera's frames within its body on /tf_static; as tf if not given"""


@named_keywords
@dataclass(frozen=True)
class Ros2Sink(_Served, _RosNames):
    """[[sink]] type = "ros2": topics for ROS 2 nodes, with the keys of real cameras' drivers.

    /NODE/events, imu, camera_info, image_raw, pose, and /clock, /tf, /tf_static. The parameters of
    the sensor itself (roi, erc_mode, erc_rate) keep their drivers' names and are passed on to it.
    """

    type: str = "ros2"
    domain_id: int = 0
    """domain, 0 ... 232, as ROS_DOMAIN_ID for ROS nodes; the environment variable is not read"""
    interface: str = ""
    """network interface, by name or address; empty: lo (with insecure: any)"""
    reliable: bool | None = None
    """true: all topics have reliable QoS, lost messages are sent again; false: all but tf are best
    effort; not given: as in real drivers, images, camera_info and poses are reliable"""
    encoding: str = "evt3"
    """encoding of event_camera_msgs (docs/reference/wire.md); libcaer_driver uses libcaer_cmp"""
    clock: bool = True
    """publish /clock; only one of several publishers may do so"""
    event_message_time_threshold: float = 1e-3
    """minimum time span of an event message, s"""
    event_message_size_threshold: int = 1_000_000
    """size at which an event message is sent before that time, bytes"""
    send_queue_size: int = 1000
    """messages per topic queued for a slow network before the oldest are dropped"""
    statistics_print_interval: float = 0.0
    """interval of the statistics on stderr, s of the wall clock, as in real drivers; 0: none"""
    roi: tuple[int, ...] = ()
    """sensor.readout.roi under the drivers' name, x y width height"""
    erc_mode: str = "na"
    """na | enabled: sensor.readout.erc_rate_mevs is erc_rate / 1e6 | disabled: it is 0"""
    erc_rate: int = 100_000_000
    """highest rate of event rate control, events/s"""

    target = "evs.drivers.ros2:Ros2Publisher"
    of_the_sensor = ("roi", "erc_mode", "erc_rate")

    def readout(self, table: str) -> dict[str, tuple[str, Any]]:
        """See `SinkConfig`."""
        if self.erc_mode not in ERC_MODES:
            raise EvsError(f"at {table}.erc_mode: {unknown('mode', self.erc_mode, ERC_MODES)}")
        if self.erc_rate < 1:
            raise EvsError(
                f"at {table}.erc_rate: {self.erc_rate} events/s; give 1 or more, or "
                "erc_mode=disabled"
            )
        found: dict[str, tuple[str, Any]] = {"roi": ("roi", self.roi)} if self.roi else {}
        if self.erc_mode != "na":
            rate = self.erc_rate / 1e6 if self.erc_mode == "enabled" else 0.0
            found["erc_rate_mevs"] = ("erc_mode", rate)
        return found


def _file(example: str) -> Any:
    return parameter("", "the file to write", is_path=any_path, example=example)


@named_keywords
@dataclass(frozen=True)
class FileSink(_Writing):
    """[[sink]] type = "npz" and others: a recording (evs convert --help lists the formats)."""

    type: str = "npz"
    file: str = _file("run.npz")

    needs = writes = "file"

    def check(self, table: str, in_worker: bool = True) -> None:
        """See `SinkConfig`; the file has an extension of its format."""
        super().check(table, in_worker)
        kind = formats.by_name(self.type)
        known = kind.suffixes + kind.shared_suffixes
        if Path(self.file).suffix.lower() not in known:
            raise EvsError(f"at {table}.file: '{self.file}' does not end in {' or '.join(known)}")

    def make(self) -> Sink:
        """See `SinkConfig`."""
        (file,), options = self._arguments
        return formats.by_name(self.type).record(Path(file), **options)


@named_keywords
@dataclass(frozen=True)
class Aedat4Sink(FileSink):
    """[[sink]] type = "aedat4": a recording that survives a kill at any moment."""

    type: str = "aedat4"
    file: str = _file("run.aedat4")
    compression: str = "lz4"
    """lz4 | zstd | none"""
    rotate_mb: float = 0.0
    """largest size of a file, MB; the recording continues in run-001.aedat4, ...; 0: no limit"""
    rotate_s: float = 0.0
    """longest simulated time of a file, s; the recording continues in the next file; 0: no limit"""


@named_keywords
@dataclass(frozen=True)
class Rosbag2Sink(FileSink, _RosNames):
    """[[sink]] type = "rosbag2": a recording for ROS 2 (.mcap, .db3)."""

    type: str = "rosbag2"
    file: str = _file("run.mcap")
    encoding: str | None = parameter(
        None,
        "evt3 (if not given), one of event_camera_msgs (docs/reference/wire.md) or dvs (dvs_msgs)",
        example="evt3",
    )


@named_keywords
@dataclass(frozen=True)
class Rosbag1Sink(FileSink):
    """[[sink]] type = "rosbag1": a recording for ROS 1 (.bag)."""

    type: str = "rosbag1"
    file: str = _file("run.bag")
    encoding: str | None = parameter(
        None,
        "dvs (dvs_msgs, if not given) or one of event_camera_msgs (docs/reference/wire.md)",
        example="dvs",
    )


_OWN = {"aedat4": Aedat4Sink, "rosbag2": Rosbag2Sink, "rosbag1": Rosbag1Sink}

SINKS: dict[str, Any] = {
    "zmq": ZmqSink,
    "dv": DvSink,
    "rerun": RerunSink,
    "foxglove": FoxgloveSink,
    "ros2": Ros2Sink,
    **{kind.name: _OWN.get(kind.name, FileSink) for kind in formats.RECORDED},
}
"""sink type -> its class"""

SinkConfig.variants |= SINKS
