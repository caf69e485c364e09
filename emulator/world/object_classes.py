"""Classes of what a scene shows: one for each object, or by patterns that a user gives."""

from __future__ import annotations

from collections.abc import Sequence
from fnmatch import fnmatchcase
from typing import NamedTuple

import mujoco
import numpy as np
from mujoco import MjModel

from evs.emulator.base.scene import I32
from evs.msgs.errors import EvsError, nearest_first


class ObjectClasses(NamedTuple):
    """Classes of everything that has a geom_id."""

    names: tuple[str, ...]
    """of the classes, in the order in which the model has them"""
    of_geom: I32
    """class of each geom_id, whose negative values count from the end, as NumPy's do; -1 nothing"""


class _Thing(NamedTuple):
    """What one geom_id stands for."""

    kind: mujoco.mjtObj
    number: int
    body: int
    """-1: it hangs on many bodies"""


def object_classes(model: MjModel, patterns: Sequence[str] = ()) -> ObjectClasses:
    """Divide what a model shows into classes.

    A thing's class is the first of `patterns` that matches its name, or that of a body that carries
    it. Without one it is the body that stands in the world itself, such as the whole robot, and a
    geom or a site of the world is a class by itself; so are skins, flexes, tendons and
    slider-cranks, which hang on many bodies.

    Args:
        model: The compiled model.
        patterns: NAME=PATTERN: a class, and the names that belong to it, with *, ? and [].

    Returns:
        Names of the classes, and the class of each geom_id.

    Raises:
        EvsError: A pattern has another form, or matches nothing that an earlier one does not.
    """
    rules = [_rule(text) for text in patterns]
    used: set[int] = set()
    numbers: dict[str, int] = {}
    candidates: set[str] = set()

    def number_of(thing: _Thing) -> int:
        own = _name(model, thing.kind, thing.number)
        carriers = [_name(model, mujoco.mjtObj.mjOBJ_BODY, body) for body in _up(model, thing.body)]
        candidates.update((own, *carriers))
        for index, (name, pattern) in enumerate(rules):
            if any(fnmatchcase(candidate, pattern) for candidate in (own, *carriers)):
                used.add(index)
                return numbers.setdefault(name, len(numbers))
        # the last carrier before the world
        default = carriers[-1] if carriers else own
        return numbers.setdefault(default, len(numbers))

    geoms, others = _things(model)
    found = [number_of(thing) for thing in geoms]
    # geom_id -1 is nothing, -2 the first of the others
    behind = [-1, *(number_of(thing) if _is_drawn(model, thing) else -1 for thing in others)]
    for index, text in enumerate(patterns):
        if index not in used:
            there = ", ".join(nearest_first(text.partition("=")[2], candidates)[:12])
            raise EvsError(f"at model.classes: '{text}' matches nothing else; there is: {there}")
    return ObjectClasses(tuple(numbers), np.array([*found, *reversed(behind)], np.int32))


def _rule(text: str) -> tuple[str, str]:
    name, equals, pattern = str(text).partition("=")
    if not (equals and name and pattern and name.isprintable()):
        raise EvsError(
            f"at model.classes: '{text}' is not NAME=PATTERN; for example 'hand=finger*'"
        )
    return name, pattern


def _things(model: MjModel) -> tuple[list[_Thing], list[_Thing]]:
    """The geoms, and what has geom_id -2, -3 and so on."""
    kinds = mujoco.mjtObj

    def things(
        kind: mujoco.mjtObj, count: int, bodies: Sequence[int] | None = None
    ) -> list[_Thing]:
        return [_Thing(kind, i, -1 if bodies is None else int(bodies[i])) for i in range(count)]

    return things(kinds.mjOBJ_GEOM, model.ngeom, model.geom_bodyid), [
        *things(kinds.mjOBJ_SKIN, model.nskin),
        *things(kinds.mjOBJ_FLEX, model.nflex),
        *things(kinds.mjOBJ_SITE, model.nsite, model.site_bodyid),
        *things(kinds.mjOBJ_TENDON, model.ntendon),
        *things(kinds.mjOBJ_ACTUATOR, model.nu),
    ]


def _is_drawn(model: MjModel, thing: _Thing) -> bool:
    """Of actuators, slider-cranks are drawn alone."""
    if thing.kind != mujoco.mjtObj.mjOBJ_ACTUATOR:
        return True
    return bool(model.actuator_trntype[thing.number] == mujoco.mjtTrn.mjTRN_SLIDERCRANK)


def _up(model: MjModel, body: int) -> list[int]:
    """A body and those that carry it, without the world."""
    found: list[int] = []
    while body > 0:
        found.append(body)
        body = int(model.body_parentid[body])
    return found


def _name(model: MjModel, kind: mujoco.mjtObj, index: int) -> str:
    plain = kind.name.removeprefix("mjOBJ_").lower()
    return mujoco.mj_id2name(model, kind, index) or f"{plain} {index}"
