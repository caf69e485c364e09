"""The scene plan: what a camera's scene contains, which code paths are on or off, and why."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

from evs.emulator.base.features import FEATURES, Feature
from evs.emulator.base.scene import SceneModel
from evs.emulator.camera.plan.contents import Contents, contents_of
from evs.emulator.camera.plan.cost import Cost, estimate
from evs.emulator.camera.plan.reasons import reasons
from evs.emulator.config import RENDERERS
from evs.emulator.sensor import SensorParameters
from evs.emulator.world import BoundCamera, MjModel, Mobility, mobility_of

if TYPE_CHECKING:
    from evs.emulator.camera.camera_plan import CameraPlan

FORCED_ON = "[plan] has it on, whether the scene needs it or not"
FORCED_OFF = "[plan] leaves it out, whether the scene needs it or not"
CANNOT = "[plan] asks for it, but it has no place here"


@dataclass(frozen=True)
class Decision:
    """One code path."""

    feature: Feature
    on: bool
    why: str
    forced: bool
    """whether [plan] has decided it, and not the scene"""


@dataclass(frozen=True)
class ScenePlan:
    """What one camera's scene requires."""

    contents: Contents
    mobility: Mobility
    view: dict[str, Any]
    """pixels, projection, renderer, samples: what is requested of them"""
    decisions: tuple[Decision, ...]
    """of the code paths that the renderer and the event model know, in the order of the stages"""
    cost: Cost

    def compact(self) -> dict[str, Any]:
        """For reports: contents without what there is none of, names that are on, why off."""
        has = {key: value for key, value in asdict(self.contents).items() if value}
        moves = {key: value for key, value in asdict(self.mobility).items() if value}
        return {
            "contents": {**has, **moves},
            "view": self.view,
            "on": [each.feature.name for each in self.decisions if each.on],
            "off": {each.feature.name: each.why for each in self.decisions if not each.on},
            "forced": [each.feature.name for each in self.decisions if each.forced],
            "cost": self.cost.plain(),
        }


def plan_scene(
    world: MjModel,
    scene: SceneModel,
    bound: BoundCamera,
    sensor: SensorParameters,
    plan: CameraPlan,
    features: Mapping[str, bool],
    tick_us: int,
) -> ScenePlan:
    """Make the plan of a camera.

    Args:
        world: The model.
        scene: What is extracted from it.
        bound: The camera.
        sensor: The sensor, resolved.
        plan: Everything that makes the camera.
        features: Which code paths it runs.
        tick_us: Length of a tick, us.
    """
    steps = max(1, round(tick_us * 1e-6 / world.opt.timestep))
    render, model, switches = plan.render, plan.model, plan.switches
    has, mobility = contents_of(scene, render), mobility_of(world, bound)
    why = reasons(has, mobility, sensor, render, model)
    decisions = []
    for feature in FEATURES:
        if feature.name not in features:
            continue
        on = features[feature.name]
        forced = feature.name in (switches.on if on else switches.off)
        reason = why[feature.name].on if on else why[feature.name].off
        if forced:
            reason = FORCED_ON if on else FORCED_OFF
        elif feature.name in switches.on:
            reason = CANNOT
        decisions.append(Decision(feature, on, reason, forced))
    cost = estimate(world, has, mobility, sensor, render, model, features, steps)
    return ScenePlan(has, mobility, _view(bound, plan), tuple(decisions), cost)


def _view(bound: BoundCamera, plan: CameraPlan) -> dict[str, Any]:
    """Optics, renderer and model of a view."""
    camera, render = bound.model, plan.render
    view = {
        "width": camera.width,
        "height": camera.height,
        "projection": "orthographic" if camera.orthographic else "perspective",
        "distortion_model": camera.distortion_model,
        "renderer": render.renderer,
        "samples": render.samples,
        "antialiasing": render.antialiasing,
        "model": plan.model.name,
    }
    return view | ({"bounces": render.bounces} if RENDERERS[render.renderer].paths else {})
