"""Write the tuned pipeline: the keys that differ from the defaults, and why."""

from __future__ import annotations

import os
import textwrap
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from evs.drivers.run.config import PipelineConfig
from evs.emulator.config import decoding
from evs.msgs import EvsError

FIRST = "# Tuned by evs tune"
"""how such a file begins"""

WIDTH = 96


def pipeline_text(config: PipelineConfig, file: Path, why: Sequence[str]) -> str:
    """TOML that loads as this configuration from where `file` is.

    Paths are relative to the folder of the file.

    Args:
        config: the pipeline.
        file: where it will be written.
        why: lines of comment.
    """
    folder = file.resolve().parent
    config = decoding.build(
        PipelineConfig, decoding.to_plain(config), lambda text: _from(folder, text)
    )
    lines = [f"{FIRST}: {why[0]}" if why else FIRST]
    for line in why[1:]:
        lines += textwrap.wrap(line, WIDTH, initial_indent="# ", subsequent_indent="#   ")
    changed = _differences(decoding.to_plain(PipelineConfig()), decoding.to_plain(config))
    tables = {name: value for name, value in changed.items() if isinstance(value, Mapping)}
    arrays = {name: value for name, value in changed.items() if _is_array(value)}
    top = {k: v for k, v in changed.items() if k not in tables and k not in arrays}
    lines += ["", *_keys(top)] if top else []
    for name, table in tables.items():
        lines += _table(name, table)
    for name, array in arrays.items():
        for item in array:
            lines += ["", f"[[{name}]]", *_keys(_without_none(item))]
    return "\n".join(lines) + "\n"


def check_own(file: Path) -> None:
    """Raises EvsError where the file exists and was not written by evs tune."""
    if not file.is_file():
        return
    try:
        with file.open(encoding="utf-8", errors="replace") as opened:
            ours = opened.read(len(FIRST)) == FIRST
    except OSError as reason:
        raise EvsError(f"cannot read '{file}': {reason.strerror}") from None
    if not ours:
        raise EvsError(f"'{file}' is there and was not written by evs tune; give another with -o")


def _from(folder: Path, text: str) -> str:
    """A path relative to a folder; an absolute path stays."""
    return text if Path(text).is_absolute() else os.path.relpath(Path(text).absolute(), folder)


def _differences(before: Mapping[str, Any], after: Mapping[str, Any]) -> dict[str, Any]:
    """Values that differ, in the same nested tables."""
    found: dict[str, Any] = {}
    for key, value in after.items():
        if isinstance(value, Mapping):
            inner = _differences(before[key], value)
            if inner:
                found[key] = inner
        elif value != before.get(key):
            found[key] = value
    return found


def _is_array(value: Any) -> bool:
    return isinstance(value, list) and bool(value) and isinstance(value[0], Mapping)


def _table(name: str, table: Mapping[str, Any]) -> list[str]:
    """Lines of a table, of its inner tables and of its arrays of tables."""
    inner = {key: value for key, value in table.items() if isinstance(value, Mapping)}
    arrays = {key: value for key, value in table.items() if _is_array(value)}
    own = {k: v for k, v in table.items() if k not in inner and k not in arrays}
    lines = ["", f"[{name}]", *_keys(own)] if own else []
    for key, value in inner.items():
        lines += _table(f"{name}.{key}", value)
    for key, items in arrays.items():
        for item in items:
            lines += ["", f"[[{name}.{key}]]", *_keys(_without_none(item))]
    return lines


def _without_none(item: Mapping[str, Any]) -> dict[str, Any]:
    """Drop keys without a value: TOML has no null."""
    return {key: value for key, value in item.items() if value is not None}


def _keys(table: Mapping[str, Any]) -> list[str]:
    return [f"{key} = {_value(value)}" for key, value in table.items() if value is not None]


def _value(value: Any) -> str:
    # a list of one string is written as a list with quotes: a string in it likewise
    return decoding.to_text([value])[1:-1] if isinstance(value, str) else decoding.to_text(value)
