"""Event models by name."""

from __future__ import annotations

from evs.emulator.base.features import UNFORCED, Switches
from evs.emulator.base.protocols import EventModel
from evs.emulator.config import ModelConfig
from evs.emulator.sensor.parameters import SensorParameters
from evs.emulator.sensor.pixel.plain import PlainModel
from evs.emulator.sensor.pixel.running_mean import RunningMeanConstants
from evs.msgs import unknown

_AVERAGES = {"plain": None, "adaptive": RunningMeanConstants()}
"""name -> the running mean in front of the pixel"""

MODELS = (*_AVERAGES, "evsnet")


def make_event_model(
    sensor: SensorParameters,
    model: ModelConfig,
    threads: int = 0,
    spp: int = 0,
    switches: Switches = UNFORCED,
    isa: str = "auto",
) -> EventModel:
    """The event model that `model.name` names.

    In: threads, 0 is one a core; spp, samples a pixel of light with noise, 0 without: a family of
    networks has a member for it; switches, code paths that are forced on or off; isa, auto, avx512,
    avx2 or portable. Raises EvsError.
    """
    if model.name not in MODELS:
        raise unknown("model", model.name, MODELS)
    if model.name == "evsnet":
        # who wants no network needs none
        from evs.emulator.evsnet.model import EvsNetModel
        from evs.emulator.evsnet.network_files import load_network

        return EvsNetModel(
            sensor,
            load_network(model.network, spp),
            runtime=model.runtime,
            provider=model.provider,
            threads=threads,
            isa=isa,
            initial=model.initial_state,
            labels=model.labels,
            switches=switches,
        )
    return PlainModel(
        sensor,
        threads,
        isa,
        average=_AVERAGES[model.name],
        causes=model.labels,
        switches=switches,
    )
