"""Settings: TOML and `dotted.key=value` into frozen dataclasses, with the path to a bad value.

Generic: knows nothing of cameras. A class maps to a table, a field to a key, a field of type
tuple[SomeDataclass, ...] to an array of tables, a field of type Mapping[str, str] to a table whose
keys are free, dotted where it has tables inside. A field's documentation is the string below it.
"""

from __future__ import annotations

import dataclasses
import json
import math
import tomllib
import types
import typing
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, TypeVar

from evs.emulator.base.small_files import read_small_text
from evs.msgs import EvsError, nearest_first

T = TypeVar("T")

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
    return parse_toml(text, str(path))


def parse_toml(text: str, source: str) -> dict[str, Any]:
    """The tables of a TOML text; `source` names it in errors, which carry line and column."""
    try:
        return tomllib.loads(text)
    except ValueError as reason:
        # also Python's own, for an integer of thousands of digits
        raise EvsError(f"{source}: malformed TOML: {reason}") from None
    except RecursionError:
        raise EvsError(f"{source}: malformed TOML: brackets are nested too deep") from None


def build(cls: type[T], tables: Mapping[str, Any]) -> T:
    """An instance of a configuration class from plain tables; keys that are absent keep defaults.

    Raises EvsError with the dotted path: an unknown key (and the nearest known), a wrong type.
    """
    made: T = _build(cls, tables, "", cls)
    return made


def override(config: T, key: str, text: str) -> T:
    """A copy of `config` with one dotted key set from the text of a command line.

    Text is read as the key's type wants it: `true`, `4`, `1e-3`, `1,2,3` or `[1, 2, 3]`, a bare or
    quoted string, `none` where a key may be absent. `list.N.key` reaches into an array of tables,
    and N = its length appends one.
    """
    root = type(config)
    changed: T = _override(config, key.split("."), text, "", root)
    return changed


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


def to_plain(config: Any) -> Any:
    """Plain values (dict, list, str, int, float, bool, None) of a configuration, ready for JSON."""
    if dataclasses.is_dataclass(config) and not isinstance(config, type):
        return {f.name: to_plain(getattr(config, f.name)) for f in dataclasses.fields(config)}
    if isinstance(config, Mapping):
        return {key: to_plain(value) for key, value in config.items()}
    if isinstance(config, (tuple, list)):
        return [to_plain(item) for item in config]
    return config


def key_names(cls: type, prefix: str = "") -> Iterator[str]:
    """Every dotted name of a class and its tables; `N` stands for a place in an array of tables."""
    for name, annotation in typing.get_type_hints(cls).items():
        path = prefix + name
        yield path
        inner, many = _table_of(annotation)
        if inner is not None:
            yield from key_names(inner, f"{path}.N." if many else f"{path}.")


def _build(cls: type[Any], tables: Any, path: str, root: type) -> Any:
    if not isinstance(tables, Mapping):
        raise EvsError(f"at {path}: expected a table, got {_shown(tables)}")
    hints = typing.get_type_hints(cls)
    values = {}
    for name, value in tables.items():
        inside = f"{path}.{name}" if path else name
        if name not in hints:
            raise _unknown_key(inside, root)
        values[name] = _convert(value, hints[name], inside, root)
    return cls(**values)


def _convert(value: Any, annotation: Any, path: str, root: type) -> Any:
    """`value` as the annotation has it, or EvsError with the path."""
    inner, many = _table_of(annotation)
    if inner is not None and many:
        if not isinstance(value, (list, tuple)):
            raise EvsError(f"at {path}: expected an array of tables [[{path}]], got a single value")
        return tuple(_build(inner, item, f"{path}.{i}", root) for i, item in enumerate(value))
    if inner is not None:
        return _build(inner, value, path, root)
    if _is_free_table(annotation):
        return dict(_free_keys(value, path))
    return _convert_value(value, annotation, path, root)


def _convert_value(value: Any, annotation: Any, path: str, root: type) -> Any:
    """The same for what is no table."""
    kinds = _kinds(annotation)
    if value is None and type(None) in kinds:
        return None
    for kind in kinds:
        if typing.get_origin(kind) is tuple and isinstance(value, (list, tuple)):
            kind_args = typing.get_args(kind)
            if kind_args[1:] == (...,):
                kind_args = kind_args[:1] * len(value)
            if len(value) == len(kind_args):
                items = enumerate(zip(value, kind_args, strict=True))
                return tuple(_convert(v, k, f"{path}.{i}", root) for i, (v, k) in items)
        elif kind is float and _is_number(value) and math.isfinite(value):
            return float(value)
        elif kind is str and type(value) is str:
            return _text(value, path)
        elif (kind is int and _is_integer(value)) or (kind is bool and type(value) is bool):
            return value
    expected = " or ".join(_in_words(kind) for kind in kinds)
    raise EvsError(f"at {path}: expected {expected}, got {_shown(value)}")


def _text(value: str, path: str) -> str:
    """A text that names of files, models and messages can hold; EvsError with its path."""
    try:
        value.encode()
    except UnicodeEncodeError:
        raise EvsError(f"at {path}: {value!a} is not UTF-8 text") from None
    if "\0" in value:
        raise EvsError(f"at {path}: {_shown(value)} has a null character; leave it out")
    return value


def _override(config: Any, parts: list[str], text: str, path: str, root: type) -> Any:
    name, rest = parts[0], parts[1:]
    inside = f"{path}.{name}" if path else name
    hints = typing.get_type_hints(type(config))
    if name not in hints:
        raise _unknown_key(".".join([inside, *rest]), root)
    inner, many = _table_of(hints[name])
    value: Any
    if _is_free_table(hints[name]):
        value = _override_free(getattr(config, name), ".".join(rest), text, inside)
    elif inner is None:
        if rest:
            raise _unknown_key(".".join([inside, *rest]), root)
        value = _convert(_read_text(text, hints[name]), hints[name], inside, root)
    elif not rest:
        example = f"{inside}.N." if many else f"{inside}."
        names = ", ".join(example + f.name for f in dataclasses.fields(inner))
        raise EvsError(f"at {inside}: is a table; set one of its keys: {names}")
    elif many:
        value = _override_item(getattr(config, name), inner, rest, text, inside, root)
    else:
        value = _override(getattr(config, name), rest, text, inside, root)
    return dataclasses.replace(config, **{name: value})


def _override_free(table: Mapping[str, str], key: str, text: str, path: str) -> dict[str, str]:
    """A table of free keys with one set, or without it where the text is `none`."""
    if not key:
        raise EvsError(f"at {path}: is a table; set one of its keys, as in {path}.KEY=")
    others = {name: value for name, value in table.items() if name != key}
    value = _read_text(text, str | None)
    return others if value is None else {**others, key: value}


def _free_keys(table: Any, path: str, prefix: str = "") -> Iterator[tuple[str, str]]:
    """Dotted key and text of a table of free keys."""
    if not isinstance(table, Mapping):
        raise EvsError(f"at {path}: expected a table, got {_shown(table)}")
    for key, value in table.items():
        if isinstance(value, Mapping):
            yield from _free_keys(value, path, f"{prefix}{key}.")
        elif isinstance(value, str):
            yield prefix + key, _text(value, f"{path}.{prefix}{key}")
        else:
            raise EvsError(f"at {path}.{prefix}{key}: expected a string, got {_shown(value)}")


def _override_item(
    items: tuple[Any, ...], cls: type, parts: list[str], text: str, path: str, root: type
) -> tuple[Any, ...]:
    """Set a key of one table of an array of tables; a place just past the end appends."""
    place = int(parts[0]) if parts[0].isdecimal() and len(parts[0]) < 6 else -1
    if not 0 <= place <= len(items) or len(parts) < 2:
        example = f"{path}.{len(items)}.{dataclasses.fields(cls)[0].name}"
        raise EvsError(
            f"at {path}.{parts[0]}: expected a place 0 ... {len(items)} and a key, as in {example}"
        )
    item = items[place] if place < len(items) else cls()
    changed = _override(item, parts[1:], text, f"{path}.{place}", root)
    return (*items[:place], changed, *items[place + 1 :])


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


def _table_of(annotation: Any) -> tuple[type | None, bool]:
    """(dataclass behind the annotation or None, whether it is tuple[dataclass, ...])."""
    if dataclasses.is_dataclass(annotation) and isinstance(annotation, type):
        return annotation, False
    arguments = typing.get_args(annotation)
    if typing.get_origin(annotation) is tuple and len(arguments) == 2 and arguments[1] is ...:
        return _table_of(arguments[0])[0], True
    return None, False


def _is_free_table(annotation: Any) -> bool:
    """Whether the annotation is Mapping[str, str], a table of free keys."""
    return typing.get_origin(annotation) is Mapping


def _kinds(annotation: Any) -> tuple[Any, ...]:
    """The alternatives of a union, or the annotation alone."""
    if typing.get_origin(annotation) in (types.UnionType, typing.Union):
        return typing.get_args(annotation)
    return (annotation,)


def _is_integer(value: Any) -> bool:
    """An integer that fits int64, as every counter and seed of ours is."""
    return type(value) is int and abs(value) <= _INT64_MAX


def _is_number(value: Any) -> bool:
    return isinstance(value, float) or _is_integer(value)


def _in_words(kind: Any) -> str:
    words = {int: "an integer", float: "a finite number", bool: "true or false", str: "a string"}
    if kind in words:
        return words[kind]
    if kind is type(None):
        return "none"
    inner = typing.get_args(kind)
    several = "strings" if inner[:1] == (str,) else "numbers"
    return several if inner[1:] == (...,) else f"{len(inner)} {several}"


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
