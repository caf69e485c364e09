"""The `raster` renderer behind the Renderer protocol."""

from __future__ import annotations

import weakref
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from evs.emulator.base.protocols import Commit
from evs.emulator.base.scene import (
    F32,
    I32,
    CameraModel,
    CameraPose,
    GroundTruth,
    SceneModel,
    SceneSnapshot,
)
from evs.emulator.config import RenderConfig
from evs.emulator.optics import check_distortion, is_distorted, make_lens
from evs.emulator.render.native import NativeRenderer
from evs.emulator.render.raster.canvas import Canvas
from evs.emulator.render.raster.context import load_library
from evs.emulator.render.raster.drawing import (
    CUBE,
    FAR,
    FLAT,
    NEAR,
    LightUniforms,
    Uniforms,
    draw_calls,
    extent_of,
    orthographic_matrix,
    pose_matrix,
)
from evs.emulator.render.raster.tessellate import TriangleMesh, stretched
from evs.msgs import EvsError


class RasterRenderer:
    """Light as `direct` has it, by OpenGL: no shadows, no mirrors.

    Each renderer has a context of its own, given back by `close`, or when nobody holds it any more.
    `config.samples` over 1: edges are antialiased by as many samples as OpenGL has, up to that; the
    inside of a surface is shaded once a pixel. `shadows`, `incremental` and `isa` change nothing,
    and neither does the number of threads; the last bits are the driver's own. Transparent geoms
    are blended far to near by their centres. An infinite plane reaches 1000 extents of the scene
    from its own centre; nothing is seen nearer to the camera
    than its near plane, or than 0.002 of them.

    FAULT: pyrender's shadow maps raise GLError 1282 on EGL, hence no shadows.
    """

    def __init__(self, scene: SceneModel, camera: CameraModel, config: RenderConfig) -> None:
        check_distortion(camera)
        if is_distorted(camera):
            raise EvsError(
                f"the raster renderer has no lens distortion ({camera.distortion_model}): give "
                'render.renderer = "direct", or camera.distortion_model = "none"'
            )
        self._library, self._camera = load_library(), camera
        self._share = make_lens(camera).share
        scene = scene if config.sites else scene.without_sites()
        self._content, self._config = scene, config
        self._tracer: NativeRenderer | None = None
        self._lights = LightUniforms(scene, config)
        self._luminance = np.zeros((camera.height, camera.width), np.float32)
        self._canvas = Canvas(
            self._library, camera.width, camera.height, config.samples, len(self._lights)
        )
        self._close = weakref.finalize(self, self._canvas.close)
        constant: Uniforms = {"flat_texture": FLAT, "cube_texture": CUBE}
        constant["orthographic"] = camera.orthographic
        with self._canvas.context:
            self._canvas.set_uniforms(constant | self._lights.constant)
            self._scene, self._nodes, self._eye, triangles = self._stage(scene)
        # skins and flexes: which of snapshot.deformed, its node, its faces
        self._deforming = [
            (scene.deforming.index(mesh), self._nodes[geom], scene.meshes[mesh].faces)
            for geom, mesh in enumerate(scene.geom_mesh)
            if mesh in scene.deforming
        ]
        # tendons and ropes: their nodes, and capsules as long as thick
        self._stretching = [(self._nodes[geom], triangles[geom]) for geom in scene.stretching]

    def render(self, snapshot: SceneSnapshot, pose: CameraPose, into: F32 | None = None) -> F32:
        """Render one instant.

        Args:
            snapshot: The world at that instant.
            pose: Where the camera is.
            into: (h, w) float32, where the light goes; without it the array that is returned is
                this renderer's own and reused.

        Returns:
            (h, w) float32 linear luminance.
        """
        luminance = self._luminance if into is None else into
        self._draw(snapshot, pose, luminance, False)
        if self._share is not None:
            luminance *= self._share
        return luminance

    def restart(self) -> None:
        """Forget earlier ticks."""
        return

    def render_again(self, snapshot: SceneSnapshot, pose: CameraPose) -> F32:
        """Render the instant that was rendered last, after `prepare_restore`."""
        return self.render(snapshot, pose)

    def save(self) -> dict[str, Any]:
        """Named arrays of earlier ticks: none."""
        return {}

    def prepare_restore(self, saved: Mapping[str, Any]) -> Commit:
        """Take back what `save` gave."""
        del saved
        return lambda: None

    def reseed(self, seed: int) -> None:
        """Nothing here follows from a seed."""

    def hits(self, snapshot: SceneSnapshot, pose: CameraPose) -> tuple[I32, F32]:
        """What each pixel's centre shows: index into the scene's geoms or -1, distance in m."""
        out = np.empty((*self._luminance.shape, 4), np.float32)
        self._draw(snapshot, pose, out, True)
        geom = np.rint(out[..., 0]).astype(np.int32) - 1
        return geom, np.where(geom < 0, np.float32(0), out[..., 1])

    @property
    def rgb(self) -> None:
        """None: luminance alone is drawn."""
        return None

    def ground_truth(
        self,
        snapshot: SceneSnapshot,
        pose: CameraPose,
        previous: tuple[SceneSnapshot, CameraPose] | None = None,
    ) -> GroundTruth:
        """As `direct` has it: it is traced, by a tracer that is made for the first call."""
        if self._tracer is None:
            config = replace(self._config, renderer="direct")
            self._tracer = NativeRenderer(self._content, self._camera, config, 0)
        return self._tracer.ground_truth(snapshot, pose, previous)

    @property
    def traced_fraction(self) -> float:
        """1: every pixel is drawn every time."""
        return 1.0

    @property
    def features(self) -> dict[str, bool]:
        """OpenGL has one code path for everything: none of ours."""
        return {"full_retrace": True}

    def close(self) -> None:
        """Give the context back; nothing can be rendered afterwards."""
        self._close()

    def _draw(self, snapshot: SceneSnapshot, pose: CameraPose, out: F32, single: bool) -> None:
        if not self._close.alive:
            raise EvsError("this raster renderer is closed: make another one")
        # the camera is the origin: 32-bit floats are finest there
        for node, position, mat in zip(
            self._nodes, snapshot.geom_pos - pose.pos, snapshot.geom_mat, strict=True
        ):
            self._scene.set_pose(node, pose_matrix(mat, position))
        self._scene.set_pose(self._eye, pose_matrix(pose.mat, np.zeros(3)))
        forward = -pose.mat.reshape(3, 3)[:, 2]
        moving: Uniforms = {"look": forward, "find_hits": single} | self._lights.at(snapshot, pose)
        with self._canvas.context:
            for shape, node, faces in self._deforming:
                now = snapshot.deformed[shape]
                parts = (x[faces].reshape(-1, 3) for x in (now.vertices, now.normals))
                self._canvas.deform(node, *parts)
            for (node, base), size in zip(self._stretching, snapshot.stretched, strict=True):
                self._canvas.deform(node, stretched(base, size), base.normals)
            self._canvas.set_uniforms(moving)
            flags = self._library.pyrender.RenderFlags.OFFSCREEN
            self._canvas.draw(self._scene, flags, out, single)

    def _stage(self, scene: SceneModel) -> tuple[Any, list[Any], Any, dict[int, TriangleMesh]]:
        """pyrender's scene, its node of each geom, that of the camera, and what can stretch."""
        pyrender, camera, canvas = self._library.pyrender, self._camera, self._canvas
        stage = pyrender.Scene(bg_color=[0.0, 0.0, 0.0, 0.0])
        names: dict[int, int] = {-1: 0}
        nodes: list[Any] = []
        triangles, stretching = {}, set(scene.stretching.tolist())
        for call in draw_calls(scene, camera.orthographic):
            if call.texture not in names:
                image = scene.textures[call.texture]
                srgb = image.srgb and image.name not in self._config.linear_textures
                names[call.texture] = canvas.add_texture(replace(image, srgb=srgb))
            part = pyrender.Primitive(
                positions=call.triangles.positions,
                normals=call.triangles.normals,
                # FAULT: texture coordinates are cut to two numbers; a cube's are three
                color_0=call.triangles.coordinates,
                indices=call.triangles.faces,
            )
            # FAULT: indices are kept as 32-bit floats, which are exact only up to 2^24
            if len(nodes) in stretching:
                triangles[len(nodes)] = call.triangles
            part._indices = np.ascontiguousarray(call.triangles.faces, np.uint32)
            if call.material["alpha"] < 1:
                colour = [1.0, 1.0, 1.0, call.material["alpha"]]
                part.material = pyrender.MetallicRoughnessMaterial(
                    alphaMode="BLEND", baseColorFactor=colour
                )
            nodes.append(stage.add(pyrender.Mesh([part])))
            canvas.paint(nodes[-1], call.material, names[call.texture])
        extent_m = extent_of(scene)
        if camera.orthographic:
            # FAULT: its width is overruled and there is no principal point
            lens = pyrender.OrthographicCamera(1.0, 1.0)
            matrix = orthographic_matrix(camera, extent_m)
            lens.get_projection_matrix = lambda **_: matrix
        else:
            lens = pyrender.IntrinsicsCamera(
                camera.fx,
                camera.fy,
                camera.cx,
                camera.cy,
                max(camera.near_m, NEAR * extent_m),
                FAR * extent_m,
            )
        return stage, nodes[: len(scene.geom_type)], stage.add(lens), triangles
