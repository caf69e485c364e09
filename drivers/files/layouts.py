"""Tables of events: the layouts that programs write, and what decides where a file states none.

A table is a text file, the arrays of an NPZ file or the data sets of an HDF5 file. Names of columns
decide what they hold; without names, their values do: time does not run backwards, polarity has two
values, x and y are whole numbers on a sensor. The unit of time follows from the name of the column,
then from the layout, then from whether the times are whole, as far as the rate of events is
possible.
What cannot be decided is refused: a wrong guess would look like a recording.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from evs.drivers.files.capabilities import MAX_SIDE_PX
from evs.drivers.files.integrity import MAX_STAMP_US
from evs.msgs import Events, EvsError, make_events

Column = npt.NDArray[Any]

FIELDS = ("t", "x", "y", "p")


@dataclass(frozen=True)
class Layout:
    """How one program lays out a table of events. Polarity is 1 for ON, 0 or -1 for OFF."""

    source: str
    """whose it is"""
    columns: tuple[str, ...]
    """what they hold in their order, as t, or t=NAME where they have other names"""
    named: bool = True
    """whether the file names its columns"""
    unit: str = ""
    """of time; empty: as `unit_of` decides"""
    path: str | None = None
    """group or data set in HDF5 files; None: text or arrays"""
    beside: str = ""
    """data set in the same group or at the root without which it is not this layout"""
    dtypes: tuple[str, ...] = ()
    """of t, x, y, p where these, with polarity -1 for OFF, tell the program"""


LAYOUTS = (
    Layout("evs", ("t", "x", "y", "p")),
    Layout("vid2e", ("x", "y", "t", "p"), unit="ns", dtypes=("i8", "i2", "i2", "i1")),
    Layout("tonic", ("x", "y", "t", "p"), unit="us", dtypes=("i8", "i2", "i2", "b1")),
    Layout("TimeLens", ("x", "y", "t=timestamp", "p=polarity"), unit="us"),
    Layout("faery", ("t", "x", "y", "p=on")),
    Layout("others", ("t=timestamps", "x=x_px", "y=y_px", "p=pol")),
    Layout("others", ("t=time", "x=col", "y=row", "p=polarities")),
    Layout("others", ("t=times", "x=xs", "y=ys", "p=ps")),
    # without names, the usual one first
    Layout("the Event Camera Dataset", ("t", "x", "y", "p"), named=False),
    Layout("Metavision", ("x", "y", "p", "t"), named=False),
    Layout("MVSEC", ("x", "y", "t", "p"), named=False),
    Layout("batches", ("y", "x", "", "p", "t"), named=False),
    # HDF5; data sets of four columns have no names
    Layout("DSEC", ("t", "x", "y", "p"), unit="us", path="events", beside="ms_to_idx"),
    Layout("rpg", ("t=ts", "x=xs", "y=ys", "p=ps"), unit="s", path="events"),
    Layout("M3ED", ("t", "x", "y", "p"), unit="us", path="prophesee/left"),
    Layout("DSEC at the root", ("t", "x", "y", "p"), unit="us", path="", beside="ms_to_idx"),
    Layout("v2e", ("t", "x", "y", "p"), named=False, unit="us", path="events"),
    Layout("MVSEC", ("x", "y", "t", "p"), named=False, unit="s", path="davis/left/events"),
)
"""every layout; readers know no other"""

UNITS = {"s": 1e6, "ms": 1e3, "us": 1.0, "ns": 1e-3}
"""unit of time -> us"""

SAMPLE = 1 << 16
"""rows from which a table is decided"""

_PLAIN_BYTES, _MAX_RATIO = 1 << 26, 600
"""what a table may always state, and how many times the bytes of the file. An array of all pixels
firing in order, tick by tick, is compressed 430 times."""

_FEW, _MANY = 16, 1000
"""fewer rows than _FEW decide nothing; a rate is known from _MANY on"""

_LOW_HZ, _HIGH_HZ = 1e-3, 1e3
"""mean rates of a pixel that are possible: a still view in the dark to a flood"""

_LONGEST_US = 86_400e6
"""a day: the times of a file that would last longer are in another unit than its layout's"""

_UNIX_NS = 1e17
"""whole times from here on are ns of Unix time, which are 1.7e18; us are 1.7e15"""

_SIDES_PX = ((346, 260), (240, 180), (640, 480), (1280, 720), (304, 240), (480, 360), (208, 192))
"""sensors wider than high, to notice that x and y are exchanged"""

_NAME = re.compile(r"(\w+?)(?:[ _]*[\[(]?(s|ms|us|ns|µs)[\])]?)?")


def _synonyms() -> dict[str, str]:
    found = {}
    for layout in LAYOUTS:
        for column in filter(None, layout.columns):
            field, _, name = column.partition("=")
            found[name or field] = field
    return found


NAMES = _synonyms()
"""name of a column, in lower case -> its field"""


@dataclass(frozen=True)
class Table:
    """How the columns of a file become events."""

    places: tuple[int, ...]
    """indices of t, x, y, p"""
    unit: str
    """of t"""
    read_as: str
    """what was decided, in words"""


def layout_of(
    names: Sequence[str], path: str | None = None, beside: Sequence[str] = ()
) -> Layout | None:
    """Find the layout whose unit of time is known.

    Args:
        names: Of the columns; none: they have none.
        path: Of the group or data set in an HDF5 file; None: arrays.
        beside: Names of what else is in the group and at the root of that file.

    Returns:
        The layout; None: its place and names tell no unit.
    """
    held = {name.lower() for name in names}
    left = path and path.replace("/right", "/left")
    for one in LAYOUTS:
        own = {column.rpartition("=")[2] for column in one.columns} if one.named else set()
        named_so = own <= held if one.named else not held
        there = one.path == left and (not one.beside or one.beside in beside)
        if named_so and there and one.unit and not one.dtypes:
            return one
    return None


def states_too_much(stated: int, stored: int) -> bool:
    """Whether a compressed table states more bytes than these of the file can mean.

    A small file could otherwise take hours and all memory.
    """
    return stated > max(_PLAIN_BYTES, _MAX_RATIO * stored)


def named_columns(names: Sequence[str], columns: str = "") -> tuple[tuple[int, ...], str] | None:
    """Find t, x, y, p by the names of columns.

    Args:
        names: Of all columns.
        columns: The user's option: "t=time,x=col,..." or, in the file's order, "t,x,y,p".

    Returns:
        Their indices and the unit that the name of t states, or ""; None: not all are there.

    Raises:
        EvsError: The option is not of that form, or contradicts the names.
    """
    wanted = _wanted(columns)
    if isinstance(wanted, tuple):
        places = tuple(wanted.index(field) for field in FIELDS)
        by_name = named_columns(names)
        if by_name is not None and by_name[0] != places:
            raise EvsError(
                f"--columns is '{columns}', but the columns are named {', '.join(names)}: leave it "
                "out, or give the names, as in t=time,x=col,y=row,p=sign"
            )
        return (places, "") if max(places) < len(names) else None
    found: dict[str, int] = {}
    unit = ""
    for k, name in enumerate(names):
        plain = name.strip(" \"'").lower()
        if wanted:
            field = wanted.get(name.strip(" \"'"), "")
        elif plain in NAMES:
            field = NAMES[plain]
        else:
            parts = _NAME.fullmatch(plain)
            field = NAMES.get(parts[1], "") if parts and parts[2] else ""
            field = field if field == "t" else ""
            unit = parts[2].replace("µ", "u") if parts and field and "t" not in found else unit
        if field and field not in found:
            found[field] = k
    if len(found) < len(FIELDS):
        return None
    return tuple(found[field] for field in FIELDS), unit


def _wanted(columns: str) -> tuple[str, ...] | dict[str, str]:
    """The option --columns: fields in order, or name -> field; no name: not given. EvsError."""
    words = [word.strip() for word in columns.split(",")] if columns else []
    pairs = [word.partition("=") for word in words]
    fields = [field for field, _, _ in pairs]
    if words and any(fields.count(field) != 1 for field in FIELDS):
        raise EvsError(
            f"--columns is '{columns}': name t, x, y and p once each, as in t,x,y,p in the order "
            "of the columns, or t=time,x=col,y=row,p=sign by their names"
        )
    if all(equals for _, equals, _ in pairs):
        return {name.strip(): field.strip() for field, _, name in pairs}
    return tuple(fields)


def decide(
    path: Any,
    sample: Sequence[Column],
    names: Sequence[str] | None = None,
    *,
    columns: str = "",
    unit: str = "",
    layout: Layout | None = None,
    with_point: bool = False,
) -> Table:
    """Decide how a table is read.

    Args:
        path: The file, for messages.
        sample: (n,) the first values of each column.
        names: Of the columns; None: they have none.
        columns: The user's option, as for `named_columns`.
        unit: The user's: of time; empty: to be found.
        layout: The layout, where the place in the file tells it.
        with_point: In text: times are written with a decimal point, unlike x.

    Returns:
        The places of t, x, y, p, the unit of time, and what was decided.

    Raises:
        EvsError: It cannot be decided; the message names the option that does.
    """
    if unit and unit not in UNITS:
        raise EvsError(f"--unit is '{unit}': give one of {', '.join(UNITS)}")
    found = named_columns(names or [""] * len(sample), columns) if names or columns else None
    if found is None and (names or columns):
        held = ", ".join(names) if names else f"{len(sample)}"
        raise EvsError(
            f"{path} is not a recording: it needs columns t, x, y, p; it has {held[:80]}"
        )
    stated = ""
    if found is None:
        places = _order(path, sample, layout)
        by = ", ".join(_words(places, len(sample)))
    else:
        places, stated = found
        by = "" if names and not columns else columns
    t, x, y, p = (sample[place] for place in places)
    _check_polarity(path, p)
    chosen = unit or stated or unit_of(path, (t, x, y, p), layout, with_point)
    parts = [f"columns {by}"] if by else []
    parts += [] if stated or unit else [f"times in {chosen}"]
    return Table(places, chosen, "; ".join(parts))


def _words(places: Sequence[int], count: int) -> list[str]:
    """What each of the columns holds; - for one that is not read."""
    return [FIELDS[places.index(k)] if k in places else "-" for k in range(count)]


def _order(path: Any, sample: Sequence[Column], layout: Layout | None) -> tuple[int, ...]:
    """The places of t, x, y, p among columns without names. EvsError: not decided."""
    known = [layout] if layout else [one for one in LAYOUTS if not one.named and one.path is None]
    orders = [
        tuple(one.columns.index(field) for field in FIELDS)
        for one in known
        if len(one.columns) == len(sample) or (len(one.columns) == 4 < len(sample))
    ]
    fitting = [places for places in orders if _fits(*(sample[place] for place in places))]
    few = not len(sample) or len(sample[0]) < _FEW
    if len(fitting) != 1 and few and orders:
        return (fitting or orders)[0]
    if len(fitting) != 1:
        why = "several orders fit" if fitting else "no order fits their values"
        raise EvsError(
            f"{path} does not name its {len(sample)} columns, and {why}: give them, as in "
            "--columns t,x,y,p"
        )
    _, x, y, _ = (sample[place] for place in fitting[0])
    sides = [1 + int(np.quantile(one, 0.999, method="lower")) for one in (x, y)]
    exchanged = any(
        0.95 * wide <= sides[1] <= wide and 0.95 * high <= sides[0] <= high
        for wide, high in _SIDES_PX
    )
    if len(x) >= _MANY and sides[1] > sides[0] and (exchanged or fitting[0][1] > fitting[0][2]):
        this, other = (
            ",".join(_words(places, len(sample)))
            for places in (fitting[0], [fitting[0][k] for k in (0, 2, 1, 3)])
        )
        raise EvsError(
            f"{path} does not name its columns, and x seems to be y ({sides[0]} x {sides[1]} px): "
            f"give --columns {other}, or {this}"
        )
    return fitting[0]


def _fits(t: Column, x: Column, y: Column, p: Column) -> bool:
    """Whether these values, (n,) each, can be of these fields; a few may be damaged."""
    steps = np.diff(t.astype(np.float64))
    runs = np.count_nonzero(steps < 0) <= 0.1 * len(steps) and steps.sum() >= 0
    # a constant is no clock
    runs = runs and (len(t) < _FEW or bool(steps.any()))
    whole = all(
        _mostly((one >= 0) & (one < MAX_SIDE_PX) & (one == np.floor(one))) for one in (x, y)
    )
    return bool(runs) and whole and _two_valued(p)


def _two_valued(p: Column) -> bool:
    return _mostly((p == 1) | (p == 0) | (p == -1))


def _mostly(right: npt.NDArray[np.bool_]) -> bool:
    """Whether most values are right, or there are none."""
    return not len(right) or bool(np.mean(right) > 0.9)


def _check_polarity(path: Any, p: Column) -> None:
    """EvsError where polarities are coded in a way that is not known."""
    if len(p) >= _FEW and not _two_valued(p):
        values = np.unique(p)
        text = ", ".join(f"{value:g}" for value in values[:6].astype(float))
        more = ", ..." if len(values) > 6 else ""
        raise EvsError(
            f"{path} has polarities {text}{more}, and evs knows 1 for ON, 0 or -1 for OFF: write "
            "them so, or name the right columns with --columns t,x,y,p"
        )


def unit_of(
    path: Any, sample: tuple[Column, ...], layout: Layout | None = None, with_point: bool = False
) -> str:
    """Decide the unit of time.

    The layout's, where one is known. Otherwise whole times are us, others s, unless the pixels of
    the sensor would then have less than one event in 1,000 s each. Which unit it is then, only the
    user can tell.

    Args:
        path: The file, for messages.
        sample: (n,) t, x, y, p.
        layout: The layout, where it is known.
        with_point: In text: times are written with a decimal point, unlike x.

    Returns:
        s, us or ns.

    Raises:
        EvsError: It cannot be decided.
    """
    t, x, y, _ = sample
    if layout and layout.beside:
        return layout.unit
    layout = layout if layout and layout.unit else _layout_by_types(sample)
    finite = t[np.isfinite(t)] if t.dtype.kind == "f" else t
    if not len(finite):
        return "us"
    # a few times in s may be whole
    with_point = with_point or bool(layout and layout.unit == "s" and t.dtype.kind == "f")
    whole = bool((finite == np.floor(finite)).all()) and not (with_point and len(t) < _FEW)
    known = layout is not None and whole == (layout.unit != "s")
    usual = layout.unit if layout and known else "us" if whole else "s"
    # a damaged row in a hundred changes nothing
    early, late = np.quantile(finite.astype(np.float64), (0.01, 0.99)).tolist()
    if whole and early >= _UNIX_NS:
        return "ns"
    pixels = (1.0 + float(np.quantile(x, 0.99))) * (1.0 + float(np.quantile(y, 0.99)))
    span = (late - early) / 0.98
    choices = ("us", "ns") if whole else ("s", "ms", "us")
    rates_hz = {
        one: len(t) * 1e6 / max(span * UNITS[one], 1e-9) / max(pixels, 1.0) for one in choices
    }
    possible = [one for one, rate_hz in rates_hz.items() if _LOW_HZ <= rate_hz <= _HIGH_HZ]
    many = len(t) >= _MANY
    if known:
        flood = many and rates_hz[usual] > _HIGH_HZ and len(possible) > 0
        sound = span * UNITS[usual] <= _LONGEST_US and not flood
    else:
        sound = not many or rates_hz[usual] >= _LOW_HZ
    if sound:
        return usual
    if many and len(possible) == 1 and (known or not whole):
        return possible[0]
    lasting = " or ".join(f"{one} ({span * UNITS[one] * 1e-6:.3g} s)" for one in choices)
    raise EvsError(
        f"{path} does not state the unit of its times, which may be {lasting}: give it, as in "
        f"--unit {choices[0]}"
    )


def _layout_by_types(sample: tuple[Column, ...]) -> Layout | None:
    """The layout that the types of t, x, y, p tell."""
    p = sample[3]
    dtypes = tuple(one.dtype.str[1:] for one in sample)
    signed = len(p) > 0 and p.dtype.kind == "i" and bool((p != 0).all()) and int(p.min()) < 0
    known = [one for one in LAYOUTS if one.dtypes == dtypes]
    return known[0] if known and (signed or p.dtype.kind == "b") else None


def events_of(
    t: Column, x: Column, y: Column, p: Column, unit: str
) -> tuple[Events, npt.NDArray[np.bool_]]:
    """Turn rows of a table into events.

    Args:
        t: (n,) in this unit.
        x: (n,) px.
        y: (n,) px.
        p: (n,) 1 ON, 0 or -1 OFF.
        unit: One of UNITS.

    Returns:
        (m,) EVENT_DTYPE, and (n,) which of the rows are events: the others lie on no sensor, at no
        time, or have another polarity.
    """
    stamps = _stamps_us(t, unit)
    sound = (stamps >= -MAX_STAMP_US) & (stamps <= MAX_STAMP_US)
    for one in (x, y):
        sound &= (one >= 0) & (one < MAX_SIDE_PX)
        if one.dtype.kind == "f":
            sound &= one == np.floor(one)
    if p.dtype.kind != "b":
        sound &= (p == 1) | (p == 0) | (p == -1)
    if not sound.all():
        stamps, x, y, p = stamps[sound], x[sound], y[sound], p[sound]
    return make_events(stamps.astype(np.int64), x, y, p > 0), sound


def _stamps_us(t: Column, unit: str) -> Column:
    """Times in whole us; what no event can have lies beyond MAX_STAMP_US.

    A fraction of a us is cut off, as a camera's clock does; s and ms are rounded, since their
    decimals are seldom exact.
    """
    if t.dtype.kind == "f":
        with np.errstate(over="ignore", invalid="ignore"):
            us = np.nan_to_num(t.astype(np.float64) * UNITS[unit], nan=2.0**63)
            return np.rint(us) if UNITS[unit] > 1.0 else np.floor(us + 1e-3)
    if unit == "us":
        return t
    if unit == "ns":
        return t // 1000
    scale = round(UNITS[unit])
    most = MAX_STAMP_US // scale
    inside = (t >= -most) & (t <= most)
    return np.where(inside, np.where(inside, t, 0).astype(np.int64) * scale, 2 * MAX_STAMP_US - 1)
