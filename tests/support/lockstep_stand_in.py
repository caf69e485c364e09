"""A loop of no cost for tests of the wire: physics is a sum, events say what was decided."""

from __future__ import annotations

import json
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
import numpy.typing as npt
import zmq

from evs.drivers.lockstep import LockstepServer
from evs.msgs import EventPacket, EvsError, Observation, StreamInfo, empty_events, make_events
from evs.msgs.packet import unpackb


class StandIn:
    """Length of each actuator grows by its control in every tick; an event each tick and camera."""

    def __init__(
        self, actuators: tuple[str, ...] = ("tilt", "slide"), cameras: tuple[str, ...] = ("left",)
    ) -> None:
        self.actuators = actuators
        self.streams = [StreamInfo(64, 48, camera) for camera in cameras]
        self.tick_us = 1000
        self.last_tick = 10**9
        self.log: list[tuple[Any, ...]] = []
        self._begin(0, False)
        self.began = False

    def _begin(self, seed: int, state: bool) -> None:
        self.tick, self.seed, self.wants_state, self.began = 0, seed, state, True
        self.ctrl = np.zeros(len(self.actuators))
        self.length = np.zeros(len(self.actuators))

    @property
    def t_us(self) -> int:
        return self.tick * self.tick_us

    @property
    def done(self) -> str:
        return "it is over" if self.tick >= self.last_tick else ""

    @property
    def ctrl_range(self) -> npt.NDArray[np.float64]:
        return np.array([[-1.0, 1.0]] * len(self.actuators)).reshape(-1, 2)

    def reset(
        self, seed: int | None = None, keyframe: str = "", state: bool = False
    ) -> Observation:
        self.log.append(("reset", seed, keyframe))
        if keyframe == "nowhere":
            raise EvsError("no keyframe 'nowhere'; there is: home")
        self._begin(self.seed if seed is None else seed, state)
        return self._seen(())

    def step(self, ctrl: npt.ArrayLike | None = None, ticks: int = 1) -> Observation:
        if not self.began:
            raise EvsError("the loop has not begun: call reset first")
        if self.tick >= self.last_tick:
            raise EvsError("the episode is over (it is over): call reset")
        if ctrl is not None:
            self.ctrl = np.array(ctrl, np.float64)
        self.log.append(("step", tuple(self.ctrl.tolist()), ticks))
        packets: list[EventPacket] = []
        for _ in range(min(ticks, self.last_tick - self.tick)):
            self.tick += 1
            self.length = self.length + self.ctrl
            packets += self._packets()
        return self._seen(tuple(packets))

    def _packets(self) -> list[EventPacket]:
        end_us = self.tick * self.tick_us
        found = []
        for stream in self.streams:
            # the first camera's packets are never empty, the others' every second time
            full = stream is self.streams[0] or self.tick % 2
            x = (self.seed + self.tick) % 64
            body = make_events([end_us - 1, end_us], [x, 1], [2, 3], [0, 1]) if full else None
            events = empty_events() if body is None else body
            seq = self.tick - 1
            found.append(EventPacket(seq, end_us - 1000, end_us, 64, 48, events, stream.camera))
        return found

    def _seen(self, packets: tuple[EventPacket, ...]) -> Observation:
        return Observation(
            t_us=self.t_us,
            packets=packets,
            position=self.length.copy(),
            velocity=self.ctrl.copy(),
            done=self.done,
            state=np.array([self.tick, *self.length]) if self.wants_state else None,
        )

    def save(self, compress: bool = False) -> bytes:
        kept = [self.tick, self.seed, self.ctrl.tolist(), self.length.tolist(), self.wants_state]
        return json.dumps(kept, indent=None if compress else 1).encode()

    def restore(self, blob: bytes) -> Observation:
        try:
            tick, seed, ctrl, length, state = json.loads(blob)
            controls, lengths = np.array([ctrl, length], np.float64).reshape(2, -1)
            if len(controls) != len(self.actuators) or not isinstance(tick, int):
                raise ValueError
        except (ValueError, TypeError):
            raise EvsError("this is no saved loop") from None
        self._begin(seed if isinstance(seed, int) else 0, bool(state))
        self.tick, self.ctrl, self.length = abs(tick) % 1000, controls, lengths
        return self._seen(())


@contextmanager
def serving(loop: Any, **options: Any) -> Iterator[LockstepServer]:
    """A server of the loop in a thread, at any free port unless told."""
    kind: type[LockstepServer] = options.pop("kind", LockstepServer)
    server = kind(loop, options.pop("address", "tcp://127.0.0.1:0"), **options)
    server.open()
    stopped: list[str] = []
    failures: list[BaseException] = []

    def run() -> None:
        try:
            server.serve(stopped)
        except BaseException as error:
            failures.append(error)

    thread = threading.Thread(target=run)
    thread.start()
    try:
        yield server
    finally:
        stopped.append("stopped")
        thread.join(20)
        server.close()
        assert not thread.is_alive()
        assert failures == []


class Later:
    """A call in a thread of its own."""

    def __init__(self, call: Callable[[], Any]) -> None:
        self.value: Any = None
        self.error: BaseException | None = None
        self._thread = threading.Thread(target=self._run, args=(call,))
        self._thread.start()

    def _run(self, call: Callable[[], Any]) -> None:
        try:
            self.value = call()
        except BaseException as error:
            self.error = error

    @property
    def waits(self) -> bool:
        return self._thread.is_alive()

    def get(self) -> Any:
        self._thread.join(20)
        assert not self._thread.is_alive()
        if self.error is not None:
            raise self.error
        return self.value


@contextmanager
def raw_client(address: str, kind: int = zmq.DEALER) -> Iterator[Any]:
    """A client that may say what it likes."""
    with zmq.Context() as context, context.socket(kind) as client:
        client.set(zmq.LINGER, 0)
        client.set(zmq.RCVTIMEO, 10_000)
        client.connect(address)
        yield client


def answered(client: Any, parts: list[Any]) -> dict[str, Any]:
    client.send_multipart(parts)
    return unpackb(client.recv_multipart()[0])
