"""What a sweep varies: one axis at a time around each preset, never the full product."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

from evs.drivers.run.config import PipelineConfig
from evs.emulator.evsnet.network_files import families, members, network_names
from evs.emulator.sensor import resolve_sensor
from evs.msgs import EvsError, unknown
from evs_lab.sweep.points import SweepPoint, preset_of, sweep_point, unique
from evs_lab.sweep.record import FRAMES, OURS, PAPER, Setting

Changes = Mapping[str, Setting]
Values = Sequence[tuple[str, Changes]]
"""(in words, keys) of each value of an axis"""

PATH_SPP = 2048
"""the most that the axis goes to: the paper calls it noiseless"""
DIRECT_SPP = (1, 2, 4, 8, 16)
HYBRID_SPP = (1, 4, 16, 64)
TICKS_US = (250, 500, 1000, 2000, 4000, 10000)
SIZES = ((173, 130), (346, 260), (640, 480))
CYCLES = (2, 4, 8)
CHUNKS = (1, 8, 32)
THREADS = (1, 2, 4)
FPS = (60, 100, 250, 500, 1000)
NETWORKS = ("evsnet_c4", "evsnet_c8", "paper")
FILTER_HZ = 300.0
"""bandwidth with which the two filters are compared: v2e's own"""


def _by_path(base: PipelineConfig) -> Changes | None:
    """What makes `path` of a preset of soft light, with its samples; None: its light is hard."""
    if base.render.renderer == "hybrid":
        return {"render.renderer": "path"}
    return {} if base.render.renderer == "path" else None


def renderer(base: PipelineConfig) -> Values:
    """Each renderer with the samples that it takes by itself."""
    del base
    plain: Changes = {"render.seeds": "fixed", "render.antialiasing": "fixed"}
    return [
        ("raster 4", {**plain, "render.renderer": "raster", "render.spp": 4}),
        ("direct 4", {**plain, "render.renderer": "direct", "render.spp": 4}),
        ("hybrid 4", {**plain, "render.renderer": "hybrid", "render.spp": 4}),
        ("path 16", {**plain, "render.renderer": "path", "render.spp": 16}),
    ]


def samples(base: PipelineConfig) -> Values:
    """Samples a pixel: by powers of two with `direct`, by powers of four around it with `path`.

    And more of them at edges: with `path` four times as many as elsewhere. `hybrid` has few values,
    since its cached light is the same with any of them.
    """
    render = base.render
    every: Changes = {"render.antialiasing": "fixed"}
    edges: Changes = {"render.antialiasing": "adaptive"}
    if render.renderer == "path":
        at_edges = render.adaptive
        own = max(1, render.samples // 4) if at_edges else render.samples
        steps = [own * 4**k for k in (-2, -1, 0, 1, 2)]
        wanted = sorted({min(PATH_SPP, step) for step in map(int, steps) if step >= 1})
        return [
            *((f"path {spp}", {**every, "render.spp": spp}) for spp in wanted),
            *(
                (f"path {4 * spp} at edges", {**edges, "render.spp": 4 * spp})
                for spp in wanted
                if own <= 4 * spp <= 4 * own and 4 * spp <= PATH_SPP
            ),
        ]
    if render.renderer == "raster":
        return [(f"raster {spp}", {"render.spp": spp}) for spp in (1, 4)]
    if render.renderer == "hybrid":
        own = render.samples
        return [
            *((f"hybrid {spp}", {**every, "render.spp": spp}) for spp in HYBRID_SPP),
            (f"hybrid {max(4, own)} at edges", {**edges, "render.spp": max(4, own)}),
        ]
    return [
        *((f"direct {spp}", {**every, "render.spp": spp}) for spp in DIRECT_SPP),
        *((f"direct {spp} at edges", {**edges, "render.spp": spp}) for spp in (4, 16)),
    ]


def seeds(base: PipelineConfig) -> Values:
    """Samples of `path` that are the same every tick, or new ones."""
    path = _by_path(base)
    if path is None:
        return []
    return [(name, {**path, "render.seeds": name}) for name in ("fixed", "fresh")]


def cycle(base: PipelineConfig) -> Values:
    """A cycle of point sets of several lengths with `path`, each tick with the preset's samples."""
    path = _by_path(base)
    if path is None:
        return []
    return [
        (f"cycle of {ticks}", {**path, "render.seeds": "cycle", "render.cycle_ticks": ticks})
        for ticks in CYCLES
    ]


def model(base: PipelineConfig) -> Values:
    """The event model."""
    del base
    return [
        ("plain", {"model.name": "plain", "model.chunk": 1}),
        ("adaptive", {"model.name": "adaptive", "model.chunk": 1}),
        ("evsnet", {"model.name": "evsnet", "model.network": "evsnet_c8", "model.chunk": 8}),
    ]


def network(base: PipelineConfig) -> Values:
    """Networks of several widths on fresh noise of `path`, for which they were trained."""
    path = _by_path(base)
    if path is None:
        return []
    shipped = network_names()
    there = [
        name
        for name in NETWORKS
        if name in shipped or (name in families(shipped) and members(name, shipped))
    ]
    noisy: Changes = {**path, "render.seeds": "fresh", "model.name": "evsnet", "model.chunk": 8}
    return [(f"{name}, fresh", {**noisy, "model.network": name}) for name in there]


def chunk(base: PipelineConfig) -> Values:
    """Ticks that the network takes at once: the same events, later and faster."""
    del base
    evsnet: Changes = {"model.name": "evsnet", "model.network": "evsnet_c8"}
    return [
        (f"{ticks} tick{'s' * (ticks > 1)}", {**evsnet, "model.chunk": ticks}) for ticks in CHUNKS
    ]


def tick(base: PipelineConfig) -> Values:
    """Length of a tick. Networks are for ticks of 1 ms, so a preset with one has none."""
    if base.model.name == "evsnet":
        return []
    return [(f"{tick_us / 1000:g} ms", {"scene.tick_us": tick_us}) for tick_us in TICKS_US]


def resolution(base: PipelineConfig) -> Values:
    """Pixels of the sensor; the field of view stays."""
    now = resolve_sensor(base.sensor)
    return [
        (f"{width} x {height}", {"sensor.width": width, "sensor.height": height})
        for width, height in SIZES
        if (width, height) != (now.width, now.height)
    ]


def precision(base: PipelineConfig) -> Values:
    """What rounds or approximates: the pixel's filter, the network's runtime.

    Light and networks are of 32-bit floats throughout and there is no other number format to choose
    (bf16 cost 8 % EMD, so there is none): what remains are an exact and an Euler step of the low
    pass, with a bandwidth that lets it matter, and the network's own kernel and onnxruntime, whose
    sums run in another order. Light of 8 bits is on the axis of the peers that have it.
    """
    found: list[tuple[str, Changes]] = []
    if base.model.name != "evsnet":
        low: Changes = {"sensor.cutoff_hz": FILTER_HZ, "sensor.follower_hz": 0.0}
        found = [
            (f"{name} filter, {FILTER_HZ:g} Hz", {**low, "sensor.filter": name})
            for name in ("exact", "euler")
        ]
    if _by_path(base) is not None:
        evsnet: Changes = {
            "model.name": "evsnet", "model.network": "evsnet_c8", "model.chunk": 8
        }  # fmt: skip
        found += [
            (f"evsnet {name}", {**evsnet, "model.runtime": name})
            for name in ("native", "onnxruntime")
        ]
    return found


def threads(base: PipelineConfig) -> Values:
    """Worker threads; the same bytes."""
    del base
    return [(f"{n} thread{'s' * (n > 1)}", {"threads": n}) for n in THREADS]


def ahead(base: PipelineConfig) -> Values:
    """Light of the next ticks rendered in parallel with the events of this one, or in sequence."""
    del base
    return [(f"{ticks} tick{'s' * (ticks != 1)}", {"ahead": ticks}) for ticks in (0, 2)]


def incremental(base: PipelineConfig) -> Values:
    """Trace only what moved, or everything; the same bytes."""
    if base.render.renderer == "raster":
        return []
    return [("on", {"render.incremental": True}), ("off", {"render.incremental": False})]


def frames(base: PipelineConfig) -> Values:
    """Frames first, events from frames, as in v2e and ESIM (frame_methods.py).

    A frame is of one instant, so its seeds are fixed, and soft light is that of `path`: what
    `hybrid` caches is as many frames old as ticks.
    """
    path = _by_path(base) or {}
    plain: Changes = {**path, "model.name": "plain", "model.chunk": 1, "render.seeds": "fixed"}
    found: list[tuple[str, Changes]] = [
        (f"{method}, {fps} FPS", {**plain, "scene.tick_us": round(1e6 / fps)})
        for method in ("ESIM", "v2e")
        for fps in FPS
    ]
    every_ms: Changes = {**plain, "scene.tick_us": 1000}
    return [*found, ("v2e, 1000 FPS, 8 bit", every_ms), ("v2e, 1000 FPS, 8 bit sRGB", every_ms)]


def paper(base: PipelineConfig) -> Values:
    """A pipeline as the paper's: 64 samples, new noise every tick, its network that looks ahead."""
    del base
    return [
        (
            "64 spp fresh, its network",
            {
                "render.renderer": "path",
                "render.spp": 64,
                "render.seeds": "fresh",
                "render.antialiasing": "fixed",
                "model.name": "evsnet",
                "model.network": "paper",
                "model.chunk": 8,
                "scene.tick_us": 1000,
            },
        )
    ]


AXES: dict[str, Callable[[PipelineConfig], Values]] = {
    "renderer": renderer,
    "samples": samples,
    "seeds": seeds,
    "cycle": cycle,
    "model": model,
    "network": network,
    "chunk": chunk,
    "tick": tick,
    "resolution": resolution,
    "precision": precision,
    "threads": threads,
    "ahead": ahead,
    "incremental": incremental,
    "frames": frames,
    "paper": paper,
}
"""axis -> its values around a preset; empty: the axis does not apply"""

KINDS = {"frames": FRAMES, "paper": PAPER}
"""axes of other emulators' methods"""

DEFAULT: dict[str, tuple[str, ...]] = {
    "fast": ("renderer", "samples", "model", "tick", "resolution", "threads", "ahead",
             "incremental"),
    "balanced": ("renderer", "samples", "model", "tick", "incremental"),
    "accurate": ("samples", "seeds", "cycle", "model", "network", "chunk", "precision", "frames",
                 "paper"),
    "reference": ("samples",),
}  # fmt: skip
"""preset -> default axes of a sweep, each around the preset where it shows most for its time"""

QUICK: dict[str, tuple[str, ...]] = {
    "fast": ("samples", "tick"),
    "balanced": ("renderer", "samples"),
}
"""The same of `--quick`."""


def points(
    presets: Sequence[str], axes: Sequence[str] = (), *, quick: bool = False
) -> list[SweepPoint]:
    """The points of a sweep: each preset, then its axes.

    Args:
        presets: names or files.
        axes: around every preset; empty: those of the tables above.
        quick: use the table QUICK.

    Raises:
        EvsError: an axis or preset does not exist or is named twice, or no axis applies.
    """
    for what, names in (("preset", presets), ("axis", axes)):
        if len(set(names)) < len(names):
            raise EvsError(f"a {what} is given twice in {', '.join(names)}; give each once")
    if not presets:
        raise EvsError(f"no preset is asked for; give for example {', '.join(DEFAULT)}")
    for name in axes:
        if name not in AXES:
            raise unknown("axis", name, AXES)
    found: list[SweepPoint] = []
    for preset in presets:
        base = preset_of(preset)
        found.append(SweepPoint(preset))
        table = QUICK if quick else DEFAULT
        for axis in axes or table.get(preset, ("samples", "tick") if not quick else ()):
            kind = KINDS.get(axis, OURS)
            for value, changes in AXES[axis](base):
                found.append(sweep_point(preset, axis, value, changes, kind))
    if axes and not any(one.axis for one in unique(found)):
        raise EvsError(
            f"no value of {', '.join(axes)} differs from {', '.join(presets)}; give another axis"
        )
    return unique(found)
