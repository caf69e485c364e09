"""Whether a network's state fits into this machine."""

from __future__ import annotations

from evs.emulator.base.memory_limits import memory_gb
from evs.emulator.evsnet.graph_network import GraphNetwork, Network
from evs.emulator.evsnet.weights import KERNEL_SIZE
from evs.msgs import EvsError

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
            f"a dense {width}x{height} state of {weights.channels} channels is {needed_gb:.3g} GB; "
            f"{free_gb:.3g} GB are free: use a smaller sensor, a network of fewer channels, or "
            "runtime native with a network without biases, which keeps only what moves"
        )


def check_growth(more_bytes: int, t_us: int, width: int, height: int) -> None:
    """Raise EvsError where what moves up to t_us is more than the memory that is free."""
    needed_gb = more_bytes / 1e9
    _, free_gb = memory_gb()
    if needed_gb > free_gb:
        raise EvsError(
            f"what moves up to {t_us} us of {width}x{height} px is {needed_gb:.3g} GB of network "
            f"state; {free_gb:.3g} GB are free: use a smaller sensor, a network of fewer channels, "
            "or model plain"
        )
