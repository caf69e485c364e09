"""Recordings: write them, read them, whatever their format."""

from evs.drivers.files.by_suffix import (
    SUFFIXES,
    Summary,
    opened,
    packets,
    read,
    recorder_for,
    repair,
    stream_of,
    summary,
)

__all__ = [
    "SUFFIXES",
    "Summary",
    "opened",
    "packets",
    "read",
    "recorder_for",
    "repair",
    "stream_of",
    "summary",
]
