"""The table of event models: what turns light into events, by the name in model.name.

A new event model is a class that follows evs.emulator.base.protocols.EventModel, a function that
makes it from a ModelRequest, and a row here.
"""

from __future__ import annotations

from dataclasses import dataclass

from evs.emulator.base.features import UNFORCED, Switches
from evs.emulator.base.gpu.driver import DEVICES, why_no_gpu
from evs.emulator.base.protocols import EventModel
from evs.emulator.config import ModelConfig
from evs.emulator.sensor.parameters import ModelRequest, SensorParameters
from evs.msgs import EvsError, unknown
from evs.msgs.registry import load

MAX_CHUNK = 256
"""Ticks; longer chunks bring no speed any more."""


@dataclass(frozen=True)
class ModelRow:
    """One event model."""

    target: str
    """"module:function", imported at first use; the function takes a ModelRequest"""
    cuda: str = ""
    """the same on a GPU (model.device); "": there is none"""
    chunked: bool = False
    """can take several ticks at once (model.chunk): base.protocols.ChunkedModel"""


MODELS = {
    "plain": ModelRow(
        "evs.emulator.sensor.pixel:plain_model",
        cuda="evs.emulator.sensor.gpu.pixel:plain_model",
    ),
    "adaptive": ModelRow(
        "evs.emulator.sensor.pixel:adaptive_model",
        cuda="evs.emulator.sensor.gpu.pixel:adaptive_model",
    ),
    "evsnet": ModelRow(
        "evs.emulator.evsnet.model:evsnet_model",
        cuda="evs.emulator.evsnet.gpu.model:evsnet_model",
        chunked=True,
    ),
}
"""model.name -> its row"""


def make_event_model(
    sensor: SensorParameters,
    model: ModelConfig,
    threads: int = 0,
    spp: int = 0,
    switches: Switches = UNFORCED,
    isa: str = "auto",
) -> EventModel:
    """The event model that `model.name` names.

    Args:
        sensor: The sensor, resolved.
        model: [model].
        threads: Worker threads; 0 is one a core.
        spp: Samples a pixel of light with noise, 0 without: a family of networks has a member for
            it.
        switches: Code paths that are forced on or off.
        isa: auto, avx512, avx2, neon or portable.

    Raises:
        EvsError: No such model, or it cannot be of this sensor.
    """
    if model.name not in MODELS:
        raise unknown("model", model.name, MODELS)
    request = ModelRequest(sensor, model, threads, spp, switches, isa)
    row = MODELS[model.name]
    made: EventModel = load(row.cuda if device_of(request) == "cuda" else row.target)(request)
    return made


def device_of(request: ModelRequest) -> str:
    """Where pixels run: "cpu" or "cuda".

    Args:
        request: See the rows of MODELS.

    Raises:
        EvsError: model.device is cuda, and that cannot be.
    """
    device = request.model.device
    if device not in DEVICES:
        raise unknown("model.device", device, DEVICES)
    if device == "cpu":
        return "cpu"
    reason, name, runtime = why_no_gpu(), request.model.name, request.model.runtime
    if not MODELS[name].cuda:
        reason = f"a GPU does not run model.name {name}"
    elif name == "evsnet" and runtime != "native":
        reason = f"a GPU runs model.runtime native only, not {runtime}"
    if reason and device == "cuda":
        raise EvsError(f"model.device is cuda, but {reason}; take cpu, or auto")
    return "cpu" if reason else "cuda"


def check_chunk(model: ModelConfig) -> None:
    """Check that the model can take so many ticks at once.

    Raises:
        EvsError: model.chunk is not possible.
    """
    if not 1 <= model.chunk <= MAX_CHUNK:
        raise EvsError(f"model.chunk is {model.chunk}; it must be 1 ... {MAX_CHUNK} ticks")
    row = MODELS.get(model.name)
    if model.chunk > 1 and not (row and row.chunked):
        raise EvsError(
            f"model.chunk is {model.chunk}, but model '{model.name}' goes tick by tick: leave "
            "model.chunk out, or take model.name=evsnet"
        )
