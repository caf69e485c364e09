"""A pipeline: the emulator's configuration, plus the sinks of its packets and its pace.

Precedence: defaults < the TOML file < the command line. Some keys are aliases of others; reports,
headers and old pipeline files keep the keys that they stand for.
"""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

from evs.drivers.clock import CATCH_UP_S
from evs.drivers.files import formats
from evs.drivers.files.paths import FORCE, check_new, free_number, numbered_path
from evs.drivers.run import driver_parameters
from evs.drivers.run.driver_parameters import DriverParameters
from evs.drivers.sink import SINK_TYPES, Sink
from evs.emulator.base.package_paths import beside, in_package
from evs.emulator.base.small_files import is_file
from evs.emulator.config import RunConfig, settings
from evs.emulator.config.declaration import any_path, parameter
from evs.emulator.config.schema import LoopConfig
from evs.emulator.render.registry import SEEDS
from evs.msgs import EvsError, nearest_first, registry, unknown
from evs.msgs.lockstep import LOCKSTEP_ADDRESS

T = TypeVar("T")

_SCENE_SUFFIXES = (".xml", ".mjcf", ".mjb", ".urdf")

PIPELINES = Path(__file__).parents[2] / "config" / "pipelines"
"""The pipelines that come with evs, each found by its bare name."""

PRESETS = ("fast", "balanced", "accurate", "reference")
"""Pipelines that trade speed for accuracy and need a scene as well; the fastest first."""

PACES = {"free": 0.0, "realtime": 1.0}
"""pace -> simulated seconds per wall second; 0: as fast as it goes"""

LOCKSTEP = "lockstep"
"""the pace of a run that controllers drive"""

PUBLISH = {
    "publish": "address",
    "publish_wait_for": "wait_for",
    "publish_wait_s": "wait_s",
    "publish_control": "control",
    "publish_key": "key",
    "publish_allow": "allow",
    "publish_insecure": "insecure",
}
"""a key of a pipeline -> the key of the zmq sink that they describe together"""


def is_key_file(text: str) -> bool:
    """Whether a public key is a file, and not written out."""
    return len(text) != 40


@dataclass(frozen=True)
class SinkConfig(DriverParameters):
    """[[sink]]: one destination of the packets. Any number of tables."""

    type: str = ""
    """zmq | dv | ros2 | rerun | foxglove, or the format of a recording: aedat4 | ... (evs convert
    --help)"""
    address: str | None = None
    """zmq, dv, foxglove: address to bind, as in tcp://127.0.0.1:5560; dv: the port of the
    events"""
    wait_for: int | None = None
    """zmq, dv, ros2, foxglove: number of event subscribers to wait for before the first tick"""
    wait_s: float | None = None
    """zmq, dv, ros2, foxglove: how long to wait for them, s"""
    queue: int | None = None
    """zmq, dv, foxglove: packets queued for a slow subscriber before packets are dropped"""
    control: str | None = None
    """zmq: control port, which describes the camera and its topics and takes requests (evs
    topics)"""
    latest: str | None = None
    """zmq: address of the newest state; any free port if only control is given"""
    truth_hz: float | None = None
    """zmq: ground-truth messages per simulated second, while the topic has subscribers"""
    key: str | None = parameter(
        None,
        "zmq: file of the publisher's secret key (evs keygen makes one); encrypts all traffic",
        is_path=any_path,
    )
    allow: tuple[str, ...] | None = parameter(
        None,
        "zmq: public keys of the clients that may subscribe (files, folders, or the keys "
        "themselves); not given: every client that has the publisher's public key",
        is_path=is_key_file,
    )
    insecure: bool | None = None
    """zmq, dv, ros2, foxglove: true: other machines may subscribe without a key"""
    file: str | None = parameter(None, "recordings: the file to write", is_path=any_path)
    overwrite: bool | None = None
    """recordings, rerun, foxglove: true: replace an existing file; not given: as for the whole
    run"""
    compression: str | None = None
    """aedat4, dv: lz4 | zstd | none"""
    encoding: str | None = None
    """ros2, foxglove, rosbag2, rosbag1: of events, as `evs convert --help` lists them"""
    rotate_mb: float | None = None
    """aedat4: largest size of a file, MB; the recording continues in run-001.aedat4, ..."""
    rotate_s: float | None = None
    """aedat4: longest simulated time of a file, s; the recording continues in the next file"""
    rrd: str | None = parameter(
        None, "rerun: the file to write, for Rerun's viewer", is_path=any_path
    )
    mcap: str | None = parameter(
        None,
        "foxglove: the file to write, for Foxglove; not given: address is served",
        is_path=any_path,
    )
    period_us: int | None = None
    """rerun, foxglove: simulated time between two pictures, us"""
    points: int | None = None
    """rerun: most points of each picture's cloud of events in x, y and time; 0: no cloud"""
    worker: bool | None = None
    """true: run the sink in its own process, so it costs the camera only a copy; not given: as for
    the whole run"""
    worker_mb: float | None = None
    """worker: size of the buffer of packets for that process, MB; 64 if not given"""
    worker_cores: tuple[int, ...] | None = None
    """worker: processor cores that the process may use; not given: the cores of the camera"""

    @property
    def target(self) -> str | None:
        """The file that it writes, whatever its key."""
        return self.file or self.rrd or self.mcap

    def at(self, target: str) -> SinkConfig:
        """The same sink that writes another file."""
        return dataclasses.replace(
            self,
            file=self.file and target,
            rrd=self.rrd and target,
            mcap=self.mcap and target,
        )


SINK_PLACES = {name: kind.place for name, kind in SINK_TYPES.items()} | {
    kind.name: "file" for kind in formats.RECORDED
}
"""sink type -> the key that every such table needs; empty: none"""

SINK_KEYS = {name: kind.keys for name, kind in SINK_TYPES.items()} | {
    kind.name: kind.options for kind in formats.RECORDED
}
"""sink type -> the other keys that it has"""

MAX_AHEAD = 64
"""ticks; the light of each is kept"""

FILE_KEYS = ("overwrite",)
"""keys that every sink has that writes a file"""

WORKER_KEYS = ("worker", "worker_mb", "worker_cores")
"""keys that every sink has"""


@dataclass(frozen=True)
class RealtimeConfig:
    """[realtime]: how pace = "realtime" handles lateness."""

    catch_up_s: float = CATCH_UP_S
    """largest lateness that the next ticks make up for, s; beyond it, simulated time slips"""
    serve: bool = False
    """true: controllers may connect as in lock-step ([lockstep], [loop]); a control acts when it
    arrives, and simulated time never waits for it"""


@dataclass(frozen=True)
class LockstepConfig:
    """[lockstep]: the server of pace = "lockstep" and of realtime.serve; see also [loop]."""

    address: str = LOCKSTEP_ADDRESS
    """address for controllers: tcp://HOST:PORT, or ipc:///PATH on this machine"""
    controllers: int = 1
    """number of controllers that must join before the simulation starts, each with its own
    actuators"""
    timeout_s: float = 10.0
    """how long to wait for a controller's decision before the controller is removed, s"""
    cameras: tuple[str, ...] = ()
    """cameras of the model, all with this pipeline's sensor; none: the pipeline's one camera"""
    key: str = parameter(
        "",
        "file of the server's secret key (evs keygen makes one); encrypts all traffic",
        is_path=any_path,
    )
    allow: tuple[str, ...] = parameter(
        (),
        "public keys of the controllers that may connect (files, folders, or the keys themselves); "
        "none: every controller that has the server's public key",
        is_path=is_key_file,
    )
    insecure: bool = False
    """true: controllers on other machines may connect without a key"""


@dataclass(frozen=True)
class PipelineConfig(RunConfig):
    """Top-level keys."""

    sink: tuple[SinkConfig, ...] = ()
    pace: str = "free"
    """free: as fast as possible | realtime: no faster than the wall clock |
    lockstep: when controllers decide (docs/tutorials/closed_loop.md)"""
    realtime: RealtimeConfig = dataclasses.field(default_factory=RealtimeConfig)
    lockstep: LockstepConfig = dataclasses.field(default_factory=LockstepConfig)
    loop: LoopConfig = dataclasses.field(default_factory=LoopConfig)
    record: str = parameter(
        "",
        "an additional recording, as in run.aedat4; the file's ending selects the format",
        is_path=any_path,
    )
    publish: str = ""
    """an additional zmq sink: the address to bind, as in tcp://127.0.0.1:5560"""
    publish_wait_for: int = 0
    """subscribers to wait for before the first tick"""
    publish_wait_s: float = 10.0
    """how long to wait for them, s"""
    publish_control: str = ""
    """control port of publish"""
    publish_key: str = parameter("", "secret key of publish", is_path=any_path)
    publish_allow: tuple[str, ...] = parameter(
        (), "public keys of the clients that may subscribe to publish", is_path=is_key_file
    )
    publish_insecure: bool = False
    """true: other machines may subscribe to publish without a key"""
    overwrite: bool = False
    """true: recordings replace existing files (--force); false: an existing file is an error"""
    beside: bool = False
    """true: if the file of a recording exists, record to run-1.aedat4 beside it; evs launch sets
    this for a node that it restarts"""
    worker: bool = False
    """true: run every sink in its own process, unless its table sets worker"""
    ahead: int = 2
    """ticks of physics and light to compute in advance, while pixels and sinks process the current
    tick; needs two cores and two threads; 0: one after the other. The bytes are the same"""
    report: str = parameter(
        "",
        "file of the run report (JSON); every recording has a report beside it anyway",
        is_path=any_path,
    )

    @property
    def is_closed(self) -> bool:
        """Whether controllers drive it."""
        return self.pace == LOCKSTEP or self.realtime.serve

    def emulation(self) -> RunConfig:
        """The part that shapes the events."""
        names = [field.name for field in dataclasses.fields(RunConfig)]
        plain = RunConfig(**{name: getattr(self, name) for name in names})
        return dataclasses.replace(
            plain, sensor=driver_parameters.passed_on(plain.sensor, self.sink)
        )

    def sinks(self) -> tuple[SinkConfig, ...]:
        """Every sink: the [[sink]] tables, `record` and `publish`; files last.

        So a port in use, or a missing subscriber, never costs an existing recording.
        """
        every = list(self.sink)
        if self.record:
            every.append(SinkConfig(type=formats.to_write(self.record).name, file=self.record))
        if self.publish:
            every.append(self._published())
        if self.overwrite:
            every = [
                dataclasses.replace(sink, overwrite=True)
                if sink.target and sink.overwrite is None
                else sink
                for sink in every
            ]
        if self.worker:
            every = [
                dataclasses.replace(sink, worker=True) if sink.worker is None else sink
                for sink in every
            ]
        return tuple(sorted(every, key=lambda sink: sink.file is not None))

    def _published(self) -> SinkConfig:
        keys = {key: getattr(self, alias) or None for alias, key in PUBLISH.items()}
        keys["wait_s"] = self.publish_wait_s if self.publish_wait_for else None
        return SinkConfig(type="zmq", **keys)


def load(
    file: str | None = None,
    overrides: Iterable[tuple[str, str]] = (),
    tables: Mapping[str, Any] | None = None,
) -> PipelineConfig:
    """Load a pipeline.

    If a key is given twice, the last value counts. Paths in the file are relative to it, all others
    to the working directory; `package:path` is a file inside an installed Python package.

    Args:
        file: A TOML file, or the name of one that comes with evs.
        overrides: (key, text) of the command line.
        tables: In place of a file.

    Returns:
        The configuration, checked.

    Raises:
        EvsError: A bad value, with the path to it.
    """
    path = None if file is None else find_pipeline(file)
    if path is not None:
        config = _from_file(path)
    else:
        config = settings.build(PipelineConfig, tables or {}, in_package)
    if overrides := list(overrides):
        config = settings.override(config, overrides, in_package)
    check(config, path)
    return config


def _from_file(path: Path) -> PipelineConfig:
    """Read a pipeline file; its name stands before an error in it."""
    tables = settings.read_toml(path)
    try:
        return settings.build(PipelineConfig, tables, lambda text: in_package(beside(path, text)))
    except EvsError as error:
        raise EvsError(f"{path}: {error}") from None


def check(config: PipelineConfig, pipeline: Path | None = None) -> None:
    """Refuse what no stage of the emulator would notice.

    Args:
        config: To check.
        pipeline: The file that it came from.

    Raises:
        EvsError: With the path to the key.
    """
    if not config.scene.file:
        raise EvsError('no scene: give --scene FILE.xml, or file = "FILE.xml" under [scene]')
    _check_pace(config)
    if config.seed < 0:
        raise EvsError(f"at seed: {config.seed}; give 0 or more")
    if not 0 <= config.ahead <= MAX_AHEAD:
        raise EvsError(
            f"at ahead: {config.ahead} ticks; give 0 (one after the other) ... {MAX_AHEAD}"
        )
    for alias, key in PUBLISH.items():
        # wait_s has a default
        if key != "wait_s" and getattr(config, alias) and not config.publish:
            raise EvsError(f"at {alias}: needs publish (--publish ADDRESS)")
    seeds = SEEDS.get(config.render.renderer, ())
    if seeds and config.render.seeds not in seeds:
        raise _at("render.seeds", unknown("seeds", config.render.seeds, seeds))
    for place, sink in enumerate(config.sink):
        _check_sink(sink, f"sink.{place}")
        if not (config.worker if sink.worker is None else sink.worker):
            for key in WORKER_KEYS[1:]:
                if getattr(sink, key) is not None:
                    raise EvsError(f"at sink.{place}.{key}: needs worker = true")
    config.emulation()
    _check_held(config)
    _check_outputs(config, pipeline)


def _check_pace(config: PipelineConfig) -> None:
    """Refuse tables of another pace, which would have no effect."""
    if config.pace not in (*PACES, LOCKSTEP):
        raise _at("pace", unknown("pace", config.pace, (*PACES, LOCKSTEP)))
    if config.pace != "realtime" and config.realtime != RealtimeConfig():
        raise EvsError('at realtime: it is for pace = "realtime" only; leave it out')
    if not config.realtime.catch_up_s >= 0:
        raise EvsError(f"at realtime.catch_up_s: {config.realtime.catch_up_s} s; give 0 s or more")
    own = (config.loop, config.lockstep)
    if not config.is_closed and own != (LoopConfig(), LockstepConfig()):
        table = "loop" if config.loop != LoopConfig() else "lockstep"
        raise EvsError(
            f'at {table}: it is for pace = "lockstep" or realtime.serve = true only; leave it out'
        )
    if config.is_closed and config.duration_s != PipelineConfig.duration_s:
        raise EvsError(
            "at duration_s: a closed loop runs until it is stopped; loop.max_s limits an episode"
        )


def settled(tables: Iterable[SinkConfig], beside: bool) -> list[SinkConfig]:
    """Return the sinks with the names that their files get.

    Args:
        tables: As they are configured.
        beside: As of PipelineConfig.

    Raises:
        EvsError: One would replace a file.
    """
    placed = []
    for table in tables:
        file = table.target
        if file and beside:
            table = table.at(numbered_path(file, free_number([file])))
        elif file and not table.overwrite:
            check_new([file], FORCE)
        placed.append(table)
    return placed


def make_sink(config: SinkConfig) -> Sink:
    """Make the sink of a table, not yet open. Its library is imported here, not before."""
    if config.worker:
        from evs.drivers.run.worker import WorkerSink

        plain = dataclasses.replace(config, worker=None, worker_mb=None, worker_cores=None)
        return WorkerSink(
            # made here too, so that a bad value is reported before anything starts
            make_sink(plain),
            settings.to_plain(plain),
            lossless=bool(config.target),
            ring_mb=config.worker_mb,
            cores=config.worker_cores,
        )
    options = {
        key: value
        for key in SINK_KEYS[config.type]
        # these have changed the sensor
        if key not in driver_parameters.OF_THE_SENSOR
        and (value := getattr(config, key)) is not None
    }
    if config.type not in SINK_TYPES:
        return formats.by_name(config.type).record(Path(config.file or ""), **options)
    kind = SINK_TYPES[config.type]
    places = [getattr(config, kind.place)] if kind.place else []
    sink: Sink = registry.load(kind.target)(*places, **options)
    return sink


def is_scene(word: str) -> bool:
    """Return whether a file is a scene, and no pipeline, by its ending."""
    return Path(word).suffix.lower() in _SCENE_SUFFIXES


def find_pipeline(word: str) -> Path:
    """Find the file of a pipeline: a path, or the name of one that comes with evs."""
    path = Path(word)
    if is_scene(word):
        raise EvsError(f"'{word}' is a scene, not a pipeline; give it as --scene {word}")
    known = pipelines()
    if is_file(path):
        return path
    if word in known:
        return known[word]
    if path.is_dir():
        raise EvsError(f"'{word}' is a folder; give a pipeline file (.toml)")
    if word in settings.key_names(PipelineConfig):
        raise EvsError(f"{word} has no value; give it as {word}=VALUE")
    names = ", ".join(nearest_first(path.stem, known))
    raise EvsError(f"no pipeline file '{word}'; evs itself comes with: {names}")


def pipelines() -> dict[str, Path]:
    """Return name -> file of the pipelines that come with evs: the presets, then the others."""
    files = {file.stem: file for file in sorted(PIPELINES.glob("*.toml"))}
    first = {name: files.pop(name) for name in PRESETS if name in files}
    return first | files


def about(file: Path) -> str:
    """Return what a pipeline is for: its first comment, up to the first colon or full stop."""
    head = []
    for line in file.read_text(encoding="utf-8").splitlines():
        if not line.startswith("#"):
            break
        head.append(line.lstrip("# ").rstrip())
    return re.split(r"[.:;](?:\s|$)", " ".join(head))[0]


def sinks_of(words: Iterable[str]) -> list[SinkConfig]:
    """The sinks that words of a command line describe, as in sink.0.type=dv.

    Args:
        words: Only keys of sinks.

    Returns:
        Their tables, checked.

    Raises:
        EvsError: A bad value, with the path to it.
    """
    keys = [settings.split_word(word) for word in words]
    for key, _ in keys:
        if not key.startswith("sink."):
            raise EvsError(f"no key '{key}' here: give those of sinks, as in sink.0.type=dv")
    found = settings.override(PipelineConfig(), keys)
    for place, sink in enumerate(found.sink):
        _check_sink(sink, f"sink.{place}")
        for key in driver_parameters.OF_THE_SENSOR:
            if getattr(sink, key) is not None:
                raise EvsError(f"at sink.{place}.{key}: changes the sensor, and there is none")
    return settled(found.sinks(), beside=False)


def _check_sink(sink: SinkConfig, path: str) -> None:
    if sink.type not in SINK_KEYS:
        raise _at(f"{path}.type", unknown("sink type", sink.type, SINK_KEYS))
    place = SINK_PLACES[sink.type]
    own = (place, *SINK_KEYS[sink.type]) if place else SINK_KEYS[sink.type]
    writes = place in ("file", "rrd") or sink.mcap
    also = (*(FILE_KEYS if writes else ()), *WORKER_KEYS)
    for field in dataclasses.fields(sink):
        if field.name not in ("type", *own, *also) and getattr(sink, field.name) is not None:
            has = ", ".join(own)
            raise EvsError(f"at {path}.{field.name}: a {sink.type} sink has only: {has}")
    if place and not getattr(sink, place):
        raise EvsError(f"at {path}.{place}: missing; a {sink.type} sink needs it")
    if sink.file:
        kind = formats.by_name(sink.type)
        known = kind.suffixes + kind.shared_suffixes
        if Path(sink.file).suffix.lower() not in known:
            raise EvsError(f"at {path}.file: '{sink.file}' does not end in {' or '.join(known)}")


def _check_held(config: PipelineConfig) -> None:
    """Refuse streams that no sink can hold."""
    files = [sink.file for sink in config.sinks() if sink.file]
    held = [formats.by_name(sink.type).capabilities for sink in config.sinks() if sink.file]
    if config.model.labels and held and not any(holds.labels for holds in held):
        raise EvsError("at model.labels: only .npz recordings hold labels; add --record FILE.npz")
    for key, on in (("aps", config.sensor.aps.enabled), ("imu", config.sensor.imu.enabled)):
        what = {"aps": "frames", "imu": "imu"}[key]
        streams = len(files) < len(config.sinks())
        if on and files and not streams and not any(getattr(holds, what) for holds in held):
            words = {"aps": "frames", "imu": "IMU samples"}[key]
            raise EvsError(
                f"at sensor.{key}.enabled: '{files[0]}' cannot hold {words}; record to .aedat4 or "
                f".npz, or leave sensor.{key}.enabled out"
            )


def _check_outputs(config: PipelineConfig, pipeline: Path | None) -> None:
    """Refuse files that are written twice, or written and read: one of the two would be lost."""
    inputs = [
        Path(file)
        for file in (config.scene.file, config.scene.control_file, config.camera.trajectory)
        if file
    ]
    if pipeline is not None:
        inputs.append(pipeline)
    read = {_place(path) for path in inputs}
    recorded: set[Path] = set()
    for file in (file for sink in config.sinks() if (file := sink.target)):
        path = _place(file)
        if path in recorded:
            raise EvsError(f"two sinks record to '{path}'; give each its own file")
        if path in read:
            raise EvsError(f"'{file}' is an input of this run; record to another file")
        recorded.add(path)
    if config.report and _place(config.report) in recorded | read:
        raise EvsError(
            f"at report: '{config.report}' is the recording or an input of this run, the report "
            "would overwrite it; give another name, as in report.json"
        )


def _place(file: str | Path) -> Path:
    """Return where a file really is, links followed; a bad name fails when it is opened."""
    try:
        return Path(file).resolve()
    except (OSError, RuntimeError, ValueError):
        return Path(file).absolute()


def _at(path: str, error: EvsError) -> EvsError:
    return EvsError(f"at {path}: {error}")
