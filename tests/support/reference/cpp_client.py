"""Programs in C++ that stand in pages of ours, built as they stand there."""

from __future__ import annotations

import re
import shutil
import subprocess
from pathlib import Path

import zmq

_HEADER = """#pragma once
#include <cstddef>
// what the client takes of libzmq's interface, whose binary form is fixed
extern "C" {
void *zmq_ctx_new(void);
void *zmq_socket(void *context, int kind);
int zmq_setsockopt(void *socket, int option, const void *value, std::size_t size);
int zmq_connect(void *socket, const char *address);
int zmq_getsockopt(void *socket, int option, void *value, std::size_t *size);
int zmq_recv(void *socket, void *buffer, std::size_t size, int flags);
int zmq_send(void *socket, const void *buffer, std::size_t size, int flags);
}
#define ZMQ_SUB 2
#define ZMQ_REQ 3
#define ZMQ_SNDMORE 2
#define ZMQ_SUBSCRIBE 6
#define ZMQ_RCVMORE 13
"""
"""Where libzmq's own header is not installed: its library is here, in pyzmq."""


def program_of(page: Path) -> str:
    """The one program in a page."""
    (found,) = re.findall(r"```cpp\n(.*?)```", page.read_text(), re.DOTALL)
    return str(found)


def build(page: Path, folder: Path) -> Path:
    """The program, built without a warning against the libzmq that this process has loaded."""
    assert zmq.zmq_version_info() >= (4, 2)
    maps = Path("/proc/self/maps").read_text()
    library = re.search(r"\S*/libzmq[^\s/]*\.so[^\s/]*", maps)
    assert library is not None
    source, program = folder / "client.cpp", folder / "client"
    source.write_text(program_of(page))
    (folder / "zmq.h").write_text(_HEADER)
    home = Path(library[0]).parent
    compiler = shutil.which("c++") or "g++"
    warnings = ["-Wall", "-Wextra", "-Werror", "-std=c++17", "-O1", f"-I{folder}"]
    links = [library[0], f"-Wl,-rpath,{home}", "-Wl,--allow-shlib-undefined"]
    subprocess.run([compiler, *warnings, str(source), "-o", str(program), *links], check=True)
    return program
