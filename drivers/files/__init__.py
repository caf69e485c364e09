"""Recordings: write them, read them, whatever their format."""

from evs.drivers.files.by_suffix import (
    SUFFIXES,
    LeftOutFramesWarning,
    Summary,
    messages,
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
    "LeftOutFramesWarning",
    "Summary",
    "calibration_yaml",
    "messages",
    "opened",
    "packets",
    "read",
    "recorder_for",
    "repair",
    "stream_of",
    "summary",
]
