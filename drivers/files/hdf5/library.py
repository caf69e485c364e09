"""h5py, if it is installed."""

from __future__ import annotations

from importlib.util import find_spec
from typing import Any

from evs.msgs import EvsError

ECF_FILTER = 0x8ECF
"""HDF5's number of Metavision's codec; no package on PyPI has the filter itself"""


_MISSING = "HDF5 recordings need h5py: pip install 'evs[formats]'"


def check_installed() -> None:
    """EvsError names the extra if the library is missing; it is not imported."""
    if find_spec("h5py") is None or find_spec("hdf5plugin") is None:
        raise EvsError(_MISSING)


def load() -> Any:
    """Import the library, to write; EvsError names the extra if it is missing."""
    try:
        import h5py
    except ImportError:
        raise EvsError(_MISSING) from None
    return h5py
