"""Pixels: frames of others become the events that our own light would give."""

from __future__ import annotations

import subprocess
import sys
from typing import Any

import mujoco
import numpy as np
import pytest

import evs
from evs.drivers.bus import Publisher, subscribe
from evs.drivers.bus.address import free_address
from evs.drivers.files import recorder_for
from evs.emulator.sensor import PlainModel, resolve_sensor
from evs.msgs import EVENT_DTYPE, Cause, EvsError, join_events

SMALL = (64, 48)


def film(frames: int, size: tuple[int, int] = SMALL, seed: int = 0) -> Any:
    """(frames, h, w) float32: a soft texture that moves a pixel a frame."""
    width, height = size
    texture = np.random.default_rng(seed).standard_normal((height, width + frames))
    for axis in (0, 1):
        texture = sum(np.roll(texture, k, axis) for k in range(-2, 3)) / 5
    light = np.exp(2.0 * texture - 1.0).astype(np.float32)
    return np.stack([light[:, k : k + width] for k in range(frames)])


def seen(pixels: evs.Pixels, light: Any, step_us: int = 1000) -> list[Any]:
    """The events of each frame, and those of the end."""
    found = [pixels.observe(frame, k * step_us) for k, frame in enumerate(light)]
    return [*found, pixels.finish()]


def test_the_light_of_our_own_camera_gives_its_events() -> None:
    """Readout, noise and model are those of EventCamera, byte for byte."""
    model = mujoco.MjModel.from_xml_string(
        """<mujoco><worldbody><light pos="0 0 3" dir="0 0 -1"/><camera pos="0 -2 1"
        xyaxes="1 0 0 0 .4 1"/><geom type="plane" size="5 5 .1" rgba=".4 .5 .6 1"/><body
        pos="0 0 .5"><freejoint/><geom size=".3 .1 .1" type="box" rgba=".9 .2 .1 1"/></body>
        </worldbody></mujoco>"""
    )
    data = mujoco.MjData(model)
    data.qvel[:] = (1.0, 0.0, 2.0, 5.0, 0.0, 3.0)
    sensor = evs.SensorConfig("davis346", width=64, height=48, shot_noise_rate_hz=50.0)
    labels = evs.ModelConfig(labels=True)
    camera = evs.EventCamera(model, sensor=sensor, seed=3, model_config=labels)
    pixels = evs.Pixels(sensor, seed=3, model=labels)
    counted = 0
    for tick in range(40):
        expected = camera.observe(data)
        ids = camera.ground_truth().geom_id
        found = pixels.observe(camera.luminance, 2000 * tick, ids)
        assert found.tobytes() == expected.tobytes()
        if camera.packet is not None:
            assert pixels.packet is not None
            assert camera.labels is not None
            assert pixels.labels is not None
            # frames of others have no depth
            for name in ("cause", "geom_id"):
                assert np.array_equal(pixels.labels[name], camera.labels[name])
            assert pixels.packet.time_base_us == camera.packet.time_base_us
            assert pixels.packet.seq == camera.packet.seq
        counted += len(found)
        mujoco.mj_step(model, data)
    assert counted > 100


def test_frames_at_any_spacing_are_those_of_the_model_itself() -> None:
    light = film(12)
    stamps = np.cumsum([5, 1, 999, 33_333, 1, 1, 250_000, 7, 1000, 1000, 2, 3]).tolist()
    pixels = evs.Pixels("ideal", SMALL, seed=1)
    found = [pixels.observe(f, t_us) for f, t_us in zip(light, stamps, strict=True)]
    assert len(found[0]) == 0
    model = PlainModel(resolve_sensor(evs.SensorConfig("ideal", width=64, height=48)))
    _, state = model.step(light[0], model.init(1), stamps[0] - 1, stamps[0])
    for k in range(1, len(light)):
        events, state = model.step(light[k], state, stamps[k - 1], stamps[k])
        assert found[k].tobytes() == events.tobytes()
    assert sum(map(len, found)) > 1000


def test_the_frame_belongs_to_the_caller_again_after_the_call() -> None:
    light = film(6)
    buffer = np.empty_like(light[0])
    ours, theirs = evs.Pixels("davis346", SMALL), evs.Pixels("davis346", SMALL)
    for k, frame in enumerate(light):
        buffer[:] = frame
        first = ours.observe(buffer, 1000 * k)
        buffer[:] = 0
        assert first.tobytes() == theirs.observe(frame, 1000 * k).tobytes()
    assert ours.luminance.tobytes() == light[-1].tobytes()


@pytest.mark.parametrize("threads", [2, 3])
def test_threads_change_no_byte(threads: int) -> None:
    light = film(10)
    one = seen(evs.Pixels("davis346", SMALL, seed=9, threads=1), light)
    many = seen(evs.Pixels("davis346", SMALL, seed=9, threads=threads), light)
    assert [part.tobytes() for part in one] == [part.tobytes() for part in many]


def test_the_seed_is_what_the_noise_follows_from() -> None:
    light = film(5)
    noisy = {"shot_noise_rate_hz": 100.0, "sigma_thres": 0.05}
    first, second, third = (
        join_events(seen(evs.Pixels("davis346", SMALL, seed=seed, **noisy), light)).tobytes()
        for seed in (1, 1, 2)
    )
    assert first == second
    assert first != third


def test_finish_reads_out_what_a_slow_link_still_holds() -> None:
    light = film(4)
    slow = {"readout.bandwidth_mevs": 0.2, "readout.stamp": "sent"}
    pixels = evs.Pixels("ideal", SMALL, **slow)
    found = [pixels.observe(frame, 1000 * k) for k, frame in enumerate(light)]
    waiting = pixels.events_waiting
    assert waiting > 100
    last = pixels.finish()
    assert len(last) == waiting
    assert pixels.events_waiting == 0
    assert pixels.packet is not None
    assert (pixels.packet.seq, pixels.packet.time_base_us) == (3, 3000)
    assert pixels.packet.time_end_us >= last["t"][-1] > 3000
    assert np.all(np.diff(last["t"]) >= 0)
    # none is lost, none is made: an ideal link has as many, and there nothing waits
    ideal = evs.Pixels("ideal", SMALL)
    everything = [ideal.observe(frame, 1000 * k) for k, frame in enumerate(light)]
    assert sum(map(len, everything)) == sum(map(len, found)) + len(last)
    assert len(ideal.finish()) == 0
    assert ideal.packet is None


def test_labels_survive_the_readout_of_the_end() -> None:
    light, ids = film(4), np.arange(48 * 64).reshape(48, 64)
    labelled = evs.ModelConfig(labels=True)
    pixels = evs.Pixels("ideal", SMALL, model=labelled, **{"readout.bandwidth_mevs": 0.2})
    for k, frame in enumerate(light):
        pixels.observe(frame, 1000 * k, ids)
    last = pixels.finish()
    assert pixels.labels is not None
    assert len(last) > 100
    assert np.array_equal(pixels.labels["geom_id"], ids[last["y"], last["x"]])
    assert set(np.unique(pixels.labels["cause"])) == {Cause.SIGNAL}
    # the padding is zero again
    assert not last.view(np.uint8).reshape(-1, 16)[:, 13:].any()


def test_without_ids_labels_have_the_cause_alone() -> None:
    pixels = evs.Pixels("ideal", SMALL, model=evs.ModelConfig(labels=True))
    for k, frame in enumerate(film(3)):
        pixels.observe(frame, 1000 * k)
    assert pixels.labels is not None
    assert np.all(pixels.labels["geom_id"] == -1)


def test_reset_is_as_new() -> None:
    light, pixels = film(5), evs.Pixels("davis346", SMALL, seed=2)
    first = seen(pixels, light)
    with pytest.raises(EvsError, match=r"finish\(\) was called: call reset\(\)"):
        pixels.observe(light[0], 9000)
    pixels.reset()
    assert pixels.packet is None
    assert [p.tobytes() for p in seen(pixels, light)] == [p.tobytes() for p in first]


def test_light_that_is_none_is_counted_and_replaced() -> None:
    light = film(4)
    light[2, 3, 4], light[3, 5, 6], light[3, 5, 7] = np.nan, -1.0, np.inf
    pixels = evs.Pixels("ideal", SMALL)
    for k, frame in enumerate(light):
        pixels.observe(frame, 1000 * k)
    assert pixels.clamps == 3
    at_nan = pixels.observe(light[0], 4000)
    assert at_nan.dtype == EVENT_DTYPE


def test_dn_of_a_white_frame_is_what_the_unit_says() -> None:
    """255 DN in every unit: so noise and bandwidth know how bright it is."""
    same: list[bytes] = []
    for unit, factor in (("luminance", 1.0), ("dn", 255.0), ("lux", 1000.0)):
        keys = {"exposure_dn": 255.0, "white_lux": 1000.0, "filter": "euler"}
        pixels = evs.Pixels("davis346", SMALL, unit=unit, **keys)
        light = np.round(film(6) * 4096) / 4096
        found = seen(pixels, (light * factor).astype(np.float64))
        same.append(join_events(found).tobytes())
        np.testing.assert_allclose(pixels.luminance, light[-1], rtol=1e-6)
    assert len(same[0]) > 16 * 500


@pytest.mark.parametrize("kind", ["aedat4", "npz", "raw", "csv"])
def test_a_recorder_takes_its_packets(tmp_path: Any, kind: str) -> None:
    light = film(8)
    pixels = evs.Pixels("davis346", SMALL, name="left")
    recorder = recorder_for(tmp_path / f"run.{kind}")
    recorder.open([pixels.info])
    parts = []
    for k, frame in enumerate(light):
        pixels.observe(frame, 1000 * k)
        if pixels.packet is not None:
            recorder.write(pixels.packet)
            parts.append(pixels.packet.events)
    pixels.finish()
    if pixels.packet is not None:
        recorder.write(pixels.packet)
        parts.append(pixels.packet.events)
    recorder.close()
    back = evs.read(tmp_path / f"run.{kind}")
    expected = join_events(parts)
    for field in ("t", "x", "y", "p"):
        assert np.array_equal(back[field], expected[field]), field
    assert (back.stream.width, back.stream.height) == SMALL


@pytest.mark.slow
def test_a_publisher_takes_its_packets() -> None:
    light, address = film(6), free_address()
    pixels = evs.Pixels("davis346", SMALL, name="left")
    publisher = Publisher(address, wait_for=1)
    with subscribe(address, timeout_s=10) as packets:
        publisher.open([pixels.info])
        sent = []
        for k, frame in enumerate(light):
            pixels.observe(frame, 1000 * k)
            if pixels.packet is not None:
                publisher.write(pixels.packet)
                sent.append(pixels.packet)
        publisher.close()
        came = list(packets)
    assert [p.events.tobytes() for p in came] == [p.events.tobytes() for p in sent]
    assert [p.seq for p in came] == list(range(5))


def test_keys_are_those_of_the_sensor() -> None:
    pixels = evs.Pixels(
        "davis346",
        (32, 24),
        pos_thres=0.4,
        readout={"order": "ideal"},
        aps=evs.ApsConfig(enabled=True),
        **{"biases.DiffBn_coarse": 3},
    )
    assert pixels.sensor.pos_thres == 0.4
    assert pixels.sensor.readout.order == "ideal"
    assert pixels.sensor.aps.enabled
    assert (pixels.info.width, pixels.info.height, pixels.info.frames) == (32, 24, True)
    assert evs.Pixels("genx320").info.width == 320
    assert "davis346 32 x 24, nothing seen yet" in repr(pixels)


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ({"sensor": "davis999"}, "no sensor 'davis999'"),
        ({"sensor": 5}, "sensor= takes a name or a SensorConfig"),
        ({"size": (0, 5)}, "width"),
        ({"size": 5}, r"size is 5; give \(width, height\)"),
        ({"size": (1.5, 3)}, "width is 1.5"),
        ({"unit": "nits"}, "no unit of frames 'nits'"),
        ({"model": "plane"}, "no model 'plane'"),
        ({"model": 3}, "model= takes"),
        ({"model": evs.ModelConfig(name="evsnet", chunk=8)}, "chunk is 8"),
        ({"pos_tres": 0.3}, r"no key 'sensor\.pos_tres'; there is: sensor\.pos_thres"),
        ({"readout.fifos": 1}, r"no key 'sensor\.readout\.fifos'; there is: sensor\.readout\.fifo"),
        ({"pos_thres.a": 1}, "is no table"),
        ({"pos_thres": "x"}, r"sensor\.pos_thres is 'x'"),
        ({"pos_thres": -1.0}, "pos_thres"),
        ({"imu.enabled": True}, "frames do not say how the camera moves"),
        ({"name": "a\nb"}, "printable"),
        ({"tick_us": 0}, "tick_us is 0"),
        ({"seed": 0.5}, "seed is 0.5"),
    ],
)
def test_what_makes_no_sense_is_refused_in_one_line(options: Any, says: str) -> None:
    with pytest.raises(EvsError, match=says) as caught:
        evs.Pixels(**options)
    assert "\n" not in str(caught.value)


def test_time_goes_forward() -> None:
    light, pixels = film(2), evs.Pixels("ideal", SMALL)
    pixels.observe(light[0], 5000)
    for t_us in (5000, 4000):
        with pytest.raises(EvsError, match=rf"time went from 5000 us to {t_us} us.*reset\(\)"):
            pixels.observe(light[1], t_us)
    for t_us, says in ((5000.5, "t_us is 5000.5"), (2**60, "stamps end")):
        with pytest.raises(EvsError, match=says):
            pixels.observe(light[1], t_us)  # type: ignore[arg-type]
    with pytest.raises(EvsError, match=r"\(48, 65\)"):
        pixels.observe(np.zeros((48, 65)), 6000)
    # what was refused has changed nothing
    assert len(pixels.observe(light[1], np.int64(6000))) > 0


def test_ids_are_for_labels_and_of_the_frames_size() -> None:
    light = film(1)[0]
    with pytest.raises(EvsError, match="ids are for labels"):
        evs.Pixels("ideal", SMALL).observe(light, 0, np.zeros((48, 64), int))
    labelled = evs.Pixels("ideal", SMALL, model=evs.ModelConfig(labels=True))
    for ids in (np.zeros((48, 63), int), np.zeros((48, 64))):
        with pytest.raises(EvsError, match="whole numbers"):
            labelled.observe(light, 0, ids)


def test_a_gap_that_no_pixel_can_bridge_is_one_line() -> None:
    light, pixels = film(2), evs.Pixels("ideal", SMALL)
    pixels.observe(light[0], 0)
    with pytest.raises(EvsError, match="use shorter ones"):
        pixels.observe(light[1], 10**9)
    # four minutes are possible
    assert len(pixels.observe(light[1], 240_000_000)) > 0


def test_neither_mujoco_nor_a_renderer_is_loaded() -> None:
    """Another simulator may have pinned them, or have none."""
    program = (
        "import sys\nsys.modules['mujoco'] = None\nimport evs, numpy as np\n"
        "pixels = evs.Pixels('davis346', (8, 6), **{'aps.enabled': True})\n"
        "for k in range(3): pixels.observe(np.full((6, 8), 0.1 + k), 1000 * k)\n"
        "assert len(pixels.packet.events) > 0\n"
        "print(*(name for name in sys.modules if name.startswith('evs.emulator.render.')))"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert done.stdout.split() == ["evs.emulator.render.renderer_table"]
