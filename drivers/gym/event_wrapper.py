"""EventWrapper, EventVectorWrapper: environments of another library with a camera in each."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from evs.drivers.environments.event_env import EpisodeCameras, HasEvents
from evs.drivers.gym.library import gymnasium, vector
from evs.emulator.simulation.world_batch import stacked
from evs.emulator.simulation.worlds import WorldsEvents
from evs.msgs import Events


class EventWrapper(HasEvents, gymnasium.Wrapper[Any, Any, Any, Any]):
    """The environment, with `events` and `event_camera`. See evs.wrap."""

    def __init__(self, env: gymnasium.Env[Any, Any], episode: EpisodeCameras) -> None:
        """See evs.wrap."""
        super().__init__(env)
        self._episode = episode

    def step(self, action: Any) -> tuple[Any, Any, bool, bool, dict[str, Any]]:
        """As the environment's."""
        with self._episode.step():
            return self.env.step(action)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """As the environment's."""
        result = self.env.reset(seed=seed, options=options)
        self._episode.begin(seed)
        return result


class EventVectorWrapper(vector.VectorWrapper):
    """The vector environment, with `events` and `event_cameras`. See evs.wrap."""

    def __init__(
        self, env: vector.VectorEnv[Any, Any, Any], wrap: Callable[[Any, int], Any]
    ) -> None:
        """Put a camera into each environment.

        Args:
            env: A vector environment that holds its environments in `envs`.
            wrap: Wraps one of them, the n-th.
        """
        super().__init__(env)
        inner: Any = env.unwrapped
        inner.envs = [wrap(one, number) for number, one in enumerate(inner.envs)]
        self._wrapped = inner.envs

    @property
    def events(self) -> Any:
        """WorldsEvents of the last step: item i is (n,) EVENT_DTYPE of environment i.

        If `wrap` got a list of cameras: a dict of them by the names of the cameras.
        """
        seen = [one.events for one in self._wrapped]
        if isinstance(seen[0], dict):
            return {name: _worlds_events([one[name] for one in seen]) for name in seen[0]}
        return _worlds_events(seen)

    @property
    def event_cameras(self) -> list[Any]:
        """The `event_camera` of each environment."""
        return [one.event_camera for one in self._wrapped]

    @property
    def instabilities(self) -> list[int]:
        """Those of each environment. See HasEvents."""
        return [one.instabilities for one in self._wrapped]


def _worlds_events(parts: list[Events]) -> WorldsEvents:
    return WorldsEvents(*stacked(parts, [len(part) for part in parts]))
