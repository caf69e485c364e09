"""`evs doctor`: a fit machine, an unfit one, and its JSON."""

import argparse
import importlib.metadata
import json
import re
import sys
from pathlib import Path
from typing import Any

import pytest

from evs.drivers.run.report import Report
from evs.emulator.base import memory_limits
from evs.launch.commands import doctor
from evs.launch.main import main
from evs.msgs import EvsError, make_events
from evs.tools import doctor as checkup
from evs.tools.doctor import machine, packages, trial

TRIAL = ("renderer", "sensor", "bus", "recorder", "timing")


def checks_of(capsys: pytest.CaptureFixture[str]) -> tuple[int, dict[str, dict[str, str]]]:
    """Exit code of `evs doctor --quick --json` and its checks by name."""
    code = main(["doctor", "--quick", "--json"])
    said: dict[str, Any] = json.loads(capsys.readouterr().out)
    assert set(said) == {"fit", "checks", "extremes"}
    assert said["extremes"] == []
    for check in said["checks"]:
        assert set(check) == {"name", "verdict", "says", "fix"}
        assert check["verdict"] in (checkup.OK, checkup.NOTE, checkup.BAD)
        assert check["says"]
        assert "\n" not in check["says"] + check["fix"]
        # who is told that something is wrong is told what to do
        assert check["fix"] or check["verdict"] == checkup.OK
    assert said["fit"] == (code == 0)
    return code, {check["name"]: check for check in said["checks"]}


def test_this_machine_is_fit(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    code, checks = checks_of(capsys)
    assert code == 0, [check for check in checks.values() if check["verdict"] == checkup.BAD]
    for name in ("python", "platform", "cpu", "memory", "native core", *packages.CORE, *TRIAL):
        assert checks[name]["verdict"] != checkup.BAD
    assert checks["numpy"]["says"] == importlib.metadata.version("numpy")
    assert re.search(r"200 of 200 packets, [1-9][\d,]* events received", checks["bus"]["says"])
    assert re.match(r"\d+\.\d\d ms a tick", checks["timing"]["says"])
    assert checks[f"disk {tmp_path}"]["verdict"] == checkup.OK
    # nothing is left behind
    assert list(tmp_path.iterdir()) == []


def quick(monkeypatch: pytest.MonkeyPatch, **versions: str | None) -> None:
    """Leave the trial runs out, and tell other versions of packages; None: it is missing."""
    real = packages.version_of
    monkeypatch.setattr(packages, "version_of", lambda name: versions.get(name, real(name)))
    monkeypatch.setattr(trial, "check_pipeline", lambda folder: [])
    monkeypatch.setattr(trial, "check_timing", lambda: checkup.Check("timing", "ok", "not looked"))


@pytest.mark.parametrize(
    ("version", "asked", "inside"),
    [
        ("3.3", ">=3.3,<5", True),
        ("3.3.0", ">=3.3,<5", True),
        ("3.17.0", ">=3.3,<5", True),
        ("3.2.7", ">=3.3,<5", False),
        ("5.0", ">=3.3,<5", False),
        ("5.0.0rc1", ">=3.3,<5", False),
        ("1.26.4", "<3,>=1.26", True),
        ("24.3.25", ">=24.3", True),
        ("9", "", True),
    ],
)
def test_ranges_are_read_as_pip_reads_them(version: str, asked: str, inside: bool) -> None:
    assert packages.in_range(version, asked) == inside


ALL_EXTRAS = dict.fromkeys(name for names in packages.EXTRAS.values() for name in names)


@pytest.mark.parametrize(
    ("versions", "check", "verdict", "says", "fix"),
    [
        ({"pyzmq": None}, "pyzmq", "bad", "not installed", "pip install pyzmq"),
        *(
            (
                {"mujoco": version},
                "mujoco",
                "bad",
                f"{version}, evs needs >=3.3,<5",
                "pip install 'mujoco>=3.3,<5'",
            )
            for version in ("2.3.7", "3.2.9", "5.0.0")
        ),
        # only notes
        (
            {"onnxruntime": None},
            "onnxruntime",
            "note",
            "model.runtime=onnxruntime",
            "pip install onnxruntime",
        ),
        ({"gymnasium": "0.29"}, "extra gym", "note", "", "pip install 'gymnasium>=1.1,<2'"),
        (ALL_EXTRAS, "extra video", "note", "", "pip install 'evs[video]'"),
    ],
)
def test_packages_that_are_missing_or_out_of_range(
    versions: dict[str, str | None], check: str, verdict: str, says: str, fix: str,
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    quick(monkeypatch, **versions)
    code, checks = checks_of(capsys)
    assert [c["name"] for c in checks.values() if c["verdict"] == checkup.BAD] == [check] * code
    assert code == (verdict == checkup.BAD)
    assert (checks[check]["verdict"], checks[check]["fix"]) == (verdict, fix)
    assert says in checks[check]["says"]


def test_without_the_native_core_everything_else_is_still_told(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    import evs.emulator

    quick(monkeypatch)
    monkeypatch.setitem(sys.modules, "evs.emulator._core", None)
    monkeypatch.delattr(evs.emulator, "_core", raising=False)
    code, checks = checks_of(capsys)
    assert code == 1
    assert checks["native core"]["verdict"] == checkup.BAD
    assert checks["timing"]["verdict"] == checkup.OK


def test_only_the_portable_set_is_a_note(monkeypatch: pytest.MonkeyPatch) -> None:
    from evs.emulator import _core

    monkeypatch.setattr(_core, "isa_available", lambda: ["portable"])
    assert packages.check_core().verdict == checkup.NOTE


def test_a_trial_that_breaks_down_is_a_finding(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def broken(folder: Path) -> list[checkup.Check]:
        raise EvsError("the loopback device is\ndown")

    quick(monkeypatch)
    monkeypatch.setattr(trial, "check_pipeline", broken)
    code, checks = checks_of(capsys)
    assert code == 1
    assert checks["trial run"]["says"] == "the loopback device is down"


def test_lines_for_people(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    quick(monkeypatch, lz4=None)
    assert doctor.run(argparse.Namespace(json=False, quick=False, markdown=None)) == 1
    lines = capsys.readouterr().out.splitlines()
    assert any(re.match(r"ok +numpy +[\d.]+$", line) for line in lines)
    assert any(re.match(r"BAD +lz4 +not installed; pip install lz4$", line) for line in lines)
    assert lines[-1] == "evs will not work here until what is BAD is mended"


def test_a_folder_that_takes_no_files(tmp_path: Path) -> None:
    (found,) = machine.check_disk([tmp_path / "gone"])
    assert found.verdict == checkup.BAD
    assert "not writable" in found.says
    assert found.fix


def test_an_old_python_and_another_system(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(machine, "MIN_PYTHON", (99, 0))
    assert machine.check_python().verdict == checkup.BAD
    assert machine.check_python().fix == "install Python 99.0 or newer"
    assert machine.check_platform("darwin").verdict == checkup.NOTE
    assert machine.check_platform("linux").verdict == checkup.OK


def test_machine_facts_without_proc(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    known = memory_limits.memory_gb()
    assert 0 < known[1] <= known[0]
    monkeypatch.setattr(memory_limits, "MEMORY_FILE", tmp_path / "none")
    monkeypatch.setattr(machine, "CPU_FILE", tmp_path / "none")
    total_gb, free_gb = memory_limits.memory_gb()
    assert total_gb == free_gb == pytest.approx(known[0], rel=0.05)
    assert machine.cpu_name()


def test_little_memory_is_a_note(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    small = tmp_path / "meminfo"
    small.write_text("MemTotal:  4000000 kB\nHugePages_Total:  0\nMemAvailable:  1000000 kB\n")
    monkeypatch.setattr(memory_limits, "MEMORY_FILE", small)
    assert memory_limits.memory_gb() == pytest.approx((4.096, 1.024))
    assert machine.check_memory().verdict == checkup.NOTE


def listener(**counts: Any) -> Any:
    """What a subscriber saw, without one."""
    seen = {"packets": 3, "events": 9, "lost": 0, "ended": True, "failure": ""}
    return argparse.Namespace(**(seen | counts))


@pytest.mark.parametrize(
    ("counts", "verdict"),
    [
        ({}, checkup.OK),
        ({"packets": 2}, checkup.BAD),
        ({"events": 8}, checkup.BAD),
        ({"lost": 1}, checkup.BAD),
        ({"ended": False}, checkup.BAD),
        ({"failure": "no route"}, checkup.BAD),
    ],
)
def test_the_bus_is_well_only_if_everything_arrived(counts: dict[str, Any], verdict: str) -> None:
    report = Report(packets=3, events=9)
    assert trial._bus(report, listener(**counts)).verdict == verdict


def test_the_recorder_is_well_only_if_the_same_events_come_back(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    sent = make_events([1, 2], [3, 4], [5, 6], [0, 1])
    for recorded, verdict in ((sent, checkup.OK), (sent[:1], checkup.BAD), (sent[::-1], "bad")):
        monkeypatch.setattr(trial, "read", lambda file, events=recorded: events)
        assert trial._recorder(sent, Path("trial.aedat4")).verdict == verdict


def test_a_dark_picture_and_no_events_are_bad() -> None:
    dark = argparse.Namespace(cameras=[argparse.Namespace(is_dark=True)])
    assert trial._renderer(dark, Report()).verdict == checkup.BAD
    assert trial._sensor(Report(events=0)).verdict == checkup.BAD
