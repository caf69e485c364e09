"""LoopEnv: a closed loop as a Gymnasium environment, its rewards and its pictures."""

from __future__ import annotations

from collections.abc import Sequence
from copy import deepcopy
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from evs.drivers.gym.library import gymnasium
from evs.drivers.gym.task import Task, TaskSpec, random_unchanged_on_error
from evs.drivers.pictures import upscale
from evs.emulator import ClosedLoop, View
from evs.emulator.base.rollback import unchanged_on_error
from evs.emulator.config import CameraConfig, SensorConfig
from evs.emulator.config.keywords import fields_as_keywords
from evs.emulator.config.schema import DelayConfig
from evs.emulator.sensor.randomisation import DrawnSensor
from evs.emulator.simulation.scene_ranges import DrawnScene, begin
from evs.emulator.simulation.worlds import WorldsEvents
from evs.emulator.world import NamedSensors, Scene
from evs.msgs import Events, EvsError, Observation, empty_events, join_events
from evs.msgs.pictures import U8, event_frame, exposure_for, to_srgb8

if TYPE_CHECKING:
    from evs.drivers.viewer.web.live import LivePage

SCENE_PX = (480, 360)
"""width, height of the scene in the picture, px"""

METADATA: dict[str, Any] = {"render_modes": ["human", "rgb_array"], "render_fps": 100.0}
"""of ten ticks a step; an environment has its own number"""


@fields_as_keywords(TaskSpec)
class LoopEnv(gymnasium.Env[Any, npt.NDArray[np.float32]]):
    """A closed loop with steps of `ticks` ticks; it observes events, and encoders on request.

    Terminated: a limit was exceeded or the physics became unstable; info["done"] has the reason.
    Truncated: max_s have passed. There are no events after a reset, whose light is the reference.
    """

    metadata = METADATA

    def __init__(
        self,
        scene: Scene | TaskSpec,
        cameras: str | CameraConfig | Sequence[str | CameraConfig] = ("",),
        *,
        delays: DelayConfig | None = None,
        threads: int = 1,
        render_mode: str | None = None,
        render_camera: str | CameraConfig = "",
        **fields: Any,
    ) -> None:
        """Load the scene and set up its cameras.

        Args:
            scene: See TaskSpec; or a TaskSpec.
            cameras: See TaskSpec.
            delays: delays between camera, agent and actuators, and lost packets, as in
                evs.ClosedLoop
            threads: threads of the renderer; several environments in parallel are fastest with one
                each
            render_mode: None, rgb_array, or human: a page in the browser shows every step, in real
                time (extra web)
            render_camera: the camera of `render`; "" is the model's first, or a free one
            **fields: fields of TaskSpec; info["sensor"] and info["scene"] have the values of
                `randomise`

        Raises:
            EvsError: an argument is invalid
        """
        spec = TaskSpec.of(scene, cameras, fields)
        # what a copy is made with
        self._arguments: dict[str, Any] = {
            "scene": spec,
            "delays": delays,
            "threads": threads,
            "render_mode": render_mode,
            "render_camera": render_camera,
        }
        modes = self.metadata["render_modes"]
        if render_mode is not None and render_mode not in modes:
            raise EvsError(f"render_mode is {render_mode!r}; give None, {' or '.join(modes)}")
        self.render_mode = render_mode
        self.ranges = spec.sensor_ranges()
        """what the sensor of each episode is drawn from; None: it stays the same"""
        self.loop = ClosedLoop(
            spec.scene,
            spec.all_cameras,
            tick_us=spec.tick_us,
            sensor=spec.sized_sensor,
            render=spec.render,
            model=spec.model,
            threads=threads,
            limits=spec.limits,
            delays=delays,
            visual=spec.visual,
        )
        world = self.loop.world
        self.scene_ranges = spec.scene_ranges(world.model, world.visual)
        """what the scene of each episode is drawn from; None: it stays the same"""
        self._keyframe = spec.keyframe
        names = [camera.name for camera in world.cameras]
        arrays = spec.make_arrays(spec.observation, self.loop.streams, 1, 1)
        self._arrays = dict(zip(names, arrays, strict=True))
        self._task = Task(spec, world.model, self._arrays, self.loop.tick_us)
        self.metadata = METADATA | self._task.metadata
        self._sensors = NamedSensors(world.model, self._task.sensors)
        self._scene = (
            world.add_view(
                render_camera,
                sensor=SensorConfig(preset="ideal", width=SCENE_PX[0], height=SCENE_PX[1]),
                rgb=True,
            )
            if render_mode == "rgb_array"
            else None
        )
        self._page: LivePage | None = None
        self.action_space = self._task.action_space
        self.observation_space = self._task.observation_space
        self.seen: Observation | None = None
        """the latest observation of the loop: packets with their exact times"""
        self.drawn: DrawnSensor | None = None
        """the sensor of this episode; None: it is not randomised, or there was no reset"""
        self.drawn_scene: DrawnScene | None = None
        """the values of its scene; None: as above"""
        self._events: dict[str, Events] = {}

    def __deepcopy__(self, memo: dict[int, Any]) -> LoopEnv:
        """A copy that continues from the present state with the same bytes."""
        kind = type(self)
        twin = memo[id(self)] = kind.__new__(kind)
        LoopEnv.__init__(twin, **self._arguments)
        if self.seen is not None:
            drawn = self.drawn.config if self.drawn else None
            twin.loop.reset(self.loop.world.seed, sensor=drawn)
            twin.loop.restore(self.loop.save())
            twin._began_us = self._began_us
        twin._np_random, twin._np_random_seed = (
            deepcopy(self._np_random, memo),
            self._np_random_seed,
        )
        for arrays, own in zip(twin._arrays.values(), self._arrays.values(), strict=True):
            arrays.go_on_from(own)
        twin.seen, twin.drawn, twin._events = self.seen, self.drawn, dict(self._events)
        twin.drawn_scene = self.drawn_scene
        return twin

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Start an episode.

        Args:
            seed: Determines the start, the sensor, the scene and all noise; None: continue the
                random numbers.
            options: {"keyframe": name} starts from another keyframe.

        Returns:
            The observation, and info with t_us, events (their number) and done; with randomise
            also sensor and scene: key -> value of this episode.

        Raises:
            EvsError: An option is unknown, the values of the scene are invalid, or a limit is
                exceeded at the start. Nothing has changed.
        """
        wanted = dict(options or {})
        keyframe = str(wanted.pop("keyframe", self._keyframe))
        if wanted:
            raise EvsError(f"reset has no option '{next(iter(wanted))}'; there is: keyframe")
        with unchanged_on_error(self), random_unchanged_on_error(self._np_random):
            super().reset(seed=seed)
            noise = int(self.np_random.integers(2**31))
            # the same seed as the noise: the start and later episodes do not depend on the ranges
            self.drawn = self.ranges.draw(noise) if self.ranges else None
            self.drawn_scene = self.scene_ranges.draw(noise) if self.scene_ranges else None
            self.seen = self.loop.reset(
                noise,
                keyframe,
                start=lambda data: begin(self._task.start, self.np_random, data),
                sensor=self.drawn.config if self.drawn else None,
                scene=self.drawn_scene.values if self.drawn_scene else None,
                must_run=True,
            )
        self._began_us = 0
        for arrays in self._arrays.values():
            arrays.reset()
        self._show(self.seen, begins=True)
        return self._observed(self.seen)

    def step(
        self, action: npt.NDArray[np.float32]
    ) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """Act for `ticks` ticks, or fewer if the episode ends.

        Args:
            action: (nu,) numbers -1 ... 1.

        Returns:
            Observation, reward, terminated, truncated, info as in `reset`.

        Raises:
            EvsError: The episode is over, or the action has another shape.
        """
        if self._out_of_time():
            raise EvsError("the episode is over (its time is): call reset")
        control = self._task.control(action)
        self.seen = self.loop.step(control, self._task.ticks_left(self.loop.t_us))
        self._show(self.seen)
        terminated = bool(self.seen.done)
        truncated = not terminated and self._out_of_time()
        readings = self._sensors.read(self.loop.world.data) if self._task.sensors else {}
        worth = self._task.worth(readings, control, terminated)
        observation, info = self._observed(self.seen)
        return observation, worth, terminated, truncated, info

    def close(self) -> None:
        """End the page of render_mode human. Safe to call twice."""
        if self._page is not None:
            self._page.close()
            self._page = None

    def _show(self, seen: Observation, *, begins: bool = False) -> None:
        if self.render_mode != "human":
            return
        if self._page is None:
            from evs.drivers.viewer.web.live import LivePage

            self._page, begins = LivePage(self.loop.world.cameras), True
        if begins:
            self._page.begin(seen.t_us)
        self._page.show(seen.packets, seen.t_us)

    def _out_of_time(self) -> bool:
        return self.loop.t_us >= self._task.max_us

    def _observed(self, seen: Observation) -> tuple[Any, dict[str, Any]]:
        """The observation of the agent, and its info."""
        self._events = {
            name: join_events([p.events for p in seen.packets if p.camera == name])
            for name in self._arrays
        }
        begin_us, self._began_us = self._began_us, seen.t_us
        # before the first tick the interval would be empty
        begin_us = min(begin_us, seen.t_us - 1)
        rows = []
        for name, arrays in self._arrays.items():
            events = self._events[name]
            one_world = WorldsEvents(events, np.array([0, len(events)], np.int64))
            rows.append(arrays.encode(one_world, begin_us, seen.t_us)[0].copy())
        count = sum(len(events) for events in self._events.values())
        info: dict[str, Any] = {"t_us": seen.t_us, "events": count, "done": seen.done}
        if self.drawn:
            info["sensor"] = dict(self.drawn.values)
        if self.drawn_scene:
            info["scene"] = dict(self.drawn_scene.values)
        return self._task.observation(rows, seen.position, seen.velocity), info

    def render(self) -> U8 | None:
        """(h, w, 3) uint8 sRGB: scene and events of the last step; None without rgb_array."""
        if self._scene is None:
            return None
        sizes = {c.name: (c.info.width, c.info.height) for c in self.loop.world.cameras}
        none = empty_events()
        return _draw(
            self._scene, [(self._events.get(name, none), *size) for name, size in sizes.items()]
        )


def _draw(scene: View, seen: Sequence[tuple[Events, int, int]]) -> U8:
    """Draw the scene and the events next to each other.

    Args:
        scene: A view of the scene in colour.
        seen: (events, width, height) of each camera.

    Returns:
        (h, w, 3) uint8 sRGB.
    """
    luminance, rgb = scene.render()
    left = to_srgb8(luminance if rgb is None else rgb, exposure_for(luminance))
    if left.ndim == 2:
        left = np.repeat(left[:, :, np.newaxis], 3, axis=2)
    panels = [_panel(event_frame(*one), left.shape[0]) for one in seen]
    return np.concatenate([left, *panels], axis=1)


def _panel(picture: U8, height_px: int) -> U8:
    """Enlarge a picture by an integer factor and centre it in a strip of this height."""
    factor = max(1, height_px // picture.shape[0])
    # skip rows and columns of a sensor that is taller than the strip
    step = -(-picture.shape[0] // height_px)
    enlarged = upscale(picture[::step, ::step], factor)
    strip = np.zeros((height_px, enlarged.shape[1], 3), np.uint8)
    top = (height_px - enlarged.shape[0]) // 2
    strip[top : top + enlarged.shape[0]] = enlarged
    return strip
