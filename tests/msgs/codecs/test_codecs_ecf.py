"""ECF: chunks that Prophesee's own codec (1.0.1) encoded, round trips, damaged chunks."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from evs.msgs import Events, make_events
from evs.msgs.codecs.ecf import MAX_EVENTS, decode_ecf, encode_ecf
from evs.msgs.header_fields import MessageError
from reference.mutations import mutations

PROPHESEE = {
    "rows": (
        "80020000e8030000000000000f1400313131313131313131313131313131313131313131313131313131"
        "31313131313131313131313131fcfbf201f4f101f4f101f4f101f4f101f4f101f4f101f4f101f4f101f4"
        "f101f4f101f4f101f4f101f4f101f4f101f4f101f4f101f4f101f4f101f4f101f4f101f4f101f4f101f4"
        "f101f4f101f4f101f4f101f4f101f4f101f4f101f4f101f4f101f4f101f4f101f4f101f4f101f4f101f4"
        "f101f4f101f4f101f2fff3fcfaf9fbf30212121212121212121212121212121212121212121212121212"
        "121212129f572800bf572800df572800ff57280013001301130213031304130513061307130813091300"
        "130113021303130413051306130713081309130013011302130313041305130613071308130913001301"
        "13021303130413051306130713081309ff8c0014"
    ),
    "lines": (
        "81020000e8030000000000000f1400313131313131313131313131313131313131313131313131313131"
        "31313131313131313131313131fcfbf201f4f101f4f101f4f101f4f101f4f101f4f101f4f101f4f101f4"
        "f101f4f101f4f101f4f101f4f101f4f101f4f101f4f101f4f101f4f101f4f101f4f101f4f101f4f101f4"
        "f101f4f101f4f101f4f101f4f101f4f101f4f101f4f101f4f101f4f101f4f101f4f101f4f101f4f101f4"
        "f101f4f101f4f101f2fff3fcfaf9fbf30212121212121212121212121212121212121212121212121212"
        "121212129f572800bf572800df572800ff5728001b00957c5f539312bd8f87641b25e501af7593370d14"
        "d7961b4a3526ff07935c5d3927191b6f854b4f209381ad5e77311b94d5709f429306fd83c7531b192595"
        "ef74932b4d0817861b3e751a3f9793509d2d67081b63c53f8f199375ed52b7201b881564df41939a3d77"
        "07531b0d65892f64931f8d9c57751b32b50e7f869344dd21a7971b570533cf1893692d46f7291b7c5558"
        "1f31938e7d6b47421b01a57d6f539313cd9097641b26f502bf7593381d15e7961b4b45270f08935d6d3a"
        "37191b70954c5f209382bd5f87311b95e571af4282070c84d6630a1a3496fe74822c5c0926860a3f841b"
        "4e978251ac2e7608"
    ),
    "points": (
        "82020000e8030000000000000f1400313131313131313131313131313131313131313131313131313131"
        "31313131313131313131313131fcfbf201f4f101f4f101f4f101f4f101f4f101f4f101f4f101f4f101f4"
        "f101f4f101f4f101f4f101f4f101f4f101f4f101f4f101f4f101f4f101f4f101f4f101f4f101f4f101f4"
        "f101f4f101f4f101f4f101f4f101f4f101f4f101f4f101f4f101f4f101f4f101f4f101f4f101f4f101f4"
        "f101f4f101f4f101f2fff3fcfaf9fbf30212121212121212121212121212121212121212121212121212"
        "12121212cb010000952517245f33121bf3294109bd66580087741b241b518212e5a79009afb524004379"
        "c31b0de9d112d7f600096ba104253520121cff370a1393c945015d6153252779131cbbf1860a85a29401"
        "4fb01c25e319c813ade3d50a77f125010b41091dd52417149f32020b33694026fd65581dc7730b145b91"
        "810225a79926efb4141d83b9c20b4de8d00217f61d26abe103157529110c3f372703d309451e9d605215"
        "6778030cfb318627c5a1931e8fb90c152359c703ede2d527b7f0151e4b81080d15241604df311f2873a9"
        "49163d65570d077328049bd1801f65a698162fb4040dc3f9c1288de7d91f57f50d16eb210305b5281029"
        "7f3617201349440edd695205a77720293b71851705a1930ecfb829056399c6202de2d417f7f9050e8bc1"
        "072a552315211f310f18b3e948067d64562a47721821db11800fa5a597066fb3212a0339c118cde6d90f"
        "97f42a062b610222f5271019bf3507105389432b1d695122e77610197bb1840745a0922b0fb81922a3d9"
        "c5106de1d30737f9222bcb01071a952214115f302c08f3294823bd63551a877108111b51892ce5a49723"
        "afb2111a4278c0080ce6d82cd6f31a236aa0011234271909fe34240092c8421b5c68501226760009baf0"
        "832484a9911b4eb70912e218c500ace0d22476f8121b"
    ),
}
"""packing -> the chunk of the events below, as Prophesee's encoder wrote it"""


def events_of(packing: str) -> Events:
    """160 events: runs of one time, short and long steps, runs of rows and polarities."""
    k = np.arange(160)
    steps = np.where(k < 60, (k - 19) * 3, np.where(k < 100, (k - 19) * 20, 10**9 + k // 2))
    x = k % 40 * 2 - k % 2 if packing == "rows" else k * 997 % 1280
    y = k * 577 % 720 if packing == "points" else k // 40 + 700
    return make_events(1000 + np.where(k < 20, 0, steps), x, y, k < 140)


@pytest.mark.parametrize(("packing", "flags"), [("rows", 0), ("lines", 1), ("points", 2)])
def test_chunks_of_prophesees_encoder_are_read(packing: str, flags: int) -> None:
    chunk = bytes.fromhex(PROPHESEE[packing])
    assert chunk[0] & 3 == flags
    assert decode_ecf(chunk).tobytes() == events_of(packing).tobytes()


def test_we_write_the_bytes_of_prophesees_encoder() -> None:
    assert encode_ecf(events_of("points")).hex() == PROPHESEE["points"]


STEPS = st.sampled_from([0, 0, 0, 1, 14, 15, 16, 255, 256, 2**31, 2**52, 2**57 - 1])
PLACES = st.integers(0, 2047)
ROWS = st.lists(st.tuples(STEPS, st.integers(1, 40), PLACES, PLACES), min_size=1, max_size=20)


@given(rows=ROWS, first_us=st.sampled_from([0, 1, 2**40]))
def test_events_come_back(rows: list[tuple[int, int, int, int]], first_us: int) -> None:
    steps, counts, x, y = np.array(rows, np.int64).T
    t = np.repeat(first_us + np.cumsum(steps), counts)
    events = make_events(t, np.repeat(x, counts), np.repeat(y, counts), t % 2)
    assert decode_ecf(encode_ecf(events)).tobytes() == events.tobytes()


def test_a_chunk_may_have_as_many_events_as_it_can_count() -> None:
    k = np.arange(MAX_EVENTS)
    for t in (k, k * 0, k // 1000 * 17):
        events = make_events(t, k % 1280, k % 720, k % 2)
        assert decode_ecf(encode_ecf(events)).tobytes() == events.tobytes()


@pytest.mark.parametrize(
    ("events", "said"),
    [
        (make_events([], [], [], []), "1 ... 65535 events at once, got 0"),
        (make_events(np.arange(65_536), 0, 0, 0), "got 65536"),
        (make_events([1], [2048], [0], [0]), "ECF holds x of 0 ... 2047 px"),
        (make_events([-1], [0], [0], [0]), "no negative time"),
        (make_events([2, 1], 0, 0, 0), "not sorted by t"),
    ],
)
def test_what_does_not_fit_is_refused(events: Events, said: str) -> None:
    with pytest.raises(MessageError, match=said):
        encode_ecf(events)


def test_an_empty_chunk_has_no_events() -> None:
    assert len(decode_ecf(bytes(12))) == 0


@settings(max_examples=300)
@given(data=st.data(), packing=st.sampled_from(list(PROPHESEE)))
def test_a_damaged_chunk_is_read_or_refused(data: st.DataObject, packing: str) -> None:
    chunk = data.draw(mutations(bytes.fromhex(PROPHESEE[packing])))
    try:
        count = len(decode_ecf(chunk))
    except MessageError:
        return
    assert count == int.from_bytes(chunk[:4], "little") >> 2


def test_damage_is_named() -> None:
    chunk = bytes.fromhex(PROPHESEE["points"])
    for damaged, said in (
        (chunk[:11], "a chunk of 11 bytes has no header"),
        (b"\xff" * 40, "a chunk states 1073741823 events"),
        (chunk[:40], "not of its 160 events"),
        (chunk[:-1], "ends within x"),
        (chunk[:12] + b"\xf1" * 17 + chunk[12:], "a step in time is too long"),
        (bytes.fromhex(PROPHESEE["rows"])[:-60], "a chunk ends within x"),
    ):
        with pytest.raises(MessageError, match=said):
            decode_ecf(damaged)
