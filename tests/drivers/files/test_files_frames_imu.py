"""Frames and IMU in recordings: round trips, other projects' readers, torn files, old files."""

from __future__ import annotations

import hashlib
import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

from evs.drivers import files
from evs.drivers.files.aedat4 import Aedat4File, Aedat4Recorder
from evs.drivers.files.npz import NpzRecorder
from evs.drivers.pictures.light_log import recorded_light
from evs.launch import main as program
from evs.msgs import (
    DEGREE,
    STANDARD_GRAVITY,
    EventPacket,
    EvsError,
    Frame,
    ImuPacket,
    ImuSamples,
    StreamInfo,
    empty_events,
    empty_imu,
    join_events,
    make_events,
)
from reference.oracles import OracleProgram

oracle = OracleProgram(Path(__file__).parents[2] / "support" / "oracles" / "aedat4_oracles.py")
BOTH = StreamInfo(34, 26, camera="left <&>", sensor="davis346", frames=True, imu=True)
FORMS = ("none.aedat4", "lz4.aedat4", "zstd.aedat4", "a.npz")

Everything = tuple[list[EventPacket], list[Frame], list[ImuPacket]]


def imu_samples(stamps: npt.ArrayLike, seed: int = 0) -> ImuSamples:
    """Random samples such as a device says: float32 in its own units."""
    random = np.random.default_rng(seed)
    samples = empty_imu(np.size(stamps))
    samples["t"] = stamps
    for key, unit, size in (
        ("acceleration", STANDARD_GRAVITY, 4.0),
        ("angular_velocity", DEGREE, 500.0),
    ):
        said = random.uniform(-size, size, (len(samples), 3)).astype(np.float32)
        samples[key] = said.astype(np.float64) * unit
    samples["temperature"] = np.float32(36.6)
    return samples


def made(bits: int = 8, ticks: int = 60, base_us: int = 0) -> Everything:
    """Events of some ticks, a frame every 10, two IMU samples a tick."""
    random = np.random.default_rng(bits)
    packets, frames, imus = [], [], []
    dtype = np.uint8 if bits == 8 else np.uint16
    for tick in range(ticks):
        begin = base_us + 1000 * tick
        t = np.sort(random.integers(begin + 1, begin + 1001, 40)) if tick % 7 else []
        events = make_events(t, *(random.integers(0, side, len(t)) for side in (34, 26, 2)))
        packets.append(EventPacket(tick, begin, begin + 1000, 34, 26, events, BOTH.camera))
        if tick % 10 == 9:
            stamps = begin - 8000, begin - 8000, begin - 3000, begin + 900
            image = random.integers(0, 1 << bits, (26, 34)).astype(dtype)
            frames.append(Frame(len(frames), *stamps, image, BOTH.camera))
        if tick > 0:
            samples = imu_samples([begin + 500, begin + 1000], tick)
            imus.append(ImuPacket(len(imus), samples, BOTH.camera))
    return packets, frames, imus


def record(path: Path, everything: Everything, stream: StreamInfo = BOTH) -> dict[str, Any]:
    packets, frames, imus = everything
    recorder = (
        NpzRecorder(path)
        if path.suffix == ".npz"
        else Aedat4Recorder(path, path.name.split(".")[0])
    )
    recorder.open([stream])
    for packet in packets:
        for frame in frames:
            if packet.time_base_us < frame.end_us <= packet.time_end_us:
                recorder.write_frame(frame)
        for imu in imus:
            if imu.samples["t"][-1] == packet.time_end_us:
                recorder.write_imu(imu)
        recorder.write(packet)
    return recorder.close()


def hashed(*columns: Any) -> str:
    summed = hashlib.sha256()
    for column in columns:
        summed.update(np.ascontiguousarray(column).tobytes())
    return summed.hexdigest()


@pytest.mark.parametrize("bits", [8, 16])
@pytest.mark.parametrize("form", FORMS)
def test_everything_comes_back(tmp_path: Path, form: str, bits: int) -> None:
    path, everything = tmp_path / form, made(bits)
    packets, frames, imus = everything
    said = record(path, everything)
    assert (said["frames"], said["imu_samples"]) == (6, 118)
    assert said["bytes"] == path.stat().st_size
    recording = files.read(path)
    assert recording.tobytes() == b"".join(packet.events.tobytes() for packet in packets)
    assert recording.stream == BOTH
    assert recording.frames == tuple(frames)
    assert recording.imu.tobytes() == b"".join(imu.samples.tobytes() for imu in imus)
    # they go along with slices and masks
    assert recording[recording["p"] == 1].frames == tuple(frames)
    assert len(recording[:5].imu) == 118


@pytest.mark.parametrize("form", FORMS)
def test_messages_come_in_the_order_recorded(tmp_path: Path, form: str) -> None:
    path, (packets, frames, imus) = tmp_path / form, made()
    record(path, (packets, frames, imus))
    messages = list(files.messages(path))
    assert [one for one in messages if isinstance(one, Frame)] == frames
    assert [one for one in messages if isinstance(one, ImuPacket)] == imus
    events = [one for one in messages if isinstance(one, EventPacket)]
    full = [packet for packet in packets if len(packet)]
    assert [(one.seq, one.time_end_us) for one in events] == [
        (seq, packet.time_end_us) for seq, packet in enumerate(full)
    ]
    ends = [
        one.time_end_us
        if isinstance(one, EventPacket)
        else -(-int(one.end_us if isinstance(one, Frame) else one.samples["t"][-1]) // 1000) * 1000
        for one in messages
    ]
    assert ends == sorted(ends)
    assert len(messages) == len(full) + 6 + 59


@pytest.mark.integration
@pytest.mark.parametrize("bits", [8, 16])
def test_dv_processing_and_aedat_read_frames_and_imu_bit_exactly(tmp_path: Path, bits: int) -> None:
    everything = made(bits, base_us=2**32 - 20_000)
    packets, frames, imus = everything
    paths = [tmp_path / form for form in FORMS[:3]]
    for path in paths:
        assert record(path, everything)["table"] == (path.name != "none.aedat4")
    samples = np.concatenate([imu.samples for imu in imus])
    force = (samples["acceleration"] / STANDARD_GRAVITY).astype(np.float32)
    turn = (samples["angular_velocity"] / DEGREE).astype(np.float32)
    warmth = samples["temperature"].astype(np.float32)[:, np.newaxis]
    imu = hashed(samples["t"], np.hstack([warmth, force, turn]))
    images = [hashed(frame.pixels) for frame in frames]
    for facts in oracle("dv-beside", *paths):
        assert facts["size"] == [34, 26]
        assert facts["frames"] == [
            [frame.exposure_begin_us, 5000, f"uint{bits}", image]
            for frame, image in zip(frames, images, strict=True)
        ]
        assert (facts["samples"], facts["imu"]) == (118, imu)
    for facts in oracle("aedat-beside", *paths):
        assert facts["frames"] == [
            [
                *(one.begin_us, one.exposure_begin_us, one.exposure_end_us, one.end_us),
                *("L" if bits == 8 else "I;16", image),
            ]
            for one, image in zip(frames, images, strict=True)
        ]
        assert (facts["samples"], facts["imu"]) == (118, imu)
    # and the events, by every reader, as ever
    whole = join_events([one.events for one in packets])
    for reader in ("dv-processing", "aedat", "faery"):
        for facts in oracle(reader, *paths):
            assert facts["error"] == "", reader
            assert facts["digest"] == oracle.digest(whole)


@pytest.mark.integration
def test_we_read_frames_and_imu_of_dv_processing(tmp_path: Path) -> None:
    for facts in oracle("write", tmp_path):
        recording = files.read(facts["path"])
        assert recording.stream.frames
        assert recording.stream.imu
        assert len(recording.frames) == 5
        for seq, frame in enumerate(recording.frames):
            assert frame.seq == seq
            assert frame.pixels.shape == (480, 640)
            assert (frame.pixels == 50 * seq).all()
            assert frame.exposure_end_us - frame.exposure_begin_us == 777
            assert frame.begin_us == frame.exposure_begin_us == recording["t"][5000 * seq + 4999]
        # 0 ... 9 are temperature, accelerometer, gyroscope, magnetometer
        assert recording.imu["temperature"].tolist() == [0.0] * 5
        assert recording.imu["acceleration"] / STANDARD_GRAVITY == pytest.approx(
            np.tile([1.0, 2.0, 3.0], (5, 1))
        )
        assert recording.imu["angular_velocity"] / DEGREE == pytest.approx(
            np.tile([4.0, 5.0, 6.0], (5, 1))
        )


@pytest.mark.integration
@pytest.mark.parametrize("form", FORMS[:3])
def test_a_torn_file_keeps_every_whole_frame_and_sample(tmp_path: Path, form: str) -> None:
    packets, frames, imus = made(16)
    path = tmp_path / form
    recorder = Aedat4Recorder(path, form.split(".")[0])
    recorder.open([BOTH])
    recorder.write(packets[1])
    recorder.write_imu(imus[0])
    recorder.write_frame(frames[0])
    whole = path.stat().st_size
    recorder.write_frame(frames[1])
    data = path.read_bytes()
    recorder.close()
    # killed at any byte of the last frame
    for cut in (whole + 1, whole + 8, whole + 9, len(data) - 1):
        torn = tmp_path / f"{cut}.{form}"
        torn.write_bytes(data[:cut])
        with pytest.warns(UserWarning, match=f"{cut - whole} bytes at offset {whole}"):
            recording = files.read(torn)
        assert recording.frames == (frames[0],)
        assert recording.imu.tobytes() == imus[0].samples.tobytes()
        assert files.repair(torn).cut_bytes == cut - whole
        assert torn.read_bytes() == data[:whole]
        assert files.read(torn).frames == (frames[0],)
        (facts,) = oracle("dv-beside", torn)
        assert (len(facts["frames"]), facts["samples"]) == (1, 2)


@pytest.mark.parametrize("form", FORMS[:3])
def test_repair_keeps_a_file_that_holds_no_event(tmp_path: Path, form: str) -> None:
    _, frames, imus = made()
    path = tmp_path / form
    record(path, ([EventPacket(0, 0, 60_000, 34, 26, empty_events())], frames, imus[-1:]))
    before = path.read_bytes()
    assert not files.repair(path).needed
    path.write_bytes(before + b"torn")
    assert files.repair(path).cut_bytes == 4
    assert path.read_bytes() == before
    recording = files.read(path)
    assert (len(recording), len(recording.frames), len(recording.imu)) == (0, 6, 2)


@pytest.mark.parametrize("form", FORMS[:3])
def test_a_damaged_frame_costs_that_frame_alone(tmp_path: Path, form: str) -> None:
    packets, frames, imus = made()
    path = tmp_path / form
    record(path, (packets, frames, imus))
    data = bytearray(path.read_bytes())
    body = frames[2].pixels.tobytes()
    at = data.find(body) if form == "none.aedat4" else -1
    if at < 0:
        # the third frame's packet, by its place in the file
        file, seen = Aedat4File.at(path), 0
        with path.open("rb") as raw:
            at = file.packets_at
            while True:
                number, packed = file._packet(raw, at)
                seen += number == 1
                if seen == 3:
                    break
                at += 8 + len(packed)
        data[at + 8 + 30] ^= 0x40
    else:
        # the number of pixels, before them
        data[at - 4] ^= 0x04
    path.write_bytes(data)
    recording = files.read(path)
    assert recording.frames[:2] == tuple(frames[:2])
    assert [frame.begin_us for frame in recording.frames] == [
        frame.begin_us for n, frame in enumerate(frames) if n != 2
    ]
    assert recording.tobytes() == b"".join(packet.events.tobytes() for packet in packets)
    summary = files.summary(path)
    assert (summary.damaged_packets, summary.frames) == (1, 5)


def test_files_without_them_are_as_they_were(tmp_path: Path) -> None:
    packets, _, _ = made()
    plain = StreamInfo(34, 26, camera=BOTH.camera)
    for form in FORMS:
        path = tmp_path / form
        record(path, (packets, [], []), plain)
        recording = files.read(path)
        assert recording.stream == plain
        assert recording.frames == ()
        assert recording.imu.tobytes() == b""
        if form.endswith(".aedat4"):
            assert list(Aedat4File.at(path).declared) == [0]
    with np.load(tmp_path / "a.npz") as arrays:
        assert set(arrays) == {"t", "x", "y", "p", "stream"}


def test_a_recorder_takes_only_what_was_declared(tmp_path: Path) -> None:
    _, frames, imus = made()
    recorder = Aedat4Recorder(tmp_path / "a.aedat4")
    recorder.open([StreamInfo(34, 26)])
    with pytest.raises(EvsError, match="for a camera without intensity frames: set frames"):
        recorder.write_frame(frames[0])
    with pytest.raises(EvsError, match="for a camera without IMU samples: set imu"):
        recorder.write_imu(imus[0])
    assert recorder.close()["error"] == ""
    npz = NpzRecorder(tmp_path / "a.npz")
    npz.open([BOTH])
    npz.write_frame(frames[0])
    with pytest.raises(EvsError, match="frames of one size"):
        npz.write_frame(made(16)[1][0])
    npz.close()


def test_a_full_disk_is_told(tmp_path: Path) -> None:
    _, frames, imus = made()
    recorder = Aedat4Recorder("/dev/full", "none")
    with pytest.raises(EvsError):
        recorder.open([BOTH])
    recorder.close()
    with pytest.raises(EvsError, match="not open for recording"):
        Aedat4Recorder(tmp_path / "x.aedat4").write_frame(frames[0])
    with pytest.raises(EvsError, match="not open for recording"):
        NpzRecorder(tmp_path / "x.npz").write_imu(imus[0])


def test_colour_frames_of_others_are_left_out_with_a_word(tmp_path: Path) -> None:
    path = tmp_path / "colour.aedat4"
    code = (
        "import dv_processing as dv, numpy as np, sys\n"
        "c = dv.io.MonoCameraWriter.Config('C', dv.CompressionType.LZ4)\n"
        "c.addFrameStream((4, 3)); c.addEventStream((4, 3))\n"
        "w = dv.io.MonoCameraWriter(sys.argv[1], c)\n"
        "s = dv.EventStore(); s.push_back(1000, 1, 1, True); w.writeEvents(s)\n"
        "w.writeFrame(dv.Frame(2000, np.zeros((3, 4, 3), np.uint8)))\n"
        "w.writeFrame(dv.Frame(3000, np.ones((3, 4), np.uint8)))\n"
    )
    subprocess.run([sys.executable, "-c", code, path], check=True, timeout=60)
    recording = files.read(path)
    with pytest.warns(files.LeftOutWarning, match="1 frames that are not grey"):
        frames = recording.frames
    assert [frame.begin_us for frame in frames] == [3000]


@pytest.mark.parametrize("form", ["lz4.aedat4", "a.npz"])
def test_evs_info_says_which_streams_a_file_has(
    tmp_path: Path, form: str, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / form
    record(path, made())
    assert program.main(["info", str(path)]) == 0
    said = capsys.readouterr().out
    assert "frames      6 intensity frames, 100.0 per second" in said
    # 118 samples at 1.5, 2, 2.5, ... 60 ms
    assert "imu         118 samples, 2,000.0 per second" in said
    assert program.main(["info", "--json", str(path)]) == 0
    found = json.loads(capsys.readouterr().out)
    assert (found["frames"], found["imu_samples"]) == (6, 118)
    assert found["stream"]["frames"] is True
    record(path, (made()[0], [], []), StreamInfo(34, 26))
    assert program.main(["info", str(path)]) == 0
    said = capsys.readouterr().out
    assert "frames" not in said
    assert "imu" not in said


@pytest.mark.parametrize("name", ["a.aedat4", "a.aedat3"])
def test_a_frame_of_a_region_keeps_its_place(name: str, tmp_path: Path) -> None:
    pixels = np.arange(1, 13, dtype=np.uint16).reshape(3, 4) * 257
    region = Frame(0, 10, 20, 30, 40, pixels, "eye", left=5, top=7)
    stream = StreamInfo(16, 12, camera="eye", frames=True)
    sink = files.recorder_for(tmp_path / name)
    sink.open([stream])
    sink.write(EventPacket(0, 0, 1000, 16, 12, make_events([5, 6], [1, 2], [3, 4], [0, 1])))
    sink.write_frame(region)
    sink.close()
    (found,) = files.read(tmp_path / name).frames
    assert (found.left, found.top) == (5, 7)
    assert np.array_equal(found.pixels, pixels)
    whole = np.zeros((12, 16), np.uint16)
    whole[7:10, 5:9] = pixels
    for other, wanted in (("b.aedat4", pixels), ("b.aedat3", pixels), ("b.npz", whole)):
        files.convert(tmp_path / name, tmp_path / other)
        (copy,) = files.read(tmp_path / other).frames
        assert np.array_equal(copy.pixels, wanted)
        assert (copy.left, copy.top) == ((0, 0) if wanted is whole else (5, 7))
    light = recorded_light([found], 16, 12)
    assert light is not None
    # in 8 bits, as it is drawn
    assert light.pictures[0].shape == whole.shape
    assert not light.pictures[0][whole == 0].any()
    assert light.pictures[0][9, 8] > 0
    # what lies outside of the sensor is cut off
    cut = replace(region, left=-1, top=11).on_sensor(16, 12)
    assert cut.pixels[11, :4].tolist() == [*pixels[0, 1:], 0]
