"""Payloads that event_camera_codecs, ROS's own decoders, decoded bit-exactly: the same bytes today.

Run as a program beside a codecs_oracle that was built as tests/support/golden/README.md says, it
decodes them with those decoders again, and prints the digests: python
tests/msgs/codecs/test_codecs_codecs.py CODECS_ORACLE.
"""

from __future__ import annotations

import hashlib
import struct
import subprocess
import sys

import numpy as np
import pytest

from evs.msgs import Events, make_events
from evs.msgs.codecs import PAYLOADS, TIME_ORIGIN_US, PayloadReader, PayloadWriter

pytestmark = pytest.mark.golden

STARTS = {"0": 0, "2^24": 2**24, "2^31": 2**31, "2^32": 2**32, "2^34": 2**34}
SIZES = (0, 1, 1000, 65_535)
COUNT = 140_000
PINNED = {
    "evt3": "47f6c2b149895eb61ae3421d29d8c8d6e736d90c610330bc0dca2fe6b4552760",
    "libcaer": "44eaac1d63c0c10d276eeaddf50cf7e7d661b18f1d2b87ac6c10e728eccec95f",
    "libcaer_cmp": "93d9805152475e3914192e5b7f30fa66c198b614d6268fbff6b071b5366e802b",
    "mono": "6ab2939e565f41c19d8fe366bf677dec254a18feca6338bdf313ed74b27dbe7e",
}
"""sha256 of every packet of an encoding, framed as the oracle reads them."""

PINNED_COLUMNS = "03830ad6e926329ff6f37761e8b1089ba004531bf88394d59a9b18ccf1867b53"
"""sha256 of packets of libcaer_cmp whose events come in columns, framed as the oracle reads them"""

PINNED_COMPRESSED = "b72b8628f6a28d8b4a6ed61996eff174a0bf1c20327f0eb778c74fe7e86c300a"
"""sha256 of the events in the words of libcaer_cmp."""


def packets(start_us: int, size: int) -> list[Events]:
    """Events around a power of two of the time, over all of 2048 x 2048 px, some seconds long."""
    random = np.random.default_rng(start_us % 1000 + size)
    count = COUNT if size > 1 else 3000
    t = np.sort(random.integers(max(0, start_us - 20_000_000), start_us + 20_000_000, count))
    x, y = random.integers(0, 2048, count), random.integers(0, 2048, count)
    x[[0, -1]], y[[0, -1]] = [0, 2047], [0, 2047]
    events = make_events(t, x, y, random.integers(0, 2, count))
    if size == 0:
        return [events[:0], events[:7], events[:0], events[7:9]]
    parts = [events[k : k + size] for k in range(0, count, size)]
    # a mono packet is 4.29 s long at most
    longest = int(max(part["t"][-1] - part["t"][0] for part in parts))
    if longest > 4_000_000:
        for part in parts:
            part["t"] = t[0] + (part["t"] - t[0]) // (longest // 4_000_000 + 1)
    return parts


def column_packets() -> list[Events]:
    """Packets of edges that sweep the sensor: rows of a column that rise, fall, repeat and skip."""
    random = np.random.default_rng(24)
    parts = []
    for k, start_us in enumerate((0, 4095, 2**24 - 7, 2**31 - 9, 1_702_669_729_854_452)):
        count = 40_000
        # some thousand columns, each at one time and of one polarity
        sizes = random.integers(1, 40, count)
        column = np.repeat(np.arange(count), sizes)[:count]
        t = start_us + np.cumsum(random.choice([0, 1, 300, 4096], count))[column]
        y = random.integers(0, 2048, count)[column] + random.choice([0, 1, 1, 1, 3, -1], count)
        y = np.clip(y + np.arange(count) % 40, 0, 2047)
        x, p = random.integers(0, 2048, count)[column], random.integers(0, 2, count)[column]
        events = make_events(t, x, y, p)
        events["t"] = np.minimum(events["t"], start_us + 2**24 - 1)
        parts += np.split(events, [k, 1000, 1000, 30_000])
    return parts


def framed(encoding: str, parts: list[Events]) -> bytes:
    """Packets as the oracle reads them: time base, size, bytes."""
    writer = PayloadWriter(encoding)
    made = [writer.payload(part) for part in parts]
    return b"".join(struct.pack("<QI", base, len(data)) + data for base, data in made)


def digest(encoding: str) -> str:
    summed = hashlib.sha256()
    for start in STARTS.values():
        for size in SIZES:
            summed.update(framed(encoding, packets(start, size)))
    return summed.hexdigest()


@pytest.mark.parametrize("encoding", PAYLOADS)
def test_payloads_are_those_that_other_decoders_were_shown(encoding: str) -> None:
    assert digest(encoding) == PINNED[encoding]


def test_columns_are_those_that_another_decoder_was_shown() -> None:
    data = framed("libcaer_cmp", column_packets())
    assert hashlib.sha256(data).hexdigest() == PINNED_COLUMNS
    # vectors carry most of them
    assert len(data) < 2.1 * sum(map(len, column_packets()))


@pytest.mark.parametrize("encoding", PAYLOADS)
@pytest.mark.parametrize("start", STARTS)
def test_we_read_them_too(encoding: str, start: str) -> None:
    for size in SIZES:
        reader, writer = PayloadReader(encoding), PayloadWriter(encoding)
        # of packets of one event every sixth will do
        for part in packets(STARTS[start], size)[:: 6 if size == 1 else 1]:
            base, data = writer.payload(part)
            assert reader.events(data, base).tobytes() == part.tobytes()


def compressed() -> list[tuple[int, bytes]]:
    """Time bases, ns, and words of libcaer_cmp: of each kind, in any order, time going on."""
    random = np.random.default_rng(16)
    packets = []
    for count in (*SIZES, 20_000):
        kinds = random.choice(6, count, p=[0.02, 0.2, 0.2, 0.2, 0.18, 0.2])
        values = random.integers(0, 4096, count)
        values[kinds == 0] = np.sort(values[kinds == 0])
        # as their driver has it, x comes first; y of a vector, too
        words = np.concatenate([[0x2000 | 7, 0x4000 | 0x800 | 2040], kinds << 12 | values])
        packets.append((1_702_669_729_854_452_000 + count, words.astype("<u2").tobytes()))
    return packets


def compressed_events() -> Events:
    """What we read in those, on a sensor of 2048 x 2048 px."""
    reader = PayloadReader("libcaer_cmp")
    events = np.concatenate([reader.events(data, base) for base, data in compressed()])
    return events[(events["x"] < 2048) & (events["y"] < 2048)]


def test_libcaer_cmp_is_read_as_other_decoders_do() -> None:
    assert hashlib.sha256(compressed_events().tobytes()).hexdigest() == PINNED_COMPRESSED


def check_compressed(oracle: str) -> int:
    """The same with the other decoder: how many events were equal."""
    ours = compressed_events()
    data = b"".join(struct.pack("<QI", base, len(data)) + data for base, data in compressed())
    command = [oracle, "libcaer_cmp", "2048", "2048"]
    done = subprocess.run(command, input=data, capture_output=True, check=True)
    theirs = np.frombuffer(done.stdout, np.dtype("<u8,<u2,<u2,u1"))
    assert all((theirs[f"f{k}"] == ours[name]).all() for k, name in enumerate("txyp"))
    return len(ours)


def check(oracle: str, encoding: str) -> int:
    """Events that the other decoders gave back exactly; fails at the first that differs."""
    row = np.dtype([("t", "<u8"), ("x", "<u2"), ("y", "<u2"), ("p", "u1")])
    count = 0
    streams = [packets(start, size) for start in STARTS.values() for size in SIZES]
    if encoding == "libcaer_cmp":
        streams.append(column_packets())
    for parts in streams:
        ours = np.concatenate(parts)
        command = [oracle, encoding, "2048", "2048"]
        done = subprocess.run(
            command, input=framed(encoding, parts), capture_output=True, check=True
        )
        theirs = np.frombuffer(done.stdout, row)
        assert len(theirs) == len(ours), (encoding, ours[:1])
        # the counter of evt3 begins at the time origin
        origin = TIME_ORIGIN_US if encoding == "evt3" else 0
        # of libcaer_cmp they give us
        scale = 1 if encoding == "libcaer_cmp" else 1000
        assert (theirs["t"] == (ours["t"] + origin).astype(np.uint64) * scale).all()
        assert all((theirs[name] == ours[name]).all() for name in "xyp")
        count += len(ours)
    return count


if __name__ == "__main__":
    for name in PAYLOADS:
        print(f'    "{name}": "{digest(name)}",  # {check(sys.argv[1], name):,} events')
    summed = hashlib.sha256(framed("libcaer_cmp", column_packets())).hexdigest()
    print(f'PINNED_COLUMNS = "{summed}"')
    summed = hashlib.sha256(compressed_events().tobytes()).hexdigest()
    print(f'PINNED_COMPRESSED = "{summed}"  # {check_compressed(sys.argv[1]):,} events')
