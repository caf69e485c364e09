"""What a tick is expected to cost, from counts: a small model, fitted once, on one core.

It is good to a factor of about two (tests/bench/test_plan_cost.py prints it beside what is
measured): enough to see where the time goes and whether real time is near. `evs plan --measure`
runs the scene instead.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

from evs.emulator.config import ModelConfig, RenderConfig
from evs.emulator.plan.contents import Contents
from evs.emulator.sensor import SensorParameters
from evs.emulator.world import MjModel, Standing

PACKET = 16
"""pixels that are traced together"""

# ns, one core of a 2023 server with AVX-512
PACKET_NS = 480.0
"""of a packet's sample: its rays and what they hit"""
LIGHT_NS, SHADOW_NS = 70.0, 90.0
"""of each light, and of one that casts shadows"""
GEOM_NS = 2.0
"""of each geom that a packet may hit, for its camera rays and for those to each light"""
TRIANGLE_NS = 900.0
"""of meshes: times the depth of their search tree over that of a thousand triangles"""
TEXTURE_NS = 250.0
PATH_NS = 3200.0
"""of a packet's sample and point of a path"""
ASK_NS = 25.0
"""of a packet that is asked whether something that moved can touch it"""
PIXEL_NS, STILL_NS = 3.0, 0.15
"""of a pixel whose light changes, and of one whose light stands still"""
TERM_NS = {"low_pass": 3.0, "follower": 2.0, "high_pass": 2.0, "leak": 1.0, "running_mean": 3.0}
NETWORK_NS = 55.0
"""evsnet of 8 channels, of a pixel in a tick in which something moves"""
STEP_US, FREEDOM_US, POSE_US = 12.0, 1.5, 0.35
"""of a step of physics, of each degree of freedom in it, and of each geom that is placed"""


@dataclass(frozen=True)
class Cost:
    """Of one tick, on one core.

    Where a camera rests, renderer and sensor cost between `still` and the rest, by what moves.
    """

    primary_rays: int
    """from the camera, where every pixel is traced"""
    shadow_rays: int
    """to lights, at most, for those"""
    world_ms: float
    render_ms: float
    """every pixel is traced"""
    render_still_ms: float
    """nothing moves that can be seen; where the camera moves it is the same as render_ms"""
    sensor_ms: float
    """the light of every pixel changes"""
    sensor_still_ms: float
    source: str = "model"
    """model: from counts, good to a factor of about two | measured"""

    def plain(self) -> dict[str, Any]:
        """For JSON, to three digits."""
        return {
            key: float(f"{value:.3g}") if isinstance(value, float) else value
            for key, value in asdict(self).items()
        }


def estimate(
    world: MjModel,
    has: Contents,
    standing: Standing,
    sensor: SensorParameters,
    render: RenderConfig,
    model: ModelConfig,
    features: Mapping[str, bool],
) -> Cost:
    """The model's cost of a tick."""
    width, height = int(sensor.width), int(sensor.height)
    pixels = width * height
    packets = math.ceil(width / 4) * math.ceil(height / 4)
    casting = has.casting if features.get("shadows") else 0
    render_ns = packets * render.samples * _packet_ns(has, casting, render)
    if render.antialiasing == "adaptive" and render.renderer == "direct":
        render_ns *= 0.5
    moves = bool(standing.camera_moves) or features.get("full_retrace", True)
    still_ns = render_ns if moves or render.seeds == "fresh" else packets * ASK_NS
    if has.lights and features.get("light_gains"):
        still_ns = render_ns

    terms_ns = sum(cost for name, cost in TERM_NS.items() if features.get(name))
    pixel_ns = NETWORK_NS if model.name == "evsnet" else PIXEL_NS + terms_ns
    quiet_ns = pixel_ns if still_ns == render_ns else STILL_NS
    if features.get("cold_tiles"):
        quiet_ns = pixel_ns
    geoms = has.geoms_moving + has.geoms_still
    world_us = STEP_US + FREEDOM_US * world.nv + POSE_US * geoms
    primary = packets * PACKET * render.samples
    return Cost(
        primary_rays=primary,
        shadow_rays=primary * casting,
        world_ms=1e-3 * world_us,
        render_ms=1e-6 * render_ns,
        render_still_ms=1e-6 * still_ns,
        sensor_ms=1e-6 * pixels * pixel_ns,
        sensor_still_ms=1e-6 * pixels * quiet_ns,
    )


def _packet_ns(has: Contents, casting: int, render: RenderConfig) -> float:
    """ns of a sample of 16 pixels."""
    lights = sum(has.lights.values())
    geoms = sum(has.geoms.values())
    rays = 1 + casting
    ns = PACKET_NS + LIGHT_NS * lights + SHADOW_NS * casting + GEOM_NS * geoms * rays
    if has.triangles:
        ns += TRIANGLE_NS * math.log2(1 + has.triangles) / 10 * rays
    if has.textured or has.sky:
        ns += TEXTURE_NS
    if render.renderer == "path":
        return ns + PATH_NS * (1 + render.bounces)
    return ns
