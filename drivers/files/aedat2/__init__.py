"""AEDAT2, jAER's files of a DAVIS (and, reading, a DVS128): recorder and reader."""

from evs.drivers.files.aedat2.reader import Aedat2File
from evs.drivers.files.aedat2.recorder import Aedat2Recorder

__all__ = ["Aedat2File", "Aedat2Recorder"]
