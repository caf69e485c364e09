"""Random scenes of everything that a world can hold, and a check that all renderers agree."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from evs.emulator import _core
from evs.emulator.base.protocols import Renderer
from evs.emulator.base.scene import (
    Atmosphere,
    CameraPose,
    Light,
    LightKind,
    Mesh,
    SceneSnapshot,
    Shape,
    Surface,
    Texture,
    TextureKind,
)
from evs.emulator.config import FlickerConfig, RenderConfig
from evs.emulator.render import NativeRenderer, make_renderer
from reference.scenes import camera_of, scene_of, shot_of

Random = np.random.Generator

PULSE = FlickerConfig(waveform="pwm", hz=166.0, depth=0.5, duty=0.3)


def random_turn(rng: Random) -> np.ndarray:
    """A rotation (9,), row-major; one in four is along the axes."""
    if rng.random() < 0.25:
        turn = np.eye(3)[rng.permutation(3)] * rng.choice([-1.0, 1.0], 3)[:, np.newaxis]
    else:
        turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    turn[0] *= np.sign(np.linalg.det(turn))
    return turn.reshape(9)


def random_mesh(rng: Random, flat: bool) -> Mesh:
    """A soup of triangles, some of them degenerate, with or without normals and coordinates.

    Args:
        rng: The source of randomness.
        flat: Whether the mesh may be flat. In that case triangles overlap in one plane, and which
            of them is seen is undefined.
    """
    count, corners = int(rng.integers(1, 60)), int(rng.integers(3, 40))
    vertices = rng.normal(size=(corners, 3)) * 10.0 ** rng.uniform(-2, 0)
    if rng.random() < 0.3 and flat:
        vertices[:, rng.integers(3)] = 0.0
    faces = rng.integers(0, corners, (count, 3))
    if not flat:
        faces = faces[np.unique(np.sort(faces, 1), axis=0, return_index=True)[1]]
        count = len(faces)
    normals = rng.normal(size=(count, 3, 3))
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    return Mesh(
        vertices.astype(np.float32),
        faces.astype(np.int32),
        normals.astype(np.float32) if rng.random() < 0.5 else None,
        rng.uniform(-3, 3, (count, 3, 2)).astype(np.float32) if rng.random() < 0.5 else None,
    )


def random_texture(rng: Random, kind: TextureKind) -> Texture:
    """Noise of any size and number of channels."""
    height, width = (int(n) for n in rng.integers(1, 20, 2))
    shape = (height, width) if kind is TextureKind.FLAT else (6, width, width)
    data = rng.integers(0, 256, (*shape, int(rng.choice([1, 3, 4]))), np.uint8)
    return Texture(kind, data, bool(rng.integers(2)))


def random_light(rng: Random, coloured: bool) -> Light:
    """A light of any kind, with or without shadow, attenuation or physical intensity."""

    def colour(most: float) -> tuple[float, float, float]:
        grey = float(rng.uniform(0, most))
        red, green, blue = rng.uniform(0, most, 3) if coloured else (grey, grey, grey)
        return float(red), float(green), float(blue)

    kind = LightKind(int(rng.integers(3)))
    return Light(
        kind,
        colour(0.2),
        colour(0.8),
        colour(0.5),
        castshadow=bool(rng.random() < 0.75),
        attenuation=tuple(float(a) for a in rng.uniform(0, 1, 3)),  # type: ignore[arg-type]
        cutoff_deg=float(rng.choice([10, 45, 90, 120, 180])),
        exponent=float(rng.choice([0, 1, 10, 100])),
        intensity=float(rng.choice([0, 0, 3000])),
        headlight=bool(kind is LightKind.DIRECTIONAL and rng.random() < 0.5),
    )


def random_maps(rng: Random, surface: Surface) -> Surface:
    """The surface with a random choice of a physical material and of maps of each kind.

    The random textures 6, 7 and 8 have one, three and three components; 3 and 4 are cubes.
    """

    def one_of(*indices: int) -> int:
        return int(rng.choice([-1, *indices]))

    return replace(
        surface,
        metallic=float(rng.choice([-1, 0, 0.5, 1])),
        roughness=float(rng.choice([-1, 0, 0.4, 1])),
        metallic_map=one_of(6),
        roughness_map=one_of(6),
        occlusion_map=one_of(6),
        opacity_map=one_of(6, -1, -1),
        normal_map=one_of(7, 8),
        emissive_map=one_of(0, 3, -1),
    )


def random_surface(rng: Random, textures: int) -> Surface:
    """A material; one in three is a mirror, and one in five is transparent."""
    surface = Surface(
        rgba=(*(float(c) for c in rng.uniform(0, 1, 3)), 1.0),  # type: ignore[arg-type]
        texture=int(rng.integers(-1, textures)),
        texrepeat=tuple(float(r) for r in rng.uniform(0, 5, 2)),  # type: ignore[arg-type]
        texuniform=bool(rng.integers(2)),
        emission=float(rng.choice([0, 0, 0.5])),
        specular=float(rng.uniform(0, 1)),
        shininess=float(rng.uniform(0, 1)),
        reflectance=float(rng.choice([0, 0, 0.6])),
    )
    alpha = 0.4 if surface.shininess < 0.2 else 1.0
    return replace(surface, rgba=(*surface.rgba[:3], alpha))


def random_size(rng: Random, shape: Shape, decades: float) -> np.ndarray:
    """Sizes (3,), m, over `decades` powers of ten around 0.3 m; a plane may be infinite."""
    size = 0.3 * 10.0 ** rng.uniform(-decades, decades / 3, 3)
    if shape is Shape.PLANE:
        size = np.where(rng.random(3) < 0.4, 0.0, size * 5)
    return size


class RandomStage:
    """A random scene of at most 24 geoms or of many, its camera, and its film, all from one seed.

    Args:
        seed: The seed of all random choices.
        decades: How many powers of ten the sizes spread over.
        zoom: The factor by which the camera is further away, and its focal length longer.
        flat: Whether a mesh may be flat.
        rich: Whether there are physical materials, maps, an image light, fog or haze, and light
            that pulses.
        size: Width and height of the picture, px.
        many: How many geoms there are, smaller ones: some are where another is, of the same size,
            and only two may be planes.
        lights: How many lights there are.
        bulbs: Whether lamps have any size.
    """

    def __init__(
        self,
        seed: int,
        *,
        decades: float = 1.0,
        zoom: float = 1.0,
        flat: bool = True,
        rich: bool = False,
        size: tuple[int, int] = (41, 30),
        many: int | None = None,
        lights: int | None = None,
        bulbs: bool = False,
    ) -> None:
        self.rng = rng = np.random.default_rng(seed)
        count, coloured = int(rng.integers(0, 25)), bool(rng.integers(2))
        count = many or count
        shapes = [Shape(int(s)) for s in rng.integers(0, len(Shape), count)]
        meshes = tuple(random_mesh(rng, flat) for _ in range(3))
        textures = (
            *(random_texture(rng, TextureKind.FLAT) for _ in range(3)),
            *(random_texture(rng, TextureKind.CUBE) for _ in range(2)),
            random_texture(rng, TextureKind.SKYBOX),
        )
        surfaces = tuple(random_surface(rng, 5) for _ in range(6))
        light_count = int(rng.integers(0, 6)) if lights is None else lights
        shining = tuple(random_light(rng, coloured) for _ in range(light_count))
        # from a generator of its own, so that the rest of the scene is the same with or without
        more, air = np.random.default_rng([seed, 1]), None
        if bulbs:
            sizes = 0.5 * np.random.default_rng([seed, 2]).random(light_count)
            shining = tuple(
                replace(light, bulbradius_m=float(size))
                for light, size in zip(shining, sizes, strict=True)
            )
        if rich:
            textures = (
                *textures,
                Texture(TextureKind.FLAT, more.integers(0, 256, (7, 5, 1), np.uint8), False),
                Texture(TextureKind.FLAT, more.integers(0, 256, (4, 6, 3), np.uint8), False),
                Texture(TextureKind.CUBE, more.integers(0, 256, (6, 4, 4, 3), np.uint8), False),
            )
            surfaces = tuple(random_maps(more, surface) for surface in surfaces)
            shining = tuple(
                replace(light, range_m=float(more.choice([0, 2])), softness=float(more.random()))
                for light in shining
            )
            if more.random() < 0.6:
                shining = (*shining, Light(LightKind.IMAGE, diffuse=(0.5,) * 3, texture=5))
            air = Atmosphere(
                1.0, 6.0, (0.3, 0.4, 0.5), float(more.choice([0.1, 0.5])), 4.0, (0.9, 0.8, 0.7)
            )
        self.render: dict[str, object] = {"sky": ("light", "backdrop")[seed % 3 == 0]}
        if rich:
            self.render |= {"fog": seed % 2 == 0, "flicker": (PULSE,)}
        sizes = [random_size(rng, shape, decades) for shape in shapes]
        twins = self._make_small(shapes, sizes) if many else np.arange(count)
        self.scene = scene_of(
            shapes,
            sizes,
            mesh=rng.integers(0, 3, count),
            surface=rng.integers(0, 6, count),
            meshes=meshes,
            surfaces=surfaces,
            textures=textures,
            lights=shining,
            skybox=int(rng.choice([-1, 5])),
            atmosphere=air,
        )
        self.orthographic = bool(rng.random() < 0.25)
        width, height = size
        focal = width / (
            3.0 if self.orthographic else float(rng.choice([0.3, 1.0, 2.0, 8.0])) / zoom
        )
        self.camera = camera_of(width, height, focal, self.orthographic)
        self.geom_pos = (rng.normal(size=(count, 3)) * 0.8)[twins]
        self.geom_mat = np.array([random_turn(rng) for _ in range(count)]).reshape(-1, 9)[twins]
        self.light_pos = rng.normal(size=(len(shining), 3)) * 2 + np.array([0, 0, 2])
        self.light_dir = rng.normal(size=(len(shining), 3)) - np.array([0, 0, 2])
        self.light_dir /= np.linalg.norm(self.light_dir, axis=1, keepdims=True)
        # the camera stands back and looks at the middle
        back = rng.normal(size=3)
        back /= np.linalg.norm(back)
        x = np.cross(rng.normal(size=3), back)
        x /= np.linalg.norm(x)
        self.pose = CameraPose(
            back * float(rng.uniform(0.5, 6)) * zoom,
            np.stack([x, np.cross(back, x), back], 1).reshape(9),
        )

    def _make_small(self, shapes: list[Shape], sizes: list[np.ndarray]) -> np.ndarray:
        """Shrink many geoms, in place, and return the one in whose place each of them is."""
        twins = np.arange(len(shapes))
        for k in range(len(shapes)):
            if shapes[k] is Shape.PLANE and k > 1:
                shapes[k] = Shape.SPHERE
            if shapes[k] is not Shape.PLANE:
                sizes[k] = sizes[k] * (24 / len(shapes)) ** (1 / 3)
            if self.rng.random() < 0.2 and k > 2:
                twins[k] = k - 1
                shapes[k], sizes[k] = shapes[k - 1], sizes[k - 1]
        return twins

    def snapshot(self, t_us: int = 0) -> SceneSnapshot:
        """Return where everything is now."""
        places = self.geom_pos.copy(), self.geom_mat.copy(), self.light_pos.copy()
        return shot_of(self.scene, *places, self.light_dir, t_us)

    def film(self, ticks: int) -> list[tuple[SceneSnapshot, CameraPose]]:
        """Film geoms that jump or hardly move; at times a light or the camera moves, too."""
        rng, frames = self.rng, []
        for tick in range(ticks):
            frames.append((self.snapshot(1000 * tick), self.pose))
            for geom in np.flatnonzero(rng.random(len(self.geom_pos)) < 0.15):
                self.geom_pos[geom] += rng.normal(size=3) * 10.0 ** rng.uniform(-6, 0)
                if rng.random() < 0.5:
                    self.geom_mat[geom] = random_turn(rng)
            if rng.random() < 0.08 and len(self.light_pos):
                self.light_pos[rng.integers(len(self.light_pos))] += rng.normal(size=3) * 0.1
            if rng.random() < 0.08:
                self.pose = CameraPose(self.pose.pos + rng.normal(size=3) * 0.1, self.pose.mat)
        return frames

    def renderer(self, threads: int = 1, **render: object) -> Renderer:
        """Make a renderer of this scene."""
        config = RenderConfig(**{"spp": 1, **self.render, **render})  # type: ignore[arg-type]
        return make_renderer(self.scene, self.camera, config, threads)

    def shifted(self, dx: int, dy: int, **render: object) -> np.ndarray:
        """Render the same light (h, w) on a larger sensor, which begins dx, dy px further out."""
        camera, (frame, pose) = self.camera, (self.snapshot(), self.pose)
        larger = replace(
            camera,
            width=camera.width + 4,
            height=camera.height + 4,
            cx=camera.cx + dx,
            cy=camera.cy + dy,
        )
        # edges decide by their neighbours
        own = {"spp": 1, "incremental": False, "antialiasing": "fixed"}
        chosen = {**own, **self.render, **render, "renderer": "direct"}
        config = RenderConfig(**chosen)  # type: ignore[arg-type]
        light = NativeRenderer(self.scene, larger, config, 1).render(frame, pose)
        return light[dy : dy + camera.height, dx : dx + camera.width].copy()


def check_film(
    seeds: range,
    ticks: int,
    settings: Callable[[int], dict[str, object]] = lambda seed: {},
    **stage: object,
) -> None:
    """Check that light is finite, and the same whether it is kept or traced anew.

    It must not depend on the instruction set and the number of threads, either.

    Args:
        seeds: The seeds of the scenes.
        ticks: The length of each film.
        settings: Maps the seed of a scene to further settings of its renderer.
        **stage: Further arguments of RandomStage.
    """
    for seed in seeds:
        scene = RandomStage(seed, **stage)  # type: ignore[arg-type]
        render = {"spp": (1, 2, 4, 5)[seed % 4], **settings(seed)}
        full = scene.renderer(incremental=False, **render)
        isa = _core.isa_available()[seed % len(_core.isa_available())]
        others = [
            scene.renderer(threads=1 + seed % 3, **render),
            scene.renderer(threads=1 + (seed + 1) % 3, isa=isa, incremental=False, **render),
            scene.renderer(isa="portable", **render),
        ]
        for tick, (frame, pose) in enumerate(scene.film(ticks)):
            light = full.render(frame, pose)
            assert np.isfinite(light).all(), (seed, tick)
            assert (light >= 0).all(), (seed, tick)
            for other in others:
                assert other.render(frame, pose).tobytes() == light.tobytes(), (seed, tick)
