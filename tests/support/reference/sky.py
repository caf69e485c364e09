"""Skyboxes for comparisons: pictures made from a function of the direction, and read back."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import numpy.typing as npt

from evs.emulator.base.scene import Texture, TextureKind

F64 = npt.NDArray[np.float64]

# per face (+X -X +Y -Y +Z -Z of OpenGL): the directions of the middle, of u and of v
FACES = np.array(
    [
        [[1, 0, 0], [0, 0, -1], [0, -1, 0]],
        [[-1, 0, 0], [0, 0, 1], [0, -1, 0]],
        [[0, 1, 0], [1, 0, 0], [0, 0, 1]],
        [[0, -1, 0], [1, 0, 0], [0, 0, -1]],
        [[0, 0, 1], [1, 0, 0], [0, -1, 0]],
        [[0, 0, -1], [-1, 0, 0], [0, -1, 0]],
    ],
    np.float64,
)
# OpenGL's y is up: (x, y, z) of the box is (x, z, -y) of the world
WORLD_TO_BOX = np.array([[1, 0, 0], [0, 0, 1], [0, -1, 0]], np.float64)


def skybox(colour: Callable[[F64], F64], width: int) -> Texture:
    """A skybox of colour(world directions (..., 3)) -> (..., 3) linear, 0 ... 1."""
    at = (np.arange(width) + 0.5) / width * 2 - 1
    u, v = np.meshgrid(at, at)
    box = FACES[:, 0, None, None] + sum(
        FACES[:, k, None, None] * w[None, :, :, None] for k, w in ((1, u), (2, v))
    )
    light = colour(box / np.linalg.norm(box, axis=-1, keepdims=True) @ WORLD_TO_BOX)
    return Texture(TextureKind.SKYBOX, np.round(255 * light).astype(np.uint8), srgb=False)


def radiance_of(texture: Texture) -> Callable[[F64], F64]:
    """What the skybox shows in world directions: between texels bilinear, at edges clamped."""
    data = texture.data[..., :3] / 255.0
    width = data.shape[1]

    def radiance(direction: F64) -> F64:
        d = direction @ WORLD_TO_BOX.T
        face = np.argmax(d @ FACES[:, 0].T, axis=-1)
        middle, along_u, along_v = (np.sum(d * FACES[face, k], -1) for k in range(3))
        x = np.clip((along_u / middle + 1) / 2 * width - 0.5, 0, width - 1)
        y = np.clip((along_v / middle + 1) / 2 * width - 0.5, 0, width - 1)
        column = np.minimum(x.astype(int), width - 2)
        row = np.minimum(y.astype(int), width - 2)
        fx, fy = (x - column)[..., None], (y - row)[..., None]
        top = data[face, row, column] * (1 - fx) + data[face, row, column + 1] * fx
        bottom = data[face, row + 1, column] * (1 - fx) + data[face, row + 1, column + 1] * fx
        return np.asarray(top * (1 - fy) + bottom * fy)

    return radiance
