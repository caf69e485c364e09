"""EventWrapper: the EventEnv of a Gymnasium environment."""

from __future__ import annotations

from typing import Any

from evs.drivers.environments.event_env import EpisodeCameras, HasEvents
from evs.drivers.gym.library import gymnasium


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
