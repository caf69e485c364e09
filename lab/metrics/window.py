"""Window: the pixels and the time of a comparison."""

from __future__ import annotations

import operator
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from evs.msgs import Events, EvsError, clean_events

I64 = npt.NDArray[np.int64]

MAX_SIDE_PX = 32767
"""an event's x and y are int16"""
MAX_STAMP_US = 2**60
"""36,000 years; differences of such stamps fit int64"""


@dataclass(frozen=True)
class Window:
    """width x height px and the stamps t_begin_us < t <= t_end_us.

    Half open as a tick is: tick k owns (t_{k-1}, t_k].

    Raises:
        EvsError: a value is out of range.
    """

    width: int
    """px"""
    height: int
    """px"""
    t_begin_us: int
    """us, itself not inside"""
    t_end_us: int
    """us, itself inside"""

    def __post_init__(self) -> None:
        for name in ("width", "height", "t_begin_us", "t_end_us"):
            object.__setattr__(self, name, whole_number(f"window.{name}", getattr(self, name)))
        for name in ("width", "height"):
            side = getattr(self, name)
            if not 1 <= side <= MAX_SIDE_PX:
                raise EvsError(f"window.{name} is {side}; give 1 ... {MAX_SIDE_PX} px")
        if max(abs(self.t_begin_us), abs(self.t_end_us)) > MAX_STAMP_US:
            raise EvsError(f"the window ends beyond {MAX_STAMP_US} us; give stamps in us, not ns")
        if self.t_end_us <= self.t_begin_us:
            raise EvsError(
                f"the window ({self.t_begin_us}, {self.t_end_us}] us is empty; "
                "give t_end_us > t_begin_us"
            )

    @property
    def pixels(self) -> int:
        """width * height."""
        return self.width * self.height

    @property
    def duration_s(self) -> float:
        """Length of the window, s."""
        return (self.t_end_us - self.t_begin_us) / 1e6

    def ticks(self, tick_us: int) -> int:
        """K: how many ticks of tick_us the window holds.

        Raises:
            EvsError: not a whole number.
        """
        tick_us = whole_number("tick_us", tick_us, lowest=1)
        count, rest = divmod(self.t_end_us - self.t_begin_us, tick_us)
        if rest:
            raise EvsError(
                f"the window of {self.t_end_us - self.t_begin_us} us is no multiple of the tick "
                f"({tick_us} us); move t_end_us back by {rest} us or choose another tick_us"
            )
        return count

    def cut(self, events: Events, name: str = "events") -> Events:
        """The events with stamps inside the window, in the order given.

        Args:
            events: (n,) EVENT_DTYPE, in any order
            name: what an error calls them

        Raises:
            EvsError: not events, or an event inside the window has an impossible x, y or p
        """
        check_fields(events, name)
        inside = clean_events(
            events[(events["t"] > self.t_begin_us) & (events["t"] <= self.t_end_us)]
        )
        for axis, side in (("x", self.width), ("y", self.height)):
            wrong = (inside[axis] < 0) | (inside[axis] >= side)
            if wrong.any():
                raise EvsError(
                    f"{name}: an event has {axis} = {inside[axis][wrong.argmax()]}, outside "
                    f"{self.width} x {self.height} px; give the size of the sensor they come from"
                )
        wrong = (inside["p"] != 0) & (inside["p"] != 1)
        if wrong.any():
            raise EvsError(
                f"{name}: an event has polarity {inside['p'][wrong.argmax()]}; "
                "write 1 for ON and 0 for OFF"
            )
        return inside

    def pixel_index(self, events: Events) -> I64:
        """(n,) int64: y * width + x of events that `cut` gave."""
        index: I64 = events["y"].astype(np.int64) * self.width + events["x"]
        return index


def check_fields(events: Events, name: str) -> None:
    """Raise an EvsError unless `events` is a (n,) array of events."""
    if not isinstance(events, np.ndarray) or events.dtype.names != ("t", "x", "y", "p"):
        raise EvsError(f"{name} are no events; give an array of evs.msgs.EVENT_DTYPE")
    if events.ndim != 1:
        raise EvsError(f"{name} have {events.ndim} dimensions; give a flat array (n,)")


def whole_number(name: str, value: object, lowest: int | None = None) -> int:
    """Convert a value to an int; integers of NumPy are accepted.

    Raises:
        EvsError: the value is no integer, or below `lowest`.
    """
    try:
        number = operator.index(value)  # type: ignore[arg-type]
    except TypeError:
        number = None
    if number is None or isinstance(value, bool | np.bool_):
        raise EvsError(f"{name} is {value!r}; give a whole number")
    if lowest is not None and number < lowest:
        raise EvsError(f"{name} is {number}; give {lowest} or more")
    return number
