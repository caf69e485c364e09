"""Ranges: a distribution as a text, and the value that an episode draws from it.

    uniform(low, high)          every value equally likely; whole keys: both ends
    log_uniform(low, high)      the logarithm equally likely
    normal(mean, deviation)     mean, standard deviation; without far outliers
    choice(a, b, ...)           one of these
    ... * nominal               times the value that the key has without ranges
    ... + nominal               plus that value
    ... * KEY, ... + KEY        times or plus another key of the same episode

A draw is a pure function of range, seed, episode and the name of the key: it depends neither on
the order of the keys nor on the other ranges, and is the same on every machine. Values have six
significant digits, so that a record in decimals is the value that was used.
"""

from __future__ import annotations

import math
import re
import zlib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from decimal import Context, Decimal, localcontext
from itertools import chain

from evs.emulator.config.decoding import plain_integer
from evs.emulator.sensor.random import indexed_normals, indexed_uniforms
from evs.msgs import EvsError, nearest_first, unknown

TERM = 160
"""what these random numbers are for, beside the terms of sensor/random.py"""

NOMINAL = "nominal"
"""stands for the value that the key has without ranges"""

DIGITS = 6
"""significant digits of a value"""

MOST_DEVIATIONS = 5.0
"""of a normal number from its mean; it is drawn again where it is farther, once in 1.7 million"""

LEAST_SHARE = 0.01
"""of a normal distribution that lies in the range of its key; it is drawn again until it does"""

MOST_DRAWS = 10_000
"""of a normal number: at LEAST_SHARE, all of them miss once in 10^43 draws"""

AT_ONCE = 16
"""normal numbers that are drawn together"""

_EXACT = Context(prec=30)

_TEXT = re.compile(r"\s*(\w+)\s*\(([^()]*)\)\s*(?:([*+])\s*([^\s*+()]+)\s*)?")

_SHOW = "write it as in 'uniform(0.15, 0.35)'"

_WORDS = {"*": "factor", "+": "summand"}

Number = int | float

Ranges = Mapping[str, str]
"""key -> its range"""


@dataclass(frozen=True)
class Key:
    """A key that may have a range."""

    name: str
    whole: bool
    """whether its values are whole numbers"""
    within: tuple[float, float]
    """lowest and highest value that it is declared to have"""
    words: Mapping[str, int] | None = None
    """names of its values, where it has no others"""


def draw_values(parts: Sequence[Range], seed: int, episode: int) -> dict[str, Number]:
    """Draw the values of an episode.

    Args:
        parts: See `bound_ranges`.
        seed: Any whole number, modulo 2^64.
        episode: Number of the episode, 0 ... 2^63 - 1.

    Returns:
        Name of the key -> value, in the order of the names.

    Raises:
        EvsError: Seed or episode is out of range.
    """
    seed, episode = plain_integer(seed, "seed"), plain_integer(episode, "episode")
    if not 0 <= episode < 2**63:
        raise EvsError(f"episode is {episode}; give 0 ... 2^63 - 1")
    # one call for all keys: a number follows from its own counter alone
    flat = [part for part in parts if part.kind != "normal"]
    shares: list[float] = []
    if flat:
        counters = [part.number for part in flat]
        shares = indexed_uniforms(seed, TERM, episode, counters).tolist()
    share_of = dict(zip((part.key.name for part in flat), shares, strict=True))
    bell = [part for part in parts if part.kind == "normal"]
    normals: list[list[float]] = []
    if bell:
        every = [_counters(part.number, 0) for part in bell]
        normals = indexed_normals(seed, TERM, episode, every).tolist()
    normals_of = dict(zip((part.key.name for part in bell), normals, strict=True))
    values: dict[str, Number] = {}
    for part in parts:
        name = part.key.name
        if name in share_of:
            values[name] = part.from_uniform(share_of[name], values)
        else:
            more = _more_normals(seed, episode, part.number)
            values[name] = part.from_normals(chain(normals_of[name], more), values)
    return dict(sorted(values.items()))


def _counters(number: int, first: int) -> list[int]:
    # far from each other: counters of keys differ in their low 32 bits
    return [(place << 32) + number for place in range(first, first + AT_ONCE)]


def _more_normals(seed: int, episode: int, number: int) -> Iterator[float]:
    for first in range(AT_ONCE, MOST_DRAWS, AT_ONCE):
        yield from indexed_normals(seed, TERM, episode, _counters(number, first)).tolist()


def bound_ranges(parsed: Mapping[str, Range], nominal: Mapping[str, Number]) -> list[Range]:
    """The ranges with what they refer to, those that others refer to first. Raises EvsError.

    Args:
        parsed: Name of the key -> its range.
        nominal: Name of the key -> the value that it has without ranges.
    """
    order = sorted(parsed.values(), key=lambda one: (one.of in parsed, one.key.name))
    return [one.bound(nominal, parsed) for one in order]


def refers_to(text: str) -> str:
    """The key that a range refers to; "": none."""
    found = _TEXT.fullmatch(text) if isinstance(text, str) else None
    name = (found[4] or "") if found else ""
    return "" if name == NOMINAL else name


@dataclass(frozen=True)
class Range:
    """One range, parsed."""

    key: Key
    text: str
    where: str
    """what has it, for errors: randomise.KEY"""
    kind: str
    numbers: tuple[float, ...]
    operator: str
    """empty, * or +"""
    of: str
    """empty, NOMINAL, or the key that it is multiplied with or added to"""
    operand: float | None = None
    """the value of that, if it is the same in every episode"""
    operands: tuple[float, float] = (1.0, 1.0)
    """the lowest and the highest"""

    @classmethod
    def parse(cls, key: Key, text: str, keys: Mapping[str, Key], where: str) -> Range:
        """Parse a range.

        Args:
            key: What has it.
            text: The range.
            keys: All that it may refer to.
            where: What has it, for errors.

        Raises:
            EvsError: The text is no range.
        """
        found = _TEXT.fullmatch(text) if isinstance(text, str) else None
        if found is None:
            raise EvsError(f"at {where}: {text!r} is no distribution; {_SHOW}")
        kind, inside, operator, of = found[1], found[2], found[3] or "", found[4] or ""
        if kind not in _CHECKS:
            raise EvsError(f"at {where}: {unknown('distribution', kind, _CHECKS)}")
        if key.words is not None and (kind != "choice" or of):
            raise EvsError(f"at {where}: '{text}': its values are names; give choice(a, b, ...)")
        try:
            numbers = tuple(_number(key, word.strip()) for word in inside.split(","))
        except ValueError:
            numbers = (math.nan,)
        except KeyError as word:
            raise EvsError(
                f"at {where}: {unknown('value', word.args[0], key.words or ())}"
            ) from None
        if not all(map(math.isfinite, numbers)):
            raise EvsError(f"at {where}: '{inside}' are no numbers; {_SHOW}")
        made = cls(key, text, where, kind, numbers, operator, of)
        if wrong := _CHECKS[kind](numbers):
            raise made.error(wrong)
        if made.whole and any(not number.is_integer() for number in numbers):
            raise made.error("its values are whole numbers; give whole ones")
        if of not in ("", NOMINAL) and (of not in keys or of == key.name):
            others = [NOMINAL, *(name for name in keys if name != key.name)]
            nearest = nearest_first(of, others)[0]
            raise made.error(f"no {_WORDS[operator]} '{of}'; nearest known: {nearest}")
        return made

    def error(self, what: str) -> EvsError:
        """An error of this range."""
        return EvsError(f"at {self.where}: '{self.text}': {what}")

    @property
    def number(self) -> int:
        """What its random numbers follow from, beside seed and episode."""
        return zlib.crc32(self.key.name.encode())

    @property
    def whole(self) -> bool:
        """Whether the distribution itself has whole values."""
        return self.key.whole and not self.of and self.kind in ("uniform", "choice")

    @property
    def ends(self) -> tuple[Number, ...]:
        """The values at the ends, lowest first; for a choice all of them."""
        if self.kind == "normal":
            lowest, highest = self.support
            return self._value(lowest), self._value(highest)
        found = {
            self._value(self._combined(number, operand))
            for number in self.numbers
            for operand in self.operands
        }
        return tuple(sorted(found))

    def bound(self, nominal: Mapping[str, Number], others: Mapping[str, Range]) -> Range:
        """The range with what it refers to, checked against the key's own range. EvsError."""
        made = self
        if self.of:
            source = self.key.name if self.of == NOMINAL else self.of
            other = None if self.of == NOMINAL else others.get(source)
            word = _WORDS[self.operator]
            if other is None:
                if source not in nominal:
                    raise self.error(f"there is no {source}; give a range without {word}")
                operand = float(nominal[source])
                made = replace(self, operand=operand, operands=(operand, operand))
            elif other.of not in ("", NOMINAL):
                own = _WORDS[other.operator]
                raise self.error(f"{source} has a {own} of its own; refer to {other.of}")
            else:
                made = replace(self, operands=other.bound(nominal, others).support)
            if self.operator == "*" and not made.operands[0] > 0:
                verb = "may be" if made.operand is None else "is"
                raise self.error(
                    f"{source} {verb} {made.operands[0]:g}, and a factor must be over 0; give a "
                    "range without it"
                )
        made.check_within()
        return made

    @property
    def support(self) -> tuple[float, float]:
        """The lowest and the highest value."""
        if self.kind == "normal":
            (mean, deviation), (lowest, highest) = self.numbers, self.key.within
            ends = (mean - MOST_DEVIATIONS * deviation, mean + MOST_DEVIATIONS * deviation)
            found = [self._combined(end, operand) for end in ends for operand in self.operands]
            return max(min(found), lowest), min(max(found), highest)
        values = self.ends
        return float(values[0]), float(values[-1])

    def check_within(self) -> None:
        """Raise EvsError where values lie outside the key's own range."""
        lowest, highest = self.key.within
        of = f"{lowest:g} ... {highest:g}"
        for operand in self.operands:
            for number in self.numbers[: 1 if self.kind == "normal" else None]:
                found = self._combined(number, operand)
                if not lowest <= found <= highest:
                    raise self.error(f"{found:g} is outside {of}, the range of the key")
            if self.kind == "normal":
                mean, deviation = self.numbers
                low, high = (
                    (self._without(end, operand) - mean) / deviation for end in (lowest, highest)
                )
                if _share_between(low, high) < LEAST_SHARE:
                    raise self.error(f"hardly any of it lies in {of}; give uniform({of})")

    def from_uniform(self, share: float, values: Mapping[str, Number]) -> Number:
        """The value of an episode.

        Args:
            share: A number of [0, 1).
            values: Of the keys that it refers to.
        """
        operand, numbers = self._operand(values), self.numbers
        if self.kind == "choice":
            return self._value(self._combined(numbers[math.floor(share * len(numbers))], operand))
        low, high = numbers
        if self.whole:
            return int(low) + math.floor(share * (high - low + 1))
        if self.kind == "uniform":
            found = _at_place(low + share * (high - low), max(abs(low), abs(high)))
        else:
            with localcontext(_EXACT):
                first, last = Decimal(low).ln(), Decimal(high).ln()
                found = float((first + Decimal(share) * (last - first)).exp())
            found = _at_place(found, found)
        return self._value(self._combined(min(max(found, low), high), operand))

    def from_normals(self, normals: Iterable[float], values: Mapping[str, Number]) -> Number:
        """The value of an episode.

        Args:
            normals: Standard normal numbers; the first that fits is taken.
            values: Of the keys that it refers to.
        """
        mean, deviation = self.numbers
        lowest, highest = self.key.within
        operand = self._operand(values)
        for normal in normals:
            found = _at_place(mean + deviation * normal, max(abs(mean), deviation))
            made = self._combined(found, operand)
            if abs(normal) <= MOST_DEVIATIONS and lowest <= made <= highest:
                return self._value(made)
        return self._value(self._combined(mean, operand))

    def _operand(self, values: Mapping[str, Number]) -> float:
        if self.operand is not None:
            return self.operand
        return float(values[self.of]) if self.of else 1.0

    def _combined(self, number: float, operand: float) -> float:
        if not self.of:
            return number
        return number * operand if self.operator == "*" else number + operand

    def _without(self, value: float, operand: float) -> float:
        """What `_combined` makes this value of."""
        if not self.of:
            return value
        return value / operand if self.operator == "*" else value - operand

    def _value(self, value: float) -> Number:
        """As the key has it, in its own range: a product may be rounded out of it."""
        if self.key.whole:
            value = round(value)
        elif self.of:
            value = _at_place(value, value)
        lowest, highest = self.key.within
        value = min(max(value, lowest), highest)
        return int(value) if self.key.whole else float(value)


def _number(key: Key, word: str) -> float:
    """The number that a word of a range stands for. ValueError, KeyError: none."""
    return float(word) if key.words is None else float(key.words[word])


def _at_place(value: float, scale: float) -> float:
    """Rounded to DIGITS significant digits of a number as large as `scale`."""
    if not scale:
        return value
    exponent = int(f"{scale:e}".partition("e")[2])
    return round(value, DIGITS - 1 - exponent)


def _share_between(low: float, high: float) -> float:
    """Share of standard normal numbers between two."""
    return (math.erf(high / math.sqrt(2.0)) - math.erf(low / math.sqrt(2.0))) / 2.0


def _wrong_interval(numbers: tuple[float, ...]) -> str:
    if len(numbers) != 2:
        return "give the lowest and the highest value"
    return "" if numbers[0] < numbers[1] else "give the lower value first"


def _wrong_log_interval(numbers: tuple[float, ...]) -> str:
    positive = min(numbers) > 0
    return _wrong_interval(numbers) or ("" if positive else "both values must be over 0")


def _wrong_normal(numbers: tuple[float, ...]) -> str:
    if len(numbers) != 2:
        return "give the mean and the standard deviation"
    return "" if numbers[1] > 0 else "the standard deviation must be over 0"


def _wrong_choice(numbers: tuple[float, ...]) -> str:
    return "" if len(set(numbers)) == len(numbers) else "a value stands there twice"


_CHECKS = {
    "uniform": _wrong_interval,
    "log_uniform": _wrong_log_interval,
    "normal": _wrong_normal,
    "choice": _wrong_choice,
}
"""distribution -> what is wrong with its numbers, empty: nothing"""
