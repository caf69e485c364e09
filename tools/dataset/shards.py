"""The two kinds of shard: events, each continuing the one before it, and frames."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from evs.drivers.files.npz.recorder import NpzRecorder
from evs.emulator import World
from evs.emulator.camera.camera import Camera
from evs.emulator.config import RunConfig
from evs.msgs import EventPacket, Pose, StreamInfo
from evs.tools.dataset.sequence_spec import SequenceSpec
from evs.tools.jobs import report_progress

EVENTS, POSE, STATE, FRAMES = "events.npz", "pose.npz", "state.bin", "frames.npz"
"""files of a shard"""


@dataclass(frozen=True, eq=False)
class EventShard:
    """The events, IMU samples and camera poses of the ticks begin + 1 ... end of a sequence."""

    sequence: SequenceSpec
    index: int
    begin: int
    end: int
    state: bytes | None = None
    """of the world at `begin`, as the previous shard left it; None: the sequence begins here"""

    @property
    def name(self) -> str:
        """Folder below the target."""
        return f"{self.sequence.name}/events/{self.index:04d}"

    @property
    def is_last(self) -> bool:
        """Whether the sequence ends with it."""
        return self.end == self.sequence.end

    def make(self, folder: Path) -> None:
        """Write events.npz, pose.npz and, unless it is the last, state.bin for the next one."""
        with self.sequence.with_model_file() as config:
            if self.state is None:
                world = self.sequence.world_at_begin(config)
            else:
                world = World.from_config(config)
                world.restore(self.state)
            recorder = NpzRecorder(folder / EVENTS)
            (camera,) = world.cameras
            recorder.open([self._stream(camera, config)])
            try:
                poses = self._film(world, camera, recorder)
            finally:
                recorder.close()
            _write_poses(folder / POSE, poses)
            if not self.is_last:
                (folder / STATE).write_bytes(world.save(compress=True))

    def _film(self, world: World, camera: Camera, recorder: NpzRecorder) -> list[Pose]:
        control = self.sequence.control(world)
        poses = []
        while world.tick < self.end:
            packets = world.step(control())
            if camera.imu_packet is not None:
                recorder.write_imu(camera.imu_packet)
            self._write(recorder, packets)
            if camera.pose is not None:
                poses.append(camera.pose)
            report_progress((world.tick - self.begin) / (self.end - self.begin))
        if self.is_last:
            self._write(recorder, world.finish())
        return poses

    def _write(self, recorder: NpzRecorder, packets: tuple[EventPacket, ...]) -> None:
        for packet in packets:
            recorder.write(packet)

    def _stream(self, camera: Camera, config: RunConfig) -> StreamInfo:
        config_json = dataclasses.asdict(self.sequence.recorded_config(config))
        # the sensor's table as the camera completed it
        config_json["sensor"] = camera.info.config["sensor"]
        config_json |= self.sequence.randomised
        return dataclasses.replace(camera.info, config=config_json)


@dataclass(frozen=True, eq=False)
class FrameShard:
    """The frames of a sequence in the ticks begin ... end - 1, at least one, with ground truth."""

    sequence: SequenceSpec
    index: int
    begin: int
    end: int

    @property
    def name(self) -> str:
        """Folder below the target."""
        return f"{self.sequence.name}/frames/{self.index:04d}"

    def make(self, folder: Path) -> None:
        """Write frames.npz."""
        ticks = [tick for tick in self.sequence.frame_ticks() if self.begin <= tick < self.end]
        with self.sequence.with_model_file() as config:
            # one tick before, so that the first frame has its flow
            world, view = self.sequence.view_at(config, max(0, ticks[0] - 1))
            control = self.sequence.control(world)
            found: list[Mapping[str, npt.NDArray[Any]]] = []
            for tick in ticks:
                while world.tick < tick:
                    world.step(control())
                light, rgb = view.render()
                truth = view.ground_truth()
                pose = view.pose
                found.append(
                    {
                        "t_us": np.array(view.t_us, np.int64),
                        "rgb": np.asarray(rgb).astype(np.float16),
                        "luminance": light,
                        "depth": truth.depth,
                        "normal": truth.normal.astype(np.float16),
                        "flow": truth.flow,
                        "geom_id": truth.geom_id,
                        "body_id": truth.body_id,
                        "position": np.array(pose.position),
                        "orientation": np.array(pose.orientation),
                    }
                )
                report_progress(len(found) / len(ticks))
        stacks = {name: np.stack([frame[name] for frame in found]) for name in found[0]}
        np.savez_compressed(folder / FRAMES, allow_pickle=False, **stacks)


Shard = EventShard | FrameShard


def _write_poses(path: Path, poses: list[Pose]) -> None:
    np.savez_compressed(
        path,
        t_us=np.array([pose.t_us for pose in poses], np.int64),
        position=np.array([pose.position for pose in poses], np.float64).reshape(-1, 3),
        orientation=np.array([pose.orientation for pose in poses], np.float64).reshape(-1, 4),
    )


def cut(sequence: SequenceSpec, shard_s: float) -> list[tuple[int, int]]:
    """(begin, end) of each range of a sequence, ticks; all but the last are `shard_s` long."""
    length = max(1, round(shard_s * 1e6 / sequence.tick_us))
    return [
        (tick, min(tick + length, sequence.end))
        for tick in range(sequence.begin, sequence.end, length)
    ]
