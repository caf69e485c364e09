"""Files that settings name: a pipe or a device is refused in one line, whatever it would give."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from evs.emulator.base.small_files import open_file, read_small
from evs.emulator.world import controls
from evs.emulator.world.controls import read_controls
from evs.msgs import EvsError
from evs.tools.dataset.manifest import MANIFEST, read_json
from reference.alarm import not_waited_for

pytestmark = pytest.mark.extremes

READ = """
import resource, sys
from pathlib import Path
from evs.emulator.config.decoding import read_toml
from evs.emulator.sensor.presets import _read
from evs.emulator.sensor.parameters import ReadoutParameters
from evs.emulator.sensor.readout import draw_fates
from evs.msgs import EvsError
held = int(open("/proc/self/statm").read().split()[0]) * resource.getpagesize()
resource.setrlimit(resource.RLIMIT_AS, (held + (1 << 28), held + (1 << 28)))
path = Path(sys.argv[1])
for read in (
    lambda: draw_fates(ReadoutParameters(mask_file=str(path)), 8, 8),
    lambda: read_toml(path),
    lambda: _read(path),
):
    try:
        read()
    except EvsError as error:
        print(error)
"""
"""Each reader of a file that settings name, with 256 MiB more than the tools themselves take."""


@pytest.mark.parametrize("what", ["/dev/zero", "pipe"])
def test_files_that_settings_name_are_regular_ones(what: str, tmp_path: Path) -> None:
    if what == "pipe":
        what = str(tmp_path / what)
        os.mkfifo(what)
    command = [sys.executable, "-c", READ, what]
    done = subprocess.run(command, capture_output=True, text=True, timeout=10, check=False)
    lines = done.stdout.splitlines()
    assert len(lines) == 3, done.stderr
    assert all("it is a pipe or a device" in line and what in line for line in lines)


def test_pipes_in_folders_of_data_are_not_waited_for(tmp_path: Path) -> None:
    for name in (MANIFEST, "light.npz"):
        os.mkfifo(tmp_path / name)
    readers: list[Callable[[], object]] = [
        lambda: read_json(tmp_path / MANIFEST),
        lambda: open_file(tmp_path / "light.npz"),
    ]
    for read in readers:
        with (
            not_waited_for(),
            pytest.raises((EvsError, OSError), match=r"pipe or a device|cannot read"),
        ):
            read()


@pytest.mark.parametrize("what", ["/dev/zero", "pipe"])
def test_a_small_file_is_a_regular_one(what: str, tmp_path: Path) -> None:
    path = Path(what)
    if what == "pipe":
        path = tmp_path / what
        os.mkfifo(path)
    with pytest.raises(OSError, match="it is a pipe or a device"):
        read_small(path)


def test_a_small_file_has_a_bound(tmp_path: Path) -> None:
    path = tmp_path / "a"
    path.write_bytes(bytes(11))
    assert read_small(path, 11) == bytes(11)
    with pytest.raises(OSError, match="more than 10 bytes"):
        read_small(path, 10)


def test_a_control_file_expands_to_no_more_than_any_has(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "a.npz"
    np.savez_compressed(path, ctrl=np.zeros((10_000, 1)))
    assert len(read_controls(str(path), 1)) == 10_000
    monkeypatch.setattr(controls, "_MOST_BYTES", 10_000)
    assert path.stat().st_size < 10_000
    with pytest.raises(EvsError, match="expands to more than 10000 bytes"):
        read_controls(str(path), 1)
