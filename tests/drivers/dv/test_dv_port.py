"""A client's queue: whatever it reads and when, whole messages in order, and every loss counts."""

from __future__ import annotations

import contextlib
import socket

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from evs.drivers.dv.port import Client, Sent

pytestmark = pytest.mark.property

STEPS = st.lists(
    st.one_of(
        st.tuples(st.just("put"), st.integers(1, 60_000)),
        st.tuples(st.just("read"), st.integers(1, 100_000)),
    ),
    max_size=60,
)


def message(number: int, size: int) -> bytes:
    """Its size, its number, and so many bytes that follow from them."""
    return size.to_bytes(4, "little") + number.to_bytes(4, "little") + bytes([number % 251]) * size


@settings(max_examples=150)
@given(STEPS, st.integers(1, 8))
def test_whole_messages_in_order_and_exact_counts(steps: list[tuple[str, int]], queue: int) -> None:
    ours, theirs = tcp_pair()
    ours.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, 8192)
    theirs.setblocking(False)
    sent = Sent()
    client = Client(ours, b"header", queue, sent)
    got = bytearray()
    put = 0

    def read(size: int) -> None:
        with contextlib.suppress(BlockingIOError):
            got.extend(theirs.recv(size))

    for what, size in steps:
        if what == "put":
            client.put(message(put, size), size)
            assert client.flush()
            put += 1
        else:
            read(size)
            assert client.flush()
    while client.is_waiting:
        read(1 << 20)
        assert client.flush()
    client.close()
    theirs.setblocking(True)
    while part := theirs.recv(1 << 20):
        got.extend(part)
    theirs.close()
    numbers, lost = parse(bytes(got))
    assert numbers == sorted(set(numbers))
    assert sent.packets == len(numbers)
    assert sent.packets_dropped == put - len(numbers)
    assert sent.bytes == len(got)
    missing = set(range(put)) - set(numbers)
    sizes = [size for what, size in steps if what == "put"]
    assert sent.elements_dropped == sum(sizes[number] for number in missing)
    # the newest are never those that are lost
    assert numbers[-min(queue, put) :] == list(range(put))[-min(queue, put) :]
    assert lost == b""


def parse(data: bytes) -> tuple[list[int], bytes]:
    assert data[:6] == b"header"
    at, numbers = 6, []
    while at < len(data):
        size = int.from_bytes(data[at : at + 4], "little")
        number = int.from_bytes(data[at + 4 : at + 8], "little")
        body = data[at + 8 : at + 8 + size]
        if len(body) < size:
            return numbers, data[at:]
        assert body == bytes([number % 251]) * size
        numbers.append(number)
        at += 8 + size
    return numbers, b""


def tcp_pair() -> tuple[socket.socket, socket.socket]:
    with socket.create_server(("127.0.0.1", 0)) as server:
        theirs = socket.socket()
        theirs.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 8192)
        theirs.connect(server.getsockname())
        ours, _ = server.accept()
    return ours, theirs
