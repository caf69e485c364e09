"""What renderers know of a world (SceneModel once, SceneSnapshot a tick) and find: GroundTruth.

Lengths in m, angles in radians unless the name has another unit, colours as MuJoCo codes them.
Matrices are row-major and turn local into world coordinates: world = mat @ local + pos.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from enum import IntEnum

import numpy as np
import numpy.typing as npt

F32 = npt.NDArray[np.float32]
F64 = npt.NDArray[np.float64]
I32 = npt.NDArray[np.int32]
U8 = npt.NDArray[np.uint8]


MAX_PIXELS = 64_000_000
"""A sensor over 64 Mpx is a slip of the keyboard."""


class Shape(IntEnum):
    """Geometric primitives, numbered as MuJoCo's mjtGeom."""

    PLANE = 0
    HFIELD = 1
    SPHERE = 2
    CAPSULE = 3
    ELLIPSOID = 4
    CYLINDER = 5
    BOX = 6
    MESH = 7


class ObjectKind(IntEnum):
    """What of a model a geom of the scene stands for."""

    GEOM = 0
    SKIN = 1
    FLEX = 2
    """cloth and soft bodies"""
    SITE = 3
    TENDON = 4
    ROPE = 5
    """a flex of dimension 1"""
    CRANK = 6
    """slider and rod of an actuator"""


class LightKind(IntEnum):
    """Light types, numbered as MuJoCo's mjtLightType."""

    SPOT = 0
    DIRECTIONAL = 1
    POINT = 2
    IMAGE = 3


class TextureKind(IntEnum):
    """Texture types, numbered as MuJoCo's mjtTexture."""

    FLAT = 0
    CUBE = 1
    SKYBOX = 2


@dataclass(frozen=True)
class Mesh:
    """A triangle mesh in its geom's frame. A height field is one too: surface, sides and bottom."""

    vertices: F32
    """(nv, 3)"""
    faces: I32
    """(nf, 3) indices into vertices, counter-clockwise seen from outside"""
    normals: F32 | None = None
    """(nf, 3, 3) unit normal of each face's corner; None: the face's own"""
    texcoords: F32 | None = None
    """(nf, 3, 2) texture coordinates of each face's corner; None: by position"""


@dataclass(frozen=True)
class Texture:
    """An image. FLAT: (h, w, c). CUBE, SKYBOX: (6, w, w, c), faces in OpenGL's order."""

    kind: TextureKind
    data: U8
    """c is 1, 3 or 4"""
    srgb: bool = True
    """True: display-coded, decoded before use. False: linear."""
    name: str = ""
    """the model's name of it, else its number"""


@dataclass(frozen=True)
class Surface:
    """How a geom reflects light: MuJoCo's material with the geom's own rgba already chosen."""

    rgba: tuple[float, float, float, float] = (0.5, 0.5, 0.5, 1.0)
    """display-coded"""
    texture: int = -1
    """index into SceneModel.textures, -1 none"""
    texrepeat: tuple[float, float] = (1.0, 1.0)
    texuniform: bool = False
    emission: float = 0.0
    specular: float = 0.5
    shininess: float = 0.5
    """0 ... 1; times 128 is the Blinn-Phong exponent"""
    reflectance: float = 0.0
    """share of a perfect mirror, of opaque surfaces. A plane mirrors on its front, a box on its +Z
    face; other shapes do all around, but a model's have none"""
    metallic: float = -1.0
    """0 dielectric ... 1 metal; negative: not given. Given, or a map of it: a physical material,
    whose gloss is a GGX lobe and not `specular` and `shininess`"""
    roughness: float = -1.0
    """0 ... 1, its square is the width of the GGX lobe; as `metallic`, it makes the material
    physical"""
    metallic_map: int = -1
    """maps are indices into SceneModel.textures, -1 none; each multiplies the number of its name, 1
    where that is not given. This one, roughness, occlusion and opacity have one component"""
    roughness_map: int = -1
    occlusion_map: int = -1
    """share of the ambient light that arrives"""
    opacity_map: int = -1
    """multiplies alpha"""
    normal_map: int = -1
    """(x, y, z) as (c - 0.5) * 2: to the image's right, to its top, out of the surface"""
    emissive_map: int = -1
    """radiance, times `emission` where that is over 0; instead of the colour times `emission`"""


@dataclass(frozen=True)
class Light:
    """Everything of a light that does not move. Colours are linear."""

    kind: LightKind
    ambient: tuple[float, float, float] = (0.0, 0.0, 0.0)
    diffuse: tuple[float, float, float] = (0.7, 0.7, 0.7)
    specular: tuple[float, float, float] = (0.3, 0.3, 0.3)
    castshadow: bool = True
    attenuation: tuple[float, float, float] = (1.0, 0.0, 0.0)
    """constant, linear, quadratic in m"""
    cutoff_deg: float = 45.0
    """half angle of a spot"""
    exponent: float = 10.0
    intensity: float = 0.0
    """candela (spot, point), lux (directional) or cd/m^2 of a white texel (image); 0: `diffuse`
    holds"""
    range_m: float = 10.0
    """where the light of a candela ends, smoothly; 0 or less: nowhere"""
    softness: float = 0.2
    """share of `cutoff_deg` over which a spot with an intensity fades out, instead of `exponent`"""
    texture: int = -1
    """of an image light, a cube: index into SceneModel.textures"""
    bulbradius_m: float = 0.02
    headlight: bool = False
    """True: sits at the camera and looks along it; its snapshot pose is not used"""
    name: str = ""
    """the model's name of it, else its number; "headlight" is the camera's"""

    @property
    def is_image(self) -> bool:
        """Whether it shines from everywhere around the scene: it has no position and no shadow."""
        return self.kind is LightKind.IMAGE

    @property
    def is_delta_direction(self) -> bool:
        """Whether all its rays are parallel: it has no position."""
        return self.kind is LightKind.DIRECTIONAL

    @property
    def is_local(self) -> bool:
        """Whether it shines from a position."""
        return not self.is_image and not self.is_delta_direction

    @property
    def has_cone(self) -> bool:
        """Whether it shines only within `cutoff_deg`."""
        return self.kind is LightKind.SPOT

    @property
    def is_bounded(self) -> bool:
        """Whether its cone or its range ends."""
        cone = self.has_cone and self.cutoff_deg < 180
        return cone or (self.is_local and self.intensity > 0 and self.range_m > 0)


@dataclass(frozen=True)
class Atmosphere:
    """Fog and haze, as MuJoCo's viewer can show them. Colours are display-coded."""

    fog_start_m: float
    fog_end_m: float
    """light from further away is the fog's"""
    fog_rgb: tuple[float, float, float]
    haze_ratio: float
    """share of the way to the horizon that haze covers, 0 ... 1"""
    haze_radius_m: float
    """how far away the haze is; 0: there is none"""
    haze_rgb: tuple[float, float, float]


@dataclass(frozen=True)
class SceneModel:
    """The world's constant part: extracted once, handed to the renderer once.

    Its geoms are what MuJoCo's visualiser draws: the model's geoms, skins, flexes, sites, tendons
    and ropes as chains of capsules, and slider-cranks.
    """

    geom_type: I32
    """(ng,) Shape"""
    geom_size: F32
    """(ng, 3) as MuJoCo: half sizes, radius, half length; plane half (x, y) or 0, infinite. What
    is round and has no radius is not hit"""
    geom_mesh: I32
    """(ng,) index into meshes, -1 none"""
    geom_surface: I32
    """(ng,) index into surfaces"""
    geom_id: I32
    """(ng,) the geom's id in the model (invisible geoms are left out here). Below -1, counted on
    from -2: skins by their id, then flexes (ropes too), then sites, then tendons, then actuators
    that are slider-cranks: site i is -2 - nskin - nflex - i, tendon i
    -2 - nskin - nflex - nsite - i. Several may have one id"""
    geom_static: npt.NDArray[np.bool_]
    """(ng,) True where the geom is welded to the world and can never move"""
    meshes: tuple[Mesh, ...] = ()
    surfaces: tuple[Surface, ...] = (Surface(),)
    textures: tuple[Texture, ...] = ()
    texture_names: tuple[str, ...] = ()
    """of all textures of the model, also of those that nothing shows"""
    lights: tuple[Light, ...] = ()
    skybox: int = -1
    """index into textures, -1 none"""
    deforming: tuple[int, ...] = ()
    """indices into meshes whose vertices every snapshot brings anew: skins and flexes"""
    stretching: I32 = field(default_factory=lambda: np.zeros(0, np.int32))
    """(ns,) geoms whose size every snapshot brings anew: tendons, ropes and slider-cranks"""
    geom_body: I32 = field(default_factory=lambda: np.zeros(0, np.int32))
    """(ng,) the body that carries the geom, -1 a skin, flex, tendon or slider-crank, which
    hang on many; or not told"""
    geom_kind: I32 = field(default_factory=lambda: np.zeros(0, np.int32))
    """(ng,) ObjectKind; empty: geoms all of them"""
    atmosphere: Atmosphere | None = None
    """None: nothing to see of it"""
    extent_m: float = 1.0
    """the model's characteristic size (mjModel.stat.extent)"""
    not_mirrors: int = 0
    """geoms whose material has reflectance and whose shape does not mirror"""
    left_out: tuple[str, ...] = ()
    """one line for each thing of the model that is not shown, with the fix"""
    seen: str = ""
    """groups and flags that decide what is shown, in words"""
    hidden: tuple[str, ...] = ()
    """one line for each group with geoms that these hide"""

    @property
    def has_meshes(self) -> bool:
        """Whether a mesh, height field, skin or flex is shown."""
        return bool((self.geom_mesh >= 0).any())

    def without_sites(self) -> SceneModel:
        """The same, with the same rows, in which no site is hit."""
        sites = self.geom_kind == ObjectKind.SITE
        if not sites.any():
            return self
        surface = np.where(sites, 0, self.geom_surface).astype(np.int32)
        # what only sites were made of is left out
        kept = set(surface[~sites].tolist())
        surfaces = (s if i in kept else Surface() for i, s in enumerate(self.surfaces))
        return replace(
            self,
            geom_type=np.where(sites, Shape.CAPSULE, self.geom_type).astype(np.int32),
            geom_size=np.where(sites[:, np.newaxis], 0, self.geom_size).astype(np.float32),
            geom_surface=surface,
            surfaces=tuple(surfaces),
        )


@dataclass(frozen=True)
class CameraPose:
    """Where a camera is. It looks along its local -z, x right, y up, as MuJoCo's cameras do."""

    pos: F64
    """(3,)"""
    mat: F64
    """(9,) row-major, camera to world"""


@dataclass(frozen=True)
class Deformed:
    """The vertices of a deforming mesh at one instant, in its geom's frame."""

    vertices: F32
    """(nv, 3)"""
    normals: F32
    """(nv, 3) unit"""


@dataclass(frozen=True)
class SceneSnapshot:
    """Everything that may have moved, at one instant. Immutable; the arrays are its own."""

    t_us: int
    geom_pos: F64
    """(ng, 3)"""
    geom_mat: F64
    """(ng, 9)"""
    light_pos: F64
    """(nl, 3)"""
    light_dir: F64
    """(nl, 3) unit"""
    cameras: tuple[CameraPose, ...] = field(default_factory=tuple)
    """one for each camera that was bound, in that order"""
    deformed: tuple[Deformed, ...] = ()
    """one for each of SceneModel.deforming, in that order"""
    exposure_us: int = 0
    """flickering light is its mean over (t_us - exposure_us, t_us]; 0: as it is at t_us"""
    stretched: F32 = field(default_factory=lambda: np.zeros((0, 3), np.float32))
    """(ns, 3) sizes of SceneModel.stretching; a radius of 0: it cannot be seen now"""


@dataclass(frozen=True)
class CameraModel:
    """Pixels to rays. Pixel (x, y) covers [x, x+1) x [y, y+1); (0, 0) is the top left.

    Perspective: the ray through image point (u, v) is ((u - cx) / fx, -(v - cy) / fy, -1) in the
    camera's frame. Orthographic: rays run along -z from ((u - cx) / fx, -(v - cy) / fy, 0), and
    fx, fy are px per m. A lens with distortion bends them as evs.emulator.optics says.
    """

    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float
    orthographic: bool = False
    distortion_model: str = "none"
    """none | plumb_bob | rational_polynomial | equidistant, as in ROS's CameraInfo"""
    distortion: tuple[float, ...] = ()
    """its coefficients in OpenCV's order"""
    vignetting: str = "none"
    """none | cos4: light falls with the fourth power of the cosine of the angle off the axis"""
    vignetting_polynomial: tuple[float, ...] = ()
    """a b ...: another factor 1 + a r^2 + b r^4 + ..., r in half diagonals of the image"""
    near_m: float = 0.0
    """depth of the near plane, m: nothing nearer is seen. Of a fisheye (equidistant), which sees
    behind itself, it is the radius of a sphere"""


@dataclass(frozen=True)
class GroundTruth:
    """Values of the first surface, opaque or not, on the ray through each pixel's centre."""

    t_us: int
    depth: F32
    """(h, w) along the optical axis, m; negative for what a fisheye sees behind itself"""
    distance: F32
    """(h, w) along the ray, m"""
    normal: F32
    """(h, w, 3) shading normal, unit, world frame, turned to the camera; no normal maps"""
    position: F32
    """(h, w, 3) of the point that is seen, world frame, m"""
    geom_id: I32
    """(h, w) MuJoCo's geom id, -1 nothing; skin i is -2 - i, flex i (a rope too) -2 - nskin - i,
    site i -2 - nskin - nflex - i, tendon i -2 - nskin - nflex - nsite - i, and slider-cranks, by
    their actuator's id, after those"""
    body_id: I32
    """(h, w) MuJoCo's body id, 0 the world; -1 nothing, or a thing that hangs on many bodies"""
    flow: F32
    """(h, w, 2) px/s, x to the right, y down: the mean velocity, since the previous snapshot, of
    the image of the point that is seen now, which moved with its body (on a skin or flex: with its
    triangle; on a tendon or rope: with the stretch from corner to corner that it is on). It belongs
    to the events between the two. NaN where that point was behind the camera, and everywhere
    without a previous snapshot. An orthographic camera has no image of what lies at infinity: 0
    there."""
