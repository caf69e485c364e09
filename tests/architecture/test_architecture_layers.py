"""Imports point one way, and each third-party library has one door."""

from __future__ import annotations

import ast
import re
import sys
import tomllib
from collections.abc import Iterator
from pathlib import Path

import pytest

LEVEL = {"msgs": 0, "emulator": 1, "drivers": 2, "tools": 3, "examples": 4, "launch": 5, "lab": 6}
"""lab is evs_lab, a distribution of its own, of which evs knows nothing."""

DOORS = {
    "numpy": ("msgs/", "emulator/", "drivers/", "tools/", "examples/", "lab/"),
    # a plugin for MuJoCo's own viewer
    "mujoco": ("emulator/world/", "examples/studio/"),
    "msgpack": ("msgs/packet.py",),
    # packages whose names stand in a stub
    "lazy_loader": (
        "emulator/core/",
        "emulator/__init__.py",
        "emulator/render/__init__.py",
        "msgs/__init__.py",
        "tools/testing/__init__.py",
    ),
    "msgspec": ("emulator/config/decoding.py",),
    "zmq": ("drivers/bus/",),
    "h5py": ("drivers/files/hdf5/",),
    "hdf5plugin": ("drivers/files/hdf5/",),
    "rosbags": ("drivers/files/bags/",),
    "cyclonedds": ("drivers/ros2/middleware.py",),
    "flatbuffers": ("drivers/files/aedat4/",),
    "lz4": ("drivers/files/aedat4/",),
    "zstandard": ("drivers/files/aedat4/",),
    "PIL": ("drivers/pictures/",),
    "imageio_ffmpeg": ("drivers/pictures/",),
    "av": ("drivers/films/decoder.py",),
    "rich": ("launch/support/terminal.py",),
    "rerun": ("drivers/viewer/rerun_drawing.py",),
    "websockets": ("drivers/viewer/web/server.py",),
    "foxglove": ("drivers/viewer/foxglove_drawing.py",),
    "matplotlib": ("drivers/pictures/chart.py",),
    "cv2": ("lab/fit/film.py",),
    "pyrender": ("emulator/render/raster/",),
    "OpenGL": ("emulator/render/raster/",),
    "cuda": ("emulator/base/gpu/driver.py",),
    "jax": ("lab/training/",),
    "optax": ("lab/training/",),
    "onnxruntime": ("emulator/evsnet/session.py",),
    "gymnasium": ("drivers/gym/",),
    "stable_baselines3": ("drivers/gym/stable_baselines.py",),
    "ray": ("tools/jobs/ray_cluster.py", "tools/jobs/ray_batches.py"),
    "argcomplete": ("launch/support/completion.py",),
    "pytest": ("tools/testing/plugin.py",),
}
"""Import name -> the only places that may import it. What is not listed may not be imported."""

EXTRAS = (
    *("raster", "gym", "video", "view", "web", "foxglove", "formats", "ros2", "cluster"),
    *("completion", "cuda", "plot"),
)
"""Whose libraries the package imports; those of the others are for tests and tools."""

OUTSIDE = {
    *("asyncio", "ftplib", "http", "mmap", "multiprocessing", "select", "selectors", "shelve"),
    *("smtplib", "socket", "socketserver", "sqlite3", "ssl", "subprocess", "urllib"),
}
"""Standard modules that reach outside: not below drivers."""

REGISTERED = re.compile(r"evs(_lab)?(\.\w+)+:\w+")
"""An entry of a registry."""

REGISTRY_DOOR = "msgs/registry.py"
"""Where the entries of every registry are imported."""

CLOCKS = {"datetime", "sched", "time", "timeit"}
CLOCK_DOOR = "drivers/clock.py"


def imported(tree: ast.Module) -> Iterator[tuple[int, str]]:
    """(line, dotted name) of everything a module imports, also inside functions and by name.

    A string "module:name" counts as an import: it stands in a registry.
    """
    constants = {
        ast.unparse(node.targets[0]): node.value.value
        for node in tree.body
        if isinstance(node, ast.Assign) and isinstance(node.value, ast.Constant)
    }
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from ((node.lineno, alias.name) for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            dots = "." * node.level
            yield from ((node.lineno, f"{dots}{node.module or ''}.{a.name}") for a in node.names)
        elif isinstance(node, ast.Constant) and REGISTERED.fullmatch(str(node.value)):
            yield node.lineno, str(node.value).partition(":")[0]
        elif isinstance(node, ast.Call) and (
            getattr(node.func, "attr", None) or getattr(node.func, "id", None)
        ) in ("import_module", "__import__"):
            # written out, or a constant of this module; "?" for what only running it tells
            name = node.args[0] if node.args else None
            told = name.value if isinstance(name, ast.Constant) else None
            told = constants.get(name.id) if isinstance(name, ast.Name) else told
            yield node.lineno, told if isinstance(told, str) else "?"


def faults(path: str, tree: ast.Module) -> list[str]:
    """What is wrong with the imports of one module, one line each."""
    layer = path.split("/")[0]
    found = []
    for line, name in imported(tree):
        top, _, rest = name.partition(".")
        inner = rest.split(".")[0]
        wrong = ""
        if name == "?":
            # the table of commands, and the door of all other tables
            known = layer == "launch" or path == REGISTRY_DOOR
            wrong = "" if known else "imports a name that is not written out"
        elif not top or top in LEVEL:
            package = "evs_lab" if top == "lab" else f"evs.{name.lstrip('.')}"
            wrong = f"imports {name}: write {package}"
        elif top == "evs_lab":
            wrong = "" if layer == "lab" else f"imports {name}: nothing in evs imports evs-lab"
        elif top == "evs":
            if inner in LEVEL and LEVEL[inner] > LEVEL[layer]:
                wrong = f"{layer} imports {name}: layers point {' -> '.join(reversed(LEVEL))}"
            elif inner not in LEVEL and inner != "__version__":
                wrong = f"imports {name}: inside the package name the layer"
        elif top in CLOCKS:
            wrong = "" if path == CLOCK_DOOR else f"reads the clock ({name}): use {CLOCK_DOOR}"
        elif top in OUTSIDE:
            wrong = f"{layer} imports {name}: it reaches outside" if LEVEL[layer] < 2 else ""
        elif top not in sys.stdlib_module_names and not path.startswith(DOORS.get(top, ())):
            doors = DOORS.get(top)
            wrong = f"imports {top}: its door is {doors or 'not in the table'}"
        if wrong:
            found.append(f"{path}:{line}: {wrong}")
    return found


def test_every_import_of_the_package_points_down_and_through_its_door(
    sources: dict[str, ast.Module],
) -> None:
    assert sources
    assert [line for path, tree in sources.items() for line in faults(path, tree)] == []


def test_no_test_of_evs_imports_evs_lab(checkout: Path, files: list[str]) -> None:
    tests = [name for name in files if name.startswith("tests/") and name.endswith(".py")]
    texts = {path: (checkout / path).read_text() for path in tests}
    assert texts
    assert [
        f"{path}:{line}"
        for path, text in texts.items()
        if "evs_lab" in text
        for line, name in imported(ast.parse(text))
        if name.split(".")[0] == "evs_lab"
    ] == []


@pytest.mark.parametrize(
    ("path", "source", "says"),
    [
        ("msgs/a.py", "from evs.emulator import scene", "layers point"),
        ("emulator/a.py", "def f():\n    import evs.drivers.bus", "layers point"),
        ("drivers/a.py", "from evs.launch import main", "layers point"),
        ("drivers/a.py", "import importlib\nimportlib.import_module('evs.launch.main')", "layers"),
        ("drivers/a.py", "importlib.import_module(name)", "not written out"),
        ("drivers/a.py", "NAME = 'evs.launch.main'\nimportlib.import_module(NAME)", "layers"),
        ("drivers/a.py", "SINKS = {'a': 'evs.tools.jobs.job:Job'}", "layers point"),
        ("drivers/a.py", "from evs.examples import pencil", "layers point"),
        ("drivers/a.py", "from evs import World", "name the layer"),
        ("launch/a.py", "import drivers.bus", "write evs.drivers.bus"),
        ("launch/a.py", "from . import main", "write evs."),
        ("drivers/a.py", "import mujoco", "emulator/world/"),
        ("emulator/world/a.py", "import zmq", "drivers/bus/"),
        ("emulator/a.py", "import scipy", "not in the table"),
        ("launch/a.py", "import numpy", "msgs/"),
        ("launch/a.py", "from time import monotonic", "reads the clock"),
        ("drivers/run/run.py", "import datetime", "reads the clock"),
        ("emulator/a.py", "import socket", "reaches outside"),
        ("msgs/a.py", "from urllib.request import urlopen", "reaches outside"),
        ("launch/a.py", "def f():\n    from evs_lab import metrics", "nothing in evs imports"),
        ("tools/a.py", "CASES = {'a': 'evs_lab.stress.light:CASES'}", "nothing in evs imports"),
        ("lab/a.py", "from lab import metrics", "write evs_lab"),
    ],
)
def test_a_wrong_import_is_found(path: str, source: str, says: str) -> None:
    found = faults(path, ast.parse(source))
    assert len(found) == 1
    assert says in found[0]


@pytest.mark.parametrize(
    ("path", "source"),
    [
        ("launch/a.py", "from evs.drivers.bus import subscribe\nimport argparse"),
        ("launch/main.py", "importlib.import_module(f'evs.launch.commands.{name}')"),
        ("drivers/a.py", "CORE = 'evs.emulator._core'\nimportlib.import_module(CORE)"),
        ("drivers/a.py", "SINKS = {'a': 'evs.drivers.bus:Publisher'}\nload(SINKS['a'])"),
        ("emulator/world/a.py", "import mujoco\nimport numpy as np"),
        ("drivers/clock.py", "import time"),
        ("drivers/bus/a.py", "import socket\nimport zmq"),
        ("drivers/run/report.py", "from evs import __version__"),
        ("lab/sweep/a.py", "from evs.launch.support import terminal\nimport evs_lab.metrics"),
    ],
)
def test_a_right_import_passes(path: str, source: str) -> None:
    assert faults(path, ast.parse(source)) == []


def test_nothing_is_named_after_a_library(files: list[str]) -> None:
    libraries = {name.lower() for name in DOORS} | {"pillow", "pyzmq"}
    parts = {
        part.lower()
        for name in files
        if name.split("/")[0] in LEVEL
        for part in Path(name).with_suffix("").parts
    }
    assert parts & libraries == set()


def test_the_core_reads_no_clock(checkout: Path, files: list[str]) -> None:
    clock = re.compile(r"<(chrono|ctime|time\.h|sys/time\.h)>|clock_gettime|gettimeofday|__rdtsc")
    native = [name for name in files if name.startswith("emulator/core/")]
    assert [name for name in native if clock.search((checkout / name).read_text())] == []


def test_every_library_behind_a_door_is_a_declared_requirement(checkout: Path) -> None:
    project, lab = (
        tomllib.loads((checkout / folder / "pyproject.toml").read_text())["project"]
        for folder in (".", "lab")
    )
    extras = project["optional-dependencies"]
    declared = project["dependencies"] + [r for name in EXTRAS for r in extras[name]]
    declared += lab["dependencies"][1:] + lab["optional-dependencies"]["train"]
    names = {re.split(r"[^\w-]", requirement)[0].replace("-", "_") for requirement in declared}
    # found by cuda-bindings
    names -= {"nvidia_cuda_nvrtc"}
    # pyrender brings its own OpenGL, pytest and Stable-Baselines3 are there when they load ours
    names |= {"PyOpenGL", "pytest", "stable_baselines3"}
    packages = {"PIL": "pillow", "zmq": "pyzmq", "OpenGL": "PyOpenGL", "rerun": "rerun_sdk"}
    packages |= {
        "foxglove": "foxglove_sdk",
        "cuda": "cuda_bindings",
        "cv2": "opencv_python_headless",
    }
    packages |= {"pyrender": "pyrender2"}
    imports = {packages.get(name, name) for name in DOORS}
    assert imports == names
