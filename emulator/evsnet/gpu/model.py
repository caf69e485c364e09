"""EventModel `evsnet` on a GPU, with the events and the saved states of the runtime `native`."""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np

from evs.emulator.base.arrays import Arrays
from evs.emulator.base.features import UNFORCED, Switches
from evs.emulator.base.gpu.arrays import DeviceLight
from evs.emulator.base.gpu.driver import the_gpu
from evs.emulator.evsnet.gpu.network import CudaNetwork, CudaNetworkState
from evs.emulator.evsnet.model import EvsNetModel
from evs.emulator.evsnet.native import NativeRuntime
from evs.emulator.evsnet.network_files import load_network
from evs.emulator.evsnet.weights import NetworkWeights
from evs.emulator.sensor.parameters import ModelRequest, SensorParameters
from evs.msgs import Events, EvsError


class CudaEvsNetModel(EvsNetModel):
    """As EvsNetModel with the runtime `native`; states are there, and are saved as its."""

    on_device = True
    """it takes light from there"""

    def __init__(
        self,
        sensor: SensorParameters,
        weights: NetworkWeights,
        *,
        provider: str = "cpu",
        isa: str = "auto",
        initial: str = "random",
        sparse: bool = True,
        events_per_tick: str = "auto",
        labels: bool = False,
        switches: Switches = UNFORCED,
    ) -> None:
        """Put a network on a sensor, and both on a GPU.

        Args:
            sensor: See `EvsNetModel`.
            weights: See `EvsNetModel`. The network must have the native design.
            provider: See `EvsNetModel`.
            isa: See `EvsNetModel`. The GPU ignores it.
            initial: See `EvsNetModel`.
            sparse: See `EvsNetModel`.
            events_per_tick: See `EvsNetModel`.
            labels: See `EvsNetModel`.
            switches: See `EvsNetModel`.

        Raises:
            EvsError: See `EvsNetModel`; or there is no GPU, or its memory is full.
        """
        super().__init__(
            sensor,
            weights,
            provider=provider,
            threads=1,
            isa=isa,
            initial=initial,
            sparse=sparse,
            events_per_tick=events_per_tick,
            labels=labels,
            switches=switches,
        )
        assert isinstance(self.runtime, NativeRuntime)
        self._there = CudaNetwork(the_gpu(), self.runtime)

    def init(self, seed: int) -> Any:
        """EventModel.init."""
        return CudaNetworkState(self._there, super().init(seed))

    def restore(self, saved: Arrays) -> Any:
        """EventModel.restore."""
        return CudaNetworkState(self._there, super().restore(saved))

    def take_over(self, state: Any, before: object) -> Any:
        """EventModel.take_over, as in EvsNetModel."""
        there = _on_gpu(state)
        there.adjust(self._there, partial(super().take_over, before=before))
        return there

    def step(
        self, luminance: Any, state: Any, t_begin_us: int, t_end_us: int
    ) -> tuple[Events, Any]:
        """See `EvsNetModel`; luminance may be on the GPU (DeviceLight)."""
        there, tick_us = _on_gpu(state), self.weights.tick_us
        if not there.numbers.ticks:
            t_begin_us = t_end_us - tick_us
        if not isinstance(luminance, DeviceLight):
            frame = np.asarray(luminance)[np.newaxis]
            (events,), _ = self.step_chunk(frame, there, t_begin_us, t_end_us - t_begin_us)
            return events, there
        self._check((1, *luminance.shape), there.numbers, t_begin_us, t_end_us - t_begin_us)
        return self._there.step(luminance.memory.address, there, t_begin_us), there

    def step_chunk(
        self, luminance: Any, state: Any, t_begin_us: int, tick_us: int
    ) -> tuple[list[Events], Any]:
        """See `EvsNetModel`."""
        there = _on_gpu(state)
        light = self._checked(luminance, there.numbers, t_begin_us, tick_us)
        events = [
            self._there.step(frame, there, t_begin_us + tick * tick_us)
            for tick, frame in enumerate(light)
        ]
        return events, there


def _on_gpu(state: Any) -> CudaNetworkState:
    """The state of a model on a GPU. Raises EvsError where it is another one's."""
    if not isinstance(state, CudaNetworkState):
        raise EvsError(
            f"state is a {type(state).__name__}, not of model evsnet on a GPU; restore what its "
            "save gives"
        )
    return state


def evsnet_model(request: ModelRequest) -> CudaEvsNetModel:
    """The event model `evsnet` on a GPU, with the network that [model] names."""
    model = request.model
    weights = load_network(model.network, request.spp)
    if not isinstance(weights, NetworkWeights):
        raise EvsError(
            f"network '{weights.name}' is of another design than ours, and a GPU runs ours only; "
            "give model.device=cpu and model.runtime=onnxruntime"
        )
    return CudaEvsNetModel(
        request.sensor,
        weights,
        provider=model.provider,
        isa=request.isa,
        initial=model.initial_state,
        events_per_tick=model.events_per_tick,
        labels=model.labels,
        switches=request.switches,
    )
