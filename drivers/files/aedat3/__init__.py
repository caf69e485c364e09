"""AEDAT3.1, cAER's and jAER's files: recorder and reader."""

from evs.drivers.files.aedat3.reader import Aedat3File
from evs.drivers.files.aedat3.recorder import Aedat3Recorder

__all__ = ["Aedat3File", "Aedat3Recorder"]
