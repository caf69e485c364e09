"""The readout inside a camera: packets keep their promises, runs report what was dropped."""

from __future__ import annotations

import json
from pathlib import Path

import mujoco
import pytest

import evs
from evs.emulator import Camera, EventCamera, World
from evs.emulator.config import ModelConfig, ReadoutConfig, SensorConfig
from evs.emulator.sensor import Readout, resolve_sensor
from evs.launch import main
from evs.msgs import Cause, EventPacket, EvsError, encode

SCENE = """<mujoco><option gravity="0 0 0"/>
<visual><headlight ambient="0.4 0.4 0.4"/></visual>
<worldbody>
  <geom name="wall" type="box" pos="0 2 0" size="3 0.1 3" rgba="0.2 0.2 0.2 1"/>
  <body><joint type="slide" axis="1 0 0"/><geom name="ball" size="0.3" rgba="1 1 1 1"/></body>
  <camera name="eye" pos="0 -2 0" xyaxes="1 0 0 0 0 1"/>
</worldbody></mujoco>"""

KEYFRAME = '<keyframe><key name="go" qvel="5"/></keyframe></mujoco>'

ALL = ReadoutConfig(
    order="arbiter",
    row_ns=3000,
    column_ns=800,
    jitter_ns=500.0,
    erc_rate_mevs=0.03,
    bandwidth_mevs=0.025,
    fifo=10,
    roi=(4, 0, 30, 48),
    mask=(30, 24),
)
IDEAL = SensorConfig("ideal", width=64, height=48, sigma_thres=0.03)
PIXEL = SensorConfig(
    "ideal",
    width=64,
    height=48,
    sigma_thres=0.03,
    latency_us=300.0,
    latency_sigma_us=100.0,
    readout=ALL,
)


def moving(config: SensorConfig, ticks: int = 30) -> tuple[Camera, list[EventPacket]]:
    world = World(mujoco.MjModel.from_xml_string(SCENE), seed=3)
    camera = world.add_camera(sensor=config)
    world.data.qvel[0] = 5.0
    return camera, [packet for _ in range(ticks) for packet in world.step()]


def test_a_camera_hands_its_pixels_events_to_the_readout() -> None:
    ideal, plain = moving(IDEAL)
    camera, packets = moving(PIXEL)
    assert ideal.events_dropped == {}
    assert ideal.events_waiting == 0
    readout = Readout(resolve_sensor(PIXEL))
    # the first tick of a camera ends at 0 and has no events
    _, state = readout.step(plain[0].events[:0], readout.init(3), -1, 0)
    for packet, before in zip(packets, plain, strict=True):
        out, state = readout.step(before.events, state, before.time_base_us, before.time_end_us)
        assert packet.events.tobytes() == out.tobytes()
        encode(packet)  # sorted, in its interval, on the sensor, zero padding
    assert camera.events_dropped == state.dropped
    dropped = state.dropped
    assert dropped["roi"] > 0
    assert dropped["erc"] + dropped["fifo"] > 0
    came, went = (sum(map(len, stream)) for stream in (plain, packets))
    assert went > 500
    assert came == went + sum(dropped.values()) + camera.events_waiting


def test_the_python_face_has_its_configuration() -> None:
    assert evs.ReadoutConfig is ReadoutConfig
    limited = evs.SensorConfig("imx636", readout=evs.ReadoutConfig(erc_rate_mevs=10.0))
    assert resolve_sensor(limited).readout.erc_target == 2000


def test_a_reset_camera_begins_anew() -> None:
    model = mujoco.MjModel.from_xml_string(SCENE)
    sensor = EventCamera(model, sensor=PIXEL, seed=1)
    runs = []
    for _ in range(2):
        data = mujoco.MjData(model)
        data.qvel[0] = 5.0
        found = []
        for _ in range(20):
            mujoco.mj_step(model, data)
            found.append(sensor.observe(data).tobytes())
        assert sum(sensor.events_dropped.values()) > 0
        runs.append((b"".join(found), sensor.events_dropped))
        sensor.reset()
        assert sum(sensor.events_dropped.values()) == 0
    assert runs[0] == runs[1]
    assert len(runs[0][0]) > 0


def test_labels_come_through_the_readout() -> None:
    world = World(mujoco.MjModel.from_xml_string(SCENE))
    noisy = SensorConfig(
        "ideal", width=64, height=48, leak_rate_hz=50.0, latency_us=1500.0, readout=ALL
    )
    camera = world.add_camera("eye", sensor=noisy, model=ModelConfig(labels=True))
    world.data.qvel[0] = 5.0
    causes: set[int] = set()
    for (packet,) in world.run(0.04):
        assert packet.labels is not None
        assert len(packet.labels) == len(packet.events)
        causes |= set(packet.labels["cause"].tolist())
        encode(packet)
    assert causes == {Cause.SIGNAL, Cause.LEAK}
    assert sum(camera.events_dropped.values()) > 0


def test_a_region_off_the_sensor_is_refused_by_the_camera() -> None:
    config = SensorConfig("ideal", width=64, height=48, readout=ReadoutConfig(roi=(0, 0, 65, 1)))
    with pytest.raises(EvsError, match=r"sensor\.readout\.roi 0 0 65 1"):
        World(mujoco.MjModel.from_xml_string(SCENE)).add_camera(sensor=config)


def test_a_run_reports_and_tells_what_was_dropped(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("scene.xml").write_text(SCENE.replace("</mujoco>", KEYFRAME))
    Path("cameras").mkdir()
    Path("cameras/hot.txt").write_text("31 24\n")
    Path("cameras/mine.toml").write_text(
        '[scene]\nfile = "../scene.xml"\ncamera = "eye"\nkeyframe = "go"\n'
        '[sensor]\npreset = "ideal"\nwidth = 64\nheight = 48\n'
        '[sensor.readout]\nmask_file = "hot.txt"\nroi = [0, 0, 36, 48]\n'
    )
    words = ["cameras/mine.toml", "--duration", "0.1", "--report", "run.json"]
    assert main.main(["emulate", *words, "sensor.readout.bandwidth_mevs=0.05"]) == 0
    report = json.loads(Path("run.json").read_text())
    (camera,) = report["cameras"]
    assert set(camera["events_dropped"]) == {"roi", "mask", "busy", "scan", "erc", "fifo"}
    assert camera["events_dropped"]["roi"] > 0
    assert report["events_dropped"] == sum(camera["events_dropped"].values())
    assert report["events_waiting"] == camera["events_waiting"]
    assert report["config"]["sensor"]["readout"]["roi"] == [0, 0, 36, 48]
    told = capsys.readouterr().out
    line = next(line for line in told.splitlines() if line.startswith("events dropped"))
    assert f"{report['events_dropped']:,} (" in line
    assert f"roi {camera['events_dropped']['roi']:,}" in line

    assert main.main(["emulate", *words, "sensor.readout.mask=[64,0]"]) == 2
    assert capsys.readouterr().err == (
        "evs: sensor.readout.mask: pixel 64 0 is not on the 64 x 48 sensor\n"
    )
