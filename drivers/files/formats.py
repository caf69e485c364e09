"""The table of formats: one entry says everything about a kind of recording.

A new format is an entry here, with a reader (recorded.RecordedFile) and a recorder (a Sink); then
`evs.read`, `evs info`, `view`, `play`, `convert`, `--record` and `[[sink]]` know it. Readers and
recorders are imported when they are first asked for, since some need an extra.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING

from evs.drivers.files import kinds
from evs.msgs import EvsError, unknown
from evs.msgs.codecs import (
    LAST_ROS_US,
    LONGEST_US,
    MAX_SIDE_DAT_PX,
    MAX_SIDE_EVT_PX,
    TIME_ORIGIN_US,
)

if TYPE_CHECKING:
    from evs.drivers.files.recorded import RecordedFile
    from evs.drivers.files.repaired import Repair
    from evs.drivers.sink import Sink

AnyPath = str | os.PathLike[str]

MAX_SIDE_PX = 1 << 15
"""x and y are int16."""

HEAD_BYTES = 1024
"""Of a file, for Format.begins."""


@dataclass(frozen=True)
class Holds:
    """What fits into a format; recorders refuse the rest, `evs convert` before it writes."""

    width: int = MAX_SIDE_PX
    """widest sensor, px"""
    height: int = MAX_SIDE_PX
    """highest sensor, px"""
    first_us: int = -(1 << 62)
    """lowest time stamp"""
    last_us: int = 1 << 62
    """highest time stamp"""
    from_start: bool = False
    """both count from the stream's begin (scene.start_us), as a camera's own clock does"""
    latest_us: int = 1 << 62
    """highest time stamp, wherever the stream begins"""
    silence_us: int = 1 << 62
    """the first event comes earlier than this after the stream's begin"""
    frames: bool = False
    """intensity frames beside the events"""
    imu: bool = False
    """IMU samples beside them"""
    triggers: bool = False
    """triggers beside them"""
    labels: bool = False
    """cause and geom of each event"""


ANYTHING = Holds()
"""Events of any time on a sensor of any size."""


@dataclass(frozen=True)
class Format:
    """One kind of recording."""

    name: str
    """also the type of its sink, and what `evs convert --format` takes"""
    suffixes: tuple[str, ...]
    """endings that mean it, in lower case, the usual one first"""
    title: str
    """NAME: one line for people"""
    open: Callable[[Path], RecordedFile]
    """the reader; EvsError where the file is none of it"""
    record: Callable[..., Sink]
    """the recorder, not yet open: record(path, **options)"""
    holds: Holds = ANYTHING
    keys: tuple[str, ...] = ()
    """options of record: keys of its sink beside `file`"""
    by_encoding: Mapping[str, Holds] = field(default_factory=dict)
    """the option `encoding` -> what fits, where that is not `holds`"""
    also: tuple[str, ...] = ()
    """endings of other formats that its files may have too"""
    begins: Callable[[bytes], bool] | None = None
    """whether a file with these first bytes is one of it; needed where an ending is shared"""
    repair: Callable[[Path], Repair] | None = None
    """cuts a torn tail in place; None: repaired.cut does it, by what the reader says"""
    extra: str = ""
    """the extra of evs that it needs, `pip install 'evs[EXTRA]'`; empty: none"""

    @property
    def called(self) -> str:
        """Its name for people."""
        return self.title.partition(":")[0]

    def holding(self, encoding: str | None) -> Holds:
        """What fits with the option `encoding`; None: it is not given."""
        return self.by_encoding.get(encoding or "", self.holds)


_LAST_US = LONGEST_US - TIME_ORIGIN_US - 1
_ROS = Holds(first_us=0, latest_us=LAST_ROS_US, frames=True, imu=True)
_ROS_EVT3 = replace(_ROS, last_us=_LAST_US, from_start=True)
_EVT = Holds(MAX_SIDE_EVT_PX, MAX_SIDE_EVT_PX, 0, _LAST_US, from_start=True)

FORMATS: tuple[Format, ...] = (
    Format(
        name="aedat4",
        suffixes=(".aedat4",),
        also=(".aedat",),
        title="AEDAT4: DV's own; survives a kill at any moment",
        open=kinds.open_aedat4,
        record=kinds.record_aedat4,
        holds=Holds(frames=True, imu=True, triggers=True),
        keys=("compression", "rotate_mb", "rotate_s"),
        begins=lambda head: head.startswith(b"#!AER-DAT4"),
        repair=kinds.repair_aedat4,
    ),
    Format(
        name="npz",
        suffixes=(".npz",),
        title="NPZ: arrays t, x, y, p that numpy.load reads",
        open=kinds.open_npz,
        record=kinds.record_npz,
        holds=Holds(frames=True, imu=True, triggers=True, labels=True),
    ),
    Format(
        name="evt3",
        suffixes=(".raw",),
        title="EVT3: RAW files of Prophesee's cameras; survives a kill at any moment",
        open=kinds.open_raw,
        record=kinds.record_evt3,
        holds=_EVT,
        begins=lambda head: b"% evt 3" in head or b"% format EVT3" in head,
    ),
    Format(
        name="evt2",
        suffixes=(".evt2",),
        also=(".raw",),
        title="EVT2: RAW files of older Prophesee cameras; survives a kill at any moment",
        open=kinds.open_raw,
        record=kinds.record_evt2,
        holds=_EVT,
        begins=lambda head: b"% evt 2.0" in head or b"% format EVT2;" in head,
    ),
    Format(
        name="evt21",
        suffixes=(".evt21",),
        also=(".raw",),
        title="EVT2.1: RAW files of Prophesee's cameras, in vectors; survives a kill at any moment",
        open=kinds.open_raw,
        record=kinds.record_evt21,
        holds=_EVT,
        begins=lambda head: b"% evt 2.1" in head or b"% format EVT21" in head,
    ),
    Format(
        name="dat",
        suffixes=(".dat",),
        title="DAT: Prophesee's 8 bytes an event; survives a kill at any moment",
        open=kinds.open_dat,
        record=kinds.record_dat,
        holds=Holds(MAX_SIDE_DAT_PX, MAX_SIDE_DAT_PX, 0, from_start=True, silence_us=1 << 32),
    ),
    Format(
        name="hdf5",
        suffixes=(".h5", ".hdf5"),
        title="HDF5: the layout of the DSEC data set",
        open=kinds.open_hdf5,
        repair=kinds.repair_hdf5,
        record=kinds.record_hdf5,
        extra="formats",
    ),
    Format(
        name="rosbag2",
        suffixes=(".mcap", ".db3"),
        title="rosbag2: a recording of event_camera_msgs for ROS 2",
        open=kinds.open_bag,
        repair=kinds.repair_bag,
        record=kinds.record_rosbag2,
        holds=_ROS_EVT3,
        by_encoding={"libcaer": _ROS, "mono": _ROS, "dvs": _ROS},
        keys=("encoding",),
        extra="ros2",
    ),
    Format(
        name="rosbag1",
        suffixes=(".bag",),
        title="Bag: a ROS 1 recording of dvs_msgs",
        open=kinds.open_bag,
        repair=kinds.repair_bag,
        record=kinds.record_rosbag1,
        holds=_ROS,
        by_encoding={"evt3": _ROS_EVT3},
        keys=("encoding",),
        extra="ros2",
    ),
    Format(
        name="aedat2",
        suffixes=(".aedat", ".aedat2"),
        title="AEDAT2: a DAVIS's files, which jAER reads",
        open=kinds.open_aedat2,
        record=kinds.record_aedat2,
        holds=Holds(width=1 << 10, height=1 << 9, first_us=0),
    ),
    Format(
        name="aedat3",
        suffixes=(".aedat3",),
        also=(".aedat",),
        title="AEDAT3.1: cAER's and jAER's",
        open=kinds.open_aedat3,
        record=kinds.record_aedat3,
        holds=Holds(first_us=0, frames=True, imu=True),
        begins=lambda head: head.startswith(b"#!AER-DAT3"),
    ),
    Format(
        name="csv",
        suffixes=(".csv", ".txt"),
        title="CSV: lines of t,x,y,p",
        open=kinds.open_csv,
        record=kinds.record_csv,
    ),
)
"""Every format."""

SUFFIXES = tuple(suffix for one in FORMATS for suffix in one.suffixes)
"""Every ending; each means one format."""


def by_name(name: str) -> Format:
    """The format of this name; EvsError tells the nearest."""
    for one in FORMATS:
        if one.name == name:
            return one
    raise unknown("recording format", name, [one.name for one in FORMATS])


def to_write(path: AnyPath, name: str | None = None) -> Format:
    """The format that a new file gets: by name, or else by its ending."""
    return _meant(path) if name is None else by_name(name)


def to_read(path: AnyPath) -> Format:
    """The format of a file: by its ending, and by its first bytes where that is shared."""
    meant = _meant(path)
    suffix = Path(path).suffix.lower()
    others = [one for one in FORMATS if suffix in one.also and one.begins is not None]
    # a pipe would be waited for; its reader tells what is wrong with the path
    if others and Path(path).is_file():
        try:
            with Path(path).open("rb") as file:
                head = file.read(HEAD_BYTES)
        except OSError:
            return meant
        for one in others:
            if one.begins is not None and one.begins(head):
                return one
    return meant


def _meant(path: AnyPath) -> Format:
    suffix = Path(path).suffix.lower()
    for one in FORMATS:
        if suffix in one.suffixes:
            return one
    known = f"{', '.join(SUFFIXES[:-1])} or {SUFFIXES[-1]}"
    raise EvsError(f"no recording format '{suffix}' (of {Path(path)}); names end in {known}")


def endings(formats: Iterable[Format] = FORMATS) -> str:
    """The endings of files in words, for help texts."""
    every = list(dict.fromkeys(one.suffixes[0] for one in formats))
    return f"{', '.join(every[:-1])} or {every[-1]}"
