"""Skins and flexes: meshes whose vertices move, as MuJoCo's visualiser has them.

A skin hangs on bones; a flex is cloth or a soft body. A flex of dimension 1, a rope, has no faces:
see tendons.py.
"""

from __future__ import annotations

import mujoco
import numpy as np

from evs.emulator.base.scene import F32, Deformed, Mesh
from evs.emulator.config import VisualConfig
from evs.emulator.world.materials import Rgba, shown_rgba
from evs.emulator.world.model import new_data
from evs.emulator.world.physics import update_poses
from evs.emulator.world.visual import DEFAULT, faded, is_shown, option_of


class Deformables:
    """The visible skins and flexes with faces of one model: first the skins, then the flexes."""

    def __init__(self, model: mujoco.MjModel, visual: VisualConfig = DEFAULT) -> None:
        self._model, self._visual = model, visual
        self._skins = [
            i
            for i in range(model.nskin)
            if visual.skin
            and is_shown(visual.skingroup, model.skin_group[i], self._skin_appearance(i)[0])
        ]
        self._flexes = [
            i
            for i in range(model.nflex)
            if model.flex_dim[i] > 1
            and (visual.flexskin or visual.flexface)
            and is_shown(visual.flexgroup, model.flex_group[i], self._flex_appearance(i)[0])
        ]
        if len(self):
            # the visualiser's own arrays; room for one geom that is never added
            self._scene = mujoco.MjvScene(model, 1)
            self._option, self._view = option_of(visual), mujoco.MjvCamera()
            # a view of our own, which no vertex depends on: with the model's, MuJoCo ends the
            # process where the near clip plane is under 1e-15 m
            self._view.type = mujoco.mjtCamera.mjCAMERA_USER
            for eye in self._scene.camera:
                eye.forward, eye.up = (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)
                eye.frustum_near, eye.frustum_far = 0.1, 10.0
                eye.frustum_bottom, eye.frustum_top, eye.frustum_width = -0.1, 0.1, 0.1

    def __len__(self) -> int:
        return len(self._skins) + len(self._flexes)

    @property
    def skins(self) -> list[int]:
        """Ids of the skins."""
        return self._skins

    @property
    def flexes(self) -> list[int]:
        """Ids of the flexes."""
        return self._flexes

    def appearances(self) -> list[tuple[Rgba, int, bool]]:
        """Of each: colour, material (-1 none), and whether the material's image is on it."""
        return [self._skin_appearance(i) for i in self._skins] + [
            self._flex_appearance(i) for i in self._flexes
        ]

    def at_rest(self) -> list[Mesh]:
        """Of each: its mesh where the model begins."""
        data = new_data(self._model)
        update_poses(self._model, data)
        return self.meshes(data)

    def meshes(self, data: mujoco.MjData) -> list[Mesh]:
        """Of each: its faces and texture coordinates, and where its vertices are now."""
        now = self.vertices(data)
        model, found = self._model, []
        for i, shape in zip(self._skins, now[: len(self._skins)], strict=True):
            first, count = model.skin_faceadr[i], model.skin_facenum[i]
            faces = np.array(model.skin_face[first : first + count], np.int32)
            texcoords = None
            if model.skin_texcoordadr[i] >= 0:
                first = model.skin_texcoordadr[i]
                per_vertex = model.skin_texcoord[first : first + model.skin_vertnum[i]]
                texcoords = np.array(per_vertex[faces], np.float32)
            found.append(Mesh(shape.vertices, faces, shape.normals[faces], texcoords))
        for i, shape in zip(self._flexes, now[len(self._skins) :], strict=True):
            # every face has corners of its own
            faces = np.arange(len(shape.vertices), dtype=np.int32).reshape(-1, 3)
            texcoords = None
            if model.flex_texcoordadr[i] >= 0:
                texcoords = self._of_flex(self._scene.flextexcoord, i, 2).reshape(-1, 3, 2)
            found.append(Mesh(shape.vertices, faces, shape.normals[faces], texcoords))
        return found

    def vertices(self, data: mujoco.MjData) -> tuple[Deformed, ...]:
        """Where the vertices of each are; `data` has its kinematics and flexes computed."""
        if not len(self):
            return ()
        scene, model = self._scene, self._model
        # category 0: of all the scene only skins and flexes are updated
        mujoco.mjv_updateScene(model, data, self._option, None, self._view, 0, scene)
        shapes = []
        for i in self._skins:
            rows = slice(model.skin_vertadr[i], model.skin_vertadr[i] + model.skin_vertnum[i])
            places = scene.skinvert.reshape(-1, 3)[rows], scene.skinnormal.reshape(-1, 3)[rows]
            shapes.append(Deformed(*(np.array(part, np.float32) for part in places)))
        for i in self._flexes:
            used = 3 * int(scene.flexfaceused[i])
            places = self._of_flex(scene.flexface, i, 3), self._of_flex(scene.flexnormal, i, 3)
            # faces that are not in use today collapse to a point, which no ray hits; MuJoCo leaves
            # there what was in memory
            for part in places:
                part[used:] = 0.0
            shapes.append(Deformed(*places))
        return tuple(shapes)

    def _of_flex(self, values: F32, flex: int, width: int) -> F32:
        """(corners, width) what the visualiser has for each face's corners of one flex."""
        first = 3 * int(self._scene.flexfaceadr[flex])
        count = 3 * int(self._scene.flexfacenum[flex])
        return np.array(values.reshape(-1, width)[first : first + count], np.float32)

    def _skin_appearance(self, skin: int) -> tuple[Rgba, int, bool]:
        material = int(self._model.skin_matid[skin])
        rgba, kind = self._model.skin_rgba[skin], mujoco.mjtObj.mjOBJ_SKIN
        own = shown_rgba(self._model, kind, skin, rgba, material)
        return faded(self._model, own, self._visual), material, True

    def _flex_appearance(self, flex: int) -> tuple[Rgba, int, bool]:
        material = int(self._model.flex_matid[flex])
        textured = bool(self._model.flex_texcoordadr[flex] >= 0)
        rgba, kind = self._model.flex_rgba[flex], mujoco.mjtObj.mjOBJ_FLEX
        own = shown_rgba(self._model, kind, flex, rgba, material)
        return faded(self._model, own, self._visual), material, textured
