"""Check the native core, the required packages and the installed extras."""

from __future__ import annotations

import importlib.metadata
import re
from collections.abc import Iterable

from evs.tools.doctor.check import BAD, NOTE, OK, Check

CORE = (
    "mujoco",
    "numpy",
    "onnxruntime",
    "pyzmq",
    "msgpack",
    "msgspec",
    "flatbuffers",
    "lz4",
    "zstandard",
    "rich",
    "pillow",
    "lazy-loader",
)
"""required distributions: `dependencies` of pyproject.toml (a test compares them)"""

OPTIONAL = {"onnxruntime": "model.runtime=onnxruntime"}
"""required distribution that has no wheel for every machine -> what does not work without it"""

EXTRAS = {
    "raster": ("pyrender2",),
    "gym": ("gymnasium",),
    "video": ("imageio-ffmpeg", "av"),
    "view": ("rerun-sdk",),
    "web": ("websockets",),
    "foxglove": ("foxglove-sdk",),
    "plot": ("matplotlib",),
    "formats": ("h5py", "hdf5plugin"),
    "ros2": ("rosbags", "cyclonedds"),
    "cluster": ("ray",),
    "completion": ("argcomplete",),
    "cuda": ("cuda-bindings", "nvidia-cuda-nvrtc"),
}
"""extra -> its distributions: `optional-dependencies` of pyproject.toml for users"""

USES = {
    "raster": "the raster renderer",
    "gym": "evs.drivers.gym and evs demo",
    "video": ".mp4 films, films and frames in evs convert",
    "view": "Rerun's viewer and .rrd files",
    "web": "the page of evs emulate --view and evs view --web",
    "foxglove": "Foxglove's server and MCAP files",
    "plot": "charts of evs loop goalie",
    "formats": ".h5 recordings",
    "ros2": ".mcap and .bag recordings, ROS 2",
    "cluster": "jobs on a Ray cluster",
    "completion": "evs completion",
    "cuda": "render.device=cuda, model.device=cuda",
}
"""extra -> what it is for"""


def check_core() -> Check:
    """The native core: that it loads, and which instruction sets it can use here."""
    try:
        from evs.emulator import _core
    except ImportError as reason:
        words = " ".join(str(reason).split())
        return Check("native core", BAD, words, "build it again: make dev, or pip install evs")
    sets = _core.isa_available()
    says = f"uses {sets[0]}, the fastest of {', '.join(sets)}"
    if sets == ["portable"]:
        return Check("native core", NOTE, says, "a CPU with AVX2 is several times faster")
    return Check("native core", OK, says)


def check_packages(names: Iterable[str] = CORE) -> list[Check]:
    """A check for each required distribution."""
    return [_needed(name) for name in names]


def check_extras() -> list[Check]:
    """A check for each extra; a missing one is not a fault."""
    return [_extra(extra, names) for extra, names in EXTRAS.items()]


def version_of(name: str) -> str | None:
    """Installed version of a distribution; None: it is not installed."""
    try:
        return importlib.metadata.version(name)
    except importlib.metadata.PackageNotFoundError:
        return None


def range_of(name: str) -> str:
    """Versions of a distribution that evs requires, such as ">=3.3,<5"; "": unknown.

    They come from the metadata of the installed evs, that is from pyproject.toml.
    """
    try:
        lines = importlib.metadata.requires("evs") or []
    except importlib.metadata.PackageNotFoundError:
        return ""
    found = (re.match(r"([\w.-]+)[^<>=;]*([<>=][^;)]*)?", line) for line in lines)
    ranges = {_plain(one[1]): (one[2] or "").strip() for one in found if one}
    return ranges.get(_plain(name), "")


def in_range(version: str, required: str) -> bool:
    """Whether a version lies in a range of >= and <, the signs that pyproject.toml uses."""
    for sign, bound in re.findall(r"(>=|<)\s*([\d.]+)", required):
        if (_numbers(version) < _numbers(bound)) == (sign == ">="):
            return False
    return True


def _plain(name: str) -> str:
    return re.sub(r"[-_.]+", "-", name).lower()


def _numbers(version: str) -> tuple[int, ...]:
    """(4, 0) of "4.0.0rc1": without zeros at the end, which mean nothing."""
    release = re.match(r"[\d.]*", version)
    numbers = [int(part) for part in (release[0] if release else "").split(".") if part]
    while numbers and not numbers[-1]:
        del numbers[-1]
    return tuple(numbers)


def _needed(name: str) -> Check:
    version = version_of(name)
    if version is None and name in OPTIONAL:
        says = f"not installed, needed for {OPTIONAL[name]}"
        return Check(name, NOTE, says, f"pip install {name}")
    if version is None:
        return Check(name, BAD, "not installed", f"pip install {name}")
    required = range_of(name)
    if not in_range(version, required):
        return Check(
            name, BAD, f"{version}, evs needs {required}", f"pip install '{name}{required}'"
        )
    return Check(name, OK, version)


def _extra(extra: str, names: tuple[str, ...]) -> Check:
    versions = {name: version_of(name) for name in names}
    missing = [name for name, version in versions.items() if version is None]
    title = f"extra {extra}"
    if missing:
        says = f"{', '.join(missing)} not installed, needed for {USES[extra]}"
        return Check(title, NOTE, says, f"pip install 'evs[{extra}]'")
    for name, version in versions.items():
        required = range_of(name)
        if version is not None and not in_range(version, required):
            says = f"{name} {version}, evs needs {required} for {USES[extra]}"
            return Check(title, NOTE, says, f"pip install '{name}{required}'")
    return Check(title, OK, ", ".join(f"{name} {version}" for name, version in versions.items()))
