"""Worlds that are stepped together, and each of them alone as a World, with the same bytes."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from evs.emulator import UnstableError, World, Worlds
from evs.emulator.config import SceneConfig
from evs.emulator.simulation.worlds import WorldsEvents
from evs.msgs import Events

SWING = """
<mujoco>
  <option timestep=".001"/>
  <worldbody>
    <light name="lamp" pos="0 -1 3"/>
    <geom type="plane" size="3 3 1" rgba=".3 .3 .3 1"/>
    <camera name="left" pos="0 -2 .6" xyaxes="1 0 0 0 .2 1"/>
    <camera name="right" pos="2 0 .6" xyaxes="0 1 0 -.2 0 1"/>
    <body name="arm" pos="0 0 .8"><joint name="swing" axis="0 1 0"/>
      <geom name="rod" type="capsule" fromto="0 0 0 .6 0 0" size=".05" rgba=".9 .9 .9 1"/>
      <site name="tip" pos=".6 0 0" size=".08" rgba=".2 .9 .2 1"/></body>
  </worldbody>
  <actuator><motor joint="swing" gear="2" ctrlrange="-1 1"/></actuator>
  <sensor><jointpos name="angle" joint="swing"/><jointvel name="rate" joint="swing"/></sensor>
  <keyframe><key name="up" qpos="-1"/></keyframe>
</mujoco>
"""


def raw(events: Events) -> bytes:
    """All bytes of events, the padding too, which NumPy's copy of fields leaves out."""
    return np.ascontiguousarray(events).view(np.uint8).tobytes()


class Alone:
    """Twins of the worlds of a Worlds, stepped one by one by `World.step`."""

    def __init__(
        self, worlds: Worlds, scene: Any, cameras: Iterable[Mapping[str, Any]], **options: Any
    ) -> None:
        """Make one World for each seed.

        Args:
            worlds: The worlds, with their cameras.
            scene: Their scene.
            cameras: Arguments of add_camera, for each camera.
            **options: Those of World, without seed.
        """
        self.worlds, self.ended = worlds, dict[int, str]()
        """as of Worlds: why they ended"""
        # the control seed of a configuration keeps its distance to the seed, as in World.reset
        reseeded = isinstance(scene, SceneConfig)
        self.each: list[World] = []
        for seed in worlds.seeds:
            world = World(scene, seed=worlds.seeds[0] if reseeded else seed, threads=1, **options)
            for camera in cameras:
                world.add_camera(**camera)
            if reseeded:
                world.reset(seed)
            self.each.append(world)

    def step(self, ctrl: Any = None, ticks: int | Sequence[int] = 1) -> list[list[bytes]]:
        """The events of each camera of each world, [camera][world], after `ticks` of World.step."""
        count = len(self.each)
        wanted = np.broadcast_to(np.array(ticks), (count,)).tolist()
        seen: list[list[bytes]] = [[b""] * count for _ in self.worlds.cameras]
        for number, world in enumerate(self.each):
            if ctrl is not None:
                world.given = np.array(ctrl[number], np.float64)
            for _ in range(0 if number in self.ended else wanted[number]):
                try:
                    packets = world.step()
                except UnstableError as reason:
                    self.ended[number] = str(reason)
                    break
                for place, packet in enumerate(packets):
                    seen[place][number] += raw(packet.events)
        return seen


def by_world(seen: tuple[WorldsEvents, ...]) -> list[list[bytes]]:
    """What Worlds.step gave, as Alone.step has it: [camera][world]."""
    return [[raw(events) for events in camera] for camera in seen]


def both(
    scene: Any,
    count: int,
    cameras: Sequence[Mapping[str, Any]],
    *,
    seed: int = 0,
    threads: int = 0,
    **options: Any,
) -> tuple[Worlds, Alone]:
    """Worlds, and the same worlds alone."""
    own = {name: options.pop(name) for name in ("limits", "sensors") if name in options}
    worlds = Worlds(scene, count, seed=seed, threads=threads, **own, **options)
    for camera in cameras:
        worlds.add_camera(**camera)
    return worlds, Alone(worlds, scene, cameras, **options)


def step_both(
    worlds: Worlds, alone: Alone, ctrl: Any = None, ticks: int | Sequence[int] = 1
) -> int:
    """Step both, compare their bytes, and return how many there were."""
    seen, expected = by_world(worlds.step(ctrl, ticks)), alone.step(ctrl, ticks)
    assert seen == expected
    assert worlds.ended == alone.ended
    return sum(len(events) for camera in expected for events in camera)


def assert_same_states(worlds: Worlds, alone: Alone) -> None:
    """Saved states, clocks and counters of both, in full."""
    assert worlds.save() == [world.save() for world in alone.each]
    assert worlds.t_us.tolist() == [world.t_us for world in alone.each]
    for number, world in enumerate(alone.each):
        for own, other in zip(worlds.world(number).cameras, world.cameras, strict=True):
            assert (own.events, own.clamps) == (other.events, other.clamps)
            assert own.luminance.tobytes() == other.luminance.tobytes()


Change = Callable[[int, World], None]


def change_both(worlds: Worlds, alone: Alone, change: Change) -> None:
    """Change every world of both in one way: change(number, world)."""
    for number, world in enumerate(alone.each):
        change(number, worlds.world(number))
        change(number, world)
