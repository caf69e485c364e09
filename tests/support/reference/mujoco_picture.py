"""Pictures of a model by MuJoCo's own classic renderer and by evs: the same camera and size.

MuJoCo shades display-coded values, and evs linear light. So the shape (which geom each pixel shows)
agrees in every scene; the colour agrees where shading is one number (under ambient light, for
glowing geoms, under one lamp at right angles), and elsewhere in order and hue.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import mujoco
import numpy as np
import numpy.typing as npt

from evs.emulator.base.scene import F32, I32, U8, CameraModel, CameraPose
from evs.emulator.config import CameraConfig, RenderConfig
from evs.emulator.render import NativeRenderer, make_renderer
from evs.emulator.world import SnapshotTaker, bind_camera, extract_scene
from speed.elsewhere import Elsewhere, elsewhere
from speed.mujoco_gl import make_context

Flags = dict[str, bool]
"""flags of mjtRndFlag by the end of their names: SHADOW, REFLECTION, SKYBOX, HAZE, FOG, ..."""


@dataclass(frozen=True)
class SideBySide:
    """One view of one instant by both renderers."""

    theirs: U8
    """(h, w, 3), as MuJoCo codes it for a display"""
    ours: F32
    """(h, w, 3), linear"""
    their_ids: I32
    """(h, w), as SceneModel.geom_id; -1 where nothing is"""
    our_ids: I32
    """(h, w), the same"""

    @property
    def our_code(self) -> U8:
        """Our picture as a display takes it, (h, w, 3): values above white are clipped."""
        return np.round(255 * encoded(np.clip(self.ours, 0, 1))).astype(np.uint8)

    @property
    def shape_agrees(self) -> float:
        """The share of pixels in which both show the same geom, or nothing."""
        return float((self.their_ids == self.our_ids).mean())

    def inside(self, geom: int) -> npt.NDArray[np.bool_]:
        """Where both show this geom (-1: nothing) in a pixel and all around it, (h, w) bool."""
        both = np.pad((self.their_ids == geom) & (self.our_ids == geom), 1, mode="edge")
        height, width = self.our_ids.shape
        around = [both[y : y + height, x : x + width] for y in range(3) for x in range(3)]
        return np.asarray(np.logical_and.reduce(around))

    def colours(self, geom: int) -> tuple[F32, F32]:
        """The medians (3,) of theirs and ours over a geom's inside, both coded, 0 ... 1."""
        mask = self.inside(geom)
        assert mask.any(), f"geom {geom} is nowhere {self.our_ids.min()} ... {self.our_ids.max()}"
        theirs = np.median(self.theirs[mask], axis=0) / 255
        return theirs.astype(np.float32), encoded(np.median(self.ours[mask], axis=0))

    def difference(self, geom: int, percent: float = 95.0) -> float:
        """A percentile of |theirs - ours| over a geom's inside and all channels, coded, 0 ... 1."""
        mask = self.inside(geom)
        apart = np.abs(self.theirs[mask] / 255.0 - encoded(np.clip(self.ours[mask], 0, 1)))
        return float(np.percentile(apart, percent))


def encoded(linear: npt.ArrayLike) -> F32:
    """Linear light as sRGB code (IEC 61966-2-1), 0 ... 1."""
    light = np.asarray(linear, np.float32)
    return np.where(light <= 0.0031308, 12.92 * light, 1.055 * light ** (1 / 2.4) - 0.055).astype(
        np.float32
    )


def decoded(code: npt.ArrayLike) -> F32:
    """The inverse of `encoded`."""
    c = np.asarray(code, np.float32)
    return np.where(c <= 0.04045, c / 12.92, ((c + 0.055) / 1.055) ** 2.4).astype(np.float32)


class MujocoPictures:
    """MuJoCo's classic renderer in a process of its own."""

    def __init__(self, process: Elsewhere) -> None:
        self._process = process

    def beside(
        self,
        model: mujoco.MjModel,
        data: mujoco.MjData | None = None,
        camera: str | CameraConfig = "",
        width: int = 160,
        height: int = 120,
        *,
        render: RenderConfig | None = None,
        flags: Flags | None = None,
    ) -> SideBySide:
        """Draw the model with both renderers.

        Args:
            model: The model.
            data: Its state; the initial one if None.
            camera: The name of a camera of the model, or a camera's configuration.
            width: Width of the pictures, px.
            height: Height of the pictures, px.
            render: The settings of our renderer; `direct` with 16 samples per pixel if None.
            flags: Flags of MuJoCo's renderer, in addition to those that follow from `render`.
        """
        data = mujoco.MjData(model) if data is None else data
        mujoco.mj_forward(model, data)
        view = camera if isinstance(camera, CameraConfig) else CameraConfig()
        name = camera if isinstance(camera, str) else ""
        bound = bind_camera(model, name, width, height, view)
        snapshot, scene = SnapshotTaker(model, [bound]).snapshot(data, 0), extract_scene(model)
        pose = snapshot.cameras[0]
        render = render or RenderConfig(spp=16, antialiasing="fixed")
        renderer = make_renderer(scene, bound.model, render, 1, rgb=True)
        assert isinstance(renderer, NativeRenderer)
        renderer.render(snapshot, pose)
        assert renderer.rgb is not None
        ours, (rows, _) = renderer.rgb.copy(), renderer.hits(snapshot, pose)
        our_ids = np.where(rows < 0, -1, scene.geom_id[rows])
        told = {"SHADOW": render.shadows, "HAZE": render.haze, "FOG": render.fog} | (flags or {})
        theirs, their_ids = self._process.call(model, data, bound.model, pose, told)
        return SideBySide(theirs, ours, their_ids, our_ids.astype(np.int32))


@contextmanager
def mujoco_pictures() -> Iterator[MujocoPictures]:
    """Start the process; it ends with the block.

    Raises:
        AbsentError: If OpenGL in software is missing.
    """
    with elsewhere(_make_drawing, environment={"LP_NUM_THREADS": "0"}) as process:
        yield MujocoPictures(process)


def _make_drawing() -> Callable[..., tuple[U8, I32]]:
    make_context()
    return _draw


def _draw(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    camera: CameraModel,
    pose: CameraPose,
    flags: Flags,
) -> tuple[U8, I32]:
    """Draw the picture (h, w, 3) and the ids (h, w)."""
    width, height = camera.width, camera.height
    model.vis.global_.offwidth, model.vis.global_.offheight = width, height
    scene = mujoco.MjvScene(model, 10_000)
    everything = mujoco.mjtCatBit.mjCAT_ALL
    mujoco.mjv_updateScene(
        model, data, mujoco.MjvOption(), None, _free_camera(pose), everything, scene
    )
    for eye in scene.camera:
        _aim(eye, camera, pose)
    for name, on in flags.items():
        scene.flags[getattr(mujoco.mjtRndFlag, f"mjRND_{name}")] = on
    context = mujoco.MjrContext(model, mujoco.mjtFontScale.mjFONTSCALE_100)
    mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN, context)
    box = mujoco.MjrRect(0, 0, width, height)

    def read() -> U8:
        rgb = np.zeros((height, width, 3), np.uint8)
        mujoco.mjr_render(box, scene, context)
        mujoco.mjr_readPixels(rgb, None, box, context)
        # OpenGL's first row is the lowest
        return rgb[::-1].copy()

    # drawing may clear the reflections of geoms, so the picture comes first
    picture = read()
    for name in ("SEGMENT", "IDCOLOR"):
        scene.flags[getattr(mujoco.mjtRndFlag, f"mjRND_{name}")] = True
    code = read().astype(np.int32)
    context.free()
    numbers = {0: -1}
    for geom in scene.geoms[: scene.ngeom]:
        numbers[geom.segid + 1] = _number_of(model, geom)
    segments = code[..., 0] + 256 * code[..., 1] + 65536 * code[..., 2]
    return picture, np.vectorize(numbers.__getitem__, otypes=[np.int32])(segments)


def _number_of(model: mujoco.MjModel, geom: mujoco.MjvGeom) -> int:
    """The geom's number in SceneModel.geom_id; what has none there gets one below all of them."""
    if geom.objtype == mujoco.mjtObj.mjOBJ_GEOM:
        return int(geom.objid)
    if geom.objtype == mujoco.mjtObj.mjOBJ_SKIN:
        return -2 - int(geom.objid)
    if geom.objtype == mujoco.mjtObj.mjOBJ_FLEX:
        return -2 - int(model.nskin) - int(geom.objid)
    sites = -2 - int(model.nskin) - int(model.nflex)
    if geom.objtype == mujoco.mjtObj.mjOBJ_SITE:
        return sites - int(geom.objid)
    if geom.objtype == mujoco.mjtObj.mjOBJ_TENDON:
        return sites - int(model.nsite) - int(geom.objid)
    return -10_000


def _free_camera(pose: CameraPose) -> mujoco.MjvCamera:
    """A camera at the pose that looks along it; _aim sets what MuJoCo's camera cannot express."""
    camera, forward = mujoco.MjvCamera(), -pose.mat.reshape(3, 3)[:, 2]
    camera.type = mujoco.mjtCamera.mjCAMERA_FREE
    camera.distance = 1.0
    camera.lookat[:] = pose.pos + forward
    camera.azimuth = np.rad2deg(np.arctan2(forward[1], forward[0]))
    camera.elevation = np.rad2deg(np.arcsin(np.clip(forward[2], -1, 1)))
    return camera


def _aim(eye: mujoco.MjvGLCamera, camera: CameraModel, pose: CameraPose) -> None:
    """Give `eye` the rays of `camera` at `pose`, without its lens."""
    turn = pose.mat.reshape(3, 3)
    eye.pos[:], eye.forward[:], eye.up[:] = pose.pos, -turn[:, 2], turn[:, 1]
    eye.orthographic = camera.orthographic
    scale = 1.0 if camera.orthographic else eye.frustum_near
    eye.frustum_bottom = -scale * (camera.height - camera.cy) / camera.fy
    eye.frustum_top = scale * camera.cy / camera.fy
    eye.frustum_center = scale * (camera.width / 2 - camera.cx) / camera.fx
    eye.frustum_width = scale * camera.width / 2 / camera.fx
