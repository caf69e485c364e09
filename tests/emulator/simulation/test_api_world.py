"""World and Camera: packets on one clock, whatever way they are asked for."""

from __future__ import annotations

import json
from dataclasses import asdict, replace

import mujoco
import numpy as np
import pytest

from evs.emulator import UnstableError, World
from evs.emulator.config import (
    CameraConfig,
    RenderConfig,
    RunConfig,
    SceneConfig,
    SensorConfig,
    decoding,
)
from evs.emulator.config.sensor import BiasConfig
from evs.emulator.sensor import resolve_sensor
from evs.msgs import EvsError
from reference.mjcf import ARM

SMALL = SensorConfig(preset="davis346", width=64, height=48)


@pytest.fixture(scope="module")
def arm(tmp_path_factory):
    path = tmp_path_factory.mktemp("scene") / "arm.xml"
    path.write_text(ARM)
    return path


def packets(world, seconds=0.03):
    return list(world.run(seconds))


def stream(world, seconds=0.03):
    """The events of every camera, as bytes."""
    return [
        b"".join(packet.events.tobytes() for packet in column)
        for column in zip(*packets(world, seconds), strict=True)
    ]


def test_packets_follow_each_other_without_a_gap(arm):
    world = World(arm, tick_us=2000, control=lambda t_s, _: [np.sin(20 * t_s)])
    camera = world.add_camera("side", sensor=SMALL)
    seen = [packet for (packet,) in world.run(0.05)]
    assert [packet.seq for packet in seen] == list(range(25))
    assert [packet.time_base_us for packet in seen] == list(range(0, 50_000, 2000))
    assert [packet.time_end_us for packet in seen] == list(range(2000, 52_000, 2000))
    assert {(packet.width, packet.height, packet.camera) for packet in seen} == {(64, 48, "side")}
    for packet in seen:
        t = packet.events["t"]
        assert (t > packet.time_base_us).all()
        assert (t <= packet.time_end_us).all()
        assert (np.diff(t) >= 0).all()
    assert camera.events == sum(map(len, seen)) > 100
    assert (world.tick, world.t_us) == (25, 50_000)
    assert str(world.substeps).startswith("4 physics steps of 0.5 ms")


def test_nothing_moves_nothing_happens(arm):
    xml = ARM.replace("<option", "<option gravity='0 0 0'")
    world = World(mujoco.MjModel.from_xml_string(xml))
    world.add_camera("top", sensor=SensorConfig("ideal", width=64, height=48))
    assert stream(world) == [b""]


def test_two_runs_give_the_same_bytes_and_another_seed_others(arm):
    def run(seed, threads=1):
        world = World(arm, control="random", seed=seed, threads=threads)
        world.add_camera("side", sensor=SMALL)
        return stream(world)

    assert run(3) == run(3) == run(3, threads=2)
    assert run(3) != run(4)
    assert len(run(3)[0]) > 16 * 100


def test_cameras_on_one_clock_do_not_disturb_each_other(arm):
    alone = World(arm, control="random")
    alone.add_camera("side", sensor=SMALL)
    both = World(arm, control="random")
    both.add_camera("side", sensor=SMALL)
    both.add_camera("top", sensor=SensorConfig(preset="dvs128"))
    both.add_camera(CameraConfig(body="arm", pos=(0, 0, 0.5), quat=(0.7, 0.7, 0, 0)), sensor=SMALL)
    both.add_camera("side", sensor=SMALL)
    assert [camera.name for camera in both.cameras] == ["side", "top", "arm_camera", "side_2"]
    side, top, _, again = stream(both)
    assert side == stream(alone)[0]
    assert len(top) > 0
    # the same view through another camera's pixels
    assert again != side
    assert len(again) == pytest.approx(len(side), rel=0.2)


def test_a_camera_that_comes_later_begins_then(arm):
    world = World(arm, control="random")
    world.add_camera("side", sensor=SMALL)
    packets(world, 0.01)
    world.add_camera("top", sensor=SMALL)
    first, second = world.step()
    assert (first.seq, first.time_base_us) == (10, 10_000)
    assert (second.seq, second.time_base_us) == (0, 10_000)


def test_the_reference_is_the_light_before_the_first_step(arm):
    def luminance_at_start(swing):
        world = World(arm)
        world.data.qpos[0] = swing
        # photon noise fires pixels whose leak has nearly brought them to their threshold
        camera = world.add_camera("side", sensor=replace(SMALL, photocurrent_pa=0.0))
        (packet,) = world.step()
        return camera.luminance, len(packet)

    still, events = luminance_at_start(0.0)
    turned, turned_events = luminance_at_start(0.8)
    assert not np.array_equal(still, turned)
    # a millisecond of falling from rest moves nothing: the change of state itself is not seen
    assert events < 20
    assert turned_events < 20


def test_step_takes_controls_that_hold(arm):
    one, other = World(arm, control="random"), World(arm, control=lambda _t, _d: [0.5])
    one.add_camera("side", sensor=SMALL), other.add_camera("side", sensor=SMALL)
    first = [one.step([0.5])[0]] + [one.step()[0] for _ in range(19)]
    second = [other.step()[0] for _ in range(20)]
    assert [p.events.tobytes() for p in first] == [p.events.tobytes() for p in second]
    assert one.data.ctrl.tolist() == [0.5]
    one.step([-0.25])
    assert one.data.ctrl.tolist() == [-0.25]


def test_a_keyframe_starts_and_holds(arm):
    world = World(arm, control="keyframe")
    assert world.data.qpos.tolist() == [-1.2]
    world.step()
    assert world.data.ctrl.tolist() == [0.7]
    from_config = World(SceneConfig(file=str(arm), keyframe="up"))
    assert from_config.data.qpos.tolist() == [-1.2]
    from_config.step()
    assert from_config.data.ctrl.tolist() == [0.0]


def test_a_function_sees_poses_before_the_first_step(arm):
    seen = []
    world = World(arm, control=lambda t_s, data: seen.append((t_s, data.geom_xpos[1].tolist())))
    world.step()
    assert seen == [(0.0, [pytest.approx(0.4), 0.0, 1.0])]


def test_from_config_is_the_same_world(arm):
    scene = SceneConfig(file=str(arm), camera="side", control="random", control_seed=5)
    config = RunConfig(scene=scene, sensor=SMALL, name="eye", seed=5, threads=1)
    world = World.from_config(config)
    by_hand = World(arm, control="random", seed=5, threads=1)
    by_hand.add_camera("side", sensor=SMALL)
    (camera,) = world.cameras
    assert camera.name == camera.info.camera == "eye"
    assert {**camera.info.config, "sensor": asdict(config)["sensor"]} == asdict(config)
    assert stream(world) == stream(by_hand)
    assert len(stream(world)[0]) > 0


def test_info_tells_the_sensor_as_it_really_is(arm):
    sensor = SensorConfig("imx636", 64, 48, biases=BiasConfig(bias_diff_on=40))
    told = World(arm).add_camera("side", sensor=sensor).info.config["sensor"]
    resolved = asdict(resolve_sensor(sensor))
    name = resolved.pop("name")
    assert told["preset"] == name == "imx636"
    assert {**told, **resolved} == told
    assert told["pos_thres"] > 0.223 == told["neg_thres"]
    assert (told["biases"]["bias_diff_on"], told["biases"]["bias_diff_off"]) == (40, None)
    # whoever runs this configuration again has the same sensor
    again = decoding.build(SensorConfig, json.loads(json.dumps(told)))
    assert resolve_sensor(again) == resolve_sensor(sensor)


def test_info_tells_what_made_the_stream(arm):
    world = World(arm, tick_us=500, seed=9, control="random")
    focal = CameraConfig(lookat=(0, 0, 1), distance=3, focal_px=(50, 60), principal_px=(30, 20))
    info = world.add_camera(focal, sensor=SMALL, render=RenderConfig(spp=2), name="eye").info
    assert (info.width, info.height, info.camera, info.sensor) == (64, 48, "eye", "davis346")
    assert (info.tick_us, info.seed) == (500, 9)
    assert set(info.versions) == {"evs", "mujoco", "numpy"}
    assert info.camera_info == {
        "width": 64,
        "height": 48,
        "distortion_model": "plumb_bob",
        "d": [0.0] * 5,
        "k": [50, 0.0, 29.5, 0.0, 60, 19.5, 0.0, 0.0, 1.0],
        "r": [1, 0, 0, 0, 1, 0, 0, 0, 1],
        "p": [50, 0, 29.5, 0, 0, 60, 19.5, 0, 0, 0, 1, 0],
    }
    assert info.config["scene"]["file"] == str(arm)
    assert info.config["scene"]["control"] == "random"
    assert info.config["camera"]["focal_px"] == (50, 60)
    assert info.config["render"]["spp"] == 2
    assert info.config["sensor"]["width"] == 64
    assert info.config["name"] == "eye"
    json.dumps(info.config)


def test_stages_are_lapped_for_every_tick(arm):
    class Laps:
        def __init__(self):
            self.seen = []

        def lap(self, stage):
            self.seen.append(stage)

    laps = Laps()
    world = World(arm, meter=laps)
    world.add_camera("side", sensor=SMALL)
    world.add_camera("top", sensor=SMALL)
    world.step()
    assert laps.seen[4:] == ["world", "render", "sensor", "render", "sensor"]
    world.step()
    assert laps.seen[9:] == ["world", "render", "sensor", "render", "sensor"]


def test_the_picture_is_a_copy_and_black_means_dark(arm):
    world = World(arm, control=lambda _t, _d: [1.0])
    camera = world.add_camera("side", sensor=SMALL)
    assert not camera.luminance.any()
    assert not camera.is_dark
    world.step()
    picture = camera.luminance
    kept = picture.copy()
    assert picture.shape == (48, 64)
    assert picture.dtype == np.float32
    for _ in range(20):
        world.step()
    np.testing.assert_array_equal(picture, kept)
    assert not np.array_equal(camera.luminance, kept)
    assert 0.0 <= camera.traced_fraction <= 1.0
    assert camera.clamps == 0

    unlit = World(mujoco.MjModel.from_xml_string(ARM.replace('<light pos="0 0 3"/>', "")))
    dark = unlit.add_camera("side", sensor=SMALL, render=RenderConfig(headlight="off"))
    unlit.step()
    assert dark.is_dark


def test_a_sky_over_a_scene_without_a_light_is_dark_and_a_glow_is_not():
    sky = """<asset><texture type="skybox" builtin="flat" rgb1="1 1 1" width="8" height="8"/>
      <material name="glow" emission="1"/></asset><worldbody>"""
    text = ARM.replace('<light pos="0 0 3"/>', "").replace("<worldbody>", sky, 1)
    off = RenderConfig(headlight="off")
    world = World(mujoco.MjModel.from_xml_string(text))
    cameras = world.add_camera("side", sensor=SMALL, render=off), world.add_camera("side")
    world.step()
    assert cameras[0].luminance.any()
    assert [camera.is_dark for camera in cameras] == [True, False]

    glowing = text.replace("<geom ", '<geom material="glow" ', 1)
    world = World(mujoco.MjModel.from_xml_string(glowing))
    camera = world.add_camera("side", sensor=SMALL, render=off)
    world.step()
    assert not camera.is_dark


def test_an_unstable_world_says_so_and_what_came_before_stays(arm):
    world = World(arm)
    world.add_camera("side", sensor=SMALL)
    before = packets(world, 0.005)
    world.data.qvel[0] = np.nan
    with pytest.raises(UnstableError, match=r"t = 0\.005000 s: bad velocity .* joint 'swing'"):
        world.step()
    assert world.t_us == 5000
    assert len(before) == 5


def test_a_scene_of_ours_is_not_the_users(arm):
    model = mujoco.MjModel.from_xml_string(ARM)
    world = World(model, tick_us=1000)
    world.step()
    assert world.model is not model
    assert model.opt.timestep == 0.0005
    assert model.opt.disableflags == 0


def test_a_world_without_cameras_still_turns(arm):
    world = World(arm)
    assert world.step() == ()
    assert world.t_us == 1000


def test_run_takes_the_nearest_whole_ticks(arm):
    world = World(arm)
    assert len(list(world.run(0.0104))) == 10
    assert len(list(world.run(1e-5))) == 1


@pytest.mark.parametrize("duration_s", [0, -1, float("nan"), float("inf")])
def test_a_duration_is_positive(arm, duration_s):
    with pytest.raises(EvsError, match="duration_s is"):
        World(arm).run(duration_s)


@pytest.mark.parametrize(
    ("make", "says"),
    [
        (lambda arm: World(arm.with_name("ram.xml")), "there is: arm.xml"),
        (lambda arm: World(arm, tick_us=0), "scene.tick_us is 0"),
        (lambda arm: World(arm, control="rnd"), "no control 'rnd'; there is: random"),
        (lambda arm: World(SceneConfig()), "scene.file is empty"),
        (lambda arm: World(SceneConfig(file=str(arm), keyframe="pu")), "no keyframe 'pu'"),
        (lambda arm: World(arm).add_camera("sied"), "no camera 'sied'; there is: side, top"),
        (lambda arm: World(arm).add_camera(sensor="davis"), "no sensor"),
        (lambda arm: World(arm).add_camera(3), "camera= takes a name or a CameraConfig, not 3"),
        (lambda arm: World(arm).add_camera(sensor=3), "sensor= takes a name or a SensorConfig"),
        (lambda arm: World(arm).add_camera(name=""), "a camera called ''"),
        (lambda arm: World(arm).step([1, 2]), "has shape (2,), the model has 1 controls"),
        (lambda arm: World(arm).step([float("nan")]), "step(ctrl) has nan at index 0"),
        (lambda arm: World(arm).add_camera(sensor=SensorConfig(width=0, height=1)), "width"),
    ],
)
def test_bad_input_is_one_clear_line(arm, make, says):
    with pytest.raises(EvsError) as caught:
        make(arm)
    assert says in str(caught.value)
    assert "\n" not in str(caught.value)


def test_two_cameras_cannot_have_one_name(arm):
    world = World(arm)
    world.add_camera("side", sensor=SMALL, name="eye")
    with pytest.raises(EvsError, match="a camera called 'eye': give each its own"):
        world.add_camera("top", sensor=SMALL, name="eye")
    assert len(world.cameras) == 1


def test_the_first_camera_is_that_of_a_scene_configuration(arm):
    world = World(SceneConfig(file=str(arm), camera="top", tick_us=500))
    assert world.add_camera(sensor=SMALL).name == "top"
    (packet,) = world.step()
    assert packet.time_end_us == 500
