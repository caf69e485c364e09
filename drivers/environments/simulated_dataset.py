"""SimulatedDataset: samples that are simulated when a data loader asks for them."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import fields
from multiprocessing import parent_process
from typing import Any

import numpy as np

from evs.drivers.environments.episode import EpisodeSpec
from evs.emulator import Worlds
from evs.emulator.base.scene import GroundTruth
from evs.emulator.config import CameraConfig, SceneConfig
from evs.emulator.config.decoding import plain_integer
from evs.emulator.config.keywords import fields_as_keywords
from evs.emulator.simulation.scene_ranges import begin, check_start
from evs.emulator.simulation.stacked_arrays import StackedArrays
from evs.emulator.world import ControlFunction, MjData, Scene
from evs.msgs import EvsError, unknown

Sample = dict[str, Any]

Place = tuple[int, int]
"""epoch, and index in it"""

IMAGES = ("luminance", *(one.name for one in fields(GroundTruth) if one.name != "t_us"))
"""ground truth of a camera"""

STATES = ("qpos", "qvel", "ctrl")
"""ground truth of a world"""

RESERVED = (*STATES, "sensors", "sensor", "scene", "attempt")
"""keys of a sample beside those of its cameras"""

SEED_TERM = 161
"""what these random numbers are for, beside the terms of sensor/randomisation.py"""

MOST = 2**63 - 1
"""samples, and epochs"""

_WORD = (1 << 64) - 1

_inherited: list[Any] = []
"""worlds that a parent process made before it forked: their threads do not exist here, so they are
never dropped"""


@fields_as_keywords(EpisodeSpec)
class SimulatedDataset:
    """Samples of events and ground truth, simulated on request; nothing is on disk.

        dataset = evs.SimulatedDataset("robot.xml", "wrist", samples=10_000, truth=["depth"])
        dataset[7]["events"]                        # (5, 260, 346) float32, a voxel grid
        DataLoader(dataset, batch_size=16, num_workers=2)

    It has a length and an index, so PyTorch's DataLoader accepts it directly. A worker simulates
    the samples of a batch in parallel (evs.Worlds). A sample depends only on the arguments, the
    epoch and its index: its bytes are the same in every process, order and batch. Samples are
    independent draws, so shuffling changes nothing.

    An index is a number in the epoch of `set_epoch`, or a pair (epoch, number) from `sampler`. A
    sample is a dict of arrays:

        events       (n,) EVENT_DTYPE, or an array as in StackedArrays
        luminance, depth, ...     what `truth` names, at the end
        qpos, qvel, ctrl          what `truth` names, at the end: float64
        sensors      name of a <sensor> -> its readings at the end, float64
        sensor       key of [sensor] -> the drawn value; with `randomise`
        scene        the same of the scene, KIND.NAME.ATTRIBUTE -> value
        attempt      number of repeated draws; with `attempts` over 1

    With several cameras, `events` and the images of each are a dict under its name. Use it in one
    thread at a time.
    """

    def __init__(
        self,
        scene: Scene | SceneConfig | EpisodeSpec,
        cameras: str | CameraConfig | Sequence[str | CameraConfig] = ("",),
        *,
        samples: int,
        seed: int = 0,
        representation: str | None = "voxel_grid",
        sequence: int | None = None,
        warm_up: int = 0,
        control: str | ControlFunction = "random",
        truth: Iterable[str] = (),
        sensors: Iterable[str] = (),
        attempts: int = 1,
        worlds: int = 16,
        threads: int = 0,
        **fields: Any,
    ) -> None:
        """Load the scene and check the arguments; the first sample creates the worlds.

        Args:
            scene: See EpisodeSpec; or an EpisodeSpec.
            cameras: See EpisodeSpec.
            samples: Samples per epoch.
            seed: Determines all samples.
            representation: event_frame | voxel_grid | time_surface | packet, as in StackedArrays;
                None: the events.
            sequence: Number of successive slices of `ticks` in a sample, as a first axis of all
                arrays that change; None: one slice, without that axis.
            warm_up: Ticks before the sample; their events are dropped.
            control: See `World`.
            truth: Names of ground truth: luminance, or a field of GroundTruth, of each camera; and
                qpos, qvel and ctrl.
            sensors: Names of <sensor>s of the model.
            attempts: Maximum number of draws of a sample whose world ends early.
            worlds: Maximum number of samples that are simulated in parallel.
            threads: Threads of this process; 0: one per core, but a single one in the worker of a
                loader.
            **fields: Fields of EpisodeSpec.

        Raises:
            EvsError: An argument is invalid.
        """
        self.seed, self.epoch = plain_integer(seed, "seed"), 0
        spec = EpisodeSpec.of(scene, cameras, fields)
        self._length = _at_least(1, samples, "samples", MOST)
        self._ticks = _at_least(1, spec.ticks, "ticks")
        self._warm_up = _at_least(0, warm_up, "warm_up")
        self._sequence = None if sequence is None else _at_least(1, sequence, "sequence")
        self._attempts = _at_least(1, attempts, "attempts")
        self._most = _at_least(1, worlds, "worlds")
        self.threads = _at_least(0, threads, "threads")
        self._truth = _names(truth, "truth")
        for name in self._truth:
            if name not in (*IMAGES, *STATES):
                raise unknown("truth", name, (*IMAGES, *STATES))
        self._sensors = _names(sensors, "sensors")
        self.ranges = spec.sensor_ranges()
        """what the sensor of each sample is drawn from; None: it stays the same"""
        if not spec.all_cameras:
            raise EvsError('there is no camera: name one, or give "" for the first')
        self._control, self._representation = control, representation
        self._worlds: Worlds | None = None
        self._arrays: list[StackedArrays] = []
        self._pid = 0
        self.spec = spec.loaded()
        """what its samples are episodes of"""
        trial = self._make(1, threads=1)
        self.scene_ranges = spec.scene_ranges(trial.model, trial.world(0).visual)
        """what its scene is drawn from; None: it stays the same"""
        self._start = check_start(trial.model, spec.start or {})
        trial.reset(keyframe=spec.keyframe)
        self.infos = trial.infos
        """what is constant of the cameras' streams"""
        self.cameras = trial.cameras
        """their names"""
        self._make_arrays(1, threads=1)
        if len(self.cameras) > 1 and (taken := [n for n in self.cameras if n in RESERVED]):
            raise EvsError(f"a camera is called '{taken[0]}', as a key of a sample: rename it")

    def __len__(self) -> int:
        """How many samples an epoch has."""
        return self._length

    @property
    def needs_gpu(self) -> bool:
        """Whether a render.device is cuda, so that making samples requires a GPU."""
        return self.spec.render is not None and self.spec.render.device == "cuda"

    def __repr__(self) -> str:
        return f"<evs.SimulatedDataset: {len(self)} of {', '.join(self.cameras)}>"

    def __getstate__(self) -> dict[str, Any]:
        """The arguments: another process makes worlds of its own."""
        return {**vars(self), "_worlds": None, "_arrays": []}

    def set_epoch(self, epoch: int) -> None:
        """Select the epoch of plain numbers as indices, in this process.

        Workers of a loader copy it when they start; persistent workers need `sampler`. Raises
        EvsError for an invalid number.
        """
        self.epoch = _at_least(0, epoch, "epoch", MOST)

    def sampler(self, *, rank: int = 0, num_replicas: int = 1) -> EpochSampler:
        """A sampler for a loader, which selects the epoch and can resume in the middle of one.

        Args:
            rank: Rank of this process in distributed training.
            num_replicas: Number of processes; each has the same number of samples.

        Raises:
            EvsError: There is no such rank, or there are more processes than samples.
        """
        return EpochSampler(len(self), rank=rank, num_replicas=num_replicas)

    def seed_of(self, index: int | Place, attempt: int = 0) -> int:
        """The seed of a sample's world; `start` draws from np.random.PCG64 with this seed.

        Args:
            index: See `dataset[index]`.
            attempt: Number of the draw.

        Raises:
            IndexError: There is no such sample.
        """
        epoch, number = self._place(index)
        key = (self.seed & _WORD) | SEED_TERM << 64
        counter = number << 64 | epoch << 128 | attempt << 192
        return int(np.random.Philox(key=key, counter=counter).random_raw()) >> 1

    def __getitem__(self, index: int | Place) -> Sample:
        """Simulate one sample; see `__getitems__`."""
        return self.__getitems__([index])[0]

    def __getitems__(self, indices: Iterable[int | Place]) -> list[Sample]:
        """Simulate a batch, side by side: what a loader calls.

        Args:
            indices: Numbers, or pairs (epoch, number).

        Returns:
            The samples, in this order. Their arrays belong to the caller.

        Raises:
            IndexError: There is no such sample.
            EvsError: A world ended, in each of `attempts` draws.
        """
        places = [self._place(one) for one in indices]
        found: list[Sample] = []
        try:
            for first in range(0, len(places), self._most):
                found += self._draw(places[first : first + self._most])
        except BaseException:
            # worlds that were left in the middle of a step are not used again
            self._worlds, self._arrays = None, []
            raise
        return found

    def _place(self, index: int | Place) -> Place:
        if isinstance(index, tuple | list):
            if len(index) != 2:
                raise EvsError(f"the index is {index!r}: give a number, or (epoch, number)")
            epoch = _at_least(0, index[0], "epoch", MOST)
            number = plain_integer(index[1], "index")
        else:
            epoch, number = self.epoch, plain_integer(index, "index")
        place = number + len(self) if number < 0 else number
        if not 0 <= place < len(self):
            raise IndexError(f"sample {number} of {len(self)}")
        return epoch, place

    def _make(self, count: int, threads: int) -> Worlds:
        sensors = self._sensors or None
        return self.spec.make_worlds(count, threads=threads, control=self._control, sensors=sensors)

    def _make_arrays(self, count: int, threads: int) -> list[StackedArrays]:
        if self._representation is None:
            return []
        return self.spec.make_arrays(self._representation, self.infos, count, threads)

    def _ready(self, count: int) -> Worlds:
        """Worlds of this process, this many or more."""
        here = os.getpid()
        if self._worlds is not None and self._pid != here:
            _inherited.append((self._worlds, self._arrays))
            self._worlds, self._arrays = None, []
        if self._worlds is None or len(self._worlds) < count:
            # the old ones go before
            self._worlds, self._arrays, self._pid = None, [], here
            threads = self.threads or (1 if parent_process() else 0)
            self._arrays = self._make_arrays(count, threads)
            self._worlds = self._make(count, threads)
        return self._worlds

    def _draw(self, places: Sequence[Place]) -> list[Sample]:
        """Samples that are simulated side by side."""
        worlds = self._ready(len(places))
        found: dict[int, Sample] = {}
        for attempt in range(self._attempts):
            left = {world: one for world, one in enumerate(places) if world not in found}
            found |= self._simulate(worlds, left, attempt)
            if len(found) == len(places):
                return [found[world] for world in range(len(places))]
        world = next(one for one in range(len(places)) if one not in found)
        epoch, number = places[world]
        mend = "narrow start and control" + (", or widen limits" if self.spec.limits else "")
        if self._attempts == 1:
            mend += ", or give attempts=10, and it is drawn again"
        when = f" in each of {self._attempts} attempts" if self._attempts > 1 else ""
        raise EvsError(
            f"the world of sample {number} of epoch {epoch} ended{when} ({worlds.ended[world]}): "
            f"{mend}"
        )

    def _simulate(
        self, worlds: Worlds, places: Mapping[int, Place], attempt: int
    ) -> dict[int, Sample]:
        """World -> its sample, where it did not end."""
        chosen = [*places]
        drawn = self._reset(worlds, places, attempt)
        ticks = np.zeros(len(worlds), np.int64)
        if self._warm_up:
            ticks[chosen] = self._warm_up
            worlds.step(ticks=ticks)
        for arrays in self._arrays:
            arrays.reset(chosen)
        ticks[chosen] = self._ticks
        slices: dict[int, list[Sample]] = {world: [] for world in chosen}
        for _ in range(self._sequence or 1):
            begin_us = worlds.t_us
            seen: Sequence[Any] = worlds.step(ticks=ticks)
            # an interval of worlds that stand still would be empty
            end_us = np.maximum(worlds.t_us, begin_us + 1)
            if self._arrays:
                both = zip(self._arrays, seen, strict=True)
                seen = [arrays.encode(one, begin_us, end_us).copy() for arrays, one in both]
            for world in chosen:
                if world not in worlds.ended:
                    slices[world].append(self._slice(worlds, world, seen))
        return {
            world: (_stacked(slices[world]) if self._sequence else slices[world][0]) | drawn[world]
            for world in chosen
            if world not in worlds.ended
        }

    def _reset(
        self, worlds: Worlds, places: Mapping[int, Place], attempt: int
    ) -> dict[int, Sample]:
        """Put worlds where their samples begin; what each sample has of its draw."""
        seeds = {world: self.seed_of(place, attempt) for world, place in places.items()}
        sensors = [self.ranges.draw(seed) for seed in seeds.values()] if self.ranges else []
        scenes = (
            [self.scene_ranges.draw(seed).values for seed in seeds.values()]
            if self.scene_ranges
            else []
        )

        def put(world: int, data: MjData) -> None:
            begin(self._start, np.random.Generator(np.random.PCG64(seeds[world])), data)

        worlds.reset(
            [*seeds.values()],
            [*seeds],
            keyframe=self.spec.keyframe,
            sensor=[one.config for one in sensors] or None,
            scene=scenes or None,
            start=put,
        )
        drawn: dict[int, Sample] = {world: {} for world in seeds}
        for sample, sensor in zip(drawn.values(), sensors, strict=False):
            sample["sensor"] = dict(sensor.values)
        for sample, scene in zip(drawn.values(), scenes, strict=False):
            sample["scene"] = dict(scene)
        if self._attempts > 1:
            for sample in drawn.values():
                sample["attempt"] = attempt
        return drawn

    def _slice(self, worlds: Worlds, number: int, seen: Sequence[Any]) -> Sample:
        """What a world gives at the end of a slice.

        Args:
            worlds: All of them.
            number: Of the world.
            seen: By camera and world, its events or their array.
        """
        # putting a world back costs more than a glance at its arrays
        world = worlds.world(number) if self._truth else None
        views = []
        for place, events in enumerate(seen):
            view = {"events": events[number]}
            truth = None
            for name in self._truth:
                if world is None or name not in IMAGES:
                    continue
                if name == "luminance":
                    view[name] = np.array(world.cameras[place].luminance)
                    continue
                truth = truth or world.cameras[place].ground_truth()
                view[name] = np.array(getattr(truth, name))
            views.append(view)
        sample: Sample = views[0]
        if len(views) > 1:
            sample = dict(zip(self.cameras, views, strict=True))
        if world is not None:
            states = [name for name in STATES if name in self._truth]
            sample |= {name: np.array(getattr(world.data, name)) for name in states}
        if self._sensors:
            sample["sensors"] = {name: row[number] for name, row in worlds.readings.items()}
        return sample


class EpochSampler:
    """The samples of an epoch, in order, for a loader's sampler=: pairs (epoch, number).

        order = dataset.sampler()
        loader = DataLoader(dataset, batch_size=16, sampler=order, num_workers=2)
        for epoch in range(10):
            order.set_epoch(epoch)
            for batch in loader: ...

    `set_epoch(epoch, done)` resumes that epoch after `done` samples.
    """

    def __init__(self, samples: int, *, rank: int = 0, num_replicas: int = 1) -> None:
        """See `SimulatedDataset.sampler`."""
        parts = _at_least(1, num_replicas, "num_replicas")
        if not 0 <= plain_integer(rank, "rank") < parts:
            raise EvsError(f"rank is {rank}: give 0 ... {parts - 1}, of {parts} num_replicas")
        if samples < parts:
            raise EvsError(f"{parts} num_replicas share {samples} samples: give more samples")
        self._share, self._rank, self._parts = samples // parts, rank, parts
        self.epoch, self.done = 0, 0

    def set_epoch(self, epoch: int, done: int = 0) -> None:
        """Choose the epoch of the next iteration.

        Args:
            epoch: 0 or more.
            done: Samples of it that this process has had before.

        Raises:
            EvsError: A number makes no sense.
        """
        epoch = _at_least(0, epoch, "epoch", MOST)
        if plain_integer(done, "done") > self._share:
            raise EvsError(f"done is {done}, but an epoch has {self._share} samples")
        self.epoch, self.done = epoch, _at_least(0, done, "done")

    def __len__(self) -> int:
        """How many samples are left in the epoch."""
        return self._share - self.done

    def __iter__(self) -> Iterator[Place]:
        """Those that are left."""
        epoch, first, last = self.epoch, self.done, self._share
        return ((epoch, self._rank + self._parts * one) for one in range(first, last))


def _stacked(slices: Sequence[Sample]) -> Sample:
    """Slices as one sample; events, whose numbers differ, as a list."""
    found: Sample = {}
    for name, first in slices[0].items():
        values = [one[name] for one in slices]
        if isinstance(first, dict):
            found[name] = _stacked(values)
        else:
            found[name] = values if first.dtype.names else np.stack(values)
    return found


def _names(given: Any, what: str) -> tuple[str, ...]:
    if isinstance(given, str) or not isinstance(given, Iterable):
        raise EvsError(f"{what} is {given!r}: give the names of several, such as ['depth']")
    return tuple(str(one) for one in given)


def _at_least(least: int, value: Any, name: str, most: int = 2**31 - 1) -> int:
    whole = plain_integer(value, name)
    if not least <= whole <= most:
        raise EvsError(f"{name} is {whole}: give {least} ... {most}")
    return whole
