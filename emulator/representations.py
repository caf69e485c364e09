"""Events as dense arrays, for learners: voxel grid, time surface, event frame, padded packet.

In every array row y and column x are the pixel's, and a polarity's index is its p: 0 OFF, 1 ON.
All are functions of their arguments alone, without a loop over events.
"""

from __future__ import annotations

import operator

import numpy as np
import numpy.typing as npt

from evs.emulator import _core
from evs.msgs import Events, EvsError

F32 = npt.NDArray[np.float32]
I32 = npt.NDArray[np.int32]
I64 = npt.NDArray[np.int64]

NEVER = int(np.iinfo(np.int64).min)
"""In `latest_stamps`: no event yet."""


def voxel_grid(
    events: Events, bins: int, size: tuple[int, int], interval: tuple[int, int] | None = None
) -> F32:
    """V(x, y, t) of Zhu et al., CVPR 2019, equation (2): polarities spread over two bins each.

    An event of polarity +1 or -1 at t* = (bins - 1) (t - t_1) / (t_N - t_1) adds to the bins around
    t* with the weights of a triangle of half width 1.

    Args:
        events: (n,) EVENT_DTYPE
        bins: number of bins
        size: (width, height) of the sensor, px
        interval: (t_1, t_N), us: events before or after it count at its edges; None: from the
            first event to the last, as in the paper

    Returns:
        (bins, height, width) float32

    Raises:
        EvsError: an event outside the sensor, a size or number of bins below 1, or an empty
            interval
    """
    width, height = _checked_size(size)
    bins = _positive(bins, "bins")
    pixel = _pixel_index(events, width, height)
    if len(events) == 0:
        return np.zeros((bins, height, width), np.float32)
    stamps = events["t"]
    if interval is None:
        begin_us, span_us = int(stamps.min()), int(stamps.max()) - int(stamps.min())
    else:
        begin_us, span_us = interval[0], interval[1] - interval[0]
        if span_us <= 0:
            raise EvsError(f"voxel_grid: interval {interval} is empty: give (begin_us, end_us)")
    # integers are subtracted before anything becomes a float: exact at any time of day
    share = (stamps - begin_us) / max(span_us, 1)
    place = np.clip(share, 0.0, 1.0) * (bins - 1)
    lower = np.minimum(place.astype(np.int64), max(bins - 2, 0))
    upper = np.minimum(lower + 1, bins - 1)
    sign = np.where(events["p"] != 0, 1.0, -1.0)
    above = place - lower
    pixels = width * height
    index = np.concatenate([lower * pixels + pixel, upper * pixels + pixel])
    weight = np.concatenate([sign * (1.0 - above), sign * above])
    grid = np.bincount(index, weight, bins * pixels)
    return grid.reshape(bins, height, width).astype(np.float32)


def latest_stamps(events: Events, size: tuple[int, int], before: I64 | None = None) -> I64:
    """When each pixel last fired, by polarity: what a time surface remembers.

    Args:
        events: (n,) EVENT_DTYPE
        size: (width, height) of the sensor, px
        before: what this gave for the events before these; it is left as it is

    Returns:
        (2, height, width) int64 us, NEVER where there was no event

    Raises:
        EvsError: an event outside the sensor, or another shape of `before`
    """
    width, height = _checked_size(size)
    shape = (2, height, width)
    if before is None:
        stamps = np.full(shape, NEVER, np.int64)
    elif before.shape != shape:
        raise EvsError(f"latest_stamps: before has shape {before.shape}, not {shape}")
    else:
        stamps = before.copy()
    index = (events["p"] != 0) * (width * height) + _pixel_index(events, width, height)
    np.maximum.at(stamps.reshape(-1), index, events["t"])
    return stamps


def decayed(stamps: I64, tau_us: float, t_us: int) -> F32:
    """exp(-(t_us - stamp) / tau_us) for each of `latest_stamps`, float32 of the same shape.

    1 for an event at t_us (or after it), towards 0 for old ones, 0 where there never was one.

    Args:
        stamps: what `latest_stamps` gave, us
        tau_us: time constant, us
        t_us: seen from this time, us

    Returns:
        float32 of 0 ... 1

    Raises:
        EvsError: tau_us is not over 0
    """
    if not tau_us > 0.0:
        raise EvsError(f"time_surface: tau_us is {tau_us}: it must be over 0, for example 30000")
    surface = np.zeros(stamps.shape, np.float32)
    flat = np.ascontiguousarray(stamps, np.int64).reshape(-1)
    _core.decayed(flat, float(tau_us), int(t_us), surface.reshape(-1))
    return surface


def time_surface(
    events: Events, size: tuple[int, int], tau_us: float = 30_000.0, t_us: int | None = None
) -> F32:
    """Exponential time surface, Lagorce et al., TPAMI 2017: the age of each pixel's last event.

    For a stream in pieces, keep `latest_stamps` from piece to piece and apply `decayed` to them.

    Args:
        events: (n,) EVENT_DTYPE
        size: (width, height) of the sensor, px
        tau_us: time constant, us
        t_us: reference time, us; None: the last event

    Returns:
        (2, height, width) float32 of 0 ... 1, OFF then ON

    Raises:
        EvsError: an event outside the sensor, or a tau or size that is not positive
    """
    stamps = latest_stamps(events, size)
    if t_us is None:
        t_us = int(stamps.max())
    return decayed(stamps, tau_us, t_us)


def event_frame(events: Events, size: tuple[int, int]) -> I32:
    """Number of events of each pixel, by polarity.

    Args:
        events: (n,) EVENT_DTYPE
        size: (width, height) of the sensor, px

    Returns:
        (2, height, width) int32, OFF then ON

    Raises:
        EvsError: an event outside the sensor
    """
    width, height = _checked_size(size)
    index = (events["p"] != 0) * (width * height) + _pixel_index(events, width, height)
    counts = np.bincount(index, minlength=2 * width * height)
    return counts.reshape(2, height, width).astype(np.int32)


def padded_packet(events: Events, capacity: int, t_us: int) -> I32:
    """The events as rows of an array that always has the same shape.

    Args:
        events: (n,) EVENT_DTYPE, sorted by t
        capacity: rows; of more events the last ones are taken
        t_us: what stamps are counted from, for example the time of a decision

    Returns:
        (capacity, 4) int32: t - t_us in us (0 and less for what is past), x, y, polarity +1 or -1;
        rows behind the last event are zeros, polarity too
    """
    capacity = _positive(capacity, "capacity")
    kept = events[-capacity:]
    rows = np.zeros((capacity, 4), np.int32)
    limit = np.iinfo(np.int32)
    filled = rows[: len(kept)]
    filled[:, 0] = np.clip(kept["t"] - t_us, limit.min, limit.max)
    filled[:, 1], filled[:, 2] = kept["x"], kept["y"]
    filled[:, 3] = np.where(kept["p"] != 0, 1, -1)
    return rows


def _checked_size(size: tuple[int, int]) -> tuple[int, int]:
    try:
        width, height = size
    except (TypeError, ValueError):
        raise EvsError(f"size is {size!r}: give (width, height) in px") from None
    return _positive(width, "size"), _positive(height, "size")


def _positive(value: int, name: str) -> int:
    try:
        number = operator.index(value)
    except TypeError:
        raise EvsError(f"{name} is {value!r}: give a whole number of at least 1") from None
    if number < 1:
        raise EvsError(f"{name} is {number}: give at least 1")
    return number


def _pixel_index(events: Events, width: int, height: int) -> I64:
    """(n,) y * width + x; EvsError for an event outside the sensor, which would land elsewhere."""
    x, y = events["x"].astype(np.int64), events["y"].astype(np.int64)
    outside = (x < 0) | (x >= width) | (y < 0) | (y >= height)
    if outside.any():
        first = events[int(np.argmax(outside))]
        raise EvsError(
            f"an event at ({first['x']}, {first['y']}) is outside {width} x {height}: "
            "give size = (width, height) of its sensor"
        )
    return np.asarray(y * width + x, np.int64)
