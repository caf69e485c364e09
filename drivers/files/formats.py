"""The table of formats: one row describes everything about a kind of recording.

To add a format, write a reader (a `recording_file.RecordingFile` with a class method `at(path)`)
and a recorder (a `Sink`; formats that are only read have none), and add a row here. `evs.read`,
`evs info`, `view`, `play`, `convert`, `--record` and `[[sink]]` then know it. Rows name readers and
recorders as "module:name"; a module is imported when its format is first used, since some formats
need an extra.
"""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypedDict, Unpack

from evs.drivers.files.capabilities import ANYTHING, Capabilities
from evs.msgs import EvsError, unknown
from evs.msgs.codecs import (
    LAST_ROS_US,
    LONGEST_US,
    MAX_SIDE_DAT_PX,
    MAX_SIDE_EVT_PX,
    PAYLOADS,
    TIME_ORIGIN_US,
)
from evs.msgs.registry import load

if TYPE_CHECKING:
    from evs.drivers.files.recording_file import RecordingFile
    from evs.drivers.sink import Sink

AnyPath = str | os.PathLike[str]


class ReadOptions(TypedDict, total=False):
    """How a recording is read: keyword arguments of everything that reads one.

    A format takes those that its row lists in `read_options`, and refuses others but `single`.
    """

    columns: str
    """what the columns hold, as in "t,x,y,p" or "t=time,x=col,y=row,p=sign"; others are ignored"""
    unit: str
    """of its times: s, ms, us or ns"""
    stream: str | int
    """key or name of the event stream that is read, where a recording holds several"""
    chip: str
    """name of the camera's chip, which decides the layout of AEDAT2's addresses"""
    single: bool
    """read only this file of a recording in several"""


MAGIC_BYTES = 1024
"""how many of a file's first bytes `Format.matches` gets"""

SIZE_LINE = re.compile(rb"\s*(\d{1,5})[ \t]+(\d{1,5})[ \t]*\r?\n")
"""the first line of rpg_e2vid's text files: width and height, px"""


@dataclass(frozen=True)
class Format:
    """One kind of recording."""

    name: str
    """also the type of its sink, and the value of `evs convert --format`"""
    suffixes: tuple[str, ...]
    """file name endings of the format, in lower case, the usual one first"""
    title: str
    """NAME: one line for help texts"""
    reader: str
    """"module:class" of its RecordingFile"""
    recorder: str = ""
    """"module:class" of its Sink; empty: evs reads the format and does not write it"""
    capabilities: Capabilities = ANYTHING
    options: tuple[str, ...] = ()
    """keyword arguments of the recorder: keys of its sink in addition to `file`"""
    read_options: tuple[str, ...] = ()
    """those of ReadOptions that its reader takes"""
    capabilities_by_encoding: Mapping[str, Capabilities] = field(default_factory=dict)
    """value of the option `encoding` -> capabilities, where they differ"""
    shared_suffixes: tuple[str, ...] = ()
    """endings of other formats that its files may have too"""
    matches: Callable[[bytes], bool] | None = None
    """whether a file with these first bytes is of this format; needed where an ending is shared"""
    repairer: str = ""
    """"module:function" that repairs a file in place; empty: a truncated tail is cut off"""
    metadata_file: bool = False
    """whether the StreamInfo lies in FILE.json, since the file has no place for it"""
    extra: str = ""
    """the extra of evs that it needs, `pip install 'evs[EXTRA]'`; empty: none"""

    @property
    def display_name(self) -> str:
        """Its name in messages."""
        return self.title.partition(":")[0]

    def capabilities_for(self, encoding: str | None) -> Capabilities:
        """Its limits with the option `encoding`; None: the default encoding."""
        return self.capabilities_by_encoding.get(encoding or "", self.capabilities)

    def open(self, path: Path, **options: Unpack[ReadOptions]) -> RecordingFile:
        """Open a file and read its header.

        Args:
            path: The file.
            **options: Some of `read_options`; empty ones count as absent.

        Returns:
            The format's reader.

        Raises:
            EvsError: The file is missing or has another format, it already states the value of an
                option, or the format's extra is not installed.
        """
        given = {
            name: value
            for name, value in options.items()
            if value not in ("", None) and name != "single"
        }
        for name in given:
            if name not in self.read_options:
                raise EvsError(
                    f"{path} is {self.display_name}, which needs no --{name}: leave it out"
                )
        reader: RecordingFile = load(self.reader).at(path, **given)
        return reader

    def record(self, path: Path, **options: Any) -> Sink:
        """Make a recorder, which creates its file when it is opened.

        Args:
            path: The file to write.
            **options: Some of `options`.

        Returns:
            The recorder, not open yet.

        Raises:
            EvsError: An option has an impossible value, or the format's extra is not installed.
        """
        recorder: Sink = load(self.recorder)(path, **options)
        return recorder


_ROS = Capabilities(first_us=0, latest_us=LAST_ROS_US, frames=True, imu=True)
_ROS_EVT3 = replace(_ROS, last_us=LONGEST_US - TIME_ORIGIN_US - 1, from_start=True)
_BAG_ENCODINGS = {"dvs": _ROS} | {
    name: _ROS_EVT3 if codec.has_clock else _ROS for name, codec in PAYLOADS.items()
}
_TXT = Capabilities(first_us=0, latest_us=2**33 * 1_000_000 - 1)
"""seconds as float64, which resolve 1 us up to there"""
_EVT = Capabilities(MAX_SIDE_EVT_PX, MAX_SIDE_EVT_PX, 0, LONGEST_US - 1, from_start=True)

FORMATS: tuple[Format, ...] = (
    Format(
        name="aedat4",
        suffixes=(".aedat4",),
        shared_suffixes=(".aedat",),
        title="AEDAT4: DV's own; survives a kill at any moment",
        reader="evs.drivers.files.aedat4.reader:Aedat4File",
        recorder="evs.drivers.files.aedat4.recorder:Aedat4Recorder",
        capabilities=Capabilities(frames=True, regions=True, imu=True, triggers=True),
        options=("compression", "rotate_mb", "rotate_s"),
        read_options=("stream",),
        matches=lambda head: head.startswith(b"#!AER-DAT4"),
        repairer="evs.drivers.files.aedat4.repair:repair",
    ),
    Format(
        name="npz",
        suffixes=(".npz",),
        title="NPZ: arrays t, x, y, p that numpy.load reads",
        reader="evs.drivers.files.npz.reader:NpzFile",
        read_options=("columns", "unit"),
        recorder="evs.drivers.files.npz.recorder:NpzRecorder",
        capabilities=Capabilities(frames=True, imu=True, triggers=True, labels=True),
    ),
    Format(
        name="npy",
        suffixes=(".npy",),
        title="NPY: one array of events, as columns or as a table",
        reader="evs.drivers.files.npz.reader:NpzFile",
        read_options=("columns", "unit"),
    ),
    Format(
        name="evt3",
        suffixes=(".raw",),
        title="EVT3: RAW files of Prophesee's cameras; survives a kill at any moment",
        reader="evs.drivers.files.raw:RawFile",
        recorder="evs.drivers.files.raw:Evt3Recorder",
        capabilities=_EVT,
        matches=lambda head: b"% evt 3" in head or b"% format EVT3" in head,
    ),
    Format(
        name="evt2",
        suffixes=(".evt2",),
        shared_suffixes=(".raw",),
        title="EVT2: RAW files of older Prophesee cameras; survives a kill at any moment",
        reader="evs.drivers.files.raw:RawFile",
        recorder="evs.drivers.files.raw:Evt2Recorder",
        capabilities=_EVT,
        matches=lambda head: b"% evt 2.0" in head or b"% format EVT2;" in head,
    ),
    Format(
        name="evt21",
        suffixes=(".evt21",),
        shared_suffixes=(".raw",),
        title="EVT2.1: RAW files of Prophesee's cameras, in vectors; survives a kill at any moment",
        reader="evs.drivers.files.raw:RawFile",
        recorder="evs.drivers.files.raw:Evt21Recorder",
        capabilities=_EVT,
        matches=lambda head: b"% evt 2.1" in head or b"% format EVT21" in head,
    ),
    Format(
        name="dat",
        suffixes=(".dat",),
        title="DAT: Prophesee's 8 bytes per event; survives a kill at any moment",
        reader="evs.drivers.files.dat:DatFile",
        recorder="evs.drivers.files.dat:DatRecorder",
        capabilities=Capabilities(
            MAX_SIDE_DAT_PX, MAX_SIDE_DAT_PX, 0, from_start=True, silence_us=1 << 32
        ),
    ),
    Format(
        name="hdf5",
        suffixes=(".h5",),
        shared_suffixes=(".hdf5",),
        title="HDF5: the layout of the DSEC data set",
        reader="evs.drivers.files.hdf5.reader:Hdf5File",
        read_options=("columns", "unit", "stream"),
        repairer="evs.drivers.files.hdf5.reader:repair",
        recorder="evs.drivers.files.hdf5.recorder:Hdf5Recorder",
        extra="formats",
    ),
    Format(
        name="metavision",
        suffixes=(".hdf5",),
        shared_suffixes=(".h5",),
        title="Metavision HDF5: Prophesee's, compressed with ECF",
        reader="evs.drivers.files.hdf5.reader:Hdf5File",
        read_options=("columns", "unit", "stream"),
        repairer="evs.drivers.files.hdf5.reader:repair",
        recorder="evs.drivers.files.hdf5.recorder:MetavisionRecorder",
        capabilities=Capabilities(MAX_SIDE_EVT_PX, MAX_SIDE_EVT_PX, 0),
        extra="formats",
    ),
    Format(
        name="rosbag2",
        suffixes=(".mcap", ".db3"),
        title="rosbag2: a recording of event_camera_msgs for ROS 2",
        reader="evs.drivers.files.bags.reader:BagFile",
        repairer="evs.drivers.files.bags.repair:repair",
        recorder="evs.drivers.files.bags.recorder:Ros2Recorder",
        read_options=("stream",),
        capabilities=_ROS_EVT3,
        capabilities_by_encoding=_BAG_ENCODINGS,
        options=(
            *("encoding", "node", "namespace"),
            *("camera_frame_id", "imu_frame_id", "link_frame_id", "world_frame", "tf", "tf_static"),
        ),
        extra="ros2",
    ),
    Format(
        name="rosbag1",
        suffixes=(".bag",),
        title="Bag: a ROS 1 recording of dvs_msgs",
        reader="evs.drivers.files.bags.reader:BagFile",
        repairer="evs.drivers.files.bags.repair:repair",
        recorder="evs.drivers.files.bags.recorder:Ros1Recorder",
        read_options=("stream",),
        capabilities=_ROS,
        capabilities_by_encoding=_BAG_ENCODINGS,
        options=("encoding",),
        extra="ros2",
    ),
    Format(
        name="aedat2",
        suffixes=(".aedat", ".aedat2"),
        shared_suffixes=(".dat",),
        title="AEDAT2: jAER's files, written as a DAVIS's; AEDAT1 is read",
        read_options=("chip",),
        reader="evs.drivers.files.aedat2.reader:Aedat2File",
        recorder="evs.drivers.files.aedat2.recorder:Aedat2Recorder",
        capabilities=Capabilities(width=1 << 10, height=1 << 9, first_us=0),
        matches=lambda head: head.startswith(b"#!AER-DAT"),
    ),
    Format(
        name="aedat3",
        suffixes=(".aedat3",),
        shared_suffixes=(".aedat",),
        title="AEDAT3.1: cAER's and jAER's",
        reader="evs.drivers.files.aedat3.reader:Aedat3File",
        recorder="evs.drivers.files.aedat3.recorder:Aedat3Recorder",
        capabilities=Capabilities(first_us=0, frames=True, regions=True, imu=True),
        read_options=("stream",),
        matches=lambda head: head.startswith(b"#!AER-DAT3"),
    ),
    Format(
        name="csv",
        suffixes=(".csv",),
        title="CSV: lines of t,x,y,p, t in us",
        reader="evs.drivers.files.csv:CsvFile",
        recorder="evs.drivers.files.csv:CsvRecorder",
        metadata_file=True,
        read_options=("columns", "unit"),
    ),
    Format(
        name="txt",
        suffixes=(".txt",),
        title="TXT: lines of t x y p, t in seconds, as in the Event Camera Dataset",
        reader="evs.drivers.files.csv:CsvFile",
        recorder="evs.drivers.files.csv:TxtRecorder",
        capabilities=_TXT,
        metadata_file=True,
        read_options=("columns", "unit"),
    ),
    Format(
        name="e2vid",
        suffixes=(".e2vid",),
        shared_suffixes=(".txt",),
        title="E2VID: TXT after a line of width and height, for rpg_e2vid",
        reader="evs.drivers.files.csv:CsvFile",
        recorder="evs.drivers.files.csv:E2vidRecorder",
        capabilities=_TXT,
        metadata_file=True,
        read_options=("columns", "unit"),
        matches=lambda head: SIZE_LINE.match(head) is not None,
    ),
    Format(
        name="es",
        suffixes=(".es",),
        title="Event Stream: files of faery and loris",
        reader="evs.drivers.files.event_stream:EventStreamFile",
    ),
    Format(
        name="nmnist",
        suffixes=(".bin",),
        title="N-MNIST: 5 bytes per event, as in N-Caltech101",
        reader="evs.drivers.files.nmnist:NMnistFile",
    ),
)
"""Every format."""

RECORDED = tuple(row for row in FORMATS if row.recorder)
"""those that evs writes"""

SUFFIXES = tuple(suffix for row in FORMATS for suffix in row.suffixes)
"""Every file name ending; each belongs to one format."""


def by_name(name: str) -> Format:
    """The format of this name.

    Raises:
        EvsError: There is none; the message lists the names, nearest first.
    """
    for row in FORMATS:
        if row.name == name:
            return row
    raise unknown("recording format", name, [row.name for row in RECORDED])


def to_write(path: AnyPath, name: str | None = None) -> Format:
    """The format of a file to be written.

    Args:
        path: The file; its extension selects the format if there is no name.
        name: The format's name.

    Raises:
        EvsError: No format has this name or extension, or evs does not write it.
    """
    found = _by_suffix(path) if name is None else by_name(name)
    if not found.recorder:
        raise EvsError(
            f"{found.display_name} is read but not written (to {Path(path)}); names end in "
            f"{_listed(suffix for row in RECORDED for suffix in row.suffixes)}"
        )
    return found


BAG_METADATA = "metadata.yaml"
PACKED_SUFFIX = ".zstd"
"""a ROS 2 bag's metadata, in its folder; the ending of its files if they are compressed whole"""

_BAG_SUFFIXES = (".mcap", ".db3")


def is_bag_file(path: Path) -> bool:
    """Whether a name is that of a ROS 2 bag's file."""
    return path.name.lower().removesuffix(PACKED_SUFFIX).endswith(_BAG_SUFFIXES)


def is_bag_folder(path: Path) -> bool:
    """Whether a path is the folder of a ROS 2 bag."""
    try:
        if not path.is_dir():
            return False
        return (path / BAG_METADATA).is_file() or any(map(is_bag_file, path.iterdir()))
    except OSError:
        return False


def to_read(path: AnyPath) -> Format:
    """The format of an existing file: by its ending, and by its first bytes where that is shared.

    The folder of a ROS 2 bag is a recording too.

    Raises:
        EvsError: No format has this ending.
    """
    if is_bag_file(Path(path)) or is_bag_folder(Path(path)):
        return by_name("rosbag2")
    usual = _by_suffix(path)
    suffix = Path(path).suffix.lower()
    others = [row for row in FORMATS if suffix in row.shared_suffixes and row.matches is not None]
    # opening a pipe would block; the reader reports what is wrong with the path
    if others and Path(path).is_file():
        try:
            with Path(path).open("rb") as file:
                head = file.read(MAGIC_BYTES)
        except OSError:
            return usual
        for row in others:
            if row.matches is not None and row.matches(head):
                return row
    return usual


def _by_suffix(path: AnyPath) -> Format:
    suffix = Path(path).suffix.lower()
    for row in FORMATS:
        if suffix in row.suffixes:
            return row
    raise EvsError(
        f"no recording format '{suffix}' (of {Path(path)}); names end in {_listed(SUFFIXES)}"
    )


def endings(formats: Iterable[Format] = FORMATS) -> str:
    """The usual file name endings of formats, as a list in words for help texts."""
    return _listed(dict.fromkeys(row.suffixes[0] for row in formats))


def _listed(suffixes: Iterable[str]) -> str:
    """Endings as a list in words."""
    *most, last = suffixes
    return f"{', '.join(most)} or {last}"
