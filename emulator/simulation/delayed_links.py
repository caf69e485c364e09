"""Delayed links between the cameras, the controller and the actuators.

On a link messages take their time from one end to the other, in order, and may get lost. When a
loop is saved, what is on its way is stored as it travels on the bus, so that whoever takes it back
checks it as if it came from there.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field, fields
from typing import Any, Generic, TypeVar

import numpy as np

from evs.emulator.base.scene import F64
from evs.emulator.config.decoding import plain_config
from evs.emulator.config.schema import DelayConfig
from evs.emulator.sensor.random import Term, indexed_normals, indexed_uniforms
from evs.emulator.state import MOST, Saved, joined, number, numbers, part
from evs.msgs import (
    LABEL_DTYPE,
    EventPacket,
    EvsError,
    Frame,
    ImuPacket,
    decode,
    decode_frame,
    decode_imu,
    encode,
    encode_frame,
    encode_imu,
)

STREAMS: dict[type, str] = {EventPacket: "packets", Frame: "frames", ImuPacket: "imu"}
"""kind of a message -> the field of an Observation that it ends in"""

MAX_DELAY_US = 10**9
"""1000 s"""


class DelayedLinks:
    """The links of some cameras, one for each of their streams, and that of the controls."""

    def __init__(self, delays: DelayConfig, cameras: Sequence[str], nu: int, seed: int) -> None:
        """Make the links.

        Args:
            delays: Of all of them.
            cameras: Names of the cameras.
            nu: Number of controls.
            seed: Jitter and losses follow from it.
        """
        self.delays, self.cameras, self.nu = delays, tuple(cameras), nu
        jitters, drops = delays.transport_jitter_us > 0.0, delays.drop_share > 0.0
        self.links: dict[tuple[str, int], Link[Any]] = {}
        for camera in range(len(self.cameras)):
            for place, stream in enumerate(STREAMS.values()):
                number = len(STREAMS) * camera + place
                self.links[stream, camera] = Link(
                    delays.transport_us,
                    delays.transport_jitter_us,
                    LinkNoise(seed, Term.TRANSPORT, number) if jitters else None,
                    delays.drop_share,
                    LinkNoise(seed, Term.DROP, number) if drops else None,
                )
        self.controls: Link[F64] = Link(
            delays.control_us,
            delays.control_jitter_us,
            LinkNoise(seed, Term.CONTROL, 0) if delays.control_jitter_us > 0.0 else None,
        )
        self.events_dropped = 0

    def send(self, camera: int, message: EventPacket | Frame | ImuPacket, t_us: int) -> None:
        """A message of a camera, by its number, at the end of the tick that it is of."""
        arrives = self.links[STREAMS[type(message)], camera].send(message, t_us)
        if not arrives and isinstance(message, EventPacket):
            self.events_dropped += len(message)

    def arrived(self, t_us: int) -> dict[str, tuple[Any, ...]]:
        """What has arrived by `t_us`, by stream; in the order of sending, then by camera."""
        found: dict[str, tuple[Any, ...]] = {}
        for stream in STREAMS.values():
            came = [
                one
                for camera in range(len(self.cameras))
                for one in self.links[stream, camera].take(t_us)
            ]
            came.sort(key=lambda one: one.sent_us)
            found[stream] = tuple(one.message for one in came)
        return found

    def decide(self, ctrl: F64, t_us: int) -> None:
        """A control that was decided on at `t_us`."""
        self.controls.send(ctrl, t_us)

    def acting(self, t_us: int) -> F64 | None:
        """The control that acts anew in the tick that begins at `t_us`; None: the one before."""
        came = self.controls.take(t_us)
        return came[-1].message if came else None

    def save(self) -> Saved:
        """Named arrays that `read` takes back."""
        saved: Saved = numbers(events_dropped=self.events_dropped)
        for (stream, camera), link in self.links.items():
            name = f"{stream}.{camera}"
            saved |= joined(**{name: save_waiting(link.waiting)})
            saved[f"{name}.counts"] = _counts(link)
        controls = self.controls
        times = [(one.sent_us, one.arrives_us) for one in controls.waiting]
        saved["controls.counts"] = _counts(controls)
        saved["controls.times"] = np.array(times, np.int64).reshape(-1, 2)
        values = np.array([one.message for one in controls.waiting], np.float64)
        saved["controls.values"] = values.reshape(len(times), self.nu)
        return saved

    def read(self, saved: Saved, seed: int) -> DelayedLinks:
        """The links that were saved, which had this seed. Raises EvsError."""
        other = DelayedLinks(self.delays, self.cameras, self.nu, seed)
        other.events_dropped = number(saved, "events_dropped", 0)
        for (stream, camera), link in other.links.items():
            kept = part(saved, f"{stream}.{camera}")
            link.waiting = read_waiting(kept, stream, self.cameras[camera])
            _set_counts(link, kept)
        controls = part(saved, "controls")
        _set_counts(other.controls, controls)
        times, values = controls["times"], controls["values"]
        if (
            (times.shape, values.shape) != ((len(times), 2), (len(times), self.nu))
            or not np.isfinite(values).all()
            or (times[:, 1] < times[:, 0]).any()
            or (np.diff(times, axis=0) < 0).any()
            or (np.abs(times) > MOST).any()
        ):
            raise EvsError("saved state is damaged: its controls are invalid; save it again")
        for (sent_us, arrives_us), ctrl in zip(times.tolist(), values, strict=True):
            other.controls.waiting.append(OnTheWay(sent_us, arrives_us, ctrl.copy()))
        return other

    @property
    def dropped(self) -> dict[str, int]:
        """Messages of each camera that got lost, by its name."""
        return {
            name: sum(self.links[stream, camera].dropped for stream in STREAMS.values())
            for camera, name in enumerate(self.cameras)
        }


def check_delays(delays: DelayConfig) -> DelayConfig:
    """With plain values. EvsError where one makes no sense."""
    if not isinstance(delays, DelayConfig):
        raise EvsError(f"delays= takes a DelayConfig, not {delays!r}")
    delays = plain_config(delays, "loop.delays")
    for key in fields(delays):
        value = getattr(delays, key.name)
        most, unit = (1, "") if key.name == "drop_share" else (MAX_DELAY_US, " us")
        if not 0 <= value <= most:
            raise EvsError(f"loop.delays.{key.name} is {value}; give 0 ... {most}{unit}")
    return delays


def _counts(link: Link[Any]) -> np.ndarray[Any, Any]:
    return np.array([link.sent, link.dropped, link.last_us], np.int64)


def _set_counts(link: Link[Any], saved: Saved) -> None:
    counts = saved["counts"]
    sound = counts.shape == (3,) and (counts <= MOST).all() and (counts >= (0, 0, NEVER)).all()
    if not sound:
        raise EvsError("saved state is damaged: the counts of a link are invalid; save it again")
    link.sent, link.dropped, link.last_us = counts.tolist()


T = TypeVar("T")

NEVER = -(2**62)
"""when the last message arrived where there was none, us"""


BLOCK = 256
"""numbers that are drawn together: one by one they cost 0.1 ms each"""


class LinkNoise:
    """Random numbers of one link, by the number of the message. Nothing is remembered but a cache.

    Those of Term.DROP are uniform in [0, 1), all others standard normal.
    """

    def __init__(self, seed: int, term: Term, link: int) -> None:
        self._source = (seed, term, link)
        self._draw = indexed_uniforms if term is Term.DROP else indexed_normals
        self._block = -1
        self._numbers = np.zeros(0)

    def __call__(self, number: int) -> float:
        """The number of message `number` >= 0."""
        block, place = divmod(number, BLOCK)
        if block != self._block:
            counters = np.arange(block * BLOCK, (block + 1) * BLOCK)
            self._block, self._numbers = block, self._draw(*self._source, counters)
        return float(self._numbers[place])


@dataclass(frozen=True)
class OnTheWay(Generic[T]):
    """A message between its two ends."""

    sent_us: int
    arrives_us: int
    message: T


@dataclass
class Link(Generic[T]):
    """One way from a sender to a receiver.

    Message n, sent at t, arrives at t + max(0, delay + jitter(n)), but never before one that was
    sent before it. What is lost on the way holds nobody up.
    """

    delay_us: int = 0
    jitter_us: float = 0.0
    """standard deviation"""
    jitter: LinkNoise | None = None
    """standard normal numbers; None: there is no jitter"""
    drop_share: float = 0.0
    drop: LinkNoise | None = None
    """uniform numbers; None: nothing is lost"""
    waiting: deque[OnTheWay[T]] = field(default_factory=deque)
    """in the order in which they were sent"""
    sent: int = 0
    """messages so far, the lost ones included"""
    dropped: int = 0
    """how many were lost"""
    last_us: int = NEVER
    """when the last one arrives"""

    def send(self, message: T, t_us: int) -> bool:
        """Put a message on its way; False: it got lost."""
        number = self.sent
        self.sent += 1
        if self.drop is not None and self.drop(number) < self.drop_share:
            self.dropped += 1
            return False
        late_us = self.delay_us
        if self.jitter is not None:
            late_us = max(0, late_us + round(self.jitter_us * self.jitter(number)))
        self.last_us = max(self.last_us, t_us + late_us)
        self.waiting.append(OnTheWay(t_us, self.last_us, message))
        return True

    def take(self, t_us: int) -> list[OnTheWay[T]]:
        """What has arrived by `t_us`, in the order in which it was sent."""
        found: list[OnTheWay[T]] = []
        while self.waiting and self.waiting[0].arrives_us <= t_us:
            found.append(self.waiting.popleft())
        return found


Message = EventPacket | Frame | ImuPacket

DECODERS: dict[str, Any] = {"packets": decode, "frames": decode_frame, "imu": decode_imu}
"""stream -> what reads its messages"""


def save_waiting(waiting: deque[OnTheWay[Message]]) -> Saved:
    """Named arrays that `read_waiting` takes back."""
    parts = [_parts(one.message) for one in waiting]
    times = [(one.sent_us, one.arrives_us) for one in waiting]
    sizes = [[len(piece) for piece in three] for three in parts]
    raw = b"".join(piece for three in parts for piece in three)
    return {
        "times": np.array(times, np.int64).reshape(-1, 2),
        "sizes": np.array(sizes, np.int64).reshape(-1, 3),
        "bytes": np.frombuffer(raw, np.uint8),
    }


def read_waiting(saved: Saved, stream: str, camera: str) -> deque[OnTheWay[Any]]:
    """What was on its way, in a stream of a camera. Raises EvsError."""
    times, sizes, raw = (saved[name] for name in ("times", "sizes", "bytes"))
    if (
        (times.shape, sizes.shape) != ((len(times), 2), (len(times), 3))
        or (sizes < 0).any()
        or (sizes > raw.size).any()
        or sizes.sum() != raw.size
        or (times[:, 1] < times[:, 0]).any()
        or (np.diff(times, axis=0) < 0).any()
        or (np.abs(times) > MOST).any()
    ):
        raise EvsError(f"saved state is damaged: its {stream} is invalid; save it again")
    pieces, place = [], 0
    for size in sizes.ravel().tolist():
        # each has memory of its own
        pieces.append(raw[place : place + size].tobytes())
        place += size
    found: deque[OnTheWay[Any]] = deque()
    for index, (sent_us, arrives_us) in enumerate(times.tolist()):
        header, body, labels = pieces[3 * index : 3 * index + 3]
        message = _message(stream, header, bytearray(body), labels)
        if message.camera != camera:
            raise EvsError(f"saved state is damaged: its {stream} is invalid; save it again")
        found.append(OnTheWay(sent_us, arrives_us, message))
    return found


def _parts(message: Message) -> tuple[bytes, bytes, bytes]:
    """Header, body and labels; these do not travel on the bus."""
    if isinstance(message, EventPacket):
        header, body = encode(message)
        labels = b"" if message.labels is None else b"l" + message.labels.tobytes()
        return header, bytes(body), labels
    header, body = encode_frame(message) if isinstance(message, Frame) else encode_imu(message)
    return header, bytes(body), b""


def _message(stream: str, header: bytes, body: bytearray, labels: bytes) -> Any:
    message = DECODERS[stream](header, body)
    if labels and stream == "packets":
        kept = bytearray(labels[1:])
        if len(kept) != len(message) * LABEL_DTYPE.itemsize:
            raise EvsError("saved state is damaged: labels are invalid; save it again")
        fields = {name: getattr(message, name) for name in EventPacket.__dataclass_fields__}
        return EventPacket(**{**fields, "labels": np.frombuffer(kept, LABEL_DTYPE)})
    return message
