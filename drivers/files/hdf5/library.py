"""h5py, where it is installed, with the compressions that public data sets use."""

from __future__ import annotations

from typing import Any

from evs.msgs import EvsError


def load() -> Any:
    """The library; EvsError says how to install it."""
    try:
        import h5py
        import hdf5plugin
    except ImportError:
        raise EvsError("HDF5 recordings need h5py: pip install 'evs[formats]'") from None
    # importing it registers DSEC's compression, Blosc; it asks to be named
    assert hdf5plugin is not None
    return h5py
