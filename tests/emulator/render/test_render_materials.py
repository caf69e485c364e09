"""Physical materials and maps in closed form: the GGX lobe, and what each map changes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from evs.emulator import _core
from evs.emulator.base.scene import (
    CameraPose,
    Light,
    LightKind,
    Mesh,
    Shape,
    Surface,
    Texture,
    TextureKind,
)
from evs.emulator.config import RenderConfig
from evs.emulator.render import NativeRenderer
from reference.closed_forms import linear
from reference.scenes import camera_of, scene_of, shot_of

SIZE = 24
WEIGHTS = np.array([0.2126, 0.7152, 0.0722])
LAMP = Light(
    LightKind.DIRECTIONAL, (0.0,) * 3, (0.8,) * 3, (0.0,) * 3, castshadow=False, name="lamp"
)
AROUND = replace(LAMP, ambient=(0.6,) * 3, diffuse=(0.0,) * 3)
COLOUR = (0.8, 0.4, 0.2)


def flat(*components: int, srgb: bool = False) -> Texture:
    """An image of one colour."""
    return Texture(TextureKind.FLAT, np.full((3, 5, len(components)), components, np.uint8), srgb)


def unit(vector: object) -> np.ndarray:
    v = np.asarray(vector, np.float64)
    return v / np.linalg.norm(v, axis=-1, keepdims=True)


class Look:
    """One surface on one geom around the origin, seen along `towards` by a long lens."""

    def __init__(
        self,
        surface: Surface,
        *,
        textures: tuple[Texture, ...] = (),
        lights: tuple[Light, ...] = (LAMP,),
        light_dir: object = (0.3, -0.2, -1.0),
        back: object = (0.2, 0.4, 1.0),
        shape: Shape = Shape.PLANE,
        size: tuple[float, float, float] = (50.0, 50.0, 0.1),
        mesh: Mesh | None = None,
        focal_px: float = 1e6,
        **render: object,
    ) -> None:
        scene = scene_of(
            [shape],
            size,
            static=True,
            meshes=() if mesh is None else (mesh,),
            surfaces=(surface,),
            textures=textures,
            lights=lights,
        )
        self.view, self.towards_light = unit(back), -unit(light_dir)
        x = unit(np.cross([0.3, 1.0, 0.2], self.view))
        axes = np.stack([x, np.cross(self.view, x), self.view], 1)
        self.pose = CameraPose(5.0 * self.view, axes.reshape(9))
        # with a long lens every ray runs along the view
        camera = camera_of(SIZE, SIZE, focal_px)
        lamps = np.zeros((len(lights), 3))
        self.shot = shot_of(scene, [0, 0, 0], None, lamps, -self.towards_light)
        config = RenderConfig(**{"spp": 1, **render})  # type: ignore[arg-type]
        renderer = NativeRenderer(scene, camera, config, 1, rgb=True)
        self.luminance = renderer.render(self.shot, self.pose).copy()
        assert renderer.rgb is not None
        self.rgb = renderer.rgb[SIZE // 2, SIZE // 2].astype(np.float64)


def ggx(normal: object, view: object, light: object, alpha: float) -> float:
    """pi times the BRDF for a reflectance of 1, times the light's cosine.

    D and the separable G as Walter et al. 2007, equations 33, 23 and 34.
    """
    n, v, l = unit(normal), unit(view), unit(light)  # noqa: E741
    h = unit(v + l)

    def smith(cosine: float) -> float:
        tangent = (1 - cosine**2) / cosine**2
        return (np.sqrt(1 + alpha**2 * tangent) - 1) / 2

    d = alpha**2 / (np.pi * ((n @ h) ** 2 * (alpha**2 - 1) + 1) ** 2)
    masking = 1 / (1 + smith(float(n @ v))) / (1 + smith(float(n @ l)))
    return float(np.pi * d * masking / (4 * (n @ v)))


@pytest.mark.parametrize("metallic", [0.0, 0.3, 1.0])
@pytest.mark.parametrize("roughness", [0.1, 0.35, 1.0])
@pytest.mark.parametrize("light", [(0.3, -0.2, -1.0), (-0.2, -0.4, -1.0), (2.0, 0.5, -0.4)])
def test_a_physical_material_is_lambert_and_ggx(
    metallic: float, roughness: float, light: tuple[float, float, float]
) -> None:
    surface = Surface(rgba=(*COLOUR, 1.0), metallic=metallic, roughness=roughness)
    look = Look(surface, light_dir=light)
    albedo, cosine = linear(COLOUR), look.towards_light[2]
    reflected = 0.04 + (albedo - 0.04) * metallic
    lobe = ggx((0, 0, 1), look.view, look.towards_light, roughness**2)
    expected = 0.8 * ((1 - metallic) * albedo * cosine + reflected * lobe)
    np.testing.assert_allclose(look.rgb, expected, rtol=2e-5)


def test_the_roughest_metal_gives_back_1_minus_ln_2_of_an_even_sky() -> None:
    # seen from above: the sum over all directions, whose azimuth does not matter
    metal = Surface(rgba=(1.0,) * 4, metallic=1.0, roughness=1.0)
    nodes, weights = np.polynomial.legendre.leggauss(20)
    cosines = 0.5 + 0.5 * nodes
    lobes = [
        Look(metal, back=(0, 0, 1), light_dir=(-np.sqrt(1 - c * c), 0, -c)).rgb[0] / 0.8
        for c in cosines
    ]
    # each direction stands for 2 pi d(cos), and a light's 1 is pi of irradiance
    np.testing.assert_allclose(np.dot(weights, lobes), 1 - np.log(2), rtol=1e-5)


def test_one_number_makes_a_material_physical_and_the_other_has_its_neutral_value() -> None:
    white = (1.0, 1.0, 1.0, 1.0)
    for given, whole in (
        (Surface(rgba=white, metallic=0.5), Surface(rgba=white, metallic=0.5, roughness=1.0)),
        (Surface(rgba=white, roughness=0.4), Surface(rgba=white, metallic=0.0, roughness=0.4)),
    ):
        np.testing.assert_array_equal(Look(given).luminance, Look(whole).luminance)
    classic = Look(Surface(rgba=white, specular=0.0))
    assert (Look(Surface(rgba=white, roughness=0.4)).luminance > classic.luminance).all()


@pytest.mark.parametrize(
    ("maps", "numbers"),
    [
        ({"roughness_map": 0, "roughness": 0.8}, {"roughness": 0.8 * 102 / 255}),
        ({"roughness_map": 0}, {"roughness": 102 / 255}),
        ({"metallic_map": 0, "metallic": 0.5, "roughness": 0.5},
         {"metallic": 0.5 * 102 / 255, "roughness": 0.5}),
        ({"metallic_map": 0, "roughness": 0.5}, {"metallic": 102 / 255, "roughness": 0.5}),
    ],
)  # fmt: skip
def test_a_map_multiplies_the_number_of_its_name(
    maps: dict[str, float], numbers: dict[str, float]
) -> None:
    base = Surface(rgba=(*COLOUR, 1.0))
    mapped = Look(replace(base, **maps), textures=(flat(102),))  # type: ignore[arg-type]
    plain = Look(replace(base, **numbers))  # type: ignore[arg-type]
    np.testing.assert_allclose(mapped.rgb, plain.rgb, rtol=1e-5)


def test_occlusion_takes_from_the_ambient_light_alone() -> None:
    surface = Surface(rgba=(*COLOUR, 1.0), occlusion_map=0, specular=0.0)
    textures = (flat(51),)
    open_one = replace(surface, occlusion_map=-1)
    around, bare = Look(surface, textures=textures, lights=(AROUND,)), linear(COLOUR) * 0.6
    np.testing.assert_allclose(around.rgb, bare * 0.2, rtol=1e-5)
    np.testing.assert_array_equal(
        Look(surface, textures=textures).luminance, Look(open_one).luminance
    )


def test_a_metal_reflects_ambient_light_in_its_colour() -> None:
    for metallic in (0.0, 1.0):
        look = Look(Surface(rgba=(*COLOUR, 1.0), metallic=metallic), lights=(AROUND,))
        albedo = linear(COLOUR)
        expected = 0.6 * (albedo if metallic else albedo + 0.04)
        np.testing.assert_allclose(look.rgb, expected, rtol=1e-5)


def test_emissive_map_glows_by_itself() -> None:
    glow = flat(200, 100, 50, srgb=True)
    for emission, factor in ((0.0, 1.0), (3.0, 3.0)):
        surface = Surface(rgba=(*COLOUR, 1.0), emissive_map=0, emission=emission)
        look = Look(surface, textures=(glow,), lights=())
        expected = factor * linear(np.array([200, 100, 50]) / 255)
        np.testing.assert_allclose(look.rgb, expected, rtol=1e-5)


def test_opacity_map_multiplies_alpha() -> None:
    glowing = Surface(rgba=(1.0, 1.0, 1.0, 0.5), emission=1.0, opacity_map=0)
    look = Look(glowing, textures=(flat(51),), lights=())
    np.testing.assert_allclose(look.rgb, 0.5 * 0.2, rtol=1e-5)


def bent(right: float, top: float) -> tuple[Texture, np.ndarray]:
    """A map that bends every normal alike, and (right, top, out) of that normal."""
    coded = np.round((unit([right, top, 1.0]) + 1) / 2 * 255).astype(np.uint8)
    return flat(*(int(c) for c in coded)), unit(coded / 255 * 2 - 1)


# shape, back: where the camera sees the surface's middle from; right and top of an image there
FRAMES = [
    (Shape.PLANE, (0.1, 0.2, 1), (1, 0, 0), (0, 1, 0)),
    (Shape.BOX, (1, 0, 0), (0, 1, 0), (0, 0, 1)),
    (Shape.BOX, (-1, 0, 0), (0, 1, 0), (0, 0, 1)),
    (Shape.BOX, (0, -1, 0), (1, 0, 0), (0, 0, 1)),
    (Shape.BOX, (0, 0, 1), (1, 0, 0), (0, 1, 0)),
    (Shape.SPHERE, (1, 0, 0), (0, 1, 0), (0, 0, 1)),
    (Shape.SPHERE, (0, -1, 0), (1, 0, 0), (0, 0, 1)),
    (Shape.ELLIPSOID, (0, 1, 0), (-1, 0, 0), (0, 0, 1)),
    (Shape.CAPSULE, (1, 0, 0), (0, 1, 0), (0, 0, 1)),
    (Shape.CYLINDER, (1, 0, 0), (0, 1, 0), (0, 0, 1)),
    (Shape.CYLINDER, (0, 0, 1), (1, 0, 0), (0, -1, 0)),
]


@pytest.mark.parametrize(("shape", "back", "right", "top"), FRAMES)
def test_a_normal_map_bends_to_the_images_right_and_top(
    shape: Shape, back: object, right: object, top: object
) -> None:
    image, (a, b, c) = bent(0.5, -0.3)
    out = np.array([0, 0, 1.0]) if shape is Shape.PLANE else np.asarray(back, np.float64)
    normal = a * np.array(right) + b * np.array(top) + c * out
    size = (50.0, 50.0, 0.1) if shape is Shape.PLANE else (0.3, 0.25, 0.2)
    towards = out + 0.3 * np.array(right) + 0.2 * np.array(top)
    surface = Surface(rgba=(1.0,) * 4, specular=0.0, normal_map=0)
    look = Look(surface, textures=(image,), shape=shape, size=size, back=back, light_dir=-towards)
    np.testing.assert_allclose(look.rgb, 0.8 * normal @ unit(towards), rtol=2e-4)


@pytest.mark.parametrize("turn", [0, 1, 2, 3])
@pytest.mark.parametrize("mirrored", [False, True])
def test_a_normal_map_on_a_mesh_follows_its_coordinates(turn: int, mirrored: bool) -> None:
    # a square whose image is turned by right angles, or seen from behind
    corners = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], np.float32)
    uv = np.array([[0, 1], [1, 1], [1, 0], [0, 0]], np.float32)  # v grows downwards
    if mirrored:
        uv[:, 0] = 1 - uv[:, 0]
    uv = np.roll(uv, turn, axis=0)
    faces = np.array([[0, 1, 2], [0, 2, 3]], np.int32)
    mesh = Mesh(corners, faces, None, uv[faces])
    right = np.array([-1.0 if mirrored else 1.0, 0, 0])
    top = np.array([0, 1.0, 0])
    spin = np.array([[0, -1, 0], [1, 0, 0], [0, 0, 1]])
    for _ in range(turn):
        right, top = spin @ right, spin @ top
    image, (a, b, c) = bent(0.5, -0.3)
    surface = Surface(rgba=(1.0,) * 4, specular=0.0, normal_map=0)
    towards = np.array([0.2, 0.3, 1.0])
    look = Look(surface, textures=(image,), shape=Shape.MESH, mesh=mesh, light_dir=-towards)
    normal = a * right + b * top + c * np.array([0, 0, 1])
    np.testing.assert_allclose(look.rgb, 0.8 * normal @ unit(towards), rtol=2e-4)


def test_a_bent_normal_sees_no_light_from_behind_the_surface() -> None:
    image, _ = bent(3.0, 0.0)
    surface = Surface(rgba=(1.0,) * 4, normal_map=0, roughness=0.5)
    below = Look(surface, textures=(image,), light_dir=(-1.0, 0.0, 0.2))
    assert (below.luminance == 0).all()
    above = Look(surface, textures=(image,), light_dir=(-1.0, 0.0, -0.2))
    assert (above.luminance > 0.5).all()


@pytest.mark.parametrize("physical", [True, False])
def test_bumps_too_far_to_see_widen_the_gloss(physical: bool) -> None:
    # two normals in turn, so fine that a sample covers many: what is left is their mean
    tilted = np.array([bent(0.3, 0.0)[0].data[0, 0], bent(-0.3, 0.0)[0].data[0, 0]])
    image = Texture(TextureKind.FLAT, tilted[[[0, 1], [1, 0]]], False)
    normals = unit(tilted / 255 * 2 - 1)
    length = np.linalg.norm(normals.mean(0))
    mean, apart = unit(normals.mean(0)), (1 - length) / length
    surface = Surface(
        rgba=(*COLOUR, 1.0), specular=1.0, shininess=0.5, normal_map=0, texrepeat=(1e9, 1e9),
        roughness=0.4 if physical else -1.0,
    )  # fmt: skip
    lamp = replace(LAMP, specular=(0.6,) * 3)
    look = Look(surface, textures=(image,), lights=(lamp,), light_dir=(0.1, -0.5, -1.0))
    matt = linear(COLOUR) * 0.8 * (mean @ look.towards_light)
    if physical:
        wide = np.sqrt(0.4**4 + 2 * apart)
        gloss = 0.8 * 0.04 * ggx(mean, look.view, look.towards_light, wide)
    else:
        # Toksvig 2005, equations 6 and 7
        factor = length / (length + 64 * (1 - length))
        lobe = (mean @ unit(look.view + look.towards_light)) ** (64 * factor)
        gloss = 0.6 * (1 + 64 * factor) / (1 + 64) * lobe
    np.testing.assert_allclose(look.rgb, matt + gloss, rtol=2e-4)


def test_a_normal_map_on_a_cube_is_not_applied() -> None:
    image, _ = bent(0.5, -0.3)
    cube = Texture(TextureKind.CUBE, np.repeat(image.data[np.newaxis, :3, :3], 6, axis=0), False)
    surface = Surface(rgba=(1.0,) * 4, specular=0.0, normal_map=0)
    plain = replace(surface, normal_map=-1)
    np.testing.assert_array_equal(
        Look(surface, textures=(cube,)).luminance, Look(plain, textures=(cube,)).luminance
    )


def test_white_maps_change_no_byte_of_a_classic_material() -> None:
    base = Surface(rgba=(*COLOUR, 1.0), specular=0.7, shininess=0.3, emission=0.1)
    mapped = replace(base, occlusion_map=0, opacity_map=0)
    lights = (LAMP, replace(LAMP, ambient=(0.3, 0.1, 0.2), specular=(0.5,) * 3))
    a, b = (Look(s, textures=(flat(255),), lights=lights) for s in (base, mapped))
    np.testing.assert_array_equal(a.luminance, b.luminance)


@pytest.mark.parametrize("isa", _core.isa_available())
def test_every_map_at_once_is_the_same_on_every_instruction_set(isa: str) -> None:
    rng = np.random.default_rng(8)

    def noise(components: int, srgb: bool = False) -> Texture:
        return Texture(TextureKind.FLAT, rng.integers(0, 256, (9, 7, components), np.uint8), srgb)

    textures = (noise(3, True), noise(1), noise(1), noise(1), noise(1), noise(3), noise(3, True))
    surface = Surface(
        rgba=(*COLOUR, 0.9), texture=0, texrepeat=(3.0, 4.0), metallic=0.8, roughness=0.7,
        metallic_map=1, roughness_map=2, occlusion_map=3, opacity_map=4, normal_map=5,
        emissive_map=6, reflectance=0.4,
    )  # fmt: skip
    lights = (replace(LAMP, ambient=(0.1, 0.2, 0.3)), replace(LAMP, diffuse=(0.3, 0.2, 0.1)))
    seen = [
        Look(
            surface,
            textures=textures,
            lights=lights,
            shape=Shape.SPHERE,
            size=(0.3,) * 3,
            focal_px=150.0,
            isa=i,
        )
        for i in ("portable", isa)
    ]
    assert seen[0].luminance.tobytes() == seen[1].luminance.tobytes()
    assert np.isfinite(seen[0].luminance).all()
    assert len(np.unique(seen[0].luminance)) > 100
