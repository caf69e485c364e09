"""The words of a launch file: {NAME} stands for what it means, and a condition is true or false."""

from __future__ import annotations

import re
import shlex
from collections.abc import Iterable, Mapping

from evs.msgs import EvsError, unknown

_PLACE = re.compile(r"\{\{|\}\}|\{([^{}]*)\}")
_SPREAD = re.compile(r"\{([^{}]*)\.\.\.\}")
_COMPARED = re.compile(r"(.*?)\s*(==|!=)\s*(.*)", re.DOTALL)
_TRUE, _FALSE = ("true", "on", "yes", "1"), ("false", "off", "no", "0")


def filled(text: str, values: Mapping[str, str], at: str) -> str:
    """The text with every {NAME} replaced, {{ and }} by braces. In: at, its place, for errors."""

    def one(found: re.Match[str]) -> str:
        if found[0] in ("{{", "}}"):
            return found[0][0]
        return _value(found[1], values, at)

    return _PLACE.sub(one, text)


def filled_words(words: Iterable[str], values: Mapping[str, str], at: str) -> tuple[str, ...]:
    """All of them; {NAME...} is as many words as its value has, as a shell splits it: or none."""
    done: list[str] = []
    for i, word in enumerate(words):
        here = f"{at}.{i}"
        spread = _SPREAD.fullmatch(word)
        if spread is None:
            done.append(filled(word, values, here))
            continue
        text = _value(spread[1], values, here)
        try:
            done += shlex.split(text)
        except ValueError as reason:
            raise EvsError(f"at {here}: '{text}' cannot be split into words: {reason}") from None
    return tuple(done)


def holds(text: str, values: Mapping[str, str], at: str) -> bool:
    """Whether a condition is true: X, not X, A == B or A != B."""
    compared = _COMPARED.fullmatch(text)
    if compared is not None:
        left, right = (filled(compared[side].strip(), values, at) for side in (1, 3))
        return (left == right) == (compared[2] == "==")
    word = filled(text, values, at).strip()
    negated = word.removeprefix("not ").strip()
    if negated.lower() not in _TRUE + _FALSE:
        raise EvsError(
            f"at {at}: '{word}' is not true or false; or compare, as in \"{{mode}} == fast\""
        )
    return (negated.lower() in _TRUE) == (negated == word)


def _value(name: str, values: Mapping[str, str], at: str) -> str:
    if name not in values:
        error = unknown("argument or bus", name, values)
        raise EvsError(f"at {at}: {error}")
    return values[name]
