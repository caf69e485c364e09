"""The account of losses against a model of what the wire did to the messages."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from evs.drivers.bus import Tally
from evs.msgs import EventPacket, Status, make_events

pytestmark = pytest.mark.property


def packet(seq: int, events: int = 1) -> EventPacket:
    stamps = [1000 * seq + 1] * events
    zeros = [0] * events
    return EventPacket(
        seq, 1000 * seq, 1000 * seq + 1000, 8, 8, make_events(stamps, zeros, zeros, zeros), "a"
    )


def status(sent: int, *, end: bool = False) -> Status:
    return Status("a", sent - 1, sent, sent, 1000 * sent, end, 8, 8, "ideal", 1000, 0, ("a",))


def feed(tally: Tally, arrives: list[bool], statuses: set[int], first: int = 0) -> int:
    """One run; True arrives. Out: packets sent from the first message on that reached the tally."""
    begun: int | None = None
    for seq, there in enumerate(arrives, start=first):
        if there:
            tally.on_packet(packet(seq))
            begun = seq if begun is None else begun
        if seq in statuses:
            tally.on_status(status(seq + 1))
            begun = seq + 1 if begun is None else begun
    last = first + len(arrives)
    return last - (last if begun is None else begun)


runs = st.lists(st.booleans(), max_size=40)
places = st.sets(st.integers(0, 60))


@given(runs, places, st.integers(0, 20), st.integers(1, 3))
def test_sent_is_received_plus_lost(
    arrives: list[bool], statuses: set[int], first: int, repeats: int
) -> None:
    tally = Tally()
    sent = feed(tally, arrives, statuses, first)
    for _ in range(repeats):
        tally.on_status(status(first + len(arrives), end=True))
    assert tally.ended
    assert tally.complete
    assert tally.packets == tally.events == sum(arrives)
    assert tally.packets + tally.lost == sent
    assert tally.restarts == 0


@given(runs, places, st.integers(0, 40))
def test_an_end_heard_on_the_side_gives_the_same_account(
    arrives: list[bool], statuses: set[int], heard_at: int
) -> None:
    tally = Tally()
    end = status(len(arrives), end=True)
    before = arrives[:heard_at]
    for seq, there in enumerate(arrives):
        if seq == len(before):
            tally.on_side_status(end)
        if there:
            tally.on_packet(packet(seq))
    tally.on_side_status(end)
    assert tally.complete == bool(arrives and arrives[-1])
    learnt_from = tally.settle()
    assert learnt_from == end
    assert tally.settle() is None
    assert tally.ended
    first = arrives.index(True) if any(arrives) else len(arrives)
    assert tally.packets + tally.lost == len(arrives) - first


@given(st.lists(st.lists(st.booleans(), min_size=1, max_size=20), min_size=1, max_size=4))
def test_runs_add_up(several: list[list[bool]]) -> None:
    tally = Tally()
    sent = 0
    for arrives in several:
        # a run that begins with its first packet is told apart from the one before
        whole = [True, *arrives]
        sent += feed(tally, whole, set())
        tally.on_status(status(len(whole), end=True))
    assert tally.restarts == len(several) - 1
    assert tally.packets + tally.lost == sent


def test_a_run_cut_short_is_a_restart_not_a_loss() -> None:
    tally = Tally()
    for seq in (0, 1, 2, 5, 6):
        tally.on_packet(packet(seq))
    for seq in (2, 3):
        tally.on_packet(packet(seq))
    assert (tally.lost, tally.restarts, tally.packets) == (2, 1, 7)


def test_time_that_goes_back_is_a_restart_too() -> None:
    tally = Tally()
    tally.on_packet(packet(100))
    tally.on_packet(EventPacket(150, 0, 1000, 8, 8, camera="a"))
    assert (tally.lost, tally.restarts) == (0, 1)


def test_what_was_promised_is_lost_when_a_new_run_begins() -> None:
    tally = Tally()
    tally.on_packet(packet(0))
    tally.on_side_status(status(10, end=True))
    assert not tally.complete
    tally.on_packet(packet(0))
    assert (tally.lost, tally.restarts, tally.promised_end) == (9, 1, None)


def test_what_was_sent_before_we_came_is_not_lost() -> None:
    tally = Tally()
    tally.on_status(status(500))
    tally.on_packet(packet(500))
    tally.on_packet(packet(502))
    assert (tally.lost, tally.packets) == (1, 2)


def test_a_status_on_the_side_alone_says_nothing_of_losses() -> None:
    tally = Tally()
    tally.on_packet(packet(0))
    tally.on_side_status(status(50))
    assert (tally.lost, tally.complete, tally.promised_end) == (0, False, None)
