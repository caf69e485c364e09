"""Launch files: which programs run together, in what order, and what happens when one ends.

TOML: [arg] names with defaults, [need] names that have none, [bus] addresses, [[node]] programs. In
a node's words {NAME} stands for an argument or an address, {NAME...} for as many words as it has,
{{ and }} for braces.
"""

from __future__ import annotations

import re
import shlex
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from evs.drivers.bus.address import free_address
from evs.emulator.base.small_files import is_file
from evs.emulator.config import decoding
from evs.msgs import EvsError, nearest_first, unknown

LAUNCH_FILES = Path(__file__).parents[3] / "config" / "launch"
"""the launch files that come with evs; each is found by its bare name too"""

ON_EXIT = ("go_on", "restart", "end")
"""what follows when a node ends"""

ANY_PORT = "auto"
"""a bus at this address gets a port of this machine that is free"""

_NAME = re.compile(r"[A-Za-z_]\w*")
_PLACEHOLDER = re.compile(r"\{\{|\}\}|\{([^{}]*)\}")
_WORDS_PLACEHOLDER = re.compile(r"\{([^{}]*)\.\.\.\}")
_COMPARISON = re.compile(r"(.*?)\s*(==|!=)\s*(.*)", re.DOTALL)
_TRUE, _FALSE = ("true", "on", "yes", "1"), ("false", "off", "no", "0")
_OWN = ("here",)
"""names that every file has: here, its folder"""
_WAITING = {
    "emulate": ("publish_wait_for={count}", "publish_wait_s=60"),
    "loop": ("publish_wait_for={count}", "publish_wait_s=60"),
    "play": ("--wait-for", "{count}", "--wait", "60"),
}
"""commands of ours that publish -> their words to wait for subscribers"""
_PUBLISHING = ("--publish", "publish")
"""emulate, loop: without one of these the pipeline itself publishes, and sets how it waits"""
_WAITS = ("--wait-for", "publish_wait_for")
"""a node with one of these sets itself how many it waits for"""


@dataclass(frozen=True)
class NodeConfig:
    """[[node]]: one program."""

    name: str = ""
    """what it is called in what is printed; its own"""
    run: tuple[str, ...] = ()
    """its words; the first is a program: evs, python (this one) or any other"""
    publishes: tuple[str, ...] = ()
    """buses that it publishes on: it starts after all that subscribe to them"""
    subscribes: tuple[str, ...] = ()
    """buses that it listens to"""
    remap: tuple[str, ...] = ()
    """names that mean others in this node, as in events:=left"""
    when: str = "true"
    """a condition, often an argument: X, not X, A == B or A != B; false leaves it out"""
    env: tuple[str, ...] = ()
    """NAME=VALUE each: added to its environment"""
    folder: str = ""
    """where it runs; empty: where the launch does"""
    delay_s: float = 0.0
    """how long after the launch it starts, s"""
    on_exit: str = "go_on"
    """when it ends: go_on | restart it if it failed | end the launch"""
    restarts: int = 3
    """restart: how often at most; then the launch ends"""
    restart_s: float = 1.0
    """restart: how long to wait before, s"""
    stop_s: float = 10.0
    """how long it may take to stop after Ctrl-C, s; then it is killed"""


@dataclass(frozen=True)
class _File:
    """What `decoding` reads of a launch file."""

    node: tuple[NodeConfig, ...] = ()


@dataclass(frozen=True)
class LaunchPlan:
    """The nodes in the order in which they start, every name in them resolved."""

    nodes: tuple[NodeConfig, ...]
    arguments: Mapping[str, str]
    """every name and what it stands for"""


def find_launch_file(word: str) -> Path:
    """Find a launch file: a path, or the name of one that comes with evs."""
    path = Path(word)
    known = {file.stem: file for file in sorted(LAUNCH_FILES.glob("*.toml"))}
    if is_file(path):
        return path
    if word in known:
        return known[word]
    names = ", ".join(nearest_first(path.stem, known))
    raise EvsError(f"no launch file '{word}'; evs itself comes with: {names}")


def read_plan(file: str, given: Iterable[str] = ()) -> LaunchPlan:
    """Read the plan of a launch file; nothing is started.

    Args:
        file: A path, or the name of a file that comes with evs.
        given: Arguments, `NAME:=VALUE` each.

    Returns:
        The plan, with every name resolved.

    Raises:
        EvsError: With the path to the wrong key.
    """
    path = find_launch_file(file)
    try:
        return _plan(decoding.read_toml(path), path, given)
    except EvsError as error:
        raise EvsError(f"{path}: {str(error).removeprefix(f'{path}: ')}") from None


def _plan(tables: dict[str, Any], path: Path, given: Iterable[str]) -> LaunchPlan:
    names = {key: _table(tables, key) for key in ("arg", "need", "bus")}
    known = [name for table in names.values() for name in table]
    for name in (*known, *_OWN):
        if not _NAME.fullmatch(name) or [*known, *_OWN].count(name) > 1:
            raise EvsError(f"'{name}' is not a valid, unique name: give letters, digits and _")
    values = {"here": str(path.parent.resolve()), **names["arg"]}
    for word in given:
        name, separator, text = word.partition(":=")
        if not separator:
            raise EvsError(f"'{word}' is not NAME:=VALUE")
        if name not in known:
            raise unknown("argument", name, known)
        (names["bus"] if name in names["bus"] else values)[name] = text
    missing = [name for name in names["need"] if name not in values]
    if missing:
        raise EvsError(f"it needs {missing[0]}:=VALUE: {names['need'][missing[0]]}")
    # an address may be made of arguments
    buses = {name: _substitute(text, values, f"bus.{name}") for name, text in names["bus"].items()}
    values |= {n: free_address() if text == ANY_PORT else text for n, text in buses.items()}
    rest = {key: value for key, value in tables.items() if key not in names}
    nodes = decoding.build(_File, rest).node
    resolved = [_resolved(node, f"node.{i}", values, list(buses)) for i, node in enumerate(nodes)]
    running = [node for node in resolved if node is not None]
    if not running:
        raise EvsError("no [[node]] to run")
    _check_names([node.name for node in running])
    waiting = [_waiting(node, running) for node in running]
    return LaunchPlan(tuple(_in_order(waiting)), values)


def _table(tables: dict[str, Any], key: str) -> dict[str, str]:
    table = tables.get(key, {})
    if not isinstance(table, dict):
        raise EvsError(f"at {key}: expected a table [{key}]")
    for name, value in table.items():
        if not isinstance(value, (str, int, float, bool)):
            raise EvsError(f"at {key}.{name}: expected one value, as a string or a number")
    return {n: v if isinstance(v, str) else decoding.to_text(v) for n, v in table.items()}


def _resolved(
    node: NodeConfig, at: str, values: Mapping[str, str], buses: list[str]
) -> NodeConfig | None:
    """Return the node with every name replaced by its value; None if its condition is false."""
    meant = {name: name for name in buses} | _remapped(node, at, values)
    own = {**values, **{name: values[other] for name, other in meant.items()}}
    if not _is_true(node.when, own, f"{at}.when"):
        return None
    _check_node(node, at)
    ends = []
    for key in ("publishes", "subscribes"):
        for name in getattr(node, key):
            if meant.get(name) not in buses:
                raise _at(f"{at}.{key}", unknown("bus", name, buses))
        ends.append(tuple(meant[name] for name in getattr(node, key)))
    run = _substitute_words(node.run, own, f"{at}.run")
    if not run or not run[0]:
        raise EvsError(f"at {at}.run: missing; give the program and its words")
    env = _substitute_words(node.env, own, f"{at}.env")
    folder = _substitute(node.folder, own, f"{at}.folder")
    _check_surroundings(env, folder, at)
    publishes, subscribes = ends
    return replace(
        node,
        name=_substitute(node.name, own, f"{at}.name") or Path(run[0]).name,
        run=run,
        env=env,
        folder=folder,
        publishes=publishes,
        subscribes=subscribes,
    )


def _remapped(node: NodeConfig, at: str, values: Mapping[str, str]) -> dict[str, str]:
    """Name in this node -> name in the file."""
    found = {}
    for word in node.remap:
        name, separator, other = word.partition(":=")
        if not separator or not _NAME.fullmatch(name):
            raise EvsError(f"at {at}.remap: '{word}' is not NAME:=OTHER")
        if other not in values:
            raise _at(f"{at}.remap", unknown("name", other, values))
        found[name] = other
    return found


def _check_node(node: NodeConfig, at: str) -> None:
    if node.on_exit not in ON_EXIT:
        raise _at(f"{at}.on_exit", unknown("on_exit", node.on_exit, ON_EXIT))
    for key in ("restarts", "restart_s", "stop_s", "delay_s"):
        if getattr(node, key) < 0:
            raise EvsError(f"at {at}.{key}: give 0 or more")


def _check_surroundings(env: tuple[str, ...], folder: str, at: str) -> None:
    for i, word in enumerate(env):
        name, separator, _ = word.partition("=")
        if not separator or not _NAME.fullmatch(name):
            raise EvsError(f"at {at}.env.{i}: '{word}' is not NAME=VALUE")
    if folder and not Path(folder).is_dir():
        raise EvsError(f"at {at}.folder: there is no folder '{folder}'")


def _waiting(node: NodeConfig, nodes: list[NodeConfig]) -> NodeConfig:
    """Return the node; a camera of ours gets the option to wait for its subscribers."""
    count = sum(bool(set(node.publishes) & set(other.subscribes)) for other in nodes)
    command = node.run[1] if node.run[0] == "evs" and len(node.run) > 1 else ""
    options = _WAITING.get(command, ())
    keys = {word.partition("=")[0] for word in node.run}
    if (
        not count
        or keys & set(_WAITS)
        or (command in ("emulate", "loop") and not keys & set(_PUBLISHING))
    ):
        return node
    return replace(node, run=(*node.run, *(word.format(count=count) for word in options)))


def _in_order(nodes: list[NodeConfig]) -> list[NodeConfig]:
    """Sort subscribers before publishers, else as in the file. EvsError where there is a circle."""
    left, ordered = list(nodes), []
    while left:
        first = [
            node
            for node in left
            if not any(
                set(node.publishes) & set(other.subscribes) for other in left if other is not node
            )
        ]
        if not first:
            names = ", ".join(node.name for node in left)
            raise EvsError(f"{names} subscribe to each other in a circle: none can start first")
        ordered.append(first[0])
        left.remove(first[0])
    return ordered


def _check_names(names: list[str]) -> None:
    for name in names:
        if not name.isprintable():
            raise EvsError(f"{name!r} is no name of a node: give it one that can be printed")
        if names.count(name) > 1:
            raise EvsError(f"two nodes are named '{name}': give each its own name")


def _at(path: str, error: EvsError) -> EvsError:
    return EvsError(f"at {path}: {error}")


def _substitute(text: str, values: Mapping[str, str], at: str) -> str:
    """Replace every {NAME} by its value, {{ and }} by braces.

    Args:
        text: Of the launch file.
        values: Name -> value.
        at: Path of the key, for errors.
    """

    def one(found: re.Match[str]) -> str:
        if found[0] in ("{{", "}}"):
            return found[0][0]
        return _value(found[1], values, at)

    return _PLACEHOLDER.sub(one, text)


def _substitute_words(words: Iterable[str], values: Mapping[str, str], at: str) -> tuple[str, ...]:
    """Substitute in each word; {NAME...} becomes the words of its value, as a shell splits it."""
    done: list[str] = []
    for i, word in enumerate(words):
        here = f"{at}.{i}"
        spread = _WORDS_PLACEHOLDER.fullmatch(word)
        if spread is None:
            done.append(_substitute(word, values, here))
            continue
        text = _value(spread[1], values, here)
        try:
            done += shlex.split(text)
        except ValueError as reason:
            raise EvsError(f"at {here}: '{text}' cannot be split into words: {reason}") from None
    return tuple(done)


def _is_true(text: str, values: Mapping[str, str], at: str) -> bool:
    """Return whether a condition is true: X, not X, A == B or A != B."""
    compared = _COMPARISON.fullmatch(text)
    if compared is not None:
        left, right = (_substitute(compared[side].strip(), values, at) for side in (1, 3))
        return (left == right) == (compared[2] == "==")
    word = _substitute(text, values, at).strip()
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
