"""The event's layout is a promise to files and other languages."""

import numpy as np
import pytest

from evs.msgs import EVENT_DTYPE, empty_events, make_events


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
