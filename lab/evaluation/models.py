"""The event models under test, by name, and how they are run on a row of pixels."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from evs.drivers.clock import monotonic_s
from evs.emulator.base.protocols import ChunkedModel, EventModel
from evs.emulator.base.scene import F32
from evs.emulator.camera.pixel_pipeline import make_event_model
from evs.emulator.config import ModelConfig, SensorConfig
from evs.emulator.evsnet.graph_network import GraphNetwork, Network
from evs.emulator.evsnet.model import EvsNetModel
from evs.emulator.evsnet.network_files import (
    families,
    load_network,
    members,
    nearest_member,
    network_names,
    read_network,
)
from evs.emulator.evsnet.state import NetworkState
from evs.emulator.sensor import SensorParameters, resolve_sensor
from evs.msgs import Events, EvsError, join_events, unknown
from evs_lab.evaluation.clip import TICK_US

SENSOR = SensorConfig(preset="ideal", pos_thres=0.2, neg_thres=0.2)
"""of every model and of the reference: without noise but that of the light"""

PIXELS = ("plain", "adaptive")
NETWORKS = ("paper", "evsnet_c8", "evsnet_c4", "evsnet_c8_8ms")
"""The paper's network as we trained it, then ours: causal ones, and one that looks 8 ms ahead."""
DEFAULT = (*PIXELS, *NETWORKS)
SIDE = 4
"""side of a tile, px, which the native network computes at once"""
CHUNK = 16
"""ticks of a network's chunk"""

Make = Callable[[SensorParameters], EventModel]


@dataclass(frozen=True)
class RuntimeOptions:
    """How models are run, as of EvsNetModel."""

    threads: int = 0
    runtime: str = "native"
    provider: str = "cpu"
    """onnxruntime's execution provider"""
    events_per_tick: str = "auto"


@dataclass(frozen=True)
class ModelUnderTest:
    """One model."""

    name: str
    make: Make
    latency_ticks: int = 0
    """ticks that it looks ahead; they are subtracted from its stamps"""
    spp: tuple[int, int] | None = None
    """fewest and most samples a pixel of the light that it was trained on; None: any light"""

    def meant_for(self, spp: Sequence[int]) -> list[int]:
        """These numbers of samples a pixel, each moved to the nearest that the model knows."""
        least, most = self.spp or (min(spp), max(spp))
        return sorted({min(max(samples, least), most) for samples in spp})

    def at(self, spp: int) -> ModelUnderTest:
        """The model for light of so many samples a pixel; 0: of light without noise."""
        del spp
        return self


@dataclass(frozen=True)
class NetworkFamily(ModelUnderTest):
    """Networks of one design, each for light of another number of samples."""

    found: tuple[tuple[int, ModelUnderTest], ...] = ()
    """(samples a pixel, the member for them)"""

    def meant_for(self, spp: Sequence[int]) -> list[int]:
        """The samples of the members that serve these."""
        known = {samples: samples for samples, _ in self.found}
        return sorted({nearest_member(known, samples) for samples in spp})

    def at(self, spp: int) -> ModelUnderTest:
        """The member for light of so many samples a pixel."""
        return dataclasses.replace(nearest_member(dict(self.found), spp), name=self.name)


@dataclass(frozen=True)
class ModelOutput:
    """Events and cost of a model on the light of n pixels."""

    events: Events
    """(m,) x is the number of the pixel, y is 0; the latency of the model is subtracted"""
    ms_per_tick: float
    """of the model alone, by the wall clock: mean over all ticks"""


def sensor_of(pixels: int) -> SensorParameters:
    """The sensor of so many pixels: tiles of 4 x 4, side by side, the last one filled up."""
    tiles = -(-pixels // SIDE**2)
    return dataclasses.replace(resolve_sensor(SENSOR), width=SIDE * tiles, height=SIDE)


def frames_of(light: F32) -> F32:
    """(ticks, 4, width) pictures of that sensor, black where the last tile is filled up.

    Pixel 16 i + 4 j + k stands in row j, column k of tile i.

    Args:
        light: (ticks, n).
    """
    ticks, pixels = light.shape
    sensor = sensor_of(pixels)
    padded = np.zeros((ticks, sensor.width * SIDE), np.float32)
    padded[:, :pixels] = light
    tiles = padded.reshape(ticks, -1, SIDE, SIDE).transpose(0, 2, 1, 3)
    return np.ascontiguousarray(tiles).reshape(ticks, SIDE, sensor.width)


def numbered(events: Events) -> Events:
    """The same events, x the number of the pixel and y 0."""
    found = events.copy()
    tile, column = np.divmod(events["x"].astype(np.int64), SIDE)
    found["x"], found["y"] = SIDE**2 * tile + SIDE * events["y"] + column, 0
    return found


def models_under_test(
    names: Sequence[str], own: Path | None, how: RuntimeOptions
) -> tuple[list[ModelUnderTest], list[str]]:
    """The models of a list, and a line for each network that does not come with this evs.

    Args:
        names: names of models.
        own: file of a user's network, which is judged too.
        how: how models are run.

    Raises:
        EvsError: unknown name, a name twice, a network that cannot be read.
    """
    shipped = network_names()
    known = list(dict.fromkeys([*DEFAULT, *families(shipped), *shipped]))
    found: list[ModelUnderTest] = []
    missing: list[str] = []
    for name in names:
        if name not in known:
            raise unknown("model", name, known)
        if name in PIXELS:
            found.append(ModelUnderTest(name, _pixel(name, how.threads)))
        elif name in shipped:
            found.append(network(load_network(name), how, name))
        elif name in families(shipped):
            found.append(_family(name, members(name, shipped), how))
        else:
            missing.append(f"no network '{name}' in config/networks: it is left out")
    if own is not None:
        found.append(network(read_network(own), how, own.stem))
    twice = [one.name for k, one in enumerate(found) if one.name in [c.name for c in found[:k]]]
    if twice:
        raise EvsError(f"two models are called '{twice[0]}'; leave one out, or rename its file")
    return found, missing


def network(weights: Network, how: RuntimeOptions, name: str = "") -> ModelUnderTest:
    """A trained network as a model. Its membranes begin at zero, as the reference's pixels do.

    Args:
        weights: the network; onnxruntime runs a graph of another design, whatever the runtime.
        how: how models are run.
        name: its name; empty: that of the network.

    Raises:
        EvsError: the network is for ticks of another length, or no sensor can use it.
    """
    name = name or weights.name
    if weights.tick_us != TICK_US:
        raise EvsError(
            f"network '{name}' is for ticks of {weights.tick_us} us; here they have {TICK_US} us"
        )
    chosen = "onnxruntime" if isinstance(weights, GraphNetwork) else how.runtime

    def make(sensor: SensorParameters) -> EventModel:
        return EvsNetModel(
            sensor,
            weights,
            runtime=chosen,
            provider=how.provider,
            threads=how.threads,
            initial="zero",
            events_per_tick=how.events_per_tick,
        )

    # fail before anything is rendered
    make(sensor_of(1))
    return ModelUnderTest(name, make, weights.latency_ticks, weights.spp)


def _family(name: str, found: dict[int, str], how: RuntimeOptions) -> NetworkFamily:
    networks = [(spp, network(load_network(member), how, member)) for spp, member in found.items()]
    latest = max(one.latency_ticks for _, one in networks)
    return NetworkFamily(name, networks[0][1].make, latest, found=tuple(networks))


def _pixel(name: str, threads: int) -> Make:
    return lambda sensor: make_event_model(sensor, ModelConfig(name=name), threads)


def run(tested: ModelUnderTest, light: F32, warm: F32 | None = None) -> ModelOutput:
    """Run a model on the light of a row of pixels.

    Args:
        tested: the model.
        light: (ticks, n) at the instants 0, 1 ... ms. Tick k is (k - 1, k] ms; the first one only
            sets the reference. A model that looks ahead needs as many ticks more.
        warm: (ticks, n) light of the scene at rest before, with its noise. A network sees it
            first, as in a camera, and its membranes are set to zero before the first tick.
    """
    pixels = light.shape[1]
    model = tested.make(sensor_of(pixels))
    state = model.init(0)
    late = tested.latency_ticks
    if model.warm_up_ticks and warm is not None:
        seen = frames_of(
            np.concatenate([warm[max(0, len(warm) - model.warm_up_ticks) :], light[:late]])
        )
        state, _ = _see(model, seen, state, TICK_US * (late - 1 - len(seen)))
        if isinstance(state, NetworkState):
            state.v[...] = 0.0
        first = late
    else:
        first = 0
    frames = frames_of(light)[first:]
    begin_s = monotonic_s()
    state, parts = _see(model, frames, state, TICK_US * (first - 1))
    seconds = monotonic_s() - begin_s
    events = numbered(join_events(parts))
    events["t"] -= TICK_US * late
    return ModelOutput(events, 1e3 * seconds / len(frames))


def _see(model: EventModel, frames: F32, state: Any, begin_us: int) -> tuple[Any, list[Events]]:
    """Run a model over frames; return its state and the events of each tick."""
    parts: list[Events] = []
    if isinstance(model, ChunkedModel):
        for k in range(0, len(frames), CHUNK):
            begin = begin_us + TICK_US * k
            chunk, state = model.step_chunk(frames[k : k + CHUNK], state, begin, TICK_US)
            parts += chunk
    else:
        for k, frame in enumerate(frames):
            begin = begin_us + TICK_US * k
            some, state = model.step(frame, state, begin, begin + TICK_US)
            parts.append(some)
    return state, parts


def reference_events(light: F32, threads: int = 0) -> Events:
    """Events of the noise-free pixel on converged light (ticks, n): the reference."""
    return run(ModelUnderTest("plain", _pixel("plain", threads)), light).events
