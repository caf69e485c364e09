"""
The native core: the ray caster, the event pixel and the event network.
"""

from collections.abc import Callable, Mapping, Sequence
from typing import Annotated, Final

import numpy
from numpy.typing import NDArray


class CameraBatch:
    """
    Cameras of many worlds, whose ticks are computed side by side.

    Each has its own caster and pixels, made for one thread, or for all of
    them where there are fewer cameras than threads.
    """

    def __init__(self, *, threads: int, start_us: int) -> None:
        """
        Args:
            threads: The number of cameras at once; 0 for one per core.
            start_us: How much later than the time of their worlds events are stamped.
        """

    def add(self, world: int) -> int:
        """
        Add a camera.

        Args:
            world: The row of its world in the arrays of `step`.

        Returns:
            Its number.
        """

    def put(self, camera: int, caster: object, luminance: Annotated[NDArray[numpy.float32], dict(shape=(None, None), order='C', device='cpu')], pixels: object, state: dict, *, seed: int, clock_us: int, tick_us: int, ticks: int, all_due: bool) -> None:
        """
        Set what renders a camera, its pixels and their state, whose arrays are modified
        in place from now on.

        Args:
            camera: Its number.
            caster: What renders it.
            luminance: (h, w) float32, the array that is passed to `Caster.render`.
            pixels: The pixels.
            state: The arrays of the state, by the names that `PixelArray.step` takes.
            seed: The seed of its light's noise.
            clock_us, ticks, all_due: See `PixelArray.step`.
            tick_us: The length of the last tick.
        """

    def put_readout(self, camera: int, readout: object, clock: Annotated[NDArray[numpy.int64], dict(shape=(None,), order='C', device='cpu')], waiting: Annotated[NDArray[numpy.uint8], dict(shape=(None,), order='C', device='cpu', writable=False)], due_ns: Annotated[NDArray[numpy.int64], dict(shape=(None,), order='C', device='cpu', writable=False)]) -> None:
        """
        After `put`: the events of the camera pass through a readout.

        Args:
            camera: Its number.
            readout: The Readout.
            clock: See `Readout.step`. It is modified in place from now on.
            waiting, due_ns: As there.
        """

    def waiting(self, camera: int) -> tuple:
        """
        Return what waits in the readout of a camera: waiting and due_ns of `Readout.step`.
        """

    def put_on_device(self, camera: int, frame: object, frame_constant: int, pixels: object, pixel_constant: int, arrays: dict) -> None:
        """
        After `put`: the camera is rendered, and its pixels are stepped, on a device.

        Args:
            camera: Its number.
            frame: DeviceFrame of its caster.
            frame_constant: Where what stays of it lies on the device.
            pixels: DevicePixels of its pixels.
            pixel_constant: Where what stays of them lies.
            arrays: Where each array of their state lies, by name.
        """

    def lay_out(self, which: Annotated[NDArray[numpy.int32], dict(shape=(None,), order='C', device='cpu', writable=False)], poses: tuple[Annotated[NDArray[numpy.float64], dict(shape=(None, None, 3), order='C', device='cpu', writable=False)], Annotated[NDArray[numpy.float64], dict(shape=(None, None, 9), order='C', device='cpu', writable=False)], Annotated[NDArray[numpy.float64], dict(shape=(None, None, 3), order='C', device='cpu', writable=False)], Annotated[NDArray[numpy.float64], dict(shape=(None, None, 3), order='C', device='cpu', writable=False)], Annotated[NDArray[numpy.float64], dict(shape=(None, 3), order='C', device='cpu', writable=False)], Annotated[NDArray[numpy.float64], dict(shape=(None, 9), order='C', device='cpu', writable=False)]], tick_us: int, *, first: int, tick: int, luminance: int, room: tuple[int, int, int, int, int], staged: Annotated[NDArray[numpy.uint8], dict(shape=(None, None), order='C', device='cpu')], frames: Annotated[NDArray[numpy.uint8], dict(shape=(None, None), order='C', device='cpu')], pixels: Annotated[NDArray[numpy.uint8], dict(shape=(None, None), order='C', device='cpu')]) -> None:
        """
        Write what a device needs for a tick of some cameras.

        Args:
            which, poses, tick_us: See `step`.
            first: How many cameras of this tick were laid out before.
            tick: Where `staged` will lie on the device.
            luminance: Where the light of all cameras, (n, h, w) float32, will.
            room: See DevicePixels.copy_arguments, camera after camera of the tick.
            staged: (k, tick_bytes of the largest) uint8, the output: what the tick changes.
            frames: (k, argument_bytes + 8) uint8, the output: a frame, and where its light goes.
            pixels: (k, argument_bytes) uint8, the output: arguments of the pixels.
        """

    def take_tick(self, which: Annotated[NDArray[numpy.int32], dict(shape=(None,), order='C', device='cpu', writable=False)], crossings: Annotated[NDArray[numpy.uint8], dict(shape=(None,), order='C', device='cpu', writable=False)], begins: Annotated[NDArray[numpy.uint32], dict(shape=(None,), order='C', device='cpu', writable=False)], clamped: Annotated[NDArray[numpy.int64], dict(shape=(None,), order='C', device='cpu', writable=False)], t_begin_us: Annotated[NDArray[numpy.int64], dict(shape=(None,), order='C', device='cpu', writable=False)], tick_us: int) -> None:
        """
        Take what the pixels of some cameras have found on a device.

        Args:
            which: (k,) int32, the cameras that were laid out last.
            crossings: (8 n,) uint8, camera after camera.
            begins: (k + 1,) uint32, where those of each begin, and n.
            clamped: (k,) int64, pixels with unusable luminance.
            t_begin_us, tick_us: See `step`.
        """

    def numbers(self, camera: int) -> tuple:
        """
        Return clock_us, tick_us and ticks of a camera, and the pixels clamped since `put`.
        """

    def step(self, which: Annotated[NDArray[numpy.int32], dict(shape=(None,), order='C', device='cpu', writable=False)], poses: tuple[Annotated[NDArray[numpy.float64], dict(shape=(None, None, 3), order='C', device='cpu', writable=False)], Annotated[NDArray[numpy.float64], dict(shape=(None, None, 9), order='C', device='cpu', writable=False)], Annotated[NDArray[numpy.float64], dict(shape=(None, None, 3), order='C', device='cpu', writable=False)], Annotated[NDArray[numpy.float64], dict(shape=(None, None, 3), order='C', device='cpu', writable=False)], Annotated[NDArray[numpy.float64], dict(shape=(None, 3), order='C', device='cpu', writable=False)], Annotated[NDArray[numpy.float64], dict(shape=(None, 9), order='C', device='cpu', writable=False)]], t_begin_us: Annotated[NDArray[numpy.int64], dict(shape=(None,), order='C', device='cpu', writable=False)], tick_us: int) -> None:
        """
        Render a tick of some cameras and step their pixels.

        Args:
            which: (k,) int32, the numbers of the cameras, in order.
            poses: geom_pos and geom_mat, (worlds, ng, 3) and (worlds, ng, 9); light_pos and
                light_dir, (worlds, nl, 3); camera_pos and camera_mat, (cameras, 3) and
                (cameras, 9); float64, world frame.
            t_begin_us: (worlds,) int64, the time of each world at the start of the tick.
            tick_us: The length of the tick.
        """

    def take_events(self, which: Annotated[NDArray[numpy.int32], dict(shape=(None,), order='C', device='cpu', writable=False)]) -> tuple:
        """
        Take the events of some cameras since the last call.

        Args:
            which: (k,) int32, the numbers of the cameras.

        Returns:
            The event bytes, (16 n,) uint8, camera after camera, and (k + 1,) int64,
            where those of each begin.
        """

class Optics:
    """A camera's pixels and rays."""

    def __init__(self, *, width: int, height: int, fx: float, fy: float, cx: float, cy: float, orthographic: bool = False, lens: Annotated[NDArray[numpy.float32], dict(shape=(None, None, 3), order='C', device='cpu', writable=False)] | None = None, share: Annotated[NDArray[numpy.float32], dict(shape=(None, None), order='C', device='cpu', writable=False)] | None = None, near: float = 0.0, near_sphere: bool = False) -> None:
        """
        Args:
            width, height: The image's size, px.
            fx, fy: The focal lengths, px; px/m if orthographic.
            cx, cy: The principal point, px.
            orthographic: Whether the rays are parallel.
            lens: (height + 1, width + 1, 3) float32, the ray at each pixel corner,
                camera frame; None for a pinhole.
            share: (height, width) float32, the vignetting: the share of the light that
                reaches a pixel; None for all of it.
            near: The depth of the near plane, m; nothing nearer is seen.
            near_sphere: Whether it is a sphere with that radius instead.
        """

class Tracing:
    """How light is computed, and what is output."""

    def __init__(self, *, samples: int = 1, adaptive: bool = False, shadows: bool = True, incremental: bool = False, rgb: bool = False, integrator: str = 'direct', bounces: int = 0, sample_set: str = 'owen', block: int = 0, blocks: int = 1, nodes: int = 0, forced: Mapping[str, bool] = {}) -> None:
        """
        Args:
            samples: The number of samples per pixel.
            adaptive: Take all samples only at edges; elsewhere one, or a quarter (path).
            shadows: Whether lights cast shadows.
            incremental: With a still camera, reuse what nothing that moved can affect.
            rgb: Whether `render` can output colour.
            integrator: direct, hybrid or path.
            bounces: The largest number of bounces of a path.
            sample_set: The sampler of path: sobol, owen, global, random or anchored.
            block, blocks: Which block of a point set the samples of path are, of how many.
            nodes: The most nodes of hybrid's cache; 0 for as many as the image needs.
            forced: Features by name that are forced on (the output keeps its bytes) or
                off, for tests.
        """

def combine_cycle(planes: Annotated[NDArray[numpy.float32], dict(shape=(None, None, None), order='C', device='cpu', writable=False)], before: Annotated[NDArray[numpy.float32], dict(shape=(None, None), order='C', device='cpu', writable=False)], newest: int, light: Annotated[NDArray[numpy.float32], dict(shape=(None, None), order='C', device='cpu')]) -> None:
    """
    Combine the light of the sets of a cycle.

    Args:
        planes: (m, h, w) float32, the light of each set when it was traced last.
        before: (h, w) float32, the light of the newest set one cycle ago.
        newest: The set of this tick.
        light: (h, w) float32, out: the mean; the middle of the cycle where light changes.
    """

def isa_available() -> list[str]:
    """
    Return the instruction sets that this build and this machine support, fastest
    first.
    """

class SceneData:
    """
    The constant part of a scene.

    Fill it once, in this order: textures, surfaces, meshes, lights, geoms.
    """

    def __init__(self) -> None: ...

    def add_texture(self, data: Annotated[NDArray[numpy.uint8], dict(shape=(None, None, None, None), order='C', device='cpu', writable=False)], srgb: bool, like: int = -1) -> int:
        """
        Add a texture.

        Args:
            data: (faces, height, width, components) uint8, with 1 or 6 faces.
            srgb: Whether the image is display-coded.
            like: The index of the same image in the scene of the caster's `before`; -1
                for none.

        Returns:
            The texture's index.
        """

    def add_surface(self, rgba: Sequence[float], texture: int, repeat: Sequence[float], uniform: bool, emission: float, specular: float, shininess: float, reflectance: float, metallic: float, roughness: float, maps: Sequence[int]) -> None:
        """
        Add a surface, MuJoCo's material.

        Args:
            rgba: The display-coded colour.
            texture: The index of the colour texture; -1 for none.
            maps: The textures for metallic, roughness, occlusion, opacity, normal and
                emissive; -1 for none.
        """

    def add_mesh(self, vertices: Annotated[NDArray[numpy.float32], dict(shape=(None, 3), order='C', device='cpu', writable=False)], faces: Annotated[NDArray[numpy.int32], dict(shape=(None, 3), order='C', device='cpu', writable=False)], normals: Annotated[NDArray[numpy.float32], dict(shape=(None, 3, 3), order='C', device='cpu', writable=False)] | None, texcoords: Annotated[NDArray[numpy.float32], dict(shape=(None, 3, 2), order='C', device='cpu', writable=False)] | None) -> None:
        """
        Add a mesh.

        Args:
            vertices: (nv, 3) float32, m.
            faces: (nf, 3) int32.
            normals: (nf, 3, 3) float32, one for each corner of each face; None for
                flat faces.
            texcoords: (nf, 3, 2) float32; None if the mesh has none.
        """

    def share_mesh(self, caster: Caster, mesh: int) -> None:
        """
        Add the mesh of a caster. The scenes share it until one of them deforms it.
        """

    def add_light(self, kind: int, ambient: Sequence[float], diffuse: Sequence[float], specular: Sequence[float], castshadow: bool, attenuation: Sequence[float], cutoff_deg: float, exponent: float, intensity: float, headlight: bool, range: float, softness: float, texture: int, bulbradius: float) -> None:
        """
        Add a light of MuJoCo. The texture is that of an image light; -1 for none.
        """

    def set_fog(self, start: float, end: float, color: Sequence[float]) -> None:
        """Add fog. The distances are in m, and the colour is display-coded."""

    def set_haze(self, ratio: float, radius: float, color: Sequence[float]) -> None:
        """
        Add haze.

        Args:
            ratio: The share of the distance to the horizon that the haze covers.
            radius: The distance to the horizon, m.
            color: The display-coded colour.
        """

    def set_geoms(self, type: Annotated[NDArray[numpy.int32], dict(shape=(None,), order='C', device='cpu', writable=False)], size: Annotated[NDArray[numpy.float32], dict(shape=(None, 3), order='C', device='cpu', writable=False)], mesh: Annotated[NDArray[numpy.int32], dict(shape=(None,), order='C', device='cpu', writable=False)], surface: Annotated[NDArray[numpy.int32], dict(shape=(None,), order='C', device='cpu', writable=False)]) -> None:
        """
        Set the geoms: type, mesh and surface (ng,) int32; size (ng, 3) float32, m.
        """

    @property
    def skybox(self) -> int:
        """The index of the skybox's texture; -1 for none."""

    @skybox.setter
    def skybox(self, arg: int, /) -> None: ...

    @property
    def sky_shines(self) -> bool:
        """
        Whether the skybox lights the scene and is in mirrors; else it is a backdrop.
        """

    @sky_shines.setter
    def sky_shines(self, arg: bool, /) -> None: ...

class Caster:
    """A ray caster: one camera's view of one scene."""

    def __init__(self, scene: SceneData, optics: Optics, tracing: Tracing, *, threads: int = 1, isa: str = 'auto', before: Caster | None = None) -> None:
        """
        Args:
            threads: The number of threads; 0 for one per core.
            isa: An instruction set of isa_available(), or auto.
            before: The previous caster of the same camera, whose threads and images
                are reused.
        """

    def trace_pixels(self, geom_pos: Annotated[NDArray[numpy.float64], dict(shape=(None, 3), order='C', device='cpu', writable=False)], geom_mat: Annotated[NDArray[numpy.float64], dict(shape=(None, 9), order='C', device='cpu', writable=False)], light_pos: Annotated[NDArray[numpy.float64], dict(shape=(None, 3), order='C', device='cpu', writable=False)], light_dir: Annotated[NDArray[numpy.float64], dict(shape=(None, 3), order='C', device='cpu', writable=False)], camera_pos: Annotated[NDArray[numpy.float64], dict(shape=(3), order='C', device='cpu', writable=False)], camera_mat: Annotated[NDArray[numpy.float64], dict(shape=(9), order='C', device='cpu', writable=False)], x: Annotated[NDArray[numpy.int32], dict(shape=(None,), order='C', device='cpu', writable=False)], y: Annotated[NDArray[numpy.int32], dict(shape=(None,), order='C', device='cpu', writable=False)], luminance: Annotated[NDArray[numpy.float32], dict(shape=(None,), order='C', device='cpu')], seed: int = 0) -> None:
        """
        Render single pixels.

        Args:
            geom_pos, geom_mat: (ng, 3) and (ng, 9) float64, world frame.
            light_pos, light_dir: (nl, 3) float64, world frame.
            camera_pos, camera_mat: (3,) and (9,) float64, world frame.
            x, y: (n,) int32, pixels in the image.
            luminance: (n,) float32, the output.
            seed: The seed of this tick, for the path integrator.
        """

    def set_light_gains(self, gains: Annotated[NDArray[numpy.float32], dict(shape=(None,), order='C', device='cpu', writable=False)]) -> None:
        """
        Scale each light's strength from the next call on.

        Args:
            gains: (nl,) float32; 1 is the scene's strength.
        """

    def deform(self, mesh: int, vertices: Annotated[NDArray[numpy.float32], dict(shape=(None, 3), order='C', device='cpu', writable=False)], normals: Annotated[NDArray[numpy.float32], dict(shape=(None, 3), order='C', device='cpu', writable=False)]) -> None:
        """
        Set new vertices (nv, 3) and unit normals (nv, 3) of a mesh, before a call of
        render.
        """

    def resize(self, geoms: Annotated[NDArray[numpy.int32], dict(shape=(None,), order='C', device='cpu', writable=False)], sizes: Annotated[NDArray[numpy.float32], dict(shape=(None, 3), order='C', device='cpu', writable=False)]) -> None:
        """
        Set new sizes of geoms, before a call of render.

        Args:
            geoms: (n,) int32, neither planes nor meshes.
            sizes: (n, 3) float32, m. A geom with radius 0 is invisible.
        """

    def render(self, geom_pos: Annotated[NDArray[numpy.float64], dict(shape=(None, 3), order='C', device='cpu', writable=False)], geom_mat: Annotated[NDArray[numpy.float64], dict(shape=(None, 9), order='C', device='cpu', writable=False)], light_pos: Annotated[NDArray[numpy.float64], dict(shape=(None, 3), order='C', device='cpu', writable=False)], light_dir: Annotated[NDArray[numpy.float64], dict(shape=(None, 3), order='C', device='cpu', writable=False)], camera_pos: Annotated[NDArray[numpy.float64], dict(shape=(3), order='C', device='cpu', writable=False)], camera_mat: Annotated[NDArray[numpy.float64], dict(shape=(9), order='C', device='cpu', writable=False)], luminance: Annotated[NDArray[numpy.float32], dict(shape=(None, None), order='C', device='cpu')], rgb: Annotated[NDArray[numpy.float32], dict(shape=(None, None, 3), order='C', device='cpu')] | None = None, seed: int = 0, copy: Annotated[NDArray[numpy.float32], dict(shape=(None, None), order='C', device='cpu')] | None = None) -> None:
        """
        Render the image.

        The luminance and rgb arrays must be the same in every call and must not be
        modified between calls.

        Args:
            geom_pos, geom_mat: (ng, 3) and (ng, 9) float64, world frame.
            light_pos, light_dir: (nl, 3) float64, world frame.
            camera_pos, camera_mat: (3,) and (9,) float64, world frame.
            luminance: (h, w) float32, the output.
            rgb: (h, w, 3) float32, the output in colour; None for no colour.
            seed: The seed of this tick, for the path integrator.
            copy: (h, w) float32, a copy of the luminance; None for no copy.
        """

    def trace_truth(self, geom_pos: Annotated[NDArray[numpy.float64], dict(shape=(None, 3), order='C', device='cpu', writable=False)], geom_mat: Annotated[NDArray[numpy.float64], dict(shape=(None, 9), order='C', device='cpu', writable=False)], light_pos: Annotated[NDArray[numpy.float64], dict(shape=(None, 3), order='C', device='cpu', writable=False)], light_dir: Annotated[NDArray[numpy.float64], dict(shape=(None, 3), order='C', device='cpu', writable=False)], camera_pos: Annotated[NDArray[numpy.float64], dict(shape=(3), order='C', device='cpu', writable=False)], camera_mat: Annotated[NDArray[numpy.float64], dict(shape=(9), order='C', device='cpu', writable=False)], geom: Annotated[NDArray[numpy.int32], dict(shape=(None, None), order='C', device='cpu')], distance: Annotated[NDArray[numpy.float32], dict(shape=(None, None), order='C', device='cpu')], point: Annotated[NDArray[numpy.float32], dict(shape=(None, None, 3), order='C', device='cpu')], normal: Annotated[NDArray[numpy.float32], dict(shape=(None, None, 3), order='C', device='cpu')], triangle: Annotated[NDArray[numpy.int32], dict(shape=(None, None), order='C', device='cpu')], barycentric: Annotated[NDArray[numpy.float32], dict(shape=(None, None, 2), order='C', device='cpu')]) -> None:
        """
        Compute the ground truth: the first hit of the ray through each pixel's centre.

        Args:
            geom_pos, geom_mat: (ng, 3) and (ng, 9) float64, world frame.
            light_pos, light_dir: (nl, 3) float64, world frame.
            camera_pos, camera_mat: (3,) and (9,) float64, world frame.
            geom: (h, w) int32, the output: the geom; -1 for none.
            distance: (h, w) float32, the output, m.
            point: (h, w, 3) float32, the output, camera frame; the ray's direction
                where nothing is hit.
            normal: (h, w, 3) float32, the output, camera frame.
            triangle: (h, w) int32, the output: the face of a mesh; -1 for none.
            barycentric: (h, w, 2) float32, the output: the weights of the face's
                second and third corner.
        """

    @property
    def traced_fraction(self) -> float:
        """The share of the last tick that was traced, 0 ... 1."""

    @property
    def channels(self) -> int:
        """The number of channels: luminance, RGB, or both."""

    @property
    def features(self) -> dict[str, bool]:
        """The active features by name, as of the last tick where that decides."""

    def restart(self) -> None:
        """Forget what earlier ticks left in the light of hybrid."""

    def save_irradiance(self, numbers: Annotated[NDArray[numpy.int32], dict(shape=(None, 7), order='C', device='cpu')], light: Annotated[NDArray[numpy.float32], dict(shape=(None, 27), order='C', device='cpu')]) -> tuple[int, int]:
        """
        Copy the irradiance cache of hybrid, of n = work["cache_nodes"] nodes.

        Args:
            numbers: (n, 7) int32, the output: each node's key and flags.
            light: (n, 27) float32, the output: each node's place and light.

        Returns:
            Ticks since the start; by how many levels the lattice is coarser than asked.
        """

    def restore_irradiance(self, tick: int, coarser: int, numbers: Annotated[NDArray[numpy.int32], dict(shape=(None, 7), order='C', device='cpu', writable=False)], light: Annotated[NDArray[numpy.float32], dict(shape=(None, 27), order='C', device='cpu', writable=False)]) -> bool:
        """
        Take back what save_irradiance gave.

        Returns:
            Whether it is valid; if not, nothing changes.
        """

    @property
    def work(self) -> dict[str, int]:
        """
        The work done so far: ticks; packets of 4 x 4 pixels that were tested against
        moving geoms, traced and relit; BVHs that were built and refitted; with
        hybrid the nodes and bytes of its cache, and the paths traced for them.
        """

def trace_device_frame(arguments: Annotated[NDArray[numpy.uint8], dict(shape=(None,), order='C', device='cpu', writable=False)], luminance: Annotated[NDArray[numpy.float32], dict(shape=(None, None), order='C', device='cpu')]) -> None:
    """
    Render a frame of DeviceFrame whose addresses are those of arrays, as a device does:
    for tests.

    Args:
        arguments: (argument_bytes,) uint8, of copy_tick.
        luminance: (h, w) float32, the output.
    """

def offer_device_readers(readers: int, count: int, word: int, first: int) -> None:
    """
    Offer a word of each reader to the nodes that it reads, as a device does: for tests.

    Args:
        readers, count: The address of so many readers of reader_bytes.
        word: Which of the words, after those before.
        first: The address of (nodes, 3) uint64, the least words so far.
    """

def trace_device_pass(arguments: Annotated[NDArray[numpy.uint8], dict(shape=(None,), order='C', device='cpu', writable=False)], edges: bool, counts: int, missing: int, missing_room: int, readers: int, reader_room: int, base: int, untextured: int, luminance: int) -> None:
    """
    Trace a pass of `hybrid` from DeviceFrame's copies, whose addresses are those of
    arrays, as a device does: for tests.

    Args:
        arguments: (argument_bytes,) uint8, of copy_tick and copy_cache.
        edges: Whether pixels at edges are refined; else all are traced.
        counts: The address of two uint32, to which the numbers of missing nodes and of
            readers are added.
        missing, missing_room: The address of so many nodes of request_bytes.
        readers, reader_room: The address of so many readers of reader_bytes.
        base, untextured, luminance: Addresses of (h, w) float32: light of the first pass,
            where edges are refined; light without textures, or 0; the light.
    """

class DeviceFrame:
    """
    The frames of a renderer for a device with memory of its own.

    Everything that a frame points to lies in two blocks of memory: one
    that stays, and one that each tick replaces. What `hybrid` reads of its
    cache lies in a third one, which each pass over the pixels replaces.
    """

    def __init__(self, caster: Caster) -> None:
        """
        Args:
            caster: Of `direct`, `hybrid`, or `path` with a fixed number of samples; without
                colour. Its meshes must not deform, nor with `path` and `hybrid` its geoms be
                resized.
        """

    def copy_constant(self, address: int, out: Annotated[NDArray[numpy.uint8], dict(shape=(None,), order='C', device='cpu')]) -> None:
        """
        Copy what stays.

        Args:
            address: Where it will lie on the device.
            out: (constant_bytes,) uint8, the output.
        """

    def copy_tick(self, geom_pos: Annotated[NDArray[numpy.float64], dict(shape=(None, 3), order='C', device='cpu', writable=False)], geom_mat: Annotated[NDArray[numpy.float64], dict(shape=(None, 9), order='C', device='cpu', writable=False)], light_pos: Annotated[NDArray[numpy.float64], dict(shape=(None, 3), order='C', device='cpu', writable=False)], light_dir: Annotated[NDArray[numpy.float64], dict(shape=(None, 3), order='C', device='cpu', writable=False)], camera_pos: Annotated[NDArray[numpy.float64], dict(shape=(3), order='C', device='cpu', writable=False)], camera_mat: Annotated[NDArray[numpy.float64], dict(shape=(9), order='C', device='cpu', writable=False)], constant: int, tick: int, out: Annotated[NDArray[numpy.uint8], dict(shape=(None,), order='C', device='cpu')], arguments: Annotated[NDArray[numpy.uint8], dict(shape=(None,), order='C', device='cpu')], seed: int = 0) -> str:
        """
        Place everything for a tick, light nodes of `hybrid`, and copy what the tick changes.

        Args:
            geom_pos, geom_mat: (ng, 3) and (ng, 9) float64, world frame.
            light_pos, light_dir: (nl, 3) float64, world frame.
            camera_pos, camera_mat: (3,) and (9,) float64, world frame.
            constant, tick: Where the blocks lie on the device.
            out: (tick_bytes,) uint8, the output.
            arguments: (argument_bytes,) uint8, the output: those of the kernels.
            seed: The seed of this tick, for path and hybrid.

        Returns:
            Where pixels are to be traced: "there", or "nowhere", as no light has changed.
        """

    def copy_cache(self, edges: bool, address: int, used_address: int, out: Annotated[NDArray[numpy.uint8], dict(shape=(None,), order='C', device='cpu')], used: Annotated[NDArray[numpy.uint8], dict(shape=(None,), order='C', device='cpu')], arguments: Annotated[NDArray[numpy.uint8], dict(shape=(None,), order='C', device='cpu')]) -> None:
        """
        Begin a pass of `hybrid`, after copy_tick, and copy what it reads of the cache.

        Args:
            edges: Whether it is that over pixels at edges.
            address, used_address: Where `out` and `used` lie on the device.
            out: (cache_bytes,) uint8, the output.
            used: (nodes,) uint8, the output; the device adds to it.
            arguments: (argument_bytes,) uint8 of copy_tick, changed.
        """

    def take_nodes(self, used: Annotated[NDArray[numpy.uint8], dict(shape=(None,), order='C', device='cpu', writable=False)], missing: Annotated[NDArray[numpy.uint8], dict(shape=(None,), order='C', device='cpu', writable=False)]) -> bool:
        """
        Take what a pass has read, and light the nodes that it missed.

        Args:
            used: (nodes,) uint8.
            missing: (n * request_bytes,) uint8.

        Returns:
            False where the cache has no room, or was empty: the tick is then traced by
            trace_here.
        """

    def take_readers(self, first: Annotated[NDArray[numpy.uint64], dict(shape=(None, 3), order='C', device='cpu', writable=False)]) -> None:
        """
        Take from where nodes are read, after a pass in which nothing was missing.

        Args:
            first: (nodes, 3) uint64, the least words of all readers of each; all bits 1: none.
        """

    def trace_here(self, luminance: Annotated[NDArray[numpy.float32], dict(shape=(None, None), order='C', device='cpu')]) -> None:
        """
        Trace the pixels of `hybrid` on the CPU, after copy_tick.

        Args:
            luminance: (h, w) float32, the output.
        """

    @property
    def cache_bytes(self) -> int:
        """Bytes of the cache as it is now, of `hybrid`."""

    @property
    def nodes(self) -> int:
        """Nodes of the cache, of `hybrid`."""

    @property
    def request_bytes(self) -> int:
        """Bytes of a missing node."""

    @property
    def reader_bytes(self) -> int:
        """Bytes of a hit that reads nodes."""

    @property
    def constant_bytes(self) -> int:
        """Bytes of what stays."""

    @property
    def tick_bytes(self) -> int:
        """Bytes of what a tick changes."""

    @property
    def argument_bytes(self) -> int:
        """Bytes of the arguments."""

    @property
    def argument_offsets(self) -> tuple[int, int, int, int]:
        """
        Where in the arguments the frame is, that of a first pass, that of paths, and the cache.
        """

    @property
    def adaptive(self) -> bool:
        """Whether there is a first pass."""

def order_crossings(crossings: Annotated[NDArray[numpy.uint8], dict(shape=(None,), order='C', device='cpu', writable=False)], t_begin_us: int, tick_us: int, width: int, causes: bool) -> Annotated[NDArray[numpy.uint8], dict(shape=(None,))]:
    """
    Sort what pixels of a device have found.

    Args:
        crossings: (8 n,) uint8, in the order of the pixels.
        t_begin_us: Where the tick begins, us.
        tick_us: How long it is, us.
        width: Of the image, px.
        causes: Whether events hold their cause.

    Returns:
        The bytes of the events, uint8.
    """

def step_device_pixels(arguments: Annotated[NDArray[numpy.uint8], dict(shape=(None,), order='C', device='cpu', writable=False)]) -> None:
    """
    Step pixels of DevicePixels whose addresses are those of arrays, as a device does: for
    tests.

    Args:
        arguments: (argument_bytes,) uint8.
    """

def place_device_crossings(counts: int, blocks: int, offsets: int, all: int) -> None:
    """
    Run the kernel place_crossings on the CPU: for tests. Arrays are addresses.

    Args:
        counts, blocks: Of each block of pixels, and how many blocks there are.
        offsets: (blocks,) uint32, the output: where the crossings of each block begin.
        all: (4,) uint32, the output: crossings, the most crossings and candidates of a
            block, pixels with unusable luminance.
    """

def pack_device_crossings(threads: int, counts: int, blocks: int, crossings: int, crossing_room: int, offsets: int, all: int, room: int, packed: int) -> None:
    """
    Run the kernel pack_crossings on the CPU: for tests. Arrays are addresses.

    Args:
        threads: How many are launched.
        counts, blocks: See `place_device_crossings`.
        crossings, crossing_room: Of each block, and room for how many it has.
        offsets, all: What place_device_crossings found.
        room: How many crossings there is room for.
        packed: The crossings, the output.
    """

class DevicePixels:
    """
    The arguments of kernels that step event pixels on a device with memory of its own.
    """

    def __init__(self, pixels: PixelArray) -> None:
        """
        Args:
            pixels: Whose fixed pattern and settings they have.
        """

    def copy_constant(self, address: int, out: Annotated[NDArray[numpy.uint8], dict(shape=(None,), order='C', device='cpu')]) -> None:
        """
        Copy what stays.

        Args:
            address: Where it will lie on the device.
            out: (constant_bytes,) uint8, the output.
        """

    def copy_arguments(self, *, constant: int, arrays: dict, luminance: int, clock_us: int, tick_us: int, ticks: int, all_due: bool, row_reads: int, row_read_count: int, room: tuple[int, int, int, int, int], out: Annotated[NDArray[numpy.uint8], dict(shape=(None,), order='C', device='cpu')]) -> None:
        """
        Write the argument of the kernels for a tick.

        Args:
            constant: Where what stays lies on the device.
            arrays: Where each array of the state lies, by name.
            luminance: Where the (h, w) float32 light lies.
            clock_us, tick_us, ticks, all_due: See `PixelArray.step`.
            row_reads, row_read_count: Where (n, 2) int32 row reads lie, and n.
            room: crossings, crossing_room, candidates, candidate_room, counts: where there is
                room for (blocks, crossing_room) crossings of 8 bytes, (blocks, candidate_room)
                candidates of 16 and (blocks,) counts of 12.
            out: (argument_bytes,) uint8, the output.
        """

    @property
    def constant_bytes(self) -> int:
        """Bytes of what stays."""

    @property
    def argument_bytes(self) -> int:
        """Bytes of the argument."""

class EventArrays:
    """
    Events of many worlds as dense arrays, written side by side.

    Each method takes the event bytes (16 n,) uint8, world after world, and offsets
    (worlds + 1,) int64, where those of each world begin.
    """

    def __init__(self, *, threads: int) -> None:
        """
        Args:
            threads: The number of worlds at once; 0 for one per core.
        """

    def voxel_grid(self, events: Annotated[NDArray[numpy.uint8], dict(shape=(None,), order='C', device='cpu', writable=False)], offsets: Annotated[NDArray[numpy.int64], dict(shape=(None,), order='C', device='cpu', writable=False)], begin_us: Annotated[NDArray[numpy.int64], dict(shape=(None,), order='C', device='cpu', writable=False)], end_us: Annotated[NDArray[numpy.int64], dict(shape=(None,), order='C', device='cpu', writable=False)], limit: float, out: Annotated[NDArray[numpy.float32], dict(shape=(None, None, None, None), order='C', device='cpu')]) -> None:
        """
        Write voxel grids.

        Args:
            events, offsets: The events.
            begin_us, end_us: (worlds,) int64, the time that the bins divide.
            limit: The largest value.
            out: (worlds, bins, h, w) float32, the output.
        """

    def event_frame(self, events: Annotated[NDArray[numpy.uint8], dict(shape=(None,), order='C', device='cpu', writable=False)], offsets: Annotated[NDArray[numpy.int64], dict(shape=(None,), order='C', device='cpu', writable=False)], out: Annotated[NDArray[numpy.uint8], dict(shape=(None, None, None, None), order='C', device='cpu')]) -> None:
        """
        Write event frames.

        Args:
            events, offsets: The events.
            out: (worlds, 2, h, w) uint8, the output; 255 is that or more.
        """

    def time_surface(self, events: Annotated[NDArray[numpy.uint8], dict(shape=(None,), order='C', device='cpu', writable=False)], offsets: Annotated[NDArray[numpy.int64], dict(shape=(None,), order='C', device='cpu', writable=False)], stamps: Annotated[NDArray[numpy.int64], dict(shape=(None, None, None, None), order='C', device='cpu')], tau_us: float, t_us: Annotated[NDArray[numpy.int64], dict(shape=(None,), order='C', device='cpu', writable=False)], out: Annotated[NDArray[numpy.float32], dict(shape=(None, None, None, None), order='C', device='cpu')]) -> None:
        """
        Write time surfaces.

        Args:
            events, offsets: The events.
            stamps: (worlds, 2, h, w) int64, when each pixel last fired; modified in
                place.
            tau_us: The time constant.
            t_us: (worlds,) int64, from when they are seen.
            out: (worlds, 2, h, w) float32, the output.
        """

    def packet(self, events: Annotated[NDArray[numpy.uint8], dict(shape=(None,), order='C', device='cpu', writable=False)], offsets: Annotated[NDArray[numpy.int64], dict(shape=(None,), order='C', device='cpu', writable=False)], t_us: Annotated[NDArray[numpy.int64], dict(shape=(None,), order='C', device='cpu', writable=False)], out: Annotated[NDArray[numpy.int32], dict(shape=(None, None, None), order='C', device='cpu')]) -> None:
        """
        Write padded packets.

        Args:
            events, offsets: The events.
            t_us: (worlds,) int64, what stamps are counted from.
            out: (worlds, capacity, 4) int32, the output.
        """

def decayed(stamps: Annotated[NDArray[numpy.int64], dict(shape=(None,), order='C', device='cpu', writable=False)], tau_us: float, t_us: int, out: Annotated[NDArray[numpy.float32], dict(shape=(None,), order='C', device='cpu')]) -> None:
    """
    Write a time surface of latest stamps.

    Args:
        stamps: (n,) int64, us; the smallest int64 where there never was an event.
        tau_us: The time constant.
        t_us: From when it is seen.
        out: (n,) float32, the output.
    """

def events_fit(raw: bytes | memoryview, base_us: int, end_us: int, width: int, height: int) -> bool:
    """
    Return whether the bytes are valid events.

    They must hold whole events, sorted by t in (base_us, end_us], on the sensor,
    with polarity 0 or 1 and zero padding.
    """

class NetworkArray:
    """EvSNet on an array of pixels. The caller owns the state."""

    def __init__(self, width: int, height: int, parameters: object, *, tick_us: int, dense: bool = False, threads: int = 0, isa: str = 'auto') -> None:
        """
        Args:
            parameters: An object with the attributes weights ... linlog_dn.
            weights: The weights of all convolutions, one after another, each (out, in,
                7).
            biases: (convolutions, channels).
            delays: (blocks,), the delay of each residual sum, ticks.
            last, last_bias: (channels,), the weights and the bias of the point-wise
                convolution.
            v_on, v_off: The thresholds of the membrane potential.
            most: The largest number of events of a pixel in a tick, 1 ... 64.
            decay_low, decay_high: (256,) d^m and (4096,) d^(256 m), where d is the
                leak of a tick.
            exposure_dn, dark_dn, linlog_dn: The map from luminance to log intensity,
                DN.
            tick_us: The length of a tick, us.
            dense: Compute every tile in every tick.
            threads: The number of threads; 0 for one per core.
            isa: An instruction set of isa_available(), or auto.
        """

    def step(self, luminance: Annotated[NDArray[numpy.float32], dict(shape=(None, None, None), order='C', device='cpu', writable=False)], tick: int, begin_us: int, *, last_luminance: Annotated[NDArray[numpy.float32], dict(shape=(None, None), order='C', device='cpu')], last_log: Annotated[NDArray[numpy.float32], dict(shape=(None, None), order='C', device='cpu')], v: Annotated[NDArray[numpy.float32], dict(shape=(None, None), order='C', device='cpu')], last: Annotated[NDArray[numpy.int64], dict(shape=(None, None), order='C', device='cpu')], fifo: Annotated[NDArray[numpy.float32], dict(shape=(None, None), order='C', device='cpu')], tile_row: Annotated[NDArray[numpy.int32], dict(shape=(None, None), order='C', device='cpu')], tile_moved: Annotated[NDArray[numpy.int64], dict(shape=(None, None, None), order='C', device='cpu')], tile_loud: Annotated[NDArray[numpy.uint8], dict(shape=(None, None), order='C', device='cpu')], grow: Callable, currents: Annotated[NDArray[numpy.float32], dict(shape=(None, None, None), order='C', device='cpu')] | None = None) -> tuple:
        """
        Step a chunk of ticks.

        All arrays except luminance are modified in place.

        Args:
            luminance: (ticks, h, w) float32.
            tick: The number of the first tick.
            begin_us: Where the first tick begins, us.
            grow: grow(rows) must copy fifo to an array with more rows, the new ones
                zero, and return it.
            currents: (ticks, h, w) float32, the output of the convolutions; None if
                not wanted.

        Returns:
            The event bytes of each tick, (16 n,) uint8; the number of pixels whose
            luminance was replaced, whose X was clamped and whose V was clamped.
        """

    @property
    def row_floats(self) -> int:
        """
        The floats in the FIFOs of a tile: [16][6][feature]; tick n is in slot n mod 6.
        """

    @property
    def tiles(self) -> tuple:
        """The number of tiles of 4 x 4 pixels, (down, across)."""

class DeviceNetwork:
    """EvSNet on a device with memory of its own: what its kernels read."""

    def __init__(self, network: NetworkArray) -> None:
        """
        Args:
            network: Size, network and unit; its threads stay unused.
        """

    def constants(self, address: int) -> Annotated[NDArray[numpy.uint8], dict(shape=(None,))]:
        """
        Return (n,) uint8, the block of memory that stays.

        Args:
            address: Where it will lie on the device.
        """

    def argument(self, constants: int, *, last_luminance: int, last_log: int, v: int, last: int, moved: int, fifo: int, current: int, leaked: int, marks: int, groups: int, totals: int) -> Annotated[NDArray[numpy.uint8], dict(shape=(None,))]:
        """
        Return (n,) uint8, the first argument of every kernel.

        Args:
            constants: Where that block lies on the device, as all others.
            last_luminance, last_log, v: (h, w) float32, of the state.
            last, moved: (h, w) int64, of the state: the tick of v, the last one with X != 0.
            fifo: (6, feature, h, w) float32, of the state; tick n is in slot n mod 6.
            current, leaked: (h, w) float32, written in each tick.
            marks: (h, w) uint16, what each pixel did in a tick.
            groups: (4, groups) uint32, counts of groups of `group` pixels.
            totals: (4,) uint32, those of all: spikes, pixels whose luminance was replaced,
                whose X was clamped and whose V was clamped.
        """

    group: Final[int] = ...
    """The pixels of a group."""

    @property
    def constant_bytes(self) -> int:
        """Bytes of what stays."""

def launch_network_kernel(kernel: str, blocks: int, threads: int, arguments: Sequence[Annotated[NDArray, dict(order='C', device='cpu', writable=False)]]) -> None:
    """
    Run a kernel of EvSNet on the CPU, whose addresses are those of arrays: for tests.

    Args:
        kernel: The name of a kernel of evsnet/gpu/network.cu.
        blocks, threads: How many blocks are launched, and threads of each.
        arguments: Arrays with the bytes of its arguments.
    """

def light_of_numbers(numbers: Annotated[NDArray, dict(device='cpu', writable=False)], tables: Annotated[NDArray[numpy.float32], dict(shape=(None, None), order='C', device='cpu', writable=False)], light: Annotated[NDArray[numpy.float32], dict(shape=(None, None), order='C', device='cpu')]) -> None:
    """
    Look up the light of a frame.

    Args:
        numbers: In, (h, w) or (h, w, 3 or more) uint8 or uint16, with any strides.
        tables: In, (1 or 3, 256 or 65536) float32: light by number, for each channel.
        light: Out, (h, w) float32: red + green, + blue, rounded twice.
    """

def probe_sampler(sampler: str, index: int, dimension: int, pixels: Annotated[NDArray[numpy.int32], dict(shape=(None,), order='C', device='cpu', writable=False)], out: Annotated[NDArray[numpy.float32], dict(shape=(None, 2), order='C', device='cpu')], seed: int = 0, log2_samples: int = 6, block: int = 0, log2_blocks: int = 0) -> None:
    """Sample one dimension for pixels (n,): points (n, 2). For tests."""

def probe_bsdf_sample(albedo: float, f0: float, metallic: float, alpha: float, mirror: float, eye: Sequence[float], u: Annotated[NDArray[numpy.float32], dict(shape=(None, 4), order='C', device='cpu', writable=False)], direction: Annotated[NDArray[numpy.float32], dict(shape=(None, 3), order='C', device='cpu')], light: Annotated[NDArray[numpy.float32], dict(shape=(None, 3), order='C', device='cpu')], pdf: Annotated[NDArray[numpy.float32], dict(shape=(None,), order='C', device='cpu')], pdf_evaluated: Annotated[NDArray[numpy.float32], dict(shape=(None,), order='C', device='cpu')], specular: Annotated[NDArray[numpy.int32], dict(shape=(None,), order='C', device='cpu')], alive: Annotated[NDArray[numpy.int32], dict(shape=(None,), order='C', device='cpu')]) -> None:
    """
    Sample the BSDF of a surface with its normal along z by random numbers (n, 4).
    For tests.
    """

def probe_bsdf(albedo: float, f0: float, metallic: float, alpha: float, mirror: float, eye: Sequence[float], direction: Annotated[NDArray[numpy.float32], dict(shape=(None, 3), order='C', device='cpu', writable=False)], light: Annotated[NDArray[numpy.float32], dict(shape=(None, 3), order='C', device='cpu')], pdf: Annotated[NDArray[numpy.float32], dict(shape=(None,), order='C', device='cpu')]) -> None:
    """
    Evaluate f cos (n, 3) and the pdf (n,) of directions (n, 3). For tests.
    """

def probe_light_sample(caster: Caster, geom_pos: Annotated[NDArray[numpy.float64], dict(shape=(None, 3), order='C', device='cpu', writable=False)], geom_mat: Annotated[NDArray[numpy.float64], dict(shape=(None, 9), order='C', device='cpu', writable=False)], light_pos: Annotated[NDArray[numpy.float64], dict(shape=(None, 3), order='C', device='cpu', writable=False)], light_dir: Annotated[NDArray[numpy.float64], dict(shape=(None, 3), order='C', device='cpu', writable=False)], camera_pos: Annotated[NDArray[numpy.float64], dict(shape=(3), order='C', device='cpu', writable=False)], camera_mat: Annotated[NDArray[numpy.float64], dict(shape=(9), order='C', device='cpu', writable=False)], point: Sequence[float], environment: bool, u: Annotated[NDArray[numpy.float32], dict(shape=(None, 3), order='C', device='cpu', writable=False)], direction: Annotated[NDArray[numpy.float32], dict(shape=(None, 3), order='C', device='cpu')], light: Annotated[NDArray[numpy.float32], dict(shape=(None, 3), order='C', device='cpu')], pdf: Annotated[NDArray[numpy.float32], dict(shape=(None,), order='C', device='cpu')], pdf_evaluated: Annotated[NDArray[numpy.float32], dict(shape=(None,), order='C', device='cpu')]) -> None:
    """
    Sample light from a point by random numbers (n, 3), camera frame, and evaluate
    the pdf (n,) of the same directions. For tests.
    """

def probe_light_pdf(caster: Caster, geom_pos: Annotated[NDArray[numpy.float64], dict(shape=(None, 3), order='C', device='cpu', writable=False)], geom_mat: Annotated[NDArray[numpy.float64], dict(shape=(None, 9), order='C', device='cpu', writable=False)], light_pos: Annotated[NDArray[numpy.float64], dict(shape=(None, 3), order='C', device='cpu', writable=False)], light_dir: Annotated[NDArray[numpy.float64], dict(shape=(None, 3), order='C', device='cpu', writable=False)], camera_pos: Annotated[NDArray[numpy.float64], dict(shape=(3), order='C', device='cpu', writable=False)], camera_mat: Annotated[NDArray[numpy.float64], dict(shape=(9), order='C', device='cpu', writable=False)], point: Sequence[float], direction: Annotated[NDArray[numpy.float32], dict(shape=(None, 3), order='C', device='cpu', writable=False)], pdf: Annotated[NDArray[numpy.float32], dict(shape=(None,), order='C', device='cpu')]) -> None:
    """
    Evaluate the light-sampling pdf (n,) of what directions (n, 3) from a point
    hit. For tests.
    """

class Readout:
    """The readout, from pixel to packet (evs.emulator.sensor.readout)."""

    def __init__(self, width: int, height: int, latency_us: float, latency_sigma_us: float, parameters: object, fates: Annotated[NDArray[numpy.uint8], dict(shape=(None, None), order='C', device='cpu', writable=False)] | None = None) -> None:
        """
        Args:
            width, height: The size of the sensor, px.
            latency_us, latency_sigma_us: The mean latency of a pixel and its jitter.
            parameters: ReadoutParameters of emulator/sensor/parameters.py.
            fates: (height, width) uint8: 0 outside the ROI, 1 masked, 255 read out;
                None reads out every pixel.
        """

    def step(self, events: Annotated[NDArray[numpy.uint8], dict(shape=(None,), order='C', device='cpu', writable=False)], clock: Annotated[NDArray[numpy.int64], dict(shape=(None,), order='C', device='cpu')], waiting: Annotated[NDArray[numpy.uint8], dict(shape=(None,), order='C', device='cpu', writable=False)], due_ns: Annotated[NDArray[numpy.int64], dict(shape=(None,), order='C', device='cpu', writable=False)], t_begin_us: int, t_end_us: int) -> tuple:
        """
        Read out the events of one tick.

        Args:
            events: (16 n,) uint8, the events of the pixels, sorted.
            clock: The int64 state, modified in place.
            waiting, due_ns: The waiting events and their times, as the last call
                returned them.
            t_begin_us, t_end_us: The tick.

        Returns:
            The bytes of the events that are output in the tick, (16 n,) uint8; of
            those that wait, (16 m,) uint8; and the times of these, (m,) int64, ns.
        """

class PixelArray:
    """
    Event pixels with a fixed pattern (emulator/sensor/pixel.py). The caller
    owns the state.
    """

    def __init__(self, settings: object, pattern: object, width: int, height: int, threads: int = 0, isa: str = 'auto') -> None:
        """
        Args:
            settings: What all pixels share; its attributes are those that settings_from of
                core/bindings/sensor.cpp reads. Terms at zero are off.
            pattern: FixedPattern of emulator/sensor/fixed_pattern.py.
            threads: The number of threads; 0 for one per core.
            isa: An instruction set of isa_available(), or auto.
        """

    def step(self, luminance: Annotated[NDArray[numpy.float32], dict(shape=(None, None), order='C', device='cpu', writable=False)], t_begin_us: int, clock_us: int, tick_us: int, ticks: int, state: dict, row_reads: Annotated[NDArray[numpy.int32], dict(shape=(None, None), order='C', device='cpu', writable=False)] | None = None, all_due: bool = False) -> tuple:
        """
        Step all pixels by one tick.

        Args:
            luminance: (h, w) float32.
            t_begin_us: The stamp of the tick's start.
            clock_us: The sensor's clock at the start: the sum of all ticks so far.
            tick_us: The length of the tick.
            ticks: The number of ticks so far.
            state: The arrays of pixel_state() by name, modified in place.
            row_reads: (n, 2) int32, rows of a frame that are read and when, us after the
                start of the tick, by time; None for none.
            all_due: Whether to skip no block, as after a change of the settings.

        Returns:
            The event bytes, (16 n,) uint8, and the number of pixels with unusable
            luminance.
        """

    def settle(self, clock_us: int, state: dict) -> None:
        """
        Account for the leak and the noise of the ticks in which blocks were skipped, so
        that other settings may take the state over.

        Args:
            clock_us: The sensor's clock.
            state: As in `step`.
        """

def pixel_state() -> list[tuple[str, str, int, float, str]]:
    """
    Return the table of the state: for each array its name, its dtype, the pixels that a
    number is of, its first value and its property of SensorTerms ("": always there).
    """

def natural_log(values: Annotated[NDArray[numpy.float32], dict(shape=(None,), order='C', device='cpu', writable=False)]) -> Annotated[NDArray[numpy.float32], dict(shape=(None,))]:
    """Return ln of normal positive float32 (n,), as the pixel computes it."""

def lowpass_steps(z: Annotated[NDArray[numpy.float32], dict(shape=(None,), order='C', device='cpu', writable=False)]) -> tuple:
    """
    Return (a, b) of a one-pole low pass for z = 2 pi f dt (n,) float32, as the
    pixel does.
    """

def large_signal_steps(z: Annotated[NDArray[numpy.float32], dict(shape=(None,), order='C', device='cpu', writable=False)], y0: Annotated[NDArray[numpy.float32], dict(shape=(None,), order='C', device='cpu', writable=False)], x0: Annotated[NDArray[numpy.float32], dict(shape=(None,), order='C', device='cpu', writable=False)], x1: Annotated[NDArray[numpy.float32], dict(shape=(None,), order='C', device='cpu', writable=False)]) -> Annotated[NDArray[numpy.float32], dict(shape=(None,))]:
    """
    Return y1 of the large-signal photoreceptor, (n,) float32 each, as the pixel
    steps it: z = 2 pi f dt, y0 its output, x0 and x1 the log light at the ends of
    the tick.
    """

def log_map(luminance: Annotated[NDArray[numpy.float32], dict(shape=(None,), order='C', device='cpu', writable=False)], log: str, exposure_dn: float, dark_dn: float, linlog_dn: float, log_eps: float) -> Annotated[NDArray[numpy.float32], dict(shape=(None,))]:
    """
    Return the log intensity of luminance (n,); NaN where it is negative, NaN or
    Inf.
    """

class Watch:
    """
    A watch on arrays of other owners: it compares them with a copy of their
    contents.
    """

    def __init__(self, arrays: Sequence[Annotated[NDArray, dict(order='C', device='cpu', writable=False)]]) -> None:
        """
        Args:
            arrays: Contiguous, of any shape and type. Their contents are copied now.
        """

    def changed(self) -> bool:
        """Return whether any byte differs from the copy."""

    def keep(self) -> None:
        """Copy the contents again."""

def digest(arrays: Sequence[Annotated[NDArray, dict(order='C', device='cpu', writable=False)]]) -> int:
    """
    Return a 64-bit digest of the arrays in their order. A single changed word
    always changes it.
    """
