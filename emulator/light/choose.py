"""Which renderer a configuration asks for."""

from __future__ import annotations

from evs.emulator import _core
from evs.emulator.config import RenderConfig
from evs.emulator.light.direct import DirectRenderer
from evs.emulator.scene import CameraModel, SceneModel
from evs.emulator.stages import Renderer
from evs.msgs import EvsError, unknown

MAX_SPP = 64
RENDERERS = ("direct", "raster")
MAX_THREADS = 1024


def make_renderer(
    scene: SceneModel,
    camera: CameraModel,
    config: RenderConfig,
    threads: int,
    rgb: bool = False,
) -> Renderer:
    """The renderer of one camera. Raises EvsError where the configuration makes no sense.

    In: rgb, colour is wanted beside the luminance.
    """
    if config.renderer not in RENDERERS:
        raise unknown("renderer", config.renderer, list(RENDERERS))
    if not 1 <= config.spp <= MAX_SPP:
        raise EvsError(f"render.spp is {config.spp}; it must be 1 ... {MAX_SPP}")
    # no noise, so there is nothing that could be fresh
    if config.seeds != "fixed":
        raise unknown("render.seeds", config.seeds, ["fixed"])
    if config.antialiasing not in ("fixed", "adaptive"):
        raise unknown("render.antialiasing", config.antialiasing, ["fixed", "adaptive"])
    if config.headlight not in ("model", "off"):
        raise unknown("render.headlight", config.headlight, ["model", "off"])
    if config.lux_per_unit <= 0:
        raise EvsError(f"render.lux_per_unit is {config.lux_per_unit}; it must be positive")
    if config.isa not in ("auto", *_core.isa_available()):
        raise unknown("instruction set", config.isa, ["auto", *_core.isa_available()])
    if not 0 <= threads <= MAX_THREADS:
        raise EvsError(f"threads is {threads}; give 0 for one a core, or 1 ... {MAX_THREADS}")
    if config.renderer == "raster":
        # an extra: what it imports need not be there
        from evs.emulator.light.raster import RasterRenderer

        if rgb:
            raise EvsError("raster gives no colour, only luminance: take render.renderer=direct")
        return RasterRenderer(scene, camera, config)
    return DirectRenderer(scene, camera, config, threads, rgb)
