"""HDF5 recordings of DSEC, rpg's data sets and Metavision. Only this package imports h5py.

It comes with the extra `formats`.
"""

from evs.drivers.files.hdf5.reader import Hdf5File, repair
from evs.drivers.files.hdf5.recorder import Hdf5Recorder, MetavisionRecorder

__all__ = ["Hdf5File", "Hdf5Recorder", "MetavisionRecorder", "repair"]
