"""DvServer: a sink that real DV software (dv.io.NetworkReader, DV's viewer) connects to."""

from __future__ import annotations

import selectors
from collections.abc import Sequence
from typing import Any

from evs.drivers.bus.address import plain_tcp
from evs.drivers.clock import monotonic_s
from evs.drivers.dv.port import PATIENCE_S, Port
from evs.drivers.files.aedat4 import compression as compressions
from evs.drivers.files.aedat4 import description, layout
from evs.drivers.files.aedat4.auxiliary import frame_body, imu_body, triggers_body
from evs.drivers.sink import Sink, Stream
from evs.drivers.sink_config import DvSink
from evs.msgs import (
    EventPacket,
    EvsError,
    Frame,
    ImuPacket,
    StreamInfo,
    TriggerPacket,
    unknown,
)

LINGER_S = 2.0
"""How long a closing server waits for its clients to read what waits for them."""

GRACE_S = 0.5
"""How long it then stays connected: when a server disconnects, dv's NetworkReader discards what its
program has not read yet."""

STREAMS = len(description.KINDS)
"""Ports that each camera has: events, frames, imu, triggers."""

_WAIT_S = 0.1


class DvServer(Sink):
    """A Sink that serves each stream of each camera on a TCP port of its own.

    With tcp://HOST:PORT, events are on PORT, frames on PORT + 1, imu on PORT + 2, triggers on
    PORT + 3 (those that the camera has), the next camera's on PORT + 4 and so on; with port 0 each
    is a free one. Nothing is encoded for a stream without clients. A client that is too slow loses
    the oldest packets once `queue` of them (or 64 MiB) wait for it; other clients are not affected,
    and the camera never waits. One that reads nothing for `patience_s` is disconnected. One
    thread uses it: clients are read and served whenever the camera writes.
    """

    streams = frozenset({Stream.EVENTS, Stream.FRAMES, Stream.IMU, Stream.TRIGGERS})

    def __init__(
        self,
        address: str,
        *,
        compression: str = DvSink.compression,
        queue: int = DvSink.queue,
        wait_for: int = DvSink.wait_for,
        wait_s: float = DvSink.wait_s,
        insecure: bool = False,
        linger_s: float = LINGER_S,
        patience_s: float = PATIENCE_S,
    ) -> None:
        """Make a server that is not open yet.

        Args:
            address: tcp://HOST:PORT, of the events of the first camera.
            compression: lz4, zstd or none.
            queue: Packets that may wait for each client.
            wait_for: Clients of events that `open` waits for.
            wait_s: Time to wait, s.
            insecure: Whether other machines may connect.
            linger_s: How long `close` sends what still waits, s.
            patience_s: After how long without reading a client is disconnected, s.

        Raises:
            EvsError: A value is too small, or the address is not valid.
        """
        for name, value, least in (
            ("queue", queue, 1),
            ("wait_for", wait_for, 0),
            ("wait_s", wait_s, 0),
            ("linger_s", linger_s, 0),
            ("patience_s", patience_s, 1),
        ):
            if not value >= least:
                raise EvsError(f"{name} is {value:g}: give {least} or more")
        self._host, self._port = plain_tcp(address, insecure, "DV")
        self._compression = compression
        self._compress = compressions.compressor(compression)
        self._queue, self._wait_for, self._wait_s = queue, wait_for, wait_s
        self._linger_s, self._patience_s = linger_s, patience_s
        self._selector: selectors.BaseSelector | None = None
        self._ports: dict[tuple[str, int], Port] = {}
        self._address = address
        self._closed_report: dict[str, Any] = {}

    @property
    def ports(self) -> dict[str, int]:
        """`CAMERA/STREAM` -> its TCP port, once open."""
        return {
            f"{camera}/{description.KINDS[number].name}": port.number
            for (camera, number), port in self._ports.items()
        }

    def open(self, streams: Sequence[StreamInfo]) -> None:
        """Bind every port and wait for clients.

        Args:
            streams: One for each camera.

        Raises:
            EvsError: A port is in use, or too few clients connected in time.
        """
        if self._selector is not None:
            raise EvsError("this DV server is open already: close it first, or make another")
        self._selector = selectors.DefaultSelector()
        self._ports = {}
        try:
            for place, stream in enumerate(streams):
                for number in description.held_by(stream):
                    wanted = self._port and self._port + STREAMS * place + number
                    self._ports[stream.camera, number] = self._bind(stream, number, wanted)
            self._await_clients()
        except BaseException:
            self._release()
            raise

    def write(self, packet: EventPacket) -> None:
        """Send one packet to the clients of events; serve those of the other streams too."""
        self._serve_clients()
        port = self._port_of(packet.camera, description.EVENT_STREAM)
        if len(packet) and port.clients:
            self._send(
                port, description.EVENT_STREAM, layout.events_body(packet.events), len(packet)
            )

    def write_frame(self, frame: Frame) -> None:
        """Send one intensity frame to the clients of frames."""
        port = self._port_of(frame.camera, description.FRAME_STREAM)
        if port.clients:
            self._send(port, description.FRAME_STREAM, frame_body(frame), 1)

    def write_imu(self, packet: ImuPacket) -> None:
        """Send the samples of one tick to the clients of imu."""
        port = self._port_of(packet.camera, description.IMU_STREAM)
        if len(packet) and port.clients:
            self._send(port, description.IMU_STREAM, imu_body(packet.samples), len(packet))

    def write_triggers(self, packet: TriggerPacket) -> None:
        """Send the triggers of one tick to the clients of triggers."""
        port = self._port_of(packet.camera, description.TRIGGER_STREAM)
        if len(packet) and port.clients:
            body = triggers_body(packet.triggers)
            self._send(port, description.TRIGGER_STREAM, body, len(packet))

    def close(self) -> dict[str, Any]:
        """Give the clients `linger_s` to read what waits, then disconnect. Safe to call twice."""
        if self._selector is not None:
            try:
                self._linger()
            finally:
                self._closed_report = self._counts()
                self._release()
                # what nobody read in that time counts as dropped
                self._closed_report |= self._totals()
        return {"type": "dv", "address": self._address, **self._closed_report}

    def _bind(self, stream: StreamInfo, number: int, wanted: int) -> Port:
        assert self._selector is not None
        if wanted > 65535:
            raise EvsError(f"DV needs ports up to {wanted}: give an address with a lower port")
        xml = description.to_xml(stream, self._compression, (number,))
        header = layout.io_header(compressions.NUMBERS[self._compression], xml)
        return Port(self._host, wanted, header, self._queue, self._selector, self._patience_s)

    def _port_of(self, camera: str, number: int) -> Port:
        if self._selector is None:
            raise EvsError("this DV server is not open: call open(streams) first")
        port = self._ports.get((camera, number))
        if port is None:
            wanted = f"{camera}/{description.KINDS[number].name}"
            raise unknown("DV stream", wanted, self.ports)
        return port

    def _send(self, port: Port, number: int, plain: bytes, elements: int) -> None:
        body = self._compress(plain)
        message = layout.PACKET_HEADER.pack(number, len(body)) + body
        self.meter.lap("pack")
        port.send(message, elements)

    def _serve_clients(self, wait_s: float = 0.0) -> None:
        """Accept new clients, send to those that have room, and discard what they sent."""
        if self._selector is None:
            return
        for key, events in self._selector.select(wait_s):
            port, client = key.data
            # an earlier one of these may have removed it
            if client is None or client in port.clients:
                port.serve(client, events)

    def _await_clients(self) -> None:
        deadline_s = monotonic_s() + self._wait_s
        while (came := self._listeners()) < self._wait_for:
            remaining_s = deadline_s - monotonic_s()
            if remaining_s <= 0:
                raise EvsError(
                    f"{came} of {self._wait_for} DV clients came to {self._address} within "
                    f"{self._wait_s:g} s: start them while this waits, or give wait_s more"
                )
            self._serve_clients(min(_WAIT_S, remaining_s))

    def _listeners(self) -> int:
        ports = self._ports.items()
        return sum(len(port.clients) for (_, kind), port in ports if not kind)

    def _linger(self) -> None:
        deadline_s = monotonic_s() + self._linger_s
        while any(port.is_waiting for port in self._ports.values()):
            remaining_s = deadline_s - monotonic_s()
            if remaining_s <= 0:
                break
            self._serve_clients(min(_WAIT_S, remaining_s))
        deadline_s = monotonic_s() + min(GRACE_S, self._linger_s)
        while any(port.clients for port in self._ports.values()):
            remaining_s = deadline_s - monotonic_s()
            if remaining_s <= 0:
                return
            self._serve_clients(remaining_s)

    def _counts(self) -> dict[str, Any]:
        every = self._ports.values()
        return {
            "ports": self.ports,
            "clients": sum(port.came for port in every),
            "clients_refused": sum(port.refused for port in every),
        }

    def _totals(self) -> dict[str, int]:
        sent = [port.sent for port in self._ports.values()]
        events = [port.sent for (_, kind), port in self._ports.items() if not kind]
        return {
            "packets_sent": sum(one.packets for one in sent),
            "bytes_sent": sum(one.bytes for one in sent),
            "packets_dropped": sum(one.packets_dropped for one in sent),
            "events_dropped": sum(one.elements_dropped for one in events),
        }

    def _release(self) -> None:
        for port in self._ports.values():
            port.close()
        if self._selector is not None:
            self._selector.close()
            self._selector = None
