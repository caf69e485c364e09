"""A model that is edited between two ticks: the next one shows it, and only that is built again."""

from __future__ import annotations

import copy

import mujoco
import numpy as np
import pytest

import evs
from evs.drivers.clock import StopWatch
from evs.emulator.config import ModelConfig, RenderConfig, SensorConfig
from evs.emulator.simulation.pipelined import pipelined
from reference.edited import LARGE, SMALL, STAGE, put, stage

SIZE = SensorConfig("ideal", width=32, height=24)
RENDER = RenderConfig(spp=1, fog=True, haze=True)


def eye(model, camera="eye", **more):
    return evs.EventCamera(model, camera, sensor=SIZE, render=RENDER, threads=1, **more)


def seen_anew(model, data, camera="eye"):
    """What a sensor sees that was made just now."""
    sensor = eye(model, camera)
    sensor.observe(data)
    return sensor.luminance


def go_on(model, data, sensor):
    mujoco.mj_step(model, data)
    return sensor.observe(data)


@pytest.mark.parametrize("name", SMALL)
def test_an_edit_is_seen_by_the_next_observe(name):
    model, data = stage()
    sensor = eye(model)
    sensor.observe(data)
    go_on(model, data, sensor)
    before = sensor.luminance
    SMALL[name](model)
    data.time += 0.001
    sensor.observe(data)
    assert sensor.luminance.tobytes() == seen_anew(model, data).tobytes()
    assert sensor.luminance.tobytes() != before.tobytes()


@pytest.mark.parametrize("name", LARGE)
def test_large_arrays_are_seen_behind_a_reset_and_by_refresh(name):
    model, data = stage()
    sensors = [eye(model), eye(model)]
    for sensor in sensors:
        sensor.observe(data)
    before = sensors[0].luminance
    # between the reset and the first observe is early enough
    sensors[0].reset()
    LARGE[name](model)
    sensors[1].refresh()
    data.time += 0.001
    for sensor in sensors:
        sensor.observe(data)
        assert sensor.luminance.tobytes() == seen_anew(model, data).tobytes()
        assert sensor.luminance.tobytes() != before.tobytes()


def test_only_what_changed_is_built_again():
    model, data = stage()
    sensor = eye(model)
    sensor.observe(data)
    counts = {"scenes": 0, "meshes": 0, "textures": 0}
    assert sensor.rebuilt == counts
    for edit, more in (
        (SMALL["colour"], {"scenes": 1}),
        (SMALL["light's place"], {}),
        (SMALL["fovy"], {"scenes": 1}),
        (put("cam.other.fovy", 20.0), {}),
        (SMALL["height of the field"], {"scenes": 1, "meshes": 1}),
        (LARGE["vertices"], {"scenes": 1, "meshes": 1}),
        (LARGE["texels"], {"scenes": 1, "textures": 1}),
        (lambda _model: None, {}),
    ):
        edit(model)
        sensor.refresh()
        go_on(model, data, sensor)
        counts = {kind: count + more.get(kind, 0) for kind, count in counts.items()}
        assert sensor.rebuilt == counts
    assert sensor.luminance.tobytes() == seen_anew(model, data).tobytes()


def test_intrinsics_are_those_of_the_edited_camera():
    model, data = stage()
    sensor = eye(model)
    sensor.observe(data)
    model.cam("eye").fovy[0] = 90.0
    go_on(model, data, sensor)
    assert sensor.info.camera_info["k"][0] == pytest.approx(12.0)


def test_an_edit_that_cannot_be_shown_is_one_line_until_it_is_undone():
    model, data = stage()
    sensor = eye(model)
    sensor.observe(data)
    kept = model.geom_rgba.copy()
    for _ in range(2):
        model.geom("rod").rgba[0] = np.nan
        mujoco.mj_step(model, data)
        with pytest.raises(evs.EvsError, match="rgba of geom 'rod' is nan"):
            sensor.observe(data)
    heights = model.hfield_data.copy()
    model.geom_rgba[:] = kept
    model.hfield_data[3] = np.inf
    for _ in range(2):
        with pytest.raises(evs.EvsError, match="height field 'hill' has 1 value that"):
            sensor.refresh()
    with pytest.raises(evs.EvsError, match="height field 'hill' has 1 value that"):
        sensor.observe(data)
    model.hfield_data[:] = heights
    sensor.observe(data)
    assert sensor.luminance.tobytes() == seen_anew(model, data).tobytes()


def test_flow_goes_on_over_an_edit_of_colours_and_not_over_one_of_geoms():
    model, data = stage()
    sensor = eye(model)
    sensor.observe(data)
    SMALL["colour"](model)
    go_on(model, data, sensor)
    assert np.isfinite(sensor.ground_truth().flow).any()
    SMALL["group in"](model)
    go_on(model, data, sensor)
    truth = sensor.ground_truth()
    assert (truth.geom_id == model.geom("ghost").id).any()
    assert not np.isfinite(truth.flow).any()
    go_on(model, data, sensor)
    assert np.isfinite(sensor.ground_truth().flow).any()


def test_a_free_camera_follows_the_visual_options():
    model, data = stage()
    sensor = eye(model, evs.CameraConfig(distance=3.0))
    sensor.observe(data)
    for name, value in (("azimuth", 30.0), ("elevation", -60.0), ("fovy", 70.0)):
        setattr(model.vis.global_, name, value)
        go_on(model, data, sensor)
        now = seen_anew(model, data, evs.CameraConfig(distance=3.0))
        assert sensor.luminance.tobytes() == now.tobytes(), name


def test_a_world_its_views_and_cameras_see_edits_too():
    model, _ = stage()
    world = evs.World(model, threads=1)
    cameras = [world.add_camera(name, sensor=SIZE, render=RENDER) for name in ("eye", "other")]
    view = world.add_view("eye", sensor=SIZE, render=RENDER)
    world.step()
    for edit in (SMALL["colour"], SMALL["group in"], SMALL["fovy"], SMALL["light off"]):
        edit(world.model)
        world.step()
        for camera, name in zip(cameras, ("eye", "other"), strict=True):
            now = seen_anew(world.model, world.data, name)
            assert camera.luminance.tobytes() == now.tobytes()
        assert view.render()[0].tobytes() == cameras[0].luminance.tobytes()
        cameras[0].ground_truth()
    # the fovy was of one camera
    assert [camera.rebuilt["scenes"] for camera in cameras] == [4, 3]
    LARGE["heights"](world.model)
    world.reset()
    world.step()
    now = seen_anew(world.model, world.data)
    assert cameras[0].luminance.tobytes() == now.tobytes()
    late = world.add_camera("eye", sensor=SIZE, render=RENDER)
    world.step()
    assert late.luminance.tobytes() == cameras[0].luminance.tobytes()


def test_bodies_that_sleep_are_seen_where_an_edit_puts_them():
    model = mujoco.MjModel.from_xml_string(
        STAGE.replace('gravity="0 0 0"', 'gravity="0 0 0"><flag sleep="enable"/></option><option')
    )
    data = mujoco.MjData(model)
    sensor = eye(model)
    sensor.observe(data)
    model.geom("box").pos[:] = (-0.3, 0.3, 0.2)
    data.time += 0.001
    sensor.observe(data)
    assert sensor.luminance.tobytes() == seen_anew(model, data).tobytes()
    model.opt.enableflags &= ~int(mujoco.mjtEnableBit.mjENBL_SLEEP)
    model.geom("box").pos[:] = (0.3, 0.3, 0.2)
    data.time += 0.001
    sensor.observe(data)
    assert sensor.luminance.tobytes() == seen_anew(model, data).tobytes()


def test_a_saved_state_belongs_to_the_model_as_it_was_edited():
    model, data = stage()
    other = copy.copy(model)
    sensor = eye(model)
    sensor.observe(data)
    SMALL["colour"](model)
    go_on(model, data, sensor)
    blob = sensor.save()
    twin = eye(other)
    with pytest.raises(evs.EvsError, match="saved by another model"):
        twin.restore(blob)
    # edited alike, and never seen since
    SMALL["colour"](other)
    twin.restore(blob)
    assert twin.luminance.tobytes() == sensor.luminance.tobytes()
    world = evs.World(model, threads=1)
    world.add_camera("eye", sensor=SIZE)
    world.step()
    world.save()
    SMALL["light off"](world.model)
    world.step()
    fresh = evs.World(model, threads=1)
    fresh.add_camera("eye", sensor=SIZE)
    with pytest.raises(evs.EvsError, match="saved by another model"):
        fresh.restore(world.save())
    SMALL["light off"](fresh.model)
    fresh.restore(world.save())
    (ours,), (theirs,) = fresh.cameras, world.cameras
    assert ours.luminance.tobytes() == theirs.luminance.tobytes()


def test_data_of_a_recompiled_model_is_refused():
    spec = mujoco.MjSpec.from_string(STAGE)
    model = spec.compile()
    data = mujoco.MjData(model)
    sensor = eye(model)
    sensor.observe(data)
    spec.geom("rod").size[0] = 0.2
    model, data = spec.recompile(model, data)
    data.time = 0.001
    with pytest.raises(evs.EvsError) as caught:
        sensor.observe(data)
    assert "the data belongs to another model" in str(caught.value)
    assert "make a new EventCamera from data.model" in str(caught.value)
    assert "\n" not in str(caught.value)


def test_data_of_a_copy_will_do_while_that_is_alike():
    model, _ = stage()
    other = copy.copy(model)
    data = mujoco.MjData(other)
    sensor = eye(model)
    sensor.observe(data)
    # physics are not looked at
    other.body_mass[:] *= 2
    other.opt.timestep = 0.0005
    go_on(other, data, sensor)
    again = copy.deepcopy(data)
    again.time = 0.01
    sensor.observe(again)
    SMALL["colour"](other)
    data.time = 0.02
    with pytest.raises(evs.EvsError, match="belongs to another model"):
        sensor.observe(data)


CLOTH = """<flexcomp name="cloth" type="grid" count="4 4 1" spacing=".2 .2 .2" radius=".01" dim="2"
  pos="0 -.6 1" mass="1" material="hide"><edge equality="true"/></flexcomp></worldbody>"""


@pytest.mark.parametrize("renderer", ["direct", "path"])
def test_cloth_is_not_built_again_with_what_changed_beside_it(renderer):
    model = mujoco.MjModel.from_xml_string(STAGE.replace("</worldbody>", CLOTH))
    data = mujoco.MjData(model)
    render = RenderConfig(renderer=renderer, spp=1)
    sensor = evs.EventCamera(model, "eye", sensor=SIZE, render=render, threads=1)
    sensor.observe(data)
    assert model.nflex == 1
    for step in range(6):
        model.geom("rod").rgba[:3] = step / 6.0
        model.flex_matid[0] = (-1, 2, 4)[step % 3]
        data.qvel[:] = np.sin(np.arange(model.nv) + step)
        mujoco.mj_step(model, data)
        sensor.observe(data)
        anew = evs.EventCamera(model, "eye", sensor=SIZE, render=render, threads=1)
        anew.observe(data)
        assert sensor.luminance.tobytes() == anew.luminance.tobytes(), step
        # what is kept incrementally, too
        mujoco.mj_step(model, data)
        sensor.observe(data)
        anew.observe(data)
        assert sensor.luminance.tobytes() == anew.luminance.tobytes(), step
    assert sensor.rebuilt == {"scenes": 6, "meshes": 0, "textures": 0}


def test_edits_while_light_is_made_ahead():
    def film(depth):
        model, _ = stage()

        def edit(t_s, data):
            tick = round(t_s * 1e3)
            if tick in (3, 6, 9):
                SMALL[("colour", "group in", "light off")[tick // 3 - 1]](data.model)

        world = evs.World(model, control=edit, threads=1)
        labelled = ModelConfig(labels=True)
        world.add_camera("eye", sensor=SIZE, render=RENDER, model=labelled)
        found = []
        with pipelined(world, 14, StopWatch(lambda: 0.0), depth) as running:
            for _ in range(14):
                (packet,) = running.step()
                truth = running.cameras[0].ground_truth()
                found.append((packet.events.tobytes(), truth.geom_id.tobytes()))
        assert world.cameras[0].rebuilt["scenes"] == 3
        return found

    plain = film(0)
    assert film(2) == plain
    assert len({geoms for _, geoms in plain}) > 1
