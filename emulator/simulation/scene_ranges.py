"""Randomised scenes: other lights, colours, cameras, masses and starts in every episode.

A range, see sensor/ranges.py, belongs to a key of the scene, see world/scene_keys.py:

    "light.*.brightness" = "uniform(0.3, 1)"       each light draws for itself
    "geom.floor.rgb" = "uniform(0, 1)"             and so does each of several numbers
    "body.pole.mass" = "uniform(0.5, 2) * nominal"
    "camera.left.pos" = "normal(0, 0.01) + nominal"
    "joint.hinge.qpos" = "uniform(-0.1, 0.1)"      where it starts
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from evs.emulator.sensor.ranges import (
    Key,
    Range,
    Ranges,
    bound_ranges,
    draw_values,
    refers_to,
)
from evs.emulator.world import (
    MjData,
    MjModel,
    Scene,
    SceneKey,
    SceneValues,
    Visual,
    every_key,
    find_keys,
    load_model,
    resolve_visual,
)
from evs.msgs import EvsError, unknown


@dataclass(frozen=True)
class DrawnScene:
    """What the scene of one episode has instead of the model's own values."""

    values: dict[str, float]
    """key of a single number -> the value that was drawn"""
    seed: int
    episode: int

    @property
    def record(self) -> dict[str, Any]:
        """Where it comes from and what was drawn, for headers and reports."""
        return {"seed": self.seed, "episode": self.episode, "values": dict(self.values)}


class SceneRanges:
    """Validated ranges of a scene's values; `draw` returns the values of an episode.

        ranges = SceneRanges({"body.pole.mass": "uniform(0.5, 2) * nominal"}, "robot.xml")
        world = evs.World("robot.xml")
        world.reset(seed=1, scene=ranges.draw(seed=1, episode=0).values)

    Equal arguments give equal values, in any process and on any machine.
    """

    def __init__(self, ranges: Ranges, scene: Scene, visual: Visual | None = None) -> None:
        """Check the ranges.

        Args:
            ranges: Key -> its range, as described above.
            scene: See `World`. An MjModel is only read; its present values are the nominal ones.
            visual: See `World`. Geoms that it hides have no colour.

        Raises:
            EvsError: No such object, attribute or distribution, a range beyond the limits of its
                key, two ranges for one number, or invalid values.
        """
        if not isinstance(ranges, Mapping):
            raise EvsError(
                f"randomise.scene is {ranges!r}; give {{'body.pole.mass': 'uniform(0.5, 2)', ...}}"
            )
        self.ranges = dict(ranges)
        """key -> its text, as given"""
        model, shown = load_model(scene), resolve_visual(visual)
        keys: dict[str, SceneKey] = {}
        written: dict[str, str] = {}
        for text in self.ranges:
            try:
                found = find_keys(model, text, shown)
            except EvsError as error:
                raise EvsError(f"at randomise.scene.{text}: {error}") from None
            for key in found:
                if key.name in keys:
                    raise EvsError(
                        f"at randomise.scene.{text}: {key.name} has a range already, that of "
                        f"{written[key.name]}; give it one"
                    )
                keys[key.name], written[key.name] = key, text
        refer = {name for text in self.ranges.values() if (name := refers_to(text))}
        every = every_key(model, shown) if refer else keys
        known = {
            name: Key(name, bool(words := key.words(model)), key.attribute.within, words)
            for name, key in every.items()
        }
        parsed = {}
        for name, text in written.items():
            where = f"randomise.scene.{text}" + (f" ({name})" if name != text else "")
            parsed[name] = Range.parse(known[name], self.ranges[text], known, where)
        nominal = {name: every[name].read(model) for name in (*keys, *refer) if name in every}
        self._parts = bound_ranges(parsed, nominal)
        self._check_models(SceneValues(model, shown))

    def draw(self, seed: int, episode: int = 0) -> DrawnScene:
        """Draw the values of an episode.

        Args:
            seed: Any whole number, modulo 2^64.
            episode: Number of the episode, 0 ... 2^63 - 1.

        Raises:
            EvsError: Seed or episode is out of range.
        """
        values = draw_values(self._parts, seed, episode)
        return DrawnScene(dict(values), int(seed), int(episode))

    def _check_models(self, scene: SceneValues) -> None:
        """Make the models where all values are lowest, and where all are highest."""
        for at in (0, -1):
            values = {part.key.name: part.ends[at] for part in self._parts}
            try:
                scene.put(values)
            except EvsError as error:
                raise EvsError(f"at randomise.scene ({', '.join(self.ranges)}): {error}") from None


Start = Mapping[str, tuple[float, float]] | Callable[[np.random.Generator, MjData], None]
"""name of a joint with one coordinate -> range of its position, drawn evenly; or a function that
puts the data somewhere."""

ONE_COORDINATE = (2, 3)
"""Slides and hinges, numbered as MuJoCo's mjtJoint."""


def check_start(model: MjModel, start: Start) -> Start:
    """`start` if every joint exists and every range is one; else EvsError."""
    if callable(start):
        return start
    known = {
        model.joint(index).name: int(model.jnt_type[index]) in ONE_COORDINATE
        for index in range(model.njnt)
    }
    for name, limits in start.items():
        if name not in known:
            raise unknown("joint", str(name), (one for one in known if one))
        if not known[name]:
            raise EvsError(f"joint '{name}' has more than one coordinate: give start= a function")
        if not _is_range(limits):
            raise EvsError(f"start['{name}'] is {limits!r}; give (low, high), such as (-0.1, 0.1)")
    return start


def begin(start: Start, random: np.random.Generator, data: MjData) -> None:
    """Put the data where an episode begins. Draws in the order of the names given."""
    if callable(start):
        start(random, data)
        return
    for name, (low, high) in start.items():
        data.joint(name).qpos[0] = random.uniform(low, high)


def _is_range(value: Any) -> bool:
    try:
        low, high = (float(end) for end in value)
    except (TypeError, ValueError):
        return False
    return math.isfinite(low) and math.isfinite(high) and low <= high
