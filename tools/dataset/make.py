"""Make a data set: run the shards of all scenes as jobs, then join them. Describe one."""

from __future__ import annotations

import dataclasses
import json
import zlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from evs.drivers.files import messages, recorder_for, stream_of
from evs.drivers.pictures import write_png
from evs.emulator import World
from evs.emulator.base.small_files import open_file
from evs.emulator.config import decoding
from evs.emulator.world import digest_of, versions
from evs.msgs import EvsError, Frame, ImuPacket, TriggerPacket
from evs.tools.dataset.contact_sheet import scene_page, words_of
from evs.tools.dataset.manifest import KIND, MANIFEST, claim, listed, missing, read_json, write_json
from evs.tools.dataset.reader import RecordedSequence
from evs.tools.dataset.scenes import SceneFile
from evs.tools.dataset.sequence_spec import SequenceSpec, make_sequence_specs
from evs.tools.dataset.shards import EVENTS, STATE, EventShard, FrameShard, Shard, cut
from evs.tools.jobs import check_workers, run_jobs

SHARD_S = 1.0
"""simulated seconds of a shard, which is what a kill can lose"""
RECORDING, SHEET = "events.aedat4", "sheet.png"
"""files of a scene, beside its folders of shards"""


@dataclass(frozen=True)
class DatasetSummary:
    """What make_dataset did."""

    made: int
    """shards that are new"""
    kept: int
    """shards that were there"""
    whole: bool
    """whether the data set is complete, with its manifest"""
    lost: tuple[str, ...] = ()
    """one line for each worker that died over a shard, which was then made elsewhere"""


def make_dataset(
    folder: Path,
    scenes: Mapping[str, SceneFile],
    *,
    shard_s: float = SHARD_S,
    workers: int = 1,
    ray: str = "",
    moved: Callable[[float, str], None] = lambda _done, _told: None,
    stopped: Callable[[], bool] = lambda: False,
) -> DatasetSummary:
    """Make a data set of these scenes, or resume it; the bytes do not depend on the workers.

    Args:
        folder: target folder.
        scenes: name -> scene.
        shard_s: simulated seconds of a shard.
        workers: processes that make shards at once, as in run_jobs.
        ray: address of a Ray cluster, as in run_jobs.
        moved: called with the number of shards that are done and the name of one that runs.
        stopped: polled before each shard.

    Raises:
        EvsError: a shard failed. Finished shards stay, and the same call resumes.
    """
    check_workers(workers, ray)
    sequences = [
        sequence for name, scene in scenes.items() for sequence in make_sequence_specs(name, scene)
    ]
    described = describe_settings(sequences, scenes, shard_s)
    claim(folder, described)
    if missing(folder):
        # it says that the set is complete, and is written again once that is true
        (folder / MANIFEST).unlink()
    jobs = _jobs(sequences, shard_s)
    shares: dict[str, float] = {}

    def report(job: Shard, share: float) -> None:
        shares[job.name] = share
        moved(sum(shares.values()), job.name)

    ran = run_jobs(
        jobs,
        folder,
        workers=workers,
        ray=ray,
        threads=max((sequence.config.threads for sequence in sequences), default=0),
        on_done=lambda job, _: report(job, 1.0),
        on_share=report,
        stopped=stopped,
        then=lambda job: _next(folder, job, shard_s),
    )
    if ran.left or stopped():
        return DatasetSummary(ran.made, ran.kept, False, ran.lost)
    if not (folder / MANIFEST).exists():
        for sequence in sequences:
            moved(sum(shares.values()), f"{sequence.name}/{RECORDING}")
            _finish(folder / sequence.name)
        write_json(folder / MANIFEST, {**described, "files": listed(folder)})
    return DatasetSummary(ran.made, ran.kept, True, ran.lost)


def shard_count(scenes: Mapping[str, SceneFile], shard_s: float = SHARD_S) -> int:
    """The maximum number of shards of make_dataset."""
    count = 0
    for scene in scenes.values():
        length = max(1, round(shard_s * 1e6 / scene.scene.tick_us))
        ticks = max(1, round(scene.duration_s * 1e6 / scene.scene.tick_us))
        count += 2 * scene.episodes * -(-ticks // length)
    return count


def describe(folder: Path, scenes: Mapping[str, SceneFile]) -> Iterator[str]:
    """Describe the data set in a folder, or the planned one if the folder has none.

    Args:
        folder: of the data set.
        scenes: name -> scene, of the planned data set.

    Yields:
        Lines for a reader.
    """
    if (folder / MANIFEST).exists():
        yield from _describe_existing(folder)
        return
    seconds = frames = 0.0
    for name, scene in scenes.items():
        seconds += scene.episodes * scene.duration_s
        frames += scene.episodes * scene.duration_s * scene.frames.fps
        light = f"{scene.render.renderer}, {scene.render.samples} samples an event tick"
        yield (
            f"{name:10s}{scene.duration_s:6.1f} s  {scene.place or 'own':8s}"
            f"{light}, {scene.frames.spp} a frame: {scene.about or scene.scene.file}"
        )
        if scene.episodes > 1:
            yield f"{'':10s}{scene.episodes} episodes, each with a different seed"
        draws = zip(scene.draw(name), scene.draw_scenes(name), strict=True)
        for sequence, drawn in zip(scene.sequence_names(name), draws, strict=True):
            values = {key: value for one in drawn if one for key, value in one.values.items()}
            if values:
                yield f"  {sequence}: {words_of(values)}"
    yield (
        f"{'all':10s}{seconds:6.1f} s  {round(frames)} frames; what a second costs: "
        "docs/howto/datasets.md"
    )


def _describe_existing(folder: Path) -> Iterator[str]:
    manifest = read_json(folder / MANIFEST)
    for name, scene in manifest["scenes"].items():
        files = manifest["files"].items()
        own = {key: size["bytes"] for key, size in files if key.startswith(f"{name}/")}
        seconds = (scene["end_us"] - scene["begin_us"]) / 1e6
        yield (
            f"{name:10s}{seconds:6.1f} s  {scene['place'] or 'own':8s}{scene['frames']} frames, "
            f"{len(own)} files, {sum(own.values()) / 1e6:.1f} MB: {scene['about']}"
        )
        record = scene.get("randomised", {})
        if values := {**record.get("values", {}), **record.get("scene", {})}:
            yield f"  {name}: {words_of(values)}"
    yield "versions  " + ", ".join(f"{key} {value}" for key, value in manifest["versions"].items())


def describe_settings(
    sequences: Sequence[SequenceSpec], scenes: Mapping[str, SceneFile], shard_s: float
) -> dict[str, Any]:
    """All settings on which the bytes depend, and what their numbers mean, as plain values."""
    # the first sequence of each scene, and each whose scene has values of its own
    firsts = {_model_name(sequence): sequence for sequence in reversed(sequences)}
    models = {name: _describe_model(first) for name, first in firsts.items()}
    return {
        "kind": KIND,
        "versions": {**versions(), "zlib": zlib.ZLIB_RUNTIME_VERSION},
        "shard_s": shard_s,
        "scenes": {
            sequence.name: _describe_sequence(
                sequence, scenes[sequence.scene], models[_model_name(sequence)]
            )
            for sequence in sequences
        },
    }


def _model_name(sequence: SequenceSpec) -> str:
    return sequence.name if sequence.drawn_scene else sequence.scene


def _describe_model(sequence: SequenceSpec) -> dict[str, Any]:
    """What all sequences of a scene have in common that show the same values."""
    with sequence.with_model_file() as config:
        world = World.from_config(config)
    (camera,) = world.cameras
    model = world.model
    digest = digest_of(model)
    sequence.randomise(world)
    return {
        "model": digest,
        "camera_info": json.loads(json.dumps(camera.info.camera_info)),
        "geoms": [model.geom(place).name for place in range(model.ngeom)],
        "bodies": [model.body(place).name for place in range(model.nbody)],
        "body_of_geom": [int(body) for body in model.geom_bodyid],
    }


def _describe_sequence(
    sequence: SequenceSpec, scene: SceneFile, model: Mapping[str, Any]
) -> dict[str, Any]:
    config = sequence.recorded_config(sequence.config)
    used = dataclasses.replace(
        scene, scene=config.scene, sensor=config.sensor, seed=config.seed, threads=0
    )
    config_json = decoding.to_plain(used)
    if sequence.rows is not None:
        config_json["controls_crc32"] = zlib.crc32(sequence.rows.tobytes())
    return {
        "about": scene.about,
        "place": scene.place,
        "model": model["model"],
        "begin_us": sequence.begin * sequence.tick_us,
        "end_us": sequence.end * sequence.tick_us,
        "frames": len(sequence.frame_ticks()),
        **{key: model[key] for key in ("camera_info", "geoms", "bodies", "body_of_geom")},
        "config": config_json,
        **sequence.randomised,
    }


def _jobs(sequences: Sequence[SequenceSpec], shard_s: float) -> list[Shard]:
    """The shards that can run at once: the first events of every scene, and all frames."""
    first: list[Shard] = []
    frames: list[Shard] = []
    for sequence in sequences:
        ranges = cut(sequence, shard_s)
        first.append(EventShard(sequence, 0, *ranges[0]))
        ticks = sequence.frame_ticks()
        frames += [
            FrameShard(sequence, index, begin, end)
            for index, (begin, end) in enumerate(ranges)
            if any(begin <= tick < end for tick in ticks)
        ]
    return [*first, *frames]


def _next(folder: Path, job: Shard, shard_s: float) -> list[Shard]:
    """The shard of the events that follow these."""
    if not isinstance(job, EventShard) or job.is_last:
        return []
    index = job.index + 1
    begin, end = cut(job.sequence, shard_s)[index]
    path = folder / job.name / STATE
    following = EventShard(job.sequence, index, begin, end)
    if (folder / following.name).exists():
        # it exists, so the state with which it began is not needed
        return [following]
    try:
        with open_file(path) as file:
            state = file.read()
    except OSError as reason:
        raise EvsError(
            f"cannot read {path}: {reason.strerror}; remove {path.parents[1]} and give the command "
            "again"
        ) from None
    return [dataclasses.replace(following, state=state)]


def _finish(folder: Path) -> None:
    """Write one recording of all events of a scene and its contact sheet; remove the states."""
    shards = sorted((folder / "events").iterdir())
    part = folder / f".{RECORDING}"
    recorder = recorder_for(part, kind="aedat4")
    recorder.open([stream_of(shards[0] / EVENTS)])
    try:
        for shard in shards:
            for message in messages(shard / EVENTS):
                if isinstance(message, ImuPacket):
                    recorder.write_imu(message)
                elif isinstance(message, Frame):
                    recorder.write_frame(message)
                elif isinstance(message, TriggerPacket):
                    recorder.write_triggers(message)
                else:
                    recorder.write(message)
    finally:
        recorder.close()
    part.replace(folder / RECORDING)
    scene = RecordedSequence(folder)
    if scene.frame_count > 1:
        write_png(folder / SHEET, scene_page(scene))
    for shard in shards:
        (shard / STATE).unlink(missing_ok=True)
