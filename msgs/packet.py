"""EventPacket: the events of one tick (or more) of one camera. The only door to msgpack.

On the wire: `topic | msgpack header | raw frame`, see docs/reference/wire.md. The header's
field names follow ROS's event_camera_msgs/EventPacket, which is another thing (msgs/codecs); the
raw frame is the events' own bytes.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import msgpack
import numpy as np

from evs.msgs.event import EVENT_DTYPE, Events, Labels, clean_events, empty_events
from evs.msgs.header_fields import MAX_INT64, MAX_PIXELS, MessageError, integer, name, shown

ENCODING = "evs16"
"""Name of the raw frame's encoding: an array of EVENT_DTYPE, little-endian."""

MAX_HEADER_BYTES = 64 * 1024
"""A larger header is refused before it is parsed."""

MAX_FRAME_BYTES = 64 * 1024 * 1024
"""A larger raw frame (4 million events) does not travel on the bus."""


QuickCheck = Callable[[bytes | memoryview, int, int, int, int], bool]
"""(raw frame, time_base, time_end, width, height) -> whether `check_events` would pass."""


@dataclass(frozen=True)
class EventPacket:
    """Events of the interval (time_base_us, time_end_us] of one camera.

    A packet may be empty; it still shows that time has passed.
    """

    seq: int
    """Counts this camera's packets from 0, without gaps."""
    time_base_us: int
    """Simulated time at which the interval begins, us; events lie after it."""
    time_end_us: int
    """Simulated time at which the interval ends, us; events lie at or before it."""
    width: int
    """Sensor width, px."""
    height: int
    """Sensor height, px."""
    events: Events = field(default_factory=empty_events)
    """(n,) EVENT_DTYPE, sorted by t."""
    camera: str = "camera"
    """Name of the camera that saw them."""
    labels: Labels | None = None
    """(n,) cause and geom of each event; None: not requested. Labels are not sent on the bus."""

    def __len__(self) -> int:
        return len(self.events)

    def __repr__(self) -> str:
        when = f"{self.time_base_us} ... {self.time_end_us} us"
        size = f"{self.width} x {self.height}"
        return f"<EventPacket {self.seq} of '{self.camera}', {size}: {len(self)} events, {when}>"

    def _repr_html_(self) -> str:
        from evs.msgs.pictures import event_facts, event_frame, html_card

        interval = f"{self.time_base_us:,} to {self.time_end_us:,} us"
        facts = {"size": f"{self.width} x {self.height} px", "interval": interval}
        picture = event_frame(self.events, self.width, self.height)
        return html_card(
            f"EventPacket {self.seq} of {self.camera}", facts | event_facts(self.events), picture
        )


def encode(packet: EventPacket, quick: QuickCheck | None = None) -> tuple[bytes, memoryview]:
    """Encode a packet.

    Args:
        packet: The packet.
        quick: A fast check of the events; without it, or where it fails, `check_events` decides.

    Returns:
        The msgpack header, and the raw frame of 16 n bytes, which is only copied where
        `clean_events` copies.

    Raises:
        MessageError: `decode` would refuse the packet.
    """
    if not _is_event_array(packet.events):
        raise MessageError("packet events are not an (n,) array of EVENT_DTYPE: use make_events")
    header: dict[str, Any] = {
        "seq": packet.seq,
        "time_base": packet.time_base_us,
        "time_end": packet.time_end_us,
        "encoding": ENCODING,
        "is_bigendian": False,
        "width": packet.width,
        "height": packet.height,
        "camera": packet.camera,
    }
    try:
        _checked(header)
    except MessageError:
        # numpy's own integers are welcome
        header = _checked(plain_integers(header))
    events = np.ascontiguousarray(packet.events, EVENT_DTYPE)
    raw = events.view(np.uint8).data
    if quick is None or not _fits(quick, raw, header):
        try:
            check_events(events, header)
        except MessageError:
            # whatever numpy's copies and masks left in the padding stays here
            events = clean_events(events)
            check_events(events, header)
            raw = events.view(np.uint8).data
    return packb(header), raw


def decode(header: bytes, frame: Any, quick: QuickCheck | None = None) -> EventPacket:
    """Decode a packet.

    Args:
        header: The msgpack header.
        frame: Any contiguous buffer with the raw frame, whose memory the events share.
        quick: As for `encode`.

    Returns:
        The packet. Its events are sorted by t, and their x and y lie on the sensor.

    Raises:
        MessageError: The bytes do not fit the format.
    """
    fields = _checked(unpackb(header))
    size = memoryview(frame).nbytes
    if size % EVENT_DTYPE.itemsize:
        raise MessageError(f"raw frame of {size} bytes is not whole events")
    events = np.frombuffer(frame, EVENT_DTYPE)
    if quick is None or not _fits(quick, frame, fields):
        check_events(events, fields)
    return EventPacket(
        seq=fields["seq"],
        time_base_us=fields["time_base"],
        time_end_us=fields["time_end"],
        width=fields["width"],
        height=fields["height"],
        events=events,
        camera=fields["camera"],
    )


def _fits(quick: QuickCheck, raw: Any, header: dict[str, Any]) -> bool:
    """Whether the quick check passes the events of a valid header."""
    return quick(raw, header["time_base"], header["time_end"], header["width"], header["height"])


def _is_event_array(events: object) -> bool:
    """(n,) with EVENT_DTYPE's four fields, padded or not (np.concatenate drops the padding)."""
    if not isinstance(events, np.ndarray) or events.ndim != 1:
        return False
    if events.dtype is EVENT_DTYPE:
        return True
    if events.dtype.names is None:
        return False
    return [(name, events.dtype[name]) for name in events.dtype.names] == _FIELDS


def check_events(events: Events, header: dict[str, Any]) -> None:
    """MessageError unless the events are sorted by t and lie in the interval and on the sensor.

    Polarity has to be 0 or 1, the padding zero. A few vector operations: 10 us for 300 events.
    """
    if len(events) == 0:
        return
    # read as unsigned, a negative coordinate is too large as well; p and the padding are one word
    words = events.view(_UNSIGNED)
    t, base, end = words["t"], header["time_base"], header["time_end"]
    if t[0] <= base or t[-1] > end:
        raise MessageError(
            f"events of {t[0]} ... {t[-1]} us lie outside the packet's ({base}, {end}] us"
        )
    width, height = header["width"], header["height"]
    # in blocks that stay in the cache until the last look, without large arrays that come and go
    for begin in range(0, len(t), _BLOCK):
        stamps = t[begin : begin + _BLOCK + 1]
        if _count(stamps[1:] < stamps[:-1]):
            raise MessageError("events are not sorted by t")
        block = words[begin : begin + _BLOCK]
        # the largest of all is found twice as fast as whether any is too large
        if _highest(block["x"]) >= width or int(_highest(block["yx"])) >> 16 >= height:
            raise MessageError(f"events lie outside the {width}x{height} sensor")
        if _highest(block["p"]) > 1:
            raise MessageError("an event's polarity is not 0 or 1, or its padding is not zero")


_FIELDS = [(name, EVENT_DTYPE[name]) for name in EVENT_DTYPE.names or ()]
_UNSIGNED = np.dtype(
    {
        "names": ["t", "x", "yx", "p"],
        "formats": ["<i8", "<u2", "<u4", "<u4"],
        "offsets": [0, 8, 8, 12],
        "itemsize": 16,
    }
)
"""y is the upper half of yx: the largest yx has the largest y"""

# what an array's own max() calls, without its way there; and a fifth of what any() takes
_highest = np.maximum.reduce
_count = np.count_nonzero

_BLOCK = 32_768
"""events: half a MB"""


def plain_integers(header: dict[str, Any]) -> dict[str, Any]:
    """The header with Python's integers: numpy's own are welcome, but msgpack knows none."""
    return {k: v.item() if isinstance(v, np.generic) else v for k, v in header.items()}


def packb(fields: dict[str, Any], most: int = MAX_HEADER_BYTES) -> bytes:
    """msgpack bytes of a map of plain values; MessageError if they are not or are too many."""
    try:
        packed: bytes = msgpack.packb(fields, use_bin_type=True)
    except (TypeError, ValueError, OverflowError) as reason:
        raise MessageError(f"header cannot be packed: {shown(str(reason))}") from None
    if len(packed) > most:
        raise MessageError(f"header of {len(packed)} bytes is over {most}")
    return packed


_LIMITS = {"max_array_len": 1000, "max_map_len": 1000}
"""A few bytes may claim a list of millions, and lists in it, for which memory is taken at once."""


def unpackb(header: bytes, most: int = MAX_HEADER_BYTES) -> dict[str, Any]:
    """The map in a msgpack header; MessageError if it is too large, torn or not a map of names."""
    if len(header) > most:
        raise MessageError(f"header of {len(header)} bytes is over {most}")
    try:
        fields = msgpack.unpackb(header, raw=False, strict_map_key=True, **_LIMITS)
    except (
        ValueError,
        OverflowError,
        RecursionError,
        msgpack.exceptions.UnpackException,
    ) as reason:
        raise MessageError(f"header is not msgpack: {shown(str(reason))}") from None
    if not isinstance(fields, dict):
        raise MessageError(f"header is a {type(fields).__name__}, not a map")
    return fields


def _checked(fields: dict[str, Any]) -> dict[str, Any]:
    """The fields of a packet header, every value of the right type and in its range."""
    if fields.get("encoding") != ENCODING:
        raise MessageError(f"packet encoding {shown(fields.get('encoding'))} is not {ENCODING!r}")
    if fields.get("is_bigendian") is not False:
        raise MessageError("packet is not marked little-endian (is_bigendian: false)")
    integer(fields, "seq", 0, MAX_INT64)
    base = integer(fields, "time_base", -MAX_INT64, MAX_INT64)
    end = integer(fields, "time_end", -MAX_INT64, MAX_INT64)
    if end < base:
        raise MessageError(f"packet ends at {end} us, before it begins at {base} us")
    integer(fields, "width", 1, MAX_PIXELS)
    integer(fields, "height", 1, MAX_PIXELS)
    name(fields, "camera")
    return fields
