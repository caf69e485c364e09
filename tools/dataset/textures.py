"""The textures of the data set's scenes: tileable, from a seeded generator, small as files.

    python -m evs.tools.dataset.textures config/scenes/dataset/textures

writes them anew; a test compares what is there with what this makes, pixel by pixel.
"""

from __future__ import annotations

import sys
import zlib
from collections.abc import Callable
from pathlib import Path

import numpy as np
import numpy.typing as npt

F64 = npt.NDArray[np.float64]
U8 = npt.NDArray[np.uint8]

LEVELS = 20
"""of each colour: few of them make small files"""


class TextureCanvas:
    """A square of (side, side) numbers to paint on, and its random numbers."""

    def __init__(self, name: str, side: int) -> None:
        self.side = side
        self.rng = np.random.Generator(np.random.Philox(zlib.crc32(name.encode())))
        self.y, self.x = np.mgrid[0:side, 0:side]

    def cells(self, wide: int, high: int) -> F64:
        """One random number for each of wide x high cells."""
        kernel = np.ones((self.side // high, self.side // wide))
        return np.asarray(np.kron(self.rng.random((high, wide)), kernel), np.float64)

    def clouds(self, first: int, last: int, fall: float = 0.5) -> F64:
        """(side, side) in 0 ... 1: smooth noise on grids of `first`, twice as many, ... cells."""
        total, weight, count = np.zeros((self.side, self.side)), 1.0, first
        while count <= last:
            total += weight * self.smooth(count)
            weight, count = weight * fall, 2 * count
        return np.asarray((total - total.min()) / (total.max() - total.min()))

    def smooth(self, count: int) -> F64:
        """(side, side) noise between count x count knots; it tiles."""
        knots = self.rng.random((count, count))
        at = np.arange(self.side) * count / self.side
        low = at.astype(np.intp)
        share = at - low
        share = share * share * (3 - 2 * share)
        rows = knots[low] * (1 - share)[:, None] + knots[(low + 1) % count] * share[:, None]
        return np.asarray(rows[:, low] * (1 - share) + rows[:, (low + 1) % count] * share)

    def grain(self) -> F64:
        """(side, side) a random number for each pixel."""
        return self.rng.random((self.side, self.side))


def coloured(shade: F64, dark: tuple[float, ...], bright: tuple[float, ...]) -> F64:
    """(side, side, 3) from one colour to another as `shade` goes from 0 to 1."""
    low, high = np.array(dark), np.array(bright)
    return np.asarray(low + np.clip(shade, 0, 1)[..., None] * (high - low))


def brick(c: TextureCanvas) -> F64:
    """Eight rows in a running bond; every brick has a tone of its own."""
    row = c.y // 32
    x = (c.x + 32 * (row % 2)) % c.side
    tone = c.rng.random((8, 4))[row, x // 64]
    mortar = (c.y % 32 < 4) | (x % 64 < 4)
    wall = coloured(0.65 * tone + 0.35 * c.clouds(16, 128), (0.42, 0.18, 0.13), (0.75, 0.4, 0.28))
    return np.where(mortar[..., None], 0.62 + 0.12 * c.clouds(32, 64)[..., None], wall)


def planks(c: TextureCanvas) -> F64:
    """Four boards with their grain and a seam between them."""
    board = c.x // 64
    grain = np.sin(0.55 * c.x + 9 * c.smooth(4) + 5 * board) * 0.5 + 0.5
    along = np.repeat(c.rng.random((1, c.side)), c.side, 0)
    shade = 0.45 * c.rng.random(4)[board] + 0.3 * grain + 0.25 * along
    wood = coloured(shade, (0.38, 0.23, 0.12), (0.82, 0.6, 0.38))
    return np.where((c.x % 64 < 2)[..., None], 0.14, wood)


def tiles(c: TextureCanvas) -> F64:
    """Four by four glazed tiles, light and dark in turn."""
    side = c.side // 4
    tone = 0.1 * c.cells(4, 4) + 0.06 * c.clouds(8, 32)
    light = ((c.x // side + c.y // side) % 2).astype(float)
    face = coloured(0.15 + 0.7 * light + tone, (0.16, 0.2, 0.22), (0.95, 0.93, 0.88))
    grout = (c.x % side < 2) | (c.y % side < 2)
    return np.where(grout[..., None], 0.45, face)


def plaster(c: TextureCanvas) -> F64:
    """A rough wall."""
    shade = 0.6 * c.clouds(4, 64, 0.7) + 0.4 * c.smooth(64)
    return coloured(shade, (0.7, 0.7, 0.7), (1.0, 1.0, 1.0))


def asphalt(c: TextureCanvas) -> F64:
    """Stones in tar, with worn and with wet places."""
    shade = 0.55 * c.grain() ** 2 + 0.45 * c.clouds(2, 16)
    return coloured(shade, (0.3, 0.3, 0.31), (1.0, 1.0, 1.0))


def concrete(c: TextureCanvas) -> F64:
    """Panels with joints and stains that ran down."""
    stain = np.repeat(c.smooth(32)[:1], c.side, 0) * (c.y / c.side)
    shade = 0.5 * c.clouds(4, 64, 0.7) + 0.25 * c.grain() + 0.25 * (1 - stain)
    joint = (c.x < 3) | (c.y < 3)
    return np.where(joint[..., None], 0.25, coloured(shade, (0.45, 0.45, 0.44), (0.95, 0.94, 0.9)))


def grass(c: TextureCanvas) -> F64:
    """Blades, dry patches, a few flowers."""
    blades = np.roll(c.grain(), 1, 0) * 0.5 + c.grain() * 0.5
    shade = 0.5 * blades + 0.5 * c.clouds(4, 32, 0.7)
    green = coloured(shade, (0.1, 0.2, 0.05), (0.55, 0.68, 0.25))
    flowers = c.rng.random((c.side, c.side)) > 0.996
    return np.where(flowers[..., None], (0.95, 0.95, 0.7), green)


def foliage(c: TextureCanvas) -> F64:
    """Leaves, and the dark between them."""
    shade = 0.6 * c.clouds(16, 64, 0.8) + 0.4 * c.grain()
    return coloured((shade - 0.25) * 1.6, (0.05, 0.12, 0.03), (0.5, 0.66, 0.24))


def bark(c: TextureCanvas) -> F64:
    """Furrows that run up a trunk."""
    furrow = np.sin(0.5 * c.x + 7 * c.smooth(8)) * 0.5 + 0.5
    return coloured(0.6 * furrow + 0.4 * c.clouds(16, 64), (0.15, 0.1, 0.07), (0.6, 0.46, 0.34))


def plaid(c: TextureCanvas) -> F64:
    """A checked tablecloth with its weave."""
    across, down = (c.x // 16) % 2, (c.y // 16) % 2
    weave = 0.1 * ((c.x + c.y) % 2)
    return coloured(1 - 0.5 * (across + down) + weave, (0.66, 0.1, 0.1), (0.97, 0.95, 0.9))


def carpet(c: TextureCanvas) -> F64:
    """Diamonds in three wools."""
    u, v = (c.x + c.y) % 64, (c.x - c.y) % 64
    ring = np.maximum(abs(u - 32), abs(v - 32)) // 8
    wool = np.array([(0.82, 0.72, 0.5), (0.55, 0.12, 0.12), (0.13, 0.2, 0.4), (0.82, 0.72, 0.5)])
    return np.asarray(wool[np.clip(ring, 0, 3)] * (0.75 + 0.25 * c.grain()[..., None]))


def poster(c: TextureCanvas) -> F64:
    """A picture: sun, hills, stripes."""
    t = c.y / c.side
    image = coloured(1 - t, (0.95, 0.75, 0.4), (0.2, 0.45, 0.75))
    sun = (c.x - 0.65 * c.side) ** 2 + (c.y - 0.38 * c.side) ** 2 < (0.15 * c.side) ** 2
    image[sun] = (0.97, 0.9, 0.5)
    for depth, colour in (
        (0.55, (0.45, 0.5, 0.6)),
        (0.68, (0.25, 0.42, 0.3)),
        (0.82, (0.1, 0.2, 0.16)),
    ):
        hill = t > depth + 0.08 * np.sin(c.x / c.side * 2 * np.pi * (1 + 2 * depth) + 9 * depth)
        image[hill] = colour
    frame = np.minimum(np.minimum(c.x, c.side - 1 - c.x), np.minimum(c.y, c.side - 1 - c.y))
    image[frame < 6] = (0.93, 0.92, 0.88)
    image[frame < 3] = (0.12, 0.1, 0.1)
    return image


def books(c: TextureCanvas) -> F64:
    """Four shelves of spines."""
    image = np.full((c.side, c.side, 3), 0.06)
    shelf = c.side // 4
    for row in range(4):
        left = 0
        while left < c.side - 4:
            width, height = int(c.rng.integers(5, 13)), int(c.rng.integers(shelf - 24, shelf - 8))
            low = (row + 1) * shelf - 5
            colour = 0.12 + 0.7 * c.rng.random(3)
            right = min(left + width, c.side)
            image[low - height : low, left:right] = colour
            image[low - height : low, right - 1 : right] *= 0.4
            image[low - height + 6 : low - height + 9, left : right - 1] = 0.85
            left = right
        image[(row + 1) * shelf - 5 : (row + 1) * shelf] = (0.45, 0.3, 0.17)
    return image


def cardboard(c: TextureCanvas) -> F64:
    """A carton: tape, a label, a bar code."""
    image = coloured(
        0.5 * c.clouds(8, 64) + 0.5 * c.grain(), (0.52, 0.37, 0.22), (0.72, 0.55, 0.36)
    )
    image[:, 56:72] = (0.86, 0.78, 0.58)
    image[74:116, 8:50] = 0.94
    bars = np.repeat(c.rng.random(19) > 0.5, 2)
    image[80:98, 10:48][:, bars] = 0.06
    image[102:105, 12:40] = image[108:111, 12:32] = 0.2
    return image


def facade(c: TextureCanvas) -> F64:
    """A house front of plaster with four by four windows."""
    image = coloured(c.clouds(4, 64, 0.7), (0.62, 0.6, 0.56), (0.82, 0.79, 0.73))
    image[_windows(c)] = (0.1, 0.12, 0.15)
    image[_sills(c)] = (0.9, 0.88, 0.84)
    image[(c.y % 64) < 3] = (0.42, 0.4, 0.38)
    return image


def lit(c: TextureCanvas) -> F64:
    """What glows of that house at night: a few of its windows, curtains in some."""
    warm = coloured(c.clouds(8, 32), (0.75, 0.42, 0.16), (1.0, 0.78, 0.42))
    home = c.cells(4, 4)
    curtain = ((c.x % 64) < 28) & (c.cells(4, 4) > 0.5)
    glow = np.where(home > 0.62, 1.0, 0.0) * np.where(curtain, 0.45, 1.0) * _windows(c)
    return np.asarray(warm * glow[..., None], np.float64)


def _windows(c: TextureCanvas) -> npt.NDArray[np.bool_]:
    u, v = c.x % 64, c.y % 64
    bars = (abs(u - 32) < 2) | (abs(v - 26) < 1)
    return np.asarray((u >= 16) & (u < 48) & (v >= 12) & (v < 48) & ~bars)


def _sills(c: TextureCanvas) -> npt.NDArray[np.bool_]:
    u, v = c.x % 64, c.y % 64
    return np.asarray((u >= 13) & (u < 51) & (v >= 48) & (v < 52))


TEXTURES: dict[str, tuple[Callable[[TextureCanvas], F64], int]] = {
    paint.__name__: (paint, side)
    for paint, side in (
        (brick, 256),
        (planks, 256),
        (tiles, 128),
        (plaster, 128),
        (asphalt, 128),
        (concrete, 128),
        (grass, 128),
        (foliage, 128),
        (bark, 128),
        (plaid, 64),
        (carpet, 128),
        (poster, 128),
        (books, 256),
        (cardboard, 128),
        (facade, 256),
        (lit, 256),
    )
}
"""name -> (what paints it, px a side)"""


def texture(name: str) -> U8:
    """(side, side, 3) one of them, coded for displays."""
    paint, side = TEXTURES[name]
    image = np.clip(paint(TextureCanvas(name, side)), 0.0, 1.0)
    return np.asarray(np.rint(image * LEVELS) * (255 / LEVELS)).round().astype(np.uint8)


def main(folder: str) -> None:
    """Write every one as a PNG file."""
    from evs.drivers.pictures import write_png

    for name in TEXTURES:
        write_png(Path(folder, f"{name}.png"), texture(name))


if __name__ == "__main__":
    main(sys.argv[1])
