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
from evs.drivers.files.calibration import calibration_yaml

__all__ = [
    "SUFFIXES",
    "Summary",
    "calibration_yaml",
    "opened",
    "packets",
    "read",
    "recorder_for",
    "repair",
    "stream_of",
    "summary",
]
