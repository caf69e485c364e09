"""MuJoCo's own OpenGL renderer in software: Mesa, without a window.

`mujoco.Renderer` makes its context through PyOpenGL, which does not load here in the version that
pyrender asks for; so the context comes from libEGL itself. What is drawn, and how, is the same.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from contextlib import AbstractContextManager

import mujoco
import numpy as np

from speed.elsewhere import AbsentError, Elsewhere, elsewhere
from speed.view import AZIMUTH, ELEVATION, HEIGHT, WIDTH, View

NO_GL = "no OpenGL in software ({}): apt install libegl1 libgl1 libgl1-mesa-dri"
# of EGL/egl.h and eglext.h
SURFACELESS, OPENGL = 0x31DD, 0x30A2
RENDERABLE, OPENGL_BIT, SURFACE_TYPE, PBUFFER, NONE = 0x3040, 8, 0x3033, 1, 0x3038


def software_gl(view: View, threads: int) -> AbstractContextManager[Elsewhere]:
    """Draws `view` with so many samples a pixel, 0 or MuJoCo's default: (h, w, 3) uint8.

    Raises AbsentError where OpenGL is missing.
    """
    # 0: llvmpipe draws on the thread that calls it
    drawing = {"LP_NUM_THREADS": str(threads if threads > 1 else 0)}
    return elsewhere(make_draw, view.model, view.data.qpos, environment=drawing)


def make_draw(model: mujoco.MjModel, qpos: np.ndarray) -> Callable[[int], np.ndarray]:
    """What happens there; the view is that of `speed.view`'s free camera."""
    make_context()
    data = mujoco.MjData(model)
    data.qpos[:] = qpos
    mujoco.mj_forward(model, data)
    camera, scene = mujoco.MjvCamera(), mujoco.MjvScene(model, 10_000)
    mujoco.mjv_defaultFreeCamera(model, camera)
    camera.azimuth, camera.elevation = AZIMUTH, ELEVATION
    everything = mujoco.mjtCatBit.mjCAT_ALL
    mujoco.mjv_updateScene(model, data, mujoco.MjvOption(), None, camera, everything, scene)
    assert scene.flags[mujoco.mjtRndFlag.mjRND_SHADOW]
    contexts = {}
    for samples in (0, int(model.vis.quality.offsamples)):
        model.vis.quality.offsamples = samples
        contexts[samples] = mujoco.MjrContext(model, mujoco.mjtFontScale.mjFONTSCALE_100)
    box, rgb = mujoco.MjrRect(0, 0, WIDTH, HEIGHT), np.zeros((HEIGHT, WIDTH, 3), np.uint8)

    def draw(samples: int) -> np.ndarray:
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN, contexts[samples])
        mujoco.mjr_render(box, scene, contexts[samples])
        mujoco.mjr_readPixels(rgb, None, box, contexts[samples])
        # OpenGL's first row is the lowest
        return rgb[::-1]

    return draw


def make_context() -> None:
    """An OpenGL context without a window, current in this thread from now on."""
    try:
        egl = ctypes.CDLL("libEGL.so.1")
    except OSError as reason:
        raise AbsentError(NO_GL.format(reason)) from None
    pointer, count, config = ctypes.c_void_p, ctypes.c_int(), ctypes.c_void_p()
    egl.eglGetPlatformDisplay.restype = egl.eglCreateContext.restype = pointer
    display = pointer(egl.eglGetPlatformDisplay(SURFACELESS, None, None))
    wanted = (ctypes.c_int * 5)(RENDERABLE, OPENGL_BIT, SURFACE_TYPE, PBUFFER, NONE)
    if not (
        display
        and egl.eglInitialize(display, None, None)
        and egl.eglChooseConfig(display, wanted, ctypes.byref(config), 1, ctypes.byref(count))
        and count.value
        and egl.eglBindAPI(OPENGL)
    ):
        raise AbsentError(NO_GL.format("EGL has no device without a window"))
    context = pointer(egl.eglCreateContext(display, config, None, None))
    if not context or not egl.eglMakeCurrent(display, None, None, context):
        raise AbsentError(NO_GL.format("EGL gives no context"))
