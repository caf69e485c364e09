"""PixelPipeline: light of ticks into events of ticks, through event model and readout.

MODELS is the table of event models: what turns light into events, by the name in model.name. A new
one is a class that follows evs.emulator.base.protocols.EventModel, a function that makes it from a
ModelRequest, and a row there.

An event model may take several ticks at once (model.chunk): their light waits until the chunk is
full, then the events of all its ticks come out, tick by tick, the same as with chunks of one.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from evs.emulator.base.features import UNFORCED, Switches
from evs.emulator.base.gpu.driver import DEVICES, why_no_gpu
from evs.emulator.base.protocols import ChunkedModel, Commit, DeviceModel, EventModel
from evs.emulator.base.scene import F32
from evs.emulator.config import ModelConfig
from evs.emulator.sensor import SensorParameters, make_readout
from evs.emulator.sensor.parameters import ModelRequest
from evs.emulator.sensor.pixel import PlainModel, PlainState
from evs.emulator.sensor.readout import Readout, ReadoutState
from evs.emulator.state import Saved, joined, number, numbers, part
from evs.msgs import EVENT_DTYPE, Events, EvsError, empty_events, unknown
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
        threads: Worker threads; 0: one per core.
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


class DoneTick(NamedTuple):
    """The events of one tick."""

    begin_us: int
    end_us: int
    events: Events


class LentPixels(NamedTuple):
    """The parts of pixels that a batch of cameras uses in their place."""

    model: PlainModel
    state: PlainState
    """live: its numbers are those of the last tick that the batch has given back"""
    readout: Readout | None
    read: ReadoutState | None
    device: object = None
    """the state on a GPU, where they are stepped there"""


class PixelPipeline:
    """The pixels of one camera with their state."""

    def __init__(
        self,
        sensor: SensorParameters,
        model: ModelConfig,
        seed: int,
        threads: int = 0,
        spp: int = 0,
        switches: Switches = UNFORCED,
        isa: str = "auto",
    ) -> None:
        """Make event model and readout.

        Args:
            sensor: The sensor, resolved.
            model: [model].
            seed: Fixed pattern and noise follow from it.
            threads: See `make_event_model`.
            spp: See `make_event_model`.
            switches: See `make_event_model`.
            isa: See `make_event_model`.

        Raises:
            EvsError: The model makes no sense for this sensor.
        """
        self._make = partial(
            make_event_model,
            model=model,
            threads=threads,
            spp=spp,
            switches=switches,
            isa=isa,
        )
        self._model = self._make(sensor)
        # asked in every tick, and slow to find out
        self._on_device = isinstance(self._model, DeviceModel)
        self._readout = make_readout(sensor, switches)
        self._shape = (int(sensor.height), int(sensor.width))
        self._seed = seed
        check_chunk(model)
        self._chunk = model.chunk
        ahead = model.chunk if model.chunk > 1 else 0
        self._light = np.empty((ahead, *self._shape), np.float32)
        self.reset()

    def reset(self, seed: int | None = None) -> None:
        """Start again in the dark, before the first light, with another seed if one is given."""
        self._seed = self._seed if seed is None else seed
        self._state: Any = self._model.init(self._seed)
        self._read = None if self._readout is None else self._readout.init(self._seed)
        self._waiting: list[tuple[int, int]] = []  # their light comes first in self._light
        self._lit = False

    def save(self) -> Saved:
        """Named arrays of all that they remember, which `prepare_restore` takes back."""
        return {
            **joined(state=self._state.save()),
            **(joined(readout=self._read.save()) if self._read is not None else {}),
            **numbers(lit=self._lit),
            "waiting_light": self._light[: len(self._waiting)].copy(),
            "waiting_us": np.array(self._waiting, np.int64).reshape(-1, 2),
        }

    def prepare_restore(self, saved: Saved, seed: int) -> Commit:
        """Check a saved state; the commit puts it in place.

        Args:
            saved: The result of `save`.
            seed: That of the pixels that were saved, from now on.

        Raises:
            EvsError: It is damaged.
        """
        state = self._model.restore(part(saved, "state"))
        read = None if self._readout is None else ReadoutState.restore(part(saved, "readout"))
        lit = bool(number(saved, "lit", 0, 1))
        light, ticks = saved.get("waiting_light"), saved.get("waiting_us")
        if (
            light is None
            or ticks is None
            or light.dtype != np.float32
            or ticks.dtype != np.int64
            or ticks.shape != (len(light), 2)
            or light.shape != (len(ticks), *self._shape)
            or len(ticks) >= self._chunk
        ):
            raise EvsError("saved state is damaged: the pending light is invalid; save it again")

        def commit() -> None:
            self._seed, self._state, self._read, self._lit = seed, state, read, lit
            self._waiting = [(int(begin_us), int(end_us)) for begin_us, end_us in ticks]
            self._light[: len(light)] = light

        return commit

    def lend(self) -> LentPixels | str:
        """What steps in their place, with the same bytes, in a batch; or why it cannot.

        Call it again after a reset.
        """
        model = self._model
        if not isinstance(model, PlainModel):
            return f"the event model is {type(model).__name__}"
        if model.has_row_reads or model.features.get("causes", False):
            return "events hold their causes, or frames disturb the pixels"
        if self.on_device:
            there = self._state
            return LentPixels(model, there.fetched(), self._readout, self._read, there)
        return LentPixels(model, self._state, self._readout, self._read)

    def adjust(self, sensor: SensorParameters) -> None:
        """Go on with other values of `adjustable` from the next light on.

        With a chunk, light that waits is seen with the new values too.

        Args:
            sensor: The sensor, resolved.

        Raises:
            EvsError: The event model cannot; nothing has changed.
        """
        model = self._make(sensor)
        self._state = model.take_over(self._state, self._model)
        self._model = model

    @property
    def on_device(self) -> bool:
        """Whether they are on a GPU, and take light that is there."""
        return self._on_device

    @property
    def adjustable(self) -> tuple[str, ...]:
        """Keys of [sensor] that `adjust` may change."""
        return self._model.adjustable

    def see(self, luminance: F32, begin_us: int, end_us: int) -> list[DoneTick]:
        """See the light at the end of a tick. The first light is the reference.

        Args:
            luminance: (h, w) float32, linear.
            begin_us: Where the tick begins, us.
            end_us: Where it ends, us.

        Returns:
            The ticks whose events are known now, in order. The tick of the first light has no
            events and is done at once.

        Raises:
            EvsError: The light has another shape.
        """
        if not self._lit or self._chunk == 1:
            events, self._state = self._model.step(luminance, self._state, begin_us, end_us)
            self._lit = True
            return [self._read_out(events, begin_us, end_us)]
        found = np.shape(luminance)
        if found != self._shape:
            raise EvsError(f"luminance is {found}, the sensor (height, width) is {self._shape}")
        # the renderer uses its array again
        self._light[len(self._waiting)] = luminance
        self._waiting.append((begin_us, end_us))
        return self.finish() if len(self._waiting) == self._chunk else []

    def finish(self) -> list[DoneTick]:
        """The ticks that wait for the rest of their chunk, without it."""
        if not self._waiting or not isinstance(self._model, ChunkedModel):
            return []
        ticks, self._waiting = self._waiting, []
        light = self._light[: len(ticks)]
        begin_us, end_us = ticks[0]
        chunk, self._state = self._model.step_chunk(light, self._state, begin_us, end_us - begin_us)
        return [self._read_out(events, *tick) for events, tick in zip(chunk, ticks, strict=True)]

    def drain(self, begin_us: int) -> DoneTick | None:
        """Read out every event that waits, as if no pixel fired any more.

        Args:
            begin_us: Where the last tick ended, us.

        Returns:
            One tick until the readout is empty; None: nothing waits.

        Raises:
            EvsError: It takes longer than time can be counted.
        """
        found: list[Events] = []
        now_us, tick_us = begin_us, 1000
        while self.events_waiting:
            done = self._read_out(empty_events(), now_us, now_us + tick_us)
            found.append(done.events)
            # a slow link may take hours
            now_us, tick_us = done.end_us, 2 * tick_us
        if not found:
            return None
        # as bytes: NumPy's copy of fields would lose the causes in the padding
        joined = np.concatenate([events.view(np.uint8) for events in found]).view(EVENT_DTYPE)
        return DoneTick(begin_us, now_us, joined)

    def _read_out(self, events: Events, begin_us: int, end_us: int) -> DoneTick:
        if self._readout is not None and self._read is not None:
            events, self._read = self._readout.step(events, self._read, begin_us, end_us)
        return DoneTick(begin_us, end_us, events)

    @property
    def latency_us(self) -> int:
        """By how much events come later than their light; their stamps carry it."""
        return self._model.latency_us

    @property
    def warm_up_ticks(self) -> int:
        """How long they want to have seen the first light before, where that is noisy."""
        return self._model.warm_up_ticks

    @property
    def versions(self) -> dict[str, str]:
        """What shapes the events beside code: the network."""
        return self._model.versions

    @property
    def features(self) -> dict[str, bool]:
        """Which code paths they run, by name."""
        return {**self._model.features, "readout": self._readout is not None}

    @property
    def clamps(self) -> int:
        """Pixels times ticks in which a value was impossible and was replaced."""
        return int(self._state.clamps)

    @property
    def events_dropped(self) -> dict[str, int]:
        """Events that the readout dropped so far, by cause; empty where the readout is ideal."""
        return self._read.dropped if self._read is not None else {}

    @property
    def events_waiting(self) -> int:
        """Events that are still on their way through the readout."""
        return self._read.count_waiting if self._read is not None else 0
