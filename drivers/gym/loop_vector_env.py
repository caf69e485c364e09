"""LoopVectorEnv: many closed loops in one process as a Gymnasium vector environment."""

from __future__ import annotations

from collections.abc import Sequence
from copy import deepcopy
from typing import Any

import numpy as np
import numpy.typing as npt

from evs.drivers.gym.library import seeding, vector
from evs.drivers.gym.loop_env import METADATA
from evs.drivers.gym.task import Task, TaskSpec, random_unchanged_on_error
from evs.emulator.base.rollback import unchanged_on_error
from evs.emulator.config import CameraConfig
from evs.emulator.config.decoding import plain_integer
from evs.emulator.config.keywords import fields_as_keywords
from evs.emulator.sensor.randomisation import DrawnSensor
from evs.emulator.simulation.scene_ranges import DrawnScene, begin
from evs.emulator.world import MjData, Scene
from evs.msgs import EvsError

AutoresetMode, batch_space = vector.AutoresetMode, vector.utils.batch_space

Flags = npt.NDArray[np.bool_]
I64 = npt.NDArray[np.int64]


@fields_as_keywords(TaskSpec)
class LoopVectorEnv(vector.VectorEnv[Any, Any, Any]):
    """Many LoopEnv in one process: the same arguments, spaces, rewards and, by seed, bytes.

    A faster gymnasium.vector.SyncVectorEnv of LoopEnv; see evs.Worlds.
    """

    metadata = METADATA | {"render_modes": []}

    def __init__(
        self,
        scene: Scene | TaskSpec,
        cameras: str | CameraConfig | Sequence[str | CameraConfig] = ("",),
        *,
        num_envs: int = 1,
        threads: int = 0,
        render_mode: str | None = None,
        render_camera: str | CameraConfig = "",
        autoreset_mode: str | vector.AutoresetMode = AutoresetMode.NEXT_STEP,
        copy: bool = True,
        **fields: Any,
    ) -> None:
        """Load the scene once, and make several worlds of it.

        Args:
            scene: See TaskSpec; or a TaskSpec.
            cameras: See TaskSpec.
            num_envs: Number of environments.
            threads: worlds at once; 0: one per core
            render_mode: None: the environments of gymnasium.make have pictures
            render_camera: not used
            autoreset_mode: when an environment begins a new episode: NextStep, SameStep or
                Disabled, as in gymnasium.vector
            copy: whether observations are copies; False: the next step overwrites them
            **fields: fields of TaskSpec

        Raises:
            EvsError: an argument is invalid
        """
        del render_camera
        if render_mode is not None:
            raise EvsError(
                f"render_mode is {render_mode!r}, but many worlds have no picture: leave it out, "
                'or take vectorization_mode="sync"'
            )
        self.num_envs = plain_integer(num_envs, "num_envs")
        self.render_mode, self._copy = None, bool(copy)
        self.autoreset_mode = _autoreset(autoreset_mode)
        spec = TaskSpec.of(scene, cameras, fields)
        self.ranges = spec.sensor_ranges()
        spec = spec.loaded()
        # the cameras' names and sizes are the worlds' own; the task wants them before
        probe = spec.make_worlds(1, threads=1)
        self.scene_ranges = spec.scene_ranges(probe.model, spec.visual)
        self._arrays = spec.make_arrays(spec.observation, probe.infos, num_envs, threads)
        by_name = dict(zip(probe.cameras, self._arrays, strict=True))
        self._task = task = Task(spec, probe.model, by_name, probe.infos[0].tick_us)
        self.worlds = spec.make_worlds(
            num_envs, threads=threads, sensors=task.sensors if task.measures else None
        )
        self._keyframe = spec.keyframe
        self.metadata = {
            **METADATA,
            **task.metadata,
            "render_modes": [],
            "autoreset_mode": self.autoreset_mode,
        }
        self.single_action_space = task.action_space
        self.single_observation_space = task.observation_space
        self.action_space = batch_space(task.action_space, num_envs)
        self.observation_space = batch_space(task.observation_space, num_envs)
        self._random: list[np.random.Generator | None] = [None] * num_envs
        self.drawn: list[DrawnSensor | None] = [None] * num_envs
        """the sensor of each environment's episode; None: it is not randomised"""
        self.drawn_scenes: list[DrawnScene | None] = [None] * num_envs
        """the values of its scene; None: it is not randomised"""
        self._began_us = np.zeros(num_envs, np.int64)
        self._over = np.ones(num_envs, np.bool_)
        """whose episode is over, or has not begun"""

    def reset(
        self,
        *,
        seed: int | list[int | None] | None = None,
        options: dict[str, Any] | None = None,
    ) -> tuple[Any, dict[str, Any]]:
        """Start episodes.

        Args:
            seed: Environment i has seed + i; or a seed for each; None: continue the random numbers.
            options: {"keyframe": name} as in LoopEnv; {"reset_mask": (n,) bool} selects the
                environments.

        Returns:
            The observations, and info as in LoopEnv, an array of each.

        Raises:
            EvsError: See `LoopEnv`; or the number of seeds is wrong. No environment has changed.
        """
        wanted = dict(options or {})
        mask = wanted.pop("reset_mask", None)
        keyframe = str(wanted.pop("keyframe", self._keyframe))
        if wanted:
            name = next(iter(wanted))
            raise EvsError(f"reset has no option '{name}'; there are: keyframe, reset_mask")
        chosen = np.ones(self.num_envs, np.bool_) if mask is None else np.asarray(mask)
        if chosen.dtype != np.bool_ or chosen.shape != (self.num_envs,) or not chosen.any():
            raise EvsError(
                f"reset_mask is {mask!r}: give ({self.num_envs},) booleans, one of them True"
            )
        if seed is None or isinstance(seed, int | np.integer):
            seeds = [None if seed is None else int(seed) + i for i in range(self.num_envs)]
        else:
            seeds = list(seed)
            if len(seeds) != self.num_envs:
                raise EvsError(f"{len(seeds)} seeds for {self.num_envs} environments: one for each")
        self._reset(np.flatnonzero(chosen).tolist(), seeds, keyframe)
        none = np.zeros(self.num_envs, np.int64)
        return self._observation(), self._info(chosen, none, self.worlds.t_us)

    def _reset(self, chosen: list[int], seeds: list[int | None], keyframe: str) -> None:
        with (
            unchanged_on_error(self),
            random_unchanged_on_error(*(self._random[number] for number in chosen)),
        ):
            self._reset_worlds(chosen, seeds, keyframe)
        self._began_us[chosen] = 0
        self._over[chosen] = False
        for arrays in self._arrays:
            arrays.reset(chosen)

    def _reset_worlds(self, chosen: list[int], seeds: list[int | None], keyframe: str) -> None:
        noises = []
        for number in chosen:
            random = self._random[number]
            if random is None or seeds[number] is not None:
                random, _ = seeding.np_random(seeds[number])
                self._random[number] = random
            noise = int(random.integers(2**31))
            noises.append(noise)
            self.drawn[number] = self.ranges.draw(noise) if self.ranges else None
            self.drawn_scenes[number] = self.scene_ranges.draw(noise) if self.scene_ranges else None

        def put(number: int, data: MjData) -> None:
            random = self._random[number]
            assert random is not None
            begin(self._task.start, random, data)

        sensors = [one.config for number in chosen if (one := self.drawn[number])]
        scenes = [drawn.values for number in chosen if (drawn := self.drawn_scenes[number])]
        self.worlds.reset(
            noises,
            chosen,
            keyframe=keyframe,
            sensor=sensors or None,
            scene=scenes or None,
            start=put,
            must_run=True,
        )

    def step(
        self, actions: Any
    ) -> tuple[Any, npt.NDArray[np.float64], Flags, Flags, dict[str, Any]]:
        """Act in every environment for `ticks` ticks, or fewer where an episode ends.

        Args:
            actions: (n, nu) numbers -1 ... 1.

        Returns:
            Observations, rewards, terminations, truncations, infos, as in gymnasium.vector.

        Raises:
            EvsError: The actions have another shape, or an episode is over with autoreset_mode
                Disabled.
        """
        control = self._task.control(actions)
        if control.shape != (self.num_envs, self.worlds.model.nu):
            raise EvsError(
                f"the actions have shape {control.shape}: give {self.num_envs} rows, one for each "
                "environment"
            )
        begins = self._over.copy()
        if begins.any() and self.autoreset_mode != AutoresetMode.NEXT_STEP:
            raise EvsError(
                f"the episode of environment {int(np.argmax(begins))} is over, or has not begun: "
                "call reset"
            )
        if begins.any():
            chosen = np.flatnonzero(begins).tolist()
            self._reset(chosen, [None] * self.num_envs, self._keyframe)
        begun_us = self.worlds.t_us
        ticks = np.array([self._task.ticks_left(int(one)) for one in begun_us], np.int64)
        ticks[begins] = 0
        counts = np.zeros(self.num_envs, np.int64)
        if ticks.any():
            seen = self.worlds.step(control, ticks)
            t_us = self.worlds.t_us
            # where an episode begins the interval would be empty
            begun_us = np.minimum(self._began_us, t_us - 1)
            for arrays, events in zip(self._arrays, seen, strict=True):
                arrays.encode(events, begun_us, t_us)
                counts += events.counts
        else:
            t_us = begun_us
        self._began_us = t_us
        terminated = np.zeros(self.num_envs, np.bool_)
        terminated[[*self.worlds.ended]] = True
        truncated = ~begins & ~terminated & (t_us >= self._task.max_us)
        rewards = self._rewards(control, terminated, begins)
        self._over = terminated | truncated
        everyone = np.ones(self.num_envs, np.bool_)
        info = self._info(everyone, counts, t_us)
        if self.autoreset_mode == AutoresetMode.SAME_STEP and self._over.any():
            info = self._begin_again(counts, info)
        return self._observation(), rewards, terminated, truncated, info

    def _begin_again(self, counts: I64, info: dict[str, Any]) -> dict[str, Any]:
        """Reset the environments whose episode is over; the info of this step then."""
        over = np.flatnonzero(self._over).tolist()
        last = self._observation(copy=False)
        finals = [(deepcopy(_row(last, i)), _row(info, i)) for i in over]
        self._reset(over, [None] * self.num_envs, self._keyframe)
        everyone = np.ones(self.num_envs, np.bool_)
        # the same keys, of the new episodes
        counts[over] = 0
        now = self._info(everyone, counts, self.worlds.t_us)
        found: dict[str, Any] = {}
        for i, (observation, final) in zip(over, finals, strict=True):
            found = self._add_info(found, {"final_obs": observation, "final_info": final}, i)
        return {**found, **now}

    def _rewards(
        self, control: npt.NDArray[np.float64], terminated: Flags, begins: Flags
    ) -> npt.NDArray[np.float64]:
        """(n,) of this step; 0 where an episode has just begun."""
        readings = self.worlds.readings if self._task.sensors else {}
        rewards = np.zeros(self.num_envs, np.float64)
        for i in np.flatnonzero(~begins).tolist():
            own = {name: values[i] for name, values in readings.items()}
            rewards[i] = self._task.worth(own, control[i], bool(terminated[i]))
        return rewards

    def _observation(self, copy: bool | None = None) -> Any:
        arrays = [one.array for one in self._arrays]
        measured = self._task.measures
        found = self._task.observation(
            arrays,
            self.worlds.position if measured else None,
            self.worlds.velocity if measured else None,
        )
        if not (self._copy if copy is None else copy):
            return found
        if isinstance(found, dict):
            return {name: array.copy() for name, array in found.items()}
        return found.copy()

    def _info(self, which: Flags, counts: I64, t_us: I64) -> dict[str, Any]:
        """As SyncVectorEnv puts the infos of these environments together."""
        done = np.full(self.num_envs, None, dtype=object)
        done[which] = ""
        for i, reason in self.worlds.ended.items():
            done[i] = reason
        values = {
            "t_us": np.where(which, t_us, 0),
            "events": np.where(which, counts, 0),
            "done": done,
        }
        info: dict[str, Any] = {}
        for name, array in values.items():
            info[name], info[f"_{name}"] = array, which.copy()
        for i in np.flatnonzero(which).tolist():
            if (sensor := self.drawn[i]) is not None:
                info = self._add_info(info, {"sensor": dict(sensor.values)}, i)
            if (scene := self.drawn_scenes[i]) is not None:
                info = self._add_info(info, {"scene": dict(scene.values)}, i)
        return info


def _row(values: Any, number: int) -> Any:
    """Those of one environment, in plain values."""
    if isinstance(values, dict):
        names = [name for name in values if not (name.startswith("_") and name[1:] in values)]
        return {name: _row(values[name], number) for name in names}
    one = values[number]
    return one.item() if isinstance(one, np.generic) else one


def _autoreset(mode: str | vector.AutoresetMode) -> vector.AutoresetMode:
    try:
        return AutoresetMode(mode)
    except ValueError:
        known = ", ".join(repr(one.value) for one in AutoresetMode)
        raise EvsError(f"autoreset_mode is {mode!r}; give one of {known}") from None
