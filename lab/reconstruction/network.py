"""A user's own network that makes video of events: any ONNX graph of the form below.

    in    1st     float32 [1, B, H, W]     voxel grid of the events since the last picture
          others  float32 [1, C, h, w]     states, zeros before the first picture
    out   1st     float32 [1, 1, H, W]     the picture, 0 (black) ... 1
          others  as the inputs            the states of the next picture, in the same order

B and C are numbers. Where h and w are free, their names say what share of H and W they are: H/8 (or
h = n in a graph whose H is 8*n). H and W are padded with empty pixels to what the shares need.
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from evs.emulator.base.scene import F32, F64
from evs.emulator.base.small_files import open_file
from evs.emulator.evsnet.session import one_line, open_session
from evs.msgs import EVENT_DTYPE, Events, EvsError
from evs_lab.reconstruction.voxels import normalised, voxel_grid

MAX_BYTES = 2**31 - 1
MAX_BINS = 1000
MAX_SHARE = 256
"""the smallest state is one pixel for so many of the picture's side"""

_SIDE = re.compile(r"(?:(\d{1,4})\*)?[A-Za-z_]\w*(?://?(\d{1,4}))?")
"""of a free dimension: a name, or a multiple or a part of one"""

Shape = tuple[int, ...]


@dataclass(frozen=True, eq=False)
class VideoNetwork:
    """A network for pictures of one size. Made by `read_video_network`."""

    name: str
    session: Any
    bins: int
    shape: tuple[int, int]
    """height and width of the picture, px"""
    padded: tuple[int, int]
    """height and width that the network gets"""
    states: tuple[Shape, ...]
    raw: bool
    """whether grids stay sums of polarities, without E2VID's normalisation"""

    def video(self, events: Events, times_us: Sequence[int]) -> F64:
        """A picture at each time, from the events since the one before; the first from 0 us.

        Args:
            events: sorted by t.
            times_us: ascending.

        Returns:
            (times, height, width), 0 ... 1.

        Raises:
            EvsError: the network cannot run, or gives other shapes than it should.
        """
        height, width = self.shape
        states: list[F32] = [np.zeros(shape, np.float32) for shape in self.states]
        ends = np.searchsorted(events["t"], [0, *times_us], "right")
        pictures = []
        for begin, end in pairwise(ends):
            grid = voxel_grid(events[begin:end], self.bins, self.shape)
            given = np.zeros((1, self.bins, *self.padded), np.float32)
            given[0, :, :height, :width] = grid if self.raw else normalised(grid)
            picture, states = self._step(given, states)
            pictures.append(picture[:height, :width])
        return np.clip(np.stack(pictures).astype(np.float64), 0.0, 1.0)

    def _step(self, grid: F32, states: list[F32]) -> tuple[F32, list[F32]]:
        names = [value.name for value in self.session.get_inputs()]
        try:
            image, *after = self.session.run(None, dict(zip(names, [grid, *states], strict=True)))
        except Exception as reason:  # onnxruntime's exceptions have no class in common
            raise EvsError(f"{self.name}: onnxruntime cannot run it: {one_line(reason)}") from None
        for found, wanted in zip(
            [image, *after], [(1, 1, *self.padded), *self.states], strict=True
        ):
            if found.shape != wanted:
                raise EvsError(
                    f"{self.name}: an output is {found.shape}, it must be {wanted}: first the "
                    "picture, then the states in the order of the inputs"
                )
        if not np.isfinite(image).all():
            raise EvsError(f"{self.name}: its picture is not finite; are its weights damaged?")
        return image[0, 0], after


def read_video_network(
    path: Path,
    shape: tuple[int, int],
    *,
    raw: bool = False,
    provider: str = "cpu",
    threads: int = 0,
) -> VideoNetwork:
    """Open a network and try it on a picture without events.

    Args:
        path: the .onnx file.
        shape: height and width of the pictures, px.
        raw: whether it wants grids without E2VID's normalisation.
        provider: execution provider of onnxruntime.
        threads: worker threads; 0: one per core.

    Raises:
        EvsError: no file, no graph of the form above, or one that cannot run at that size.
    """
    try:
        size = path.stat().st_size
        with open_file(path) as file:
            graph = file.read() if size <= MAX_BYTES else b""
    except OSError as reason:
        raise EvsError(f"cannot read the network {path}: {reason.strerror}") from None
    if not graph:
        raise EvsError(f"the network {path} has {size} bytes; give an ONNX file of up to 2 GB")
    try:
        session = open_session(graph, provider, threads)
        bins, padded, states = _fitted(session, shape)
    except EvsError as error:
        raise EvsError(f"{path}: {error}") from None
    network = VideoNetwork(path.stem, session, bins, shape, padded, states, raw)
    network.video(np.zeros(0, EVENT_DTYPE), [1, 2])
    return network


def _fitted(session: Any, shape: tuple[int, int]) -> tuple[int, tuple[int, int], tuple[Shape, ...]]:
    """B, padded height and width, and the shapes of the states, for pictures of a size."""
    first, *others = session.get_inputs()
    outputs = session.get_outputs()
    for value in (first, *others, *outputs):
        sound = value.type == "tensor(float)" and len(value.shape) == 4
        if not sound or (isinstance(value.shape[0], int) and value.shape[0] != 1):
            raise EvsError(
                f"'{value.name}' is {value.type} {value.shape}; inputs and outputs must be float32 "
                "with four dimensions, the first of them 1"
            )
    if len(outputs) != 1 + len(others):
        raise EvsError(
            f"it has {len(others)} states and {len(outputs)} outputs; give the picture and "
            "then each state, in the order of the inputs"
        )
    for value in (first, *others):
        if not isinstance(value.shape[1], int) or not 1 <= value.shape[1] <= MAX_BINS:
            raise EvsError(
                f"'{value.name}' has {value.shape[1]} channels; export it with a fixed number"
            )
    padded, shares = list(shape), []
    for axis in (2, 3):
        whole, parts = first.shape[axis], [value.shape[axis] for value in others]
        shares.append([_share(part, whole) for part in parts])
        need = math.lcm(*(share for share in shares[-1] if share))
        side = -(-shape[axis - 2] // need) * need
        padded[axis - 2] = whole if isinstance(whole, int) else side
        if padded[axis - 2] < side:
            raise EvsError(
                f"'{first.name}' has {' x '.join(map(str, first.shape[2:]))} px, too few for a "
                f"picture of {shape[0]} x {shape[1]}; export it with free sizes"
            )
    sizes = [
        tuple(
            value.shape[2 + k] if isinstance(value.shape[2 + k], int) else padded[k] // shares[k][i]
            for k in (0, 1)
        )
        for i, value in enumerate(others)
    ]
    states = tuple((1, value.shape[1], *size) for value, size in zip(others, sizes, strict=True))
    return first.shape[1], (padded[0], padded[1]), states


def _share(part: Any, whole: Any) -> int:
    """Of what share of the picture's side the side of a state is; 0: it is fixed."""
    if isinstance(part, int):
        return 0
    own, all_of = (_factor(side) for side in (part, 1 if isinstance(whole, int) else whole))
    share = all_of / own
    if share.denominator != 1 or not 1 <= share <= MAX_SHARE:
        raise EvsError(
            f"the side {part} of a state is no whole part of {whole}; call it H/8, for instance, "
            "where it is an eighth"
        )
    return int(share)


def _factor(side: Any) -> Fraction:
    """Of 'H': 1; of 'H/8': 1/8; of '4*n': 4."""
    if isinstance(side, int):
        return Fraction(1)
    found = _SIDE.fullmatch(str(side).replace(" ", ""))
    if found is None or "0" in (found[1], found[2]):
        raise EvsError(f"the side '{side}' cannot be read; call it H, W, H/8 or W/8")
    return Fraction(int(found[1] or 1), int(found[2] or 1))
