"""Other projects read our AEDAT4 files bit-exactly, and we read dv-processing's."""

from __future__ import annotations

import json
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from evs.drivers.files import read
from evs.drivers.files.aedat4 import Aedat4File, Aedat4Recorder
from evs.msgs import EventPacket, Events, StreamInfo, join_events, make_events
from reference.oracles import OracleProgram
from reference.streams import random_events

pytestmark = pytest.mark.integration

oracle = OracleProgram(Path(__file__).parents[2] / "support" / "oracles" / "aedat4_oracles.py")
READERS = ("dv-processing", "aedat", "faery")
COMPRESSIONS = ("none", "lz4", "zstd")


def chunks(events: Events, tick_us: int) -> Iterator[Events]:
    ticks = -(-events["t"] // tick_us)
    yield from np.split(events, np.flatnonzero(np.diff(ticks)) + 1)


def record(path: Path, events: Events, stream: StreamInfo, compression: str) -> dict[str, Any]:
    recorder = Aedat4Recorder(path, compression)
    recorder.open([stream])
    for seq, part in enumerate(chunks(events, stream.tick_us)):
        packet = EventPacket(seq, 0, 0, stream.width, stream.height, part, stream.camera)
        recorder.write(packet)
    return recorder.close()


def seen(stream: StreamInfo, count: int, start_us: int, span_us: int) -> Events:
    size = stream.width, stream.height
    return random_events(count, start_us - 1, start_us + span_us - 1, size)


DAVIS = StreamInfo(
    346,
    260,
    camera="track <&> é",
    sensor="davis346",
    seed=2**70,
    versions={"evs": "0.1.0"},
    config={"scene": {"file": 'a "b" <c>.xml'}, "spp": [1, 2.5, None]},
    camera_info={"k": [300.0, 0, 173]},
)
LARGE = StreamInfo(1280, 720, camera="imx636")
CORNERS = make_events([1, 1, 2, 2], [0, 1279, 0, 1279], [0, 0, 719, 719], [1, 0, 1, 0])
CASES = {
    "many": (DAVIS, seen(DAVIS, 120_000, 1, 200_000)),
    "one": (DAVIS, make_events([1], [345], [259], [1])),
    "corners": (LARGE, CORNERS),
    "2^24": (DAVIS, seen(DAVIS, 100_000, 2**24 - 5000, 10_000)),
    "2^31": (LARGE, seen(LARGE, 100_000, 2**31 - 5000, 10_000)),
    "2^32": (DAVIS, seen(DAVIS, 100_000, 2**32 - 5000, 10_000)),
    # ticks of 65,535, 0, 1 and 65,535 events
    "65535": (
        LARGE,
        join_events(
            [
                seen(LARGE, 65_535, 1, 1000),
                make_events([2500], [1279], [719], [1]),
                seen(LARGE, 65_535, 3001, 1000),
            ]
        ),
    ),
    "empty": (DAVIS, make_events([], [], [], [])),
}


@pytest.fixture(scope="module")
def recordings(tmp_path_factory: pytest.TempPathFactory) -> dict[str, tuple[StreamInfo, Events]]:
    """Path to stream and events of every case, for each compression."""
    folder = tmp_path_factory.mktemp("recordings")
    found = {}
    for compression in COMPRESSIONS:
        for name, (stream, events) in CASES.items():
            path = folder / f"{name}.{compression}.aedat4"
            said = record(path, events, stream, compression)
            assert said["events"] == len(events)
            assert said["bytes"] == path.stat().st_size
            assert said["table"] == (compression != "none" and len(events) > 0)
            found[str(path)] = (stream, events)
    return found


@pytest.mark.parametrize("reader", READERS)
def test_whole_files_are_read_bit_exactly(
    reader: str, recordings: dict[str, tuple[StreamInfo, Events]]
) -> None:
    seen = oracle(reader, *recordings)
    assert len(seen) == len(recordings) == 24
    for facts in seen:
        stream, events = recordings[facts["path"]]
        assert facts["error"] == ""
        assert facts["events"] == len(events)
        assert facts["digest"] == oracle.digest(events)
        assert facts["resolution"] == [stream.width, stream.height]
        assert facts["packets"] >= len(np.unique(-(-events["t"] // 1000))) or reader == "faery"


def test_dv_processing_reads_the_description_and_seeks(
    recordings: dict[str, tuple[StreamInfo, Events]],
) -> None:
    for facts in oracle("dv-processing", *recordings):
        stream, events = recordings[facts["path"]]
        assert facts["camera"] == stream.camera
        assert json.loads(facts["info"]["config"]) == stream.config
        assert json.loads(facts["info"]["versions"]) == stream.versions
        assert json.loads(facts["info"]["camera_info"]) == stream.camera_info
        assert int(facts["info"]["seed"]) == stream.seed
        assert facts["info"]["sensor"] == stream.sensor
        if len(events) > 1:
            assert facts["range"] == [events["t"][0], events["t"][-1]]
            assert facts["second_half"] == np.count_nonzero(events["t"] >= facts["middle"])


def test_we_read_our_own_files(recordings: dict[str, tuple[StreamInfo, Events]]) -> None:
    for path, (stream, events) in recordings.items():
        recording = read(path)
        assert recording.tobytes() == events.tobytes()
        assert recording.stream == stream


def test_we_read_files_of_dv_processing_past_frames_imu_and_triggers(tmp_path: Path) -> None:
    written = oracle("write", tmp_path)
    assert len(written) == 5
    for facts in written:
        file = Aedat4File.at(facts["path"])
        assert file.compression == Path(facts["path"]).stem
        assert len(file.declared) == 4
        recording = read(facts["path"])
        assert len(recording) == facts["events"] == 25_000
        assert oracle.digest(recording) == facts["digest"]
        assert (recording.stream.width, recording.stream.height) == (640, 480)
        assert recording.stream.camera == "DVX_123"
        assert file.table_packets is not None


@pytest.mark.parametrize("compression", COMPRESSIONS)
def test_whole_packets_of_torn_files_reach_every_reader(tmp_path: Path, compression: str) -> None:
    events = seen(DAVIS, 6000, 1, 6000)
    parts = list(chunks(events, 1000))
    path = tmp_path / "torn.aedat4"
    recorder = Aedat4Recorder(path, compression)
    recorder.open([DAVIS])
    ends = []
    for seq, part in enumerate(parts):
        recorder.write(EventPacket(seq, 0, 0, 346, 260, part))
        ends.append(path.stat().st_size)
    # not closed: as a kill leaves it, cut further at some bytes of the last packet
    data = path.read_bytes()
    header = ends[-2]
    kept = {len(data): events}
    for cut in (header + 1, header + 7, header + 8, header + 9, header + 40, len(data) - 1):
        kept[cut] = np.concatenate(parts[:-1])
    # killed between the table and the header's pointer to it
    recorder.close()
    closed = bytearray(path.read_bytes())
    at = 14 + Aedat4File.at(path).header.table_position_at if compression != "none" else 0
    if at:
        assert struct.unpack_from("<q", closed, at) == (len(data),)
        closed[at : at + 8] = struct.pack("<q", -1)
    files = {}
    for cut, whole in kept.items():
        files[tmp_path / f"{cut}.aedat4"] = whole
        (tmp_path / f"{cut}.aedat4").write_bytes(data[:cut])
    files[tmp_path / "pointerless.aedat4"] = events
    (tmp_path / "pointerless.aedat4").write_bytes(closed)
    for reader in READERS:
        for facts in oracle(reader, *files):
            whole = files[Path(facts["path"])]
            assert facts["events"] == len(whole), (reader, facts)
            assert facts["digest"] == oracle.digest(whole), (reader, facts)
            assert facts["error"] == "" or reader != "dv-processing", facts
