"""AEDAT2, jAER's files: recorder (as a DAVIS) and reader (of every chip in `chips.CHIPS`)."""

from evs.drivers.files.aedat2.reader import Aedat2File
from evs.drivers.files.aedat2.recorder import Aedat2Recorder

__all__ = ["Aedat2File", "Aedat2Recorder"]
