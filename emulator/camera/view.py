"""What one camera sees of a world: SceneView, shared by Camera and View; View: no events."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from evs.emulator.base.features import Switches
from evs.emulator.base.protocols import Commit, Renderer
from evs.emulator.base.scene import (
    F32,
    CameraPose,
    GroundTruth,
    ObjectKind,
    SceneModel,
    SceneSnapshot,
)
from evs.emulator.base.stamps import check_start
from evs.emulator.config import (
    CameraConfig,
    ModelConfig,
    RenderConfig,
    RunConfig,
    SceneConfig,
    SensorConfig,
)
from evs.emulator.config.decoding import plain_config, plain_integer
from evs.emulator.optics import camera_info
from evs.emulator.optics.camera_info import pose_message
from evs.emulator.render import make_renderer
from evs.emulator.sensor import resolve_sensor
from evs.emulator.world import BoundCamera, MjModel, bind_camera, geom_label
from evs.msgs import EvsError, Pose


def camera_config(
    scene: SceneConfig,
    camera: str | CameraConfig,
    sensor: str | SensorConfig,
    render: RenderConfig | None,
    model: ModelConfig | None,
    seed: int,
    threads: int,
) -> RunConfig:
    """The configuration of a camera from what the Python face takes: names or configurations."""
    for what, value, kind in (("camera", camera, CameraConfig), ("sensor", sensor, SensorConfig)):
        if not isinstance(value, str | kind):
            raise EvsError(f"{what}= takes a name or a {kind.__name__}, not {value!r}")
    if not isinstance(render, RenderConfig | None):
        raise EvsError(f"render= takes a RenderConfig, not {render!r}")
    if not isinstance(model, ModelConfig | None):
        raise EvsError(f"model= takes a ModelConfig, not {model!r}")
    optics = CameraConfig() if isinstance(camera, str) else camera
    pixel = SensorConfig(preset=sensor) if isinstance(sensor, str) else sensor
    return RunConfig(
        scene=replace(scene, camera=camera if isinstance(camera, str) else ""),
        camera=plain_config(optics, "camera"),
        sensor=plain_config(pixel, "sensor"),
        render=plain_config(render or RenderConfig(), "render"),
        model=plain_config(model or ModelConfig(), "model"),
        seed=plain_integer(seed, "seed"),
        threads=plain_integer(threads, "threads"),
    )


class Viewpoint(NamedTuple):
    """A camera in its place, and what renders what it sees. Another one where the scene is."""

    bound: BoundCamera
    scene: SceneModel
    renderer: Renderer

    def follows(self, other: Viewpoint) -> bool:
        """Whether a snapshot for `other` has the same geoms, so that their motion can be seen."""
        ours, theirs = self.scene, other.scene
        return ours is theirs or (
            np.array_equal(ours.geom_id, theirs.geom_id) and ours.deforming == theirs.deforming
        )


class SceneView:
    """A camera in a world, with its renderer."""

    _viewpoint: Viewpoint

    def __init__(
        self,
        world: MjModel,
        scene: SceneModel,
        config: RunConfig,
        place: int,
        rgb: bool = False,
        like: SceneView | None = None,
    ) -> None:
        """Build the renderer.

        Args:
            world: The model.
            scene: What is extracted from it.
            config: Everything that makes the camera besides its world.
            place: Which of a snapshot's cameras this is.
            rgb: Whether to render colour too.
            like: A camera in a world of the same model, whose meshes, trees and images it shares.

        Raises:
            EvsError: The configuration makes no sense in this world.
        """
        self.config, self.place = config, place
        self.sensor = resolve_sensor(config.sensor)
        """with every value of its preset"""
        self.width, self.height = int(self.sensor.width), int(self.sensor.height)
        self._world, self._rgb = world, rgb
        self._start_us = check_start(int(config.scene.start_us))
        self._switches = Switches.of(config.plan)
        self._now: tuple[SceneSnapshot, CameraPose] | None = None
        self._previous: tuple[SceneSnapshot, CameraPose] | None = None
        shared = like._viewpoint.renderer if like else None
        self._viewpoint = self._viewpoint_in(scene, None, shared)

    def _viewpoint_in(
        self, scene: SceneModel, before: Viewpoint | None, like: Renderer | None = None
    ) -> Viewpoint:
        """Where it stands in a scene; what has not changed since `before` is reused."""
        name, optics, render = self.config.scene.camera, self.config.camera, self.config.render
        shown = scene.geom_id[scene.geom_kind == ObjectKind.GEOM]
        bound = bind_camera(self._world, name, self.width, self.height, optics, shown)
        if before and scene is before.scene and bound.model == before.bound.model:
            return Viewpoint(bound, scene, before.renderer)
        settings = (render, self.config.threads, self._rgb, self.config.seed, self._switches)
        like = before.renderer if before else like
        return Viewpoint(bound, scene, make_renderer(scene, bound.model, *settings, like))

    def part(self, world: MjModel) -> None:
        """Go on with a copy of the model, which is the same."""
        self._world = world

    @property
    def bound(self) -> BoundCamera:
        """The model's camera, or what describes it, with its optics."""
        return self._viewpoint.bound


class View(SceneView):
    """The present light and ground truth of a world, computed on request."""

    def __init__(
        self,
        world: MjModel,
        scene: SceneModel,
        config: RunConfig,
        place: int,
        rgb: bool,
        present: Callable[[], SceneSnapshot],
    ) -> None:
        """Build the renderer.

        Args:
            world: See SceneView.
            scene: See SceneView.
            config: See SceneView.
            place: See SceneView.
            rgb: See SceneView.
            present: Takes a snapshot.

        Raises:
            EvsError: See SceneView.
        """
        super().__init__(world, scene, config, place, rgb)
        self._present = present

    def prepare_refresh(self, scene: SceneModel) -> Commit:
        """Prepare the renderer for the edited world; the commit installs it. Raises EvsError."""
        before = self._viewpoint
        viewpoint = self._viewpoint_in(scene, before)

        def commit() -> None:
            self._viewpoint = viewpoint
            if not viewpoint.follows(before):
                self._now = self._previous = None

        return commit

    def reset(self, seed: int | None = None) -> None:
        """Forget past instants, because the world was reset, perhaps with another seed."""
        if seed is not None:
            self.config = replace(self.config, seed=seed)
            self._viewpoint.renderer.reseed(seed)
        self._now = self._previous = None

    def start(self) -> None:
        """Observe the present state if nothing was observed yet."""
        self._instant()

    def move(self, snapshot: SceneSnapshot) -> None:
        """The world went on to `snapshot`."""
        self._previous, self._now = self._now, (snapshot, snapshot.cameras[self.place])

    def render(self) -> tuple[F32, F32 | None]:
        """Render the present.

        Returns:
            Copies of luminance (h, w) and rgb (h, w, 3), linear float32; rgb is None where no
            colour is wanted.
        """
        instant = self._instant()
        renderer = self._viewpoint.renderer
        renderer.restart()
        luminance, colour = renderer.render(*instant), renderer.rgb
        return np.array(luminance), None if colour is None else np.array(colour)

    def ground_truth(self) -> GroundTruth:
        """Ground truth of the present; its flow is the motion since the previous tick."""
        instant = self._instant()
        truth = self._viewpoint.renderer.ground_truth(*instant, self._previous)
        return replace(truth, t_us=truth.t_us + self._start_us)

    def _instant(self) -> tuple[SceneSnapshot, CameraPose]:
        if self._now is None:
            self.move(self._present())
        assert self._now is not None
        return self._now

    @property
    def t_us(self) -> int:
        """The instant that is seen, us."""
        return self._start_us + self._instant()[0].t_us

    @property
    def pose(self) -> Pose:
        """Where the camera is at that instant; numbered 0."""
        return pose_message(self._instant()[1], 0, self.t_us, self.name)

    @property
    def name(self) -> str:
        """The model's name of the camera, or what describes it."""
        return self.bound.name

    @property
    def camera_info(self) -> dict[str, Any]:
        """Intrinsics in the fields of ROS's CameraInfo."""
        return camera_info(self.bound.model)


NEAR_M, NEAR_EXTENTS = 0.05, 0.05
"""how far away a cover may be, m, and as a share of the model's extent"""


def may_be_covered(
    world: MjModel, viewpoint: Viewpoint, snapshot: SceneSnapshot, pose: CameraPose
) -> bool:
    """Whether the bounds of a geom are near enough: only then is a picture of ids worth its time.

    Args:
        world: The model.
        viewpoint: The camera's.
        snapshot: Where the geoms are.
        pose: The camera's.
    """
    geoms = viewpoint.scene.geom_id >= 0
    away = snapshot.geom_pos[geoms] - pose.pos
    # a plane has no radius: its distance counts
    radius = world.geom_rbound[viewpoint.scene.geom_id[geoms]]
    normal = snapshot.geom_mat[geoms].reshape(-1, 3, 3)[:, :, 2]
    gap = np.where(
        radius > 0.0, np.linalg.norm(away, axis=1) - radius, np.abs((away * normal).sum(1))
    )
    return bool((gap < _limit_m(viewpoint)).any())


def _limit_m(viewpoint: Viewpoint) -> float:
    return min(NEAR_M, NEAR_EXTENTS * viewpoint.scene.extent_m)


def covered_by(
    world: MjModel, viewpoint: Viewpoint, truth: GroundTruth, name: str
) -> tuple[str, ...]:
    """One line that names the geom that fills the whole picture from a few cm away, and the fix.

    Args:
        world: The model.
        viewpoint: The camera's.
        truth: What it sees.
        name: Of the camera.

    Returns:
        () where there is none.
    """
    geom, limit_m = int(truth.geom_id.flat[0]), _limit_m(viewpoint)
    farthest_m = float(np.max(truth.distance))
    if geom < 0 or not farthest_m < limit_m or (truth.geom_id != geom).any():
        return ()
    near_m = viewpoint.bound.model.near_m
    line = (
        f"camera '{name}': geom '{geom_label(world, geom)}', at most {1e3 * farthest_m:.3g} mm "
        f"away, fills the picture; a camera behind its own housing needs a near plane (camera."
        f"near_m, now {near_m:.3g}) beyond it, the geom's group hidden (scene.visual.geomgroup), "
        "or another place"
    )
    return (line,)
