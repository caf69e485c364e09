"""The client in msgs/README.md, in C++: as it stands there it is built, and counts right."""

from __future__ import annotations

import re
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
import zmq

from evs.drivers.bus import Publisher
from evs.drivers.checkup.loopback import free_address
from evs.msgs import EventPacket, StreamInfo, make_events

LINES = 40
HEADER = """#pragma once
#include <cstddef>
// what the client takes of libzmq's interface, whose binary form is fixed
extern "C" {
void *zmq_ctx_new(void);
void *zmq_socket(void *context, int kind);
int zmq_setsockopt(void *socket, int option, const void *value, std::size_t size);
int zmq_connect(void *socket, const char *address);
int zmq_getsockopt(void *socket, int option, void *value, std::size_t *size);
int zmq_recv(void *socket, void *buffer, std::size_t size, int flags);
}
#define ZMQ_SUB 2
#define ZMQ_SUBSCRIBE 6
#define ZMQ_RCVMORE 13
"""
"""Where libzmq's own header is not installed: its library is here, in pyzmq."""


def program_of(page: str) -> str:
    (found,) = re.findall(r"```cpp\n(.*?)```", page, re.DOTALL)
    return str(found)


@pytest.fixture
def client(checkout_root: Path, tmp_path: Path) -> Path:
    """The program, built without a warning against the libzmq that this process has loaded."""
    assert zmq.zmq_version_info() >= (4, 2)
    maps = Path("/proc/self/maps").read_text()
    library = re.search(r"\S*/libzmq[^\s/]*\.so[^\s/]*", maps)
    assert library is not None
    source, program = tmp_path / "client.cpp", tmp_path / "client"
    source.write_text(program_of((checkout_root / "msgs" / "README.md").read_text()))
    (tmp_path / "zmq.h").write_text(HEADER)
    folder = Path(library[0]).parent
    compiler = shutil.which("c++") or "g++"
    warnings = ["-Wall", "-Wextra", "-Werror", "-std=c++17", "-O1", f"-I{tmp_path}"]
    links = [library[0], f"-Wl,-rpath,{folder}", "-Wl,--allow-shlib-undefined"]
    subprocess.run([compiler, *warnings, str(source), "-o", str(program), *links], check=True)
    return program


@pytest.fixture
def checkout_root() -> Path:
    return Path(__file__).parents[2]


def test_the_page_holds_a_short_program(checkout_root: Path) -> None:
    program = program_of((checkout_root / "msgs" / "README.md").read_text())
    assert len([line for line in program.splitlines() if line]) <= LINES


def test_a_client_in_another_language_counts_every_event(client: Path) -> None:
    random = np.random.default_rng(0)
    events = on = 0
    address = free_address()
    sender = Publisher(address, wait_for=1, wait_s=60)
    with subprocess.Popen([client, address], stdout=subprocess.PIPE, text=True) as process:
        sender.open([StreamInfo(346, 260, "cam")])
        # seq as msgpack's one, two, three and five bytes, and packets that a full queue dropped
        seqs = [0, 1, 126, 127, 128, 255, 256, 65_535, 65_536, 70_000]
        for seq in seqs:
            size = int(random.integers(0, 5000))
            t = np.sort(random.integers(1000 * seq + 1, 1000 * seq + 1001, size))
            p = random.integers(0, 2, size)
            body = make_events(t, t % 346, t % 260, p)
            sender.write(EventPacket(seq, 1000 * seq, 1000 * seq + 1000, 346, 260, body, "cam"))
            events, on = events + size, on + int(p.sum())
        sender.close()
        out, _ = process.communicate(timeout=60)
    assert process.returncode == 0
    lost = seqs[-1] + 1 - len(seqs)
    assert out == f"events {events}, ON {on}, lost {lost}\n"
