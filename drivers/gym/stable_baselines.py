"""StableBaselinesEnvs: a Gymnasium vector environment in the form that Stable-Baselines3 expects.

Stable-Baselines3 has a base class of its own. It is installed by whoever learns with it; nothing
else here imports it.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
from stable_baselines3.common.vec_env import VecEnv  # pyright: ignore[reportMissingImports]

from evs.drivers.gym.library import vector
from evs.msgs import EvsError


class StableBaselinesEnvs(VecEnv):  # type: ignore[misc]
    """Environments that begin another episode in the step in which one ends.

    envs = evs.make_vec("evs/CartPole-v0", 16, autoreset_mode="SameStep", observation="voxel_grid")
    learner = PPO("MlpPolicy", StableBaselinesEnvs(envs), device="cpu")
    """

    def __init__(self, envs: vector.VectorEnv[Any, Any, Any]) -> None:
        """Put the class around them.

        Args:
            envs: A vector environment with autoreset_mode SameStep.

        Raises:
            EvsError: It has another autoreset_mode.
        """
        mode = envs.metadata.get("autoreset_mode")
        if mode != vector.AutoresetMode.SAME_STEP:
            raise EvsError(
                f"Stable-Baselines3 resets in the step in which an episode ends, not by {mode}: "
                'make the environments with autoreset_mode="SameStep"'
            )
        self.envs = envs
        super().__init__(envs.num_envs, envs.single_observation_space, envs.single_action_space)

    def reset(self) -> Any:
        """Begin episodes, with the seeds of `seed` if it was called; the observations."""
        given = self._seeds if any(one is not None for one in self._seeds) else None
        observation, _ = self.envs.reset(seed=given)
        self._reset_seeds()
        self._reset_options()
        return observation

    def step_async(self, actions: npt.NDArray[Any]) -> None:
        """Take note of the actions (n, nu)."""
        self._actions = actions

    def step_wait(self) -> tuple[Any, npt.NDArray[np.float32], npt.NDArray[np.bool_], list[Any]]:
        """Act: observations, rewards, ends, and the info of each environment."""
        observation, rewards, terminated, truncated, infos = self.envs.step(self._actions)
        over = terminated | truncated
        told: list[dict[str, Any]] = []
        for number in range(self.num_envs):
            own = {
                name: values[number]
                for name, values in infos.items()
                if isinstance(values, np.ndarray) and f"_{name}" in infos and name != "final_obs"
            }
            own["TimeLimit.truncated"] = bool(truncated[number] and not terminated[number])
            if over[number]:
                own["terminal_observation"] = infos["final_obs"][number]
            told.append(own)
        return observation, rewards.astype(np.float32), over, told

    def close(self) -> None:
        """End them."""
        self.envs.close()

    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
        """An attribute of the whole, once for each environment."""
        return [getattr(self.envs, attr_name)] * len(self._get(indices))

    def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:
        """Refused: the environments are one object."""
        del value, indices
        raise EvsError(f"'{attr_name}' cannot be set for single environments of {self.envs}")

    def env_method(
        self, method_name: str, *args: Any, indices: Any = None, **more: Any
    ) -> list[Any]:
        """Refused: the environments are one object."""
        del args, indices, more
        raise EvsError(f"'{method_name}' cannot be called of single environments of {self.envs}")

    def env_is_wrapped(self, wrapper_class: Any, indices: Any = None) -> list[bool]:
        """No environment has a wrapper of its own."""
        del wrapper_class
        return [False] * len(self._get(indices))

    def _get(self, indices: Any) -> Sequence[int]:
        return [*self._get_indices(indices)]
