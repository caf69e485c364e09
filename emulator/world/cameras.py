"""Cameras: from a name or a description to pixels (CameraModel) and to a place in the world."""

from __future__ import annotations

import math
from collections.abc import Container
from dataclasses import dataclass, replace

import mujoco
import numpy as np
import numpy.typing as npt

from evs.emulator.base.scene import F64, I32, MAX_PIXELS, CameraModel, CameraPose
from evs.emulator.config import CameraConfig
from evs.emulator.optics import check_distortion, check_vignetting
from evs.emulator.world.compat import is_orthographic
from evs.emulator.world.controls import home_keyframe
from evs.emulator.world.materials import clamped
from evs.emulator.world.model import find, name_of, new_data
from evs.emulator.world.physics import moving_bodies, update_poses
from evs.emulator.world.trajectories import Shaking, Trajectory, read_trajectory
from evs.emulator.world.visual import visible_geoms
from evs.msgs import EvsError

FREE_KEYS = ("lookat", "distance", "azimuth", "elevation")
MOUNT_KEYS = ("pos", "quat", "xyaxes")

UNSET = CameraConfig()

MARGIN = 1.2
"""of a free camera's distance over the nearest that shows the robot whole: limbs stretch"""

FARTHEST_M = 1e12
"""of a near plane"""

SHORTEST_M = 1e-6
"""a box without extent is looked at from here"""


@dataclass(frozen=True)
class ModelCamera:
    """A camera that the model has; MuJoCo itself moves it."""

    camera: int

    def pose(self, data: mujoco.MjData, _t_us: int) -> CameraPose:
        """Where it is; `data` has its kinematics and cameras computed."""
        return CameraPose(data.cam_xpos[self.camera].copy(), data.cam_xmat[self.camera].copy())


@dataclass(frozen=True)
class FreeCamera:
    """A camera that stands still in the world."""

    fixed: CameraPose

    def pose(self, _data: mujoco.MjData, _t_us: int) -> CameraPose:
        """Where it is, always."""
        return self.fixed


@dataclass(frozen=True)
class MountedCamera:
    """A camera that a body carries: `pos` (3,) and `mat` (3, 3) are in the body's frame."""

    body: int
    pos: F64
    mat: F64

    def pose(self, data: mujoco.MjData, _t_us: int) -> CameraPose:
        """Where it is; `data` has its kinematics computed."""
        return _carried(data, self.body, self.pos, self.mat)


@dataclass(frozen=True)
class TravellingCamera:
    """A camera that goes through the poses of a file, in the frame of a body."""

    body: int
    """0: the world"""
    trajectory: Trajectory

    def pose(self, data: mujoco.MjData, t_us: int) -> CameraPose:
        """Where it is; `data` has its kinematics computed."""
        return _carried(data, self.body, *self.trajectory.pose(t_us * 1e-6))


@dataclass(frozen=True)
class ShakenCamera:
    """A camera that shakes where another would be."""

    mount: ModelCamera | FreeCamera | MountedCamera | TravellingCamera
    shaking: Shaking

    def pose(self, data: mujoco.MjData, t_us: int) -> CameraPose:
        """Where it is; `data` has its kinematics and cameras computed."""
        still = self.mount.pose(data, t_us)
        mat = np.asarray(still.mat, np.float64).reshape(3, 3)
        offset, turn = self.shaking.offset(t_us * 1e-6)
        return CameraPose(still.pos + mat @ offset, (mat @ turn).ravel())


def _carried(data: mujoco.MjData, body: int, pos: F64, mat: F64) -> CameraPose:
    """A pose in the frame of a body, in the world's."""
    turn = data.xmat[body].reshape(3, 3)
    return CameraPose(data.xpos[body] + turn @ pos, (turn @ mat).ravel())


Mount = ModelCamera | FreeCamera | MountedCamera | TravellingCamera | ShakenCamera
"""What moves a camera."""


@dataclass(frozen=True)
class BoundCamera:
    """A camera of one model: its pixels, and what moves it."""

    name: str
    """the model's name for it, else "free" or "BODY_camera" """
    model: CameraModel
    mount: Mount


def bind_camera(
    model: mujoco.MjModel,
    name: str,
    width: int,
    height: int,
    config: CameraConfig | None = None,
    shown: I32 | None = None,
) -> BoundCamera:
    """Bind a camera of the model, or one that the configuration describes.

    Args:
        model: The model.
        name: Name or number of one of its cameras; "" with no description is its first camera, else
            a free camera that shows what moves.
        width: Of the sensor, px.
        height: Of the sensor, px.
        config: A description, or other optics for a camera of the model.
        shown: See `robot_box`.

    Raises:
        EvsError: An unknown name, a resolution or angle that makes no picture, or a description
            that contradicts itself.
    """
    config = config or CameraConfig()
    bound = _bind_still(model, name, width, height, config, shown)
    if config.shake_m == config.shake_deg == 0.0:
        return bound
    for key in ("shake_m", "shake_deg", "shake_hz"):
        value = getattr(config, key)
        if not (math.isfinite(value) and value >= 0.0):
            raise EvsError(f"camera.{key} is {value:g}; give 0 or more")
    shaking = Shaking(
        config.shake_m, math.radians(config.shake_deg), config.shake_hz, config.shake_seed
    )
    assert not isinstance(bound.mount, ShakenCamera)
    return replace(bound, mount=ShakenCamera(bound.mount, shaking))


def _bind_still(
    model: mujoco.MjModel,
    name: str,
    width: int,
    height: int,
    config: CameraConfig,
    shown: I32 | None,
) -> BoundCamera:
    """The same without shaking."""
    if width < 1 or height < 1 or width * height > MAX_PIXELS:
        raise EvsError(f"a sensor of {width} x {height} px has no picture; try 346 x 260")
    free = any(getattr(config, key) is not None for key in FREE_KEYS)
    if free + bool(config.body) + bool(name) > 1:
        raise EvsError(
            "more than one camera is described: give either scene.camera, or camera.body, or "
            "camera.lookat, distance, azimuth, elevation"
        )
    mount_keys = [key for key in MOUNT_KEYS if getattr(config, key) != getattr(UNSET, key)]
    if config.trajectory:
        return _travelling(model, name, width, height, config, free or bool(mount_keys))
    if config.trajectory_axes != UNSET.trajectory_axes:
        raise EvsError("camera.trajectory_axes is given, but no camera.trajectory")
    if mount_keys and not config.body:
        raise EvsError(
            f"camera.{mount_keys[0]} is given, but no body that carries the camera: give "
            "camera.body too (world: it stands still)"
        )
    if config.body:
        body = find(model, mujoco.mjtObj.mjOBJ_BODY, "body", config.body)
        pos = np.array(config.pos, np.float64)
        mount = MountedCamera(body, pos, _mounted_turn(config))
        return BoundCamera(
            f"{config.body}_camera", _free_optics(model, width, height, config), mount
        )
    if free or (not name and not model.ncam):
        optics = _free_optics(model, width, height, config)
        return BoundCamera("free", optics, FreeCamera(free_pose(model, config, optics, shown)))
    camera = find(model, mujoco.mjtObj.mjOBJ_CAMERA, "camera", name) if name else 0
    label = name_of(model, mujoco.mjtObj.mjOBJ_CAMERA, camera)
    return BoundCamera(
        label, _model_optics(model, camera, width, height, config), ModelCamera(camera)
    )


def _travelling(
    model: mujoco.MjModel,
    name: str,
    width: int,
    height: int,
    config: CameraConfig,
    placed: bool,
) -> BoundCamera:
    """A camera on a trajectory, with the optics of one of the model's where that is named."""
    if placed:
        raise EvsError(
            "camera.trajectory says where the camera is: leave out camera.pos, quat, xyaxes, "
            "lookat, distance, azimuth and elevation"
        )
    trajectory = read_trajectory(config.trajectory, config.trajectory_axes)
    body = find(model, mujoco.mjtObj.mjOBJ_BODY, "body", config.body) if config.body else 0
    mount = TravellingCamera(body, trajectory)
    if not name:
        return BoundCamera("trajectory", _free_optics(model, width, height, config), mount)
    camera = find(model, mujoco.mjtObj.mjOBJ_CAMERA, "camera", name)
    label = name_of(model, mujoco.mjtObj.mjOBJ_CAMERA, camera)
    return BoundCamera(label, _model_optics(model, camera, width, height, config), mount)


def free_pose(
    model: mujoco.MjModel, config: CameraConfig, optics: CameraModel, shown: I32 | None = None
) -> CameraPose:
    """A free camera's pose, as mjv_cameraFrame computes it.

    Angles that are None are the model's default; lookat and distance show what moves, whole, or are
    MuJoCo's default where nothing but the world's own body is there.
    """
    lookat = np.array(model.stat.center if config.lookat is None else config.lookat, np.float64)
    distance = 1.5 * model.stat.extent if config.distance is None else config.distance
    if config.lookat is None or config.distance is None:
        box = robot_box(model, shown)
        if box is not None and config.lookat is None:
            lookat = (box[0] + box[1]) / 2
        if box is not None and config.distance is None:
            distance = _fitting(optics, lookat, *box)
    view = model.vis.global_
    azimuth = math.radians(view.azimuth if config.azimuth is None else config.azimuth)
    elevation = math.radians(view.elevation if config.elevation is None else config.elevation)
    if not distance > 0.0 or not all(map(math.isfinite, (*lookat, distance, azimuth, elevation))):
        raise EvsError(
            f"camera.distance is {distance:g}: it must be over 0, lookat and all angles finite"
        )
    ca, sa, ce, se = math.cos(azimuth), math.sin(azimuth), math.cos(elevation), math.sin(elevation)
    forward = np.array([ce * ca, ce * sa, se])
    up = np.array([-se * ca, -se * sa, ce])
    right = np.array([sa, -ca, 0.0])
    return CameraPose(lookat - distance * forward, np.stack([right, up, -forward], 1).ravel())


def _fitting(optics: CameraModel, lookat: F64, low: F64, high: F64) -> float:
    """The distance from `lookat` at which a box fits the picture, from wherever it is seen."""
    radius = float(np.linalg.norm(np.maximum(np.abs(low - lookat), np.abs(high - lookat))))
    # an edge of the picture that the axis is next to, as a slope
    slope = min(
        min(optics.cx, optics.width - optics.cx) / optics.fx,
        min(optics.cy, optics.height - optics.cy) / optics.fy,
    )
    if optics.orthographic or slope <= 0.0:
        return MARGIN * max(2.0 * radius, SHORTEST_M)
    return MARGIN * max(radius * math.hypot(1.0, slope) / slope, SHORTEST_M)


def _mounted_turn(config: CameraConfig) -> F64:
    """(3, 3) camera to body, from xyaxes or quat."""
    if config.xyaxes is not None:
        x, y = np.array(config.xyaxes[:3], np.float64), np.array(config.xyaxes[3:], np.float64)
        x /= np.linalg.norm(x) or 1.0
        y -= x * (x @ y)
        y /= np.linalg.norm(y) or 1.0
        turn = np.stack([x, y, np.cross(x, y)], 1)
        if not abs(np.linalg.det(turn) - 1.0) < 1e-6:
            raise EvsError(f"camera.xyaxes {config.xyaxes}: the two axes must span a plane")
        return turn
    quat = np.array(config.quat, np.float64)
    length = float(np.linalg.norm(quat))
    if not length > 0.0 or not math.isfinite(length):
        raise EvsError(
            f"camera.quat {config.quat} is zero; give a rotation, for example (1, 0, 0, 0)"
        )
    flat = np.zeros(9)
    mujoco.mju_quat2Mat(flat, quat / length)
    return flat.reshape(3, 3)


def _free_optics(
    model: mujoco.MjModel, width: int, height: int, config: CameraConfig
) -> CameraModel:
    """Optics of a camera that the model does not have: MuJoCo's free camera's, or the config's."""
    view = model.vis.global_
    fovy = float(view.fovy)
    return _with_lens(model, _optics(width, height, fovy, bool(view.orthographic), config), config)


def _model_optics(
    model: mujoco.MjModel, camera: int, width: int, height: int, config: CameraConfig
) -> CameraModel:
    """Optics of one of the model's cameras: physical intrinsics where it has them, else fovy."""
    orthographic = is_orthographic(model, camera)
    size_x, size_y = (float(length) for length in model.cam_sensorsize[camera])
    if orthographic or not size_y or config.fovy is not None or config.focal_px is not None:
        fovy = float(model.cam_fovy[camera])
        return _with_lens(model, _optics(width, height, fovy, orthographic, config), config)

    numbers = (size_x, size_y, *(float(v) for v in model.cam_intrinsic[camera]))
    if not (all(v > 0.0 for v in numbers[:4]) and math.isfinite(sum(numbers))):
        name = name_of(model, mujoco.mjtObj.mjOBJ_CAMERA, camera)
        raise EvsError(
            f"camera '{name}' has a sensorsize, but not all of it and of its focal lengths is over "
            "0 and finite: give focal or focalpixel in the model, or camera.fovy here"
        )
    # the model's image plane is stretched over our pixels, as MuJoCo stretches it over a window
    focal_x, focal_y, principal_x, principal_y = numbers[2:]
    cx, cy = width / 2 - principal_x / size_x * width, height / 2 - principal_y / size_y * height
    cx, cy = config.principal_px or (cx, cy)
    fx, fy = focal_x / size_x * width, focal_y / size_y * height
    return _with_lens(model, CameraModel(width, height, fx, fy, cx, cy), config)


def _near_m(model: mujoco.MjModel, config: CameraConfig) -> float:
    """Where rays begin: MuJoCo's near plane, unless the configuration has another."""
    if config.near_m is not None:
        if not 0.0 <= config.near_m <= FARTHEST_M:
            raise EvsError(f"camera.near_m is {config.near_m:g}; give 0 m or more")
        return config.near_m
    near_m = float(model.vis.map.znear) * float(model.stat.extent)
    return clamped(near_m, 0.0, FARTHEST_M, "visual/map znear times statistic/extent")


def _with_lens(model: mujoco.MjModel, camera: CameraModel, config: CameraConfig) -> CameraModel:
    """The camera with the lens and the near plane that `config` describes."""
    camera = replace(
        camera,
        near_m=_near_m(model, config),
        distortion_model=config.distortion_model,
        distortion=config.distortion,
        vignetting=config.vignetting,
        vignetting_polynomial=config.vignetting_polynomial,
    )
    check_distortion(camera)
    check_vignetting(camera)
    return camera


def _optics(
    width: int, height: int, fovy: float, orthographic: bool, config: CameraConfig
) -> CameraModel:
    """Square pixels from a vertical field of view (degrees or m), or the config's own."""
    cx, cy = config.principal_px or (width / 2, height / 2)
    if config.focal_px is not None:
        fx, fy = config.focal_px
        if not (fx > 0.0 and fy > 0.0 and math.isfinite(fx + fy)):
            raise EvsError(f"camera.focal_px {config.focal_px}: both must be over 0")
        return CameraModel(width, height, fx, fy, cx, cy, orthographic)
    fovy = fovy if config.fovy is None else config.fovy
    if not 0.0 < fovy < (math.inf if orthographic else 180.0):
        raise EvsError(f"camera.fovy is {fovy}: it must lie between 0 and 180 degrees")
    half = fovy / 2 if orthographic else math.tan(math.radians(fovy) / 2)
    focal = height / 2 / half
    return CameraModel(width, height, focal, focal, cx, cy, orthographic)


def robot_box(model: mujoco.MjModel, shown: I32 | None = None) -> tuple[F64, F64] | None:
    """(3,), (3,) lowest and highest corner, m, of what moves; None: the world's body has it all.

    A free camera shows what moves, not the floor that it stands on.
    Of whole trees of bodies that have a joint or are mocap, an arm's fixed base too, else of all
    bodies but the world; where they are at the keyframe `home`, else at qpos0. What is not shown
    does not count, nor does a plane.

    Args:
        model: The model.
        shown: (n,) ids of the geoms that are seen; None: those that MuJoCo shows by default.
    """
    ids = set((visible_geoms(model) if shown is None else shown).tolist())
    roots = np.unique(model.body_rootid[moving_bodies(model)])
    robots = np.isin(model.body_rootid, roots)
    others = np.arange(model.nbody) > 0
    return next((box for bodies in (robots, others) if (box := _box(model, bodies, ids))), None)


def _box(
    model: mujoco.MjModel, bodies: npt.NDArray[np.bool_], shown: Container[int]
) -> tuple[F64, F64] | None:
    """Of all that these bodies, (nbody,), carry."""
    geoms = [
        geom
        for geom in range(model.ngeom)
        if bodies[model.geom_bodyid[geom]]
        and model.geom_type[geom] != mujoco.mjtGeom.mjGEOM_PLANE
        and geom in shown
    ]
    deforms = bool(model.nskin or model.nflex)
    if not geoms and not (deforms and bodies.any()):
        return None
    data = new_data(model)
    home = home_keyframe(model)
    if home >= 0:
        mujoco.mj_resetDataKeyframe(model, data, home)
    update_poses(model, data)
    turn = data.geom_xmat[geoms].reshape(-1, 3, 3)
    boxes = model.geom_aabb[geoms].reshape(-1, 6)
    middle = data.geom_xpos[geoms] + np.einsum("gij,gj->gi", turn, boxes[:, :3])
    half = np.einsum("gij,gj->gi", np.abs(turn), boxes[:, 3:])
    # the vertices of skins and flexes lie at their bodies
    carried = data.xpos[bodies] if deforms else np.zeros((0, 3))
    low = np.concatenate([middle - half, carried]).min(axis=0)
    high = np.concatenate([middle + half, carried]).max(axis=0)
    return (low, high) if np.isfinite([low, high]).all() else None
