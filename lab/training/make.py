"""make_shard: the shard of one scene; make_data: the shards of many scenes in a folder."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from evs.emulator.world import versions
from evs.msgs import EvsError
from evs.tools.jobs import check_workers, job_threads, report_progress, run_jobs
from evs_lab.training.pilot import Pilot, choose_pixels, run_pilot
from evs_lab.training.scenes import make_scene
from evs_lab.training.settings import WHITE_DN, DataSettings, Variant, claim_folder
from evs_lab.training.shards import Shard, read_meta, shard_name, write_shard
from evs_lab.training.targets import IDEAL, NOISY, draw_phases, event_counts
from evs_lab.training.traced_scene import Moved, TracedScene, simulate_scene

ATTEMPTS = 20
"""scenes that are tried for a number before it fails"""
STILL_SHARE = 0.15
"""share of the numbers whose scene may be nearly still; for others another scene is tried"""
MOST_SCENES = 100_000


@dataclass(frozen=True)
class TrainingDataSummary:
    """Result of make_data."""

    made: int
    """shards that are new"""
    kept: int
    """shards that existed"""


def make_shard(
    settings: DataSettings, number: int, threads: int = 1, moved: Moved = lambda _: None
) -> Shard:
    """The shard of scene `number`: the same bytes on any number of threads.

    Raises:
        EvsError: none of ATTEMPTS scenes is useful.
    """
    entropy = np.random.SeedSequence([settings.seed, 4, number])
    may_be_still = np.random.Generator(np.random.PCG64(entropy)).random() < STILL_SHARE
    why = ""
    for attempt in range(ATTEMPTS):

        def seed(place: int, attempt: int = attempt) -> int:
            entropy = [settings.seed, 3, number, attempt, place]
            return int(np.random.SeedSequence(entropy).generate_state(1, np.uint64)[0])

        scene = make_scene(settings.seed, number, attempt)
        try:
            traced = simulate_scene(scene, settings.ticks, settings.tick_us, threads)
        except EvsError as reason:
            # its physics diverges, or a mesh has no volume; the next one may be good
            why = str(reason)
            continue
        pilot = run_pilot(traced, seed(0))
        if not pilot.is_useful or (pilot.is_still and not may_be_still):
            why = "too dark, too bright, too fast, or nothing moves"
            continue
        rng = np.random.Generator(np.random.PCG64(seed(1)))
        pixels = choose_pixels(pilot, settings.pixels, rng)
        truth = traced.light(pixels, Variant(settings.truth_spp, "fixed"), seed(2), moved)
        light = [
            traced.light(pixels, variant, seed(4 + place), moved)
            for place, variant in enumerate(settings.variants)
        ]
        phase = draw_phases(rng, settings.pixels)
        drawn = settings.draw(number)
        noisy = drawn.config if drawn else NOISY
        meta = {
            "settings": settings.plain(),
            "scene": scene.meta,
            "digest": scene.digest,
            "versions": versions(),
            "seen": _seen(pilot, traced),
            **({"randomised": drawn.record} if drawn else {}),
        }
        return Shard(
            light=np.stack(light),
            truth=truth,
            phase=phase,
            counts=event_counts(truth, phase, IDEAL, tick_us=settings.tick_us),
            noisy_counts=event_counts(truth, phase, noisy, seed=seed(3), tick_us=settings.tick_us),
            pixels=pixels.astype(np.int16),
            variants=settings.variants,
            meta=meta,
        )
    raise EvsError(
        f"scene {number}: none of {ATTEMPTS} attempts is of any use (the last: {why}); take "
        "another seed"
    )


def work_of(settings: DataSettings) -> int:
    """Number of samples of a shard: the sum of what `moved` receives."""
    spp = settings.truth_spp + sum(variant.spp for variant in settings.variants)
    return spp * settings.pixels * settings.ticks


@dataclass(frozen=True)
class ShardJob:
    """The shard of a scene, as a job of the runner."""

    settings: DataSettings
    number: int

    @property
    def name(self) -> str:
        """Its file."""
        return shard_name(self.number)

    def make(self, folder: Path) -> None:
        """Write it. Raises EvsError as make_shard, OSError where the disk is full."""
        work, done = work_of(self.settings), 0

        def traced(samples: int) -> None:
            nonlocal done
            done += samples
            report_progress(done / work)

        shard = make_shard(self.settings, self.number, job_threads(), traced)
        write_shard(folder / self.name, shard)


def make_data(
    folder: Path,
    settings: DataSettings,
    numbers: range,
    threads: int,
    moved: Callable[[int, str], None],
    stopped: Callable[[], bool],
    *,
    workers: int = 1,
    ray: str = "",
) -> TrainingDataSummary:
    """Make the missing shards of these scenes: the same bytes on any machine.

    Args:
        folder: target folder.
        settings: of the data.
        numbers: of the scenes.
        threads: as run_jobs.
        moved: called with the finished scenes times `work_of`, and a label.
        stopped: polled before each scene.
        workers: as run_jobs.
        ray: as run_jobs.

    Raises:
        EvsError: the folder has other settings, the disk is full, or as run_jobs.
    """
    if not (0 <= numbers.start < numbers.stop <= MOST_SCENES):
        raise EvsError(
            f"scenes {numbers.start} ... {numbers.stop - 1}: give at least one, all of them "
            f"0 ... {MOST_SCENES - 1}"
        )
    check_workers(workers, ray)
    claim_folder(folder, settings)
    work = work_of(settings)
    done = 0
    shares: dict[int, float] = {}

    def on_share(job: ShardJob, share: float) -> None:
        shares[job.number] = share
        moved(int((done + sum(shares.values())) * work), f"scene {job.number}")

    def on_done(job: ShardJob, is_new: bool) -> None:
        nonlocal done
        if not is_new:
            _check(folder / job.name, settings)
        done += 1
        on_share(job, 0.0)

    ran = run_jobs(
        [ShardJob(settings, number) for number in numbers],
        folder,
        workers=workers,
        ray=ray,
        threads=threads,
        on_done=on_done,
        on_share=on_share,
        stopped=stopped,
    )
    return TrainingDataSummary(ran.made, ran.kept)


def _check(path: Path, settings: DataSettings) -> None:
    """Raises EvsError where an existing shard is damaged, or has other settings."""
    if read_meta(path).get("settings") != settings.plain():
        raise EvsError(f"{path} is of other settings than its folder; delete it and go on")


def _seen(pilot: Pilot, traced: TracedScene) -> dict[str, Any]:
    """Statistics of the pilot frames, for the meta data."""
    speed = pilot.speed[np.isfinite(pilot.speed)]
    shares = (1, 10, 50, 90, 99)

    def percentiles(values: Any) -> list[float]:
        found = np.percentile(values, shares) if values.size else np.zeros(len(shares))
        return [float(f"{value:.4g}") for value in found]

    return {
        "percentiles": list(shares),
        "dn": percentiles(pilot.light_dn),
        "white_dn": WHITE_DN,
        "speeds_px_s": percentiles(speed),
        "changing": float(f"{np.mean(pilot.score > 0):.4g}"),
        "geoms": len(traced.scene.geom_type),
        "lights": len(traced.scene.lights),
    }
