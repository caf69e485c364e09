"""Evidence: a file from which an episode can be replayed, and recordings of its events."""

from __future__ import annotations

import json
import zipfile
import zlib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, is_dataclass
from pathlib import Path
from typing import Any

import numpy as np

from evs.drivers.files.aedat4 import Aedat4Recorder
from evs.emulator import ClosedLoop, config
from evs.msgs import EventPacket, EvsError, Observation
from evs.tools.testing.pushes import Push, Pushes, plain_pushes, pushes_of
from evs.tools.testing.run import Trace

KIND = "evs closed loop 1"
"""what the file is, with its version"""

_NO_ARCHIVE = (
    *(OSError, ValueError, KeyError, EOFError, TypeError, NotImplementedError, RuntimeError),
    *(zipfile.BadZipFile, zlib.error),
)
"""what NumPy raises for a file that is not one of its archives, or a damaged one"""

_CLASSES: dict[str, Any] = {
    name: one for name, one in vars(config).items() if isinstance(one, type) and is_dataclass(one)
}
"""name -> each dataclass that an option may be or contain"""

_CLASS = "class"
"""key of the name of such a class in JSON"""


@dataclass(frozen=True)
class LoopOrigin:
    """How a run made its loop."""

    scene: str = ""
    """the file of the scene; "": it was not a file"""
    options: dict[str, Any] | None = None
    """of the ClosedLoop, as `plain_options` returns them; None: JSON cannot hold them"""


def leave_behind(
    folder: Path,
    loop: ClosedLoop,
    trace: Trace,
    ticks: int,
    pushes: Sequence[Push],
    origin: LoopOrigin,
) -> tuple[str, ...]:
    """Write seed-N.npz, and one seed-N-CAMERA.aedat4 for each camera.

    The episode is replayed to record its events.

    Args:
        folder: where to write; created if it does not exist.
        loop: the loop of the episode.
        trace: the record of the episode.
        ticks: ticks of a decision.
        pushes: all pushes of the episode.
        origin: how the loop was made.

    Returns:
        Lines for a message: the files, and how to look at them and replay them.
    """
    folder.mkdir(parents=True, exist_ok=True)
    file = folder / f"seed-{trace.seed}.npz"
    about = {
        "kind": KIND,
        "seed": trace.seed,
        "ticks": ticks,
        "pushes": plain_pushes(pushes),
        "scene": origin.scene,
        "options": origin.options,
    }
    arrays: dict[str, Any] = {
        "about": json.dumps(about),
        "ctrl": trace.ctrl,
        "t_us": trace.t_us,
        "start": np.frombuffer(trace.start, np.uint8),
        **{f"sensor/{name}": values for name, values in trace.sensors.items()},
    }
    np.savez_compressed(file, **arrays)
    recordings = _record(folder, loop, file, trace.seed)
    alone = bool(origin.scene) and origin.options is not None
    call = f"replay({str(file)!r})" if alone else f"replay({str(file)!r}, loop=...)"
    return (
        f"left behind: {file} (start, controls, pushes, sensors)",
        *(f"look: evs view {path} -o {path.with_suffix('.gif')}" for path in recordings),
        f"run it again: from evs.tools.testing import replay; list({call})",
    )


def replay(path: str | Path, loop: ClosedLoop | None = None) -> Iterator[Observation]:
    """Run an episode again from the file that a failed claim left behind: the same bytes.

    Args:
        path: the file, seed-N.npz.
        loop: a loop like that of the test; None: the loop of the file, if its scene was a file.

    Yields:
        The observations of the controller: at the start, then after each decision.

    Raises:
        EvsError: the file is damaged or has another format, or the loop is of another kind.
    """
    about, ctrl, start = _read(Path(path))
    loop = loop or _loop_of(about, path)
    pushes = Pushes(loop, pushes_of(about["pushes"]))
    seen = loop.restore(start)
    pushes.begin()
    try:
        yield seen
        for values in ctrl:
            # a row of NaN: the last one was kept
            yield loop.step(None if np.isnan(values).all() else values, int(about["ticks"]))
    finally:
        pushes.end()


def _loop_of(about: dict[str, Any], path: str | Path) -> ClosedLoop:
    if not about["scene"] or about["options"] is None:
        raise EvsError(
            f"'{path}' does not say how its loop was made: give loop=, made as in the test"
        )
    return ClosedLoop(about["scene"], **options_of(about["options"]))


def _read(path: Path) -> tuple[dict[str, Any], Any, bytes]:
    """The file's description, its controls (n, nu), and the state that it begins with."""
    try:
        with np.load(path, allow_pickle=False) as file:
            about = json.loads(str(file["about"]))
            ctrl, start = file["ctrl"], file["start"].tobytes()
    except FileNotFoundError:
        raise EvsError(f"no file '{path}': give one that a failed claim left behind") from None
    except _NO_ARCHIVE:
        about, ctrl, start = None, None, b""
    if not isinstance(about, dict) or about.get("kind") != KIND:
        raise EvsError(f"'{path}' is no {KIND} file: give one that a failed claim left behind")
    return about, ctrl, start


def _record(folder: Path, loop: ClosedLoop, file: Path, seed: int) -> list[Path]:
    """The events of every camera, before any delay, one AEDAT4 file each."""
    paths = [folder / f"seed-{seed}-{stream.camera}.aedat4" for stream in loop.streams]
    sinks = [Aedat4Recorder(path) for path in paths]
    for sink, stream in zip(sinks, loop.streams, strict=True):
        sink.open([stream])
    before, episode = loop.on_tick, replay(file, loop)
    next(episode)
    pushing = loop.on_tick

    def write(packets: tuple[EventPacket, ...]) -> None:
        if pushing is not None:
            pushing(packets)
        for sink, packet in zip(sinks, packets, strict=True):
            sink.write(packet)

    loop.on_tick = write
    try:
        for _ in episode:
            pass
    finally:
        loop.on_tick = before
        for sink in sinks:
            sink.close()
    return paths


def plain_options(options: Mapping[str, Any]) -> dict[str, Any] | None:
    """The options of a ClosedLoop as JSON values; None if JSON cannot hold one of them."""
    try:
        return {name: _plain(value) for name, value in options.items()}
    except TypeError:
        return None


def options_of(plain: Mapping[str, Any]) -> dict[str, Any]:
    """The options of a ClosedLoop from what `plain_options` returned."""
    return {name: _value(value) for name, value in plain.items()}


def _plain(value: Any) -> Any:
    if type(value) in _CLASSES.values():
        inner = {field.name: _plain(getattr(value, field.name)) for field in fields(value)}
        return {_CLASS: type(value).__name__, **inner}
    if isinstance(value, Mapping):
        return {str(key): _plain(one) for key, one in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(one) for one in value]
    if value is None or isinstance(value, str | bool | int | float):
        return value
    raise TypeError(f"{value!r} is nothing that JSON has")


def _value(plain: Any) -> Any:
    if isinstance(plain, dict) and _CLASS in plain:
        inner = {key: _value(one) for key, one in plain.items() if key != _CLASS}
        return _CLASSES[plain[_CLASS]](**inner)
    if isinstance(plain, dict):
        return {key: _value(one) for key, one in plain.items()}
    return tuple(_value(one) for one in plain) if isinstance(plain, list) else plain
