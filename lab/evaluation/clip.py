"""Clip: a scene under random controls, snapshot by snapshot, and the pixels that are rendered."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from evs.emulator.base.scene import F64, I32, CameraModel, CameraPose, SceneModel, SceneSnapshot
from evs.emulator.config import FlickerConfig, RenderConfig
from evs.emulator.render import NativeRenderer
from evs.emulator.world import (
    Physics,
    SnapshotTaker,
    bind_camera,
    extract_scene,
    load_model,
    make_control,
    starting_keyframe,
)
from evs.msgs import EvsError, unknown
from evs_lab.evaluation.digest import digest
from evs_lab.evaluation.scenes import SceneSetup

TICK_US = 1000
SIZE = (346, 260)
"""width, height of the sensor, px: a DAVIS346's"""
PATCH_PX = 32
"""side of the patch"""
CONTROL_SCALE = 0.6
"""share of the control range that the random controls use"""
MAX_SAMPLED = 16384
"""most pixels of a clip besides the patch; an event's x is the number of its pixel"""

PAN_PX_S = 170.0
SLIDE_M_S = 0.5
MOTIONS = ("still", "pan", "slide")
"""How a camera moves: not at all, turning (170 px/s), or to its right (0.5 m/s)."""

_LOOKS = 5
"""instants that are compared to place the patch"""
_LOOK_STEP_PX = 8

Instant = tuple[SceneSnapshot, CameraPose]


@dataclass(frozen=True)
class Clip:
    """The constant part of a scene, its instants, and the pixels that are rendered.

    The first `sampled` pixels are spread over the picture, the others are a square patch.
    """

    scene_name: str
    motion: str
    soft: bool
    scene: SceneModel
    camera: CameraModel
    instants: tuple[Instant, ...]
    """one a tick, at 0, 1, 2 ... ticks"""
    pixels: I32
    """(n, 2) columns and rows: the sampled ones, then the patch row by row"""
    sampled: int
    patch_px: int
    """side of the patch"""
    bounces: int
    flicker: tuple[FlickerConfig, ...]
    sky: str
    tick_us: int = TICK_US

    @property
    def name(self) -> str:
        """Scene and motion."""
        return f"{self.scene_name}, {self.motion}"

    def before(self, ticks: int) -> Clip:
        """The scene at rest in its first instant, for so many ticks before it."""
        snapshot, pose = self.instants[0]
        earlier = tuple(
            (dataclasses.replace(snapshot, t_us=snapshot.t_us - back * self.tick_us), pose)
            for back in range(ticks, 0, -1)
        )
        return dataclasses.replace(self, instants=earlier)

    def fingerprint(self, ticks: int) -> str:
        """Hash of everything that shapes the light of its first ticks, except how it is traced."""
        light = self.scene, self.bounces, self.flicker, self.sky
        return digest((light, self.camera, self.instants[:ticks], self.pixels))


def make_clip(
    setup: SceneSetup,
    motion: str,
    ticks: int,
    *,
    sampled: int = 4096,
    patch_px: int = PATCH_PX,
    size: tuple[int, int] = SIZE,
    seed: int = 0,
    look_ticks: int | None = None,
    tick_us: int = TICK_US,
    pan_px_s: float = PAN_PX_S,
) -> Clip:
    """Simulate the scene and record a snapshot of each tick.

    The time that the scene moves before does not depend on the length of a tick.

    Args:
        setup: the scene.
        motion: of the camera, one of MOTIONS.
        ticks: of tick_us.
        sampled: pixels spread over the image.
        patch_px: side of the patch; 0: there is none.
        size: of the image, px.
        seed: of the controls and of the sampled pixels.
        look_ticks: how many of the ticks choose where the patch lies (all).
        tick_us: length of a tick.
        pan_px_s: how fast motion `pan` turns.

    Raises:
        EvsError: unknown motion, too many pixels, a scene that breaks down.
    """
    if motion not in MOTIONS:
        raise unknown("camera motion", motion, MOTIONS)
    width, height = size
    if not 1 <= sampled <= min(width * height, MAX_SAMPLED):
        raise EvsError(f"pixels is {sampled}; give 1 ... {MAX_SAMPLED}")
    model = load_model(setup.model)
    start = starting_keyframe(model, setup.keyframe)
    physics = Physics(model, tick_us, start)
    control = make_control(model, "random", seed=seed, scale=CONTROL_SCALE)
    bound = bind_camera(model, setup.camera, width, height, setup.view)
    poser = SnapshotTaker(model, [bound])
    moved = camera_motion(motion, bound.model, pan_px_s)
    warm = -(-setup.warm_ticks * TICK_US // tick_us)
    instants: list[Instant] = []
    for tick in range(warm + ticks):
        k = tick - warm
        if k >= 0:
            snapshot = poser.snapshot(physics.data, tick_us * k, tick_us)
            rest = instants[0][1] if setup.stands and instants else snapshot.cameras[0]
            instants.append((snapshot, moved(rest, tick_us * k)))
        values = control(physics.t_us, physics.data)
        if values is not None:
            physics.data.ctrl[:] = values
        physics.advance()
    scene = extract_scene(model)
    looked = [instants[k] for k in np.linspace(0, (look_ticks or ticks) - 1, _LOOKS).astype(int)]
    corner = busiest_corner(scene, bound.model, looked, patch_px) if patch_px else (0, 0)
    spread, patch = spread_pixels(size, sampled, seed), patch_pixels(corner, patch_px)
    return Clip(
        setup.name,
        motion,
        setup.soft,
        scene,
        bound.model,
        tuple(instants),
        np.concatenate([spread, patch]),
        sampled,
        patch_px,
        setup.bounces,
        setup.flicker,
        setup.sky,
        tick_us,
    )


def camera_motion(
    name: str, camera: CameraModel, pan_px_s: float = PAN_PX_S
) -> Callable[[CameraPose, int], CameraPose]:
    """A function from the pose of the camera at rest and a time, us, to its moving pose.

    A motion that the scene gives the camera is kept, and this one is added.
    """

    def pan(rest: CameraPose, t_us: int) -> CameraPose:
        angle = pan_px_s * 1e-6 * t_us / camera.fx
        cos, sin = np.cos(angle), np.sin(angle)
        turn = np.array([[cos, -sin, 0], [sin, cos, 0], [0, 0, 1]])
        return CameraPose(rest.pos, np.ascontiguousarray((turn @ rest.mat.reshape(3, 3)).ravel()))

    def slide(rest: CameraPose, t_us: int) -> CameraPose:
        return CameraPose(
            rest.pos + rest.mat.reshape(3, 3)[:, 0] * (SLIDE_M_S * 1e-6 * t_us), rest.mat
        )

    return {"still": lambda rest, _t_us: rest, "pan": pan, "slide": slide}[name]


def spread_pixels(size: tuple[int, int], count: int, seed: int) -> I32:
    """(count, 2) different pixels of an image, at random, in rows of 4 x 4 blocks.

    The tracer works in blocks of 4 x 4, so neighbours in the list are neighbours in the scene.
    """
    width, height = size
    drawn = np.random.Philox(key=seed % 2**64).random_raw(width * height)
    chosen = np.argsort(drawn, kind="stable")[:count]
    x, y = chosen % width, chosen // width
    order = np.lexsort((x, y, x // 4, y // 4))
    return np.stack([x, y], axis=1)[order].astype(np.int32)


def patch_pixels(corner: tuple[int, int], side: int) -> I32:
    """(side^2, 2) the pixels of a square, row by row; corner is its top left."""
    y, x = np.mgrid[:side, :side]
    return np.stack([x.ravel() + corner[0], y.ravel() + corner[1]], axis=1).astype(np.int32)


def busiest_corner(
    scene: SceneModel, camera: CameraModel, instants: list[Instant], side: int
) -> tuple[int, int]:
    """Column and row of the square in which direct light changes most."""
    if side > min(camera.width, camera.height):
        raise EvsError(f"a patch of {side} px does not fit {camera.width} x {camera.height} px")
    renderer = NativeRenderer(scene, camera, RenderConfig(renderer="direct", spp=1), 1)
    looks = np.stack([np.log(renderer.render(*shot) + np.float32(0.01)) for shot in instants])
    change = np.abs(np.diff(looks, axis=0)).sum(axis=0, dtype=np.float64)
    return busiest_square(change, side)


def busiest_square(change: F64, side: int) -> tuple[int, int]:
    """Column and row of the square, on a grid of 8 px, with the largest sum of a map."""
    sums = np.pad(change.cumsum(axis=0).cumsum(axis=1), ((1, 0), (1, 0)))
    held = sums[side:, side:] - sums[side:, :-side] - sums[:-side, side:] + sums[:-side, :-side]
    grid = held[::_LOOK_STEP_PX, ::_LOOK_STEP_PX]
    row, column = np.unravel_index(int(np.argmax(grid)), grid.shape)
    return _LOOK_STEP_PX * int(column), _LOOK_STEP_PX * int(row)
