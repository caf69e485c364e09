"""Channels: everything between the cameras, the controller and the actuators, with its delays."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields
from typing import Any

import numpy as np

from evs.emulator.base.scene import F64
from evs.emulator.config.closed_loop import DelayConfig
from evs.emulator.config.plain_values import plain_config
from evs.emulator.sensor.random import Term
from evs.emulator.simulation.closed_loop.link import NEVER, Link, LinkNoise, OnTheWay
from evs.emulator.simulation.closed_loop.saved_links import read_waiting, save_waiting
from evs.emulator.state import MOST, Saved, joined, number, numbers, part
from evs.msgs import EventPacket, EvsError, Frame, ImuPacket

STREAMS: dict[type, str] = {EventPacket: "packets", Frame: "frames", ImuPacket: "imu"}
"""kind of a message -> the field of an Observation that it ends in"""

MAX_DELAY_US = 10**9
"""1000 s"""


class Channels:
    """The links of some cameras, one for each of their streams, and that of the controls."""

    def __init__(self, delays: DelayConfig, cameras: Sequence[str], nu: int, seed: int) -> None:
        """Make the links.

        Args:
            delays: Of all of them.
            cameras: Names of the cameras.
            nu: How many controls there are.
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

    def read(self, saved: Saved, seed: int) -> Channels:
        """Those that were saved. In: seed, theirs. Raises EvsError."""
        other = Channels(self.delays, self.cameras, self.nu, seed)
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
    for field in fields(delays):
        value = getattr(delays, field.name)
        most, unit = (1, "") if field.name == "drop_share" else (MAX_DELAY_US, " us")
        if not 0 <= value <= most:
            raise EvsError(f"loop.delays.{field.name} is {value}; give 0 ... {most}{unit}")
    return delays


def _counts(link: Link[Any]) -> np.ndarray[Any, Any]:
    return np.array([link.sent, link.dropped, link.last_us], np.int64)


def _set_counts(link: Link[Any], saved: Saved) -> None:
    counts = saved["counts"]
    sound = counts.shape == (3,) and (counts <= MOST).all() and (counts >= (0, 0, NEVER)).all()
    if not sound:
        raise EvsError("saved state is damaged: the counts of a link are invalid; save it again")
    link.sent, link.dropped, link.last_us = counts.tolist()
