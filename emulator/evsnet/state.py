"""NetworkState: what EvSNet remembers from tick to tick. A value."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from evs.emulator.base.arrays import Arrays, same_bytes
from evs.emulator.base.memory_limits import memory_gb
from evs.emulator.base.scene import F32
from evs.emulator.evsnet.bilif import I64
from evs.emulator.evsnet.graph_network import GraphNetwork, Network
from evs.emulator.evsnet.weights import KERNEL_SIZE, MAX_CURRENT
from evs.msgs import EvsError

MAX_TICKS = 2**52
"""How many ticks a sensor may live: 142 years of 1 ms are 2^42"""
MAX_COUNT = 2**62
MAX_V = 64.0
MAX_LOG = 128.0
"""L_log of no float32 is larger"""
_LARGEST = float(np.finfo(np.float32).max)

_FRAMES = {
    "last_luminance": np.float32,
    "last_log": np.float32,
    "v": np.float32,
    "last": np.int64,
}
_NUMBERS = ("ticks", "clamped", "x_clamped", "v_clamped")
_WORDS = ("runtime", "network")


@dataclass(eq=False)
class NetworkState:
    """State of (h, w) pixels: four arrays that every runtime has, and those of its own.

    Arrays may be replaced by others; no two states share one.
    """

    seed: int
    """the initial membranes follow from it"""
    runtime: str
    """whose arrays these are"""
    network: str
    """name and digest of the weights, as in `identity`"""
    arrays: dict[str, np.ndarray[Any, Any]]
    """by name: last_luminance, last_log, v, last, and the runtime's"""
    ticks: int = 0
    """how many there were; the number of the next one"""
    clamped: int = 0
    """pixels times ticks whose light was none and was replaced by the last one"""
    x_clamped: int = 0
    """whose X was over 20 and was clamped"""
    v_clamped: int = 0
    """whose membrane was over 64 and was clamped"""

    @classmethod
    def dark(
        cls, seed: int, runtime: str, network: str, v0: F32, own: Mapping[str, np.ndarray[Any, Any]]
    ) -> NetworkState:
        """Make the state of pixels that have seen no light yet.

        Args:
            seed: What v0 follows from.
            runtime: Name of the runtime.
            network: Identity of the network.
            v0: (h, w) float32, the first membrane potentials.
            own: The runtime's own arrays.
        """
        arrays: dict[str, np.ndarray[Any, Any]] = {
            "last_luminance": np.full(v0.shape, -1.0, np.float32),
            "last_log": np.full(v0.shape, np.nan, np.float32),
            "v": np.array(v0, np.float32),
            "last": np.zeros(v0.shape, np.int64),
        }
        return cls(seed, runtime, network, {**arrays, **own})

    @property
    def clamps(self) -> int:
        """Everything that was clamped or replaced."""
        return self.clamped + self.x_clamped + self.v_clamped

    @property
    def last_luminance(self) -> F32:
        """(h, w) the last luminance that was one; -1 before a pixel's first light."""
        return self.arrays["last_luminance"]

    @property
    def last_log(self) -> F32:
        """(h, w) its L_log; NaN before a pixel's first light."""
        return self.arrays["last_log"]

    @property
    def v(self) -> F32:
        """(h, w) membrane V as it was after tick `last`."""
        return self.arrays["v"]

    @property
    def last(self) -> I64:
        """(h, w) int64, number of the tick in which the pixel was last active."""
        return self.arrays["last"]

    def copy(self) -> NetworkState:
        """A state of its own: stepping one does not touch the other."""
        return replace(self, arrays={name: a.copy() for name, a in self.arrays.items()})

    def save(self) -> dict[str, np.ndarray[Any, Any]]:
        """Named arrays that np.savez writes and `restore` takes back."""
        numbers = {name: np.array(getattr(self, name), np.int64) for name in _NUMBERS}
        words = {name: np.array(getattr(self, name)) for name in _WORDS}
        seed = np.array(self.seed % 2**64, np.uint64)
        return {**self.copy().arrays, **numbers, **words, "seed": seed}

    @classmethod
    def restore(cls, saved: Arrays) -> NetworkState:
        """The state that was saved. Raises EvsError where something of it is missing or unfit.

        The model checks in each step whether it fits.
        """
        kinds = {"seed": "u", **dict.fromkeys(_NUMBERS, "i"), **dict.fromkeys(_WORDS, "U")}
        for name in (*_FRAMES, *kinds):
            if name not in saved:
                raise EvsError(
                    f"saved network state lacks '{name}'; save it with NetworkState.save"
                )
            array = np.asarray(saved[name])
            sound = (
                np.can_cast(array.dtype, _FRAMES[name], "equiv")
                if name in _FRAMES
                else array.dtype.kind == kinds[name] and array.ndim == 0
            )
            if not sound:
                raise EvsError(f"saved network state is damaged: {name} is invalid; save it again")
        frames = {name: np.array(saved[name], kind, order="C") for name, kind in _FRAMES.items()}
        own = {n: np.array(saved[n], order="C") for n in saved if n not in {*kinds, *frames}}
        numbers: dict[str, Any] = {name: int(saved[name]) for name in ("seed", *_NUMBERS)}
        words: dict[str, Any] = {name: str(saved[name]) for name in _WORDS}
        state = cls(**numbers, **words, arrays={**frames, **own})
        state._check_values()
        return state

    def _check_values(self) -> None:
        if len({self.arrays[name].shape for name in _FRAMES}) != 1 or self.v.ndim != 2:
            raise EvsError("saved network state has arrays of different shapes; save it again")
        # what the network reads is bounded, as its weights are
        most = {"v": MAX_V, "last_luminance": _LARGEST, "last_log": MAX_LOG}
        wrong = [
            name
            for name, array in self.arrays.items()
            if array.dtype.kind == "f" and not _size(name, array) <= most.get(name, MAX_CURRENT)
        ]
        counts = (self.clamped, self.x_clamped, self.v_clamped)
        if not 0 <= self.ticks <= MAX_TICKS:
            wrong.append("ticks")
        elif not all(0 <= count <= MAX_COUNT for count in counts):
            wrong.append("clamped")
        elif np.any(self.last < 0) or np.any(self.last > self.ticks):
            wrong.append("last")
        if wrong:
            raise EvsError(f"saved network state is damaged: {wrong[0]} is invalid; save it again")

    def __eq__(self, other: object) -> bool:
        """Same bits everywhere; a NaN equals itself."""
        if not isinstance(other, NetworkState):
            return NotImplemented
        if (self.seed - other.seed) % 2**64:
            return False
        if any(getattr(self, name) != getattr(other, name) for name in (*_NUMBERS, *_WORDS)):
            return False
        return same_bytes(self.arrays, other.arrays)

    __hash__ = None  # type: ignore[assignment]


def _size(name: str, array: np.ndarray[Any, Any]) -> float:
    """Of its largest value; NaN where one is, but for the log of pixels without light."""
    largest = np.fmax if name == "last_log" else np.maximum
    return float(largest.reduce(np.abs(array), axis=None, initial=0))


def check_arrays(
    state: NetworkState, expected: Mapping[str, tuple[type[np.generic], tuple[int, ...]]]
) -> None:
    """Raise EvsError unless a runtime's own arrays are these: name -> (dtype, shape)."""
    own = {name for name in state.arrays if name not in _FRAMES}
    for name in sorted(own ^ set(expected)):
        what = "lacks" if name in expected else "has an unknown"
        raise EvsError(f"state of runtime {state.runtime} {what} array '{name}'; call init again")
    for name, (kind, shape) in expected.items():
        array = state.arrays[name]
        if array.dtype != kind or array.shape != shape:
            raise EvsError(
                f"state of runtime {state.runtime}: {name} is {array.dtype} {array.shape}, "
                f"not {np.dtype(kind)} {shape}; call init again"
            )


def identity(weights: Network) -> str:
    """Name and digest of a network, by which a state knows its own."""
    digest = hashlib.sha256()
    numbers = (weights.tau_s, weights.threshold, weights.linlog_dn, weights.tick_us)
    if isinstance(weights, GraphNetwork):
        digest.update(repr((*numbers, weights.look_ahead)).encode() + weights.graph)
        return f"{weights.name} {digest.hexdigest()[:16]}"
    digest.update(repr((*numbers, float(np.float32(weights.last_bias)))).encode())
    for convolution in weights.convolutions:
        digest.update(repr((convolution.weight.shape, convolution.look_ahead)).encode())
        digest.update(convolution.weight.astype("<f4").tobytes())
        if convolution.bias is not None:
            digest.update(convolution.bias.astype("<f4").tobytes())
    digest.update(weights.last.astype("<f4").tobytes())
    return f"{weights.name} {digest.hexdigest()[:16]}"


COMMON_BYTES = 20
"""of a pixel: last luminance, last log, v (float32 each), last (int64)"""


def dense_bytes(weights: Network, width: int, height: int) -> int:
    """State in which every pixel has its FIFOs: 7 float32 for each channel that is read."""
    if isinstance(weights, GraphNetwork):
        floats = sum(int(state.size) for state in weights.states)
    else:
        floats = KERNEL_SIZE * sum(int(c.weight.shape[1]) for c in weights.convolutions)
    return (COMMON_BYTES + 4 * floats) * width * height


def check_dense(weights: Network, width: int, height: int) -> None:
    """Raise EvsError where a dense state is more than the memory that is free."""
    needed_gb = dense_bytes(weights, width, height) / 1e9
    _, free_gb = memory_gb()
    if needed_gb > free_gb:
        raise EvsError(
            f"a dense {width}x{height} state of {weights.channels} channels needs {needed_gb:.3g} "
            f"GB, but only {free_gb:.3g} GB are free: use a smaller sensor, a network with fewer "
            "channels, or runtime native with a network without biases, which stores only the "
            "active pixels"
        )


def check_growth(more_bytes: int, t_us: int, width: int, height: int) -> None:
    """Raise EvsError where what moves up to t_us is more than the memory that is free."""
    needed_gb = more_bytes / 1e9
    _, free_gb = memory_gb()
    if needed_gb > free_gb:
        raise EvsError(
            f"at {t_us} us, the network state of the active pixels of {width}x{height} needs "
            f"{needed_gb:.3g} GB, but only {free_gb:.3g} GB are free: use a smaller sensor, a "
            "network with fewer channels, or model plain"
        )
