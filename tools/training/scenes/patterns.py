"""Textures of our own: smooth to fine, soft or with edges, tileable, from + - * / alone."""

from __future__ import annotations

import struct
import zlib

import numpy as np
import numpy.typing as npt

from evs.drivers.pictures import to_srgb8
from evs.emulator.base.scene import F64, U8
from evs.tools.training.scenes.draft import Draft

PATTERNS = ("clouds", "patches", "stripes", "grain", "dots", "bricks")
SIDES = (32, 64, 128, 256)


def pattern_file(draft: Draft, contrast: float) -> tuple[str, str]:
    """(name of a file of the draft, kind): a PNG image.

    It goes from 1 / contrast to 1 in linear light.
    """
    kind = draft.choice(PATTERNS)
    side = SIDES[draft.integer(0, len(SIDES) - 1)]
    shade = _make(draft, kind, side)
    least = 1.0 / contrast
    tint = draft.rng.uniform(0.0, 0.5, 3)
    # dark parts may have another colour than bright ones
    image = (least + (1.0 - least) * shade)[..., np.newaxis] * (
        1.0 - tint * (1.0 - shade[..., np.newaxis])
    )
    name = draft.name("pattern") + ".png"
    draft.files[name] = _png(to_srgb8(image.astype(np.float32), 1.0))
    return name, kind


def _png(pixels: U8) -> bytes:
    """A PNG file of (h, w, 3); not compressed, so that its bytes follow from the pixels alone."""
    height, width, _ = pixels.shape

    def chunk(kind: bytes, content: bytes) -> bytes:
        check = zlib.crc32(kind + content)
        return struct.pack(">I", len(content)) + kind + content + struct.pack(">I", check)

    # each row begins with the number of its filter: none
    rows = np.pad(pixels.reshape(height, -1), ((0, 0), (1, 0)))
    head = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    return b"".join(
        (
            b"\x89PNG\r\n\x1a\n",
            chunk(b"IHDR", head),
            chunk(b"IDAT", zlib.compress(rows.tobytes(), 0)),
            chunk(b"IEND", b""),
        )
    )


def _make(draft: Draft, kind: str, side: int) -> F64:
    """(side, side) in 0 ... 1."""
    if kind == "clouds":
        return _stretched(_octaves(draft, side, draft.uniform(0.3, 0.95)))
    if kind == "patches":
        field = _octaves(draft, side, draft.uniform(0.3, 0.8))
        levels = draft.integer(2, 5)
        return np.asarray(np.floor(np.minimum(_stretched(field), 0.999) * levels) / (levels - 1))
    if kind == "stripes":
        return _stripes(draft, side)
    if kind == "grain":
        block = 1 << draft.integer(0, 2)
        cells = draft.rng.random((side // block, side // block))
        return np.asarray(np.kron(cells, np.ones((block, block))))
    if kind == "bricks":
        return _bricks(draft, side)
    return _dots(draft, side)


def _octaves(draft: Draft, side: int, persistence: float) -> F64:
    """Noise on grids of 2, 4, 8 ... cells; persistence: each beside the one before."""
    total = np.zeros((side, side))
    cells, strength = draft.integer(1, 2) * 2, 1.0
    while cells <= side:
        grid = draft.rng.uniform(-1.0, 1.0, (cells, cells))
        total += strength * _smooth(_smooth(grid, side).T, side).T
        cells, strength = cells * 2, strength * persistence
    return total


def _smooth(grid: F64, side: int) -> F64:
    """Rows of a periodic grid, drawn out to `side` of them."""
    place = np.arange(side) * (grid.shape[0] / side)
    first = place.astype(np.intp)
    part = (place - first)[:, np.newaxis]
    part = part * part * (3.0 - 2.0 * part)
    after = np.roll(grid, -1, 0)
    return np.asarray(grid[first] * (1.0 - part) + after[first] * part)


def _stretched(field: F64) -> F64:
    low, high = float(field.min()), float(field.max())
    return (field - low) / max(high - low, 1e-9)


def _axes(side: int) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]:
    y, x = np.mgrid[0:side, 0:side]
    return x, y


def _stripes(draft: Draft, side: int) -> F64:
    """Stripes along a whole number of periods in x and in y; hard, or a soft wave."""
    x, y = _axes(side)
    wide, high = draft.integer(0, 4), draft.integer(0, 4)
    periods = max(1, draft.integer(1, side // 16))
    phase = ((wide * x + high * y + (wide + high == 0) * x) * periods % side) / side
    if draft.chance(0.5):
        return (phase < draft.uniform(0.15, 0.85)).astype(np.float64)
    # a parabola for each half of a wave
    half = np.abs(2.0 * phase - 1.0)
    return half * half * (3.0 - 2.0 * half)


def _dots(draft: Draft, side: int) -> F64:
    """Round dots of any shade, over one another and over the edges."""
    x, y = _axes(side)
    shade = np.full((side, side), draft.uniform(0.0, 1.0))
    for _ in range(draft.integer(5, 60)):
        radius = side * draft.log_uniform(0.01, 0.2)
        dx = (x - draft.integer(0, side) + side // 2) % side - side // 2
        dy = (y - draft.integer(0, side) + side // 2) % side - side // 2
        shade[dx * dx + dy * dy < radius * radius] = draft.uniform(0.0, 1.0)
    return shade


def _bricks(draft: Draft, side: int) -> F64:
    """Rows of bricks of many shades with joints between them."""
    x, y = _axes(side)
    rows, columns = 1 << draft.integer(1, 3), 1 << draft.integer(1, 3)
    row = y * rows // side
    moved = (x + row * (side // (2 * columns))) % side
    column = moved * columns // side
    shade = draft.rng.uniform(0.4, 1.0, (rows, columns))[row, column]
    joint = max(1, side // 64)
    between = (y % (side // rows) < joint) | (moved % (side // columns) < joint)
    return np.where(between, draft.uniform(0.0, 0.3), shade)
