"""Ctrl-C and SIGTERM as a wish: once is enough, twice at once is once, who insists is obeyed."""

from __future__ import annotations

import signal

import pytest

from evs.drivers.clock import sleep_s
from evs.drivers.run.stop_signals import stop_signals


@pytest.mark.parametrize(
    ("number", "word"), [(signal.SIGINT, "interrupted"), (signal.SIGTERM, "terminated")]
)
def test_twice_at_once_is_one_wish(number: int, word: str) -> None:
    """`timeout` sends its signal to a program and to its process group."""
    before = signal.getsignal(number)
    with stop_signals() as stopped:
        signal.raise_signal(number)
        signal.raise_signal(number)
        assert stopped == [word]
    assert signal.getsignal(number) is before


def test_who_insists_a_moment_later_interrupts() -> None:
    with stop_signals() as stopped:
        signal.raise_signal(signal.SIGINT)
        # as long as a person takes to press it again
        sleep_s(0.3)
        assert stopped == ["interrupted"]
        with pytest.raises(KeyboardInterrupt):
            signal.raise_signal(signal.SIGINT)
