"""The DV server as iniVation's own NetworkReader sees it: every stream, bit-exactly."""

from __future__ import annotations

import hashlib
import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from evs.drivers.bus.address import free_address
from evs.launch import main as program
from evs.msgs import (
    DEGREE,
    STANDARD_GRAVITY,
    Events,
    Frame,
    ImuPacket,
    TriggerPacket,
    empty_imu,
    join_events,
    make_events,
    make_triggers,
)
from reference.dv_packets import TICKS, came, packet, serving
from reference.mjcf import BAR

pytestmark = pytest.mark.integration

CLIENT = Path(__file__).parents[2] / "support" / "oracles" / "dv_client.py"


class Reader:
    """The real NetworkReader, in a process of its own."""

    def __init__(self, kind: str, port: int) -> None:
        words = [sys.executable, str(CLIENT), kind, "127.0.0.1", str(port)]
        self.process = subprocess.Popen(words, stdout=subprocess.PIPE, text=True)

    def said(self) -> dict[str, Any]:
        """Its next line of JSON; libraries print lines of their own."""
        assert self.process.stdout is not None
        for line in self.process.stdout:
            if line.startswith("{"):
                found: dict[str, Any] = json.loads(line)
                return found
        raise AssertionError("the reader ended early")

    def end(self) -> None:
        self.process.kill()
        self.process.wait()
        assert self.process.stdout is not None
        self.process.stdout.close()


def digest(events: Events) -> str:
    summed = hashlib.sha256()
    for name in "txyp":
        summed.update(np.ascontiguousarray(events[name]).tobytes())
    return summed.hexdigest()


SLOW = pytest.mark.slow


@pytest.mark.parametrize(
    "compression", ["lz4", pytest.param("none", marks=SLOW), pytest.param("zstd", marks=SLOW)]
)
def test_the_real_reader_gets_everything_bit_exactly(compression: str) -> None:
    # times that pass 2^24, 2^31 and 2^32 us, packets of 0, 1 and 65,535 events
    packets = [packet(0, 65_535), packet(1, 0), packet(2, 1), packet(3, 346)]
    for bits in (24, 31, 32):
        packets += [packet(seq, 2000, 2**bits - 10_000) for seq in range(4, 24)]
    packets[3].events["x"][:2], packets[3].events["y"][:2] = (0, 345), (0, 259)
    random = np.random.default_rng(3)
    frames, imus, triggers = [], [], []
    for seq in range(12):
        t = 2**31 - 6000 + 1000 * seq
        dtype = np.uint8 if seq % 2 else np.uint16
        image = random.integers(0, 256, (260, 346)).astype(dtype)
        frames.append(Frame(seq, t, t, t + 400, t + 900, image, "eye"))
        samples = empty_imu(2)
        samples["t"] = t, t + 500
        force, turn = random.uniform(-9, 9, (2, 2, 3)).astype(np.float32)
        samples["acceleration"] = force.astype(float) * STANDARD_GRAVITY
        samples["angular_velocity"] = turn.astype(float) * DEGREE
        imus.append((ImuPacket(seq, samples, "eye"), force, turn))
        triggers.append(TriggerPacket(seq, make_triggers([(t, seq % 10), (t + 1, 6)]), "eye"))
    with serving(compression=compression) as server:
        readers = {name: Reader(name.split("/")[1], port) for name, port in server.ports.items()}
        readers["again"] = Reader("events", server.ports["eye/events"])
        try:
            came(server, 5)
            for name, reader in readers.items():
                told = reader.said()
                kind = "events" if name == "again" else name.split("/")[1]
                assert (told["streams"], told["camera"]) == ([kind], "eye")
                assert kind != "events" or told["size"] == [346, 260]
            for one in packets:
                server.write(one)
            for frame, (imu, _, _), marks in zip(frames, imus, triggers, strict=True):
                server.write_frame(frame)
                server.write_imu(imu)
                server.write_triggers(marks)
                # a reader of dv holds no more than some frames that were not fetched
                time.sleep(0.02)
            said = server.close()
            found = {name: reader.said() for name, reader in readers.items()}
        finally:
            for reader in readers.values():
                reader.end()
    whole = join_events([one.events for one in packets])
    assert len(whole) > 1e5
    for name in ("eye/events", "again"):
        assert found[name]["events"] == len(whole)
        assert found[name]["digest"] == digest(whole)
    assert found["eye/frames"]["rows"] == [
        [
            *(one.exposure_begin_us, str(one.pixels.dtype), [260, 346]),
            hashlib.sha256(one.pixels.tobytes()).hexdigest(),
        ]
        for one in frames
    ]
    wanted = [
        [int(imu.samples["t"][k]), 0.0, *map(float, force[k]), *map(float, turn[k])]
        for imu, force, turn in imus
        for k in range(2)
    ]
    assert found["eye/imu"]["rows"] == wanted
    assert found["eye/triggers"]["rows"] == [
        list(mark) for one in triggers for mark in one.triggers.tolist()
    ]
    assert (said["packets_dropped"], said["events_dropped"], said["clients"]) == (0, 0, 5)
    # a tick without events sends nothing; the events go out twice
    assert said["packets_sent"] == 2 * (len(packets) - 1) + 36


def test_a_stopped_process_slows_nobody_and_goes_on_when_it_continues() -> None:
    with serving(queue=5, linger_s=20.0) as server:
        port = server.ports["eye/events"]
        stopped, quick = Reader("events", port), Reader("events", port)
        try:
            came(server, 2)
            stopped.said(), quick.said()
            os.kill(stopped.process.pid, signal.SIGSTOP)
            for seq in range(TICKS):
                server.write(packet(seq, 20_000))
                time.sleep(0.005)
            os.kill(stopped.process.pid, signal.SIGCONT)
            said = server.close()
            assert quick.said()["events"] == 20_000 * TICKS
            late = stopped.said()
        finally:
            quick.end()
            stopped.end()
    # its last packet is the last one
    assert late["ends"][1] > 1000 * (TICKS - 1)
    assert late["events"] == 20_000 * TICKS - said["events_dropped"]


def test_evs_emulate_serves_a_real_reader(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "bar.xml").write_text(BAR.format(speed=40))
    address = free_address()
    (tmp_path / "p.toml").write_text(
        "duration_s = 0.05\nreport = 'report.json'\nrecord = 'run.npz'\n"
        "[scene]\nfile = 'bar.xml'\nkeyframe = 'fast'\n[sensor]\nwidth = 48\nheight = 36\n"
        f"[[sink]]\ntype = 'dv'\naddress = '{address}'\ncompression = 'lz4'\n"
        "wait_for = 1\nwait_s = 20\n"
    )
    reader = Reader("events", int(address.rpartition(":")[2]))
    try:
        code = program.main(["emulate", str(tmp_path / "p.toml"), "--quiet"])
        assert reader.said()["size"] == [48, 36]
        found = reader.said()
    finally:
        reader.end()
    assert (code, capsys.readouterr().err) == (0, "")
    report = json.loads((tmp_path / "report.json").read_text())
    said = next(one for one in report["sinks"] if one["type"] == "dv")
    with np.load(tmp_path / "run.npz") as arrays:
        events = make_events(*(arrays[name] for name in "txyp"))
    assert len(events) > 100
    # it was waited for, so it has everything
    assert (found["events"], found["digest"]) == (len(events), digest(events))
    assert (said["clients"], said["packets_dropped"], report["ticks"]) == (1, 0, 50)
