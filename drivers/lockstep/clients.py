"""The controllers that have joined, each with its own actuators and the cameras it sees."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from evs.drivers.bus.exchange import Peer
from evs.msgs import EvsError, StreamInfo, unknown
from evs.msgs.lockstep import Join, Parts


@dataclass
class Client:
    """One controller that has joined."""

    name: str
    peer: Peer
    actuators: npt.NDArray[np.int64]
    """(n,) places of its actuators among all"""
    cameras: dict[str, int]
    """camera it sees -> its place among those"""
    has_all: bool
    """whether its controls are all there are, in their order"""
    number: int = 0
    """of its last request"""
    answer: Parts | None = None
    """to that request; None: it is not answered yet"""
    wants_state: bool = False
    joined: Join = field(default_factory=lambda: Join(""))


class Clients:
    """All controllers that have joined. Raises EvsError for one that may not."""

    def __init__(
        self, actuators: Sequence[str], streams: Sequence[StreamInfo], controllers: int
    ) -> None:
        self.actuators = tuple(actuators)
        self.cameras = tuple(stream.camera for stream in streams)
        self.controllers = controllers
        """how many there have to be before anything moves"""
        self.present: dict[bytes, Client] = {}

    @property
    def full(self) -> bool:
        """Whether all have joined."""
        return len(self.present) >= self.controllers

    @property
    def names(self) -> str:
        """Names of all that have joined."""
        return ", ".join(f"'{client.name}'" for client in self.present.values()) or "nobody"

    def admit(self, peer: Peer, join: Join) -> Client:
        """Let a controller join; return the same Client for a repeated request."""
        before = self.present.get(peer[0])
        if before is not None and before.joined == join:
            return before
        if before is not None:
            raise EvsError(
                f"you have already joined, as '{before.name}': leave before you join again"
            )
        if self.full:
            count = self.controllers
            raise EvsError(
                f"every seat is taken: {len(self.present)} of {count} controllers are here "
                f"({self.names}); lockstep.controllers={count + 1} lets one more in"
            )
        if any(client.name == join.name for client in self.present.values()):
            raise EvsError(
                f"a controller '{join.name}' has already joined: join under another name"
            )
        cameras = self.cameras if join.cameras is None else join.cameras
        for camera in cameras:
            if camera not in self.cameras:
                raise unknown("camera", camera, self.cameras)
        if len(set(cameras)) < len(cameras):
            raise EvsError(f"cameras {list(cameras)}: one is named twice")
        places = self._places(join)
        client = Client(
            name=join.name,
            peer=peer,
            actuators=np.array(places, np.int64),
            cameras={camera: place for place, camera in enumerate(cameras)},
            has_all=places == list(range(len(self.actuators))),
            joined=join,
        )
        self.present[peer[0]] = client
        return client

    def _places(self, join: Join) -> list[int]:
        """Return the places of its actuators; no other controller may own one of them."""
        wanted = self.actuators if join.actuators is None else join.actuators
        for name in wanted:
            if name not in self.actuators:
                raise unknown("actuator", name, self.actuators)
        if len(set(wanted)) < len(wanted):
            raise EvsError(f"actuators {list(wanted)}: one is named twice")
        places = [self.actuators.index(name) for name in wanted]
        for other in self.present.values():
            both = set(places) & set(other.actuators.tolist())
            if both:
                name = self.actuators[min(both)]
                raise EvsError(
                    f"actuator '{name}' belongs to controller '{other.name}': give each "
                    'controller its own, as in evs.connect(..., actuators=("x",))'
                )
        return places
