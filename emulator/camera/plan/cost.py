"""What a tick is expected to cost, from counts: a small model, fitted once, on one core.

It is good to a factor of about two where there are no meshes and of four where there are, since it
does not know how much of the picture they fill, and of four for OpenGL, where it knows no GPU
(`Cost.within`; tests/bench/test_plan_cost.py prints it beside what is measured): enough to see
where the time goes and whether real time is near. `evs plan --measure` runs the scene instead.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

from evs.emulator.camera.plan.contents import Contents
from evs.emulator.config import RENDERERS, ModelConfig, RenderConfig
from evs.emulator.sensor import SensorParameters
from evs.emulator.world import MjModel, Mobility

PACKET = 16
"""pixels that are traced together"""

# ns of CPU time, one core of a 2023 server with AVX-512: fitted by hand to ten robots
PACKET_NS = 60.0
"""of a packet's sample: its rays and what they hit"""
LIGHT_NS, SHADOW_NS = 10.0, 15.0
"""of each light, and of one that casts shadows"""
GEOM_NS = 0.5
"""of each geom, for the camera rays and for those to each light"""
TRIANGLE_NS = 10.0
"""of meshes, for the same rays: of each level of their search trees"""
TEXTURE_NS, SKY_NS, MIRROR_NS = 40.0, 60.0, 60.0
POINT_NS, SKY_POINT_NS = 100.0, 230.0
"""of a point of a path, and more of it where a sky is aimed at"""
RASTER_GEOM_MS, RASTER_NS = 0.7, 90.0
"""by OpenGL in software: of a geom, and of a sample of a pixel; on a GPU a tenth of it"""
RENDER_US, REST_NS = 12.0, 6.5
"""of a picture; of a packet of one in which nothing moves"""
SENSOR_US, PIXEL_NS, STILL_NS = 15.0, 1.9, 0.8
"""of all pixels; of one whose light changes, and of one whose light stands still"""
TERM_NS = {"low_pass": 3.0, "follower": 2.0, "high_pass": 2.0, "leak": 1.0, "running_mean": 2.7}
NETWORK_NS, CHUNKED_NS = 130.0, 60.0
"""evsnet of 8 channels, of a pixel in a tick in which something moves; in chunks of 8 and more"""
WORLD_US, STEP_US, FREEDOM_US, DEFORM_US = 30.0, 15.0, 4.0, 400.0
"""of a tick; of a step of physics and each degree of freedom in it; of each skin or flex"""


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
    """nothing moves; where the camera moves it is the same as render_ms"""
    sensor_ms: float
    """the light of every pixel changes"""
    sensor_still_ms: float
    within: float
    """by what factor about it may be off, up or down"""

    def plain(self) -> dict[str, Any]:
        """For JSON, to three digits."""
        return {
            key: float(f"{value:.3g}") if isinstance(value, float) else value
            for key, value in asdict(self).items()
        }


def estimate(
    world: MjModel,
    has: Contents,
    mobility: Mobility,
    sensor: SensorParameters,
    render: RenderConfig,
    model: ModelConfig,
    features: Mapping[str, bool],
    steps: int = 1,
) -> Cost:
    """Estimate the cost of a tick.

    Args:
        world: The model.
        has: What the scene contains.
        mobility: What can move.
        sensor: The sensor, resolved.
        render: [render].
        model: [model].
        features: Which code paths run.
        steps: Steps of physics in a tick.
    """
    width, height = int(sensor.width), int(sensor.height)
    pixels = width * height
    packets = math.ceil(width / 4) * math.ceil(height / 4)
    casting = has.casting if features.get("shadows") else 0
    render_ns = packets * render.samples * _packet_ns(has, casting, render)
    renderer = RENDERERS[render.renderer]
    if render.antialiasing == "adaptive" and renderer.adaptive:
        render_ns *= 0.5
    if not renderer.traced:
        geoms_ns = 1e6 * RASTER_GEOM_MS * _drawn(has)
        render_ns = geoms_ns + RASTER_NS * pixels * render.samples
    moves = bool(mobility.camera_moves) or features.get("full_retrace", True)
    rest_ns = 0.0 if renderer.paths else REST_NS
    render_ns += 1e3 * RENDER_US
    still_ns = 1e3 * RENDER_US + packets * rest_ns
    if moves or render.seeds == "fresh":
        still_ns = render_ns
    if has.lights and features.get("light_gains"):
        still_ns = render_ns

    terms_ns = sum(cost for name, cost in TERM_NS.items() if features.get(name))
    pixel_ns = PIXEL_NS + terms_ns
    if model.name == "evsnet":
        pixel_ns = NETWORK_NS if model.chunk < 8 else CHUNKED_NS
    quiet_ns = STILL_NS
    if still_ns == render_ns or features.get("cold_tiles"):
        quiet_ns = pixel_ns
    step_us = STEP_US + FREEDOM_US * world.nv
    world_us = WORLD_US + step_us * steps + DEFORM_US * has.deforming
    primary = packets * PACKET * render.samples * renderer.traced
    return Cost(
        primary_rays=primary,
        shadow_rays=primary * casting,
        world_ms=1e-3 * world_us,
        render_ms=1e-6 * render_ns,
        render_still_ms=1e-6 * still_ns,
        sensor_ms=1e-3 * SENSOR_US + 1e-6 * pixels * pixel_ns,
        sensor_still_ms=1e-3 * SENSOR_US + 1e-6 * pixels * quiet_ns,
        within=4.0 if has.triangles or not renderer.traced else 2.0,
    )


def _drawn(has: Contents) -> int:
    return sum(has.geoms.values()) + has.sites + has.rods


def _packet_ns(has: Contents, casting: int, render: RenderConfig) -> float:
    """ns of a sample of 16 pixels."""
    rays = 1 + casting
    levels = math.log2(1 + has.triangles)
    met = GEOM_NS * _drawn(has) + TRIANGLE_NS * levels
    ns = PACKET_NS + LIGHT_NS * sum(has.lights.values()) + SHADOW_NS * casting + met * rays
    ns += TEXTURE_NS * (has.textured > 0) + SKY_NS * has.sky + MIRROR_NS * (has.mirrors > 0)
    if RENDERERS[render.renderer].paths:
        point_ns = POINT_NS + SKY_POINT_NS * has.sky + met * rays
        return ns + point_ns * (1 + render.bounces)
    return ns
