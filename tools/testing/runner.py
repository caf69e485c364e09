"""LoopRunner: the fixture evs_loop. It runs the episodes and returns a Run."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from evs.drivers.clock import monotonic_s
from evs.emulator import ClosedLoop
from evs.emulator.base.package_paths import in_package
from evs.emulator.config.decoding import plain_integer
from evs.emulator.simulation.scene_ranges import Start, begin, check_start
from evs.emulator.world import MjData, NamedSensors, Scene
from evs.msgs import EvsError, Observation
from evs.tools.testing.evidence import LoopOrigin, leave_behind, plain_options
from evs.tools.testing.pushes import Push, Pushes
from evs.tools.testing.run import Run, Trace

Decide = Callable[[Observation], npt.ArrayLike | None]
"""a controller: from an observation to (nu,) controls, or None to keep the last ones"""


class LoopRunner:
    """Runs controllers against scenes, and stores the episodes of failed claims."""

    def __init__(self, folder: Path) -> None:
        """Make a runner.

        Args:
            folder: folder for the episodes of failed claims.
        """
        self._folder, self._runs = folder, 0

    def __call__(
        self,
        scene: Scene | ClosedLoop,
        controller: Callable[[], Decide],
        *,
        seconds: float = 5.0,
        seeds: int | Iterable[int] = 1,
        ticks: int = 1,
        start: Start | None = None,
        keyframe: str = "",
        pushes: Sequence[Push] = (),
        sensors: Iterable[str] | None = None,
        **options: Any,
    ) -> Run:
        """Run the controller once for each seed, for `seconds` of simulated time, in lock-step.

        Args:
            scene: a file, `package:path`, MjModel or MjSpec; or a ClosedLoop, then without options.
            controller: makes a controller for each seed: a class, or `lambda: function`. The
                controller is called with each Observation, and returns controls.
            seconds: length of an episode, simulated time.
            seeds: of all noise and of the start; a number n is range(n).
            ticks: ticks of a decision.
            start: name of a joint -> range of its position at the start; or f(random, data).
            keyframe: keyframe to start from.
            pushes: forces from outside.
            sensors: names of the <sensor>s that claims can use; None: all that have a name.
            options: of evs.ClosedLoop: cameras, sensor, limits, delays, tick_us, ...

        Returns:
            The episodes, with assertions.

        Raises:
            EvsError: an argument is not possible; one line says which.
        """
        loop, origin = _loop_of(scene, options)
        ticks = plain_integer(ticks, "ticks")
        decisions = round(seconds * 1e6 / (loop.tick_us * ticks)) if ticks > 0 else 0
        if decisions < 1:
            raise EvsError(f"seconds={seconds}, ticks={ticks}: that is not one decision")
        named = NamedSensors(loop.world.model, sensors)
        begins = None if start is None else check_start(loop.world.model, start)
        forces = Pushes(loop, pushes)
        self._runs += 1
        folder = self._folder / f"evs_loop-{self._runs}"

        def keep(trace: Trace) -> tuple[str, ...]:
            return leave_behind(folder, loop, trace, ticks, pushes, origin)

        traces = []
        for seed in _seeds_of(seeds):
            decide = _made(controller)
            seen = loop.reset(seed, keyframe, start=_starter(begins, seed))
            episode = _Episode(loop, named, seed, seen)
            forces.begin()
            try:
                episode.run(decide, decisions, ticks)
            except Exception as reason:
                where = f"seed {seed}, t = {loop.t_us * 1e-6:.3f} s"
                reason.add_note("\n  ".join([f"evs_loop: {where}", *keep(episode.trace())]))
                raise
            finally:
                forces.end()
            traces.append(episode.trace())
        if not traces:
            raise EvsError("seeds is empty: give at least one")
        return Run(tuple(traces), decisions * ticks * loop.tick_us * 1e-6, keep)


class _Episode:
    """One episode while it runs."""

    def __init__(self, loop: ClosedLoop, named: NamedSensors, seed: int, seen: Observation) -> None:
        self._loop, self._named, self._seed, self._seen = loop, named, seed, seen
        self._start = loop.save()
        self._events = 0
        self._t_us: list[int] = []
        self._sensed: dict[str, list[npt.NDArray[np.float64]]] = {n: [] for n in named.names}
        self._ctrl: list[npt.NDArray[np.float64]] = []
        self._took_s: list[float] = []
        self._look()

    def run(self, decide: Decide, decisions: int, ticks: int) -> None:
        """Decide and step until the time or the episode is over."""
        for _ in range(decisions):
            if self._seen.done:
                return
            began_s = monotonic_s()
            ctrl = decide(self._seen)
            took_s = monotonic_s() - began_s
            # a copy: the controller may write to its own
            decided = None if ctrl is None else np.array(ctrl, np.float64)
            self._seen = self._loop.step(decided, ticks)
            self._ctrl.append(np.full(self._loop.nu, np.nan) if decided is None else decided)
            self._took_s.append(took_s)
            self._look()

    def _look(self) -> None:
        self._t_us.append(self._seen.t_us)
        for name, values in self._named.read(self._loop.world.data).items():
            self._sensed[name].append(values)
        self._events = sum(camera.events for camera in self._loop.world.cameras)

    def trace(self) -> Trace:
        """The record of the episode so far."""
        nu = self._loop.nu
        return Trace(
            seed=self._seed,
            t_us=np.array(self._t_us, np.int64),
            sensors={name: np.array(values) for name, values in self._sensed.items()},
            ctrl=np.array(self._ctrl, np.float64).reshape(len(self._ctrl), nu),
            compute_s=np.array(self._took_s, np.float64),
            events=self._events,
            done=self._seen.done,
            start=self._start,
        )


def _loop_of(scene: Scene | ClosedLoop, options: dict[str, Any]) -> tuple[ClosedLoop, LoopOrigin]:
    """The loop, and how it was made."""
    if isinstance(scene, ClosedLoop):
        if options:
            raise EvsError(f"{next(iter(options))}= belongs to the ClosedLoop: give it there")
        return scene, LoopOrigin()
    file = str(Path(in_package(str(scene))).absolute()) if isinstance(scene, str | Path) else ""
    try:
        return ClosedLoop(file or scene, **options), LoopOrigin(file, plain_options(options))
    except TypeError as reason:
        raise EvsError(f"evs_loop: {reason}; see help(evs.ClosedLoop)") from None


def _starter(start: Start | None, seed: int) -> Callable[[MjData], None] | None:
    """A function that sets the start of an episode; None: the loop sets it."""
    if start is None:
        return None
    return lambda data: begin(start, np.random.default_rng(seed % 2**64), data)


def _seeds_of(seeds: int | Iterable[int]) -> list[int]:
    several = range(seeds) if isinstance(seeds, int) else seeds
    return [plain_integer(seed, "seeds") for seed in several]


def _made(controller: Callable[[], Decide]) -> Decide:
    """Make the controller of one seed; EvsError if `controller` makes none."""
    if callable(controller):
        try:
            made = controller()
        except TypeError as reason:
            raise EvsError(
                f"the controller cannot be made: {reason}; give a class, or lambda: function"
            ) from reason
        if callable(made):
            return made
    raise EvsError(
        "the controller has to be something that makes a callable for each seed: "
        "a class with __call__(seen), or lambda: function"
    )
