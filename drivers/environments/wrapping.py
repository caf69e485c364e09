"""wrap: events from an environment of another library, in one line; make_vec: many of ours."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import Any

from evs.drivers.environments.event_env import EpisodeCameras, EventEnv
from evs.drivers.environments.host_view import find_visual
from evs.drivers.environments.physics import holds_environments, is_gymnasium
from evs.emulator import EventCamera
from evs.emulator.camera.camera import free_name
from evs.emulator.config import CameraConfig, ModelConfig, RenderConfig, SensorConfig
from evs.emulator.world import MjModel, Scene, Visual
from evs.msgs import EvsError

EVERY = ("substep", "step")


def wrap(
    env: Any,
    camera: str | CameraConfig | Sequence[str | CameraConfig] = "",
    *,
    every: str = "substep",
    sensor: str | SensorConfig = "davis346",
    render: RenderConfig | None = None,
    model_config: ModelConfig | None = None,
    seed: int = 0,
    threads: int = 0,
    visual: Visual | None = None,
) -> Any:
    """Put an event camera into an environment.

        env = evs.wrap(gymnasium.make("Ant-v5"), camera="track")
        env.reset(seed=1)
        env.step(action)
        env.events                      # events of this step

    For Gymnasium, Gymnasium-Robotics, Metaworld, robosuite and dm_control environments, also
    wrapped ones. Events start again after resets, resets that compile a new model, and episodes
    that begin in `step`. In a gymnasium.vector.SyncVectorEnv every environment gets its own camera,
    item i of `events` holds the events of environment i, and `event_cameras` holds the cameras.

    With a list of cameras, `events` and `event_camera` are dicts by name. Calls may be nested: each
    wrapper has the events of its own cameras.

    If the physics becomes unstable, MuJoCo resets the data and events start again. `instabilities`
    counts these resets, and the first one issues an `evs.emulator.UnstableWarning`.

    Args:
        env: The environment; the results of its step and reset do not change.
        camera: See `EventCamera`, as for the other arguments; or a list of cameras.
        every: When the camera observes: in every "substep" of the physics, or after every "step" of
            the environment, which is faster but makes moving objects jump.
        sensor: Its preset or configuration.
        render: How light reaches the pixels.
        model_config: What turns light into events.
        seed: Determines the noise of all episodes, together with the seed of `reset`.
        threads: Worker threads; 0: one per core.
        visual: Visible groups and flags, a mujoco.MjvOption or a VisualConfig; None: those of
            the environment's own pictures where it has any (robosuite's render_collision_mesh,
            Gymnasium's MujocoRenderer, dm_control's scene_option), else what MuJoCo shows by
            default.

    Returns:
        The environment with `events`, (n,) EVENT_DTYPE of its last step, `event_camera`, the
        EventCamera, and `instabilities`. For Gymnasium, it is a gymnasium.Wrapper.

    Raises:
        EvsError: The environment has no MuJoCo physics; or see `EventCamera`.
    """
    if every not in EVERY:
        raise EvsError(f"every is {every!r}; give {' or '.join(map(repr, EVERY))}")
    if holds_environments(env):
        from evs.drivers.gym.event_wrapper import EventVectorWrapper

        def one(inner: Any, number: int) -> Any:
            return wrap(
                inner,
                camera,
                every=every,
                sensor=sensor,
                render=render,
                model_config=model_config,
                seed=seed + number,
                threads=threads,
                visual=visual,
            )

        return EventVectorWrapper(env, one)

    keyed = not isinstance(camera, str | CameraConfig)
    wanted = [camera] if isinstance(camera, str | CameraConfig) else list(camera)
    if not wanted:
        raise EvsError("camera is an empty list: give the names of cameras")

    def make(model: MjModel) -> dict[str, EventCamera]:
        made: dict[str, EventCamera] = {}
        for one in wanted:
            new = partial(
                EventCamera,
                model,
                camera=one,
                sensor=sensor,
                render=render,
                model_config=model_config,
                threads=threads,
                visual=find_visual(env, one) if visual is None else visual,
            )
            event_camera = new()
            name = event_camera.info.camera
            if name in made:
                name = free_name(None, name, tuple(made))
                event_camera = new(name=name)
            made[name] = event_camera
        return made

    episode = EpisodeCameras(env, make, len(wanted), every, seed, keyed)
    if not is_gymnasium(env):
        return EventEnv(env, episode)
    from evs.drivers.gym.event_wrapper import EventWrapper

    return EventWrapper(env, episode)


def make_vec(scene: Scene, num_envs: int = 1, **options: Any) -> Any:
    """Make a Gymnasium vector environment of many worlds, which one process steps together.

        envs = evs.make_vec("robot.xml", 64, cameras="wrist", observation="voxel_grid")
        envs = evs.make_vec("evs/CartPole-v0", 64)     # a registered one, other options allowed

    Args:
        scene: A registered name (evs/CartPole-v0, ...), or a scene as in LoopEnv.
        num_envs: Number of environments.
        **options: See `evs.drivers.gym.LoopVectorEnv`: cameras, observation, reward, ...

    Returns:
        A gymnasium.vector.VectorEnv.

    Raises:
        EvsError: Gymnasium is not installed (extra gym), or an option is invalid.
    """
    from evs.drivers.gym.library import gymnasium
    from evs.drivers.gym.loop_vector_env import LoopVectorEnv
    from evs.drivers.gym.registration import ENVIRONMENTS

    if isinstance(scene, str) and scene in ENVIRONMENTS:
        mode = "vector_entry_point"
        return gymnasium.make_vec(scene, num_envs=num_envs, vectorization_mode=mode, **options)
    return LoopVectorEnv(scene, num_envs=num_envs, **options)
