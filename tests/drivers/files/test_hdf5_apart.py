"""HDF5 is read in a process of its own: its crash is one line, and nothing of it is left."""

from __future__ import annotations

import gc
import os
import resource
import signal
import subprocess
import sys
import time
import zlib
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from hdf5_in_process import opened_here

from evs.drivers import files
from evs.drivers.files.hdf5 import apart, contents, reader
from evs.launch.main import main
from evs.msgs import EventPacket, Events, EvsError, StreamInfo, make_events

pytestmark = pytest.mark.integration

h5py = pytest.importorskip("h5py")

CHUNK = 1 << 14
COUNT = 3 * CHUNK + 5
CHANGED = f"""
import os, signal, sys
sys.path.append({str(apart.PROGRAM.parent)!r})
import contents
"""
"""a program that reads as evs's does, but for what is appended"""


def made(path: Path) -> Events:
    """Record events; returns them."""
    stamps = np.arange(COUNT)
    events = make_events(stamps, stamps % 64, stamps % 48, stamps % 2)
    sink = files.recorder_for(path)
    sink.open([StreamInfo(64, 48)])
    sink.write(EventPacket(0, 0, COUNT, 64, 48, events))
    sink.close()
    return events


def rows(path: Path) -> Events:
    """A file as v2e writes it."""
    events = make_events(*(np.arange(COUNT) % side for side in (COUNT, 64, 48, 2)))
    with h5py.File(path, "w") as file:
        columns = np.stack([events[name] for name in "txyp"], 1)
        file.create_dataset("events", data=columns.astype("u4"), chunks=(999, 4), compression=1)
    return events


@pytest.fixture
def program(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """The program that reads, which a test may write."""
    path = tmp_path / "program.py"
    monkeypatch.setattr(apart, "PROGRAM", path)
    apart._idle.clear()
    yield path
    apart._idle.clear()


def ours() -> tuple[set[str], set[int]]:
    """Open descriptors and children of this process."""
    gc.collect()
    pid = os.getpid()
    found = Path(f"/proc/{pid}/task").glob("*/children")
    children = {int(word) for one in found for word in one.read_text().split()}
    return {one.name for one in Path("/proc/self/fd").iterdir()}, children


@pytest.mark.parametrize(("name", "make"), [("a.h5", made), ("a.hdf5", made), ("v2e.h5", rows)])
def test_it_reads_as_the_library_does_in_this_process(
    name: str, make: object, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / name
    assert callable(make)
    events = make(path)
    assert files.read(path).tobytes() == events.tobytes()
    kept = list(apart._idle)
    found = files.summary(path)
    assert apart._idle == kept
    assert len(kept) == 1
    monkeypatch.setattr(reader, "opened", opened_here)
    assert files.read(path).tobytes() == events.tobytes()
    assert files.summary(path) == found


@pytest.mark.parametrize("method", ["__init__", "pair", "rows", "close"])
def test_a_crash_is_one_line(
    method: str, program: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path, target = tmp_path / "a.h5", tmp_path / "a.csv"
    made(path)
    crash = "lambda *_: os.kill(os.getpid(), signal.SIGSEGV)"
    program.write_text(f"{CHANGED}\ncontents.Contents.{method} = {crash}\ncontents.main()")
    before = ours()
    convert = [["convert", str(path), str(target)]] if method == "rows" else []
    for words in (["info", str(path)], *convert):
        assert main(words) == 2
        told = capsys.readouterr().err
        assert told == (
            f"evs: {path}: the HDF5 library crashed on this file (signal 11); it is damaged or "
            "crafted: get a sound copy\n"
        )
    assert not target.exists()
    assert ours() == before


def test_what_is_no_answer_is_one_line(program: Path, tmp_path: Path) -> None:
    path = tmp_path / "a.h5"
    path.write_bytes(b"x")
    huge = b"\xff\xff\xff\xff"
    answers = [b"", huge, b"\2\0\0\0[]", b"\2\0\0\0{", b"\3\0\0\0nan", b"\x04\0\0\0\x80abc"]
    nested = b"[" * 100_000
    answers.append(len(nested).to_bytes(4, "little") + nested)
    for kind, count in (("O", 1), ("|O", 1), ("<i8", -1), ("<i8", 1 << 40), ("<i8", 1.5)):
        head = f'{{"value": null, "arrays": [["{kind}", {count}]]}}'.encode()
        answers.append(len(head).to_bytes(4, "little") + head)
    before = ours()
    for answer in answers:
        program.write_text(f"import sys\nsys.stdout.buffer.write({answer!r})")
        with pytest.raises(EvsError, match=r"answers nonsense about|ended \(0\)") as told:
            files.read(path)
        assert "\n" not in str(told.value)
    assert ours() == before


def test_rows_that_nobody_asked_for_are_no_events(program: Path, tmp_path: Path) -> None:
    path = tmp_path / "a.h5"
    made(path)
    more = "[contents.np.arange(9)] * 4"
    program.write_text(f"{CHANGED}\ncontents.Contents.rows = lambda *_: {more}\ncontents.main()")
    with pytest.raises(EvsError, match="has not the rows 0 to"):
        files.read(path)


def test_a_piece_that_takes_too_long_is_one_line(program: Path, tmp_path: Path) -> None:
    path = tmp_path / "a.h5"
    made(path)
    loop = "lambda *_: [None for _ in iter(int, 1)]"
    program.write_text(
        f"{CHANGED}\ncontents.MAX_CPU_S = 1\ncontents.Contents.rows = {loop}\ncontents.main()"
    )
    with pytest.raises(EvsError, match=r"took more than 60 s .* \(signal 24\)"):
        files.read(path)


def test_a_chunk_that_grows_takes_no_memory_here(program: Path, tmp_path: Path) -> None:
    """What a file states of a chunk does not bound deflate: 130 kB become 128 MiB."""
    path = tmp_path / "a.h5"
    packer, piece = zlib.compressobj(9), bytes(1 << 20)
    data = b"".join(packer.compress(piece) for _ in range(128)) + packer.flush()
    with h5py.File(path, "w") as file:
        for name in "txyp":
            one = file.create_dataset(f"events/{name}", (16,), "i8", chunks=(16,), compression=1)
            one.id.write_direct_chunk((0,), data if name == "t" else zlib.compress(bytes(128)))
    before_kib = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    program.write_text(f"{CHANGED}\ncontents.main()")
    assert len(files.read(path)) == 16
    apart._idle.clear()
    program.write_text(f"{CHANGED}\ncontents.MAX_BYTES = 1 << 26\ncontents.main()")
    with pytest.raises(EvsError, match="cannot read"):
        files.read(path)
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before_kib < 50_000


def test_one_process_reads_every_file_until_an_error(tmp_path: Path) -> None:
    path, damaged = tmp_path / "a.h5", tmp_path / "b.h5"
    events = made(path)
    damaged.write_bytes(path.read_bytes()[:900])
    files.read(path)
    before = ours()
    assert len(apart._idle) == 1
    first = apart._idle[0]._process.pid
    # a pass that nobody ends, and another beside it
    left = reader.Hdf5File.at(path).events()
    next(left)
    assert files.read(path).tobytes() == events.tobytes()
    del left
    # no file stays open, which would lock it
    with h5py.File(path, "a"):
        pass
    assert len(ours()[1]) == len(before[1])
    assert files.read(path).tobytes() == events.tobytes()
    with pytest.raises(EvsError, match="cannot read"):
        files.read(damaged)
    assert files.read(path).tobytes() == events.tobytes()
    assert apart._idle[0]._process.pid != first
    # the kernel may kill it at any time
    os.kill(apart._idle[0]._process.pid, signal.SIGKILL)
    assert files.read(path).tobytes() == events.tobytes()
    after = ours()
    assert (len(after[0]), len(after[1])) == (len(before[0]), len(before[1]))


LOOP = """
import os, sys, warnings
warnings.simplefilter("error")
folder, path = sys.argv[1:]
os.chdir(folder)
os.rmdir(folder)
from evs.drivers import files
from evs.drivers.files.hdf5 import apart
from evs.drivers.files.hdf5.reader import Hdf5File
files.read(path)
if os.fork() == 0:
    own = apart._idle == [] and len(files.read(path)) and apart._idle[0]._process.pid
    os.write(1, f"forked {own > 0}\\n".encode())
    os._exit(0)
os.wait()
kept = Hdf5File.at(path).events()
next(kept)
print("reads", apart._idle, os.getpid(), flush=True)
while True:
    files.read(path)
"""


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGKILL])
def test_it_ends_with_its_parent(number: signal.Signals, tmp_path: Path) -> None:
    path, gone = tmp_path / "a.h5", tmp_path / "gone"
    made(path)
    gone.mkdir()
    with subprocess.Popen(
        [sys.executable, "-c", LOOP, str(gone), str(path)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        start_new_session=True,
        text=True,
    ) as process:
        assert process.stdout is not None
        assert process.stderr is not None
        lines = [process.stdout.readline(), process.stdout.readline()]
        time.sleep(0.3)
        children = Path(f"/proc/{process.pid}/task/{process.pid}/children").read_text().split()
        os.killpg(process.pid, number)
        told = process.stderr.read()
    assert lines[0] == "forked True\n", told
    assert children
    if number == signal.SIGINT:
        assert told.count("Traceback") == 1, told
        assert told.endswith("KeyboardInterrupt\n"), told
    else:
        assert told == ""
    end = time.monotonic() + 10
    while any(Path(f"/proc/{one}").exists() for one in children):
        assert time.monotonic() < end
        time.sleep(0.01)


def test_the_limits_are_set(program: Path, tmp_path: Path) -> None:
    path, told = tmp_path / "a.h5", tmp_path / "told"
    made(path)
    copy = f"open({str(told)!r}, 'w').write(open('/proc/self/limits').read())"
    program.write_text(f"{CHANGED}\ncontents.Contents.rows = lambda *_: {copy}\ncontents.main()")
    with pytest.raises(EvsError, match="none of its"):
        files.read(path)
    stated = {line[:26].strip(): line[26:].split() for line in told.read_text().splitlines()}
    assert stated["Max core file size"][0] == "0"
    assert contents.MAX_CPU_S <= int(stated["Max cpu time"][0]) <= contents.MAX_CPU_S + 10
    space = int(stated["Max address space"][0])
    assert contents.MAX_BYTES < space < 2 * contents.MAX_BYTES
