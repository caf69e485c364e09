"""The renderer that a configuration names, checked and made."""

from __future__ import annotations

from evs.emulator import _core
from evs.emulator.base.features import UNFORCED, Switches
from evs.emulator.base.gpu.driver import DEVICES
from evs.emulator.base.protocols import Renderer
from evs.emulator.base.scene import CameraModel, SceneModel
from evs.emulator.config import RenderConfig
from evs.emulator.render.device import device_of
from evs.emulator.render.native import NativeRenderer
from evs.emulator.render.renderer_table import RENDERERS
from evs.emulator.render.seed_cycle import CycleRenderer
from evs.msgs import EvsError, unknown
from evs.msgs.registry import load

SAMPLERS = ("owen", "sobol", "global", "random", "anchored")
MAX_BOUNCES = 64
MAX_CYCLE_TICKS = 16
MAX_THREADS = 1024


def make_renderer(
    scene: SceneModel,
    camera: CameraModel,
    config: RenderConfig,
    threads: int,
    rgb: bool = False,
    seed: int = 0,
    switches: Switches = UNFORCED,
    like: Renderer | None = None,
) -> Renderer:
    """The renderer of one camera.

    Args:
        scene: What is seen.
        camera: The optics.
        config: [render].
        threads: Worker threads; 0: one per core.
        rgb: Whether colour is wanted beside the luminance.
        seed: What the noise of `path` follows from.
        switches: Code paths that are forced on or off (not of raster).
        like: The same camera's renderer until now, whose threads, meshes and images are shared
            where they are the same (not of raster).

    Raises:
        EvsError: The configuration makes no sense.
    """
    check_render(config)
    config = config.for_scene(scene.has_meshes)
    for name in config.linear_textures:
        if name not in scene.texture_names:
            raise unknown("render.linear_textures", name, list(scene.texture_names))
    if not 0 <= threads <= MAX_THREADS:
        raise EvsError(f"threads is {threads}; give 0 for one per core, or 1 ... {MAX_THREADS}")
    row = RENDERERS[config.renderer]
    if rgb and not row.colour:
        raise EvsError(
            f"{config.renderer} gives no colour, only luminance: take render.renderer=direct"
        )
    like = like.renderers[0] if isinstance(like, CycleRenderer) else like
    before = like if isinstance(like, NativeRenderer) else None
    device = device_of(scene, config, rgb)
    if config.seeds == "cycle":
        parts = scene, camera, config, threads, rgb, seed, switches
        first = NativeRenderer(*parts, before, device)
        # the others share its threads, meshes and images
        rest = [NativeRenderer(*parts, first, device, i) for i in range(1, config.cycle_ticks)]
        return CycleRenderer([first, *rest])
    options = {
        "threads": threads,
        "rgb": rgb,
        "seed": seed,
        "switches": switches,
        "like": before,
        "device": device,
    }
    given = {name: options[name] for name in row.options}
    made: Renderer = load(row.target)(scene, camera, config, **given)
    return made


def check_render(config: RenderConfig) -> None:
    """EvsError where a value of the configuration makes no sense."""
    if config.renderer not in RENDERERS:
        raise unknown("renderer", config.renderer, list(RENDERERS))
    _check_samples(config)
    if config.antialiasing not in (None, "fixed", "adaptive"):
        raise unknown("render.antialiasing", config.antialiasing, ["fixed", "adaptive"])
    if config.headlight not in ("model", "off"):
        raise unknown("render.headlight", config.headlight, ["model", "off"])
    if config.sky not in ("backdrop", "light"):
        raise unknown("render.sky", config.sky, ["backdrop", "light"])
    if config.device not in DEVICES:
        raise unknown("render.device", config.device, list(DEVICES))
    if config.lux_per_unit <= 0:
        raise EvsError(f"render.lux_per_unit is {config.lux_per_unit}; it must be positive")
    if config.isa not in ("auto", *_core.isa_available()):
        raise unknown("instruction set", config.isa, ["auto", *_core.isa_available()])


def _check_samples(config: RenderConfig) -> None:
    row, spp = RENDERERS[config.renderer], config.samples
    if not 1 <= spp <= row.max_spp:
        raise EvsError(
            f"render.spp is {spp}; with renderer {config.renderer} it must be 1 ... {row.max_spp}"
        )
    if config.seeds not in row.seeds:
        raise unknown("render.seeds", config.seeds, list(row.seeds))
    if not 2 <= config.cycle_ticks <= MAX_CYCLE_TICKS:
        raise EvsError(
            f"render.cycle_ticks is {config.cycle_ticks}; it must be 2 ... {MAX_CYCLE_TICKS}"
        )
    if not 0 <= config.bounces <= MAX_BOUNCES:
        raise EvsError(f"render.bounces is {config.bounces}; it must be 0 ... {MAX_BOUNCES}")
    if config.sampler not in SAMPLERS:
        raise unknown("render.sampler", config.sampler, list(SAMPLERS))
