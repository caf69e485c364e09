"""View: what one camera sees of a world, without pixels and events: light and ground truth."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from evs.emulator.base.protocols import Commit
from evs.emulator.base.scene import F32, CameraPose, GroundTruth, SceneModel, SceneSnapshot
from evs.emulator.camera.camera_plan import CameraPlan
from evs.emulator.optics import camera_info
from evs.emulator.optics.camera_info import pose_message
from evs.emulator.sensor import resolve_sensor
from evs.emulator.world import BoundCamera, MjModel
from evs.msgs import Pose


class View:
    """The light and the ground truth of a world's present, each computed on request."""

    def __init__(
        self,
        world: MjModel,
        scene: SceneModel,
        plan: CameraPlan,
        place: int,
        present: Callable[[], SceneSnapshot],
        rgb: bool = False,
        start_us: int = 0,
    ) -> None:
        """Build the renderer.

        Args:
            world: The model.
            scene: What is extracted from it.
            plan: Everything that makes the camera besides its world.
            place: Which of a snapshot's cameras this is.
            present: Takes a snapshot.
            rgb: Whether colour is wanted too.
            start_us: What stamps begin at, us.

        Raises:
            EvsError: The plan makes no sense in this world.
        """
        sensor = resolve_sensor(plan.sensor)
        self.width, self.height = int(sensor.width), int(sensor.height)
        self._plan, self._world, self._rgb = plan, world, rgb
        self._viewpoint = plan.stand(world, scene, self.width, self.height, rgb)
        self.place, self._present, self._start_us = place, present, start_us
        self._now: tuple[SceneSnapshot, CameraPose] | None = None
        self._previous: tuple[SceneSnapshot, CameraPose] | None = None

    def prepare_refresh(self, scene: SceneModel) -> Commit:
        """Builds what sees the edited world; the commit puts it in place. Raises EvsError."""
        size, before = (self.width, self.height), self._viewpoint
        viewpoint = self._plan.stand(self._world, scene, *size, self._rgb, before)

        def commit() -> None:
            self._viewpoint = viewpoint
            if not viewpoint.follows(before):
                self._now = self._previous = None

        return commit

    def part(self, world: MjModel) -> None:
        """Go on with a copy of the model, which is the same."""
        self._world = world

    def reset(self, seed: int | None = None) -> None:
        """Forget the instants seen: the world has begun again, perhaps with another seed."""
        if seed is not None:
            self._plan = replace(self._plan, seed=seed)
            self._viewpoint.renderer.reseed(seed)
        self._now = self._previous = None

    def start(self) -> None:
        """See the present, if nothing was seen yet."""
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
        """Of the present; its flow is the motion since the tick before."""
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
    def bound(self) -> BoundCamera:
        """The model's camera, or what describes it, with its optics."""
        return self._viewpoint.bound

    @property
    def name(self) -> str:
        """The model's name of the camera, or what describes it."""
        return self.bound.name

    @property
    def camera_info(self) -> dict[str, Any]:
        """Intrinsics in the fields of ROS's CameraInfo."""
        return camera_info(self.bound.model)
