"""Frames and IMU packets on the wire: what is sent arrives; other bytes are refused."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import msgpack
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from evs.msgs import (
    IMU_DTYPE,
    Frame,
    ImuPacket,
    MessageError,
    decode_frame,
    decode_imu,
    empty_imu,
    encode_frame,
    encode_imu,
)

pytestmark = pytest.mark.property

IMAGE = np.arange(12, dtype=np.uint8).reshape(3, 4)
FRAME = Frame(3, 40_000, 40_000, 50_000, 53_000, IMAGE, "track")
SAMPLES = empty_imu(3)
SAMPLES["t"] = 1, 2, 5
SAMPLES["acceleration"] = [[0.1, -9.81, 0.2]] * 3
PACKET = ImuPacket(7, SAMPLES, "track")
FRAME_HEADER, FRAME_BYTES = encode_frame(FRAME)[0], bytes(encode_frame(FRAME)[1])
IMU_HEADER, IMU_BYTES = encode_imu(PACKET)[0], bytes(encode_imu(PACKET)[1])


@given(
    st.integers(1, 40),
    st.integers(1, 40),
    st.sampled_from(["u1", "<u2"]),
    st.lists(st.integers(-(2**62), 2**62), min_size=4, max_size=4),
    st.integers(0, 2**63 - 1),
)
def test_a_frame_arrives_as_it_was_sent(
    width: int, height: int, kind: str, stamps: list[int], seq: int
) -> None:
    image = np.random.default_rng(width).integers(0, 256, (height, width)).astype(kind)
    sent = Frame(seq, *sorted(stamps), image, "cam")
    header, raw = encode_frame(sent)
    assert decode_frame(header, bytes(raw)) == sent
    # also of pixels that do not lie in a row
    turned = replace(sent, pixels=np.asfortranarray(image))
    assert bytes(encode_frame(turned)[1]) == bytes(raw)


@given(st.lists(st.integers(-(2**62), 2**62), max_size=20), st.floats(-1e6, 1e6))
def test_samples_arrive_as_they_were_sent(stamps: list[int], value: float) -> None:
    samples = empty_imu(len(stamps))
    samples["t"] = sorted(stamps)
    samples["angular_velocity"] = value
    sent = ImuPacket(0, samples, "cam")
    assert decode_imu(*map(bytes, encode_imu(sent))) == sent
    assert IMU_DTYPE.itemsize == 64


def test_numpys_integers_are_welcome() -> None:
    frame = replace(FRAME, seq=np.int64(3), begin_us=np.int64(40_000))
    assert encode_frame(frame)[0] == FRAME_HEADER
    assert encode_imu(replace(PACKET, seq=np.uint8(7)))[0] == IMU_HEADER


@given(st.lists(st.tuples(st.integers(0, 300), st.integers(0, 255)), max_size=4), st.binary())
def test_changed_bytes_are_refused_or_keep_the_promises(
    changes: list[tuple[int, int]], tail: bytes
) -> None:
    for header, raw, decoder in (
        (FRAME_HEADER, FRAME_BYTES, decode_frame),
        (IMU_HEADER, IMU_BYTES, decode_imu),
    ):
        changed, body = bytearray(header), bytearray(raw)
        for place, value in changes:
            target = changed if place < len(changed) else body
            target[place % len(target)] = value
        try:
            message: Any = decoder(bytes(changed), bytes(body) + tail)
        except MessageError:
            continue
        if isinstance(message, Frame):
            stamps = [message.begin_us, message.exposure_begin_us, message.exposure_end_us]
            assert stamps == sorted(stamps)
            assert message.pixels.nbytes == len(body) + len(tail)
        else:
            assert list(message.samples["t"]) == sorted(message.samples["t"])
            assert np.isfinite(message.samples["acceleration"]).all()


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"encoding": "rgb8"}, "frame encoding 'rgb8' is not mono8 or mono16"),
        ({"is_bigendian": True}, "not marked little-endian"),
        ({"width": 0}, "'width' is 0"),
        ({"end": 45_000}, "run backwards"),
        ({"width": 5}, "raw frame of 12 bytes is not 5x3"),
        ({"camera": ""}, "a name is"),
    ],
)
def test_headers_that_do_not_fit_are_refused(changes: dict[str, Any], said: str) -> None:
    fields = {**msgpack.unpackb(FRAME_HEADER), **changes}
    with pytest.raises(MessageError, match=said):
        decode_frame(msgpack.packb(fields), FRAME_BYTES)


def test_senders_hear_of_it_first() -> None:
    with pytest.raises(MessageError, match=r"frame is float64 of shape \(2, 2\)"):
        encode_frame(replace(FRAME, pixels=np.zeros((2, 2))))
    with pytest.raises(MessageError, match="run backwards"):
        encode_frame(replace(FRAME, end_us=0))
    with pytest.raises(MessageError, match="not an \\(n,\\) array of IMU_DTYPE"):
        encode_imu(replace(PACKET, samples=np.zeros(3)))
    backwards = SAMPLES[::-1]
    with pytest.raises(MessageError, match="not sorted by t"):
        encode_imu(replace(PACKET, samples=backwards))
    bad = SAMPLES.copy()
    bad["acceleration"][1, 2] = np.nan
    with pytest.raises(MessageError, match="not finite"):
        encode_imu(replace(PACKET, samples=bad))
    with pytest.raises(MessageError, match="not whole IMU samples"):
        decode_imu(IMU_HEADER, IMU_BYTES[:-1])


def test_frames_and_packets_are_values() -> None:
    assert replace(FRAME, pixels=IMAGE.copy()) == FRAME
    assert replace(FRAME, pixels=IMAGE.astype(np.uint16)) != FRAME
    assert replace(FRAME, end_us=53_001) != FRAME
    assert replace(PACKET, samples=SAMPLES.copy()) == PACKET
    assert replace(PACKET, samples=SAMPLES[:2]) != PACKET
    assert (FRAME.width, FRAME.height, len(PACKET)) == (4, 3, 3)
