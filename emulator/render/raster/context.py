"""The way to OpenGL: the imports of pyrender and PyOpenGL, and contexts without a window.

PyOpenGL chooses its platform when it is first imported, by the variable PYOPENGL_PLATFORM: it is
set to "egl" for that import and put back, so that nobody has to set any variable.

Faults of pyrender2 0.2.2 and PyOpenGL 3.1.10 are worked around where FAULT says so, in this folder.
"""

from __future__ import annotations

import os
import warnings
from dataclasses import dataclass
from functools import cache
from typing import Any

from evs.msgs import EvsError

NO_EXTRA = 'the raster renderer needs {}, which is not installed: pip install "evs[raster]"'
NO_GL = (
    "the raster renderer needs OpenGL by EGL, and {}: "
    "apt install libegl1 libgl1 libgl1-mesa-dri (or the GPU's driver)"
)


@dataclass(frozen=True)
class GlLibrary:
    """What the imports brought."""

    pyrender: Any
    egl: Any
    """pyrender.platforms.egl"""
    gl: Any
    """OpenGL.GL"""
    shader_program: Any


@cache
def load_library() -> GlLibrary:
    """Import everything, once. Raises EvsError where a package or libEGL is missing."""
    before = os.environ.get("PYOPENGL_PLATFORM")
    os.environ["PYOPENGL_PLATFORM"] = "egl"
    try:
        with warnings.catch_warnings():
            # FAULT: both have escapes and calls that today's Python warns of
            warnings.simplefilter("ignore")
            import pyrender
            from OpenGL import GL
            from pyrender import shader_program
            from pyrender.platforms import egl
    except ModuleNotFoundError as missing:
        raise EvsError(NO_EXTRA.format(missing.name)) from None
    except Exception as reason:
        # without libEGL, PyOpenGL raises whatever it stumbles over
        raise EvsError(NO_GL.format(f"its libraries do not load ({one_line(reason)})")) from None
    finally:
        if before is None:
            del os.environ["PYOPENGL_PLATFORM"]
        else:
            os.environ["PYOPENGL_PLATFORM"] = before
    return GlLibrary(pyrender, egl, GL, shader_program)


def one_line(reason: BaseException | str) -> str:
    """The message of a foreign error, in at most 100 characters."""
    # an ImportError of PyOpenGL says the same several times over
    words = reason.args[0] if isinstance(reason, ImportError) and reason.args else reason
    return (" ".join(str(words).split()) or type(reason).__name__)[:100]


class Context:
    """An OpenGL context without any window: `with context:` makes it the thread's own meanwhile."""

    def __init__(self, library: GlLibrary) -> None:
        from OpenGL import EGL

        self._egl, self._process = EGL, os.getpid()
        reason = "no EGL device is there"
        for device in devices_of(library):
            platform = library.egl.EGLPlatform(1, 1, device)
            try:
                platform.init_context()
            except Exception as fault:
                reason = f"no device gives a context ({one_line(fault)})"
                continue
            finally:
                # FAULT: a platform that is collected terminates the display, and with it every
                # other context on it, at any moment: it keeps neither display nor context
                self._display, self._context = platform._egl_display, platform._egl_context
                platform._egl_display = platform._egl_context = None
            # it is current now, and shall not be
            none = EGL.EGL_NO_SURFACE, EGL.EGL_NO_SURFACE, EGL.EGL_NO_CONTEXT
            EGL.eglMakeCurrent(self._display, *none)
            return
        raise EvsError(NO_GL.format(reason))

    @property
    def is_inherited(self) -> bool:
        """Whether this process was forked from the one whose context it is."""
        return os.getpid() != self._process

    def __enter__(self) -> None:
        if self.is_inherited:
            # a driver's threads stay behind: the next call would wait for them for ever
            raise EvsError(
                "the raster renderer does not work in a forked process: make the world or camera "
                "there, or start processes with 'spawn'"
            )
        egl = self._egl
        surfaces = [egl.eglGetCurrentSurface(which) for which in (egl.EGL_DRAW, egl.EGL_READ)]
        self._before = (egl.eglGetCurrentDisplay(), *surfaces, egl.eglGetCurrentContext())
        none = (egl.EGL_NO_SURFACE,) * 2
        egl.eglMakeCurrent(self._display, *none, self._context)

    def __exit__(self, *_: object) -> None:
        # FAULT: make_uncurrent does nothing: the thread's own context, if any, would be lost
        egl, none = self._egl, (self._egl.EGL_NO_SURFACE,) * 2
        if self._before[3]:
            egl.eglMakeCurrent(*self._before)
        else:
            egl.eglMakeCurrent(self._display, *none, egl.EGL_NO_CONTEXT)

    def destroy(self) -> None:
        """Give it back."""
        self._egl.eglDestroyContext(self._display, self._context)


def devices_of(library: GlLibrary) -> list[Any]:
    """The devices that EGL knows: GPUs, and Mesa's software."""
    try:
        return list(library.egl.query_devices())
    except Exception as fault:
        raise EvsError(NO_GL.format(f"EGL lists no devices ({one_line(fault)})")) from None
