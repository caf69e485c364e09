"""A far checker floor does not sparkle: textures are filtered, so panning over them is quiet."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from evs.emulator.base.scene import (
    F32,
    CameraPose,
    SceneModel,
    Shape,
    Surface,
    Texture,
    TextureKind,
)
from evs.emulator.camera.pixel_pipeline import make_event_model
from evs.emulator.config import ModelConfig, RenderConfig, SensorConfig
from evs.emulator.render import NativeRenderer
from evs.emulator.sensor import resolve_sensor
from reference.scenes import camera_of, scene_of, shot_of

WIDTH, HEIGHT, FOCAL, TICKS = 64, 32, 60.0, 60
HEIGHT_M = 1.5
SQUARES_PER_M = 4.0
DARK, BRIGHT = 0.05, 0.8


def pose(tick: int) -> CameraPose:
    """Looking at the horizon, turning by 100 px a second."""
    angle = tick * 1e-3 * 100 / FOCAL
    right = np.array([np.cos(angle), np.sin(angle), 0.0])
    back = np.array([np.sin(angle), -np.cos(angle), 0.0])
    return CameraPose(
        np.array([0.013, 0.027, HEIGHT_M]),
        np.stack([right, [0.0, 0.0, 1.0], back], 1).reshape(9),
    )


def floor() -> SceneModel:
    """A glowing checker without end."""
    texels = np.array([[0, 1], [1, 0]])
    colours = np.round(255 * np.array([DARK, BRIGHT]))[texels].astype(np.uint8)
    image = np.repeat(np.kron(colours, np.ones((32, 32), np.uint8))[..., np.newaxis], 3, -1)
    return scene_of(
        [Shape.PLANE],
        [0, 0, 0],
        static=True,
        lights=(),
        surfaces=(
            Surface(
                (1.0,) * 4, texture=0, texrepeat=(SQUARES_PER_M, SQUARES_PER_M),
                texuniform=True, emission=1.0,
            ),
        ),
        textures=(Texture(TextureKind.FLAT, image, False),),
    )  # fmt: skip


def filtered(spp: int) -> list[F32]:
    """The light of every tick."""
    # the horizon lies on the image's upper rim
    scene, camera = floor(), replace(camera_of(WIDTH, HEIGHT, FOCAL), cy=0.0)
    tracer = NativeRenderer(scene, camera, RenderConfig(spp=spp), 1)
    return [
        tracer.render(shot_of(scene, [0, 0, 0], t_us=1000 * tick), pose(tick)).copy()
        for tick in range(TICKS)
    ]


def exact(across: int) -> list[F32]:
    """The checker itself at across x across points of each pixel, and their mean."""
    at = (np.arange(across) + 0.5) / across
    x, y, a, b = np.meshgrid(np.arange(WIDTH), np.arange(HEIGHT), at, at, indexing="ij")
    out = []
    for tick in range(TICKS):
        now = pose(tick)
        mat = now.mat.reshape(3, 3)
        ray = (
            np.stack([(x + a - WIDTH / 2) / FOCAL, -(y + b) / FOCAL, -np.ones_like(a)], -1) @ mat.T
        )
        point = now.pos[:2] - ray[..., :2] * (HEIGHT_M / ray[..., 2:])
        # as a texture lies on a plane without bounds: one image, two squares, in 2 m / texrepeat
        cells = np.floor((point * [1, -1] / 2 * SQUARES_PER_M - 0.5) * 2).sum(-1) % 2
        out.append(np.where(cells == 0, DARK, BRIGHT).mean((2, 3)).T.astype(np.float32))
    return out


def events(film: list[F32]) -> int:
    """How many an ideal pixel gives."""
    sensor = resolve_sensor(SensorConfig("ideal", width=WIDTH, height=HEIGHT))
    model = make_event_model(sensor, ModelConfig(), 1)
    state, count = model.init(0), 0
    for tick, light in enumerate(film):
        found, state = model.step(
            np.ascontiguousarray(light), state, 1000 * tick - 1000, 1000 * tick
        )
        count += len(found)
    return count


@pytest.mark.slow
def test_a_far_checker_floor_does_not_sparkle() -> None:
    films = {"area": exact(24), "points": exact(1), "one": filtered(1), "four": filtered(4)}
    # the far half of the floor: 16 rows below the horizon, many squares to a pixel
    for film in films.values():
        for light in film:
            light[HEIGHT // 2 :] = DARK
    counts = {name: events(film) for name, film in films.items()}
    # one point a pixel sparkles
    assert counts["points"] > 20 * counts["area"]
    # one filtered sample does not, and is about as sharp as a pixel's area
    for name in ("one", "four"):
        assert 0.5 * counts["area"] < counts[name] < 1.8 * counts["area"]
        error, sparkle = (
            np.abs(np.array(films[which]) - films["area"]).mean() for which in (name, "points")
        )
        assert error < 0.1 * sparkle
