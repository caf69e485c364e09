"""A model before a camera: its instants, and what renderers make of them."""

from __future__ import annotations

import copy
from dataclasses import replace
from typing import Any

import mujoco
import numpy as np

from evs.emulator.base.features import UNFORCED, Switches
from evs.emulator.base.scene import F32, SceneSnapshot
from evs.emulator.config import CameraConfig, RenderConfig
from evs.emulator.render import make_renderer
from evs.emulator.world import SnapshotTaker, bind_camera, extract_scene


class Film:
    """A model, one of its cameras or a free one, and its first instant, which a test may change."""

    def __init__(
        self,
        model: mujoco.MjModel | str,
        size: tuple[int, int],
        view: CameraConfig | None = None,
        camera: str = "",
    ) -> None:
        self.model = mujoco.MjModel.from_xml_string(model) if isinstance(model, str) else model
        self.data = mujoco.MjData(self.model)
        self.bound = bind_camera(self.model, camera, *size, view)
        self.camera = self.bound.model
        self.scene = extract_scene(self.model)
        self.taker = SnapshotTaker(self.model, [self.bound])
        self.shot = self.taker.snapshot(self.data, 0)
        self.first_lamp = 0
        """what is added to the indices of lamps"""

    def snapshots(self, ticks: int = 1) -> list[SceneSnapshot]:
        """One a step from the start on; their times are ms."""
        data, taken = copy.copy(self.data), []
        for k in range(ticks):
            taken.append(self.taker.snapshot(data, 1000 * k))
            mujoco.mj_step(self.model, data)
        return taken

    def renderer(
        self, threads: int = 1, switches: Switches = UNFORCED, seed: int = 0, rgb: bool = False,
        **render: object,
    ) -> Any:  # fmt: skip
        """A renderer of this camera, with one sample a pixel if nothing else is said."""
        config = RenderConfig(**{"spp": 1, **render})  # type: ignore[arg-type]
        return make_renderer(self.scene, self.camera, config, threads, rgb, seed, switches)

    def light(self, **how: object) -> F32:
        """What a new renderer of this kind sees in the first instant."""
        return self.renderer(**how).render(self.shot, self.shot.cameras[0]).copy()  # type: ignore[arg-type]

    def lamp(self, index: int, *by: float) -> None:
        """Move a lamp in the instant."""
        pos = self.shot.light_pos.copy()
        pos[index + self.first_lamp] += by
        self.shot = replace(self.shot, light_pos=pos)

    def turn(self, index: int, *towards: float) -> None:
        """Turn a lamp in the instant."""
        direction = self.shot.light_dir.copy()
        direction[index + self.first_lamp] = np.array(towards) / np.linalg.norm(towards)
        self.shot = replace(self.shot, light_dir=direction)

    def geom(self, index: int, *by: float) -> None:
        """Move a geom in the instant."""
        pos = self.shot.geom_pos.copy()
        pos[index] += by
        self.shot = replace(self.shot, geom_pos=pos)
