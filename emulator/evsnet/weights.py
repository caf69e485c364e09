"""What a trained EvSNet is: its filters, and the numbers without which they mean nothing.

Per pixel, over X_k = L_log(k) - L_log(k-1) (the paper's equations 1, 5 and 6):

    h_0 = ReLU(Conv(X))
    h_i = ReLU(h_{i-1} + Conv(ReLU(Conv(h_{i-1})))),  i = 1 ... M
    I   = last . h_M + last_bias

Each Conv has 7 taps and reads `look_ahead` ticks of the future: 0 is causal, 3 is centred. In a
stream, output k of a Conv exists once input k + look_ahead is there, so that the whole network is
`latency_ticks` late. What a tick before the first would have held is the rest value: the network's
answer to light that has stood still for ever, zero everywhere where there is no bias.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass

import numpy as np

from evs.emulator.base.scene import F32, F64
from evs.emulator.evsnet.bilif import most_events
from evs.msgs import EvsError

KERNEL_SIZE = 7
"""k, ticks that one convolution reads"""
MAX_CHANNELS = 64
MAX_BLOCKS = 8
MAX_STEP = 20.0
"""|X| is clamped to it: from black to a sun, in log units"""
MAX_CURRENT = 1e30
"""No sum in the network may come near the end of float32: so no NaN or Inf can come about."""
MAX_TICK_US = 2**28 - 1
MAX_LINLOG_DN = 1e6


@dataclass(frozen=True, eq=False)
class Convolution:
    """out[c, k] = bias[c] + sum_ij weight[c, i, j] in[i, k + look_ahead - 6 + j]."""

    weight: F32
    """(out, in, 7) float32; j = 6 is the latest tick, as in PyTorch and ONNX"""
    bias: F32 | None = None
    """(out,) float32; None: there is none"""
    look_ahead: int = 0
    """ticks of the future that it reads, 0 ... 6"""


@dataclass(frozen=True, eq=False)
class Block:
    """h <- ReLU(h + second(ReLU(first(h)))), the paper's residual block."""

    first: Convolution
    second: Convolution

    @property
    def look_ahead(self) -> int:
        """Ticks by which the sum is late, and so h in it: 0 ... 6."""
        return self.first.look_ahead + self.second.look_ahead


@dataclass(frozen=True, eq=False)
class NetworkWeights:
    """A trained network. Raises EvsError where something of it does not fit the rest."""

    name: str
    encoder: Convolution
    """from X, one channel, to C"""
    blocks: tuple[Block, ...]
    """M of them; the paper has 3"""
    last: F32
    """(C,) float32, the point-wise convolution"""
    last_bias: float = 0.0
    tau_s: float = 0.5
    """time constant of the membrane, s"""
    threshold: float = 0.2
    """log units: contrast threshold of the pixels it was trained on; V_th = 1 stands for it"""
    linlog_dn: float = 2.718281828459045
    """rho of L_log, DN"""
    tick_us: int = 1000
    """the tick it was trained on, us"""
    spp: tuple[int, int] = (1, 64)
    """fewest and most samples a pixel that it was trained on"""
    events_per_tick: str = "one"
    """of a pixel, as it was trained: one | many"""

    def __post_init__(self) -> None:
        """Check everything."""
        channels = self.channels
        if not 1 <= channels <= MAX_CHANNELS or not 0 <= len(self.blocks) <= MAX_BLOCKS:
            raise EvsError(
                f"network '{self.name}' has {channels} channels and {len(self.blocks)} blocks; "
                f"1 ... {MAX_CHANNELS} and 0 ... {MAX_BLOCKS} are possible"
            )
        self._check("encoder", self.encoder, (channels, 1, KERNEL_SIZE))
        for i, block in enumerate(self.blocks):
            self._check(f"blocks.{i}.first", block.first, (channels, channels, KERNEL_SIZE))
            self._check(f"blocks.{i}.second", block.second, (channels, channels, KERNEL_SIZE))
            if block.look_ahead >= KERNEL_SIZE:
                raise EvsError(
                    f"network '{self.name}': block {i} looks {block.look_ahead} ticks ahead; "
                    f"{KERNEL_SIZE - 1} is the most"
                )
        self._check_array("last", self.last, (channels,))
        if not abs(self.last_bias) < float("inf"):
            raise EvsError(f"network '{self.name}': last_bias is {self.last_bias}")
        check_numbers(self.name, self.tau_s, self.threshold, self.linlog_dn, self.tick_us, self.spp)
        most_events(self.events_per_tick)
        if not self._largest_sum() <= MAX_CURRENT:
            raise EvsError(
                f"network '{self.name}': its weights are so large that a current may exceed "
                f"{MAX_CURRENT:g}; train it again"
            )

    def _check(self, where: str, convolution: Convolution, shape: tuple[int, ...]) -> None:
        self._check_array(f"{where}.weight", convolution.weight, shape)
        if convolution.bias is not None:
            self._check_array(f"{where}.bias", convolution.bias, shape[:1])
        if not 0 <= convolution.look_ahead < KERNEL_SIZE:
            raise EvsError(
                f"network '{self.name}': {where} looks {convolution.look_ahead} ticks ahead; "
                f"0 ... {KERNEL_SIZE - 1} is possible"
            )

    def _check_array(self, where: str, array: F32, shape: tuple[int, ...]) -> None:
        if array.dtype != np.float32 or array.shape != shape:
            raise EvsError(
                f"network '{self.name}': {where} is {array.dtype} {array.shape}; "
                f"it must be float32 {shape}"
            )
        if not np.all(np.isfinite(array)):
            raise EvsError(f"network '{self.name}': {where} holds a NaN or Inf; train it again")

    def _largest_sum(self) -> float:
        """No sum in the network is larger, nor any part of one, for any X."""
        most = 0.0

        def grown(convolution: Convolution, value: F64) -> F64:
            nonlocal most
            out: F64 = np.abs(convolution.weight.astype(np.float64)).sum(axis=2) @ value
            if convolution.bias is not None:
                out += np.abs(convolution.bias)
            most = float(np.maximum(most, out.max()))
            return out

        with np.errstate(over="ignore", invalid="ignore"):  # Inf and NaN are too large
            held = grown(self.encoder, np.full(1, MAX_STEP))
            for block in self.blocks:
                held = held + grown(block.second, grown(block.first, held))
            last = np.abs(self.last.astype(np.float64)) @ held + abs(self.last_bias)
        # the terms are not negative: each sum here is at least as large as any before
        return float(np.max([most, held.max(), last]))

    @property
    def channels(self) -> int:
        """C."""
        return int(self.last.shape[0])

    @property
    def convolutions(self) -> tuple[Convolution, ...]:
        """All of them in order: the encoder, then two a block."""
        return (self.encoder, *(c for block in self.blocks for c in (block.first, block.second)))

    @property
    def receptive_field(self) -> int:
        """W, ticks of X that one current depends on: 43 for M = 3."""
        return 1 + (KERNEL_SIZE - 1) * len(self.convolutions)

    @property
    def latency_ticks(self) -> int:
        """By how many ticks the current comes late: 0 where all is causal."""
        return sum(convolution.look_ahead for convolution in self.convolutions)

    @property
    def is_still(self) -> bool:
        """Whether still light gives a current of exactly 0: there is no bias anywhere."""
        biases = [c.bias for c in self.convolutions]
        return self.last_bias == 0.0 and all(b is None or not np.any(b) for b in biases)

    def rest(self) -> tuple[F32, ...]:
        """What each convolution reads while light stands still: (channels in,) float32 each."""
        held = np.zeros(1, np.float32)
        found = [held]
        held = _relu(_constant(self.encoder, held))
        for block in self.blocks:
            found.append(held)
            middle = _relu(_constant(block.first, held))
            found.append(middle)
            held = _relu(held + _constant(block.second, middle))
        return tuple(found)


def check_numbers(
    name: str,
    tau_s: float,
    threshold: float,
    linlog_dn: float,
    tick_us: int,
    spp: tuple[int, int],
) -> None:
    """Raise EvsError where a number that stands beside the filters makes no sense."""
    for key, value in (("tau_s", tau_s), ("threshold", threshold), ("tick_us", tick_us)):
        most = MAX_TICK_US if key == "tick_us" else sys.float_info.max
        if not 0.0 < value <= most:
            raise EvsError(f"network '{name}': {key} is {value}")
    if not 1.0 < linlog_dn <= MAX_LINLOG_DN:
        raise EvsError(
            f"network '{name}': linlog_dn is {linlog_dn}; the log map rises only "
            f"where it is over 1, and {MAX_LINLOG_DN:g} is the most"
        )
    if not 1 <= spp[0] <= spp[1]:
        raise EvsError(f"network '{name}': spp is {spp}; give fewest and most")


def _constant(convolution: Convolution, value: F32) -> F32:
    """What a convolution makes of an input that does not change, summed as the reference does."""
    outputs, inputs, _ = convolution.weight.shape
    out = np.zeros(outputs, np.float32)
    for j in range(KERNEL_SIZE):
        for i in range(inputs):
            out += convolution.weight[:, i, j] * value[i]
    return out if convolution.bias is None else out + convolution.bias


def _relu(value: F32) -> F32:
    return np.where(value > 0, value, np.float32(0))
