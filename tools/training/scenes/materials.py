"""Materials: albedo over three decades, textures from smooth to fine, gloss, mirrors, glow."""

from __future__ import annotations

from evs.tools.training.scenes.draft import Draft, encoded, num
from evs.tools.training.scenes.patterns import pattern_file

BUILTIN = ("checker", "gradient", "flat")
LUMA = (0.2126, 0.7152, 0.0722)


def colour(draft: Draft, albedo: float) -> tuple[float, float, float]:
    """Linear RGB of this luminance, of any hue, mostly pale."""
    tint = draft.rng.uniform(0.0, 1.0, 3) ** draft.uniform(0.1, 1.5)
    luminance = float(sum(weight * part for weight, part in zip(LUMA, tint, strict=True)))
    red, green, blue = (min(1.0, float(part) * albedo / max(luminance, 1e-3)) for part in tint)
    return red, green, blue


def albedo(draft: Draft) -> float:
    """Half as paints and woods are, half over three decades."""
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
    """Name of a new material for something of this size.

    Args:
        draft: the scene so far.
        size_m: size of what it covers, m.
        px_per_m: how large a metre appears.
        fine: share of textures with a period of a few px.
        plain: share without texture.
        reflects: share of mirrors.
        contrast: the least of a texture.
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
    """Name of a material that shines by itself with this luminance."""
    name = draft.name("glow")
    shade = " ".join(num(encoded(part)) for part in colour(draft, 0.8))
    draft.assets.append(
        f'<material name="{name}" rgba="{shade} 1" emission="{num(radiance / 0.8)}" specular="0"/>'
    )
    draft.tags.append("glow")
    return name


def texture(draft: Draft, least: float) -> str:
    """Name of a new flat texture: one of MuJoCo's, or a pattern of ours; at least this contrast."""
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
    """A sky of about this luminance: even, or brighter above."""
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
