"""The DV server on the wire: its ports, what a slow client costs others, what is refused."""

from __future__ import annotations

import socket
import threading
import time

import numpy as np
import pytest

from evs.drivers.dv import DvServer
from evs.drivers.dv import port as ports_module
from evs.drivers.dv.port import Client
from evs.drivers.files.aedat4 import description, layout
from evs.drivers.sink import Stream
from evs.msgs import Events, EvsError, Frame, StreamInfo
from reference.dv_packets import ALL, ANY, TICKS, came, packet, serving


class Listener:
    """A client of ours: the stream as it is on the wire."""

    def __init__(self, port: int, buffer: int = 0) -> None:
        self.link = socket.socket()
        if buffer:
            self.link.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, buffer)
        self.link.settimeout(20)
        self.link.connect(("127.0.0.1", port))

    def header(self) -> layout.IOHeader:
        size = self.take(4)
        return layout.parse_io_header(size + self.take(int.from_bytes(size, "little")))

    def events(self) -> Events | None:
        """Of the next packet; None when the server has hung up."""
        head = self.take(8)
        if not head:
            return None
        number, size = layout.PACKET_HEADER.unpack(head)
        assert number == 0
        return layout.parse_events(self.take(size))

    def read_all(self, into: list[Events]) -> None:
        """Header and packets until the server hangs up."""
        assert self.header().compression == 0
        while (events := self.events()) is not None:
            into.append(events)

    def take(self, size: int) -> bytes:
        data = b""
        while len(data) < size:
            part = self.link.recv(size - len(data))
            if not part:
                assert data == b"", "cut in the midst of a packet"
                return b""
            data += part
        return data


@pytest.mark.slow
def test_a_stuck_client_loses_its_oldest_packets_and_nobody_else_any() -> None:
    big = [packet(seq, 20_000) for seq in range(TICKS)]
    slowest = 0.0
    with serving(queue=10, linger_s=20.0) as server:
        port = server.ports["eye/events"]
        stuck, quick = Listener(port, 4096), Listener(port)
        whole: list[Events] = []
        got: list[Events] = []
        reading = threading.Thread(target=quick.read_all, args=(whole,))
        waking = threading.Thread(target=stuck.read_all, args=(got,))
        try:
            came(server, 2)
            reading.start()
            for one in big:
                begin = time.perf_counter()
                server.write(one)
                slowest = max(slowest, time.perf_counter() - begin)
                # the quick one may keep up; the stuck one does not read at all
                time.sleep(0.005)
            waking.start()
            said = server.close()
            waking.join()
            reading.join()
        finally:
            quick.link.close()
            stuck.link.close()
    assert [events.tobytes() for events in whole] == [one.events.tobytes() for one in big]
    # what the stuck one has is whole packets in their order, the newest ten among them
    seqs = [int(events["t"][0] - 1) // 1000 for events in got]
    assert seqs == sorted(set(seqs))
    assert seqs[-10:] == list(range(TICKS - 10, TICKS))
    assert all(
        events.tobytes() == big[seq].events.tobytes() for seq, events in zip(seqs, got, strict=True)
    )
    lost = TICKS - len(got)
    assert lost > 5
    assert (said["packets_dropped"], said["events_dropped"]) == (lost, 20_000 * lost)
    assert slowest < 0.5


@pytest.mark.slow
def test_clients_that_never_read_cost_no_calls_of_the_system(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Sixty that are full cost a packet an entry in their queues; one that reads again gets all."""
    flushed: list[Client] = []
    flush = Client.flush

    def counting(self: Client) -> bool:
        flushed.append(self)
        return flush(self)

    monkeypatch.setattr(Client, "flush", counting)
    got: list[Events] = []
    with serving(queue=5, linger_s=20.0) as server:
        stuck = [Listener(server.ports["eye/events"], 4096) for _ in range(60)]
        came(server, 60)
        clients = tuple(server._ports["eye", description.EVENT_STREAM].clients)
        for _ in range(20):
            server.write(packet(0, 200_000))
        assert all(client.is_full for client in clients)
        flushed.clear()
        for seq in range(200):
            server.write(packet(seq, 100))
        assert flushed == []
        reading = threading.Thread(target=stuck[0].read_all, args=(got,))
        reading.start()
        for one in stuck[1:]:
            one.link.close()
        server.close()
        reading.join()
        stuck[0].link.close()
    # what was begun, whole, and the newest five
    newest = [packet(seq, 100).events.tobytes() for seq in range(195, 200)]
    assert [events.tobytes() for events in got][-5:] == newest
    assert set(flushed) >= {clients[0]}


def test_who_comes_late_gets_the_description_and_what_is_new() -> None:
    with serving() as server:
        port = server.ports["eye/events"]
        for seq in range(5):
            server.write(packet(seq, 10))
        late = Listener(port)
        came(server, 1)
        server.write(packet(5, 10))
        assert "/outInfo/0/" in late.header().xml
        events = late.events()
        assert events is not None
        assert events.tobytes() == packet(5, 10).events.tobytes()
        late.link.close()


@pytest.mark.parametrize("patience_s", [1.0, 1e6, float("inf")])
def test_any_patience_is_one_that_the_system_counts(patience_s: float) -> None:
    server = DvServer("tcp://127.0.0.1:0", patience_s=patience_s, linger_s=0.0)
    server.open([StreamInfo(346, 260, "eye")])
    listener = Listener(server.ports["eye/events"])
    came(server, 1)
    assert listener.header().compression >= 0
    listener.link.close()
    server.close()


def test_nothing_is_encoded_while_nobody_listens() -> None:
    laps: list[str] = []

    class Watch:
        def lap(self, stage: str) -> None:
            laps.append(stage)

    server = DvServer(ANY)
    assert Stream.FRAMES in server.streams
    assert Stream.IMU in server.streams
    assert Stream.TRIGGERS in server.streams
    server.meter = Watch()
    server.open([ALL])
    for seq in range(5):
        server.write(packet(seq, 10))
    assert laps == []
    listener = Listener(server.ports["eye/events"])
    came(server, 1)
    server.write(packet(5, 10))
    assert laps == ["pack"]
    listener.link.close()
    assert server.close()["packets_sent"] == 1


def test_clients_that_talk_vanish_or_are_too_many_do_no_harm(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(ports_module, "MAX_CLIENTS", 3)
    with serving() as server:
        port = server.ports["eye/events"]
        good, talker, gone = Listener(port), Listener(port), Listener(port)
        came(server, 3)
        too_many = Listener(port)
        talker.link.sendall(b"GET / HTTP/1.1\r\n\r\n" * 5000)
        # a connection that is reset, not closed
        gone.link.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, b"\x01\0\0\0\0\0\0\0")
        gone.link.close()
        good.header(), talker.header()
        for seq in range(50):
            server.write(packet(seq, 100))
            for one in (good, talker):
                events = one.events()
                assert events is not None
                assert events.tobytes() == packet(seq, 100).events.tobytes()
        assert too_many.take(1) == b""
        for one in (good, talker, too_many):
            one.link.close()
        came(server, 0)
        said = server.close()
    assert (said["clients"], said["clients_refused"]) == (3, 1)
    assert server.close() == said


def test_each_camera_has_its_ports_in_a_row() -> None:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        base = min(probe.getsockname()[1], 60_000)
    left = StreamInfo(346, 260, camera="left", imu=True)
    right = StreamInfo(346, 260, camera="right", frames=True)
    try:
        server = DvServer(f"tcp://127.0.0.1:{base}")
        server.open([left, right])
    except EvsError:
        # somebody else has one of them: any other place will do
        base += 100
        server = DvServer(f"tcp://127.0.0.1:{base}")
        server.open([left, right])
    try:
        assert server.ports == {
            "left/events": base,
            "left/imu": base + 2,
            "right/events": base + 4,
            "right/frames": base + 5,
        }
        listener = Listener(base + 4)
        came(server, 1)
        server.write(packet(0, 5, camera="left"))
        server.write(packet(1, 5, camera="right"))
        listener.header()
        events = listener.events()
        assert events is not None
        assert events.tobytes() == packet(1, 5).events.tobytes()
        listener.link.close()
        with pytest.raises(EvsError, match=r"no DV stream 'left/frames'; there is: "):
            server.write_frame(Frame(0, 0, 0, 1, 1, np.zeros((2, 2), np.uint8), "left"))
        with pytest.raises(EvsError, match=f"cannot serve DV on 127.0.0.1 port {base}: "):
            DvServer(f"tcp://127.0.0.1:{base}").open([left])
    finally:
        server.close()


@pytest.mark.parametrize(
    ("address", "says"),
    [
        ("tcp://0.0.0.0:7777", "its protocol has no keys"),
        ("tcp://192.168.1.5:7777", r"use tcp://127\.0\.0\.1:7777, or insecure=true"),
        ("tcp://robot:7777", "insecure=true"),
        ("127.0.0.1:7777", "not of the form tcp://HOST:PORT"),
        ("tcp://127.0.0.1:99999", "ports end at 65535"),
    ],
)
def test_addresses_that_are_refused(address: str, says: str) -> None:
    with pytest.raises(EvsError, match=says):
        DvServer(address)


def test_bad_numbers_and_calls_out_of_order_are_told() -> None:
    for options in ({"queue": 0}, {"wait_for": -1}, {"wait_s": float("nan")}, {"linger_s": -1.0}):
        with pytest.raises(EvsError, match="or more"):
            DvServer(ANY, **options)
    with pytest.raises(EvsError, match="no compression 'lz5'"):
        DvServer(ANY, compression="lz5")
    with pytest.raises(EvsError, match="ports up to 65536"):
        DvServer("tcp://127.0.0.1:65535").open([ALL])
    with pytest.raises(EvsError, match="not open"):
        DvServer(ANY).write(packet(0, 1))
    with pytest.raises(EvsError, match="0 of 1 DV clients came"):
        DvServer(ANY, wait_for=1, wait_s=0.05).open([ALL])
    with serving() as server, pytest.raises(EvsError, match="open already"):
        server.open([ALL])
