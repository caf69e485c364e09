"""The table of renderers, where a new one plugs in.

A new renderer is a class that follows evs.emulator.base.protocols.Renderer, and a row here, which
holds all that the rest of evs knows of it.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class RendererRow:
    """One renderer."""

    target: str
    """"module:Class", imported at first use"""
    default_spp: int
    """samples per pixel if the configuration sets none: the fewest that give usable events"""
    max_spp: int
    mesh_spp: int = 0
    """the same where edges of meshes are seen and samples at edges alone are taken; 0: default_spp.
    Other outlines are areas, and meshes have no closed form"""
    adaptive: bool = False
    """render.antialiasing is adaptive unless the configuration sets it"""
    seeds: tuple[str, ...] = ("fixed",)
    """values of render.seeds; a renderer without noise has "fixed" only"""
    options: tuple[str, ...] = ()
    """what its constructor takes after scene, camera and configuration: of threads, rgb, seed,
    switches, like and device (make_renderer explains them)"""
    paths: bool = False
    """follows paths of light from every pixel: it has noise"""
    bounces: bool = False
    """light goes from surface to surface"""
    caches_light: bool = False
    """keeps light on surfaces from tick to tick"""
    cuda: str = ""
    """"module:Class" of its device on a GPU (evs.emulator.render.device.Device); empty: there is
    none"""
    traced: bool = True
    """traces rays itself, and only those that a motion can touch"""

    @property
    def colour(self) -> bool:
        """Whether it can give colour beside the luminance."""
        return "rgb" in self.options


NATIVE = ("threads", "rgb", "seed", "switches", "like", "device")
"""options of NativeRenderer"""

RENDERERS = {
    "direct": RendererRow(
        "evs.emulator.render.native:NativeRenderer",
        default_spp=4,
        max_spp=64,
        adaptive=True,
        options=NATIVE,
        cuda="evs.emulator.render.gpu.direct:DirectOnGpu",
    ),
    "hybrid": RendererRow(
        "evs.emulator.render.native:NativeRenderer",
        default_spp=4,
        mesh_spp=16,
        max_spp=64,
        adaptive=True,
        options=NATIVE,
        cuda="evs.emulator.render.gpu.hybrid:HybridOnGpu",
        bounces=True,
        caches_light=True,
    ),
    "path": RendererRow(
        "evs.emulator.render.native:NativeRenderer",
        default_spp=16,
        max_spp=4096,
        seeds=("fixed", "fresh", "cycle"),
        options=NATIVE,
        cuda="evs.emulator.render.gpu.path:PathOnGpu",
        paths=True,
        bounces=True,
    ),
    "raster": RendererRow(
        "evs.emulator.render.raster:RasterRenderer",
        default_spp=4,
        max_spp=64,
        traced=False,
    ),
}
"""render.renderer -> its row"""

SEEDS = {name: row.seeds for name, row in RENDERERS.items()}
"""render.renderer -> values of render.seeds"""
