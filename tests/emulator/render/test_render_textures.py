"""Where images lie on shapes: MuJoCo's mapping, written down a second time in NumPy.

Source: MuJoCo's classic renderer, whose unit shapes carry the coordinates (render_context.c) and
whose texture matrix scales them (render_gl3.c).
"""

from __future__ import annotations

import numpy as np
import pytest

from evs.emulator.base.scene import CameraPose, Mesh, Shape, Surface, Texture, TextureKind
from evs.emulator.config import RenderConfig
from evs.emulator.render import NativeRenderer
from reference.scenes import SAMPLED_OUTLINES, camera_of, scene_of, shot_of

pytestmark = pytest.mark.property

SIZE = 72
SIZES = {
    Shape.PLANE: (0.5, 0.35, 0.1),
    Shape.SPHERE: (0.3, 0.0, 0.0),
    Shape.CAPSULE: (0.15, 0.2, 0.0),
    Shape.ELLIPSOID: (0.35, 0.2, 0.25),
    Shape.CYLINDER: (0.25, 0.2, 0.0),
    Shape.BOX: (0.3, 0.2, 0.25),
}


def turn_of(rng: np.random.Generator) -> np.ndarray:
    """(3, 3) a random rotation."""
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    turn[0] *= np.sign(np.linalg.det(turn))
    return turn


class Look:
    """One glowing geom with an image, looked at from somewhere; nothing else shines."""

    def __init__(
        self, rng: np.random.Generator, shape: Shape, surface: Surface, texture: Texture,
        mesh: Mesh | None = None,
    ) -> None:  # fmt: skip
        self.size = np.array(SIZES.get(shape, (1.5, 0.5, 1.0)))
        scene = scene_of(
            [shape],
            self.size,
            static=True,
            lights=(),
            meshes=() if mesh is None else (mesh,),
            surfaces=(surface,),
            textures=(texture,),
        )
        place, self.turn = rng.normal(size=3), turn_of(rng)
        # towards the plane's front side
        back = rng.normal(size=3)
        back /= np.linalg.norm(back)
        back = self.turn @ np.array([*back[:2], abs(back[2]) + 0.2])
        back /= np.linalg.norm(back)
        x = np.cross(rng.normal(size=3), back)
        x /= np.linalg.norm(x)
        axes = np.stack([x, np.cross(back, x), back], 1)
        camera = camera_of(SIZE, SIZE, 1.3 * SIZE)
        pose = CameraPose(place + back, axes.reshape(9))
        shot = shot_of(scene, place, self.turn)
        config = RenderConfig(spp=1)
        renderer = NativeRenderer(scene, camera, config, 1, switches=SAMPLED_OUTLINES)
        self.light = renderer.render(shot, pose).copy()
        index, distance = renderer.hits(shot, pose)
        self.hit = index == 0
        at = (np.arange(SIZE) + 0.5 - SIZE / 2) / (1.3 * SIZE)
        d = np.stack([*np.meshgrid(at, -at), -np.ones((SIZE, SIZE))], -1)
        d /= np.linalg.norm(d, axis=-1, keepdims=True)
        # both in the geom's frame
        self.origin = (pose.pos - place) @ self.turn
        self.direction = d @ axes.T @ self.turn
        self.point = self.origin + self.direction * distance[..., np.newaxis]


def unit_coordinates(shape: Shape, size: np.ndarray, p: np.ndarray) -> np.ndarray:
    """(..., 3) where points of a shape lie on the unit shape that MuJoCo scales to it."""
    if shape is Shape.PLANE:
        return p
    if shape is Shape.SPHERE:
        return p / size[0]
    if shape in (Shape.BOX, Shape.ELLIPSOID):
        return p / size
    q = p / np.array([size[0], size[0], size[1]])
    if shape is Shape.CAPSULE:
        beyond = np.abs(p[..., 2]) - size[1]
        # the caps are half spheres above +1 and below -1
        cap = np.sign(p[..., 2]) * (1 + beyond / size[0])
        q[..., 2] = np.where(beyond > 0, cap, q[..., 2])
    return q


def image_coordinates(shape: Shape, size: np.ndarray, p: np.ndarray) -> np.ndarray:
    """(..., 2) u, v on the image of points p, before the texture is repeated."""
    q = unit_coordinates(shape, size, p)
    x, y, z = np.moveaxis(q, -1, 0)
    around = np.arctan2(y, x) / (2 * np.pi) % 1
    across, down = 0.5 + 0.5 * x, 0.5 - 0.5 * y
    if shape is Shape.PLANE:
        return np.stack([0.5 + x / size[0] / 2, 0.5 - y / size[1] / 2], -1)
    if shape in (Shape.SPHERE, Shape.ELLIPSOID):
        return np.stack([around, 0.5 - np.arcsin(np.clip(z, -1, 1)) / np.pi], -1)
    if shape is Shape.BOX:
        face = np.argmax(np.abs(p) - size, -1)
        return np.stack([np.where(face == 0, 0.5 + 0.5 * y, across),
                         np.where(face == 2, down, 0.5 - 0.5 * z)], -1)  # fmt: skip
    side = 0.5 - 0.5 * z
    if shape is Shape.CYLINDER:
        lid = size[1] - np.abs(p[..., 2]) < size[0] - np.hypot(p[..., 0], p[..., 1])
        return np.stack([np.where(lid, across, around), np.where(lid, 0.5 + 0.5 * y, side)], -1)
    high = np.arcsin(np.clip(np.abs(z) - 1, 0, 1)) / (np.pi / 2)
    cap = np.where(z > 0, 1 - high, high)
    return np.stack([around, np.where(np.abs(z) > 1, cap, side)], -1)


def bilinear(image: np.ndarray, uv: np.ndarray) -> np.ndarray:
    """Look-up between texel centres in an image (h, w) that repeats."""
    height, width = image.shape
    x, y = uv[..., 0] * width - 0.5, uv[..., 1] * height - 0.5
    x0, y0 = np.floor(x).astype(int), np.floor(y).astype(int)
    fx, fy = x - x0, y - y0

    def at(row: np.ndarray, column: np.ndarray) -> np.ndarray:
        return image[row % height, column % width]

    top = at(y0, x0) * (1 - fx) + at(y0, x0 + 1) * fx
    bottom = at(y0 + 1, x0) * (1 - fx) + at(y0 + 1, x0 + 1) * fx
    return top * (1 - fy) + bottom * fy


def glowing(repeat: tuple[float, float], uniform: bool) -> Surface:
    return Surface((1, 1, 1, 1), 0, repeat, uniform, emission=1.0, specular=0.0)


@pytest.mark.parametrize("uniform", [False, True])
@pytest.mark.parametrize("shape", SIZES)
def test_a_flat_image_lies_where_mujoco_puts_it(shape: Shape, uniform: bool) -> None:
    rng = np.random.default_rng(int(shape))
    compared = 0
    for _ in range(12):
        image = rng.integers(0, 256, (3, 4), np.uint8)
        repeat = (1.5, 2.0) if not uniform else (6.0, 5.0)
        texture = Texture(TextureKind.FLAT, image[..., np.newaxis], False)
        look = Look(rng, shape, glowing(repeat, uniform), texture)
        round_ = shape in (Shape.SPHERE, Shape.CAPSULE, Shape.CYLINDER)
        scale = look.size[[0, 0 if round_ else 1]] if uniform else np.ones(2)
        uv = image_coordinates(shape, look.size, look.point) * repeat * scale
        # where the image is magnified: no more than half a texel a pixel
        change = np.max(np.abs(np.gradient(uv, axis=(0, 1))), axis=(0, 3)) * 4
        near = look.hit & (change < 0.25)
        expected = bilinear(image / 255.0, uv)
        wrong = near & (np.abs(look.light - expected) > 3e-3)
        compared += int(near.sum())
        assert wrong.sum() <= 0.002 * near.sum(), (int(wrong.sum()), int(near.sum()))
    assert compared > 5000


@pytest.mark.parametrize("uniform", [False, True])
@pytest.mark.parametrize("shape", SIZES)
def test_a_cube_lies_where_mujoco_puts_it(shape: Shape, uniform: bool) -> None:
    rng = np.random.default_rng(int(shape))
    shades = np.arange(1, 7) * 40
    data = np.broadcast_to(shades[:, None, None, None], (6, 1, 1, 1)).astype(np.uint8)
    for _ in range(12):
        look = Look(
            rng, shape, glowing((1, 1), uniform), Texture(TextureKind.CUBE, data.copy(), False)
        )
        q = unit_coordinates(shape, look.size, look.point)
        if uniform:
            third = {Shape.SPHERE: 0, Shape.CAPSULE: 1, Shape.CYLINDER: 1}.get(shape, 2)
            second = 1 if shape in (Shape.BOX, Shape.ELLIPSOID, Shape.PLANE) else 0
            q = q * look.size[[0, second, third]]
        axis = np.argmax(np.abs(q), -1)
        negative = np.take_along_axis(q, axis[..., np.newaxis], -1)[..., 0] < 0
        expected = shades[2 * axis + negative] / 255.0
        # a pixel that covers more than one face, or ends, is a mean: the same all around
        face = np.pad(np.where(look.hit, expected, -1), 1, constant_values=-1)
        around = [face[y : y + SIZE, x : x + SIZE] for y in range(3) for x in range(3)]
        clear = look.hit & np.all(np.array(around) == expected, axis=0)
        assert clear.sum() > 300
        np.testing.assert_allclose(look.light[clear], expected[clear], rtol=1e-5)


def first_crossed(
    mesh: Mesh, origin: np.ndarray, direction: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Brute force in double: nearest front face of each ray (n, 3), -1 none; its distance and
    barycentric coordinates (n, 3); and how far from the rim the nearest rim is (n,)."""
    corners = mesh.vertices.astype(np.float64)[mesh.faces]
    nearest = np.full(len(direction), np.inf)
    index, weights = np.full(len(direction), -1), np.zeros((len(direction), 3))
    rim = np.full(len(direction), np.inf)
    for face, (a, b, c) in enumerate(corners):
        normal = np.cross(b - a, c - a)
        along = direction @ normal
        with np.errstate(divide="ignore", invalid="ignore"):
            distance = (a - origin) @ normal / along
            inside = origin + direction * distance[:, np.newaxis] - a
            area = normal @ normal
            wb = np.cross(inside, c - a) @ normal / area
            wc = np.cross(b - a, inside) @ normal / area
        w = np.stack([1 - wb - wc, wb, wc], 1)
        least = np.min(w, 1)
        rim = np.fmin(rim, np.where(distance > 0, np.abs(least), np.inf))
        hit = (along < 0) & (distance > 0) & (least >= 0) & (distance < nearest)
        nearest = np.where(hit, distance, nearest)
        index = np.where(hit, face, index)
        weights[hit] = w[hit]
    return index, nearest, weights, rim


@pytest.mark.slow
@pytest.mark.parametrize("faces", [1, 3, 30, 300])
@pytest.mark.parametrize("uniform", [False, True])
def test_a_mesh_is_hit_and_textured_as_brute_force_says(faces: int, uniform: bool) -> None:
    rng = np.random.default_rng(faces)
    for _ in range(4):
        # no two faces on the same three corners
        vertices = (rng.normal(size=(faces + 4, 3)) * 0.3).astype(np.float32)
        chosen = np.array([rng.permutation(len(vertices))[:3] for _ in range(faces)], np.int32)
        assert len(np.unique(np.sort(chosen, 1), axis=0)) == faces
        texcoords = rng.uniform(-0.5, 0.5, (faces, 3, 2)).astype(np.float32)
        mesh = Mesh(vertices, chosen, None, texcoords)
        image = rng.integers(0, 256, (2, 2), np.uint8)
        repeat = (0.4, 0.7)
        look = Look(
            rng,
            Shape.MESH,
            glowing(repeat, uniform),
            Texture(TextureKind.FLAT, image[..., np.newaxis], False),
            mesh,
        )
        direction = look.direction.reshape(-1, 3)
        index, distance, weights, rim = first_crossed(mesh, look.origin, direction)
        clear = rim > 1e-3
        assert clear.mean() > 0.4
        np.testing.assert_array_equal(look.hit.reshape(-1)[clear], (index >= 0)[clear])
        seen = clear & (index >= 0)
        found = np.linalg.norm(look.point.reshape(-1, 3) - look.origin, axis=1)
        np.testing.assert_allclose(found[seen], distance[seen], rtol=1e-4)
        uv = np.einsum("nc,ncx->nx", weights, texcoords[index]) * repeat
        if uniform:
            uv *= look.size[:2]
        # magnified only: neighbours on the same triangle differ by less than half a texel
        grid = uv.reshape(SIZE, SIZE, 2)
        change = np.max(np.abs(np.gradient(grid, axis=(0, 1))), axis=(0, 3)).reshape(-1) * 2
        seen &= change < 0.1
        expected = bilinear(image / 255.0, uv)
        light = look.light.reshape(-1)
        wrong = np.abs(light[seen] - expected[seen]) > 3e-3
        assert wrong.sum() <= 0.002 * seen.sum(), (int(wrong.sum()), int(seen.sum()))
