"""--single, of the commands that take a recording."""

from __future__ import annotations

import argparse


def add_single(parser: argparse.ArgumentParser) -> None:
    """One file alone of a recording that goes on in several."""
    parser.add_argument(
        "--single",
        action="store_true",
        help="only this file, where the recording goes on in others (FILE-001, FILE-002, ...)",
    )
