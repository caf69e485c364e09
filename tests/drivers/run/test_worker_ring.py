"""The ring of a worker sink: whatever goes in comes out, whole and in order, at every wrap."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from evs.drivers.run.worker import messages
from evs.drivers.run.worker.shared_memory import HEAD, TAIL, RingReader, RingWriter, SharedMemory
from evs.emulator.base.scene import GroundTruth
from evs.msgs import EVENT_DTYPE, EventPacket, EvsError, Frame, ImuPacket, Pace, Pose, TriggerPacket
from evs.msgs.event import LABEL_DTYPE
from evs.msgs.ground_truth import TRUTH_CHANNELS
from evs.msgs.imu import IMU_DTYPE
from evs.msgs.trigger import TRIGGER_DTYPE

pytestmark = pytest.mark.property

RING = 64


@contextmanager
def ring(size: int, begin: int = 0) -> Iterator[tuple[RingWriter, RingReader]]:
    """Both sides of one, which `begin` bytes have gone through already."""
    with SharedMemory.make(size) as memory:
        memory.slots[HEAD] = memory.slots[TAIL] = begin
        sides = RingWriter(memory), RingReader(memory)
        yield sides


@given(
    st.lists(st.tuples(st.booleans(), st.integers(0, RING + 8)), max_size=60),
    st.integers(0, 2**62),
)
def test_it_is_a_queue_of_bytes(steps: list[tuple[bool, int]], begin: int) -> None:
    """Against a plain bytearray: what does not fit is refused whole, what is there is taken."""
    waiting, said = bytearray(), 0
    with ring(RING, begin) as (writer, reader):
        for writes, count in steps:
            if writes:
                message = bytes((said + k) % 251 for k in range(count))
                halves = [message[: count // 2], memoryview(message)[count // 2 :]]
                fits = len(waiting) + count <= RING
                assert writer.offer(halves) is fits
                if fits:
                    waiting += message
                    said += count
            else:
                target = bytearray(count)
                taken = reader.take(memoryview(target))
                assert taken == min(count, len(waiting))
                assert target[:taken] == waiting[:taken]
                del waiting[:taken]
            assert reader.waiting == len(waiting)
            assert writer.free == RING - len(waiting)


@given(st.binary(max_size=5 * RING), st.lists(st.integers(1, RING), min_size=1, max_size=9))
def test_a_message_larger_than_the_ring_goes_through_in_pieces(
    message: bytes, sizes: list[int]
) -> None:
    with ring(RING) as (writer, reader):
        done, got, turn = 0, b"", 0
        while len(got) < len(message):
            done += writer.pour(memoryview(message)[done:])
            target = bytearray(sizes[turn % len(sizes)])
            got += target[: reader.take(memoryview(target))]
            turn += 1
        assert got == message
        assert writer.pour(b"") == 0


@pytest.mark.slow
def test_two_threads_share_one_without_a_lock() -> None:
    random = np.random.default_rng(0)
    said = random.integers(0, 256, 300_000, np.uint8)
    got = np.zeros_like(said)
    with ring(1000) as (writer, reader):

        def read() -> None:
            done = 0
            while done < len(got):
                done += reader.take(got.data[done:])

        thread = threading.Thread(target=read)
        thread.start()
        done = 0
        while done < len(said):
            done += writer.pour(said.data[done : done + 700])
        thread.join(60)
    assert (got == said).all()


def test_more_memory_than_there_is_is_an_error_of_one_line() -> None:
    with pytest.raises(
        EvsError, match=r"over a quarter of this machine's; give \d+ or less as its worker_mb"
    ):
        SharedMemory.make(1 << 50)


def through(parts: list[bytes | memoryview]) -> messages.Message:
    """What the other side makes of a message."""
    whole = b"".join(bytes(part) for part in parts)
    place = 0

    def read(count: int) -> np.ndarray:
        nonlocal place
        place += count
        return np.frombuffer(whole[place - count : place], np.uint8)

    message = messages.receive(read, ("left", "right"))
    assert place == len(whole)
    return message


int64 = st.integers(-(2**63), 2**63 - 1)
counts = st.integers(0, 40)


def some(dtype: np.dtype, count: int, seed: int) -> np.ndarray:
    """(count,) any bytes at all."""
    raw = np.random.default_rng(seed).integers(0, 256, count * dtype.itemsize, np.uint8)
    return raw.view(dtype)


@given(counts, st.booleans(), st.tuples(int64, int64, int64), st.integers(1, 2**15 - 1), counts)
def test_packets_arrive_as_they_were(
    count: int, labelled: bool, span: tuple[int, int, int], side: int, seed: int
) -> None:
    events = some(EVENT_DTYPE, count, seed)
    labels = some(LABEL_DTYPE, count, seed + 1) if labelled else None
    sent = EventPacket(*span, side, 7, events, "right", labels)
    got = through(messages.of_events(sent, 1))
    assert isinstance(got, EventPacket)
    assert (got.seq, got.time_base_us, got.time_end_us) == span
    assert (got.width, got.height, got.camera) == (side, 7, "right")
    assert got.events.tobytes() == events.tobytes()
    assert (got.labels is None) is not labelled
    if got.labels is not None and labels is not None:
        assert got.labels.tobytes() == labels.tobytes()


def test_events_that_lie_apart_are_packed() -> None:
    events = np.zeros(10, EVENT_DTYPE)
    events["t"] = range(10)
    # every second one; and numpy's concatenate, which gives 13 bytes an event
    for odd in (events[::2], np.concatenate([events[:5], events[:5]])):
        got = through(messages.of_events(EventPacket(0, 0, 9, 4, 3, odd, "left"), 0))
        assert isinstance(got, EventPacket)
        assert got.events.dtype == EVENT_DTYPE
        assert got.events["t"].tolist() == odd["t"].tolist()


@given(st.tuples(*[int64] * 5), st.sampled_from(["u1", "<u2"]), st.integers(1, 9), counts)
def test_frames_imu_triggers_and_poses_arrive_as_they_were(
    stamps: tuple[int, ...], kind: str, height: int, seed: int
) -> None:
    pixels = some(np.dtype(kind), height * 5, seed).reshape(height, 5)
    frame = Frame(*stamps, pixels=pixels, camera="left")
    assert through(messages.of_frame(frame, 0)) == frame
    imu = ImuPacket(stamps[0], some(IMU_DTYPE, seed, seed), "right")
    assert through(messages.of_imu(imu, 1)) == imu
    marks = TriggerPacket(stamps[1], some(TRIGGER_DTYPE, seed, seed), "right")
    assert through(messages.of_triggers(marks, 1)) == marks
    pose = Pose(stamps[2], stamps[3], (1.5, -2.0, 1e-300), (0.0, 0.6, 0.0, 0.8), "left")
    assert through(messages.of_pose(pose, 0)) == pose
    pace = Pace(0.1, 5, 2**40, 3, 2**62)
    assert through(messages.of_pace(pace)) == pace


@given(int64, st.integers(1, 6), st.integers(1, 6))
def test_ground_truth_and_light_arrive_as_they_were(t_us: int, height: int, width: int) -> None:
    planes = {
        key: some(kind, height * width * count, count).reshape(
            (height, width) if count == 1 else (height, width, count)
        )
        for key, (kind, count) in TRUTH_CHANNELS.items()
    }
    got = through(messages.of_truth(GroundTruth(t_us, **planes), 1))
    assert isinstance(got, messages.TruthOf)
    assert (got.camera, got.truth.t_us) == ("right", t_us)
    for key, plane in planes.items():
        assert getattr(got.truth, key).tobytes() == plane.tobytes()
        assert getattr(got.truth, key).shape == plane.shape
    light = through(messages.of_light(t_us, planes["depth"], 0))
    assert isinstance(light, messages.Light)
    assert (light.camera, light.t_us) == ("left", t_us)
    assert light.luminance.tobytes() == planes["depth"].tobytes()
