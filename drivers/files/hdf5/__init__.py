"""HDF5 recordings as DSEC and rpg's data sets have them. The door to h5py (extra `formats`)."""

from evs.drivers.files.hdf5.reader import Hdf5File, repair
from evs.drivers.files.hdf5.recorder import Hdf5Recorder

__all__ = ["Hdf5File", "Hdf5Recorder", "repair"]
