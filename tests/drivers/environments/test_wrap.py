"""evs.wrap: the same events as an EventCamera in the loop, whatever the environment does."""

from __future__ import annotations

import subprocess
import sys
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext
from types import SimpleNamespace
from typing import Any

import gymnasium
import mujoco
import numpy as np
import pytest

import evs
from evs.drivers.environments.physics import find_physics
from evs.emulator import UnstableError, UnstableWarning
from evs.msgs import Events, EvsError, empty_events, join_events

BALL = """
<mujoco><option timestep=".002"/><worldbody><light pos="0 0 3"/>
<camera name="eye" pos="0 -1.5 .5" xyaxes="1 0 0 0 0 1"/>
<geom type="plane" size="3 3 .1"/>
<body pos="0 0 {height}"><freejoint/><geom size=".2" rgba="{grey} .5 .3 1"/></body>
</worldbody></mujoco>"""
SENSOR = evs.SensorConfig("davis346", width=32, height=24)
FRAME_SKIP = 5
LATE_STEP = mujoco.mj_step
"""MuJoCo's own, as in a library that said `from mujoco import mj_step`"""


def ball(height: float = 1.0, grey: float = 0.8) -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_string(BALL.format(height=height, grey=grey))


class Ball(gymnasium.Env[Any, Any]):
    """As Gymnasium and Metaworld: model and data; a step is several of the physics."""

    observation_space = gymnasium.spaces.Box(-1, 1, (1,))
    action_space = gymnasium.spaces.Box(-1, 1, (1,))

    def __init__(self, step: Callable[..., None] | None = None) -> None:
        self.model = ball()
        self.data = mujoco.MjData(self.model)
        self.stepped = step

    def step(self, action: Any) -> Any:
        (self.stepped or mujoco.mj_step)(self.model, self.data, nstep=FRAME_SKIP)
        return np.zeros(1, np.float32), 0.0, False, False, {}

    def reset(self, *, seed: int | None = None, options: Any = None) -> Any:
        super().reset(seed=seed)
        mujoco.mj_resetData(self.model, self.data)
        return np.zeros(1, np.float32), {}


class Suite:
    """As dm_control: `physics`, mj_step2 before mj_step1, and a step after the last one resets."""

    def __init__(self, last: int = 4) -> None:
        model = ball()
        self.physics = SimpleNamespace(
            model=SimpleNamespace(ptr=model), data=SimpleNamespace(ptr=mujoco.MjData(model))
        )
        self.last = last
        self.reset()

    def reset(self) -> str:
        mujoco.mj_resetData(self.physics.model.ptr, self.physics.data.ptr)
        mujoco.mj_forward(self.physics.model.ptr, self.physics.data.ptr)
        self.count = 0
        return "first"

    def step(self, action: Any) -> str:
        if self.count == self.last:
            return self.reset()
        self.count += 1
        model, data = self.physics.model.ptr, self.physics.data.ptr
        mujoco.mj_step2(model, data)
        mujoco.mj_step(model, data, FRAME_SKIP - 1)
        mujoco.mj_step1(model, data)
        return "mid"


class Suites:
    """As robosuite: `sim`; a reset compiles another model."""

    def __init__(self) -> None:
        self.compiled = 0
        self.reset()

    def reset(self) -> None:
        model = ball(grey=0.2 + 0.3 * self.compiled)
        self.compiled += 1
        self.sim = SimpleNamespace(
            model=SimpleNamespace(_model=model), data=SimpleNamespace(_data=mujoco.MjData(model))
        )

    def step(self, action: Any) -> tuple[None, float, bool, dict[str, Any]]:
        for _ in range(FRAME_SKIP):
            mujoco.mj_step1(self.sim.model._model, self.sim.data._data)
            mujoco.mj_step2(self.sim.model._model, self.sim.data._data)
        return None, 0.0, False, {}


def wrapped(env: Any, **options: Any) -> Any:
    return evs.wrap(env, "eye", **{"sensor": SENSOR, "threads": 1, **options})


def own_loop(seed: int, steps: int, every: int = 1, grey: float = 0.8) -> Events:
    """The same ball in a loop of ours; the camera looks every `every` steps."""
    model = ball(grey=grey)
    data = mujoco.MjData(model)
    camera = evs.EventCamera(model, "eye", sensor=SENSOR, seed=seed, threads=1)
    camera.observe(data)
    parts = []
    for k in range(steps):
        LATE_STEP(model, data)
        if (k + 1) % every == 0:
            parts.append(camera.observe(data))
    return join_events(parts)


def seed_of(env: Any) -> int:
    return int(env.event_camera.info.seed)


def run(env: Any, steps: int) -> Events:
    parts = []
    for _ in range(steps):
        env.step(None)
        parts.append(env.events)
    return join_events(parts)


@pytest.mark.parametrize(("every", "looks"), [("substep", 1), ("step", FRAME_SKIP)])
@pytest.mark.parametrize("kind", [Ball, Suite])
def test_events_are_those_of_a_camera_in_the_loop(kind: Any, every: str, looks: int) -> None:
    env = wrapped(kind(), every=every)
    env.reset()
    seen = run(env, 4)
    expected = own_loop(seed_of(env), 4 * FRAME_SKIP, looks)
    assert len(expected) > 100
    assert seen.tobytes() == expected.tobytes()


def test_another_model_is_followed() -> None:
    env = wrapped(Suites())
    first = env.event_camera
    for compiled in (2, 3):
        env.reset()
        assert len(env.events) == 0
        seen = run(env, 4)
        expected = own_loop(seed_of(env), 4 * FRAME_SKIP, grey=0.2 + 0.3 * (compiled - 1))
        assert seen.tobytes() == expected.tobytes()
    assert env.event_camera is not first


def test_a_model_compiled_behind_the_wrapper_is_seen() -> None:
    inner = Suites()
    env = wrapped(inner)
    inner.reset()
    env.step(None)
    assert env.events.tobytes() == own_loop(seed_of(env), FRAME_SKIP, grey=0.5).tobytes()


@pytest.mark.parametrize("every", ["substep", "step"])
def test_an_episode_that_begins_in_step_begins_anew(every: str) -> None:
    env = wrapped(Suite(last=2), every=every)
    first = [seed_of(env), run(env, 2)]
    assert env.step(None) == "first"
    assert len(env.events) == 0
    assert seed_of(env) != first[0]
    seen = run(env, 2)
    looks = 1 if every == "substep" else FRAME_SKIP
    assert seen.tobytes() == own_loop(seed_of(env), 2 * FRAME_SKIP, looks).tobytes()


def test_an_episode_that_settles_within_the_step_begins_after_it() -> None:
    """The reset takes as long as the episode did: time alone would not tell afterwards."""

    class Settling(Suite):
        def reset(self) -> str:
            super().reset()
            for _ in range(50):
                mujoco.mj_step(self.physics.model.ptr, self.physics.data.ptr)
            return "first"

    env = wrapped(Settling(last=1))
    env.step(None)
    assert len(env.events)
    assert env.step(None) == "first"
    assert len(env.events) == 0


def test_seeds_decide_the_noise() -> None:
    def episodes(env: Any, *seeds: int | None) -> list[bytes]:
        seen = []
        for seed in seeds:
            env.reset(seed=seed)
            seen.append(run(env, 2).tobytes())
        return seen

    one = episodes(wrapped(Ball()), 5, None, 6)
    assert len(set(one)) == 3
    assert one == episodes(wrapped(Ball(), seed=9), 5, None, 6)
    # without a seed of reset, that of wrap
    assert episodes(wrapped(Ball(), seed=9), None) == episodes(wrapped(Ball(), seed=9), None)
    assert episodes(wrapped(Ball(), seed=9), None) != episodes(wrapped(Ball(), seed=8), None)


def test_gymnasium_sees_a_wrapper() -> None:
    env = wrapped(gymnasium.wrappers.TimeLimit(Ball(), 3))
    assert isinstance(env, gymnasium.Wrapper)
    outer = gymnasium.wrappers.RecordEpisodeStatistics(env)
    outer.reset(seed=0)
    ends = [outer.step(np.zeros(1))[3] for _ in range(3)]
    assert ends == [False, False, True]
    assert len(outer.get_wrapper_attr("events")) > 0
    vector = gymnasium.vector.SyncVectorEnv([lambda: wrapped(Ball())] * 2)
    vector.reset(seed=[3, 4])
    vector.step(np.zeros((2, 1)))
    assert [len(events) > 0 for events in vector.get_attr("events")] == [True, True]


def test_a_vector_has_the_events_of_each_of_its_environments() -> None:
    vector = wrapped(gymnasium.vector.SyncVectorEnv([Ball] * 3), seed=5)
    assert isinstance(vector, gymnasium.vector.VectorEnv)
    vector.reset(seed=[3, 4, 4])
    vector.step(np.zeros((3, 1)))
    for number in range(3):
        alone = wrapped(Ball(), seed=5 + number)
        alone.reset(seed=[3, 4, 4][number])
        alone.step(np.zeros(1))
        assert len(alone.events)
        assert vector.events[number].tobytes() == alone.events.tobytes()
    assert vector.events.counts.sum() == len(vector.events.events)
    assert len(vector.event_cameras) == 3
    # every episode begins anew where the vector resets by itself
    assert vector.events[1].tobytes() != vector.events[0].tobytes()


def test_a_vector_of_processes_is_wrapped_before_they_start() -> None:
    vector = gymnasium.vector.AsyncVectorEnv([Ball])
    try:
        with pytest.raises(EvsError, match=r"of environments: wrap each.*wrappers=\[evs.wrap\]"):
            evs.wrap(vector)
    finally:
        vector.close()


@pytest.mark.parametrize("kind", [Ball, Suite])
def test_several_cameras_see_one_environment(kind: Any) -> None:
    above = evs.CameraConfig(lookat=(0, 0, 0.8), distance=1.0)
    env = evs.wrap(kind(), ["eye", above, above], sensor=SENSOR, threads=1)
    nested = wrapped(kind())
    for camera in (above, above):
        nested = evs.wrap(nested, camera, sensor=SENSOR, threads=1)
    assert list(env.event_camera) == ["eye", "free", "free_2"]
    for each in (env, nested):
        each.reset(seed=4) if kind is Ball else each.reset()
    together: list[Events] = [empty_events()] * 3
    one_by_one = together.copy()
    for _ in range(8):
        env.step(None)
        nested.step(None)
        apart = [nested.env.env.events, nested.env.events, nested.events]
        for k, (seen, expected) in enumerate(zip(env.events.values(), apart, strict=True)):
            together[k] = join_events([together[k], seen])
            one_by_one[k] = join_events([one_by_one[k], expected])
    assert [len(seen) > 20 for seen in together] == [True] * 3
    assert [seen.tobytes() for seen in together] == [seen.tobytes() for seen in one_by_one]
    # two cameras at one place have noise of their own
    assert together[1].tobytes() != together[2].tobytes()
    alone = wrapped(kind())
    alone.reset(seed=4) if kind is Ball else alone.reset()
    assert run(alone, 8).tobytes() == together[0].tobytes()


def test_several_cameras_see_a_vector() -> None:
    nested = wrapped(wrapped(gymnasium.vector.SyncVectorEnv([Ball] * 2)))
    listed = evs.wrap(
        gymnasium.vector.SyncVectorEnv([Ball] * 2), ["eye", "eye"], sensor=SENSOR, threads=1
    )
    for vector in (nested, listed):
        vector.reset(seed=3)
        vector.step(np.zeros((2, 1)))
    for seen, other in ((nested.env, "eye"), (nested, "eye_2")):
        assert len(seen.events[1])
        assert seen.events.events.tobytes() == listed.events[other].events.tobytes()
    assert [list(cameras) for cameras in listed.event_cameras] == [["eye", "eye_2"]] * 2


@pytest.fixture
def quiet() -> Iterator[None]:
    """MuJoCo prints no warning, and leaves no log file."""
    old = mujoco.get_mju_user_warning()
    mujoco.set_mju_user_warning(lambda _text: None)
    yield
    mujoco.set_mju_user_warning(old)


@pytest.mark.parametrize("before", [0, 2])
@pytest.mark.parametrize("every", ["substep", "step"])
@pytest.mark.parametrize("kind", [Ball, Suite, Suites])
def test_an_explosion_is_reported(kind: Any, every: str, before: int, quiet: None) -> None:
    """With no step before, time does not go back over a step: only MuJoCo's count tells."""
    env = wrapped(kind(), every=every)
    env.reset()
    run(env, before)
    _, data = find_physics(env)
    for count in (1, 2):
        data.qfrc_applied[2] = np.nan
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            env.step(None)
        assert env.instabilities == count
        assert len(env.events) == 0
        assert [one.category for one in caught] == [UnstableWarning] * (count == 1)
        for one in caught:
            text = str(one.message)
            t_s = 0.002 * before * FRAME_SKIP
            assert text.startswith(f"unstable after t = {t_s:.6f} s: bad ")
            assert " at joint '0' of body '1'; MuJoCo has reset the data by itself" in text
    env.step(None)
    env.reset()
    env.step(None)
    assert len(env.events)
    assert env.instabilities == 2


@pytest.mark.parametrize("before", [0, 2])
def test_an_explosion_in_a_loop_of_ones_own_is_reported(before: int, quiet: None) -> None:
    model = ball()
    data = mujoco.MjData(model)
    camera = evs.EventCamera(model, "eye", sensor=SENSOR, threads=1)
    camera.observe(data)
    for _ in range(before):
        mujoco.mj_step(model, data, 5)
        camera.observe(data)
    data.qvel[2] = np.inf
    mujoco.mj_step(model, data, 5)
    where = f"unstable after t = {before * 0.01:.6f} s: bad velocity .*joint"
    # time has gone back, or MuJoCo's count alone tells
    ends = pytest.raises(UnstableError, match=where + r".*call reset\(\)")
    with pytest.warns(UnstableWarning, match=where), ends if before else nullcontext():
        camera.observe(data)
    assert camera.instabilities == 1
    mujoco.mj_step(model, data)
    mujoco.mj_resetData(model, data)
    camera.reset()
    camera.observe(data)
    mujoco.mj_step(model, data)
    camera.observe(data)
    assert camera.instabilities == 1


def test_everything_else_is_the_environments() -> None:
    inner = Suite()
    env = wrapped(inner)
    assert env.physics is inner.physics
    assert env.last == 4
    with pytest.raises(AttributeError, match="nothing"):
        _ = env.nothing


@contextmanager
def refused(says: str) -> Iterator[None]:
    with pytest.raises(EvsError, match=says) as raised:
        yield
    assert "\n" not in str(raised.value)


def test_what_cannot_be_is_said() -> None:
    with refused("every is 'frame'; give 'substep' or 'step'"):
        wrapped(Ball(), every="frame")
    with refused(r"SimpleNamespace has no mujoco.MjModel and MjData .*use evs.EventCamera"):
        wrapped(SimpleNamespace(model=1, data=2))
    with refused("camera is an empty list"):
        evs.wrap(Ball(), [])
    with refused("camera"):
        evs.wrap(Ball(), "nowhere")


def test_substeps_that_cannot_be_seen_are_not_left_out_silently() -> None:
    env = wrapped(Ball(step=LATE_STEP))
    env.reset()
    with refused("does not step by mujoco.mj_step: give every='step'"):
        env.step(None)
    env = wrapped(Ball(step=LATE_STEP), every="step")
    env.reset()
    env.step(None)
    assert len(env.events)


def test_other_worlds_and_failures_pass_through() -> None:
    other = ball()
    data = mujoco.MjData(other)

    def both(model: Any, own: Any, nstep: int) -> None:
        mujoco.mj_step(other, data, nstep=3)
        mujoco.mj_step(model, own, nstep=nstep)
        if failing:
            raise RuntimeError("the robot is on fire")

    failing = False
    env = wrapped(Ball(step=both))
    env.reset()
    assert run(env, 2).tobytes() == own_loop(seed_of(env), 2 * FRAME_SKIP).tobytes()
    assert data.time == pytest.approx(6 * 0.002)
    failing = True
    with pytest.raises(RuntimeError, match="on fire"):
        env.step(None)
    # nobody watches any more
    failing = False
    before = len(env.events)
    mujoco.mj_step(env.unwrapped.model, env.unwrapped.data)
    assert len(env.events) == before


@pytest.mark.integration
def test_without_gymnasium_it_is_not_imported() -> None:
    program = """
import sys, mujoco, evs
spec = mujoco.MjSpec()
spec.worldbody.add_geom(size=[1, 1, 1])
class Env:
    model = spec.compile()
    data = mujoco.MjData(model)
    def step(self): mujoco.mj_step(self.model, self.data)
env = evs.wrap(Env(), sensor=evs.SensorConfig("ideal", width=8, height=8))
env.step()
assert "gymnasium" not in sys.modules
"""
    subprocess.run([sys.executable, "-c", program], check=True)


GROUPS = """
<mujoco><worldbody><light pos="0 0 3"/><camera name="eye" pos="0 -1.5 .5" xyaxes="1 0 0 0 0 1"/>
<geom type="plane" size="3 3 .1" group="1"/><geom size=".3" group="0"/>
<geom size=".2" group="1"/><geom size=".4" pos=".2 0 0" group="3"/></worldbody></mujoco>"""
HIDDEN = mujoco.MjvOption()
HIDDEN.geomgroup[0] = 0


def pair() -> tuple[mujoco.MjModel, mujoco.MjData]:
    model = mujoco.MjModel.from_xml_string(GROUPS)
    return model, mujoco.MjData(model)


class Robosuite:
    """As robosuite: which meshes its cameras show is an argument of its environments."""

    def __init__(self, collision: bool = False, visual: bool = True) -> None:
        self.render_collision_mesh, self.render_visual_mesh = collision, visual
        model, data = pair()
        self.sim = SimpleNamespace(
            model=SimpleNamespace(_model=model), data=SimpleNamespace(_data=data)
        )


class Rendered(Ball):
    """As Gymnasium's MujocoEnv: flags until there is a viewer, then the viewer's own option."""

    def __init__(self, flags: dict[int, bool], viewer: Any = None) -> None:
        super().__init__()
        self.model, self.data = pair()
        viewers = {"rgb_array": viewer} if viewer else {}
        self.mujoco_renderer = SimpleNamespace(_viewers=viewers, viewer=viewer, _vopt=flags)


class Pixels:
    """As dm_control's pixels.Wrapper: an option for its own pictures, in a wrapper of its own."""

    def __init__(self, **render_kwargs: Any) -> None:
        model, data = pair()
        self._env = SimpleNamespace(
            physics=SimpleNamespace(
                model=SimpleNamespace(ptr=model), data=SimpleNamespace(ptr=data)
            )
        )
        self._render_kwargs = render_kwargs

    def __getattr__(self, name: str) -> Any:
        return getattr(self._env, name)


NO_STATIC = {int(mujoco.mjtVisFlag.mjVIS_STATIC): False}


@pytest.mark.parametrize(
    ("env", "more", "seen"),
    [
        (Robosuite, {}, {0, 2}),
        (lambda: Robosuite(collision=True), {}, {0, 1}),
        (lambda: Robosuite(collision=True, visual=False), {}, {-1, 1}),
        (Robosuite, {"visual": mujoco.MjvOption()}, {0, 1}),
        (lambda: Rendered({}), {}, {0, 1}),
        (lambda: Rendered({}, SimpleNamespace(vopt=HIDDEN)), {}, {0, 2}),
        (lambda: Pixels(scene_option=SimpleNamespace(ptr=HIDDEN)), {}, {0, 2}),
        (Pixels, {}, {0, 1}),
    ],
)
def test_what_the_pictures_of_the_host_hide_is_hidden(
    env: Callable[[], Any], more: dict[str, Any], seen: set[int]
) -> None:
    camera = wrapped(env(), **more).event_camera
    assert set(camera.ground_truth().geom_id.ravel().tolist()) - {-1} == seen - {-1}


def test_flags_of_a_gymnasium_renderer_hold() -> None:
    with pytest.raises(EvsError, match=r"nothing to see.*scene.visual"):
        wrapped(Rendered(NO_STATIC))
