"""CameraPlan: everything that makes a camera besides its world; Viewpoint: it, in its place."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any, NamedTuple

import numpy as np

from evs.emulator.base.features import Switches
from evs.emulator.base.protocols import Renderer
from evs.emulator.base.scene import ObjectKind, SceneModel
from evs.emulator.config import (
    CameraConfig,
    ModelConfig,
    PlanConfig,
    RenderConfig,
    RunConfig,
    SensorConfig,
)
from evs.emulator.config.settings import plain_config, plain_integer
from evs.emulator.render import make_renderer
from evs.emulator.world import BoundCamera, MjModel, bind_camera
from evs.msgs import EvsError


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


@dataclass(frozen=True)
class CameraPlan:
    """Everything that makes a camera besides the world it stands in."""

    camera: str = ""
    """name of a camera of the model"""
    optics: CameraConfig = field(default_factory=CameraConfig)
    sensor: SensorConfig = field(default_factory=SensorConfig)
    render: RenderConfig = field(default_factory=RenderConfig)
    model: ModelConfig = field(default_factory=ModelConfig)
    name: str | None = None
    """its name on the bus and in recordings; None: after the model's camera or the body"""
    seed: int = 0
    threads: int = 0
    plan: PlanConfig = field(default_factory=PlanConfig)

    @property
    def switches(self) -> Switches:
        """Code paths that are forced on or off. EvsError for names that are none."""
        return Switches.of(self.plan)

    def stand(
        self,
        world: MjModel,
        scene: SceneModel,
        width: int,
        height: int,
        rgb: bool = False,
        before: Viewpoint | None = None,
        like: Renderer | None = None,
    ) -> Viewpoint:
        """Put the camera into its place in a world, and make its renderer.

        Args:
            world: The model.
            scene: What is extracted from it.
            width: Of the sensor, px.
            height: Of the sensor, px.
            rgb: Whether colour is wanted too.
            before: The same camera until now; what has not changed is reused.
            like: Another camera's renderer in a world of this model, whose meshes, trees and
                images are shared.

        Raises:
            EvsError: The plan makes no sense in this world.
        """
        shown = scene.geom_id[scene.geom_kind == ObjectKind.GEOM]
        bound = bind_camera(world, self.camera, width, height, self.optics, shown)
        if before and scene is before.scene and bound.model == before.bound.model:
            return Viewpoint(bound, scene, before.renderer)
        settings = (self.render, self.threads, rgb, self.seed, self.switches)
        like = before.renderer if before else like
        return Viewpoint(bound, scene, make_renderer(scene, bound.model, *settings, like))


def plan_camera(
    camera: str | CameraConfig,
    sensor: str | SensorConfig,
    render: RenderConfig | None,
    model: ModelConfig | None,
    name: str | None,
    seed: int,
    threads: int,
) -> CameraPlan:
    """A plan from what the Python face takes: names or configurations."""
    for what, value, kind in (("camera", camera, CameraConfig), ("sensor", sensor, SensorConfig)):
        if not isinstance(value, str | kind):
            raise EvsError(f"{what}= takes a name or a {kind.__name__}, not {value!r}")
    if not isinstance(render, RenderConfig | None):
        raise EvsError(f"render= takes a RenderConfig, not {render!r}")
    if not isinstance(model, ModelConfig | None):
        raise EvsError(f"model= takes a ModelConfig, not {model!r}")
    optics = CameraConfig() if isinstance(camera, str) else camera
    pixel = SensorConfig(preset=sensor) if isinstance(sensor, str) else sensor
    return CameraPlan(
        camera=camera if isinstance(camera, str) else "",
        optics=plain_config(optics, "camera"),
        sensor=plain_config(pixel, "sensor"),
        render=plain_config(render or RenderConfig(), "render"),
        model=plain_config(model or ModelConfig(), "model"),
        name=name,
        seed=plain_integer(seed, "seed"),
        threads=plain_integer(threads, "threads"),
    )


def plan_of(config: RunConfig) -> CameraPlan:
    """The one camera of a pipeline."""
    return CameraPlan(
        camera=config.scene.camera,
        optics=config.camera,
        sensor=config.sensor,
        render=config.render,
        model=config.model,
        name=config.name,
        seed=config.seed,
        threads=config.threads,
        plan=config.plan,
    )


def plain_plan(plan: CameraPlan) -> dict[str, Any]:
    """The plan under the names of the configuration's tables and keys."""
    values = asdict(plan)
    del values["camera"]
    values["camera"] = values.pop("optics")
    return values


def identity_of(plan: CameraPlan, config: Mapping[str, Any]) -> dict[str, Any]:
    """Describe what shapes a camera's events, seed aside, in plain values.

    Args:
        plan: Of the camera.
        config: As in its StreamInfo.
    """
    tables = {key: dict(config[key]) for key in ("camera", "sensor", "render", "model")}
    # the same bytes
    for key in ("isa", "incremental", "device"):
        del tables["render"][key]
    del tables["model"]["device"]
    if plan.plan != PlanConfig():
        # the same events of other arrays
        tables["plan"] = asdict(plan.plan)
    return {"of": plan.camera, **tables}


def free_name(wanted: str | None, usual: str, taken: tuple[str, ...]) -> str:
    """A camera's name: the wanted one, else the usual one, numbered where it is taken."""
    if wanted is not None:
        if not wanted or not wanted.isprintable() or wanted in taken:
            raise EvsError(f"a camera called {wanted!r}: give each its own, printable name")
        return wanted
    number = 1
    while (name := usual if number == 1 else f"{usual}_{number}") in taken:
        number += 1
    return name
