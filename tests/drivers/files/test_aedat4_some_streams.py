"""AEDAT4 files that lack streams, or hold nothing in them: read as what they have."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from evs.drivers import files
from evs.launch.main import main
from evs.msgs import EvsError

SCRIPT = Path(__file__).parents[2] / "support" / "oracles" / "aedat4_oracles.py"
STAMPS = [1000, 1001, 1002]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    made = tmp_path_factory.mktemp("some")
    subprocess.run([sys.executable, SCRIPT, "some", made], check=True, capture_output=True)
    return made


@pytest.mark.parametrize("name", ["f-f", "i-i", "t-t", "fit-fit", "eit-e", "eit-eIT", "efit-t"])
def test_a_file_is_read_as_what_it_has(folder: Path, name: str, tmp_path: Path) -> None:
    path, held = folder / f"{name}.aedat4", name.partition("-")[2]
    recording = files.read(path)
    assert recording["t"].tolist() == (STAMPS if "e" in held else [])
    assert [frame.exposure_begin_us for frame in recording.frames] == (
        STAMPS if "f" in held else []
    )
    assert recording.imu["t"].tolist() == (STAMPS if "i" in held else [])
    assert recording.triggers["t"].tolist() == (STAMPS if "t" in held else [])
    assert recording.stream.camera == "eye"
    sides = recording.stream.width, recording.stream.height
    assert sides == ((34, 26) if set(name) & set("ef") - {"-"} else (1, 1))
    assert main(["info", str(path)]) == 0
    # all of it goes where it fits, and only what is there is missed elsewhere
    for target in ("a.aedat4", "a.npz"):
        done = files.convert(path, tmp_path / target)
        counts = done.events, done.frames, done.imu_samples, done.triggers
        assert counts == tuple(3 * (kind in held) for kind in "efit")
    if held.strip("eIT"):
        with pytest.raises(EvsError, match="cannot hold the"):
            files.convert(path, tmp_path / "a.csv")
    else:
        assert files.convert(path, tmp_path / "a.csv").events == 3


def test_packets_of_nothing_are_not_played(folder: Path) -> None:
    assert [len(one) for one in files.messages(folder / "eit-eIT.aedat4")] == [3]
