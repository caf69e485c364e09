"""DAT files of Prophesee's cameras: recorder and reader."""

from evs.drivers.files.dat.reader import DatFile
from evs.drivers.files.dat.recorder import DatRecorder

__all__ = ["DatFile", "DatRecorder"]
