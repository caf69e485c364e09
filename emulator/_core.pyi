"""The native core: ray caster, event pixel and event network."""

from collections.abc import Callable, Mapping, Sequence
from typing import Annotated

import numpy
from numpy.typing import NDArray


class Optics:
    """Pixels and rays of one camera; lengths in px."""

    def __init__(self, *, width: int, height: int, fx: float, fy: float, cx: float, cy: float, orthographic: bool = False, lens: Annotated[NDArray[numpy.float32], dict(shape=(None, None, 3), order='C', device='cpu', writable=False)] | None = None, share: Annotated[NDArray[numpy.float32], dict(shape=(None, None), order='C', device='cpu', writable=False)] | None = None) -> None:
        """
        orthographic: fx and fy are px/m; lens (height + 1, width + 1, 3): the ray at each pixel corner, camera frame; share (height, width): the share of its light that a pixel gets.
        """

class Tracing:
    """How light is computed, and what is output."""

    def __init__(self, *, samples: int = 1, adaptive: bool = False, shadows: bool = True, incremental: bool = False, rgb: bool = False, integrator: str = 'direct', bounces: int = 0, sample_set: str = 'owen', forced: Mapping[str, bool] = {}) -> None:
        """
        samples: of a pixel; adaptive: only where neighbours differ, one elsewhere; incremental: with a still camera, reuse what nothing that moved can affect; rgb: `render` can output colour; integrator: direct or path; bounces, sample_set: of path; forced: code paths by name that are on, with the same bytes, or off, whatever the scene needs, for tests.
        """

def isa_available() -> list[str]:
    """Instruction sets that this build and this machine have, fastest first."""

class SceneData:
    """
    The constant part of a scene, filled once: textures, surfaces, meshes, lights, then geoms.
    """

    def __init__(self) -> None: ...

    def add_texture(self, data: Annotated[NDArray[numpy.uint8], dict(shape=(None, None, None, None), order='C', device='cpu', writable=False)], srgb: bool, like: int = -1) -> int:
        """
        data (faces, height, width, components) uint8; its index. like: of the same image in the scene of the caster's `before`.
        """

    def add_surface(self, rgba: Sequence[float], texture: int, repeat: Sequence[float], uniform: bool, emission: float, specular: float, shininess: float, reflectance: float, metallic: float, roughness: float, maps: Sequence[int]) -> None:
        """
        maps: textures for metallic, roughness, occlusion, opacity, normal, emissive; -1 none.
        """

    def add_mesh(self, vertices: Annotated[NDArray[numpy.float32], dict(shape=(None, 3), order='C', device='cpu', writable=False)], faces: Annotated[NDArray[numpy.int32], dict(shape=(None, 3), order='C', device='cpu', writable=False)], normals: Annotated[NDArray[numpy.float32], dict(shape=(None, 3, 3), order='C', device='cpu', writable=False)] | None, texcoords: Annotated[NDArray[numpy.float32], dict(shape=(None, 3, 2), order='C', device='cpu', writable=False)] | None) -> None:
        """
        vertices (nv, 3), faces (nf, 3), normals (nf, 3, 3), texcoords (nf, 3, 2).
        """

    def share_mesh(self, caster: Caster, mesh: int) -> None:
        """The mesh of a caster, shared until one of them deforms it."""

    def add_light(self, kind: int, ambient: Sequence[float], diffuse: Sequence[float], specular: Sequence[float], castshadow: bool, attenuation: Sequence[float], cutoff_deg: float, exponent: float, intensity: float, headlight: bool, range: float, softness: float, texture: int, bulbradius: float) -> None: ...

    def set_fog(self, start: float, end: float, color: Sequence[float]) -> None:
        """Distances in m, display-coded colour."""

    def set_haze(self, ratio: float, radius: float, color: Sequence[float]) -> None:
        """
        Share of the distance to the horizon, that distance in m, display-coded colour.
        """

    def set_geoms(self, type: Annotated[NDArray[numpy.int32], dict(shape=(None,), order='C', device='cpu', writable=False)], size: Annotated[NDArray[numpy.float32], dict(shape=(None, 3), order='C', device='cpu', writable=False)], mesh: Annotated[NDArray[numpy.int32], dict(shape=(None,), order='C', device='cpu', writable=False)], surface: Annotated[NDArray[numpy.int32], dict(shape=(None,), order='C', device='cpu', writable=False)]) -> None: ...

    @property
    def skybox(self) -> int:
        """Index of the skybox's texture, -1 none."""

    @skybox.setter
    def skybox(self, arg: int, /) -> None: ...

class Caster:
    """One camera's view of one scene."""

    def __init__(self, scene: SceneData, optics: Optics, tracing: Tracing, *, threads: int = 1, isa: str = 'auto', before: Caster | None = None) -> None:
        """
        threads: 0 is one a core; isa: auto, or one of isa_available(). before: of the same camera until now; its threads and images are shared.
        """

    def trace_pixels(self, geom_pos: Annotated[NDArray[numpy.float64], dict(shape=(None, 3), order='C', device='cpu', writable=False)], geom_mat: Annotated[NDArray[numpy.float64], dict(shape=(None, 9), order='C', device='cpu', writable=False)], light_pos: Annotated[NDArray[numpy.float64], dict(shape=(None, 3), order='C', device='cpu', writable=False)], light_dir: Annotated[NDArray[numpy.float64], dict(shape=(None, 3), order='C', device='cpu', writable=False)], camera_pos: Annotated[NDArray[numpy.float64], dict(shape=(3), order='C', device='cpu', writable=False)], camera_mat: Annotated[NDArray[numpy.float64], dict(shape=(9), order='C', device='cpu', writable=False)], x: Annotated[NDArray[numpy.int32], dict(shape=(None,), order='C', device='cpu', writable=False)], y: Annotated[NDArray[numpy.int32], dict(shape=(None,), order='C', device='cpu', writable=False)], luminance: Annotated[NDArray[numpy.float32], dict(shape=(None,), order='C', device='cpu')], seed: int = 0) -> None:
        """luminance (n) of the pixels (x, y), (n) int32 each."""

    def set_light_gains(self, gains: Annotated[NDArray[numpy.float32], dict(shape=(None,), order='C', device='cpu', writable=False)]) -> None:
        """
        Each light's strength (nl) from the next call on, 1 as the scene has it.
        """

    def deform(self, mesh: int, vertices: Annotated[NDArray[numpy.float32], dict(shape=(None, 3), order='C', device='cpu', writable=False)], normals: Annotated[NDArray[numpy.float32], dict(shape=(None, 3), order='C', device='cpu', writable=False)]) -> None:
        """
        New vertices (nv, 3) and unit normals (nv, 3) of a mesh, before a call of render.
        """

    def resize(self, geoms: Annotated[NDArray[numpy.int32], dict(shape=(None,), order='C', device='cpu', writable=False)], sizes: Annotated[NDArray[numpy.float32], dict(shape=(None, 3), order='C', device='cpu', writable=False)]) -> None:
        """
        New sizes (n, 3) of geoms (n) that are no planes and no meshes, before a call of render; with a radius of 0 none is hit.
        """

    def render(self, geom_pos: Annotated[NDArray[numpy.float64], dict(shape=(None, 3), order='C', device='cpu', writable=False)], geom_mat: Annotated[NDArray[numpy.float64], dict(shape=(None, 9), order='C', device='cpu', writable=False)], light_pos: Annotated[NDArray[numpy.float64], dict(shape=(None, 3), order='C', device='cpu', writable=False)], light_dir: Annotated[NDArray[numpy.float64], dict(shape=(None, 3), order='C', device='cpu', writable=False)], camera_pos: Annotated[NDArray[numpy.float64], dict(shape=(3), order='C', device='cpu', writable=False)], camera_mat: Annotated[NDArray[numpy.float64], dict(shape=(9), order='C', device='cpu', writable=False)], luminance: Annotated[NDArray[numpy.float32], dict(shape=(None, None), order='C', device='cpu')], rgb: Annotated[NDArray[numpy.float32], dict(shape=(None, None, 3), order='C', device='cpu')] | None = None, seed: int = 0, copy: Annotated[NDArray[numpy.float32], dict(shape=(None, None), order='C', device='cpu')] | None = None) -> None:
        """
        luminance (h, w) and rgb (h, w, 3) float32 must be the same arrays, untouched, in every call. copy: (h, w) float32, where the luminance goes as well.
        """

    def trace_truth(self, geom_pos: Annotated[NDArray[numpy.float64], dict(shape=(None, 3), order='C', device='cpu', writable=False)], geom_mat: Annotated[NDArray[numpy.float64], dict(shape=(None, 9), order='C', device='cpu', writable=False)], light_pos: Annotated[NDArray[numpy.float64], dict(shape=(None, 3), order='C', device='cpu', writable=False)], light_dir: Annotated[NDArray[numpy.float64], dict(shape=(None, 3), order='C', device='cpu', writable=False)], camera_pos: Annotated[NDArray[numpy.float64], dict(shape=(3), order='C', device='cpu', writable=False)], camera_mat: Annotated[NDArray[numpy.float64], dict(shape=(9), order='C', device='cpu', writable=False)], geom: Annotated[NDArray[numpy.int32], dict(shape=(None, None), order='C', device='cpu')], distance: Annotated[NDArray[numpy.float32], dict(shape=(None, None), order='C', device='cpu')], point: Annotated[NDArray[numpy.float32], dict(shape=(None, None, 3), order='C', device='cpu')], normal: Annotated[NDArray[numpy.float32], dict(shape=(None, None, 3), order='C', device='cpu')], triangle: Annotated[NDArray[numpy.int32], dict(shape=(None, None), order='C', device='cpu')], barycentric: Annotated[NDArray[numpy.float32], dict(shape=(None, None, 2), order='C', device='cpu')]) -> None:
        """
        What each pixel's centre shows: geom (h, w) int32, -1 none; distance (h, w), m; point and normal (h, w, 3), camera frame; face (h, w) int32 of a mesh, -1 none, and the shares (h, w, 2) of its second and third corner. Where nothing is hit, point is the ray's direction.
        """

    @property
    def traced_fraction(self) -> float: ...

    @property
    def channels(self) -> int: ...

    @property
    def features(self) -> dict[str, bool]:
        """
        Which code paths it runs, by name: as the last tick was placed, where that decides.
        """

    @property
    def work(self) -> dict[str, int]:
        """
        What it has done since it was made: ticks, packets of 4 x 4 pixels that were asked whether something that moved can touch them, packets that were traced, trees that were built and refitted.
        """

def events_fit(raw: bytes | memoryview, base_us: int, end_us: int, width: int, height: int) -> bool:
    """
    Whether raw holds whole events, sorted by t in (base_us, end_us], on the sensor, with polarity 0 or 1 and zero padding.
    """

class NetworkArray:
    """EvSNet on an array of pixels."""

    def __init__(self, width: int, height: int, *, weights: Annotated[NDArray[numpy.float32], dict(shape=(None,), order='C', device='cpu', writable=False)], biases: Annotated[NDArray[numpy.float32], dict(shape=(None, None), order='C', device='cpu', writable=False)], delays: Annotated[NDArray[numpy.int32], dict(shape=(None,), order='C', device='cpu', writable=False)], last: Annotated[NDArray[numpy.float32], dict(shape=(None,), order='C', device='cpu', writable=False)], last_bias: float, v_on: float, v_off: float, decay_low: Annotated[NDArray[numpy.float32], dict(shape=(None,), order='C', device='cpu', writable=False)], decay_high: Annotated[NDArray[numpy.float32], dict(shape=(None,), order='C', device='cpu', writable=False)], exposure_dn: float, dark_dn: float, linlog_dn: float, tick_us: int, dense: bool = False, threads: int = 0, isa: str = 'auto') -> None:
        """
        In: weights of all convolutions, one after another, each (out, in, 7); biases (convolutions, channels); delays (blocks,), ticks by which each residual sum is late.
        """

    def step(self, luminance: Annotated[NDArray[numpy.float32], dict(shape=(None, None, None), order='C', device='cpu', writable=False)], tick: int, begin_us: int, *, last_luminance: Annotated[NDArray[numpy.float32], dict(shape=(None, None), order='C', device='cpu')], last_log: Annotated[NDArray[numpy.float32], dict(shape=(None, None), order='C', device='cpu')], v: Annotated[NDArray[numpy.float32], dict(shape=(None, None), order='C', device='cpu')], last: Annotated[NDArray[numpy.int64], dict(shape=(None, None), order='C', device='cpu')], fifo: Annotated[NDArray[numpy.float32], dict(shape=(None, None), order='C', device='cpu')], tile_row: Annotated[NDArray[numpy.int32], dict(shape=(None, None), order='C', device='cpu')], tile_moved: Annotated[NDArray[numpy.int64], dict(shape=(None, None, None), order='C', device='cpu')], tile_loud: Annotated[NDArray[numpy.uint8], dict(shape=(None, None), order='C', device='cpu')], grow: Callable, currents: Annotated[NDArray[numpy.float32], dict(shape=(None, None, None), order='C', device='cpu')] | None = None) -> tuple:
        """
        Out: (list of the event bytes of each tick, (16 n,) uint8; number of pixels whose luminance was replaced, whose X was clamped, whose V was clamped). In: tick, number of the first tick. All arrays but luminance are modified in place. grow(rows) must copy fifo to an array with more rows, the new ones zero, and return it.
        """

    @property
    def row_floats(self) -> int:
        """
        float32 in the FIFOs of a tile: [16][6][feature]; tick n is in slot n mod 6.
        """

    @property
    def tiles(self) -> tuple:
        """(down, across), number of tiles of 4 x 4 pixels."""

def probe_points(sampler: str, index: int, dimension: int, pixels: Annotated[NDArray[numpy.int32], dict(shape=(None,), order='C', device='cpu', writable=False)], out: Annotated[NDArray[numpy.float32], dict(shape=(None, 2), order='C', device='cpu')], seed: int = 0, digits: int = 6) -> None:
    """
    Points (n, 2) that pixels (n) draw for one sample and dimension: for tests.
    """

def probe_scatter(albedo: float, f0: float, metallic: float, alpha: float, mirror: float, eye: Sequence[float], numbers: Annotated[NDArray[numpy.float32], dict(shape=(None, 4), order='C', device='cpu', writable=False)], direction: Annotated[NDArray[numpy.float32], dict(shape=(None, 3), order='C', device='cpu')], light: Annotated[NDArray[numpy.float32], dict(shape=(None, 3), order='C', device='cpu')], density: Annotated[NDArray[numpy.float32], dict(shape=(None,), order='C', device='cpu')], again: Annotated[NDArray[numpy.float32], dict(shape=(None,), order='C', device='cpu')], mirrored: Annotated[NDArray[numpy.int32], dict(shape=(None,), order='C', device='cpu')], alive: Annotated[NDArray[numpy.int32], dict(shape=(None,), order='C', device='cpu')]) -> None:
    """
    Directions that a surface with its normal along z draws by numbers (n, 4): for tests.
    """

def probe_evaluate(albedo: float, f0: float, metallic: float, alpha: float, mirror: float, eye: Sequence[float], direction: Annotated[NDArray[numpy.float32], dict(shape=(None, 3), order='C', device='cpu', writable=False)], light: Annotated[NDArray[numpy.float32], dict(shape=(None, 3), order='C', device='cpu')], density: Annotated[NDArray[numpy.float32], dict(shape=(None,), order='C', device='cpu')]) -> None:
    """f times cosine (n, 3) and density (n) of directions (n, 3): for tests."""

def probe_aim(caster: Caster, geom_pos: Annotated[NDArray[numpy.float64], dict(shape=(None, 3), order='C', device='cpu', writable=False)], geom_mat: Annotated[NDArray[numpy.float64], dict(shape=(None, 9), order='C', device='cpu', writable=False)], light_pos: Annotated[NDArray[numpy.float64], dict(shape=(None, 3), order='C', device='cpu', writable=False)], light_dir: Annotated[NDArray[numpy.float64], dict(shape=(None, 3), order='C', device='cpu', writable=False)], camera_pos: Annotated[NDArray[numpy.float64], dict(shape=(3), order='C', device='cpu', writable=False)], camera_mat: Annotated[NDArray[numpy.float64], dict(shape=(9), order='C', device='cpu', writable=False)], point: Sequence[float], sky: bool, numbers: Annotated[NDArray[numpy.float32], dict(shape=(None, 3), order='C', device='cpu', writable=False)], direction: Annotated[NDArray[numpy.float32], dict(shape=(None, 3), order='C', device='cpu')], light: Annotated[NDArray[numpy.float32], dict(shape=(None, 3), order='C', device='cpu')], density: Annotated[NDArray[numpy.float32], dict(shape=(None,), order='C', device='cpu')], again: Annotated[NDArray[numpy.float32], dict(shape=(None,), order='C', device='cpu')]) -> None:
    """
    What a point aims at by numbers (n, 3), camera frame; and the density (n) that a ray is told which goes there by chance: for tests.
    """

def probe_told(caster: Caster, geom_pos: Annotated[NDArray[numpy.float64], dict(shape=(None, 3), order='C', device='cpu', writable=False)], geom_mat: Annotated[NDArray[numpy.float64], dict(shape=(None, 9), order='C', device='cpu', writable=False)], light_pos: Annotated[NDArray[numpy.float64], dict(shape=(None, 3), order='C', device='cpu', writable=False)], light_dir: Annotated[NDArray[numpy.float64], dict(shape=(None, 3), order='C', device='cpu', writable=False)], camera_pos: Annotated[NDArray[numpy.float64], dict(shape=(3), order='C', device='cpu', writable=False)], camera_mat: Annotated[NDArray[numpy.float64], dict(shape=(9), order='C', device='cpu', writable=False)], point: Sequence[float], direction: Annotated[NDArray[numpy.float32], dict(shape=(None, 3), order='C', device='cpu', writable=False)], density: Annotated[NDArray[numpy.float32], dict(shape=(None,), order='C', device='cpu')]) -> None:
    """
    The density (n) of aiming at what directions (n, 3) from a point meet: for tests.
    """

class Readout:
    """The readout, from pixel to packet: see evs.emulator.sensor.readout."""

    def __init__(self, *, width: int, height: int, latency_us: float, latency_sigma_us: float, order: str, row_ns: int, column_ns: int, jitter_ns: float, scan_us: int, erc_target: int, erc_period_us: int, erc_drop: str, link_rate: int, fifo: int, stamp_sent: bool, fates: Annotated[NDArray[numpy.uint8], dict(shape=(None, None), order='C', device='cpu', writable=False)] | None = None) -> None:
        """
        erc_target: events a period, 0 for off; link_rate: events a second, 0 for unlimited; fates (height, width) uint8: 0 outside the ROI, 1 masked, 255 kept.
        """

    def step(self, events: Annotated[NDArray[numpy.uint8], dict(shape=(None,), order='C', device='cpu', writable=False)], clock: Annotated[NDArray[numpy.int64], dict(shape=(None,), order='C', device='cpu')], waiting: Annotated[NDArray[numpy.uint8], dict(shape=(None,), order='C', device='cpu', writable=False)], due_ns: Annotated[NDArray[numpy.int64], dict(shape=(None,), order='C', device='cpu', writable=False)], t_begin_us: int, t_end_us: int) -> tuple:
        """
        Out: (bytes of the events that are output in the tick (16 n,) uint8, of those that wait (16 m,) uint8, the times of those (m,) int64 ns). clock is modified in place.
        """

class PixelSettings:
    """The settings that all pixels share."""

    def __init__(self, *, log: str, exposure_dn: float, dark_dn: float, linlog_dn: float, log_eps: float, euler: bool = False, lowpass_low: float = 0.0, lowpass_slope: float = 0.0, follower: float = 0.0, highpass: float = 0.0, parasitic_slope: float = 0.0, refractory_us: int = 0, causes: bool = False, noise_gain: float = 0.0, drift_gain: float = 0.0, least_gain: float = 0.0, noise_weight: float = 0.0, shot_bright: float = 1.0, shot_inverse: bool = False, shot_slope: float = 0.0, shot_offset: float = 0.0, shot_dim_dn: float = 0.0, seed: int = 0) -> None:
        """
        Terms at zero are off. lowpass, follower, highpass: 2 pi f in 1 / us; lowpass at DN 0 and its slope per DN.
        """

class PixelArray:
    """Event pixels with a fixed pattern: emulator/sensor/pixel/plain.py."""

    def __init__(self, settings: PixelSettings, width: int, height: int, *, theta_on: Annotated[NDArray[numpy.float32], dict(shape=(None, None), order='C', device='cpu', writable=False)], theta_off: Annotated[NDArray[numpy.float32], dict(shape=(None, None), order='C', device='cpu', writable=False)], leak: Annotated[NDArray[numpy.float32], dict(shape=(None, None), order='C', device='cpu', writable=False)] | None = None, parasitic: Annotated[NDArray[numpy.float32], dict(shape=(None, None), order='C', device='cpu', writable=False)] | None = None, phase: Annotated[NDArray[numpy.float32], dict(shape=(None, None), order='C', device='cpu', writable=False)] | None = None, hot: Annotated[NDArray[numpy.uint8], dict(shape=(None, None), order='C', device='cpu', writable=False)] | None = None, shot_on: Annotated[NDArray[numpy.float32], dict(shape=(None, None), order='C', device='cpu', writable=False)] | None = None, shot_off: Annotated[NDArray[numpy.float32], dict(shape=(None, None), order='C', device='cpu', writable=False)] | None = None, threads: int = 0, isa: str = 'auto') -> None: ...

    def step(self, luminance: Annotated[NDArray[numpy.float32], dict(shape=(None, None), order='C', device='cpu', writable=False)], t_begin_us: int, clock_us: int, tick_us: int, ticks: int, *, reference: Annotated[NDArray[numpy.float64], dict(shape=(None, None), order='C', device='cpu')], last_log: Annotated[NDArray[numpy.float32], dict(shape=(None, None), order='C', device='cpu')], last_luminance: Annotated[NDArray[numpy.float32], dict(shape=(None, None), order='C', device='cpu')], filtered: Annotated[NDArray[numpy.float32], dict(shape=(None, None), order='C', device='cpu')] | None = None, followed: Annotated[NDArray[numpy.float32], dict(shape=(None, None), order='C', device='cpu')] | None = None, blind_until: Annotated[NDArray[numpy.int64], dict(shape=(None, None), order='C', device='cpu')] | None = None, mean: Annotated[NDArray[numpy.float32], dict(shape=(None, None), order='C', device='cpu')] | None = None, noise: Annotated[NDArray[numpy.float32], dict(shape=(None, None), order='C', device='cpu')] | None = None, drift: Annotated[NDArray[numpy.float32], dict(shape=(None, None), order='C', device='cpu')] | None = None, due_us: Annotated[NDArray[numpy.int64], dict(shape=(None,), order='C', device='cpu')] | None = None, since_us: Annotated[NDArray[numpy.int64], dict(shape=(None,), order='C', device='cpu')] | None = None, shot_next: Annotated[NDArray[numpy.int64], dict(shape=(None,), order='C', device='cpu')] | None = None, shot_count: Annotated[NDArray[numpy.int64], dict(shape=(None,), order='C', device='cpu')] | None = None) -> tuple:
        """
        Out: (event bytes (16 n,) uint8, number of pixels with unusable luminance). The keyword arguments are the state and are modified in place. In: ticks, number of ticks so far.
        """

def natural_log(values: Annotated[NDArray[numpy.float32], dict(shape=(None,), order='C', device='cpu', writable=False)]) -> Annotated[NDArray[numpy.float32], dict(shape=(None,))]:
    """ln of normal positive float32 (n,), as the pixel computes it."""

def lowpass_steps(z: Annotated[NDArray[numpy.float32], dict(shape=(None,), order='C', device='cpu', writable=False)]) -> tuple:
    """
    (a, b) of a one-pole low pass for z = 2 pi f dt (n,) float32, as the pixel computes them.
    """

def log_map(luminance: Annotated[NDArray[numpy.float32], dict(shape=(None,), order='C', device='cpu', writable=False)], log: str, exposure_dn: float, dark_dn: float, linlog_dn: float, log_eps: float) -> Annotated[NDArray[numpy.float32], dict(shape=(None,))]:
    """
    Log intensity of luminance (n,); NaN where the luminance is negative, NaN or Inf.
    """

class Watch:
    """Arrays of others, and what they held when they were last known."""

    def __init__(self, arrays: Sequence[Annotated[NDArray, dict(order='C', device='cpu', writable=False)]]) -> None:
        """arrays: any shape and type, contiguous; what they hold now is known."""

    def changed(self) -> bool:
        """Whether a byte is another than was known."""

    def keep(self) -> None:
        """What they hold now is known."""

def digest(arrays: Sequence[Annotated[NDArray, dict(order='C', device='cpu', writable=False)]]) -> int:
    """
    64 bits of what the arrays hold, in their order; one changed word changes it for sure.
    """
