"""NPZ files: recorder, reader, and a writer of frame stacks."""

from evs.drivers.files.npz.reader import NpzFile
from evs.drivers.files.npz.recorder import NpzRecorder

__all__ = ["NpzFile", "NpzRecorder"]
