"""The first import of MuJoCo, which brings more with it than evs needs.

glfw reads its library's version in a process of its own, `python -c`, which would import a
ctypes.py that lies in the working directory. With MUJOCO_GL set, MuJoCo loads OpenGL and may fail
in it.
"""

from __future__ import annotations

import os

from evs.msgs import EvsError

_VARIABLE = "PYTHONSAFEPATH"


def import_mujoco() -> None:
    """Import it safely. Raises EvsError where what MUJOCO_GL names does not load."""
    before = os.environ.get(_VARIABLE)
    os.environ[_VARIABLE] = "1"
    try:
        import mujoco  # noqa: F401
    except ImportError:
        raise
    except Exception as reason:
        chosen = os.environ.get("MUJOCO_GL")
        if chosen is None:
            raise
        line = " ".join(str(reason).split())[:100]
        raise EvsError(
            f"MuJoCo does not load with MUJOCO_GL={chosen} ({line}): unset MUJOCO_GL, which evs "
            "does not need, or install the OpenGL that it names"
        ) from None
    finally:
        if before is None:
            del os.environ[_VARIABLE]
        else:
            os.environ[_VARIABLE] = before


import_mujoco()
