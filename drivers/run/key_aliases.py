"""The one layer of aliases: keys that stand for others, in a file or on the command line.

Reports, headers and old pipeline files keep the keys that these stand for.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from evs.msgs import EvsError

WORKER = {"worker": "aside", "worker_mb": "aside_mb", "worker_cores": "aside_cores"}
"""a key of a sink -> the one that it stands for; `worker` is a key of a whole pipeline, too"""

PUBLISH = {
    "publish": "address",
    "publish_wait_for": "wait_for",
    "publish_wait_s": "wait_s",
    "publish_control": "control",
    "publish_key": "key",
    "publish_allow": "allow",
    "publish_insecure": "insecure",
}
"""a key of a pipeline -> the key of the zmq sink that they describe together"""


def resolved_key(key: str) -> str:
    """Return the dotted key that a dotted key stands for; itself where it is no alias."""
    path, dot, last = key.rpartition(".")
    if not path or path.startswith("sink."):
        return f"{path}{dot}{WORKER.get(last, last) if path or last == 'worker' else last}"
    return key


def resolved_tables(tables: Mapping[str, Any]) -> dict[str, Any]:
    """Return a pipeline's tables without aliases. EvsError where one key is given by two names."""
    found = _resolved(tables, {"worker": WORKER["worker"]}, "")
    sinks = found.get("sink")
    if isinstance(sinks, list | tuple):
        found["sink"] = [
            _resolved(sink, WORKER, f"sink.{place}.") if isinstance(sink, Mapping) else sink
            for place, sink in enumerate(sinks)
        ]
    return found


def _resolved(table: Mapping[str, Any], aliases: Mapping[str, str], path: str) -> dict[str, Any]:
    for alias, key in aliases.items():
        if alias in table and key in table:
            raise EvsError(f"at {path}{alias}: {path}{key} is the same key; give one of them")
    return {aliases.get(key, key): value for key, value in table.items()}
