"""robosuite's Panda at its table: MJCF and meshes from its wheel, which is never imported.

`pip download` fetches the wheel once (150 MB); the files that are needed are kept in build/.
"""

from __future__ import annotations

import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import mujoco
import numpy as np

from speed.elsewhere import AbsentError
from speed.view import View, view_of

ASSETS = "robosuite/models/assets/"
NEEDED = ("robots/panda/", "arenas/table_arena.xml", "textures/")
MISSING = "robosuite's wheel cannot be fetched ({}): go online once, or put it into build/robosuite"
# as in robosuite: PandaRobot.init_qpos, and the place of its base behind a table of 0.8 m
HOME = [0.0, np.pi / 16, 0.0, -np.pi / 2 - np.pi / 3, 0.0, np.pi - 0.2, np.pi / 4]
BASE = [-0.56, 0.0, 0.912]
EYE, LOOKAT = np.array([0.45, -0.75, 1.45]), np.array([-0.28, 0.0, 1.25])


def panda(checkout: Path, shadows: bool) -> View:
    """View the arm in its first pose by a camera whose height it nearly fills.

    Args:
        checkout: The root of the repository.
        shadows: Whether the lamp casts shadows, which robosuite's does not.

    Raises:
        AbsentError: If the wheel cannot be fetched.
    """
    model = panda_model(fetch_assets(checkout))
    model.light_castshadow[:] = shadows
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    return view_of(model, data, "bench")


def panda_model(assets: Path) -> mujoco.MjModel:
    """Make the model: 141 k triangles, 127 k visible; camera `bench`, keyframe 0 as first pose."""
    scene = mujoco.MjSpec.from_file(str(assets / "arenas/table_arena.xml"))
    arm = mujoco.MjSpec.from_file(str(assets / "robots/panda/robot.xml"))
    scene.attach(arm, frame=scene.worldbody.add_frame(pos=BASE), prefix="robot_")
    # group 0 collides; robosuite hides it, MuJoCo would show it in the place of the visible geoms
    for geom in scene.geoms:
        geom.group = 3 if geom.group == 0 else geom.group
    forward = LOOKAT - EYE
    right = np.cross(forward, [0.0, 0.0, 1.0])
    axes = np.stack([right, np.cross(right, forward), -forward], 1)
    quat = np.zeros(4)
    mujoco.mju_mat2Quat(quat, (axes / np.linalg.norm(axes, axis=0)).ravel())
    scene.worldbody.add_camera(name="bench", pos=EYE, quat=quat, fovy=45)
    scene.add_key(name="home", qpos=HOME, ctrl=np.zeros(len(HOME)))
    return scene.compile()


def fetch_assets(checkout: Path) -> Path:
    """Unpack the wheel and return the folder of its MJCF files.

    Raises:
        AbsentError: If the wheel cannot be fetched.
    """
    folder = checkout / "build" / "robosuite"
    done = folder / "unpacked"
    if not done.exists():
        given = next(folder.glob("robosuite-*.whl"), None)
        wheel = given or download(folder, checkout)
        with zipfile.ZipFile(wheel) as archive:
            shutil.rmtree(folder / "robosuite", ignore_errors=True)
            needed = tuple(ASSETS + name for name in NEEDED)
            archive.extractall(folder, [n for n in archive.namelist() if n.startswith(needed)])
        if not given:
            wheel.unlink()
        done.touch()
    return folder / ASSETS


def download(folder: Path, checkout: Path) -> Path:
    """Download the pinned wheel into `folder`.

    Raises:
        AbsentError: If pip cannot fetch it.
    """
    folder.mkdir(parents=True, exist_ok=True)
    print("\nfetching robosuite's wheel, 150 MB, once")
    pins = (checkout / ".ci/constraints.txt").read_text().splitlines()
    pinned = next(line for line in pins if line.startswith("robosuite=="))
    fetched = subprocess.run(
        [
            *(sys.executable, "-m", "pip", "download", "-q", "--disable-pip-version-check"),
            *("--no-input", "--no-deps", "--timeout", "10", "--retries", "1"),
            *("-d", str(folder), pinned),
        ],
        capture_output=True,
        text=True,
        check=False,
    )
    wheel = next(folder.glob("robosuite-*.whl"), None)
    if fetched.returncode or wheel is None:
        said = fetched.stderr.strip().splitlines() or ["pip said nothing"]
        raise AbsentError(MISSING.format(said[-1]))
    return wheel
