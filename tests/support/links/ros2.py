"""A node of ROS 2 on other people's middleware: Fast DDS, built here from ros2_listener.cpp."""

from __future__ import annotations

import functools
import json
import shutil
import subprocess
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

SOURCE = Path(__file__).with_name("ros2_listener.cpp")
LIBRARIES = ("-lfastrtps", "-lfastcdr")
FLAGS = ("-std=c++17", "-O1", "-Wall", "-Wextra", "-Werror")

Run = Callable[..., "subprocess.Popen[Any]"]


@functools.cache
def _built() -> tuple[str, tempfile.TemporaryDirectory[str]]:
    """Build the program, in a few seconds, in a folder that is removed with this process."""
    compiler = shutil.which("c++") or "g++"
    probe = [compiler, "-E", "-x", "c++", "-include", "fastdds/dds/subscriber/DataReader.hpp"]
    if subprocess.run([*probe, "/dev/null"], capture_output=True).returncode:
        pytest.skip("Fast DDS is not installed: apt install libfastrtps-dev")
    folder = tempfile.TemporaryDirectory()
    program = f"{folder.name}/ros2_listener"
    subprocess.run([compiler, *FLAGS, str(SOURCE), "-o", program, *LIBRARIES], check=True)
    return program, folder


class Listener:
    """A program that hears every topic of one node."""

    def __init__(self, run: Run, domain_id: int, path: str, *, reliable: bool = False) -> None:
        """Start the program and wait until it is ready.

        Args:
            run: Starts a program: subprocess.Popen, or the `run` of a Side.
            domain_id: The DDS domain.
            path: What the names of the node's topics begin with, for example "/cam".
            reliable: Whether to demand reliable delivery of the topics that may be sent either way.
        """
        program, folder = _built()
        words = [program, str(domain_id), str(int(reliable)), path]
        # it hears more than a pipe can hold
        with tempfile.NamedTemporaryFile("w", dir=folder.name, delete=False) as out:
            self.program = run(words, stdin=-1, stdout=out, stderr=subprocess.PIPE, text=True)
        self._out = Path(out.name)
        assert self.program.stderr is not None
        assert self.program.stderr.readline() == "ready\n"

    def heard(self) -> dict[str, list[dict[str, Any]]]:
        """End the program and return topic -> messages, including those that were on their way."""
        _, errors = self.program.communicate(timeout=120)
        assert (self.program.returncode, errors) == (0, ""), (self.program.returncode, errors)
        found: dict[str, list[dict[str, Any]]] = {}
        with self._out.open() as lines:
            for line in lines:
                message = json.loads(line)
                found.setdefault(message.pop("topic"), []).append(message)
        self._out.unlink()
        return found
