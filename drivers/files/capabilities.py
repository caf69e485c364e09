"""What a format can hold (sensor size, time range, streams), and the checks against it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from evs.msgs import Events, EvsError, StreamInfo

MAX_SIDE_PX = 1 << 15
"""x and y are int16"""


@dataclass(frozen=True)
class Capabilities:
    """The limits of a format; by default events of any time on a sensor of any size.

    Recorders reject everything else, and `evs convert` rejects it before it writes.
    """

    width: int = MAX_SIDE_PX
    """widest sensor, px"""
    height: int = MAX_SIDE_PX
    """highest sensor, px"""
    first_us: int = -(1 << 62)
    """lowest time stamp"""
    last_us: int = 1 << 62
    """highest time stamp"""
    from_start: bool = False
    """both count from the start of the stream (scene.start_us), as a camera's own clock does"""
    latest_us: int = 1 << 62
    """highest time stamp, wherever the stream starts"""
    silence_us: int = 1 << 62
    """the first event must come earlier than this after the start of the stream"""
    frames: bool = False
    """intensity frames"""
    regions: bool = False
    """the place on the sensor of a frame that shows a region of it"""
    imu: bool = False
    """IMU samples"""
    triggers: bool = False
    """triggers"""
    labels: bool = False
    """cause and geom of each event"""


ANYTHING = Capabilities()
"""events of any time on a sensor of any size"""


def one_stream(
    path: Path,
    streams: Sequence[StreamInfo],
    limits: Capabilities = ANYTHING,
    format_name: str = "",
) -> StreamInfo:
    """The only stream of a recorder.

    Args:
        path: The file to be written.
        streams: The streams that the recorder was opened with.
        limits: What the format can hold.
        format_name: The format's name in the message; empty: no format holds a larger sensor.

    Raises:
        EvsError: There is not exactly one stream, or its sensor is too large.
    """
    if len(streams) != 1:
        names = ", ".join(stream.camera for stream in streams) or "none"
        raise EvsError(
            f"{path} records exactly one camera, got {len(streams)} ({names}); "
            "give each camera a file of its own"
        )
    (stream,) = streams
    if 0 < stream.width <= limits.width and 0 < stream.height <= limits.height:
        return stream
    if format_name:
        fix = f"{format_name} holds at most {limits.width} x {limits.height} px, .aedat4 any size"
    else:
        fix = f"each side must be 1 ... {limits.width}"
    raise EvsError(f"cannot record {stream.width} x {stream.height} px to {path}; {fix}")


def check_stamps(
    path: Path, events: Events, limits: Capabilities, format_name: str, stream: StreamInfo
) -> None:
    """Check that the format can hold the time stamps of some events.

    Args:
        path: The file to be written.
        events: (n,) EVENT_DTYPE, sorted by t.
        limits: What the format can hold.
        format_name: The format's name in the message.
        stream: The stream of the events.

    Raises:
        EvsError: A time stamp is out of range.
    """
    if not len(events):
        return
    first, last = int(events["t"][0]), int(events["t"][-1])
    lowest, highest = _time_range(limits, stream)
    if first < lowest or last > highest:
        bad = first if first < lowest else last
        raise EvsError(
            f"cannot record an event at {bad} us to {path}; {format_name} holds {lowest} ... "
            f"{highest} us, .aedat4 any time"
        )


def can_begin_with(events: Events, limits: Capabilities, stream: StreamInfo) -> bool:
    """Whether a recording may begin with these events, (n,) with n > 0, sorted by t."""
    first, last = int(events["t"][0]), int(events["t"][-1])
    lowest, highest = _time_range(limits, stream)
    start = stream.start_us if limits.from_start else 0
    return lowest <= first and last <= highest and first - start < limits.silence_us


def _time_range(limits: Capabilities, stream: StreamInfo) -> tuple[int, int]:
    """The lowest and the highest time stamp, us, that a format can hold of a stream."""
    start = stream.start_us if limits.from_start else 0
    return limits.first_us + start, min(limits.last_us + start, limits.latest_us)
