"""Materials and textures of a model, as its geoms use them."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import mujoco
import numpy as np
import numpy.typing as npt

from evs.emulator.scene import Surface, Texture, TextureKind

Rgba = tuple[float, float, float, float]

VISIBLE_GROUPS = 3
"""Groups 0, 1 and 2 of geoms, skins and flexes are shown, as in MuJoCo's viewer at the start."""

ROLES = (mujoco.mjtTextureRole.mjTEXROLE_RGB, mujoco.mjtTextureRole.mjTEXROLE_RGBA)
"""The roles that give a material its colour, the first that is filled counts."""

UNSET = (0.5, 0.5, 0.5, 1.0)
"""A geom's rgba that means: take the material's."""

KTX_MAGIC = bytes([0xAB, 0x4B, 0x54, 0x58])
"""Compressed textures are stored as whole files that begin like this; they are not pixels."""


def is_shown(group: int, rgba: Rgba) -> bool:
    """Whether MuJoCo shows by default what is in this group and has this colour."""
    return max(0, group) < VISIBLE_GROUPS and rgba[3] > 0.0


def geom_rgba(model: mujoco.MjModel, geom: int) -> Rgba:
    """The colour that MuJoCo shows of a geom."""
    return shown_rgba(model, model.geom_rgba[geom], int(model.geom_matid[geom]))


def shown_rgba(model: mujoco.MjModel, rgba: npt.ArrayLike, material: int) -> Rgba:
    """The colour MuJoCo shows: an object's own unless that is unset and it has a material."""
    own = tuple(float(value) for value in np.asarray(rgba))
    if own == UNSET and material >= 0:
        own = tuple(float(value) for value in model.mat_rgba[material])
    return own[0], own[1], own[2], own[3]


@dataclass
class Surfaces:
    """Collects the surfaces and textures in use, each once."""

    model: mujoco.MjModel
    surfaces: list[Surface] = field(default_factory=list)
    textures: list[Texture] = field(default_factory=list)
    surface_index: dict[Surface, int] = field(default_factory=dict)
    texture_index: dict[int, int] = field(default_factory=dict)

    def of_geom(self, geom: int) -> int:
        """Index of the geom's surface."""
        return self.of(geom_rgba(self.model, geom), int(self.model.geom_matid[geom]))

    def of(self, rgba: Rgba, material: int, textured: bool = True) -> int:
        """Index of the surface with this colour and material (-1 none), with its image or not."""
        surface = Surface(rgba=rgba)
        if material >= 0:
            surface = self._with_material(rgba, material)
        if not textured:
            surface = replace(surface, texture=-1)
        if surface not in self.surface_index:
            self.surface_index[surface] = len(self.surfaces)
            self.surfaces.append(surface)
        return self.surface_index[surface]

    def texture(self, index: int) -> int:
        """Index, among those in use, of the model's texture `index`; -1 where it has no pixels."""
        if index not in self.texture_index:
            texture = extract_texture(self.model, index)
            self.texture_index[index] = -1 if texture is None else len(self.textures)
            if texture is not None:
                self.textures.append(texture)
        return self.texture_index[index]

    def skybox(self) -> int:
        """Index of the sky's texture, -1 where the model has none."""
        for index in range(self.model.ntex):
            if self.model.tex_type[index] == mujoco.mjtTexture.mjTEXTURE_SKYBOX:
                return self.texture(index)
        return -1

    def _with_material(self, rgba: Rgba, material: int) -> Surface:
        model = self.model
        images = [int(model.mat_texid[material, role]) for role in ROLES]
        image = next((index for index in images if index >= 0), -1)
        return Surface(
            rgba=rgba,
            texture=self.texture(image) if image >= 0 else -1,
            texrepeat=(
                float(model.mat_texrepeat[material, 0]),
                float(model.mat_texrepeat[material, 1]),
            ),
            texuniform=bool(model.mat_texuniform[material]),
            emission=float(model.mat_emission[material]),
            specular=float(model.mat_specular[material]),
            shininess=float(model.mat_shininess[material]),
            reflectance=float(model.mat_reflectance[material]),
        )


def extract_texture(model: mujoco.MjModel, index: int) -> Texture | None:
    """One texture of the model; None where its bytes are not pixels that we can read."""
    width, height = int(model.tex_width[index]), int(model.tex_height[index])
    channels, first = int(model.tex_nchannel[index]), int(model.tex_adr[index])
    data = np.array(model.tex_data[first : first + width * height * channels], np.uint8)
    if channels not in (1, 3, 4) or data[:4].tobytes() == KTX_MAGIC:
        return None

    # no colour space given: it is a colour, so it is coded for displays
    linear = model.tex_colorspace[index] == mujoco.mjtColorSpace.mjCOLORSPACE_LINEAR
    kind = {
        int(mujoco.mjtTexture.mjTEXTURE_2D): TextureKind.FLAT,
        int(mujoco.mjtTexture.mjTEXTURE_CUBE): TextureKind.CUBE,
        int(mujoco.mjtTexture.mjTEXTURE_SKYBOX): TextureKind.SKYBOX,
    }[int(model.tex_type[index])]
    if kind is TextureKind.FLAT:
        return Texture(kind, data.reshape(height, width, channels), not linear)

    # one face stands for all six, or six lie one below the other
    faces = data.reshape(-1, width, width, channels)
    if len(faces) == 1:
        faces = np.repeat(faces, 6, axis=0)
    return Texture(kind, np.ascontiguousarray(faces), not linear)
