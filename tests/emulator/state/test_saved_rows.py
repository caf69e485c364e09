"""Saved states whose head lies, under a right checksum: one line, before memory is taken."""

from __future__ import annotations

import json
import struct
import tracemalloc
import zlib
from typing import Any

import mujoco
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from evs.emulator import ClosedLoop
from evs.emulator.config import SensorConfig
from evs.emulator.config.schema import DelayConfig
from evs.msgs import EvsError

pytestmark = pytest.mark.property

SCENE = """
<mujoco>
  <worldbody>
    <light pos="0 -1 3"/>
    <camera name="left" pos="0 -2 .6" xyaxes="1 0 0 0 .2 1"/>
    <body pos="0 0 .8"><joint name="swing" axis="0 1 0"/>
      <geom type="capsule" fromto="0 0 0 .6 0 0" size=".05" rgba=".9 .9 .9 1"/></body>
  </worldbody>
  <actuator><motor joint="swing" gear="2"/></actuator>
</mujoco>
"""
START = struct.Struct("<8sIII")
MOST_BYTES = 80e6
"""64 MiB that any state may take, and these few arrays"""
BIG = 2**30


@pytest.fixture(scope="module")
def loop() -> ClosedLoop:
    model = mujoco.MjModel.from_xml_string(SCENE)
    sensor = SensorConfig("dvs128", width=12, height=9)
    loop = ClosedLoop(model, sensor=sensor, threads=1, delays=DelayConfig(transport_us=3000))
    loop.reset(seed=1)
    loop.step([0.5], ticks=9)
    return loop


@pytest.fixture(scope="module")
def blob(loop: ClosedLoop) -> bytes:
    return loop.save()


def parts_of(blob: bytes) -> tuple[dict[str, Any], bytes]:
    size = START.unpack(blob[: START.size])[3]
    head = zlib.decompress(blob[START.size : START.size + size])
    return json.loads(head), blob[START.size + size :]


def joined(head: Any, data: bytes) -> bytes:
    packed = zlib.compress(head if isinstance(head, bytes) else json.dumps(head).encode())
    rest = struct.pack("<I", len(packed)) + packed + data
    return b"evs save" + struct.pack("<II", 1, zlib.crc32(rest)) + rest


def refused(loop: ClosedLoop, blob: bytes) -> None:
    """In one line that any wire can carry, and without the memory that it asks for."""
    before = loop.t_us
    tracemalloc.start()
    try:
        with pytest.raises(EvsError) as caught:
            loop.restore(blob)
        assert tracemalloc.get_traced_memory()[1] < MOST_BYTES
    finally:
        tracemalloc.stop()
    line = str(caught.value)
    assert line
    assert line.encode().count(b"\n") == 0
    assert loop.t_us == before


@pytest.mark.parametrize(
    "row",
    [
        ["zz", "<U0", [], "raw", 0],
        ["zz", "|u1", [0] + [BIG] * 7, "raw", 0],
        ["zz", "|u1", [BIG] * 7 + [0], "one", 1],
        ["zz", "|u1", [BIG], "one", 1],
        ["zz", "<U99999", [], "raw", 0],
        ["zz\ud800", "|u1", [0], "raw", 0],
        ["\ud800", "<f8", [], "one", 8],
    ],
)
def test_a_row_that_cannot_be(loop: ClosedLoop, blob: bytes, row: list[Any]) -> None:
    head, data = parts_of(blob)
    refused(loop, joined({**head, "arrays": [*head["arrays"], row]}, data + bytes(row[4])))
    refused(loop, joined({**head, "arrays": [row]}, bytes(row[4])))


@pytest.mark.parametrize("way", ["one", "deflate"])
@pytest.mark.parametrize("name", ["channels.0.packets.bytes", "world.given", "done"])
def test_a_few_bytes_take_no_memory(loop: ClosedLoop, blob: bytes, name: str, way: str) -> None:
    """Also where an array of this name and kind belongs there, of any length."""
    head, data = parts_of(blob)
    names = [row[0] for row in head["arrays"]]
    place = next(n for n, one in enumerate(names) if one.endswith(name.rpartition(".")[2]))
    row = head["arrays"][place]
    item = np.dtype(row[1]).itemsize
    count = 2**27 // item
    begin = sum(one[4] for one in head["arrays"][:place])
    stored = bytes(item) if way == "one" else zlib.compress(bytes(count * item), 1)
    shape = [count] + [1] * (max(1, len(row[2])) - 1)
    head["arrays"][place] = [row[0], row[1], shape, way, len(stored)]
    refused(loop, joined(head, data[:begin] + stored + data[begin + row[4] :]))


@pytest.mark.parametrize(
    "about",
    [
        b'{"kind": "\\ud800"}',
        b'{"kind": "loop", "versions": "\\udfff"}',
        b'{"\\ud800": 1}',
        *(b'{"kind": ' + b"[" * depth + b"]" * depth + b"}" for depth in (300, 900, 960, 5000)),
        b'{"kind": ' + b"9" * 5000 + b"}",
        b'{"kind": NaN}',
        b"[]",
    ],
    ids=lambda about: about[:20].decode() + str(len(about)),
)
def test_a_description_that_cannot_be(loop: ClosedLoop, about: bytes) -> None:
    refused(loop, joined(b'{"about": ' + about + b', "arrays": []}', b""))


def test_a_text_that_no_wire_carries(loop: ClosedLoop, blob: bytes) -> None:
    head, data = parts_of(blob)
    place = next(n for n, row in enumerate(head["arrays"]) if row[0] == "done")
    row = head["arrays"][place]
    begin = sum(one[4] for one in head["arrays"][:place])
    text = "\ud800".encode("utf-32-le", "surrogatepass")
    head["arrays"][place] = ["done", "<U1", [], "raw", 4]
    refused(loop, joined(head, data[:begin] + text + data[begin + row[4] :]))


COUNTS = st.one_of(st.integers(-2, 70), st.sampled_from([2**30, 2**31, 2**62, 2**64, 10**30]))
VALUES = st.one_of(COUNTS, st.none(), st.booleans(), st.floats(), st.text(max_size=4))
CHANGED = (
    st.one_of(st.text(max_size=5), VALUES),
    st.one_of(st.sampled_from(["<U0", "<U1", "|u1", "<f8", "<i8", ">i4", "|O", "<M8"]), VALUES),
    st.one_of(st.lists(VALUES, max_size=9), st.lists(COUNTS, max_size=9), VALUES),
    st.one_of(st.sampled_from(["raw", "one", "deflate"]), VALUES),
    VALUES,
)  # fmt: skip


@given(data=st.data())
@settings(max_examples=150)
def test_a_head_that_lies_does_no_harm(loop: ClosedLoop, blob: bytes, data: st.DataObject) -> None:
    """Refused in one line, or restored."""
    head, rest = parts_of(blob)
    row = head["arrays"][data.draw(st.integers(0, len(head["arrays"]) - 1))]
    for part in data.draw(st.sets(st.integers(0, 4), min_size=1, max_size=3)):
        row[part] = data.draw(CHANGED[part])
    try:
        loop.restore(joined(head, rest))
        loop.save()
    except EvsError as error:
        line = str(error)
        assert line
        assert line.encode().count(b"\n") == 0
