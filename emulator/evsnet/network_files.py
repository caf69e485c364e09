"""Trained networks on disk: NAME.onnx holds the weights, NAME.toml beside it holds what they mean.

The graph's initialisers are named encoder.weight (C, 1, 7, 1), blocks.0.first.weight (C, C, 7, 1),
blocks.0.second.weight, ..., last.weight (1, C, 1, 1), and .bias where there is one. The sidecar:

    name = "evsnet_c8"
    tau_s = 0.5
    threshold = 0.2
    linlog_dn = 2.718281828459045
    tick_us = 1000
    spp = [1, 64]
    look_ahead = [0, 0, 0, 0, 0, 0, 0]    # one a convolution
    events_per_tick = "one"               # or "many"; without it: one

and a table [training], which is for people.

Networks of one design, each trained on light of another number of samples, are a family: the files
NAME_1spp.onnx, NAME_4spp.onnx ... are the members of family NAME. Light of few samples needs a
network that averages long, light of many one that does not: a camera takes the member whose samples
come nearest to its own.
"""

from __future__ import annotations

import math
import re
import tomllib
from collections.abc import Callable, Iterable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any, TypeVar

from evs.emulator.base.scene import F32
from evs.emulator.base.small_files import read_small_text
from evs.emulator.evsnet.bilif import EVENTS_PER_TICK
from evs.emulator.evsnet.graph_network import Network, read_graph_network
from evs.emulator.evsnet.onnx_graph import initialisers
from evs.emulator.evsnet.weights import KERNEL_SIZE, Block, Convolution, NetworkWeights
from evs.msgs import EvsError, nearest_first, unknown

_OURS = {"encoder.weight", "last.weight"}
"""a graph with neither is of another design: a GraphNetwork, for runtime onnxruntime alone"""
MAX_BYTES = 64 * 2**20
"""the largest network has 8 MB"""

# config/ lies beside emulator/, in the wheel as in the checkout; links are not followed
_NETWORKS = Path(__file__).absolute().parents[2] / "config" / "networks"


def network_names() -> list[str]:
    """Names of the networks that come with evs, in alphabetical order; not of their families."""
    return sorted(path.stem for path in _NETWORKS.glob("*.onnx"))


def network_path(network: str, spp: int = 0) -> Path:
    """Find the .onnx file of a network that comes with evs, or of the user's own.

    Args:
        network: A name, that of a family, or a path (it ends in .onnx or has a slash in it).
        spp: Samples a pixel of the light, for which a family has a member; 0: the light has no
            noise.

    Raises:
        EvsError: There is none.
    """
    if network.endswith(".onnx") or "/" in network:
        path = Path(network)
        with suppress(RuntimeError):  # ~nobody
            path = path.expanduser()
        if not _is_file(path):
            shipped = ", ".join([*families(network_names()), *network_names()])
            raise EvsError(f"no network file {path}; give a .onnx file or one of: {shipped}")
        return path
    names = network_names()
    if network not in names:
        found = members(network, names)
        if not found:
            raise unknown("network", network, [*families(names), *names])
        network = nearest_member(found, spp)
    return _NETWORKS / f"{network}.onnx"


def load_network(network: str, spp: int = 0) -> Network:
    """The network of that name or path, as in `network_path`. Raises EvsError."""
    return read_network(network_path(network, spp))


def read_network(path: Path) -> Network:
    """The network of a .onnx file and the sidecar beside it.

    Raises EvsError, one line: no file, damaged, weights that are missing or of another shape or
    not finite; no sidecar, a key that is missing, unknown or without sense.
    """
    if not _is_file(path):
        raise EvsError(f"no network file {path}")
    sidecar = _sidecar(path.with_suffix(".toml"))
    try:
        size = path.stat().st_size
        if size > MAX_BYTES:
            raise EvsError(f"network file {path} has {size} bytes; {MAX_BYTES} is the most")
        graph = path.read_bytes()
        tensors = initialisers(graph)
    except OSError as reason:
        raise EvsError(f"cannot read network file {path}: {reason.strerror}") from None
    except ValueError as reason:
        raise EvsError(f"network file {path}: {reason}") from None
    if _OURS.isdisjoint(tensors):
        # only onnxruntime can read what it is
        try:
            return read_graph_network(graph, sidecar)
        except EvsError as error:
            raise EvsError(f"network file {path}: {error}") from None
    return _Assembly(path, tensors, sidecar["look_ahead"]).network(sidecar)


def _is_file(path: Path) -> bool:
    try:
        return path.is_file()
    except OSError:  # a name that is too long, a folder that is not ours
        return False


class _Assembly:
    """Puts the tensors of one file together."""

    def __init__(self, path: Path, tensors: Mapping[str, F32], look_ahead: list[int]) -> None:
        self.path, self.tensors, self.look_ahead = path, tensors, look_ahead

    def network(self, sidecar: Mapping[str, Any]) -> NetworkWeights:
        numbers = [re.match(r"blocks\.(\d{1,6})\.", name) for name in self.tensors]
        blocks = 1 + max((int(found[1]) for found in numbers if found), default=-1)
        convolutions = 1 + 2 * blocks
        if len(self.look_ahead) != convolutions:
            raise EvsError(
                f"network file {self.path} has {convolutions} convolutions, look_ahead in its "
                f"sidecar {len(self.look_ahead)} numbers; give one for each"
            )
        last = self._tensor("last.weight", (1, None, 1, 1))[0, :, 0, 0]
        channels = last.shape[0]
        bias = self._tensor("last.bias", (1,))[0] if "last.bias" in self.tensors else 0.0
        fields = {key: value for key, value in sidecar.items() if key in _FIELDS}
        try:
            return NetworkWeights(
                name=sidecar["name"],
                encoder=self._convolution(0, "encoder", channels, 1),
                blocks=tuple(
                    Block(
                        self._convolution(2 * i + 1, f"blocks.{i}.first", channels, channels),
                        self._convolution(2 * i + 2, f"blocks.{i}.second", channels, channels),
                    )
                    for i in range(blocks)
                ),
                last=last.copy(),
                last_bias=float(bias),
                **fields,
            )
        except EvsError as error:
            message = str(error)
            shown = message if str(self.path) in message else f"{self.path}: {message}"
            raise EvsError(shown) from None

    def _convolution(self, index: int, name: str, outputs: int, inputs: int) -> Convolution:
        weight = self._tensor(f"{name}.weight", (outputs, inputs, KERNEL_SIZE, 1))[..., 0].copy()
        key = f"{name}.bias"
        bias = self._tensor(key, (outputs,)) if key in self.tensors else None
        return Convolution(weight, bias, self.look_ahead[index])

    def _tensor(self, name: str, shape: tuple[int | None, ...]) -> F32:
        """The initialiser of that name, of that shape; None stands for any size."""
        if name not in self.tensors:
            raise EvsError(
                f"network file {self.path} has no float32 initialiser '{name}'; write it with "
                "`evs train`, or name its weights so"
            )
        tensor = self.tensors[name]
        sizes = zip(tensor.shape, shape, strict=False)
        if tensor.ndim != len(shape) or any(b not in (a, None) for a, b in sizes):
            wanted = ", ".join("C" if size is None else str(size) for size in shape)
            wanted += "," if len(shape) == 1 else ""
            raise EvsError(
                f"network file {self.path}: {name} is {tensor.shape}; it must be ({wanted})"
            )
        return tensor


def _sidecar(path: Path) -> dict[str, Any]:
    """The values of a sidecar, each of its type."""
    try:
        text = read_small_text(path)
        values = tomllib.loads(text)
    except FileNotFoundError:
        raise EvsError(
            f"network file {path.with_suffix('.onnx')} has no {path.name} beside it"
        ) from None
    except (ValueError, RecursionError) as reason:
        line = str(reason).splitlines()[0]
        raise EvsError(f"network sidecar {path} is not TOML: {line}") from None
    except OSError as reason:
        raise EvsError(f"cannot read network sidecar {path}: {reason.strerror}") from None
    for key in values:
        if key not in _KEYS:
            nearest = nearest_first(key, _KEYS)[0]
            raise EvsError(f"network sidecar {path}: no key {key!r}; there is {nearest}")
    for key, (what, fits) in _KEYS.items():
        if key not in values:
            if key in _OPTIONAL:
                continue
            raise EvsError(f"network sidecar {path} lacks {key}; give {what}")
        if not fits(values[key]):
            raise EvsError(f"network sidecar {path}: {key} is {values[key]!r}; give {what}")
    values["spp"] = tuple(values["spp"])
    values.setdefault("events_per_tick", "one")
    return values


def _is_int(value: Any) -> bool:
    return isinstance(value, int) and not isinstance(value, bool) and abs(value) < 2**53


def _is_ints(value: Any) -> bool:
    return isinstance(value, list) and all(_is_int(entry) for entry in value)


def _is_real(value: Any) -> bool:
    return _is_int(value) or isinstance(value, float)


def _is_name(value: Any) -> bool:
    return isinstance(value, str) and 0 < len(value) <= 100 and value.isprintable()


_FIELDS = ("tau_s", "threshold", "linlog_dn", "tick_us", "spp", "events_per_tick")
_KEYS: dict[str, tuple[str, Callable[[Any], bool]]] = {
    "name": ("a line of text", _is_name),
    "tau_s": ("seconds", _is_real),
    "threshold": ("log units", _is_real),
    "linlog_dn": ("DN over 1", _is_real),
    "tick_us": ("whole microseconds", _is_int),
    "spp": ("[fewest, most]", lambda value: _is_ints(value) and len(value) == 2),
    "look_ahead": ("[ticks, one for each convolution]", _is_ints),
    "events_per_tick": (" or ".join(EVENTS_PER_TICK), lambda value: value in list(EVENTS_PER_TICK)),
    "training": ("a table", lambda value: isinstance(value, dict)),
}
"""key -> what it is, and whether a value is one"""
_OPTIONAL = ("events_per_tick", "training")


T = TypeVar("T")

MEMBER = re.compile(r"(?P<family>.+)_(?P<spp>[1-9][0-9]{0,5})spp")


def members(family: str, names: Iterable[str]) -> dict[int, str]:
    """Samples a pixel -> name, of the networks that belong to a family, in order."""
    found = {}
    for name in names:
        parts = MEMBER.fullmatch(name)
        if parts is not None and parts["family"] == family:
            found[int(parts["spp"])] = name
    return dict(sorted(found.items()))


def families(names: Iterable[str]) -> list[str]:
    """Names of the families that these networks belong to, in alphabetical order."""
    return sorted({parts["family"] for name in names if (parts := MEMBER.fullmatch(name))})


def nearest_member(found: Mapping[int, T], spp: int) -> T:
    """The member for light with this number of samples per pixel; 0: light without noise.

    The nearest by ratio; of two that are as near, the one of fewer samples.
    """
    if spp == 0:
        return found[max(found)]
    return found[min(found, key=lambda own: (abs(math.log2(own / spp)), own))]
