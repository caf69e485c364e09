"""RAW files of Prophesee cameras, EVT2, EVT2.1 and EVT3: recorders and reader."""

from evs.drivers.files.raw.reader import RawFile
from evs.drivers.files.raw.recorder import Evt2Recorder, Evt3Recorder, Evt21Recorder

__all__ = ["Evt2Recorder", "Evt3Recorder", "Evt21Recorder", "RawFile"]
