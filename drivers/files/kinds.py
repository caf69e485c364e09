"""Reader, recorder and repair of each format, imported when first asked for: some need an extra."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from evs.drivers.files.recorded import RecordedFile
    from evs.drivers.files.repaired import Repair
    from evs.drivers.sink import Sink


def open_aedat4(path: Path) -> RecordedFile:
    """The reader of AEDAT4."""
    from evs.drivers.files.aedat4 import Aedat4File

    return Aedat4File.at(path)


def record_aedat4(path: Path, **options: Any) -> Sink:
    """The recorder of AEDAT4."""
    from evs.drivers.files.aedat4 import Aedat4Recorder

    return Aedat4Recorder(path, **options)


def repair_aedat4(path: Path) -> Repair:
    """The repair of AEDAT4."""
    from evs.drivers.files.aedat4 import repair

    return repair(path)


def open_npz(path: Path) -> RecordedFile:
    """The reader of NPZ."""
    from evs.drivers.files.npz import NpzFile

    return NpzFile.at(path)


def record_npz(path: Path) -> Sink:
    """The recorder of NPZ."""
    from evs.drivers.files.npz import NpzRecorder

    return NpzRecorder(path)


def open_raw(path: Path) -> RecordedFile:
    """The reader of RAW."""
    from evs.drivers.files.raw import RawFile

    return RawFile.at(path)


def record_evt3(path: Path) -> Sink:
    """The recorder of EVT3."""
    from evs.drivers.files.raw import Evt3Recorder

    return Evt3Recorder(path)


def record_evt21(path: Path) -> Sink:
    """The recorder of EVT2.1."""
    from evs.drivers.files.raw import Evt21Recorder

    return Evt21Recorder(path)


def record_evt2(path: Path) -> Sink:
    """The recorder of EVT2."""
    from evs.drivers.files.raw import Evt2Recorder

    return Evt2Recorder(path)


def open_dat(path: Path) -> RecordedFile:
    """The reader of DAT."""
    from evs.drivers.files.dat import DatFile

    return DatFile.at(path)


def record_dat(path: Path) -> Sink:
    """The recorder of DAT."""
    from evs.drivers.files.dat import DatRecorder

    return DatRecorder(path)


def open_hdf5(path: Path) -> RecordedFile:
    """The reader of HDF5."""
    from evs.drivers.files.hdf5 import Hdf5File

    return Hdf5File.at(path)


def record_hdf5(path: Path) -> Sink:
    """The recorder of HDF5."""
    from evs.drivers.files.hdf5 import Hdf5Recorder

    return Hdf5Recorder(path)


def repair_hdf5(path: Path) -> Repair:
    """The repair of HDF5."""
    from evs.drivers.files.hdf5 import repair

    return repair(path)


def repair_bag(path: Path) -> Repair:
    """The repair of bags."""
    from evs.drivers.files.bags import repair

    return repair(path)


def open_bag(path: Path) -> RecordedFile:
    """The reader of bags."""
    from evs.drivers.files.bags import BagFile

    return BagFile.at(path)


def record_rosbag1(path: Path, **options: str) -> Sink:
    """The recorder of ROS 1 bags."""
    from evs.drivers.files.bags import Ros1Recorder

    return Ros1Recorder(path, **options)


def record_rosbag2(path: Path, **options: str) -> Sink:
    """The recorder of rosbag2."""
    from evs.drivers.files.bags import Ros2Recorder

    return Ros2Recorder(path, **options)


def open_aedat2(path: Path) -> RecordedFile:
    """The reader of AEDAT2."""
    from evs.drivers.files.aedat2 import Aedat2File

    return Aedat2File.at(path)


def record_aedat2(path: Path) -> Sink:
    """The recorder of AEDAT2."""
    from evs.drivers.files.aedat2 import Aedat2Recorder

    return Aedat2Recorder(path)


def open_aedat3(path: Path) -> RecordedFile:
    """The reader of AEDAT3.1."""
    from evs.drivers.files.aedat3 import Aedat3File

    return Aedat3File.at(path)


def record_aedat3(path: Path) -> Sink:
    """The recorder of AEDAT3.1."""
    from evs.drivers.files.aedat3 import Aedat3Recorder

    return Aedat3Recorder(path)


def open_csv(path: Path) -> RecordedFile:
    """The reader of CSV."""
    from evs.drivers.files.csv import CsvFile

    return CsvFile.at(path)


def record_csv(path: Path) -> Sink:
    """The recorder of CSV."""
    from evs.drivers.files.csv import CsvRecorder

    return CsvRecorder(path)
