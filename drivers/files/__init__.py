"""Write and read recordings in every format."""

from evs.drivers.files.calibration import calibration_yaml
from evs.drivers.files.capabilities import Capabilities
from evs.drivers.files.convert import Converted, convert
from evs.drivers.files.formats import FORMATS, RECORDED, SUFFIXES, Format, endings, to_write
from evs.drivers.files.integrity import Repair
from evs.drivers.files.reading import (
    LeftOutWarning,
    messages,
    opened,
    origin_us,
    packets,
    parts,
    read,
    recorder_for,
    repair,
    stream_of,
)
from evs.drivers.files.slices import EventSlices
from evs.drivers.files.summary import Summary, summary

__all__ = [
    "FORMATS",
    "RECORDED",
    "SUFFIXES",
    "Capabilities",
    "Converted",
    "EventSlices",
    "Format",
    "LeftOutWarning",
    "Repair",
    "Summary",
    "calibration_yaml",
    "convert",
    "endings",
    "messages",
    "opened",
    "origin_us",
    "packets",
    "parts",
    "read",
    "recorder_for",
    "repair",
    "stream_of",
    "summary",
    "to_write",
]
