"""The native renderer: an integrator of the core, on the CPU or on a GPU."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from evs.emulator import _core
from evs.emulator.base.features import UNFORCED, Switches
from evs.emulator.base.protocols import Commit
from evs.emulator.base.scene import (
    F32,
    I32,
    CameraModel,
    CameraPose,
    GroundTruth,
    SceneModel,
    SceneSnapshot,
    TextureKind,
)
from evs.emulator.config import RenderConfig
from evs.emulator.optics import Lens, make_lens
from evs.emulator.render.device import Cpu, Device, Poses
from evs.emulator.render.flicker import Flicker
from evs.emulator.render.ground_truth import trace_hits, trace_truth
from evs.emulator.render.irradiance_state import IrradianceState
from evs.emulator.render.renderer_table import RENDERERS
from evs.msgs.registry import load


class LentRenderer(NamedTuple):
    """The parts of a renderer that a batch of cameras uses in its place."""

    caster: _core.Caster
    luminance: F32
    """(h, w) the image, which the caster knows"""
    lights: npt.NDArray[np.intp]
    """which of the scene's lights it has"""
    seed: int
    """of the noise in every tick"""
    device: object = None
    """what of it is on a GPU, where it renders there"""


class NativeRenderer:
    """An integrator of the core, `config.renderer`, on a device.

    `direct` evaluates every light once, with hard shadows and one mirror bounce: it has no noise.
    `path` follows light as it bounces. With fixed seeds a pixel draws the same numbers in every
    tick, so still light stays still; with fresh ones every tick has its own noise, as in the paper.
    `hybrid` evaluates lamps, glowing geoms, gloss and mirrors at every pixel and caches the diffuse
    light of sky and bounces on surfaces. The cache follows changes within 96 ticks.

    With `config.incremental` and a still camera the CPU traces only what a moved geom or light can
    affect, with the bytes of the full trace. A GPU traces every tick as a whole. Single pixels,
    ground truth and hits are always traced on the CPU.
    """

    _lens: Lens
    _caster: _core.Caster

    def __init__(
        self,
        scene: SceneModel,
        camera: CameraModel,
        config: RenderConfig,
        threads: int,
        rgb: bool = False,
        seed: int = 0,
        switches: Switches = UNFORCED,
        like: NativeRenderer | None = None,
        device: str = "cpu",
        point_set: int = 0,
    ) -> None:
        """Build the caster, and on a GPU compile the kernels unless they are in the cache.

        Args:
            scene: What is seen; on a GPU without shapes that deform.
            camera: The optics.
            config: [render].
            threads: Worker threads of the CPU; 0: one per core.
            rgb: Whether colour is wanted beside the luminance, which keeps its bytes.
            seed: What the noise of `path` and the cached light of `hybrid` follow from.
            switches: Code paths that are forced on or off.
            like: The same camera's renderer until now, whose unchanged parts are shared.
            device: "cpu" or "cuda".
            point_set: Index of the point set if config.seeds is "cycle".

        Raises:
            EvsError: There is no GPU, or no memory on it.
        """
        scene = scene if config.sites else scene.without_sites()
        self._scene, self._camera = scene, camera
        self._lens = like._lens if like and like._camera == camera else make_lens(camera)
        self._seed, self._fresh = seed, config.seeds == "fresh"
        self._draws = config.renderer != "direct"
        keep = [
            i
            for i, light in enumerate(scene.lights)
            if config.headlight == "model" or not light.headlight
        ]
        self._lights = np.array(keep, np.intp)
        self._flicker = Flicker(scene.lights, config.flicker)
        bent, share = self._lens.directions, self._lens.share
        self._own = {
            "sky": switches.decide("sky", scene.skybox >= 0),
            "light_gains": switches.decide("light_gains", not self._flicker.steady),
            "lens": switches.decide("lens", bent is not None),
            "vignetting": switches.decide("vignetting", share is not None),
        }
        if self._own["vignetting"] and share is None:
            share = np.ones((camera.height, camera.width), np.float32)
        self._deforming, self._stretching = scene.deforming, scene.stretching
        self.shape = camera.height, camera.width
        self._rgb = np.zeros((*self.shape, 3), np.float32) if rgb else None
        before = (like._scene, like._caster) if like else None
        data, self.built = scene_data(scene, keep, config, self._own["sky"], before)
        self._caster = _core.Caster(
            data,
            _core.Optics(
                width=camera.width,
                height=camera.height,
                fx=camera.fx,
                fy=camera.fy,
                cx=camera.cx,
                cy=camera.cy,
                orthographic=camera.orthographic,
                lens=bent if self._own["lens"] else None,
                share=share if self._own["vignetting"] else None,
                near=camera.near_m,
                near_sphere=camera.distortion_model == "equidistant",
            ),
            _core.Tracing(
                samples=config.samples,
                adaptive=config.adaptive,
                shadows=config.shadows,
                incremental=config.incremental,
                rgb=rgb,
                integrator=config.renderer,
                bounces=config.bounces,
                sample_set=config.sampler,
                block=point_set,
                blocks=config.cycle_ticks if config.seeds == "cycle" else 1,
                forced=_forced(scene, switches),
            ),
            threads=threads,
            isa=config.isa,
            before=before[1] if before else None,
        )
        self._device: Device
        if device == "cpu":
            self._device = Cpu(self._caster, self.shape, self._rgb)
        else:
            on_gpu = load(RENDERERS[config.renderer].cuda)
            shared = like._device if like else None
            self._device = made = on_gpu(self._caster, self.shape, config.samples, shared)
            # what makes it a DeviceRenderer
            self.device_light = made.device_light
            self._own["full_retrace"] = True
        self._state = (
            IrradianceState(self._caster, self._device, self._rgb)
            if config.renderer == "hybrid"
            else None
        )

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
        return self._device.render(self._place(snapshot, pose), self._noise(snapshot), into)

    def reseed(self, seed: int) -> None:
        """The noise follows from `seed` from the next call on."""
        self._seed = seed

    def restart(self) -> None:
        """Forget earlier ticks: `hybrid` fills its cache anew in the next one."""
        if self._state:
            self._state.restart()

    def save(self) -> dict[str, Any]:
        """Named arrays of earlier ticks: of `hybrid` its cache and its last light."""
        return self._state.save() if self._state else {}

    def prepare_restore(self, saved: Mapping[str, Any]) -> Commit:
        """Check what `save` gave; the commit puts it in place.

        Raises:
            EvsError: It is damaged.
        """
        return self._state.prepare_restore(saved) if self._state else lambda: None

    def render_again(self, snapshot: SceneSnapshot, pose: CameraPose) -> F32:
        """See Renderer."""
        if not self._state:
            return self.render(snapshot, pose)
        self._device.fetch()
        return self._device.luminance

    def trace(self, snapshot: SceneSnapshot, pose: CameraPose, pixels: I32) -> F32:
        """Trace single pixels; their luminance is the same as `render` gives them.

        Args:
            snapshot: The world at an instant; of `hybrid`, at the end of the next tick.
            pose: Where the camera is.
            pixels: (n, 2) columns and rows inside the image.

        Returns:
            (n,) float32 linear luminance.
        """
        x, y = (np.ascontiguousarray(part, np.int32) for part in np.asarray(pixels).T)
        if self._state:
            # the cache is that of a tick
            traced: F32 = self.render(snapshot, pose)[y, x]
            return traced
        luminance = np.zeros(len(x), np.float32)
        poses = self._place(snapshot, pose)
        self._caster.trace_pixels(*poses, x, y, luminance, self._noise(snapshot))
        return luminance

    def ground_truth(
        self,
        snapshot: SceneSnapshot,
        pose: CameraPose,
        previous: tuple[SceneSnapshot, CameraPose] | None = None,
    ) -> GroundTruth:
        """What each pixel's centre shows, and how it moved since `previous`."""
        placed = self._place(snapshot, pose)
        return trace_truth(
            self._caster, placed, self._scene, self._camera, self._lens, snapshot, pose, previous
        )

    def hits(self, snapshot: SceneSnapshot, pose: CameraPose) -> tuple[I32, F32]:
        """What each pixel's centre shows: index into the scene's geoms or -1, distance in m."""
        found = trace_hits(self._caster, self._place(snapshot, pose), self.shape, self._lens)
        return found.geom, np.where(found.geom < 0, np.float32(0), found.distance)

    @property
    def rgb(self) -> F32 | None:
        """(h, w, 3) float32 linear light of the last `render`, reused; None: it was not wanted."""
        return self._rgb

    @property
    def traced_fraction(self) -> float:
        """Share of the pixels that the last call traced; those only lit again do not count."""
        return self._caster.traced_fraction

    @property
    def features(self) -> dict[str, bool]:
        """Which code paths it runs, by name; if a tick decides, those of the last one."""
        return {**self._caster.features, **self._own}

    @property
    def work(self) -> dict[str, int]:
        """What it has done: ticks, packets of 4 x 4 pixels needed, traced and lit again, trees."""
        return self._caster.work

    def lend(self) -> LentRenderer | str:
        """What renders in its place, with the same bytes, in a batch; or why it cannot."""
        if self._device.why_not_lent:
            return self._device.why_not_lent
        if self._fresh:
            return "render.seeds is fresh"
        if self._deforming or len(self._stretching):
            return "the scene has shapes that deform"
        if self._own["light_gains"]:
            return "render.flicker is in use"
        if self._rgb is not None:
            return "colour is rendered too"
        device = self._device
        return LentRenderer(
            self._caster, device.luminance, self._lights, self._noise(), device.uploaded
        )

    def _place(self, snapshot: SceneSnapshot, pose: CameraPose) -> Poses:
        for mesh, shape in zip(self._deforming, snapshot.deformed, strict=True):
            self._caster.deform(mesh, shape.vertices, shape.normals)
        if len(self._stretching):
            self._caster.resize(self._stretching, snapshot.stretched)
        lights = self._lights
        light_pos, light_dir = snapshot.light_pos, snapshot.light_dir
        if len(lights) < len(light_pos):
            light_pos, light_dir = light_pos[lights], light_dir[lights]
        if self._own["light_gains"]:
            self._caster.set_light_gains(self._flicker.gains(snapshot)[lights])
        return snapshot.geom_pos, snapshot.geom_mat, light_pos, light_dir, pose.pos, pose.mat

    def _noise(self, snapshot: SceneSnapshot | None = None) -> int:
        """What a tick draws from; fresh seeds need its snapshot."""
        if not self._draws:
            return 0
        # seeds may be negative, words may not
        words = [self._seed % 2**64]
        if self._fresh and snapshot is not None:
            words.append(snapshot.t_us % 2**64)
        drawn = np.random.SeedSequence(words).generate_state(1, np.uint32)
        return int(drawn.view(np.int32)[0])


def _forced(scene: SceneModel, switches: Switches) -> dict[str, bool]:
    """The code paths of the tracer that are forced: name -> on or off."""
    forced = switches.forced()
    # forced fog would hide the sky
    if scene.skybox >= 0 and forced.get("fog"):
        del forced["fog"]
    return forced


def scene_data(
    scene: SceneModel,
    lights: list[int],
    config: RenderConfig,
    sky: bool = True,
    before: tuple[SceneModel, _core.Caster] | None = None,
) -> tuple[_core.SceneData, dict[str, int]]:
    """Copy a scene's constant part, with some of its lights, into the core's form.

    Args:
        scene: The scene.
        lights: Indices of the lights.
        config: [render].
        sky: Whether there is a sky: the scene's, or a black one.
        before: Another scene and its caster, whose meshes and textures are shared.

    Returns:
        The copy; how many meshes and textures are not shared, by kind.
    """
    data = _core.SceneData()
    known = before[0] if before else None
    textures = {id(one): place for place, one in enumerate(known.textures if known else ())}
    meshes = {id(one): place for place, one in enumerate(known.meshes if known else ())}
    for texture in scene.textures:
        flat = texture.kind is TextureKind.FLAT
        image = texture.data[np.newaxis] if flat else texture.data
        srgb = texture.srgb and texture.name not in config.linear_textures
        like = textures.get(id(texture), -1)
        data.add_texture(np.ascontiguousarray(image), srgb, like)
    for surface in scene.surfaces:
        data.add_surface(
            surface.rgba,
            surface.texture,
            surface.texrepeat,
            surface.texuniform,
            surface.emission,
            surface.specular,
            surface.shininess,
            surface.reflectance,
            surface.metallic,
            surface.roughness,
            (
                surface.metallic_map,
                surface.roughness_map,
                surface.occlusion_map,
                surface.opacity_map,
                surface.normal_map,
                surface.emissive_map,
            ),
        )
    for mesh in scene.meshes:
        if before and id(mesh) in meshes:
            data.share_mesh(before[1], meshes[id(mesh)])
        else:
            data.add_mesh(mesh.vertices, mesh.faces, mesh.normals, mesh.texcoords)
    for index in lights:
        light = scene.lights[index]
        data.add_light(replace(light, intensity=light.intensity / config.lux_per_unit))
    data.set_geoms(scene.geom_type, scene.geom_size, scene.geom_mesh, scene.geom_surface)
    data.skybox = scene.skybox if sky else -1
    if sky and scene.skybox < 0:
        data.skybox = data.add_texture(np.zeros((6, 1, 1, 3), np.uint8), True)
    data.sky_shines = config.sky == "light"
    atmosphere = scene.atmosphere
    if atmosphere is not None and config.fog:
        data.set_fog(atmosphere.fog_start_m, atmosphere.fog_end_m, atmosphere.fog_rgb)
    if atmosphere is not None and config.haze:
        data.set_haze(atmosphere.haze_ratio, atmosphere.haze_radius_m, atmosphere.haze_rgb)
    return data, {
        "meshes": sum(id(mesh) not in meshes for mesh in scene.meshes),
        "textures": sum(id(texture) not in textures for texture in scene.textures),
    }
