"""Ctrl-C and SIGTERM as a wish: once is enough, twice at once is once, who insists is obeyed."""

from __future__ import annotations

import signal
from contextlib import suppress

import pytest

from evs.drivers.clock import sleep_s
from evs.drivers.run.stop_signals import ending_signals, stop_signals


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


@pytest.mark.parametrize(
    ("number", "kind", "code"),
    [(signal.SIGINT, KeyboardInterrupt, None), (signal.SIGTERM, SystemExit, 143)],
)
@pytest.mark.parametrize("inside_a_run", [True, False])
def test_a_command_of_many_runs_ends_with_the_run_that_was_stopped(
    number: int, kind: type[BaseException], code: int | None, inside_a_run: bool
) -> None:
    before = signal.getsignal(number)
    done: list[str] = []

    def command() -> None:
        with ending_signals():
            if inside_a_run:
                with stop_signals() as stopped:
                    signal.raise_signal(number)
                    # the run writes what it has
                    done.extend(stopped)
            else:
                signal.raise_signal(number)
            done.append("the next run")

    with pytest.raises(kind) as ended:
        command()
    assert done == ([("interrupted" if code is None else "terminated")] if inside_a_run else [])
    assert getattr(ended.value, "code", None) == code
    assert signal.getsignal(number) is before


def test_a_library_that_catches_the_signal_does_not_keep_the_command_alive() -> None:
    def command() -> None:
        with ending_signals(), suppress(KeyboardInterrupt):
            signal.raise_signal(signal.SIGINT)

    with pytest.raises(KeyboardInterrupt):
        command()
