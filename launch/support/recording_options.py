"""Options of the commands that read a recording: --single."""

from __future__ import annotations

import argparse


def add_single_option(parser: argparse.ArgumentParser) -> None:
    """Add --single: read one file of a recording that continues in several."""
    parser.add_argument(
        "--single",
        action="store_true",
        help="read this file only, even if the recording continues in FILE-001, FILE-002, ...",
    )
