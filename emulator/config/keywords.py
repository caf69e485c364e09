"""Unknown keywords of constructors: the error has the nearest names that exist."""

from __future__ import annotations

import functools
import inspect
from collections.abc import Callable
from typing import Any, ParamSpec, TypeVar

from evs.msgs import EvsError, nearest_first

P = ParamSpec("P")
R = TypeVar("R")
C = TypeVar("C")


class UnknownKeywordError(EvsError, TypeError):
    """A keyword that a function does not have; a TypeError, as Python's own."""


def check_keywords(
    function: Callable[P, R], name: str, signature: inspect.Signature | None = None
) -> Callable[P, R]:
    """The function with an error that names the nearest keywords.

    Args:
        function: The function.
        name: What messages call it.
        signature: With the names of its **keywords; None if it has none.
    """
    known = [
        one.name
        for one in (signature or inspect.signature(function)).parameters.values()
        if one.kind is not one.POSITIONAL_ONLY and one.name != "self"
    ]
    allowed = frozenset(known)

    @functools.wraps(function)
    def checked(*args: P.args, **keywords: P.kwargs) -> R:
        if not allowed.issuperset(keywords):
            word = next(one for one in keywords if one not in allowed)
            nearest = ", ".join(nearest_first(word, known)[:3])
            raise UnknownKeywordError(f"{name} has no keyword '{word}'; nearest: {nearest}")
        return function(*args, **keywords)

    return checked


def fields_as_keywords(spec: type) -> Callable[[type[C]], type[C]]:
    """Decorate a class whose constructor takes the fields of a dataclass as **keywords.

    `help` lists them, and an unknown one is answered with the nearest.
    """

    def decorate(kind: type[C]) -> type[C]:
        signature = inspect.signature(kind)
        own = [one for one in signature.parameters.values() if one.kind is not one.VAR_KEYWORD]
        names = {one.name for one in own}
        fields = [
            one.replace(kind=one.KEYWORD_ONLY)
            for one in inspect.signature(spec).parameters.values()
            if one.name not in names
        ]
        listed = signature.replace(parameters=[*own, *fields])
        begin: Any = check_keywords(kind.__init__, kind.__name__, listed)
        kind.__init__ = begin  # type: ignore[method-assign]
        kind.__signature__ = listed  # type: ignore[attr-defined]
        return kind

    return decorate


def named_keywords(kind: type[C]) -> type[C]:
    """Decorate a class: an unknown keyword of its constructor is answered with the nearest."""
    begin: Any = check_keywords(kind.__init__, kind.__name__)
    kind.__init__ = begin  # type: ignore[method-assign]
    return kind
