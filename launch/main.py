"""`evs`: finds the command, runs it, and turns an EvsError into one line and exit code 2."""

from __future__ import annotations

import argparse
import importlib
import sys
from collections.abc import Sequence

from evs.msgs import EvsError

COMMANDS = {
    "emulate": "evs.launch.emulate",
    "view": "evs.launch.view",
    "echo": "evs.launch.echo",
    "play": "evs.launch.play",
    "info": "evs.launch.info",
    "doctor": "evs.launch.doctor",
}
"""Every command and the module behind it: each has HELP (one line), configure(parser), run(args) -> exit code."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command line; the exit code."""
    raise SystemExit("to be written")
