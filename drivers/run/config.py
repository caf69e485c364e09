"""A pipeline: the emulator's configuration, plus the sinks of its packets and its pace.

Precedence: defaults < the TOML file < the command line. Some keys are aliases of others; reports,
headers and old pipeline files keep the keys that they stand for.
"""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

from evs.drivers.clock import CATCH_UP_S
from evs.drivers.files import formats
from evs.drivers.files.paths import FORCE, check_new, free_number, numbered_path
from evs.drivers.sink import Sink
from evs.drivers.sink_config import FileSink, SinkConfig, is_key_file
from evs.emulator.base.package_paths import beside, in_package
from evs.emulator.base.small_files import is_file
from evs.emulator.config import RunConfig, decoding
from evs.emulator.config.declaration import any_path, parameter
from evs.emulator.config.schema import LoopConfig
from evs.emulator.render.renderer_table import SEEDS
from evs.msgs import EvsError, nearest_first, unknown
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


MAX_AHEAD = 64
"""ticks; the light of each is kept"""


@dataclass(frozen=True)
class RealtimeConfig:
    """[realtime]: how pace = "realtime" handles lateness."""

    catch_up_s: float = CATCH_UP_S
    """maximum lateness that the next ticks catch up, s; beyond it, simulated time falls behind"""
    serve: bool = False
    """true: controllers may connect as in lock-step ([lockstep], [loop]); a control takes effect
    when it arrives, and simulated time never waits for it"""


@dataclass(frozen=True)
class LockstepConfig:
    """[lockstep]: the server of pace = "lockstep" and of realtime.serve; see also [loop]."""

    address: str = LOCKSTEP_ADDRESS
    """address for controllers: tcp://HOST:PORT, or ipc:///PATH on this machine"""
    controllers: int = 1
    """number of controllers that must join before the simulation starts, each with its own
    actuators"""
    timeout_s: float = 10.0
    """time to wait for a controller's decision before the controller is removed, s"""
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
        "an additional recording, as in run.aedat4; the file's extension selects the format",
        is_path=any_path,
    )
    publish: str = ""
    """an additional zmq sink: the address to bind, as in tcp://127.0.0.1:5560"""
    publish_wait_for: int = 0
    """subscribers to wait for before the first tick"""
    publish_wait_s: float = 10.0
    """time to wait for them, s"""
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
    """true: if the file of a recording exists, record to run-1.aedat4 next to it; evs launch sets
    this for a node that it restarts"""
    worker: bool = False
    """true: run every sink in its own process, unless its table sets worker"""
    ahead: int = 2
    """ticks of physics and light to compute in advance, while pixels and sinks process the current
    tick; needs two cores and two threads; 0: one after the other. The bytes are the same"""
    report: str = parameter(
        "",
        "file of the run report (JSON); every recording also has a report next to it",
        is_path=any_path,
    )

    @property
    def is_closed(self) -> bool:
        """Whether controllers drive it."""
        return self.pace == LOCKSTEP or self.realtime.serve

    def sinks(self) -> tuple[SinkConfig, ...]:
        """Every sink: the [[sink]] tables, `record` and `publish`; files last.

        So a port in use, or a missing subscriber, never costs an existing recording.
        """
        every = list(self.sink)
        if self.record:
            kind = formats.to_write(self.record).name
            every.append(SinkConfig.of(kind, file=self.record))
        if self.publish:
            keys = {key: getattr(self, alias) for alias, key in PUBLISH.items()}
            if not self.publish_wait_for:
                del keys["wait_s"]
            every.append(SinkConfig.of("zmq", **keys))
        for key in ("overwrite", "worker"):
            if getattr(self, key):
                unset = [getattr(sink, key) is None for sink in every]
                every = [
                    s.having(**{key: True}) if n else s for s, n in zip(every, unset, strict=True)
                ]
        return tuple(sorted(every, key=lambda sink: isinstance(sink, FileSink)))


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
    if path is None:
        config = decoding.build(PipelineConfig, tables or {}, in_package)
    else:
        tables = decoding.read_toml(path)
        try:
            config = decoding.build(PipelineConfig, tables, lambda it: in_package(beside(path, it)))
        except EvsError as error:
            raise EvsError(f"{path}: {error}") from None
    if overrides := list(overrides):
        config = decoding.override(config, overrides, in_package)
    config = _passed_on(config)
    check(config, path)
    return config


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
        sink.check(f"sink.{place}", config.worker if sink.worker is None else sink.worker)
    sinks = config.sinks()
    _check_held(config, sinks)
    _check_outputs(config, sinks, pipeline)


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
        beside: See `PipelineConfig`.

    Raises:
        EvsError: One would replace a file.
    """
    placed = []
    for table in tables:
        if table.path and beside:
            table = table.at(numbered_path(table.path, free_number([table.path])))
        elif table.path and not table.overwrite:
            check_new([table.path], FORCE)
        placed.append(table)
    return placed


def make_sink(config: SinkConfig) -> Sink:
    """Make the sink of a table, not yet open. Its library is imported here, not before."""
    if not config.worker:
        return config.make()
    from evs.drivers.run.worker import WorkerSink

    # made here too, so that a bad value is reported before anything starts
    return WorkerSink(
        config.make(),
        decoding.to_plain(config.having(worker=None)),
        lossless=bool(config.path),
        ring_mb=config.worker_mb,
        cores=config.worker_cores or None,
    )


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
    if word in decoding.key_names(PipelineConfig):
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
    keys = [decoding.split_word(word) for word in words]
    for key, _ in keys:
        if not key.startswith("sink."):
            raise EvsError(f"no key '{key}' here: give those of sinks, as in sink.0.type=dv")
    found = decoding.override(PipelineConfig(), keys)
    for place, sink in enumerate(found.sink):
        sink.check(f"sink.{place}")
        for key in sink.of_the_sensor:
            if sink.gives(key):
                raise EvsError(f"at sink.{place}.{key}: changes the sensor, and there is none")
    return settled(found.sinks(), beside=False)


def _passed_on(config: PipelineConfig) -> PipelineConfig:
    """The pipeline with the drivers' parameters of its sinks in its sensor.

    Raises:
        EvsError: Two of them disagree.
    """
    readout = config.sensor.readout
    for place, sink in enumerate(config.sink):
        for key, (name, value) in sink.readout(f"sink.{place}").items():
            if getattr(readout, key) not in (None, value):
                raise EvsError(
                    f"at sink.{place}.{name}: sensor.readout.{key} already has another value; "
                    "set only one of them"
                )
            readout = dataclasses.replace(readout, **{key: value})
    if readout == config.sensor.readout:
        return config
    sensor = dataclasses.replace(config.sensor, readout=readout)
    return dataclasses.replace(config, sensor=sensor)


def _check_held(config: PipelineConfig, sinks: Sequence[SinkConfig]) -> None:
    """Refuse streams that no sink can hold."""
    recorded = [sink for sink in sinks if isinstance(sink, FileSink)]
    files = [sink.file for sink in recorded]
    held = [formats.by_name(sink.type).capabilities for sink in recorded]
    if config.model.labels and held and not any(holds.labels for holds in held):
        raise EvsError("at model.labels: only .npz recordings hold labels; add --record FILE.npz")
    for key, on in (("aps", config.sensor.aps.enabled), ("imu", config.sensor.imu.enabled)):
        what = {"aps": "frames", "imu": "imu"}[key]
        streams = len(files) < len(sinks)
        if on and files and not streams and not any(getattr(holds, what) for holds in held):
            words = {"aps": "frames", "imu": "IMU samples"}[key]
            raise EvsError(
                f"at sensor.{key}.enabled: '{files[0]}' cannot hold {words}; record to .aedat4 or "
                f".npz, or leave sensor.{key}.enabled out"
            )


def _check_outputs(
    config: PipelineConfig, sinks: Sequence[SinkConfig], pipeline: Path | None
) -> None:
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
    for file in (file for sink in sinks if (file := sink.path)):
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
