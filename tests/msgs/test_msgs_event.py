"""The event's layout is a promise to files and other languages, and its padding is zero in them."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from evs.drivers.files import read, recorder_for
from evs.msgs import (
    EVENT_DTYPE,
    EventPacket,
    Events,
    StreamInfo,
    clean_events,
    empty_events,
    join_events,
    make_events,
)

WAYS: dict[str, Callable[[Events], Events]] = {
    "copy": lambda events: events.copy(),
    "mask": lambda events: events[events["t"] > 0],
    "slice": lambda events: events[1:-1],
    "backwards and sorted": lambda events: np.sort(events[::-1], order="t"),
    "concatenate": lambda events: np.concatenate([events, events]),
}


def dirty() -> Events:
    """Sorted events whose padding is anything but zero."""
    raw = np.full(16 * 500, 0xA5, np.uint8)
    events = raw.view(EVENT_DTYPE)
    events["t"], events["x"], events["y"] = np.arange(1, 501), 3, 4
    events["p"] = np.arange(500) % 2
    return events


def padding(data: bytes) -> bytes:
    return np.frombuffer(data, np.uint8).reshape(-1, 16)[:, 13:].tobytes()


def test_layout_is_sixteen_bytes_little_endian() -> None:
    assert EVENT_DTYPE.itemsize == 16
    fields = {name: EVENT_DTYPE.fields[name] for name in EVENT_DTYPE.names or ()}  # type: ignore[index]
    assert {name: (kind.str, offset) for name, (kind, offset, *_) in fields.items()} == {
        "t": ("<i8", 0),
        "x": ("<i2", 8),
        "y": ("<i2", 10),
        "p": ("|i1", 12),
    }


def test_bytes_of_one_event_are_as_written_down() -> None:
    event = make_events([0x0102030405060708], [0x1112], [-2], [1])
    assert event.tobytes().hex(" ") == "08 07 06 05 04 03 02 01 12 11 fe ff 01 00 00 00"


@pytest.mark.parametrize("count", [0, 1, 100_000])
def test_padding_is_zero(count: int) -> None:
    # dirty memory of the same size first, so that np.empty would show
    dirt = np.full(count * 16, 0xAB, np.uint8)
    del dirt
    for events in (empty_events(count), make_events(*np.ones((4, count), int))):
        raw = events.view(np.uint8).reshape(count, 16) if count else np.zeros((0, 16), np.uint8)
        assert len(events) == count
        assert not raw[:, 13:].any()


def test_arrays_of_different_lengths_are_refused() -> None:
    with pytest.raises(ValueError, match="broadcast"):
        make_events([1, 2, 3], [1, 2], [1, 2, 3], [1, 1, 1])


@pytest.mark.parametrize("way", WAYS)
def test_clean_events_keeps_the_fields_and_zeroes_the_padding(way: str) -> None:
    events = WAYS[way](dirty())
    clean = clean_events(events)
    assert clean.dtype == EVENT_DTYPE
    assert not any(padding(clean.tobytes()))
    assert all(np.array_equal(clean[name], events[name]) for name in "txyp")


def test_clean_events_are_not_copied() -> None:
    events = make_events([1, 2], [3, 4], [5, 6], [0, 1])
    assert clean_events(events) is events
    assert len(clean_events(empty_events())) == 0


def test_join_events_is_concatenation_with_the_same_dtype() -> None:
    joined = join_events([dirty(), empty_events(), dirty()[:7]])
    assert joined.dtype == EVENT_DTYPE
    assert len(joined) == 507
    assert joined["t"].tolist() == [*range(1, 501), *range(1, 8)]
    assert not any(padding(joined.tobytes()))
    assert len(join_events([])) == 0


def test_every_file_gets_zeros(tmp_path: Path) -> None:
    packet = EventPacket(0, 0, 1000, 346, 260, dirty())
    for name in ("a.aedat4", "a.npz"):
        recorder = recorder_for(tmp_path / name, "none")
        recorder.open([StreamInfo(346, 260)])
        recorder.write(packet)
        recorder.close()
        assert not any(padding(read(tmp_path / name).tobytes()))
    assert b"\xa5\xa5\xa5" not in (tmp_path / "a.aedat4").read_bytes()
