"""What all tests share: the same examples in every run, and robots that nobody here wrote."""

from __future__ import annotations

import gc
import signal
from collections import Counter
from collections.abc import Callable, Iterator
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, settings

# fails today, fails tomorrow, however busy the machine is that draws the examples;
# to search with new examples: --hypothesis-profile default
settings.register_profile(
    "steady", derandomize=True, deadline=None, suppress_health_check=[HealthCheck.too_slow]
)
settings.load_profile("steady")

# a job in the background is deaf to Ctrl-C, and so would be the programs that tests start and stop
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Begin with the files of most slow tests: in the end no process waits for a long one."""
    slow = Counter(item.path for item in items if item.get_closest_marker("slow"))
    items.sort(key=lambda item: -slow[item.path])


def pytest_collection_finish() -> None:
    """Search for garbage seldom, and never among the tests themselves: that takes half a second."""
    gc.collect()
    gc.freeze()
    gc.set_threshold(20_000, 10, 10)
    # evs emulate would thaw them
    for name in ("freeze", "unfreeze"):
        setattr(gc, name, lambda: None)


FOLDERS = {"gymnasium": "envs/mujoco/assets", "dm_control": "suite"}


def find_robot_files() -> dict[str, Path]:
    """Name to path of every MJCF with geometry, e.g. gymnasium/humanoid; nothing is imported."""
    found = {}
    for package, folder in FOLDERS.items():
        spec = find_spec(package)
        if spec is None or not spec.submodule_search_locations:
            continue
        root = Path(spec.submodule_search_locations[0], folder)
        for path in sorted(root.rglob("*.xml")):
            if "<geom" in path.read_text():
                found[f"{package}/{path.relative_to(root).with_suffix('')}"] = path
    return found


@pytest.fixture(scope="session")
def robot_files() -> dict[str, Path]:
    """Every MJCF with geometry of the installed gymnasium and dm_control, by name."""
    found = find_robot_files()
    assert any(name.startswith("gymnasium/") for name in found), "pip install gymnasium"
    return found


def rays_of(camera: Any) -> np.ndarray:
    """(h, w, 3) unit directions through the pixels' centres, in the camera's frame.

    Written anew from CameraModel's contract, for a perspective camera with an ideal lens.
    """
    x, y = np.meshgrid(np.arange(camera.width) + 0.5, np.arange(camera.height) + 0.5)
    d = np.stack([(x - camera.cx) / camera.fx, -(y - camera.cy) / camera.fy, -np.ones_like(x)], -1)
    return d / np.linalg.norm(d, axis=-1, keepdims=True)


@pytest.fixture(scope="session")
def mujoco_beside() -> Iterator[Any]:
    """MuJoCo's classic renderer, with whose picture `beside` compares ours (MujocoPictures)."""
    # what other tests never need
    from reference.mujoco_picture import mujoco_pictures

    with mujoco_pictures() as pictures:
        yield pictures


@pytest.fixture
def link() -> Iterator[Any]:
    """Two network namespaces with a cable between them, for this test alone."""
    # what other tests never need
    from links.link import Link, NoLinkError

    try:
        made = Link()
    except NoLinkError as reason:
        pytest.skip(str(reason))
    with made:
        yield made


@pytest.fixture(scope="session")
def camera_rays() -> Callable[[Any], np.ndarray]:
    """The independent statement of which ray belongs to a pixel: rays_of(CameraModel)."""
    return rays_of
