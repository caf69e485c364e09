"""Write a trained network: NAME.onnx, the streaming graph, and NAME.toml, its sidecar.

The sidecar holds what the graph cannot: name, tau_s, threshold, linlog_dn, tick_us, spp = [fewest,
most], look_ahead = [ticks of each convolution], events_per_tick, and a table [training] with the
origin of the network. emulator/evsnet/network_files.py reads both back.
"""

from __future__ import annotations

import contextlib
import json
import math
import re
from collections.abc import Mapping, Sequence
from numbers import Integral, Real
from pathlib import Path
from typing import Any

from evs.emulator.evsnet.onnx_graph import streaming_graph
from evs.emulator.evsnet.weights import NetworkWeights
from evs.msgs import EvsError


def export(
    weights: NetworkWeights, path: str | Path, training: Mapping[str, Any] | None = None
) -> tuple[Path, Path]:
    """Write the two files. Same weights and training, same bytes.

    Files that exist already stay complete until both are written.

    Args:
        weights: of the network.
        path: NAME.onnx.
        training: str, bool, int, float, sequences of them, and tables (Mapping) of them.

    Returns:
        The paths of the graph and of the sidecar.

    Raises:
        EvsError: another suffix, a folder that does not exist, a value that TOML does not know.
    """
    graph = Path(path)
    if graph.suffix != ".onnx":
        raise EvsError(f"cannot write a network to '{graph}': the name must end in .onnx")
    sidecar_text = sidecar(weights, training)
    contents = {graph: streaming_graph(weights), graph.with_suffix(".toml"): sidecar_text.encode()}
    parts = {target: target.with_name(f"{target.name}.part") for target in contents}
    try:
        # both are complete before either takes its place
        for target, part in parts.items():
            part.write_bytes(contents[target])
        for target, part in parts.items():
            part.replace(target)
    except OSError as reason:
        for part in parts.values():
            with contextlib.suppress(OSError):
                part.unlink()
        raise EvsError(f"cannot write the network '{graph}': {reason.strerror}") from None
    onnx, toml = parts
    return onnx, toml


def sidecar(weights: NetworkWeights, training: Mapping[str, Any] | None = None) -> str:
    """The text of NAME.toml. Every float reads back as the same bits."""
    look_ahead = [convolution.look_ahead for convolution in weights.convolutions]
    lines = [
        f"name = {_value('name', weights.name)}",
        f"tau_s = {_value('tau_s', float(weights.tau_s))}",
        f"threshold = {_value('threshold', float(weights.threshold))}",
        f"linlog_dn = {_value('linlog_dn', float(weights.linlog_dn))}",
        f"tick_us = {_value('tick_us', weights.tick_us)}",
        f"spp = {_value('spp', weights.spp)}",
        f"look_ahead = {_value('look_ahead', look_ahead)}",
        f"events_per_tick = {_value('events_per_tick', weights.events_per_tick)}",
    ]
    return "\n".join([*lines, *_table("training", training or {})]) + "\n"


def _table(path: str, table: Mapping[str, Any]) -> list[str]:
    """Plain values first, then each inner table under its own heading."""
    lines = ["", f"[{path}]"]
    inner: list[str] = []
    for key, value in table.items():
        name = key if re.fullmatch(r"[A-Za-z0-9_-]+", key, re.ASCII) else _text(key)
        if isinstance(value, Mapping):
            inner += _table(f"{path}.{name}", value)
        else:
            lines.append(f"{name} = {_value(f'{path}.{key}', value)}")
    return lines + inner


def _value(where: str, value: Any) -> str:
    """One value as TOML writes it; numbers of NumPy are numbers too."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, Integral) and abs(int(value)) < 2**63:
        return str(int(value))
    if isinstance(value, Real) and not isinstance(value, Integral) and math.isfinite(value):
        return repr(float(value))
    if isinstance(value, str):
        return _text(value)
    if isinstance(value, Sequence) and not isinstance(value, bytes):
        return f"[{', '.join(_value(where, entry) for entry in value)}]"
    raise EvsError(
        f"cannot write {where} = {value!r} to a sidecar; give text, finite numbers, lists or tables"
    )


def _text(text: str) -> str:
    # TOML's basic strings are JSON's, but for DEL (to be escaped) and lone surrogates (none)
    quoted = json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")
    return quoted.encode("utf-8", "replace").decode()
