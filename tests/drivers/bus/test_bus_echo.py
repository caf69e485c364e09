"""`evs echo` as a command: what it prints, when it ends, how it fails."""

import json
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path

import pytest

from evs.drivers.bus import Publisher
from evs.drivers.clock import sleep_s
from evs.launch.commands import echo as echo_command
from evs.launch.main import main
from evs.msgs import EventPacket, StreamInfo, make_events

pytestmark = pytest.mark.integration

Echo = Callable[..., subprocess.Popen[str]]


def packet(seq: int, camera: str = "cam") -> EventPacket:
    base = 1000 * seq
    stamps = [base + 1, base + 2, base + 3, base + 4, base + 1000]
    events = make_events(stamps, [1, 2, 3, 4, 5], [9, 8, 7, 6, 5], [1, 0, 1, 1, 0])
    return EventPacket(seq, base, base + 1000, 346, 260, events, camera)


@pytest.fixture
def echo() -> Iterator[Echo]:
    """Starts `evs echo` with some arguments; killed at the end if it still runs."""
    started = []

    def start(*arguments: object, stdout: int = subprocess.PIPE) -> subprocess.Popen[str]:
        command = [sys.executable, "-W", "error", "-m", "evs.launch.main", "echo"]
        process = subprocess.Popen(
            [*command, *map(str, arguments)], stdout=stdout, stderr=subprocess.PIPE, text=True
        )
        started.append(process)
        return process

    yield start
    for process in started:
        with suppress(ProcessLookupError):
            process.kill()
        process.communicate()


@pytest.fixture
def camera(address: str) -> Iterator[Callable[..., Publisher]]:
    """Opens a publisher at the address, once an echo listens to it."""
    senders = []

    def opened(listeners: int = 1, names: tuple[str, ...] = ("cam",)) -> Publisher:
        sender = Publisher(address, wait_for=listeners, wait_s=60)
        senders.append(sender)
        sender.open([StreamInfo(346, 260, name) for name in names])
        return sender

    yield opened
    for sender in senders:
        sender.close()


def test_a_line_a_packet_and_the_totals(
    address: str, echo: Echo, camera: Callable[..., Publisher], tmp_path: Path
) -> None:
    listener = echo(address, "--json", tmp_path / "totals.json")
    sender = camera()
    for seq in range(3):
        sender.write(packet(seq))
    sender.close()
    out, errors = listener.communicate(timeout=60)
    assert out.splitlines() == [
        "cam seq 0  t 0.001000 s  n 5 (ON 3, OFF 2)  1:(1,9)+ 2:(2,8)- 3:(3,7)+ 4:(4,6)+ ...",
        "cam seq 1  t 0.002000 s  n 5 (ON 3, OFF 2)  "
        "1001:(1,9)+ 1002:(2,8)- 1003:(3,7)+ 1004:(4,6)+ ...",
        "cam seq 2  t 0.003000 s  n 5 (ON 3, OFF 2)  "
        "2001:(1,9)+ 2002:(2,8)- 2003:(3,7)+ 2004:(4,6)+ ...",
        "packets 3  events 15  lost 0",
    ]
    assert errors == f"listening to {address} (Ctrl-C ends)\n"
    assert listener.returncode == 0
    totals = json.loads((tmp_path / "totals.json").read_text())
    assert totals["status"]["packets"] == 3
    del totals["status"]
    assert totals == {
        "address": address,
        "camera": "",
        "packets": 3,
        "events": 15,
        "bytes": 240,
        "lost": 0,
        "restarts": 0,
        "bad_messages": 0,
        "ended": True,
    }


def test_an_empty_packet_has_a_line_too(
    address: str, echo: Echo, camera: Callable[..., Publisher]
) -> None:
    listener = echo(address)
    sender = camera()
    sender.write(EventPacket(0, 0, 1000, 346, 260, camera="cam"))
    sender.close()
    out, _ = listener.communicate(timeout=60)
    assert out.splitlines()[0] == "cam seq 0  t 0.001000 s  n 0 (ON 0, OFF 0)"


def test_quiet_says_the_totals_and_counts_losses(
    address: str, echo: Echo, camera: Callable[..., Publisher]
) -> None:
    listener = echo(address, "--quiet")
    sender = camera()
    for seq in (0, 1, 7):
        sender.write(packet(seq))
    sender.close()
    assert listener.communicate(timeout=60) == ("packets 3  events 15  lost 5\n", "")


def test_one_camera_of_two(address: str, echo: Echo, camera: Callable[..., Publisher]) -> None:
    listener = echo(address, "--camera", "right")
    sender = camera(names=("left", "right"))
    for seq in range(2):
        sender.write(packet(seq, "left"))
        sender.write(packet(seq, "right"))
    sender.close()
    out, _ = listener.communicate(timeout=60)
    assert [line.split()[0] for line in out.splitlines()] == ["right", "right", "packets"]


def test_rates_come_once_a_second(
    address: str, echo: Echo, camera: Callable[..., Publisher]
) -> None:
    units = {"--hz": "packets ", "--bw": " MB/s"}
    # both at once: the second that they count takes time
    listeners = {option: echo(address, option) for option in units}
    sender = camera(len(listeners))
    for seq in range(300):
        sender.write(packet(seq))
        sleep_s(0.001)
    sleep_s(1.0)
    sender.close()
    for option, listener in listeners.items():
        out, _ = listener.communicate(timeout=60)
        *rates, totals = out.splitlines()
        assert totals == "packets 300  events 1500  lost 0"
        assert 1 <= len(rates) <= 8
        assert units[option] in rates[0]
        assert all(line.endswith("lost 0") for line in rates)


def test_it_ends_after_so_many(address: str, echo: Echo, camera: Callable[..., Publisher]) -> None:
    listener = echo(address, "--count", 2)
    sender = camera()
    for seq in range(5):
        sender.write(packet(seq))
    out, _ = listener.communicate(timeout=60)
    assert len(out.splitlines()) == 3
    assert listener.returncode == 0


def test_silence_after_packets_is_an_end(
    address: str, echo: Echo, camera: Callable[..., Publisher]
) -> None:
    listener = echo(address, "--timeout", 0.4, "--quiet")
    sender = camera()
    sender.write(packet(0))
    assert listener.communicate(timeout=60) == ("packets 1  events 5  lost 0\n", "")
    assert listener.returncode == 0


@pytest.mark.parametrize("stop", [signal.SIGINT, signal.SIGTERM])
def test_interrupted_it_still_tells_the_totals(
    address: str,
    echo: Echo,
    camera: Callable[..., Publisher],
    tmp_path: Path,
    stop: signal.Signals,
) -> None:
    listener = echo(address, "--json", tmp_path / "totals.json")
    sender = camera()
    sender.write(packet(0))
    assert listener.stdout is not None
    assert listener.stdout.readline().startswith("cam seq 0")
    listener.send_signal(stop)
    out, errors = listener.communicate(timeout=60)
    assert out == "packets 1  events 5  lost 0\n"
    assert "Traceback" not in errors
    assert listener.returncode == 0
    totals = json.loads((tmp_path / "totals.json").read_text())
    assert (totals["packets"], totals["ended"]) == (1, False)


def test_a_reader_that_leaves_ends_it(
    address: str, echo: Echo, camera: Callable[..., Publisher]
) -> None:
    listener = echo(address)
    sender = camera()
    assert listener.stdout is not None
    assert listener.stderr is not None
    sender.write(packet(0))
    listener.stdout.readline()
    listener.stdout.close()
    seq = 0
    while listener.poll() is None and seq < 5000:
        seq += 1
        sender.write(packet(seq))
        sleep_s(0.002)
    assert listener.wait(60) == 0
    assert "Traceback" not in listener.stderr.read()


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["127.0.0.1:5560"], "tcp://HOST:PORT"),
        (["tcp://127.0.0.1:77777"], "ports end at 65535"),
        (["{address}", "--timeout", "0.2", "--camera", "left"], "a camera named 'left'"),
        (["{address}", "--timeout", "-1"], "timeout_s"),
        (["{address}", "--timeout", "nan"], "timeout_s"),
        (["{address}", "--count", "0"], "--count 0"),
        (["{address}", "--count", "many"], "--count"),
        (["{address}", "--json", "{folder}/none/totals.json"], "folder does not exist"),
        (["{address}", "--json", "{folder}", "--timeout", "0.2"], "cannot write '{folder}'"),
        (["{address}", "--camera", "a\nb"], "camera name"),
        (["{address}", "--hz", "--bw"], "not allowed with"),
        ([], "ADDRESS"),
    ],
)
def test_bad_use_is_one_line_and_exit_code_2(
    address: str,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    arguments: list[str],
    words: str,
) -> None:
    filled = [each.format(address=address, folder=tmp_path) for each in arguments]
    assert main(["echo", *filled]) == 2
    out, errors = capsys.readouterr()
    message = _only_line(errors)
    assert message.startswith("evs: ")
    assert words.format(address=address, folder=tmp_path) in message
    assert out in ("", "packets 0  events 0  lost 0\n")


def test_as_a_process_it_fails_with_one_line_and_exit_code_2(address: str, echo: Echo) -> None:
    listener = echo(address, "--timeout", 0.2)
    out, errors = listener.communicate(timeout=60)
    assert listener.returncode == 2
    assert _only_line(errors).startswith(f"evs: nothing came from {address} within 0.2 s")
    assert out == "packets 0  events 0  lost 0\n"


def _only_line(errors: str) -> str:
    """The one line of standard error beside that it listens."""
    (line,) = [line for line in errors.splitlines() if not line.startswith("listening to")]
    return line


def test_an_address_where_nobody_answers_is_told_once(
    address: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert echo_command._LOOK_S == 1.0
    # ten checks of the connection fit into the wait
    monkeypatch.setattr(echo_command, "_LOOK_S", 0.05)
    assert main(["echo", address, "--timeout", "0.5"]) == 2
    lines = capsys.readouterr().err.splitlines()
    assert lines[1] == f"evs: nobody answers at {address} yet; it waits until a camera is there"
    assert lines[2].startswith(f"evs: nothing came from {address} within 0.5 s")
    assert len(lines) == 3
