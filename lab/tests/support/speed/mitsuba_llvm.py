"""Mitsuba 3's compiled renderer (LLVM), and robots as both it and we can show them."""

from __future__ import annotations

import ctypes
import ctypes.util
import os
from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import replace
from typing import Any

import numpy as np

from evs.emulator.base.scene import Light, LightKind, Shape, Surface
from reference.stage import Stage
from reference.tessellation import ball
from speed.elsewhere import AbsentError, Elsewhere, elsewhere
from speed.view import View

BOUNCES, SAMPLES = 2, 8
OLDEST = 17
NO_LLVM = (
    "Mitsuba's compiler needs LLVM {} or newer, {}: apt install libllvm19, or name another "
    "libLLVM in DRJIT_LIBLLVM_PATH"
)


def common_view(view: View) -> View:
    """Of one colour a geom, matt; lamps are points or suns; without sky and headlight.

    Ellipsoids become meshes, which Mitsuba has instead.
    """
    content = view.content
    meshes, geom_mesh = list(content.meshes), content.geom_mesh.copy()
    round_ones = content.geom_type == Shape.ELLIPSOID
    for row in np.flatnonzero(round_ones):
        geom_mesh[row] = len(meshes)
        meshes.append(ball(40, content.geom_size[row]))
    shown = [row for row, light in enumerate(content.lights) if not light.headlight]
    matt = replace(
        content,
        geom_type=np.where(round_ones, Shape.MESH, content.geom_type).astype(np.int32),
        geom_mesh=geom_mesh,
        meshes=tuple(meshes),
        surfaces=tuple(Surface((*s.rgba[:3], 1.0), specular=0.0) for s in content.surfaces),
        lights=tuple(_hard(content.lights[row]) for row in shown),
        textures=(),
        skybox=-1,
        atmosphere=None,
    )
    shot = replace(
        view.shot, light_pos=view.shot.light_pos[shown], light_dir=view.shot.light_dir[shown]
    )
    return replace(view, content=matt, shot=shot)


def _hard(light: Light) -> Light:
    """A sun, or a bare point that fades with the square of the distance."""
    dark, square = (0.0, 0.0, 0.0), (0.0, 0.0, 1.0)
    sun = light.kind is LightKind.DIRECTIONAL
    kind = LightKind.DIRECTIONAL if sun else LightKind.POINT
    diffuse = light.diffuse if sun else (20.0, 20.0, 20.0)
    return Light(kind, diffuse=diffuse, specular=dark, attenuation=square, bulbradius_m=0.0)


def mitsuba(view: View, threads: int) -> AbstractContextManager[Elsewhere]:
    """Draws a `common_view` by `direct` or `path` with 1 or SAMPLES samples: (h, w, 3) linear.

    Raises AbsentError where LLVM is missing.
    """
    stage = (view.content, view.shot, view.camera, view.pose)
    return elsewhere(make_draw, stage, threads, environment={})


def make_draw(stage: tuple[object, ...], threads: int) -> Callable[..., np.ndarray]:
    """What happens there."""
    os.environ["DRJIT_LIBLLVM_PATH"] = find_llvm()
    import drjit as dr
    import mitsuba as mi

    from reference.mitsuba_scene import mitsuba_scene

    mi.set_variant("llvm_ad_rgb")
    dr.set_thread_count(threads)
    scene = mitsuba_scene(Stage(*stage, bounces=BOUNCES), "path")  # type: ignore[arg-type]
    integrators = {
        # to the lamp one ray, as ours
        "direct": mi.load_dict({"type": "direct", "emitter_samples": 1, "bsdf_samples": 0}),
        "path": scene.integrator(),
    }

    def record(integrator: Any, samples: int) -> Callable[..., Any]:
        return dr.freeze(
            lambda scene, seed: mi.render(scene, integrator=integrator, spp=samples, seed=seed)
        )

    # recorded once: else Python puts every frame together anew
    frames = {
        (name, samples): record(integrator, samples)
        for name, integrator in integrators.items()
        for samples in (1, SAMPLES)
    }
    return lambda name, samples, seed=0: np.asarray(frames[name, samples](scene, mi.UInt32(seed)))


def find_llvm() -> str:
    """Path of a libLLVM that is new enough; the newest unless DRJIT_LIBLLVM_PATH names one."""
    named = os.environ.get("DRJIT_LIBLLVM_PATH")
    newest_first = [f"LLVM-{version}" for version in range(40, OLDEST - 1, -1)]
    found = (ctypes.util.find_library(name) for name in (*newest_first, "LLVM"))
    for library in filter(None, [named] if named else found):
        if version_of(library) >= OLDEST:
            return library
    raise AbsentError(NO_LLVM.format(OLDEST, f"{named} is not" if named else "which is not here"))


def version_of(library: str) -> int:
    """Major version of a libLLVM; 0 where it is not one, or older than 16."""
    major = ctypes.c_uint(0)
    try:
        ctypes.CDLL(library).LLVMGetVersion(ctypes.byref(major), None, None)
    except (OSError, AttributeError):
        return 0
    return major.value
