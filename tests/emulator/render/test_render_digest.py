"""The bytes themselves: light and events of a scene without physics, on every machine alike.

The digests change only when light or pixel are meant to change: look at the pictures first, then
write the new ones here.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterator

import numpy as np
import pytest

from evs.emulator import _core
from evs.emulator.base.scene import (
    CameraPose,
    Light,
    LightKind,
    Mesh,
    SceneModel,
    SceneSnapshot,
    Shape,
    Surface,
    Texture,
    TextureKind,
)
from evs.emulator.camera.pixel_pipeline import make_event_model
from evs.emulator.config import ModelConfig, RenderConfig, SensorConfig
from evs.emulator.render import make_renderer
from evs.emulator.sensor import resolve_sensor
from evs.msgs import join_events
from reference.scenes import camera_of, scene_of, shot_of

pytestmark = pytest.mark.golden

LIGHT = "c31ab02ec3c167f6"
EVENTS = {
    "t": "cb92fe216a9f68df",
    "x": "eb3b0d2801c8d6c0",
    "y": "51335a182b389aec",
    "p": "a3a06bab514fb84e",
}

WIDTH, HEIGHT, TICKS = 61, 47, 40


def scene() -> SceneModel:
    """Every shape, a checker, a mesh, a spot with shadows, a headlight; nothing from a library."""
    squares = np.indices((16, 16)).sum(0) // 8 % 2 * 200 + 30
    checker = np.repeat(squares[..., np.newaxis], 3, 2).astype(np.uint8)
    pyramid = Mesh(
        np.array(
            [[0, 0, 0.4], [0.3, 0.3, 0], [-0.3, 0.3, 0], [-0.3, -0.3, 0], [0.3, -0.3, 0]],
            np.float32,
        ),
        np.array([[0, 1, 2], [0, 2, 3], [0, 3, 4], [0, 4, 1], [1, 3, 2], [1, 4, 3]], np.int32),
    )
    shapes = [Shape.PLANE, Shape.SPHERE, Shape.CAPSULE, Shape.ELLIPSOID, Shape.CYLINDER, Shape.BOX]
    return scene_of(
        [*shapes, Shape.MESH],
        [[2, 2, 0.1], *[[0.2, 0.15, 0.1]] * 6],
        surface=[0, 1, 1, 1, 1, 1, 1],
        static=[True] + [False] * 6,
        meshes=(pyramid,),
        surfaces=(
            Surface((1, 1, 1, 1), 0, (2, 2), True, reflectance=0.25),
            Surface((0.8, 0.5, 0.25, 1)),
        ),
        textures=(Texture(TextureKind.FLAT, checker),),
        lights=(
            Light(
                LightKind.DIRECTIONAL, diffuse=(0.25, 0.25, 0.25), castshadow=False, headlight=True
            ),
            Light(LightKind.SPOT, diffuse=(0.75, 0.75, 0.75), cutoff_deg=60, exponent=2),
        ),
    )


def snapshots() -> Iterator[SceneSnapshot]:
    """One a ms: everything slides and turns by exactly representable amounts."""
    quarter = np.array([[0.6, -0.8, 0], [0.8, 0.6, 0], [0, 0, 1]])
    places = np.array(
        [
            [0, 0, 0],
            [-0.5, 0, 0.25],
            [0.5, 0, 0.3],
            [0, 0.5, 0.25],
            [0, -0.5, 0.25],
            [-0.5, 0.5, 0.25],
            [0.5, 0.5, 0.25],
        ]
    )
    turned = np.tile(quarter.reshape(9), (7, 1))
    turned[0] = np.eye(3).reshape(9)
    world, lamps = scene(), [[0, 0, 0], [0.5, -0.5, 2]]
    for tick in range(TICKS + 1):
        moved = places + np.array([tick / 256, -tick / 512, 0]) * np.arange(7)[:, np.newaxis] / 8
        yield shot_of(world, moved, turned, lamps, t_us=1000 * tick)


def run(isa: str) -> tuple[str, dict[str, str]]:
    """Digest of all the light, and of each field of all the events."""
    camera = camera_of(WIDTH, HEIGHT, 60)
    pose = CameraPose(np.array([0, -2, 1.5]), np.array([1, 0, 0, 0, 0.6, -0.8, 0, 0.8, 0.6]))
    renderer = make_renderer(scene(), camera, RenderConfig(spp=2, antialiasing="fixed", isa=isa), 1)
    sensor = resolve_sensor(SensorConfig("ideal", width=WIDTH, height=HEIGHT, sigma_thres=0.02))
    model = make_event_model(sensor, ModelConfig(), 1)
    state, light, parts = model.init(7), hashlib.sha256(), []
    for shot in snapshots():
        luminance = renderer.render(shot, pose)
        light.update(luminance.tobytes())
        found, state = model.step(luminance, state, shot.t_us - 1000, shot.t_us)
        parts.append(found)
    events = join_events(parts)
    assert len(events) > 1000
    fields = {f: hashlib.sha256(np.ascontiguousarray(events[f])).hexdigest()[:16] for f in EVENTS}
    return light.hexdigest()[:16], fields


@pytest.mark.parametrize("isa", _core.isa_available())
def test_light_and_events_have_the_bytes_they_always_had(isa: str) -> None:
    light, fields = run(isa)
    assert (light, fields) == (LIGHT, EVENTS)
