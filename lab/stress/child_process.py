"""Run `evs emulate` in a process with limited resources, and collect its output and files."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from evs.drivers.files import read
from evs.drivers.search_path import search_path
from evs.msgs import Events, EvsError, empty_events

TIMEOUT_S = 120.0

_CODE = """
import resource, sys
from evs.emulator.base.memory_limits import address_space
from evs.launch.main import main
import evs.launch.commands.emulate
memory, file = int(sys.argv[1]), int(sys.argv[2])
if file:
    resource.setrlimit(resource.RLIMIT_FSIZE, (file, file))
if not memory:
    sys.exit(main(sys.argv[3:]))
with address_space(memory):
    sys.exit(main(sys.argv[3:]))
"""


@dataclass(frozen=True)
class ProcessResult:
    """What a run in a process of its own left behind."""

    code: int
    """exit code"""
    errors: tuple[str, ...]
    """lines on stderr that are no warnings"""
    warnings: tuple[str, ...]
    report: dict[str, Any]
    """its run report; empty where it wrote none"""
    recorded: Events
    """events of its recording; empty where there is none"""


def emulate(
    folder: Path,
    mjcf: str,
    arguments: Sequence[str] = (),
    *,
    memory_bytes: int = 0,
    file_bytes: int = 0,
    environment: Mapping[str, str] | None = None,
) -> ProcessResult:
    """Run `evs emulate` on this scene; recording and report go into `folder`.

    Args:
        folder: target folder.
        mjcf: text of the scene.
        arguments: further arguments.
        memory_bytes: memory that it may take beyond its program; 0: no limit.
        file_bytes: largest size of a file, as on a full disk; 0: no limit.
        environment: variables in addition to those of this process.

    Raises:
        EvsError: it does not end in time, or its recording cannot be read.
    """
    scene, recording, report = (folder / name for name in ("s.xml", "run.aedat4", "report.json"))
    scene.write_text(mjcf, encoding="utf-8")
    command = [sys.executable, "-P", "-c", _CODE, str(memory_bytes), str(file_bytes), "emulate"]
    command += ["--scene", str(scene), "--record", str(recording), "--report", str(report)]
    try:
        ended = subprocess.run(
            [*command, "--quiet", *arguments],
            stdin=subprocess.DEVNULL,
            capture_output=True,
            text=True,
            timeout=TIMEOUT_S,
            env={**os.environ, "PYTHONPATH": search_path(), **(environment or {})},
            check=False,
        )
    except subprocess.TimeoutExpired:
        raise EvsError(f"a run did not end in {TIMEOUT_S:g} s: try again when less runs") from None
    lines = ended.stderr.splitlines()
    warned = tuple(line for line in lines if line.startswith("evs: warning: "))
    return ProcessResult(
        ended.returncode,
        tuple(line for line in lines if line not in warned),
        warned,
        json.loads(report.read_text()) if report.is_file() else {},
        read(recording) if recording.is_file() else empty_events(),
    )
