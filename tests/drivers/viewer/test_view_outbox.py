"""The queue between a camera and a slow destination."""

from __future__ import annotations

import threading

import pytest

from evs.drivers.viewer import outbox
from evs.drivers.viewer.outbox import Letter, Outbox
from evs.msgs import EvsError


class Slow:
    """A destination that begins to accept when it is told to."""

    def __init__(self) -> None:
        self.go, self.begun = threading.Event(), threading.Event()
        self.came: list[int] = []

    def letter(self, number: int, size: int = 1) -> Letter:
        def send() -> None:
            self.begun.set()
            assert self.go.wait(20)
            self.came.append(number)

        return Letter(send, size, events=10)


def test_a_full_queue_drops_the_oldest_and_counts_them() -> None:
    slow, box = Slow(), Outbox(3, lossless=False)
    box.put(slow.letter(0))
    assert slow.begun.wait(20)
    for number in range(1, 10):
        box.put(slow.letter(number))
    slow.go.set()
    box.close(20)
    # the first was on its way already
    assert slow.came == [0, 7, 8, 9]
    counts = box.counts
    assert (counts.sent, counts.dropped, counts.events_dropped, counts.bytes) == (4, 6, 60, 4)


def test_large_messages_fill_it_too(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(outbox, "MAX_QUEUE_BYTES", 100)
    slow, box = Slow(), Outbox(1000, lossless=False)
    box.put(slow.letter(0))
    assert slow.begun.wait(20)
    for number in range(1, 5):
        box.put(slow.letter(number, 40))
    # a single one may be larger than all that may wait
    box.put(slow.letter(5, 400))
    slow.go.set()
    box.close(20)
    assert slow.came == [0, 5]
    assert box.counts.dropped == 4


def test_a_lossless_queue_waits() -> None:
    slow, box = Slow(), Outbox(2, lossless=True)

    def fill() -> None:
        for number in range(20):
            box.put(slow.letter(number))

    filling = threading.Thread(target=fill)
    filling.start()
    filling.join(0.2)
    assert filling.is_alive()
    slow.go.set()
    filling.join(20)
    box.close(None)
    assert slow.came == list(range(20))
    assert box.counts.dropped == 0


def test_what_is_left_after_the_linger_is_dropped() -> None:
    slow, box = Slow(), Outbox(10, lossless=False)
    for number in range(4):
        box.put(slow.letter(number))
    assert slow.begun.wait(20)
    box.close(0.1)
    slow.go.set()
    assert (box.counts.dropped, box.counts.events_dropped) == (3, 30)


@pytest.mark.parametrize("lossless", [False, True])
def test_an_error_of_sending_reaches_the_camera(lossless: bool) -> None:
    box = Outbox(1, lossless=lossless)

    def send() -> None:
        raise ValueError("no such thing")

    box.put(Letter(send, 1))
    with pytest.raises(EvsError, match="sending failed: no such thing"):
        box.close(None)
    with pytest.raises(EvsError, match="sending failed: no such thing"):
        box.put(Letter(send, 1))
