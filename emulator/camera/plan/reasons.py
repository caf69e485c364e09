"""One reason for each code path that is on or off, from what the scene contains.

The decision itself is made where the code path is, and read from there: a reason explains it.
"""

from __future__ import annotations

from dataclasses import dataclass

from evs.emulator.camera.plan.contents import Contents
from evs.emulator.config import RENDERERS, ModelConfig, RenderConfig
from evs.emulator.sensor import SensorParameters
from evs.emulator.sensor.terms import TERMS
from evs.emulator.world import Mobility


@dataclass(frozen=True)
class Why:
    """Both reasons of a code path; the one that does not hold is never shown."""

    on: str
    off: str


def reasons(
    has: Contents,
    mobility: Mobility,
    sensor: SensorParameters,
    render: RenderConfig,
    model: ModelConfig,
) -> dict[str, Why]:
    """name of the code path -> why it is on, or off."""
    path = RENDERERS[render.renderer].paths
    return {
        **_surfaces(has, path),
        **_air(has, render),
        **_light(has, mobility, render, path),
        **_sensor(sensor),
        **_beside(sensor, model),
    }


def _surfaces(has: Contents, path: bool) -> dict[str, Why]:
    of_paths = "only renderer path has it"
    lobes = (
        "paths see every gloss as a GGX lobe"
        if path
        else f"materials that ask for it: {has.physical}"
    )
    return {
        "physical_gloss": Why(lobes, "no material is physical or has maps"),
        "normal_maps": Why(f"materials that have one: {has.bumpy}", "no material has a normal map"),
        "texture_filter": Why("surfaces have images or maps", "no surface has an image or a map"),
        "glowing": Why(
            f"surfaces that glow: {has.glowing}", "no surface glows" if path else of_paths
        ),
        "transparent": Why(
            f"surfaces that are: {has.transparent}",
            "no surface is transparent" if path else f"{of_paths}: direct looks at each pixel",
        ),
        "refits": Why(
            "a skin or flex changed its shape",
            "no skin or flex moves" if has.deforming else "the scene has no skin and no flex",
        ),
    }


def _air(has: Contents, render: RenderConfig) -> dict[str, Why]:
    without = "no plane without bounds" if has.sky else "no sky"
    haze = "render.haze=false" if not render.haze else f"there is {without} and so no horizon"
    if has.haze:
        haze = "the camera sees no horizon"
    return {
        "sky": Why("the model has a sky", "the model has no sky"),
        "fog": Why("render.fog=true", "render.fog=false"),
        "haze": Why("a sky, and a plane without bounds", haze),
    }


def _light(has: Contents, mobility: Mobility, render: RenderConfig, path: bool) -> dict[str, Why]:
    coloured = ", ".join(has.coloured[:3])
    bent = "camera.distortion_model"
    retrace = "render.incremental=false" if RENDERERS[render.renderer].traced else "OpenGL draws it"
    kept = f"{'samples' if path else 'pixels'} that nothing that moved can touch are kept"
    if mobility.camera_moves:
        kept += f", while the camera rests ({mobility.camera_moves})"
    return {
        "colour": Why(
            "light goes from surface to surface" if path else f"lights not grey: {coloured}",
            "every light is grey: luminance is enough",
        ),
        "shadows": Why(
            f"lights that cast them: {has.casting}",
            "render.shadows=false" if not render.shadows else "no light casts any",
        ),
        "plane_shadows": Why(
            "a light is behind a plane",
            f"the lights are on the front of every plane ({has.planes})"
            if has.planes
            else "there is no plane",
        ),
        "light_gains": Why("[[render.flicker]]", "no light flickers"),
        "lens": Why(bent, f"{bent}=none: a pinhole"),
        "vignetting": Why("camera.vignetting", "camera.vignetting=none"),
        "full_retrace": Why(retrace, kept),
    }


def _sensor(sensor: SensorParameters) -> dict[str, Why]:
    """The parameters that need each term."""

    def values(keys: tuple[str, ...]) -> str:
        return ", ".join(f"sensor.{key}={getattr(sensor, key):g}" for key in keys)

    return {name: Why(values(keys), values(keys)) for name, keys in TERMS.items()}


def _readout(sensor: SensorParameters) -> str:
    """The stages between pixel and packet that the sensor has."""
    readout = sensor.readout
    stages = {
        "a latency of the pixels": sensor.latency_us > 0 or sensor.latency_sigma_us > 0,
        f"rows read by {readout.order}": readout.order != "ideal",
        f"event rate control at {readout.erc_rate_mevs:g} Mev/s": readout.erc_rate_mevs > 0,
        f"a link of {readout.bandwidth_mevs:g} Mev/s": readout.bandwidth_mevs > 0,
        "a region of interest": bool(readout.roi),
        "masked pixels": bool(readout.mask or readout.mask_file),
    }
    return ", ".join(stage for stage, there in stages.items() if there)


def _beside(sensor: SensorParameters, model: ModelConfig) -> dict[str, Why]:
    labels = "model.labels=true"
    return {
        "ground_truth": Why(labels, "traced when a listener asks"),
        "causes": Why(labels, "model.labels=false"),
        "running_mean": Why(f"model {model.name}", f"model {model.name}"),
        "cold_tiles": Why(
            "the network has a bias" if model.runtime == "native" else f"runtime {model.runtime}",
            "tiles where nothing moves are left out",
        ),
        "readout": Why(_readout(sensor), "every event passes at its own time"),
        "aps": Why("sensor.aps.enabled=true", "sensor.aps.enabled=false"),
        "imu": Why("sensor.imu.enabled=true", "sensor.imu.enabled=false"),
    }
