"""HDF5 recordings as DSEC, rpg's data sets and Metavision have them. The door to h5py.

It comes with the extra `formats`.
"""

from evs.drivers.files.hdf5.reader import Hdf5File, repair
from evs.drivers.files.hdf5.recorder import Hdf5Recorder, MetavisionRecorder

__all__ = ["Hdf5File", "Hdf5Recorder", "MetavisionRecorder", "repair"]
