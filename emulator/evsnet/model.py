"""EventModel `evsnet`: the paper's network, streaming."""

from __future__ import annotations

import numpy as np

from evs.emulator.base.arrays import Arrays
from evs.emulator.base.features import UNFORCED, Switches
from evs.emulator.base.scene import F32
from evs.emulator.evsnet.bilif import decay_tables, most_events
from evs.emulator.evsnet.graph_network import Network
from evs.emulator.evsnet.network_files import load_network
from evs.emulator.evsnet.runtime import make_runtime
from evs.emulator.evsnet.state import MAX_TICKS, NetworkState, check_dense, identity
from evs.emulator.sensor.parameters import ModelRequest, SensorParameters
from evs.emulator.sensor.random import Term, pixel_uniforms
from evs.msgs import Events, EvsError, unknown

INITIAL_STATES = ("random", "zero")
MAX_CHUNK = 32
"""ticks that a runtime is given at once; longer chunks are cut, with the same bytes"""
THRESHOLDS = (1 / 64, 32.0)
"""of a pixel in units of the network's: membranes end at 64"""
MAX_TIME_US = 2**52


class EvsNetModel:
    """Light into events by a trained network and a BiLIF unit per pixel.

    Of the sensor it takes size, exposure, dark current and the mean thresholds. Bandwidth, noise
    and fixed pattern are not there. docs/explanation/network.md lists what is taken.
    """

    def __init__(
        self,
        sensor: SensorParameters,
        weights: Network,
        *,
        runtime: str = "native",
        provider: str = "cpu",
        threads: int = 0,
        isa: str = "auto",
        initial: str = "random",
        sparse: bool = True,
        events_per_tick: str = "auto",
        labels: bool = False,
        switches: Switches = UNFORCED,
    ) -> None:
        """Put a network on a sensor.

        Args:
            sensor: The sensor, resolved.
            weights: The network.
            runtime: See `make_runtime`.
            provider: See `make_runtime`.
            threads: See `make_runtime`.
            isa: See `make_runtime`.
            initial: Membranes at the start: "random" in (-V_off, V_on), or "zero".
            sparse: See `make_runtime`.
            events_per_tick: Of a pixel: "one", the paper's, "many", all that a step is worth, or
                "auto", as the network was trained.
            labels: Refused: a network has no cause of an event.
            switches: Cold tiles that are forced on or off.

        Raises:
            EvsError: The network does not fit the sensor or the runtime, or labels are on.
        """
        if initial not in INITIAL_STATES:
            raise unknown("initial state", initial, INITIAL_STATES)
        if labels:
            raise EvsError(
                "model evsnet cannot label its events; use model plain or adaptive, or "
                "model.labels=false"
            )
        self.sensor, self.weights = sensor, weights
        self._initial = initial
        least, most = (limit * weights.threshold for limit in THRESHOLDS)
        for key in ("pos_thres", "neg_thres"):
            if not least <= getattr(sensor, key) <= most:
                raise EvsError(
                    f"sensor.{key} is {getattr(sensor, key):g}; network '{weights.name}' was "
                    f"trained for {weights.threshold:g}: give {least:.3g} ... {most:.3g}"
                )
        self._on = np.float32(sensor.pos_thres / weights.threshold)
        self._off = np.float32(sensor.neg_thres / weights.threshold)
        decay_tables(weights.tau_s, weights.tick_us)  # refuses what has none
        trained = weights.events_per_tick
        self.most_events = most_events(trained if events_per_tick == "auto" else events_per_tick)
        """of a pixel in a tick"""
        dense = switches.decide("cold_tiles", not sparse or not weights.is_still)
        if runtime != "native" or dense:
            check_dense(weights, sensor.width, sensor.height)
        self.runtime = make_runtime(
            runtime,
            sensor,
            weights,
            provider=provider,
            threads=threads,
            isa=isa,
            sparse=not dense,
            most=self.most_events,
        )
        self.features = {"cold_tiles": runtime != "native" or dense}
        """which code paths it runs, by name"""
        self._network = identity(weights)

    @property
    def latency_us(self) -> int:
        """The look-ahead of the network: events are that late, and their stamps carry it."""
        return self.weights.latency_ticks * self.weights.tick_us

    @property
    def warm_up_ticks(self) -> int:
        """Its window: fresh noise has to fill it before events stand out."""
        return self.weights.receptive_field - 1

    @property
    def versions(self) -> dict[str, str]:
        """The network: its name and a digest of its numbers."""
        return {"network": self._network}

    @property
    def adjustable(self) -> tuple[str, ...]:
        """The thresholds; the sensor's other parameters have no effect on a network."""
        return ("pos_thres", "neg_thres")

    def take_over(self, state: NetworkState, before: object) -> NetworkState:
        """EventModel.take_over; membranes beyond a new threshold are moved back below it."""
        if not isinstance(before, EvsNetModel) or before.versions != self.versions:
            raise EvsError("other event models cannot hand their pixels over; make another camera")
        state.v[:] = self._below_thresholds(state.v)
        return state

    def init(self, seed: int) -> NetworkState:
        """The state before the first tick."""
        return NetworkState.dark(
            seed, self.runtime.name, self._network, self._membranes(seed), self.runtime.own_arrays()
        )

    def restore(self, saved: Arrays) -> NetworkState:
        """EventModel.restore."""
        state = NetworkState.restore(saved)
        self._check_state(state, 1)
        return state

    def step(
        self, luminance: F32, state: NetworkState, t_begin_us: int, t_end_us: int
    ) -> tuple[Events, NetworkState]:
        """EventModel.step; the tick must be as long as those the network was trained on.

        Only the first may have any length: before it, light stood still for ever.
        """
        frame = np.asarray(luminance)
        if isinstance(state, NetworkState) and not state.ticks:
            t_begin_us = t_end_us - self.weights.tick_us
        (events,), state = self.step_chunk(
            frame[np.newaxis], state, t_begin_us, t_end_us - t_begin_us
        )
        return events, state

    def step_chunk(
        self, luminance: F32, state: NetworkState, t_begin_us: int, tick_us: int
    ) -> tuple[list[Events], NetworkState]:
        """Turn the light of several ticks into events: the same bytes for any cut.

        Args:
            luminance: (ticks, h, w) float32, linear, at the end of each tick.
            state: It is consumed.
            t_begin_us: Where the first tick begins, us.
            tick_us: Length of a tick, us.

        Returns:
            One array of events a tick, and the state.

        Raises:
            EvsError: Wrong shape, another tick length, a state of something else.
        """
        light = self._checked(luminance, state, t_begin_us, tick_us)
        events: list[Events] = []
        for first in range(0, len(light), MAX_CHUNK):
            begin_us = t_begin_us + first * tick_us
            events += self.runtime.step(light[first : first + MAX_CHUNK], state, begin_us)
        return events, state

    def _membranes(self, seed: int) -> F32:
        """V(0) (h, w): the paper's internal state bias."""
        width, height = self.sensor.width, self.sensor.height
        if self._initial == "zero":
            return np.zeros((height, width), np.float32)
        share = 2.0 * pixel_uniforms(seed, Term.INTERNAL_STATE, width, height) - 1.0
        v = np.where(share > 0, share * np.float64(self._on), share * np.float64(self._off))
        # rounded to a threshold, a still pixel would fire
        return self._below_thresholds(v.astype(np.float32))

    def _below_thresholds(self, v: F32) -> F32:
        below, zero = np.nextafter, np.float32(0)
        return np.clip(v, below(-self._off, zero), below(self._on, zero))

    def _checked(self, luminance: F32, state: NetworkState, t_begin_us: int, tick_us: int) -> F32:
        """The light as runtimes want it. Raises EvsError where it cannot be stepped."""
        self._check(np.shape(luminance), state, t_begin_us, tick_us)
        with np.errstate(over="ignore", invalid="ignore"):  # a float64 may be no float32
            return np.ascontiguousarray(luminance, np.float32)

    def _check(
        self, found: tuple[int, ...], state: NetworkState, t_begin_us: int, tick_us: int
    ) -> None:
        """Raise EvsError where light of that shape, (ticks, h, w), cannot be stepped."""
        shape = (self.sensor.height, self.sensor.width)
        if found[1:] != shape:
            raise EvsError(f"luminance is {found[1:]}, the sensor (height, width) is {shape}")
        if tick_us != self.weights.tick_us:
            raise EvsError(
                f"tick of {tick_us} us; network '{self.weights.name}' is for ticks of "
                f"{self.weights.tick_us} us"
            )
        if max(-t_begin_us, t_begin_us + tick_us * found[0]) > MAX_TIME_US:
            raise EvsError(f"tick at {t_begin_us} us is beyond {MAX_TIME_US} us")
        self._check_state(state, found[0])

    def _check_state(self, state: NetworkState, ticks: int) -> None:
        if not isinstance(state, NetworkState):
            raise EvsError(
                f"state is a {type(state).__name__}, not of model evsnet; call init again"
            )
        if state.runtime != self.runtime.name:
            raise EvsError(
                f"state is of runtime {state.runtime}, the model's is {self.runtime.name}; "
                "call init again"
            )
        if state.network != self._network:
            raise EvsError(
                f"state is of network {state.network}, the model's is {self._network}; "
                "call init again"
            )
        shape = (self.sensor.height, self.sensor.width)
        if state.v.shape != shape:
            raise EvsError(f"state is {state.v.shape}, the sensor is {shape}; call init again")
        if state.ticks + ticks > MAX_TICKS:
            raise EvsError(f"state is {state.ticks} ticks old, past its end; call init again")
        self.runtime.check(state)


def evsnet_model(request: ModelRequest) -> EvsNetModel:
    """The event model `evsnet`, with the network that [model] names."""
    model = request.model
    return EvsNetModel(
        request.sensor,
        load_network(model.network, request.spp),
        runtime=model.runtime,
        provider=model.provider,
        threads=request.threads,
        isa=request.isa,
        initial=model.initial_state,
        events_per_tick=model.events_per_tick,
        labels=model.labels,
        switches=request.switches,
    )
