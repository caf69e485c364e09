"""Declarations of sensor parameters: one call of `parameter` holds all that evs knows of one.

A group of parameters is declared once, generic in `Unset`, the type of a value that is not given:

    @dataclass(frozen=True)
    class PixelKeys(Generic[Unset]):
        cutoff_hz: float | Unset = parameter(0.0, "bandwidth", unit="Hz", within=(0.0, 1e7))

Two classes follow from it. `PixelKeys[None]` is the configuration table, where every key may be
None, which stands for the preset's value. `PixelKeys[Never]` is the resolved sensor, where every
value is there. Key names, defaults, ranges, documentation and plan terms are read from the
declaration; a type checker knows the fields of both.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import MISSING, Field, dataclass, field, fields, is_dataclass
from inspect import get_annotations
from types import NoneType
from typing import Any, TypeVar, Union, get_args, get_origin, get_type_hints

Unset = TypeVar("Unset")
"""None in a configuration, Never in resolved parameters."""

C = TypeVar("C")

REQUIRED: Any = MISSING
"""The default of a parameter that every preset has to give."""

_KEY = "parameter"


@dataclass(frozen=True)
class Term:
    """A code path of the pixel that is off where its parameters are 0."""

    name: str
    what: str
    """what it does"""
    idle: str = ""
    """why it cannot run where nothing needs it; empty: it can, with the same bytes"""


@dataclass(frozen=True)
class Declaration:
    """What is declared of a parameter beside its name, its type and its default."""

    doc: str
    unit: str = ""
    within: tuple[float, float] | None = None
    """lowest and highest value, both allowed; of each item where the value is a tuple"""
    term: Term | None = None
    """what is off where this is 0"""
    choices: tuple[str, ...] = ()
    """the words that it may be"""
    noun: str = ""
    """what such a word is called in messages"""
    example: Any = None
    """a value to show where the default is none"""
    is_path: Callable[[str], bool] | None = None
    """whether a text of it is a path, which in a file is relative to that file"""

    @property
    def text(self) -> str:
        """Documentation with unit and range: `bandwidth [Hz, 0 ... 1e+07]`."""
        parts = [self.unit] if self.unit else []
        if self.within is not None:
            lowest, highest = self.within
            parts.append(f"{lowest:g} ... {highest:g}")
        return f"{self.doc} [{', '.join(parts)}]" if parts else self.doc


def parameter(
    default: Any,
    doc: str,
    *,
    unit: str = "",
    within: tuple[float, float] | None = None,
    term: Term | None = None,
    choices: tuple[str, ...] = (),
    noun: str = "",
    example: Any = None,
    is_path: Callable[[str], bool] | None = None,
) -> Any:
    """A field of a dataclass of declarations.

    Args:
        default: The value where neither preset nor configuration gives one, or REQUIRED.
        doc: What it means, on one line.
        unit: Its unit, as in `m/s^2`.
        within: Lowest and highest value, both allowed; of each item of a tuple.
        term: The term of the pixel that it switches on, for the plan.
        choices: The words that it may be.
        noun: What such a word is called in messages.
        example: A value to show where the default is none.
        is_path: Whether a text of it is a path, relative to the file that has it.
    """
    declared = Declaration(doc, unit, within, term, choices, noun, example, is_path)
    return field(default=default, metadata={_KEY: declared})


def any_path(_text: str) -> bool:
    """`is_path` of a key whose texts are all paths."""
    return True


def path_or_name(suffix: str) -> Callable[[str], bool]:
    """`is_path` of a key that is a name, or a path where it has a slash or this ending."""
    return lambda text: text.endswith(suffix) or "/" in text


def declaration(of: Field[Any]) -> Declaration | None:
    """The declaration of a dataclass field; None where it has none."""
    declared: Declaration | None = of.metadata.get(_KEY)
    return declared


def specialised(cls: type[C]) -> type[C]:
    """Give a subclass of generic declarations fields of its own; goes below @dataclass.

    With `Keys[None]` as base every field is `T | None` and None by default. With `Keys[Never]` it
    is `T` and has the declared default. What each key means is added to the class's docstring.
    """
    annotations: dict[str, Any] = {}
    lines: list[str] = []
    for base in getattr(cls, "__orig_bases__", ()):
        keys = get_origin(base)
        if keys is None or not is_dataclass(keys):
            continue
        optional = get_args(base) == (NoneType,)
        hints = get_type_hints(keys)
        for each in fields(keys):
            kinds = [kind for kind in get_args(hints[each.name]) if kind is not Unset]
            annotations[each.name] = Union[tuple([*kinds, None] if optional else kinds)]  # noqa: UP007
            default = None if optional else each.default
            setattr(cls, each.name, field(default=default, metadata=each.metadata))
            if declared := declaration(each):
                lines.append(f"    {each.name}: {declared.text}")
    cls.__annotations__ = {**annotations, **get_annotations(cls)}
    cls.__doc__ = f"{cls.__doc__}\n\nAttributes:\n" + "\n".join(lines)
    return cls
