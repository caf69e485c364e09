"""EventEnv: an environment of another library with an event camera in it."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np

from evs.drivers.environments.physics import find_physics
from evs.emulator import EventCamera
from evs.emulator.world import MjData, MjModel
from evs.emulator.world.substeps import watching
from evs.msgs import Events, EvsError, empty_events, join_events


class EpisodeCamera:
    """An event camera that follows an environment through its episodes and its models."""

    def __init__(
        self, env: Any, make: Callable[[MjModel], EventCamera], every: str, seed: int
    ) -> None:
        """Put a camera into the environment as it is now.

        Args:
            env: As of `find_physics`.
            make: The camera of a model.
            every: substep | step
            seed: The noise of all episodes follows from it.

        Raises:
            EvsError: There is no physics, or the camera does not fit into it.
        """
        self._env, self._make, self._substeps = env, make, every == "substep"
        self._random = np.random.default_rng(seed)
        self._model: MjModel | None = None
        self._data: MjData | None = None
        self._seen_s = 0.0
        self.events = empty_events()
        self.begin()

    def begin(self, seed: int | None = None) -> None:
        """Start an episode: light is compared with that of now, and there are no events yet.

        Args:
            seed: The noise of this episode and of all later ones follows from it; None: go on.
        """
        if seed is not None:
            self._random = np.random.default_rng(seed)
        noise = int(self._random.integers(2**31))
        model, data = find_physics(self._env)
        if model is not self._model:
            self.camera, self._model = self._make(model), model
        self.camera.reset(noise)
        self.camera.observe(data)
        self._data, self._seen_s = data, data.time
        self.events = empty_events()

    @contextmanager
    def step(self) -> Iterator[None]:
        """Observe what happens while this is open. Where an episode begins in it: `begin`."""
        model, data = self._model, self._data
        if find_physics(self._env) != (model, data):
            # it was reset, or compiled, behind the wrapper
            self.begin()
            model, data = self._model, self._data
        assert model is not None
        assert data is not None
        parts: list[Events] = []
        restarted = False

        def observe() -> None:
            nonlocal restarted
            restarted = restarted or data.time < self._seen_s
            if not restarted and data.time > self._seen_s and self._substeps:
                parts.append(self.camera.observe(data))
                self._seen_s = data.time

        began_s = self._seen_s
        with watching(data, observe):
            yield
        if restarted or find_physics(self._env) != (model, data) or data.time < self._seen_s:
            self.begin()
            return
        if data.time > self._seen_s:
            if self._substeps and data.time - began_s > 1.5 * model.opt.timestep:
                raise EvsError(
                    "the environment does not step by mujoco.mj_step: give every='step' to wrap"
                )
            parts.append(self.camera.observe(data))
            self._seen_s = data.time
        self.events = join_events(parts)


class HasEvents:
    """What an environment gains."""

    _episode: EpisodeCamera

    @property
    def events(self) -> Events:
        """(n,) EVENT_DTYPE, those of the last step; none after a reset."""
        return self._episode.events

    @property
    def event_camera(self) -> EventCamera:
        """What made them: `luminance`, `ground_truth()`, `info`. Another model has another one."""
        return self._episode.camera


class EventEnv(HasEvents):
    """The environment, with `events` and `event_camera`; everything else is the environment's."""

    def __init__(self, env: Any, episode: EpisodeCamera) -> None:
        """See `wrap`."""
        self.env, self._episode = env, episode

    def step(self, *args: Any, **more: Any) -> Any:
        """As the environment's."""
        with self._episode.step():
            return self.env.step(*args, **more)

    def reset(self, *args: Any, **more: Any) -> Any:
        """As the environment's."""
        result = self.env.reset(*args, **more)
        self._episode.begin(more.get("seed"))
        return result

    def __getattr__(self, name: str) -> Any:
        if name in ("env", "_episode"):  # as in a copy that is being made
            raise AttributeError(name)
        return getattr(self.env, name)
