"""Identity: what a state was saved by, and whether it is the same that takes it back."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from evs.msgs import EvsError


def check_identity(saved: Mapping[str, Any], here: Mapping[str, Any]) -> None:
    """Check that a state is restored where it was saved.

    Args:
        saved: What it was saved by: plain values, nested. The key "model" is of MuJoCo's model.
        here: What restores it.

    Raises:
        EvsError: Something differs; the message has the first difference, its path and both values.
    """
    for path, ours, theirs in _differences("", saved, here):
        name = path.removeprefix(".")
        if name == "kind":
            raise EvsError(
                f"saved by a {_shown(ours)}, this is a {_shown(theirs)}: restore it where it was "
                "saved"
            )
        if name == "model":
            raise EvsError(
                f"saved by another model ({_shown(ours)}, not {_shown(theirs)}): restore it into "
                "a world of the same scene and tick"
            )
        raise EvsError(
            f"saved by another configuration: {name} was {_shown(ours)}, here it is "
            f"{_shown(theirs)}; restore it where it is the same"
        )


class _Nothing:
    """What one side does not have."""


def _differences(path: str, ours: Any, theirs: Any) -> Iterator[tuple[str, Any, Any]]:
    if isinstance(ours, Mapping) and isinstance(theirs, Mapping):
        for key in [*theirs, *(key for key in ours if key not in theirs)]:
            yield from _differences(
                f"{path}.{key}", ours.get(key, _Nothing), theirs.get(key, _Nothing)
            )
    elif isinstance(ours, list | tuple) and isinstance(theirs, list | tuple):
        if len(ours) != len(theirs):
            yield path, ours, theirs
            return
        for place, (one, other) in enumerate(zip(ours, theirs, strict=True)):
            yield from _differences(f"{path}.{place}", one, other)
    elif ours != theirs or isinstance(ours, bool) != isinstance(theirs, bool):
        yield path, ours, theirs


def _shown(value: Any) -> str:
    text = "nothing" if value is _Nothing else value if isinstance(value, str) else repr(value)
    text = " ".join(text.split())
    return text if len(text) <= 80 else f"{text[:77]}..."
