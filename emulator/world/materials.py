"""Materials and textures of a model, as its geoms use them."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import mujoco
import numpy as np
import numpy.typing as npt

from evs.emulator.base.scene import Surface, Texture, TextureKind
from evs.emulator.world.compat import gloss_is_given
from evs.emulator.world.model import name_of
from evs.emulator.world.model_edits import Array, PartCache
from evs.msgs import EvsError

Rgba = tuple[float, float, float, float]

Role = mujoco.mjtTextureRole

COLOUR_ROLES = (Role.mjTEXROLE_RGB, Role.mjTEXROLE_RGBA)
"""The roles that give a material its colour, the first that is filled counts."""

MAP_ROLES = {
    "metallic_map": ((Role.mjTEXROLE_METALLIC, 0), (Role.mjTEXROLE_ORM, 2)),
    "roughness_map": ((Role.mjTEXROLE_ROUGHNESS, 0), (Role.mjTEXROLE_ORM, 1)),
    "occlusion_map": ((Role.mjTEXROLE_OCCLUSION, 0), (Role.mjTEXROLE_ORM, 0)),
    "opacity_map": ((Role.mjTEXROLE_OPACITY, 0), (Role.mjTEXROLE_RGBA, 3)),
}
"""map of one number -> roles and which component of theirs; the first that is filled counts"""

MIRRORS = (mujoco.mjtGeom.mjGEOM_PLANE, mujoco.mjtGeom.mjGEOM_BOX)
"""Geoms of these types mirror where their material has reflectance: planes, and boxes on their +Z
face, in both of MuJoCo's renderers and in its reference."""

UNSET = (0.5, 0.5, 0.5, 1.0)
"""A geom's rgba that means: take the material's."""

WORDS = {
    mujoco.mjtObj.mjOBJ_GEOM: "geom",
    mujoco.mjtObj.mjOBJ_SKIN: "skin",
    mujoco.mjtObj.mjOBJ_FLEX: "flex",
    mujoco.mjtObj.mjOBJ_SITE: "site",
    mujoco.mjtObj.mjOBJ_TENDON: "tendon",
    mujoco.mjtObj.mjOBJ_MATERIAL: "material",
}
"""What has a colour, as errors call it."""

KTX_MAGIC = bytes([0xAB, 0x4B, 0x54, 0x58])
"""Compressed textures are stored as whole files that begin like this; they are not pixels."""


def geom_rgba(model: mujoco.MjModel, geom: int) -> Rgba:
    """The colour that MuJoCo shows of a geom."""
    kind = mujoco.mjtObj.mjOBJ_GEOM
    return shown_rgba(model, kind, geom, model.geom_rgba[geom], int(model.geom_matid[geom]))


def site_rgba(model: mujoco.MjModel, site: int) -> Rgba:
    """The colour that MuJoCo shows of a site."""
    kind = mujoco.mjtObj.mjOBJ_SITE
    return shown_rgba(model, kind, site, model.site_rgba[site], int(model.site_matid[site]))


def shown_rgba(
    model: mujoco.MjModel, kind: mujoco.mjtObj, index: int, rgba: npt.ArrayLike, material: int
) -> Rgba:
    """The colour that MuJoCo shows: an object's own unless that is unset and it has a material.

    Args:
        model: The model.
        kind: Kind of the object.
        index: Its id.
        rgba: (4,) its own colour.
        material: Id of its material; -1: none.

    Raises:
        EvsError: The colour is not finite.
    """
    own = tuple(float(value) for value in np.asarray(rgba))
    if own == UNSET and material >= 0:
        kind, index = mujoco.mjtObj.mjOBJ_MATERIAL, material
        own = tuple(float(value) for value in model.mat_rgba[material])
    what = f"rgba of {WORDS[kind]} '{name_of(model, kind, index)}'"
    red, green, blue, alpha = (clamped(value, 0.0, 1.0, what) for value in own)
    return red, green, blue, alpha


@dataclass
class Surfaces:
    """Collects the surfaces and textures in use, each once."""

    model: mujoco.MjModel
    parts: PartCache = field(default_factory=PartCache)
    """which keep the textures"""
    surfaces: list[Surface] = field(default_factory=list)
    textures: list[Texture] = field(default_factory=list)
    surface_index: dict[Surface, int] = field(default_factory=dict)
    texture_index: dict[tuple[int, bool, int], int] = field(default_factory=dict)
    unread: dict[int, None] = field(default_factory=dict)
    """the model's textures that were named and are not pixels, in that order"""
    not_mirrors: int = 0
    """geoms whose material has reflectance and whose shape does not mirror"""
    textured: bool = True
    """False: materials are without their images"""

    def of_geom(self, geom: int, rgba: Rgba) -> int:
        """Index of the surface of a geom that has this colour."""
        material = int(self.model.geom_matid[geom])
        mirrors = int(self.model.geom_type[geom]) in MIRRORS
        if not mirrors and material >= 0 and self.model.mat_reflectance[material] > 0:
            self.not_mirrors += 1
        return self.of(rgba, material, mirrors=mirrors)

    def of_site(self, site: int, rgba: Rgba) -> int:
        """Index of the surface of a site that has this colour."""
        return self.of(rgba, int(self.model.site_matid[site]))

    def of(self, rgba: Rgba, material: int, textured: bool = True, *, mirrors: bool = False) -> int:
        """Index the surface with this colour and material.

        Args:
            rgba: Its colour.
            material: Id of its material; -1: none.
            textured: Whether the material's images are on it.
            mirrors: Whether its geom can mirror; otherwise its reflectance is 0.
        """
        surface = Surface(rgba=rgba)
        if material >= 0:
            surface = self._with_material(rgba, material)
        if not mirrors:
            surface = replace(surface, reflectance=0.0)
        if not (textured and self.textured):
            surface = replace(
                surface,
                texture=-1,
                metallic_map=-1,
                roughness_map=-1,
                occlusion_map=-1,
                opacity_map=-1,
                normal_map=-1,
                emissive_map=-1,
            )
        if surface not in self.surface_index:
            self.surface_index[surface] = len(self.surfaces)
            self.surfaces.append(surface)
        return self.surface_index[surface]

    def texture(self, index: int, colour: bool = True, component: int = -1) -> int:
        """Index a texture of the model among those in use.

        Args:
            index: Id of the texture; -1: none.
            colour: Whether it is colour, or numbers.
            component: The only component that is wanted; -1: all.

        Returns:
            -1 where it has no pixels.
        """
        if index < 0:
            return -1
        key = (index, colour, component)
        if key not in self.texture_index:
            if is_encoded(self.model, index):
                self.unread[index] = None
            texture = self.parts.get(
                key, *texture_arrays(self.model, index), lambda: self._read(*key)
            )
            self.texture_index[key] = -1 if texture is None else len(self.textures)
            if texture is not None:
                self.textures.append(texture)
        return self.texture_index[key]

    def _read(self, index: int, colour: bool, component: int) -> Texture | None:
        texture = extract_texture(self.model, index, colour)
        return texture if texture is None or component < 0 else _component(texture, component)

    def skybox(self) -> int:
        """Index of the sky's texture, -1 where the model has none."""
        for index in range(self.model.ntex):
            if self.model.tex_type[index] == mujoco.mjtTexture.mjTEXTURE_SKYBOX:
                return self.texture(index)
        return -1

    def unread_lines(self) -> list[str]:
        """One line for each texture in use that could not be read: its name, and the fix."""
        names = (name_of(self.model, mujoco.mjtObj.mjOBJ_TEXTURE, index) for index in self.unread)
        return [
            f"texture '{name}' is left out: it is a KTX file, which is not read; give a PNG file"
            for name in names
        ]

    def _with_material(self, rgba: Rgba, material: int) -> Surface:
        model = self.model
        name = name_of(model, mujoco.mjtObj.mjOBJ_MATERIAL, material)

        def number(attribute: str, low: float, high: float) -> float:
            value = getattr(model, f"mat_{attribute}")[material]
            return clamped(value, low, high, f"{attribute} of material '{name}'")

        def gloss(attribute: str) -> float:
            value = number(attribute, -1.0, 1.0)
            return value if gloss_is_given(attribute, value) else -1.0

        images = [int(model.mat_texid[material, role]) for role in COLOUR_ROLES]
        image = next((index for index in images if index >= 0), -1)
        return Surface(
            rgba=rgba,
            texture=self.texture(image),
            texrepeat=(
                float(model.mat_texrepeat[material, 0]),
                float(model.mat_texrepeat[material, 1]),
            ),
            texuniform=bool(model.mat_texuniform[material]),
            emission=number("emission", 0.0, BRIGHTEST),
            specular=number("specular", 0.0, 1.0),
            shininess=number("shininess", 0.0, 1.0),
            reflectance=number("reflectance", 0.0, 1.0),
            metallic=gloss("metallic"),
            roughness=gloss("roughness"),
            **self._maps(material),
        )

    def _maps(self, material: int) -> dict[str, int]:
        """Every map of a material by its field in Surface."""
        layers = self.model.mat_texid[material]
        maps = {
            "normal_map": self.texture(int(layers[Role.mjTEXROLE_NORMAL]), colour=False),
            "emissive_map": self.texture(int(layers[Role.mjTEXROLE_EMISSIVE])),
        }
        normal = maps["normal_map"]
        if normal >= 0 and self.textures[normal].data.shape[-1] < 3:
            maps["normal_map"] = -1
        for name, roles in MAP_ROLES.items():
            found = (
                self.texture(int(layers[role]), False, component)
                for role, component in roles
                if layers[role] >= 0
            )
            maps[name] = next((index for index in found if index >= 0), -1)
        return maps


def is_encoded(model: mujoco.MjModel, index: int) -> bool:
    """Whether a texture's bytes are a whole file (KTX) and not pixels."""
    first = int(model.tex_adr[index])
    begin = np.asarray(model.tex_data[first : first + len(KTX_MAGIC)], np.uint8)
    return int(model.tex_nchannel[index]) not in (1, 3, 4) or begin.tobytes() == KTX_MAGIC


def texture_arrays(model: mujoco.MjModel, index: int) -> tuple[tuple[int, ...], list[Array]]:
    """What extract_texture makes it of: a few numbers, and the model's own memory."""
    names = ("type", "colorspace", "height", "width", "nchannel", "adr")
    arrays = [getattr(model, f"tex_{name}", None) for name in names]
    numbers = tuple(int(array[index]) for array in arrays if array is not None)
    first, size = (
        int(model.tex_adr[index]),
        int(model.tex_height[index]) * int(model.tex_width[index]),
    )
    end = first + size * int(model.tex_nchannel[index])
    return numbers, [model.tex_data[first:end]]


def extract_texture(model: mujoco.MjModel, index: int, colour: bool = True) -> Texture | None:
    """Extract one texture of the model.

    Args:
        model: The model.
        index: Id of the texture.
        colour: Whether it is coded for displays; otherwise its numbers are linear. `tex_colorspace`
            does not count: it does not separate a PNG without an sRGB chunk, as nearly all are,
            from "linear".

    Returns:
        None where its bytes are not pixels that we can read.
    """
    width, height = int(model.tex_width[index]), int(model.tex_height[index])
    channels, first = int(model.tex_nchannel[index]), int(model.tex_adr[index])
    if is_encoded(model, index):
        return None
    name = name_of(model, mujoco.mjtObj.mjOBJ_TEXTURE, index)
    data = np.array(model.tex_data[first : first + width * height * channels], np.uint8)
    kind = {
        int(mujoco.mjtTexture.mjTEXTURE_2D): TextureKind.FLAT,
        int(mujoco.mjtTexture.mjTEXTURE_CUBE): TextureKind.CUBE,
        int(mujoco.mjtTexture.mjTEXTURE_SKYBOX): TextureKind.SKYBOX,
    }[int(model.tex_type[index])]
    if kind is TextureKind.FLAT:
        return Texture(kind, data.reshape(height, width, channels), colour, name)

    # one face stands for all six, or six lie one below the other
    faces = data.reshape(-1, width, width, channels)
    if len(faces) == 1:
        faces = np.repeat(faces, 6, axis=0)
    return Texture(kind, np.ascontiguousarray(faces), colour, name)


def _component(texture: Texture, component: int) -> Texture | None:
    """One component of a texture; None where it has none such; grey is each colour."""
    count = texture.data.shape[-1]
    if component == 3 and count < 4:
        return None
    only = component if count >= 3 else 0
    return replace(texture, data=np.ascontiguousarray(texture.data[..., only : only + 1]))


BRIGHTEST = 1e9
"""No light, and nothing that glows, is brighter: the sun is 1e5 lux."""


def clamped(value: float, low: float, high: float, what: str) -> float:
    """Clamp a number of the model, as MuJoCo's viewer clamps colours in the end.

    Args:
        value: Any number, as MuJoCo takes it.
        low: The lowest result.
        high: The highest result.
        what: The name of the value and of what has it, for messages.

    Raises:
        EvsError: It is not finite.
    """
    number = float(value)
    if not math.isfinite(number):
        raise EvsError(f"{what} is {number}; give a number in {low:g} ... {high:g}")
    return min(max(number, low), high)


def clamped_colour(values: npt.ArrayLike, high: float, what: str) -> tuple[float, float, float]:
    """Three of them, 0 ... high."""
    red, green, blue = np.asarray(values, np.float64)
    return (
        clamped(red, 0.0, high, what),
        clamped(green, 0.0, high, what),
        clamped(blue, 0.0, high, what),
    )
