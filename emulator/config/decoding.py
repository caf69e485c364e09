"""Decoding of keys: TOML, `dotted.key=value` and values of Python into frozen dataclasses, checked.

A class maps to a table, a field to a key, a field of type tuple[SomeDataclass, ...] to an array of
tables, a field of type Mapping[str, str] to a table whose keys are free, dotted where it has tables
inside. A class with a class method `variant(table)` stands for several, which that chooses from.
msgspec decodes and checks types; unknown keys, files beside a file and the words of errors are
added here.
"""

from __future__ import annotations

import json
import math
import numbers
import os
import re
import tomllib
import types
import typing
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, fields, is_dataclass
from functools import cache
from pathlib import Path
from typing import Any, TypeVar

import msgspec
import numpy as np

from evs.emulator.base.small_files import read_small_text
from evs.emulator.config.declaration import declaration
from evs.msgs import EvsError, nearest_first, unknown

T = TypeVar("T")

PathChange = Callable[[str], str]
"""gives a declared path of a configuration another form"""

_INT64_MAX = 2**63 - 1


def read_toml(path: Path) -> dict[str, Any]:
    """The tables of a TOML file. EvsError where it is missing, unreadable or malformed."""
    try:
        text = read_small_text(path)
    except FileNotFoundError:
        raise EvsError(f"no file '{path}'") from None
    except UnicodeDecodeError:
        raise EvsError(f"{path}: not a TOML file: it is not UTF-8 text") from None
    except OSError as reason:
        raise EvsError(f"cannot read '{path}': {reason.strerror}") from None
    try:
        return tomllib.loads(text)
    except ValueError as reason:
        # also Python's own, for an integer of thousands of digits
        raise EvsError(f"{path}: malformed TOML: {reason}") from None
    except RecursionError:
        raise EvsError(f"{path}: malformed TOML: brackets are nested too deep") from None


def build(cls: type[T], tables: Mapping[str, Any], paths: PathChange | None = None) -> T:
    """Build a configuration from plain tables; keys that are absent keep their defaults.

    Args:
        cls: The class of the configuration.
        tables: As TOML or JSON give them.
        paths: Applied to every key that is declared as a path.

    Raises:
        EvsError: With the dotted path: an unknown key (and the nearest known), a wrong type.
    """
    made: T = _Decoder(cls, paths=paths).decode(cls, tables, "")
    return made


def override(config: T, overrides: Iterable[tuple[str, str]], paths: PathChange | None = None) -> T:
    """A copy of a configuration with dotted keys set from texts of a command line.

    Text is read as the key's type wants it: `true`, `4`, `1e-3`, `1,2,3` or `[1, 2, 3]`, a bare or
    quoted string, `none` where a key may be absent. `list.N.key` reaches into an array of tables,
    and N = its length appends one.

    Args:
        config: An instance of a configuration class.
        overrides: (key, text); the last text of a key counts.
        paths: See `build`.

    Raises:
        EvsError: As `build` does.
    """
    tables = to_plain(config, sparse=True)
    # the type of a table decides what its other keys are
    for key, text in sorted(overrides, key=lambda pair: not pair[0].endswith(".type")):
        _check_text(text, key)
        _put(type(config), tables, key.split("."), text, "", type(config))
    return build(type(config), tables, paths)


def plain_config(config: T, table: str) -> T:
    """A copy of a configuration from Python with plain values, which any header can hold.

    Args:
        config: An instance of a configuration class; nothing has checked its types.
        table: Its name, for messages.

    Raises:
        EvsError: A value is not of its field's type, or not finite.
    """
    made: T = _Decoder(type(config), python=True).decode(type(config), config, table)
    return made


def with_keys(config: T, keys: Mapping[str, Any], table: str) -> T:
    """`plain_config` of a copy with some keys set.

    Args:
        config: A dataclass of the configuration.
        keys: key -> value. A key of a table inside is dotted, or the value is a dict of its keys.
        table: Of `config`, for messages.

    Raises:
        EvsError: An unknown key; the message has the nearest ones. A bad value.
    """
    tables = dict(vars(config))
    for key, value in keys.items():
        name, _, rest = key.partition(".")
        before = tables.get(name)
        if rest and name in tables and not is_dataclass(before):
            raise EvsError(f"{table}.{name} is no table: it has no key {rest}")
        if is_dataclass(before) and (rest or isinstance(value, Mapping)):
            value = with_keys(before, {rest: value} if rest else value, f"{table}.{name}")
        tables[name] = value
    made: T = _Decoder(type(config), python=True).decode(type(config), tables, table)
    return made


def plain_integer(value: Any, name: str) -> int:
    """`value` as an int; EvsError where it is no whole number."""
    return int(_Decoder(int, python=True).decode(int, value, name))


def plain_number(value: Any, name: str) -> float:
    """`value` as a float; EvsError where it is no finite number."""
    return float(_Decoder(float, python=True).decode(float, value, name))


def split_word(word: str) -> tuple[str, str]:
    """`key=value` into its two sides; EvsError if it has no key."""
    key, equals, text = word.partition("=")
    if not equals or not key.strip():
        raise EvsError(f"'{word}' is not key=value, as in render.spp=4")
    return key.strip(), text.strip()


def to_text(value: Any) -> str:
    """The text that `override` reads back as `value`."""
    if value is None:
        return "none"
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        plain_word = value == value.strip() and value[:1] not in "\"'" and value.lower() != "none"
        return value if plain_word and value else _quoted(value)
    if isinstance(value, (tuple, list)):
        # a word alone is a string, in a list it is not
        items = (_quoted(item) if isinstance(item, str) else to_text(item) for item in value)
        return "[" + ", ".join(items) + "]"
    return repr(value)


def to_plain(config: Any, sparse: bool = False) -> Any:
    """Plain values (dict, list, str, int, float, bool, None) of a configuration, ready for JSON.

    Args:
        config: A configuration, or a value in one.
        sparse: Leave keys out that have their defaults.
    """
    if is_dataclass(config) and not isinstance(config, type):
        return {
            field.name: to_plain(value, sparse)
            for field in fields(config)
            if (value := getattr(config, field.name)) != field.default
            or not sparse
            or field.name == "type"
        }
    if isinstance(config, Mapping):
        return {key: to_plain(value) for key, value in config.items()}
    if isinstance(config, (tuple, list)):
        return [to_plain(item, sparse) for item in config]
    return config


def key_names(cls: type, prefix: str = "") -> Iterator[str]:
    """Every dotted name of a class and its tables; `N` stands for a place in an array of tables."""
    for name, hint in hints_of(cls).items():
        path = prefix + name
        yield path
        inner, many = table_of(hint)
        for kind in variants_of(inner) if inner else ():
            yield from key_names(kind, f"{path}.N." if many else f"{path}.")


@cache
def hints_of(cls: type) -> dict[str, Any]:
    """The types of a class's fields; finding them takes longer than all else here."""
    hints = typing.get_type_hints(cls)
    return {field.name: hints[field.name] for field in fields(cls)} if is_dataclass(cls) else hints


def table_of(hint: Any) -> tuple[type | None, bool]:
    """(class of the table that a hint is, or None; whether it is an array of them)."""
    arguments = typing.get_args(hint)
    if typing.get_origin(hint) is tuple and arguments[1:] == (...,):
        return table_of(arguments[0])[0], True
    is_table = is_dataclass(hint) or hasattr(hint, "variants")
    return (hint if is_table and isinstance(hint, type) else None), False


@cache
def _paths_of(cls: type) -> dict[str, Callable[[str], bool]]:
    """The keys of a class that may be paths, and which of their texts are."""
    declared = {field.name: declaration(field) for field in fields(cls)}
    return {name: one.is_path for name, one in declared.items() if one and one.is_path}


def variants_of(cls: type) -> tuple[type, ...]:
    """The classes that a table may be of: what `cls.variants` has, or the class alone."""
    return tuple(dict.fromkeys(getattr(cls, "variants", {"": cls}).values()))


def _variant(cls: type, table: Mapping[str, Any], path: str) -> type:
    """The class of a table, which its key `type` decides where there are several."""
    known: Mapping[str, type] | None = getattr(cls, "variants", None)
    if known is None:
        return cls
    word = str(table.get("type", ""))
    if word not in known:
        noun = f"{path.partition('.')[0]} type"
        raise EvsError(f"at {path}.type: {unknown(noun, word, known)}")
    return known[word]


@dataclass(frozen=True)
class _Decoder:
    """Makes a value what a type hint wants, or reports the path to what cannot be."""

    root: Any
    """the outermost hint"""
    paths: PathChange | None = None
    python: bool = False
    """whether errors are worded for a program in Python, and not for a file"""

    def decode(self, hint: Any, value: Any, path: str) -> Any:
        """`value` as the hint has it. EvsError with the path to what it cannot be."""
        prepared = self._prepared(hint, value, path)
        try:
            return msgspec.convert(prepared, hint)
        except msgspec.ValidationError as error:
            place = re.search(r"at `\$(.*)`$", str(error))
            for name, index in re.findall(r"\.(\w+)|\[(\d+)\]", place[1]) if place else ():
                path, hint, value = _inside(path, hint, value, name or int(index))
            raise self._bad(path, hint, value) from None

    def _prepared(self, hint: Any, value: Any, path: str) -> Any:
        """`value` as msgspec reads it: its keys are known, and no array of NumPy is in it."""
        inner, many = table_of(hint)
        if inner is None:
            free = _is_free_table(hint)
            return dict(_free_keys(value, path)) if free else self._leaf(hint, value, path)
        if many:
            if not isinstance(value, list | tuple):
                return value
            return [self._prepared(inner, v, f"{path}.{n}") for n, v in enumerate(value)]
        if isinstance(value, inner):
            value = vars(value)
        if not isinstance(value, Mapping):
            return value
        cls = _variant(inner, value, path)
        hints, paths, made = hints_of(cls), _paths_of(cls) if self.paths else {}, {}
        for name, given in value.items():
            inside = f"{path}.{name}" if path else name
            if name not in hints:
                raise self._unknown(inside, path, cls, value.get("type", ""))
            made[name] = self._prepared(hints[name], given, inside)
            if self.paths and name in paths:
                made[name] = _changed(made[name], paths[name], self.paths)
        # a class of several is none that msgspec knows
        # (its paths are changed already)
        return (
            made if cls is inner else _Decoder(self.root, None, self.python).decode(cls, made, path)
        )

    def _leaf(self, hint: Any, value: Any, path: str) -> Any:
        """A value that is no table, as Python's own; refused where no header could hold it."""
        if isinstance(value, np.ndarray | np.generic):
            value = value.tolist()
        if isinstance(value, list | tuple):
            several = [kind for kind in _kinds(hint) if typing.get_origin(kind) is tuple]
            item = typing.get_args(several[0])[0] if several else hint
            return [self._leaf(item, one, f"{path}.{place}") for place, one in enumerate(value)]
        if isinstance(value, os.PathLike):
            value = os.fspath(value)
        if isinstance(value, str):
            _check_text(value, path)
        elif isinstance(value, numbers.Real) and not isinstance(value, bool):
            value = int(value) if isinstance(value, numbers.Integral) else float(value)
            whole = isinstance(value, int)
            if abs(value) > _INT64_MAX and not self.python if whole else not math.isfinite(value):
                raise self._bad(path, hint, value)
        return value

    def _bad(self, path: str, hint: Any, value: Any) -> EvsError:
        """The error for a value that is not what it has to be."""
        inner, many = table_of(hint)
        if self.python:
            name = inner.__name__ if inner else ""
            expected = name and f"a tuple of {name}" if many else name and f"a {name}"
            return EvsError(f"{path} is {value!r}; give {expected or _in_words(hint, _PYTHON)}")
        if many:
            expected, got = f"an array of tables [[{path}]]", "a single value"
        else:
            expected, got = "a table" if inner else _in_words(hint, _FILE), _shown(value)
        return EvsError(f"at {path}: expected {expected}, got {got}")

    def _unknown(self, path: str, table: str, cls: type, word: str) -> EvsError:
        """The error for a key that does not exist, with the nearest that do."""
        if self.python:
            return unknown("key", path, [f"{table}.{name}" for name in hints_of(cls)])
        if hasattr(cls, "variants"):
            own = [name for base in cls.__mro__ for name in vars(base).get("__annotations__", ())]
            known = hints_of(cls).keys() - {"type"}
            has = ", ".join(name for name in dict.fromkeys(own) if name in known)
            return EvsError(f"at {path}: a {word} {table.split('.')[0]} has only: {has}")
        return _unknown_key(path, self.root)


def _inside(path: str, hint: Any, value: Any, key: str | int) -> tuple[str, Any, Any]:
    """Path, hint and value of a key of a table, or of an item of a list."""
    inside = f"{path}.{key}" if path else str(key)
    if isinstance(key, str):
        cls = next(kind for kind in _kinds(hint) if is_dataclass(kind))
        given = value[key] if isinstance(value, Mapping) else getattr(value, key)
        return inside, hints_of(cls)[key], given  # type: ignore[arg-type]
    items = next(typing.get_args(k) for k in _kinds(hint) if typing.get_origin(k) is tuple)
    return inside, items[0 if items[1:] == (...,) else key], value[key]


def _changed(value: Any, is_path: Callable[[str], bool], change: PathChange) -> Any:
    """The paths of a key in another form; what is no text is refused later."""
    if isinstance(value, list):
        return [_changed(item, is_path, change) for item in value]
    return change(value) if isinstance(value, str) and value and is_path(value) else value


def _check_text(text: str, path: str) -> None:
    """Refuse a text that names of files, models and messages cannot hold."""
    try:
        text.encode()
    except UnicodeEncodeError:
        raise EvsError(f"at {path}: {text!a} is not UTF-8 text") from None
    if "\0" in text:
        raise EvsError(f"at {path}: {_shown(text)} has a null character; leave it out")


def _put(
    cls: type, table: dict[str, Any], parts: list[str], text: str, path: str, root: type
) -> None:
    """Set a dotted key of a table from the text of a command line."""
    name, rest = parts[0], parts[1:]
    inside = f"{path}.{name}" if path else name
    hint = hints_of(cls).get(name)
    inner, many = table_of(hint)
    if _is_free_table(hint):
        if not rest:
            raise EvsError(f"at {inside}: is a table; set one of its keys, as in {inside}.KEY=")
        value = _read_text(text, str | None)
        table[name] = {k: v for k, v in table.get(name, {}).items() if k != ".".join(rest)}
        table[name] |= {} if value is None else {".".join(rest): value}
    elif text.lower() == "none" and hasattr(cls, "variants"):
        # as if the table did not have the key
        table.pop(name, None)
    elif hint is None and hasattr(cls, "variants") and not rest:
        # refused later, with the keys that a table of its type has
        table[name] = text
    elif hint is None or (inner is None and rest):
        raise _unknown_key(".".join([inside, *rest]), root)
    elif inner is None:
        table[name] = _read_text(text, hint)
    elif not rest:
        example = f"{inside}.N." if many else f"{inside}."
        keys = dict.fromkeys(key for kind in variants_of(inner) for key in hints_of(kind))
        names = ", ".join(example + key for key in keys)
        raise EvsError(f"at {inside}: is a table; set one of its keys: {names}")
    elif many:
        items, place = (
            table.setdefault(name, []),
            int(rest[0]) if re.fullmatch("[0-9]{1,5}", rest[0]) else -1,
        )
        if not 0 <= place <= len(items) or len(rest) < 2:
            first = next(iter(hints_of(variants_of(inner)[0])))
            raise EvsError(
                f"at {inside}.{rest[0]}: expected a place 0 ... {len(items)} and a key, as in "
                f"{inside}.{len(items)}.{first}"
            )
        items += [{}] if place == len(items) else []
        kind = inner if rest[1] == "type" else _variant(inner, items[place], f"{inside}.{place}")
        _put(kind, items[place], rest[1:], text, f"{inside}.{place}", root)
    else:
        _put(inner, table.setdefault(name, {}), rest, text, inside, root)


def _free_keys(table: Any, path: str, prefix: str = "") -> Iterator[tuple[str, str]]:
    """Dotted key and text of a table of free keys."""
    if not isinstance(table, Mapping):
        raise EvsError(f"at {path}: expected a table, got {_shown(table)}")
    for key, value in table.items():
        if isinstance(value, Mapping):
            yield from _free_keys(value, path, f"{prefix}{key}.")
        elif isinstance(value, str):
            _check_text(value, f"{path}.{prefix}{key}")
            yield prefix + key, value
        else:
            raise EvsError(f"at {path}.{prefix}{key}: expected a string, got {_shown(value)}")


def _read_text(text: str, annotation: Any) -> Any:
    """A plain value from command-line text; text that fits no type stays a string."""
    kinds = _kinds(annotation)
    if type(None) in kinds and text.lower() == "none":
        return None
    if bool in kinds and text.lower() in ("true", "on", "false", "off"):
        return text.lower() in ("true", "on")
    if str in kinds:
        quoted = _toml_value(text) if text[:1] in ('"', "'") and text else None
        return quoted if isinstance(quoted, str) else text
    value = _toml_value(text)
    if isinstance(value, (bool, int, float, list)) and _fits_shape(value, kinds):
        return value
    # a,b for ["a", "b"]
    if any(typing.get_args(kind)[:1] == (str,) for kind in kinds):
        return [word.strip() for word in text.split(",") if word.strip()]
    # 1,2,3 for [1,2,3]
    if any(typing.get_origin(kind) is tuple for kind in kinds):
        several = _toml_value(f"[{text}]")
        return several if isinstance(several, list) else text
    # .5 and 5. are no TOML, but people write them
    if float in kinds:
        try:
            return float(text)
        except ValueError:
            return text
    return text if value is None else value


def _fits_shape(value: Any, kinds: tuple[Any, ...]) -> bool:
    wants_list = any(typing.get_origin(kind) is tuple for kind in kinds)
    return isinstance(value, list) == wants_list


def _toml_value(text: str) -> Any:
    """The TOML value that the text is, None if it is none (or more than one)."""
    try:
        tables = tomllib.loads(f"value = {text}")
    except (ValueError, RecursionError):
        return None
    return tables["value"] if set(tables) == {"value"} else None


def _is_free_table(annotation: Any) -> bool:
    """Whether the annotation is Mapping[str, str], a table of free keys."""
    return typing.get_origin(annotation) is Mapping


def _kinds(annotation: Any) -> tuple[Any, ...]:
    """The alternatives of a union, or the annotation alone."""
    if typing.get_origin(annotation) in (types.UnionType, typing.Union):
        return typing.get_args(annotation)
    return (annotation,)


_FILE = {
    int: "an integer",
    float: "a finite number",
    bool: "true or false",
    str: "a string",
    types.NoneType: "none",
}
_PYTHON = {
    int: "a whole number",
    float: "a finite number",
    bool: "True or False",
    str: "a name",
    types.NoneType: "None",
}


def _in_words(hint: Any, words: Mapping[Any, str]) -> str:
    return " or ".join(words.get(kind) or _items_in_words(kind, words) for kind in _kinds(hint))


def _items_in_words(kind: Any, words: Mapping[Any, str]) -> str:
    items = typing.get_args(kind)
    plural = "strings" if items[0] is str else "numbers"
    if words is _PYTHON:
        plural = {int: "whole numbers", float: "finite numbers", str: "names"}[items[0]]
    return plural if items[1:] == (...,) else f"{len(items)} {plural}"


def _shown(value: Any) -> str:
    """How a bad value looks in a message: as TOML has it, and not too long."""
    if isinstance(value, Mapping):
        return "a table"
    if type(value) is int and value.bit_length() > 200:
        # Python itself refuses to write one of thousands of digits
        return f"one of {value.bit_length()} bits"
    text = _quoted(value) if isinstance(value, str) else to_text(value)
    return text if len(text) <= 60 else text[:57] + "..."


def _quoted(text: str) -> str:
    # TOML's basic strings are JSON's, but for DEL, which TOML wants escaped
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")


def _unknown_key(path: str, root: type) -> EvsError:
    """The error for a key that does not exist: its path and the nearest that does."""
    # places in arrays stand as N in the known names: take over the digits of the path
    places = [part for part in path.split(".") if part.isdecimal()]
    known = []
    for name in key_names(root):
        for place in places:
            name = name.replace(".N.", f".{place}.", 1)
        known.append(name)
    return EvsError(f"at {path}: unknown key; nearest known: {nearest_first(path, known)[0]}")
