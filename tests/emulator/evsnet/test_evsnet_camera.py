"""Cameras whose pixels are a network: chunks, latency, what is declared, what is refused."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from evs.drivers import files
from evs.emulator import EventCamera, World
from evs.emulator.config import ModelConfig, RenderConfig, SensorConfig
from evs.emulator.evsnet.export import export
from evs.emulator.world import load_model
from evs.launch.main import main
from evs.msgs import EvsError
from reference.networks import random_network

SMALL = SensorConfig(preset="ideal", width=37, height=26)
SWING = """
<mujoco>
  <option timestep=".001"/>
  <worldbody>
    <light pos="0 0 3"/>
    <geom type="plane" size="2 2 1" rgba=".3 .3 .3 1"/>
    <camera name="side" pos="0 -3 1" xyaxes="1 0 0 0 .3 1"/>
    <body name="arm" pos="0 0 1"><joint name="swing" axis="0 1 0"/>
      <geom type="capsule" fromto="0 0 0 .8 0 0" size=".15" density="50"/></body>
  </worldbody>
</mujoco>
"""
RENDER = RenderConfig(spp=1)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A scene and two networks: causal and centred."""
    path = tmp_path_factory.mktemp("network")
    (path / "swing.xml").write_text(SWING)
    export(random_network(3, 4), path / "causal.onnx")
    export(random_network(4, 4, look_ahead=3), path / "centred.onnx")
    return path


def world(folder: Path, **model: object) -> World:
    made = World(folder / "swing.xml")
    network = str(folder / f"{model.pop('network', 'causal')}.onnx")
    keys = {"name": "evsnet", "network": network, "runtime": "reference", **model}
    config = ModelConfig(**keys)  # type: ignore[arg-type]
    made.add_camera(sensor=SMALL, render=RENDER, model=config)
    made.data.qvel[:] = 20.0
    return made


@pytest.mark.parametrize("runtime", ["native", "onnxruntime", "reference"])
@pytest.mark.parametrize(("chunk", "events_per_tick"), [(3, "one"), (8, "one"), (8, "many")])
def test_packets_do_not_depend_on_the_chunk(
    folder: Path, runtime: str, chunk: int, events_per_tick: str
) -> None:
    """One packet a tick either way; those of a chunk leave together, the last by themselves."""
    keys = {"runtime": runtime, "events_per_tick": events_per_tick}
    single = [p for ps in world(folder, **keys).run(0.052) for p in ps]
    steps = list(world(folder, **keys, chunk=chunk).run(0.052))
    chunked = [p for ps in steps for p in ps]
    assert [len(ps) for ps in steps[: 2 * chunk]] == ([0] * (chunk - 1) + [chunk]) * 2
    assert [p.seq for p in chunked] == list(range(52))
    assert sum(len(p) for p in single) > 100
    for ours, theirs in zip(chunked, single, strict=True):
        assert (ours.time_base_us, ours.time_end_us) == (theirs.time_base_us, theirs.time_end_us)
        assert ours.events.tobytes() == theirs.events.tobytes()


def test_stamps_lie_in_their_tick_and_latency_is_declared(folder: Path) -> None:
    centred = world(folder, network="centred")
    assert centred.cameras[0].info.latency_us == 21_000
    assert world(folder).cameras[0].info.latency_us == 0
    for (packet,) in centred.run(0.03):
        assert np.all(packet.events["t"] > packet.time_base_us)
        assert np.all(packet.events["t"] <= packet.time_end_us)


def test_a_recording_says_which_network_and_how_late(folder: Path) -> None:
    for suffix in ("aedat4", "npz"):
        recording = folder / f"run.{suffix}"
        words = ["emulate", "--scene", str(folder / "swing.xml"), "--model", "evsnet"]
        words += [f"model.network={folder / 'centred.onnx'}", "model.chunk=8", "duration_s=0.05"]
        words += ["model.runtime=reference"]
        words += ["sensor.preset=ideal", "sensor.width=37", "sensor.height=26", "render.spp=1"]
        assert main([*words, "--record", str(recording)]) == 0
        stream = files.read(recording).stream
        assert stream.latency_us == 21_000
        assert stream.versions["network"].startswith("random4 ")
        report = json.loads((folder / f"run.{suffix}.report.json").read_text())
        assert report["cameras"][0]["latency_us"] == 21_000
        assert report["packets"] == report["ticks"] == 50


def test_who_gives_events_at_once_takes_no_chunks(folder: Path) -> None:
    model = ModelConfig(
        name="evsnet", network=str(folder / "causal.onnx"), chunk=4, runtime="reference"
    )
    with pytest.raises(EvsError, match="leave it 1"):
        EventCamera(load_model(folder / "swing.xml"), sensor=SMALL, model_config=model)


@pytest.mark.parametrize(
    ("keys", "says"),
    [
        ({"chunk": 0}, "1 ... 256"),
        ({"chunk": 257}, "1 ... 256"),
        ({"chunk": 8, "name": "plain"}, "goes tick by tick"),
        ({"labels": True}, "evsnet cannot label its events; use model plain or adaptive"),
        ({"runtime": "natve"}, "native"),
        ({"network": "nowhere"}, "nowhere"),
        ({"initial_state": "one"}, "zero"),
        ({"events_per_tick": "two"}, "no number of events per tick 'two'; there is: "),
        ({"provider": "cuda"}, "runtime onnxruntime"),
    ],
)
def test_what_cannot_be_is_one_line(folder: Path, keys: dict[str, object], says: str) -> None:
    network = str(folder / "causal.onnx")
    given = {"name": "evsnet", "network": network, "runtime": "reference", **keys}
    with pytest.raises(EvsError, match=says) as caught:
        World(folder / "swing.xml").add_camera(
            sensor=SMALL,
            render=RENDER,
            model=ModelConfig(**given),  # type: ignore[arg-type]
        )
    assert "\n" not in str(caught.value)


def test_another_tick_is_refused(folder: Path) -> None:
    made = World(folder / "swing.xml", tick_us=2000)
    made.add_camera(
        sensor=SMALL,
        render=RENDER,
        model=ModelConfig(name="evsnet", network=str(folder / "causal.onnx"), runtime="reference"),
    )
    with pytest.raises(EvsError, match="2000 us"):
        made.step()


@pytest.mark.parametrize("chunk", [1, 8])
def test_fresh_noise_does_not_burst_at_the_start(folder: Path, chunk: int) -> None:
    """A still scene under soft light: the first ticks are like the later ones, tick by tick."""
    soft = folder / "soft.xml"
    soft.write_text(SWING.replace('pos="0 0 3"', 'pos="0 0 3" bulbradius=".8"'))
    made = World(soft)
    made.add_camera(
        sensor=SMALL,
        render=RenderConfig(renderer="path", spp=1, seeds="fresh"),
        model=ModelConfig(name="evsnet", chunk=chunk),
    )
    made.model.opt.gravity[:] = 0
    packets = [packet for packets in made.run(0.16) for packet in packets]
    assert [packet.seq for packet in packets] == list(range(160))
    early, late = (sum(len(p) for p in part) for part in (packets[:40], packets[120:]))
    assert 10 < early < 2.5 * late
