"""How much memory this process may have: the machine's, a container's, a shell's."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from evs.drivers.search_path import search_path
from evs.emulator.base import memory_limits
from evs.emulator.base.memory_limits import address_space
from evs.emulator.evsnet.state import check_growth
from evs.launch import main
from evs.msgs import EvsError


@pytest.fixture
def machine(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A machine of 100 GB of which 80 are free, in no group yet."""
    (tmp_path / "meminfo").write_text("MemTotal: 97656250 kB\nMemAvailable: 78125000 kB\n")
    (tmp_path / "groups").write_text("")
    monkeypatch.setattr(memory_limits, "MEMORY_FILE", tmp_path / "meminfo")
    monkeypatch.setattr(memory_limits, "GROUP_FILE", tmp_path / "groups")
    monkeypatch.setattr(memory_limits, "GROUPS", tmp_path / "cgroup")
    return tmp_path


def group(folder: Path, names: tuple[str, str, str], most: str, used: int, cached: int) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    limit, use, stat = names
    (folder / limit).write_text(most + "\n")
    (folder / use).write_text(f"{used}\n")
    (folder / "memory.stat").write_text(f"anon 1\n{stat} {cached}\n")


V2 = ("memory.max", "memory.current", "inactive_file")
V1 = ("memory.limit_in_bytes", "memory.usage_in_bytes", "total_inactive_file")


def test_without_limits_it_is_the_machines(machine: Path) -> None:
    assert memory_limits.memory_gb() == pytest.approx((100, 80))


def test_a_container_counts_with_what_its_kernel_gives_back(machine: Path) -> None:
    (machine / "groups").write_text("0::/docker/one\n")
    group(machine / "cgroup" / "docker" / "one", V2, "8000000000", 5 * 10**9, 2 * 10**9)
    assert memory_limits.memory_gb() == pytest.approx((8, 5))


def test_a_group_above_counts_too(machine: Path) -> None:
    (machine / "groups").write_text("0::/user/one\n")
    group(machine / "cgroup" / "user" / "one", V2, "max", 10**9, 0)
    group(machine / "cgroup" / "user", V2, "16000000000", 15 * 10**9, 0)
    assert memory_limits.memory_gb() == pytest.approx((16, 1))


def test_a_container_that_sees_its_own_group_as_the_root(machine: Path) -> None:
    (machine / "groups").write_text("0::/\n")
    group(machine / "cgroup", V2, "4000000000", 10**9, 0)
    assert memory_limits.memory_gb() == pytest.approx((4, 3))


def test_groups_of_version_1(machine: Path) -> None:
    (machine / "groups").write_text("5:cpu:/\n4:memory:/docker/one\n0::/\n")
    group(machine / "cgroup" / "memory" / "docker" / "one", V1, "6000000000", 7 * 10**9, 0)
    group(machine / "cgroup" / "cpu", V1, "1", 0, 0)
    assert memory_limits.memory_gb() == pytest.approx((6, 0))


def test_a_limit_on_address_space() -> None:
    before = memory_limits.memory_gb()
    with address_space(10**9):
        total_gb, free_gb = memory_limits.memory_gb()
        # what Python itself took for looking
        assert 0.9 < free_gb <= 1.0
        assert total_gb > free_gb
        with pytest.raises(MemoryError):
            bytearray(2 * 10**9)
    assert memory_limits.memory_gb()[0] == before[0]
    said = subprocess.run(
        ["sh", "-c", f"ulimit -v 4000000; exec {sys.executable} -c "
         "'from evs.emulator.base.memory_limits import memory_gb; print(memory_gb()[0])'"],
        capture_output=True, text=True, check=True,
        env={"PYTHONPATH": search_path()},
    ).stdout  # fmt: skip
    assert float(said) == pytest.approx(4.096)


def test_a_network_that_would_outgrow_it_is_told_so() -> None:
    check_growth(1000, 0, 4, 4)
    said = r"active pixels .* needs 5 GB, but only [01].* GB are free"
    with address_space(10**9), pytest.raises(EvsError, match=said):
        check_growth(5 * 10**9, 7000, 640, 480)


@pytest.mark.parametrize("left", [0, 1_000_000, main.LEAST_BYTES - 1])
def test_too_little_to_load_anything_is_one_line(
    left: int, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(main, "address_space_left", lambda: left)
    assert main.main(["sensors"]) == 2
    said = capsys.readouterr()
    assert said.out == ""
    (line,) = said.err.splitlines()
    assert line.startswith(f"evs: {left / 1e6:.0f} MB of memory are left to this process")


@pytest.mark.parametrize("left", [None, main.LEAST_BYTES])
def test_enough_to_load_says_nothing(
    left: int | None, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(main, "address_space_left", lambda: left)
    assert main.main(["sensors"]) == 0
    assert capsys.readouterr().err == ""


def test_threads_that_the_system_refuses_are_a_lack_of_memory() -> None:
    program = (
        "from evs.emulator.base.memory_limits import address_space\n"
        "from evs.emulator.sensor import PlainModel, SensorParameters\n"
        "model = PlainModel(SensorParameters('test', 4, 4, 0.2, 0.2), threads=64)\n"
        "model.pattern(0)\n"
        "with address_space(30_000_000):\n"
        "    try:\n"
        "        model.init(0)\n"
        "    except MemoryError:\n"
        "        print('refused')\n"
    )
    ended = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert (ended.stdout, ended.stderr) == ("refused\n", "")
