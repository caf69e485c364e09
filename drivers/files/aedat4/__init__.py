"""AEDAT4 files: recorder, reader, repair."""

from evs.drivers.files.aedat4.reader import Aedat4File
from evs.drivers.files.aedat4.recorder import Aedat4Recorder
from evs.drivers.files.aedat4.repair import repair

__all__ = ["Aedat4File", "Aedat4Recorder", "repair"]
