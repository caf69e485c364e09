"""The conftest.py of tests that run on a wheel: evs is the one that was installed, and no other."""

from __future__ import annotations

import os
from importlib.metadata import entry_points, version
from pathlib import Path

import evs
import evs.emulator._core


def pytest_configure() -> None:
    """Refuse to run on anything but EVS_INSTALLED_IN, as a checkout that is on the path too."""
    for found in (evs.__file__, evs.emulator._core.__file__):
        assert (
            Path(found or "")
            .resolve()
            .is_relative_to(Path(os.environ["EVS_INSTALLED_IN"]).resolve())
        ), f"{found} is not the wheel's"
    assert [entry.value for entry in entry_points(name="evs")] == ["evs.__main__:main"]
    assert not [entry for entry in entry_points(group="pytest11") if "evs" in entry.value]
    assert evs.__version__ == version("evs")
    assert all(getattr(evs, name) is not None for name in evs.__all__)
