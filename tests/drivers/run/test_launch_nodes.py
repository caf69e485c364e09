"""Real programs under evs launch: ends, restarts, exit codes, one Ctrl-C that stops them all."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from evs.drivers.clock import monotonic_s, sleep_s
from evs.drivers.search_path import search_path

pytestmark = pytest.mark.integration

STAYS = "import time; print('up', flush=True); time.sleep(60)"
DEAF = f"import signal; signal.signal(signal.SIGINT, signal.SIG_IGN); {STAYS}"
SHUT = f"import signal; signal.signal(signal.SIGTERM, signal.SIG_IGN); {DEAF}"


def node(name: str, program: str, *more: str) -> str:
    return "\n".join(
        ["[[node]]", f'name = "{name}"', f"run = ['python', '-c', \"{program}\"]", *more, ""]
    )


class Launched:
    """`evs launch` of a text, as a process."""

    def __init__(self, folder: Path, text: str, *given: str) -> None:
        file = folder / "launch.toml"
        file.write_text(text)
        command = [sys.executable, "-W", "error", "-m", "evs.launch.main", "launch", str(file)]
        pipe = subprocess.PIPE
        self.process = subprocess.Popen(
            [*command, *given],
            stdout=pipe,
            stderr=pipe,
            text=True,
            # under nohup, SIGHUP is ignored by every child
            preexec_fn=lambda: signal.signal(signal.SIGHUP, signal.SIG_DFL),
        )

    def wait_for(self, line: str) -> None:
        """Until a node has said this."""
        assert self.process.stdout is not None
        for said in self.process.stdout:
            if said.strip() == line:
                return
        raise AssertionError(f"it never said {line}")

    def end(self) -> tuple[int, list[str], list[str]]:
        """Exit code, lines of the nodes, lines of the launch without its prefix."""
        out, told = self.process.communicate(timeout=60)
        lines = told.splitlines()
        assert all(line.startswith("launch: ") for line in lines), told
        return self.process.returncode, out.splitlines(), [one[8:] for one in lines]


def test_the_worst_exit_code_is_told_and_the_others_go_on(tmp_path: Path) -> None:
    text = node("bad", "raise SystemExit(3)") + node("worse", "raise SystemExit(7)")
    text += node("good", "import time; time.sleep(0.5); print('done')")
    code, out, told = Launched(tmp_path, text).end()
    assert code == 7
    assert out == ["[good] done"]
    assert "bad failed with exit code 3" in told
    assert "worse failed with exit code 7" in told
    assert told[-1] == "good ended"


def test_a_node_has_its_own_folder_environment_and_time(tmp_path: Path) -> None:
    (tmp_path / "sub").mkdir()
    program = "import os; print(os.getcwd()[-3:], os.environ['A'])"
    late = node("late", program, "folder = '{here}/sub'", "env = ['A=b c']", "delay_s = 0.5")
    code, out, told = Launched(tmp_path, late + node("prompt", "print('x')")).end()
    assert (code, sorted(out)) == (0, ["[late] sub b c", "[prompt] x"])
    # whether the first one has ended by then is the machine's affair
    assert [line for line in told if "started" in line] == ["prompt started", "late started"]
    assert sorted(told) == ["late ended", "late started", "prompt ended", "prompt started"]
    text = "[[node]]\nname = 'own'\nrun = ['./own.sh']\nfolder = '{here}/sub'\n"
    script = tmp_path / "sub" / "own.sh"
    script.write_text("#!/bin/sh\necho here\n")
    script.chmod(0o755)
    code, out, _ = Launched(tmp_path, text).end()
    assert (code, out) == (0, ["[own] here"])


def test_all_well_is_nought(tmp_path: Path) -> None:
    code, out, _ = Launched(tmp_path, node("a", "print('x')") + node("b", "print('y')")).end()
    assert (code, sorted(out)) == (0, ["[a] x", "[b] y"])


def test_a_node_that_dies_is_restarted_as_often_as_its_entry_says(tmp_path: Path) -> None:
    count = tmp_path / "count"
    program = (
        f"import os, pathlib; p = pathlib.Path('{count}'); "
        "n = len(p.read_text()) if p.exists() else 0; p.write_text('x' * (n + 1)); "
        "os.kill(os.getpid(), 9) if n < 2 else print('third time')"
    )
    often = ["on_exit = 'restart'", "restarts = 2", "restart_s = 0.05"]
    code, out, told = Launched(tmp_path, node("phoenix", program, *often)).end()
    assert (code, out) == (0, ["[phoenix] third time"])
    assert told.count("phoenix was killed by SIGKILL") == 2
    assert told.count("phoenix started again") == 2
    assert "phoenix starts again in 0.05 s (2 of 2)" in told
    # once more is too often: the launch ends
    count.unlink()
    often[1] = "restarts = 1"
    text = node("phoenix", program, *often) + node("other", STAYS)
    code, out, told = Launched(tmp_path, text).end()
    assert code == 128 + signal.SIGKILL
    assert "phoenix failed after 1 restarts: stopping every node, publishers first" in told
    assert told[-1] == "other stopped"


def test_a_node_may_end_the_launch(tmp_path: Path) -> None:
    text = node("camera", "print('over')", "on_exit = 'end'") + node("viewer", STAYS)
    code, _, told = Launched(tmp_path, text).end()
    # who was asked to stop did nothing wrong
    assert code == 0
    assert told[-2:] == [
        "camera has ended: stopping every node, publishers first",
        "viewer stopped",
    ]


@pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_one_signal_stops_all_in_order(tmp_path: Path, number: int, code: int) -> None:
    text = "[bus]\nx = 'auto'\n"
    text += node("source", STAYS, "publishes = ['x']")
    # it ends by itself once its source has, as evs echo does
    text += node("sink", "import os, time; time.sleep(60)", "subscribes = ['x']", "stop_s = 20")
    launched = Launched(tmp_path, text)
    launched.wait_for("[source] up")
    launched.process.send_signal(number)
    found, _, told = launched.end()
    assert found == code
    assert told[:2] == ["sink started", "source started"]
    assert told[-2:] == ["source stopped", "sink stopped"]


def test_a_deaf_node_is_killed_after_its_time(tmp_path: Path) -> None:
    text = node("deaf", DEAF, "stop_s = 0.3") + node("shut", SHUT, "stop_s = 0.3")
    launched = Launched(tmp_path, text)
    for _ in range(2):
        assert launched.process.stdout is not None
        assert launched.process.stdout.readline().endswith("up\n")
    begin_s = monotonic_s()
    launched.process.send_signal(signal.SIGINT)
    code, _, told = launched.end()
    assert monotonic_s() - begin_s < 30
    # killing was needed for one: that is no good end
    assert code == 128 + signal.SIGKILL
    assert told[-2:] == ["shut was killed by SIGKILL", "deaf stopped"]


def test_who_insists_is_obeyed_at_once(tmp_path: Path) -> None:
    launched = Launched(tmp_path, node("shut", SHUT + "", "stop_s = 60"))
    launched.wait_for("[shut] up")
    begin_s = monotonic_s()
    launched.process.send_signal(signal.SIGINT)
    assert launched.process.stderr is not None
    told = [launched.process.stderr.readline() for _ in range(2)]
    assert told[1] == "launch: interrupted: stopping every node, publishers first\n"
    # at once it would count as the same
    sleep_s(0.5)
    launched.process.send_signal(signal.SIGINT)
    assert launched.process.wait(30) == 130
    assert monotonic_s() - begin_s < 30
    # the guard knows that nothing is left, and is silent
    assert launched.end()[2] == []


def test_one_that_cannot_start_stops_the_others_as_well_as_ever(tmp_path: Path) -> None:
    broken = tmp_path / "broken"
    broken.write_bytes(b"\x7fELF")
    broken.chmod(0o755)
    closes = "import signal, sys, time; "
    closes += "signal.signal(signal.SIGINT, lambda *_: sys.exit(print('closed'))); "
    text = node("recorder", closes + "print('up', flush=True); time.sleep(60)")
    text += f"[[node]]\nname = 'broken'\nrun = ['{broken}']\ndelay_s = 3\n"
    launched = Launched(tmp_path, text)
    out, told = launched.process.communicate(timeout=60)
    assert (launched.process.returncode, out) == (2, "[recorder] up\n[recorder] closed\n")
    assert told.splitlines() == [
        "launch: recorder started",
        "launch: a node cannot be started: stopping every node, publishers first",
        "launch: recorder stopped",
        f"evs: node 'broken': cannot run '{broken}': Exec format error",
    ]


def test_files_of_the_folder_are_not_imported_by_mistake(tmp_path: Path) -> None:
    (tmp_path / "socket.py").write_text("raise SystemExit('the wrong one')")
    (tmp_path / "launch.toml").write_text(node("good", "print('x')"))
    done = subprocess.run(
        [sys.executable, "-P", "-m", "evs.launch.main", "launch", "launch.toml"],
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": search_path()},
        capture_output=True,
        text=True,
        timeout=60,
        check=True,
    )
    assert done.stderr == "launch: good started\nlaunch: good ended\n"


def test_nothing_stays_behind(tmp_path: Path) -> None:
    """Not even what a node started itself."""
    program = (
        "import subprocess, sys, time; c = [sys.executable, '-c', 'import time; time.sleep(60)']; "
        "print('child', subprocess.Popen(c).pid, flush=True); time.sleep(60)"
    )
    launched = Launched(tmp_path, node("parent", program))
    assert launched.process.stdout is not None
    child = int(launched.process.stdout.readline().split()[-1])
    launched.process.send_signal(signal.SIGINT)
    launched.end()
    deadline_s = monotonic_s() + 10
    while Path(f"/proc/{child}").exists() and monotonic_s() < deadline_s:
        # a zombie that nobody waits for is gone, too
        if re.search(r"^State:\s+Z", Path(f"/proc/{child}/status").read_text(), re.MULTILINE):
            return
        sleep_s(0.02)
    with pytest.raises(ProcessLookupError):
        os.kill(child, 0)


def gone(pid: int) -> bool:
    """It does not run: a zombie that nobody waits for is gone, too."""
    try:
        return re.search(r"^State:\s+Z", Path(f"/proc/{pid}/status").read_text(), re.M) is not None
    except FileNotFoundError:
        return True


def test_a_launcher_that_is_killed_leaves_nothing_behind(tmp_path: Path) -> None:
    """kill -9: the nodes are stopped in their order, by their ordinary signal, and may say so."""
    log = tmp_path / "log"
    program = (
        "import os, signal, sys, time; "
        "print('up', os.getpid(), flush=True); "
        "f = open(sys.argv[1], 'a', buffering=1)\n"
        "try:\n    time.sleep(60)\n"
        "except KeyboardInterrupt:\n"
        "    time.sleep(0.2); print('x' * 200000, flush=True); f.write(sys.argv[2] + '\\n')"
    )
    script = tmp_path / "node.py"
    script.write_text(program)
    words = {
        name: f"run = ['python', '{script}', '{log}', '{name}']"
        for name in ("listener", "camera", "other")
    }
    text = "[bus]\nx = 'auto'\n"
    text += f"[[node]]\nname = 'camera'\npublishes = ['x']\n{words['camera']}\n"
    text += f"[[node]]\nname = 'listener'\nsubscribes = ['x']\n{words['listener']}\n"
    text += f"[[node]]\nname = 'other'\n{words['other']}\n" + node("shut", SHUT, "stop_s = 0.1")
    launched = Launched(tmp_path, text)
    assert launched.process.stdout is not None
    pids = []
    while len(pids) < 3:
        words_said = launched.process.stdout.readline().split()
        pids += [int(words_said[2])] if len(words_said) == 3 else []
    launched.process.kill()
    # its standard error is the guard's, too: closed when all is over
    _, error = launched.process.communicate(timeout=60)
    assert all(gone(pid) for pid in pids)
    assert log.read_text().split() == ["other", "camera", "listener"]
    assert error.splitlines()[-1] == "launch: the launcher was killed: stopping every node"


def test_who_closes_the_terminal_stops_all(tmp_path: Path) -> None:
    launched = Launched(
        tmp_path, node("one", "import os, time; print(os.getpid()); time.sleep(60)")
    )
    assert launched.process.stdout is not None
    pid = int(launched.process.stdout.readline().split()[1])
    launched.process.send_signal(signal.SIGHUP)
    launched.process.communicate(timeout=60)
    assert gone(pid)


def test_a_camera_and_its_listeners_lose_nothing(tmp_path: Path) -> None:
    """The subscribers are ready before the first packet, in whatever order the file has them."""
    scene = tmp_path / "scene.xml"
    scene.write_text(
        "<mujoco><worldbody><light pos='0 0 3'/><geom type='plane' size='5 5 .1'/>"
        "<body pos='0 0 1'><freejoint/><geom type='box' size='.2 .2 .2'/></body>"
        "</worldbody></mujoco>"
    )
    words = f"'evs', 'emulate', '--scene', '{scene}', '--publish', '{{events}}', '--duration', "
    words += "'{seconds}', 'sensor.width=32', 'sensor.height=24', '--sensor', 'ideal', '--quiet'"
    text = "[arg]\nseconds = 9.0\n[bus]\nevents = 'auto'\n"
    text += f"[[node]]\nname = 'camera'\npublishes = ['events']\nrun = [{words}]\n"
    for name in ("one", "two"):
        text += f"[[node]]\nname = '{name}'\nsubscribes = ['events']\n"
        text += "run = ['evs', 'echo', '{events}', '--quiet']\n"
    code, out, _ = Launched(tmp_path, text, "seconds:=0.2").end()
    assert code == 0
    # on a busy machine the camera may come so late that the others report that they wait
    counts = [re.sub(r"events \d+", "events", line) for line in sorted(out) if "lost" in line]
    assert counts == [
        "[one] packets 200  events  lost 0",
        "[two] packets 200  events  lost 0",
    ]


def test_a_camera_that_is_started_again_records_beside(tmp_path: Path) -> None:
    """It breaks down each time; what each run recorded is there, although it may overwrite."""
    (tmp_path / "ball.xml").write_text(
        '<mujoco><worldbody><camera name="eye" pos="0 -2 0"/><body><joint type="slide" '
        'stiffness="-9e6"/><geom size=".2"/></body></worldbody><keyframe><key name="home" '
        'qpos="0.1"/></keyframe></mujoco>'
    )
    words = ["evs", "emulate", "ball.xml", "--record", "run.aedat4", "overwrite=true", "--quiet"]
    words += ["sensor.width=16", "sensor.height=12", "render.spp=1", "--duration", "9"]
    text = f'[[node]]\nname = "eye"\nrun = {words!r}\nfolder = "{tmp_path}"\n'
    text += 'on_exit = "restart"\nrestarts = 2\nrestart_s = 0.0\n'
    code, out, _ = Launched(tmp_path, text).end()
    assert code == 2
    assert len([line for line in out if "unstable at t = " in line]) == 3
    names = sorted(file.name for file in tmp_path.glob("*.aedat4"))
    assert names == ["run-1.aedat4", "run-2.aedat4", "run.aedat4"]
    assert len({(tmp_path / name).read_bytes() for name in names}) == 1
