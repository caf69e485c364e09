"""faery, where it is installed, and its errors as ours."""

from __future__ import annotations

from types import ModuleType

from evs.msgs import EvsError


def load() -> ModuleType:
    """The library; EvsError says how to install it."""
    try:
        import faery
    except ImportError:
        raise EvsError("DAT files need faery: pip install 'evs[formats]'") from None
    found: ModuleType = faery
    return found


def is_fault(reason: BaseException) -> bool:
    """Whether the library says that something is wrong with the file: its errors and its panics."""
    return isinstance(reason, Exception) or type(reason).__name__ == "PanicException"
