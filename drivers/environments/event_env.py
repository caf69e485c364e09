"""EventEnv: an environment of another library with event cameras in it."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np

from evs.drivers.environments.physics import find_physics
from evs.emulator import EventCamera
from evs.emulator.world import MjData, MjModel, StabilityWatch
from evs.emulator.world.physics import watching
from evs.msgs import Events, EvsError, empty_events, join_events


class EpisodeCameras:
    """Event cameras that follow an environment through its episodes and its models."""

    def __init__(
        self,
        env: Any,
        make: Callable[[MjModel], dict[str, EventCamera]],
        count: int,
        every: str,
        seed: int,
        keyed: bool,
    ) -> None:
        """Put cameras into the environment as it is now.

        Args:
            env: See `find_physics`. It may have event cameras already.
            make: The cameras of a model by name.
            count: Number of cameras.
            every: substep | step
            seed: The noise of all episodes follows from it.
            keyed: Whether `by_name` has a dict even of one camera.

        Raises:
            EvsError: There is no physics, or a camera does not fit into it.
        """
        self._env, self._make, self._substeps, self._keyed = env, make, every == "substep", keyed
        first = _cameras_in(env)
        self._numbers = range(first, first + count)
        self._model: MjModel | None = None
        self._data: MjData | None = None
        self._seen_s = 0.0
        self.stability = StabilityWatch()
        self.cameras: dict[str, EventCamera] = {}
        self.events: dict[str, Events] = {}
        """of each camera, those of the last step"""
        self.begin(seed)

    def by_name(self, values: dict[str, Any]) -> Any:
        """The values by the names of the cameras, or the value of the only camera."""
        return dict(values) if self._keyed else next(iter(values.values()))

    def __len__(self) -> int:
        """Number of cameras."""
        return len(self._numbers)

    def begin(self, seed: int | None = None) -> None:
        """Start an episode: light is compared with that of now, and there are no events yet.

        Args:
            seed: The noise of this episode and of all later ones follows from it; None: go on.
        """
        if seed is not None:
            # the cameras of an environment have different noise, also if they are nested wrappers
            self._randoms = [
                np.random.default_rng([seed, number] if number else seed)
                for number in self._numbers
            ]
        model, data = find_physics(self._env)
        if model is not self._model:
            self.cameras, self._model = self._make(model), model
        for camera, random in zip(self.cameras.values(), self._randoms, strict=True):
            camera.reset(int(random.integers(2**31)))
            camera.observe(data)
        self._data, self._seen_s = data, data.time
        self.stability.forget()
        self.stability.look(model, data)
        self.events = dict.fromkeys(self.cameras, empty_events())

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
        parts: dict[str, list[Events]] = {name: [] for name in self.cameras}
        restarted, looked = False, False

        def observe() -> None:
            for name, camera in self.cameras.items():
                parts[name].append(camera.observe(data))
            self._seen_s = data.time

        def look() -> None:
            nonlocal restarted, looked
            looked = True
            # an unstable state that MuJoCo has reset is the beginning of an episode, but not silent
            unstable = self.stability.look(model, data)
            restarted = restarted or data.time < self._seen_s or unstable is not None
            if not restarted and data.time > self._seen_s and self._substeps:
                observe()

        began_s = self._seen_s
        with watching(data, look):
            yield
        if find_physics(self._env) != (model, data):
            restarted = True
        elif not looked:
            restarted = self.stability.look(model, data) is not None
        if restarted or data.time < self._seen_s:
            self.begin()
            return
        if data.time > self._seen_s:
            if self._substeps and data.time - began_s > 1.5 * model.opt.timestep:
                raise EvsError(
                    "the environment does not step by mujoco.mj_step: give every='step' to wrap"
                )
            observe()
        self.events = {name: join_events(seen) for name, seen in parts.items()}


class HasEvents:
    """What an environment gains."""

    _episode: EpisodeCameras

    @property
    def events(self) -> Any:
        """(n,) EVENT_DTYPE, those of the last step; none after a reset.

        If `wrap` got a list of cameras: a dict of such arrays by the names of the cameras.
        """
        return self._episode.by_name(self._episode.events)

    @property
    def event_camera(self) -> Any:
        """The EventCamera: `luminance`, `ground_truth()`, `info`. Another model has another one.

        If `wrap` got a list of cameras: a dict of them by name.
        """
        return self._episode.by_name(self._episode.cameras)

    @property
    def instabilities(self) -> int:
        """How often MuJoCo found a bad position, velocity or acceleration, in all episodes.

        MuJoCo then resets the data by itself, and the events begin anew. A `UnstableWarning`
        reports the first one.
        """
        return self._episode.stability.count


def _cameras_in(env: Any) -> int:
    """How many event cameras wrappers have put into an environment."""
    count, met = 0, set()
    while env is not None and id(env) not in met:
        met.add(id(env))
        count += len(env._episode) if isinstance(env, HasEvents) else 0
        env = getattr(env, "env", None)
    return count


class EventEnv(HasEvents):
    """The environment, with `events` and `event_camera`; everything else is the environment's."""

    def __init__(self, env: Any, episode: EpisodeCameras) -> None:
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
