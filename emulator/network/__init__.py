"""EvSNet, the paper's event spiking network, streaming: weights, state and runtimes."""

from evs.emulator.network.weights import Block, Convolution, NetworkWeights

__all__ = ["Block", "Convolution", "NetworkWeights"]
