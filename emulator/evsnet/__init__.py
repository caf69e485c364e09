"""EvSNet, the paper's event spiking network, streaming: weights, state and runtimes."""

from evs.emulator.evsnet.weights import Block, Convolution, NetworkWeights

__all__ = ["Block", "Convolution", "NetworkWeights"]
