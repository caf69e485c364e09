"""Do kernels give the same bytes on a GPU as on this machine's processor, and how fast are they?

    python measure.py LIBRARY CODE [math | rays | direct | path]...

LIBRARY is reference.cpp, built; CODE a folder with machine code from compile.py. Prints a table;
the exit code is the number of comparisons in which bytes differ.
"""

from __future__ import annotations

import ctypes
import os
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from gpu import Gpu, Kernel

MATH = [
    *("log2", "exp2", "floor", "truncate", "to_float", "sqrt", "safe_inverse", "abs", "negate"),
    *("add", "subtract", "multiply", "divide", "min", "max", "less", "less_equal", "select"),
]
FIRST_BINARY = 9
CORES = len(os.sched_getaffinity(0))
BLOCK = 128
SAMPLE_BATCH_BYTES = 448


class Difference(ctypes.Structure):
    """As in reference.cpp."""

    _fields_ = [(name, ctypes.c_uint64) for name in ("values", "nan_only", "zero_only", "at")] + [
        (name, ctypes.c_uint32) for name in ("a", "b", "cpu", "gpu")
    ]


def spread(ms: np.ndarray) -> str:
    """Median, least and most of times."""
    return f"{np.median(ms):.3f} ms ({ms.min():.3f} ... {ms.max():.3f}, {len(ms)} times)"


def wall_ms(work: Callable[[], None], repeats: int) -> np.ndarray:
    """How long work takes by the wall, repeated; after two more, which do not count."""
    took = []
    for turn in range(repeats + 2):
        began = time.perf_counter()
        work()
        if turn >= 2:
            took.append(1e3 * (time.perf_counter() - began))
    return np.array(took)


def floats_differ(name: str, cpu: np.ndarray, gpu: np.ndarray) -> int:
    """Print how many floats have other bits. Returns 0 or 1."""
    a, b = cpu.ravel().view(np.uint32), gpu.ravel().view(np.uint32)
    other = np.flatnonzero(a != b)
    if len(other) == 0:
        print(f"  {name}: {a.nbytes} bytes, all equal")
        return 0
    distance = np.abs(a[other].astype(np.int64) - b[other].astype(np.int64))
    least, most = other[distance.argmin()], other[distance.argmax()]
    print(f"  {name}: {len(other)} of {len(a)} floats differ")
    for place in (least, most):
        x, y = cpu.flat[place], gpu.flat[place]
        print(f"    at {place}: {x!r} here, {y!r} there, {abs(int(a[place]) - int(b[place]))} ulp")
    return 1


@dataclass
class Camera:
    """A camera's frame on the GPU."""

    width: int
    height: int
    samples: int
    frame: np.ndarray
    paths: np.ndarray
    upload: Callable[[], None]
    place_ms: float

    @property
    def pixels(self) -> int:
        return self.width * self.height

    @property
    def blocks(self) -> list[int]:
        return [(self.width + 7) // 8, (self.height + 15) // 16]


class Measurement:
    """Everything that is compared."""

    def __init__(self, library: Path, code: Path) -> None:
        self.cpu = ctypes.CDLL(str(library))
        for name in ("camera_make", "camera_constant", "camera_tick", "camera_frame_struct",
                     "camera_paths_struct"):  # fmt: skip
            getattr(self.cpu, name).restype = ctypes.c_void_p
        self.cpu.camera_frame.restype = ctypes.c_uint64
        self.code = code
        self.gpu = Gpu()
        self.differ = 0

    def kernel(self, file: str, name: str = "") -> Kernel:
        return Kernel(self.gpu, self.code / f"{file}.cubin", name or file.split("-")[0])

    def math(self, log2_count: int) -> None:
        """Single operations, on all floats or on 2^log2_count pairs."""
        chunk = 1 << 26
        results = self.gpu.pinned(chunk, np.int32)
        out = self.gpu.allocate(results.nbytes)
        for variant in sorted(path.stem for path in self.code.glob("math*.cubin")):
            kernel = self.kernel(variant, "math")
            print(f"{variant}: {kernel.describe(BLOCK)}")
            for op, name in enumerate(MATH):
                found = Difference()
                count = 1 << (32 if op < FIRST_BINARY else log2_count)
                for first in range(0, count, chunk):
                    kernel(
                        [chunk // 256], 256, np.int32([op]), np.uint64([first]), np.uint64([out])
                    )
                    self.gpu.download(results, out)
                    self.cpu.math_compare(
                        op, ctypes.c_uint64(first), ctypes.c_uint64(chunk),
                        ctypes.c_void_p(results.ctypes.data), CORES, ctypes.byref(found),
                    )  # fmt: skip
                line = f"  {name}: {count} operands, {found.values} differ"
                line += f", {found.nan_only} are NaN of other bits"
                if found.values:
                    self.differ += variant == "math"
                    line += (
                        f"; {found.zero_only} by the sign of zero; first: {found.a:08x}, "
                        f"{found.b:08x} give {found.cpu:08x} here, {found.gpu:08x} there"
                    )
                print(line, flush=True)
        self.gpu.free(out)

    def place(self, camera: int) -> tuple[np.ndarray, np.ndarray, Callable[[], None], float]:
        """Put a camera's frame on the GPU. Returns its structs, the upload of a tick, its bytes."""
        tick_bytes = ctypes.c_uint64()
        handle = ctypes.c_void_p(camera)

        def lay_out(constant: int, tick: int) -> int:
            size: int = self.cpu.camera_frame(
                handle, ctypes.c_uint64(constant), ctypes.c_uint64(tick), ctypes.byref(tick_bytes)
            )
            if size == 0:
                raise SystemExit("the scene has what reference.cpp does not copy")
            return size

        size = lay_out(0, 0)
        constant = self.gpu.allocate(size + 4096)
        tick = self.gpu.allocate(tick_bytes.value + 4096)
        lay_out(constant, tick)
        self.gpu.upload(constant, self.cpu.camera_constant(handle), size)
        source = self.gpu.pinned(tick_bytes.value, np.uint8)
        ctypes.memmove(source.ctypes.data, self.cpu.camera_tick(handle), tick_bytes.value)

        def upload() -> None:
            self.gpu.upload(tick, source.ctypes.data, source.nbytes)

        upload()
        self.gpu.wait()

        def struct(address: int, size: int) -> np.ndarray:
            memory = (ctypes.c_uint8 * size).from_address(address)
            return np.frombuffer(memory, np.uint8).copy()

        frame = struct(self.cpu.camera_frame_struct(handle), self.cpu.frame_bytes())
        paths = struct(self.cpu.camera_paths_struct(handle), self.cpu.paths_bytes())
        print(f"  {size} bytes stay on the GPU, {tick_bytes.value + len(frame)} go there each tick")
        began = time.perf_counter()
        self.cpu.camera_place(handle, 200)
        return frame, paths, upload, 1e3 * (time.perf_counter() - began) / 201

    def rays(self, count: int) -> None:
        """Nearest hits and occlusion."""
        kernel = self.kernel("rays")
        print(f"rays: {kernel.describe(BLOCK)}")
        camera = self.cpu.camera_make(346, 260, 1, 0)
        frame, _, _, _ = self.place(camera)
        rays = np.empty((6, count), np.float32)
        self.cpu.rays_make(ctypes.c_long(count), ctypes.c_void_p(rays.ctypes.data))
        hits, found = np.empty_like(rays), np.empty_like(rays)
        near, far = self.gpu.allocate(rays.nbytes), self.gpu.allocate(rays.nbytes)
        self.gpu.upload(near, rays.ctypes.data, rays.nbytes)

        def launch() -> None:
            kernel(
                [count // BLOCK], BLOCK, frame, np.uint64([near]), np.int64([count]),
                np.uint64([far]),
            )  # fmt: skip

        ms = self.gpu.milliseconds(launch, 20)
        self.gpu.download(found, far)
        for threads in (1, CORES):

            def trace(threads: int = threads) -> None:
                self.cpu.rays_trace(
                    ctypes.c_void_p(camera), threads, ctypes.c_long(count),
                    ctypes.c_void_p(rays.ctypes.data), ctypes.c_void_p(hits.ctypes.data),
                )  # fmt: skip

            print(f"  portable, {threads} threads: {spread(wall_ms(trace, 5))}")
        self.differ += floats_differ("distance, geom, triangle, u, v, occluded", hits, found)
        met, shadow = np.count_nonzero(hits[1] >= 0), np.count_nonzero(hits[5])
        print(f"  {count} rays, {met} hits, {shadow} occluded; GPU: {spread(ms)}")

    def rendered(self, camera: int, isa: str, threads: int, incremental: bool, ticks: int,
                 pixels: int) -> tuple[np.ndarray, np.ndarray]:  # fmt: skip
        """Luminance of the last tick, and ms of each."""
        luminance = np.empty(pixels, np.float32)
        handle, image = ctypes.c_void_p(camera), ctypes.c_void_p(luminance.ctypes.data)
        self.cpu.camera_begin(handle, isa.encode(), threads, int(incremental))
        ms = np.empty(ticks)
        for tick in range(ticks):
            began = time.perf_counter()
            self.cpu.camera_render(handle, image)
            ms[tick] = 1e3 * (time.perf_counter() - began)
        return luminance, ms

    def together(
        self, kernel: Kernel, blocks: list[int], frame: np.ndarray, pixels: int, count: int
    ) -> None:
        """Frames at once: as many streams, each with an image of its own."""
        images = [np.uint64([self.gpu.allocate(4 * pixels)]) for _ in range(count)]
        streams = [self.gpu.new_stream() for _ in range(count)]

        def launch() -> None:
            for image, stream in zip(images, streams, strict=True):
                kernel(blocks, BLOCK, frame, image, stream=stream)
            self.gpu.wait_for_all()

        ms = wall_ms(launch, 30) / count
        print(f"    {count} frames at once, a frame: {spread(ms)}", flush=True)
        for image in images:
            self.gpu.free(int(image[0]))

    def launcher(
        self, variant: str, camera: Camera, out: int
    ) -> tuple[Kernel, Callable[[], None], list[int]]:
        """What launches a kernel of images, and the memory that it needs besides."""
        kernel = self.kernel(variant)
        image = np.uint64([out])
        if variant.startswith("direct"):
            return kernel, lambda: kernel(camera.blocks, BLOCK, camera.frame, image), []
        if variant.startswith("samples"):
            count = camera.pixels * camera.samples
            batches = self.gpu.allocate(SAMPLE_BATCH_BYTES * count)
            light = self.gpu.allocate(3 * 4 * count)
            add = self.kernel(variant, "sum")

            def launch_samples() -> None:
                kernel(
                    [(count + BLOCK - 1) // BLOCK], BLOCK, camera.frame, camera.paths,
                    np.uint64([batches]), np.uint64([light]),
                )  # fmt: skip
                grid = [(camera.pixels + BLOCK - 1) // BLOCK]
                add(grid, BLOCK, camera.frame, np.uint64([light]), image)

            return kernel, launch_samples, [batches, light]
        at_once = 8 * self.gpu.attribute("MULTIPROCESSOR_COUNT")
        grid = [min(at_once, camera.blocks[0] * camera.blocks[1])]
        size = np.zeros(1, np.uint64)
        place = self.gpu.allocate(8)
        self.kernel(variant, "path_batch_bytes")([1], 1, np.uint64([place]))
        self.gpu.download(size, place)
        batches = self.gpu.allocate(int(size[0]) * grid[0] * BLOCK)
        print(f"  batch of a thread: {size[0]} bytes")

        def launch_paths() -> None:
            kernel(grid, BLOCK, camera.frame, camera.paths, np.uint64([batches]), image)

        return kernel, launch_paths, [batches]

    def images(self, variant: str, camera: Camera, expected: np.ndarray, ticks: int) -> None:
        """Images of one kernel: their bytes and times."""
        luminance = self.gpu.pinned(camera.pixels, np.float32)
        out = self.gpu.allocate(luminance.nbytes)
        kernel, launch, memory = self.launcher(variant, camera, out)
        print(f"  {variant}: {kernel.describe(BLOCK)}")

        def tick() -> None:
            camera.upload()
            launch()
            self.gpu.download(luminance, out)

        tick()
        self.differ += floats_differ(f"{variant} on the GPU", expected, luminance.copy())
        print(f"    kernel alone: {spread(self.gpu.milliseconds(launch, ticks))}", flush=True)
        print(f"    upload, kernel, download: {spread(wall_ms(tick, ticks))}", flush=True)
        if variant.startswith("direct"):
            self.together(kernel, camera.blocks, camera.frame, camera.pixels, 16)
        for address in (out, *memory):
            self.gpu.free(address)

    def frames(self, what: str, width: int, height: int, samples: int, ticks: int) -> None:
        """Whole images."""
        print(f"{what}, {width} x {height}, {samples} samples a pixel")
        handle = self.cpu.camera_make(width, height, samples, int(what == "path"))
        camera = Camera(width, height, samples, *self.place(handle))
        expected, _ = self.rendered(handle, "auto", CORES, False, 1, camera.pixels)
        for other in ("one_lane", "portable"):
            light, _ = self.rendered(handle, other, CORES, False, 1, camera.pixels)
            self.differ += floats_differ(f"{other} on the CPU", expected, light)
        names = [what, "samples"] if what == "path" else [what]
        files = [file for name in names for file in sorted(self.code.glob(f"{name}*.cubin"))]
        for file in files:
            self.images(file.stem, camera, expected, ticks)
        print(f"  placing the scene on the CPU: {camera.place_ms:.4f} ms a tick")
        repeats = 3 if what == "path" else 30
        for threads in (1, CORES):
            _, ms = self.rendered(handle, "auto", threads, False, repeats + 1, camera.pixels)
            print(f"  CPU, {threads} threads, every pixel: {spread(ms[1:])}", flush=True)
            _, ms = self.rendered(handle, "auto", threads, True, repeats + 2, camera.pixels)
            print(f"  CPU, {threads} threads, incremental, one of 25 geoms moves: {spread(ms[2:])}")
        low, high = expected.min(), expected.max()
        print(f"  light: mean {expected.mean():.4f}, from {low:.4f} to {high:.4f}", flush=True)


def main() -> None:
    library, code = Path(sys.argv[1]).resolve(), Path(sys.argv[2])
    wanted = sys.argv[3:] or ["math", "rays", "direct", "path"]
    run = Measurement(library, code)
    processors = run.gpu.attribute("MULTIPROCESSOR_COUNT")
    print(f"{run.gpu.name()}, {processors} multiprocessors; CPU with {CORES} cores")
    if "rays" in wanted:
        run.rays(1 << 22)
    if "direct" in wanted:
        run.frames("direct", 346, 260, 1, 50)
        run.frames("direct", 1280, 720, 1, 50)
    if "math" in wanted:
        run.math(30)
    if "path" in wanted:
        run.frames("path", 346, 260, 64, 5)
    raise SystemExit(run.differ)


if __name__ == "__main__":
    main()
