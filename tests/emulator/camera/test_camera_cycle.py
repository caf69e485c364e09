"""A camera whose seeds are a cycle: silent where light is still, and honest about its delay."""

from __future__ import annotations

import numpy as np
import pytest

from evs.emulator import World
from evs.emulator.config import RenderConfig, RunConfig, SceneConfig
from reference.ball_room import SENSOR, ball_room

CYCLE = RenderConfig(renderer="path", spp=1, seeds="cycle", cycle_ticks=4)
TICKS = 10


def a_world(render: RenderConfig = CYCLE) -> World:
    return ball_room(render)


def events_of(world: World, ticks: int = TICKS) -> int:
    return sum(len(packet.events) for _ in range(ticks) for packet in world.step())


def test_a_still_scene_is_silent_from_the_first_tick() -> None:
    assert events_of(a_world()) == 0
    # the noise is there: new samples every tick are full of events
    fresh = RenderConfig(renderer="path", spp=1, seeds="fresh")
    assert events_of(a_world(fresh)) > 1000


def test_it_is_silent_after_a_reset_to_another_seed_and_state() -> None:
    world = a_world()
    world.data.qvel[0] = 3.0
    assert events_of(world) > 20
    world.reset(seed=9)
    assert events_of(world) == 0


def test_it_is_silent_after_a_restore() -> None:
    world, other = a_world(), a_world()
    events_of(world, 2)
    blob = world.save()
    other.data.qvel[0] = 3.0
    events_of(other)
    other.restore(blob)
    assert events_of(other) == 0


def test_an_edit_of_the_model_is_seen_at_once_and_only_once() -> None:
    world = a_world()
    events_of(world, 6)
    world.model.geom("post").rgba[:3] = 0.1, 0.1, 0.1
    counts = [events_of(world, 1) for _ in range(TICKS)]
    assert counts[0] > 100
    assert counts[1:] == [0] * (TICKS - 1)


def test_a_camera_made_later_is_silent_too() -> None:
    world = a_world()
    events_of(world, 3)
    late = world.add_camera("eye", sensor=SENSOR, render=CYCLE, name="late")
    events_of(world)
    assert late.events == 0


@pytest.mark.parametrize("ticks", [2, 4, 5])
def test_it_states_its_delay_and_moving_light_has_it(ticks: int) -> None:
    render = RenderConfig(renderer="path", spp=32, seeds="cycle", cycle_ticks=ticks)
    cycle, fixed = a_world(render), a_world(RenderConfig(renderer="path", spp=128))
    assert cycle.cameras[0].info.latency_us == 500 * (ticks - 1)
    assert fixed.cameras[0].info.latency_us == 0
    lights = []
    for world in (cycle, fixed):
        world.data.qvel[0] = 2.0
        light = [world.cameras[0].luminance for _ in range(60) if world.step()]
        lights.append(np.stack(light).astype(np.float64))
    late, light = lights

    def error(delay: float) -> float:
        whole, part = divmod(delay, 1.0)
        shifted = [np.roll(light, int(whole) + k, axis=0)[8:] for k in (0, 1)]
        return float(np.square(late[8:] - (1 - part) * shifted[0] - part * shifted[1]).sum())

    best = min(np.arange(0.0, 4.0, 0.25), key=error)
    assert best == pytest.approx(0.5 * (ticks - 1), abs=0.25)


def test_a_view_shows_the_present_alone() -> None:
    world, view = World.with_view(
        RunConfig(
            scene=SceneConfig(file="config/scenes/pendulum.xml", camera="front", keyframe="none"),
            sensor=SENSOR,
            render=CYCLE,
            threads=1,
        )
    )
    before = view.render()[0]
    for _ in range(3):
        world.step()
    moved = view.render()[0]
    assert moved.tobytes() != before.tobytes()
    assert moved.tobytes() == view.render()[0].tobytes()
