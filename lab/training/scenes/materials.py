"""Materials: albedo over three decades, textures from smooth to fine, gloss, mirrors, glow."""

from __future__ import annotations

import struct
import zlib

import numpy as np
import numpy.typing as npt

from evs.emulator.base.scene import F64, U8
from evs.msgs.pictures import to_srgb8
from evs_lab.training.scenes.draft import Draft, encoded, num

BUILTIN = ("checker", "gradient", "flat")
LUMA = (0.2126, 0.7152, 0.0722)


def colour(draft: Draft, albedo: float) -> tuple[float, float, float]:
    """Draw a linear RGB colour of this luminance, of any hue, mostly pale."""
    tint = draft.rng.uniform(0.0, 1.0, 3) ** draft.uniform(0.1, 1.5)
    luminance = float(sum(weight * part for weight, part in zip(LUMA, tint, strict=True)))
    red, green, blue = (min(1.0, float(part) * albedo / max(luminance, 1e-3)) for part in tint)
    return red, green, blue


def albedo(draft: Draft) -> float:
    """Draw an albedo: half like paint and wood, half over three decades."""
    return draft.log_uniform(0.05, 0.9) if draft.chance(0.5) else draft.log_uniform(1e-3, 0.95)


def material(
    draft: Draft,
    size_m: float,
    px_per_m: float,
    *,
    fine: float = 0.0,
    plain: float = 0.25,
    reflects: float = 0.12,
    contrast: float = 1.05,
) -> str:
    """Add a material for something of this size; return its name.

    Args:
        draft: the scene so far.
        size_m: size of what it covers, m.
        px_per_m: how large a metre appears.
        fine: share of textures with a period of a few px.
        plain: share without texture.
        reflects: share of mirrors.
        contrast: least contrast of a texture.
    """
    name = draft.name("look")
    attributes = [f'name="{name}"', f'rgba="{num(*map(encoded, colour(draft, albedo(draft))))} 1"']
    if not draft.chance(plain):
        # a period in the image, px
        period_px = (
            draft.log_uniform(2.0, 12.0) if draft.chance(fine) else draft.log_uniform(4, 200)
        )
        repeat = max(0.3, size_m * px_per_m / period_px)
        stretched = draft.log_uniform(0.5, 2.0)
        attributes.append(
            f'texture="{texture(draft, contrast)}" texrepeat="{num(repeat, repeat * stretched)}"'
        )
        draft.tags.append("fine" if period_px < 8 else "textured")
    if draft.chance(reflects):
        attributes.append(f'reflectance="{num(draft.uniform(0.1, 0.95))}"')
        draft.tags.append("mirror")
    elif draft.chance(0.25):
        metal = 1.0 if draft.chance(0.5) else 0.0
        attributes.append(f'metallic="{num(metal)}" roughness="{num(draft.uniform(0.05, 1.0))}"')
        draft.tags.append("metal" if metal else "physical")
    elif draft.chance(0.5):
        gloss = draft.uniform(0.0, 1.0), draft.uniform(0.05, 1.0)
        attributes.append(f'specular="{num(gloss[0])}" shininess="{num(gloss[1])}"')
    else:
        attributes.append('specular="0"')
    draft.assets.append(f"<material {' '.join(attributes)}/>")
    return name


def glowing(draft: Draft, radiance: float) -> str:
    """Add a material that emits this luminance; return its name."""
    name = draft.name("glow")
    shade = " ".join(num(encoded(part)) for part in colour(draft, 0.8))
    draft.assets.append(
        f'<material name="{name}" rgba="{shade} 1" emission="{num(radiance / 0.8)}" specular="0"/>'
    )
    draft.tags.append("glow")
    return name


def texture(draft: Draft, least: float) -> str:
    """Add a texture of at least this contrast, of MuJoCo's or of our patterns; return its name."""
    name = draft.name("texture")
    contrast = draft.log_uniform(least, 30.0)
    if draft.chance(0.6):
        file, _ = pattern_file(draft, contrast)
        draft.assets.append(f'<texture name="{name}" type="2d" file="{file}"/>')
        return name
    builtin = draft.choice(BUILTIN, (3, 1, 1))
    side = 1 << draft.integer(3, 8)
    dark = 1.0 / contrast
    shades = (dark, 1.0) if draft.chance(0.5) else (1.0, dark)
    tint = draft.rng.uniform(0.6, 1.0, 3)
    first, second = (num(*(encoded(shade * part) for part in tint)) for shade in shades)
    mark = ""
    if builtin == "flat" or draft.chance(0.3):
        kind = draft.choice(("random", "edge", "cross"), (3, 1, 1))
        share = draft.log_uniform(0.01, 0.5)
        mark = f'mark="{kind}" random="{num(share)}" markrgb="{second}"'
    draft.assets.append(
        f'<texture name="{name}" type="2d" builtin="{builtin}" width="{side}" height="{side}" '
        f'rgb1="{first}" rgb2="{second}" {mark}/>'
    )
    return name


def sky(draft: Draft, brightness: float) -> None:
    """Add a sky of about this luminance: uniform, or brighter at the top."""
    above, below = draft.uniform(0.5, 1.0), draft.uniform(0.05, 1.0)
    tint = draft.rng.uniform(0.7, 1.0, 3)
    first, second = (
        num(*(encoded(min(1.0, brightness) * share * part) for part in tint))
        for share in (above, below)
    )
    stars = ""
    if draft.chance(0.2):
        stars = f'mark="random" random="{num(draft.log_uniform(1e-3, 0.05))}" markrgb="1 1 1"'
    draft.assets.append(
        f'<texture name="{draft.name("sky")}" type="skybox" builtin="gradient" width="64" '
        f'height="64" rgb1="{first}" rgb2="{second}" {stars}/>'
    )
    draft.tags.append("sky")


# Textures that we draw: smooth to fine, soft or with edges, tileable, from + - * / alone

PATTERNS = ("clouds", "patches", "stripes", "grain", "dots", "bricks")
SIDES = (32, 64, 128, 256)


def pattern_file(draft: Draft, contrast: float) -> tuple[str, str]:
    """Add a PNG image that goes from 1 / contrast to 1 in linear light.

    Returns:
        Name of the file in the draft, and kind of the pattern.
    """
    kind = draft.choice(PATTERNS)
    side = SIDES[draft.integer(0, len(SIDES) - 1)]
    shade = _draw_pattern(draft, kind, side)
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


def _draw_pattern(draft: Draft, kind: str, side: int) -> F64:
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
