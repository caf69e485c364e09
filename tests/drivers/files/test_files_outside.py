"""Files that would lead a reader to other files, or for ever on: refused in one line, at once."""

from __future__ import annotations

import os
import sqlite3
import struct
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
import pytest

from evs.drivers import files
from evs.msgs import EventPacket, EvsError, StreamInfo, make_events

pytestmark = pytest.mark.extremes

COUNT = 4
READ = """
import resource, sys
import evs
evs.read(sys.argv[2])
# what the tools themselves take, and 1 GiB
held = int(open("/proc/self/statm").read().split()[0]) * resource.getpagesize()
resource.setrlimit(resource.RLIMIT_AS, (held + (1 << 30), held + (1 << 30)))
try:
    print("read", len(evs.read(sys.argv[1])))
except evs.EvsError as error:
    print("refused", error)
"""


def read_apart(path: Path, sound: Path) -> str:
    """What a process says that reads a file, ten seconds and 1 GiB at most."""
    command = [sys.executable, "-c", READ, str(path), str(sound)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=10, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout.strip()


def recorded(path: Path) -> Path:
    sink = files.recorder_for(path)
    sink.open([StreamInfo(64, 48)])
    events = make_events([1, 2, 3, 4], range(4), range(4), [1] * 4)
    sink.write(EventPacket(0, 0, 1000, 64, 48, events))
    sink.close()
    return path


def columns(file: h5py.File, without: str = "") -> None:
    for name, kind in {"t": "<i8", "x": "<u2", "y": "<u2", "p": "u1"}.items():
        if name != without:
            file.create_dataset(
                f"events/{name}", data=np.arange(COUNT, dtype=kind) % (2 if name == "p" else COUNT)
            )


def external(file: h5py.File, secret: Path) -> None:
    columns(file, "t")
    file.create_dataset("events/t", (COUNT,), "<i8", external=[(str(secret), 0, 8 * COUNT)])


def external_text(file: h5py.File, secret: Path) -> None:
    columns(file)
    file.create_dataset("evs_stream", (1,), "S32", external=[(str(secret), 0, 32)])


def virtual(file: h5py.File, secret: Path) -> None:
    columns(file, "x")
    layout = h5py.VirtualLayout((COUNT,), "<u2")
    layout[:] = h5py.VirtualSource(str(secret), "x", (COUNT,))
    file.create_virtual_dataset("events/x", layout)


def linked(file: h5py.File, secret: Path) -> None:
    columns(file, "y")
    file["events/y"] = h5py.ExternalLink(str(secret), "/y")


def linked_group(file: h5py.File, secret: Path) -> None:
    file["there"] = h5py.ExternalLink(str(secret), "/events")
    file["events"] = h5py.SoftLink("/there")


def linked_round(file: h5py.File, secret: Path) -> None:
    file["events"] = h5py.SoftLink("/again")
    file["again"] = h5py.SoftLink("/events")


@pytest.mark.parametrize(
    "make", [external, external_text, virtual, linked, linked_group, linked_round]
)
@pytest.mark.parametrize("kind", ["file", "pipe"])
def test_hdf5_reads_nothing_outside(
    make: Callable[[h5py.File, Path], None], kind: str, tmp_path: Path
) -> None:
    path, secret = tmp_path / "a.h5", tmp_path / "secret"
    if kind == "pipe":
        os.mkfifo(secret)
    else:
        secret.write_bytes(struct.pack("<4q", 11, 22, 33, 44))
    with h5py.File(path, "w") as file:
        make(file, secret)
    said = read_apart(path, recorded(tmp_path / "sound.h5"))
    if make is external_text:
        # it is read without, as any file that says nothing of its stream
        assert said == "read 4"
        assert "evs_stream" not in str(files.read(path).stream)
        assert files.read(path).stream.sensor == "unknown"
        return
    assert said.startswith(f"refused {path} is not a recording: ")
    wanted = "links without end" if make is linked_round else "another file, which is not read"
    assert wanted in said


def test_hdf5_links_within_the_file_are_followed(tmp_path: Path) -> None:
    path = tmp_path / "a.h5"
    with h5py.File(path, "w") as file:
        columns(file)
        file.move("events", "prophesee")
        file["events"] = h5py.SoftLink("prophesee")
    assert len(files.read(path)) == COUNT


TOPICS = "CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT, type TEXT)"
MESSAGES = (
    "CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp INTEGER, data BLOB)"
)
KIND = "'dvs_msgs/msg/EventArray'"
ENDLESS = "WITH RECURSIVE n(k) AS (SELECT 1 UNION ALL SELECT k + 1 FROM n)"
DATABASES = {
    "endless topics": [f"CREATE VIEW topics AS {ENDLESS} SELECT k AS id, 'a' AS name, {KIND} AS "
                       "type FROM n", MESSAGES],
    "endless messages": [TOPICS, f"INSERT INTO topics VALUES (1, '/a', {KIND})",
                         f"CREATE VIEW messages AS {ENDLESS} SELECT k AS id, 2 AS topic_id, k AS "
                         "timestamp, x'00' AS data FROM n"],
    "zeroblob": [TOPICS, f"INSERT INTO topics VALUES (1, '/a', {KIND})",
                 "CREATE VIEW messages AS SELECT 1 AS id, 1 AS topic_id, 1 AS timestamp, "
                 "zeroblob(900000000) || x'00' AS data"],
    "worked out": [TOPICS, f"INSERT INTO topics VALUES (1, '/a', {KIND})",
                   "CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id, timestamp, data AS "
                   "(zeroblob(999999999)))", "INSERT INTO messages(id, topic_id, timestamp) "
                   "VALUES (1, 1, 1), (2, 1, 1), (3, 1, 1)"],
    # as many pairs as there is no time for
    "pairs": ["CREATE TABLE topics(id INTEGER, name TEXT, type TEXT)", MESSAGES,
              f"{ENDLESS} INSERT INTO topics SELECT 1, '/a' || k, 'a/msg/B' FROM n LIMIT 20000",
              f"{ENDLESS} INSERT INTO messages SELECT k, 1, k, x'00' FROM n LIMIT 20000"],
}  # fmt: skip


@pytest.mark.parametrize("name", DATABASES)
def test_a_database_is_read_in_bounded_time_and_memory(name: str, tmp_path: Path) -> None:
    path = tmp_path / "a.db3"
    with sqlite3.connect(path) as bag:
        for line in DATABASES[name]:
            bag.execute(line)
    bag.close()
    said = read_apart(path, recorded(tmp_path / "sound.db3"))
    wanted = "holds no events but" if name == "pairs" else "is no plain table in it"
    assert said.startswith(f"refused {path}"), said
    assert wanted in said


def test_a_journal_deletes_no_other_file(tmp_path: Path) -> None:
    # the name of a journal of several databases, which SQLite would read and delete
    path, other = recorded(tmp_path / "a.db3"), tmp_path / "mine.txt"
    other.write_text("nobody's journal")
    name = str(other).encode()
    head = struct.pack(">8s5I", b"\xd9\xd5\x05\xf9\x20\xa1\x63\xd7", 0, 0, 1, 512, 4096)
    end = struct.pack(">I", 1 << 30) + name
    end += struct.pack(">II8s", len(name), sum(name), head[:8])
    path.with_name("a.db3-journal").write_bytes(head.ljust(512, b"\0") + end)
    with pytest.raises(EvsError, match="its journal names another one"):
        files.read(path)
    assert other.exists()


@pytest.mark.parametrize("suffix", [".aedat", ".raw", ".aedat4", ".csv"])
def test_pipes_and_devices_are_no_recordings(suffix: str, tmp_path: Path) -> None:
    pipe, device = tmp_path / f"pipe{suffix}", tmp_path / f"zero{suffix}"
    os.mkfifo(pipe)
    device.symlink_to("/dev/zero")
    for path in (pipe, device):
        with pytest.raises(EvsError, match="is a pipe or a device"):
            files.read(path)
