"""TrainingExamples: turn shards of traced light into batches of X, V(0) and true event counts."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from evs.emulator.base.scene import F32, U8
from evs.emulator.evsnet.bilif import most_events
from evs.emulator.sensor import resolve_sensor
from evs.emulator.sensor.pixel import log_light
from evs.msgs import EvsError
from evs_lab.training.network import THRESHOLD
from evs_lab.training.recipes import GROUP, Recipe
from evs_lab.training.settings import Variant
from evs_lab.training.shards import Shard, Shards, read_shard
from evs_lab.training.targets import IDEAL

MOST_X = 20.0
"""|X| is clamped to it, as in every runtime"""
HELD_OUT = 8
"""scenes whose number this divides are for validation"""
MEMORY_BYTES = 4 * 2**30
"""of prepared shards; if there are more, they take turns"""
MOST_EVENTS = 100
"""Pixels with more true events are left out: they outweigh all others, and networks that learn
from them fire on the noise of still ones."""
MOST_EXTRA = 20
"""Pixels with more true events that share their tick with another are left out, too, for networks
that fire once per tick: these cannot follow them."""
ROUND_STEPS = 500
"""steps between turns"""

I32 = npt.NDArray[np.int32]


@dataclass(frozen=True, eq=False)
class Prepared:
    """A shard in the layout of training: pixels first, since batches draw pixels."""

    x: F32
    """(V, P, K), variants of the recipe"""
    start: F32
    """(P,) V of the true pixel after the recipe's warm_ticks, in thresholds"""
    counts: U8
    """(P, 2, K) true ON and OFF events"""
    live: tuple[I32, ...]
    """of each variant the pixels that may be drawn: with few enough events and, unless the network
    is biased, with an X that is not always zero"""
    true_x: F32 | None = None
    """(P, K) of the truth; None where the recipe does not scale noise"""


@dataclass(frozen=True, eq=False)
class Batch:
    """Input of one step: G groups of pixels."""

    x: F32
    """(G, n, K)"""
    start: F32
    """(G, n)"""
    counts: U8
    """(G, 2, K, n)"""
    variant: I32
    """(G,) of the recipe's variants"""


def differences(light: F32, linlog_dn: float) -> F32:
    """Equation 1: X (..., K) float32 of luminance (..., K), as in the runtimes; X[0] = 0."""
    sensor = dataclasses.replace(resolve_sensor(IDEAL), linlog_dn=linlog_dn)
    x = np.zeros(light.shape, np.float32)
    mapped = log_light(light, sensor)
    np.subtract(mapped[..., 1:], mapped[..., :-1], out=x[..., 1:])
    return np.clip(x, -MOST_X, MOST_X, out=x)


def prepare(shard: Shard, recipe: Recipe, linlog_dn: float) -> Prepared:
    """Prepare a shard for a recipe.

    Raises:
        EvsError: the shard lacks a variant of the recipe.
    """
    light = [shard.variant(one.spp, one.seeds).T for one in recipe.variants]
    x = differences(np.ascontiguousarray(np.stack(light)), linlog_dn)
    counts = shard.noisy_counts if recipe.noisy_truth else shard.counts
    slow = followable(counts, recipe.architecture.events_per_tick)
    # without biases constant light has no events and no gradient: there is nothing to learn
    biased = recipe.architecture.biased
    still = np.zeros(x.shape[:2], np.bool_) if biased else np.logical_not(x.any(axis=2))
    live = tuple(np.flatnonzero(slow & ~one).astype(np.int32) for one in still)
    start = true_membranes(shard, recipe.warm_ticks, linlog_dn)
    counted = np.ascontiguousarray(counts.transpose(2, 0, 1))
    if recipe.noise == (1.0, 1.0):
        return Prepared(x, start, counted, live)
    return Prepared(
        x, start, counted, live, differences(np.ascontiguousarray(shard.truth.T), linlog_dn)
    )


def louder(x: F32, true_x: F32, noise: tuple[float, float], rng: np.random.Generator) -> F32:
    """Scale the noise of X by a factor for each pixel.

    Args:
        x: (..., P, K) input with noise.
        true_x: (P, K) input without noise.
        noise: least and largest factor, between which factors are log-uniform.
        rng: random numbers.

    Returns:
        (..., P, K) X.
    """
    low, high = (math.log(times) for times in noise)
    factor = np.exp(rng.uniform(low, high, (len(true_x), 1))).astype(np.float32)
    found: F32 = np.clip(true_x + factor * (x - true_x), -MOST_X, MOST_X)
    return found


def true_membranes(shard: Shard, tick: int, linlog_dn: float) -> F32:
    """V of the ideal pixels that produced the counts before a tick, (P,), in thresholds."""
    if tick == 0:
        return shard.phase.copy()
    # X[0] is 0: the change of the log light, less what its events account for
    moved = differences(np.ascontiguousarray(shard.truth[:tick].T), linlog_dn)
    counted = shard.counts[0, :tick].sum(0, np.float64) - shard.counts[1, :tick].sum(0, np.float64)
    v = shard.phase + moved.sum(1, dtype=np.float64) / THRESHOLD - counted
    below = np.nextafter(np.float32(1), np.float32(0))
    standing: F32 = np.clip(v.astype(np.float32), -below, below)
    return standing


def followable(counts: U8, events_per_tick: str) -> npt.NDArray[np.bool_]:
    """Which pixels of (2, K, P) true events a network with such pixels can follow, (P,)."""
    ticks = counts.sum(0, dtype=np.int64)
    found: npt.NDArray[np.bool_] = ticks.sum(0) <= MOST_EVENTS
    if most_events(events_per_tick) == 1:
        found &= np.maximum(ticks - 1, 0).sum(0) <= MOST_EXTRA
    return found


class TrainingExamples:
    """The training scenes of a folder, and batches drawn from them.

    A batch depends only on recipe, seed, step and the scenes of the folder: a resumed training
    reads the same batches as an uninterrupted one.
    """

    def __init__(
        self,
        folder: str | Path,
        recipe: Recipe,
        seed: int,
        linlog_dn: float,
        memory_bytes: int = MEMORY_BYTES,
    ) -> None:
        """Open a folder of training data.

        Args:
            folder: of the data.
            recipe: of the training.
            seed: of the draws.
            linlog_dn: end of the linear part of the log map, DN.
            memory_bytes: for prepared shards.

        Raises:
            EvsError: no data, too few scenes, other ticks than the network's.
        """
        shards = Shards(folder)
        tick_us = shards.settings.tick_us
        if tick_us != recipe.architecture.tick_us:
            raise EvsError(f"the data in '{folder}' have ticks of {tick_us} us, "
                           f"the network has {recipe.architecture.tick_us} us")  # fmt: skip
        if shards.settings.ticks <= recipe.warm_ticks + recipe.architecture.latency_ticks:
            raise EvsError(f"the scenes in '{folder}' have {shards.settings.ticks} ticks, too few")
        self.recipe, self.seed, self.linlog_dn = recipe, seed, linlog_dn
        self.settings = shards.settings
        named = list(zip(shards.numbers, shards.paths, strict=True))
        self.training = [path for number, path in named if number % HELD_OUT]
        self.held_out = [path for number, path in named if number % HELD_OUT == 0]
        if not self.training or not self.held_out:
            raise EvsError(
                f"'{folder}' holds {len(named)} scenes; two are needed, one of them with a "
                f"number that {HELD_OUT} divides"
            )
        size = self.settings.pixels * self.settings.ticks
        self._most = max(
            1,
            memory_bytes
            // (size * (4 * (len(recipe.variants) + (recipe.noise != (1.0, 1.0))) + 2)),
        )
        self._loaded: dict[Path, Prepared] = {}
        shares = np.array(recipe.shares or [1.0] * len(recipe.variants))
        self._shares = shares / shares.sum()

    def batch(self, step: int) -> Batch:
        """The batch of a step, from 0 on; it does not depend on earlier calls.

        Raises:
            EvsError: a damaged shard.
        """
        scenes = self._turn(step // ROUND_STEPS)
        rng = np.random.default_rng([self.seed, 1, step])
        variant = rng.choice(len(self._shares), self.recipe.batch // GROUP, p=self._shares)
        groups = [self._group(scenes, one, rng) for one in variant.tolist()]
        x, start, counts = (np.stack(part) for part in zip(*groups, strict=True))
        return Batch(x, start, counts, variant.astype(np.int32))

    def _group(
        self, scenes: Sequence[Prepared], variant: int, rng: np.random.Generator
    ) -> tuple[F32, F32, U8]:
        """Draw pixels of any scene, each live one with the same probability."""
        ends = np.cumsum([len(scene.live[variant]) for scene in scenes])
        if not ends[-1]:
            one = self.recipe.variants[variant]
            raise EvsError(f"nothing moves in the training scenes at {one.spp} spp, {one.seeds}")
        x, true_x, start, counts = [], [], [], []
        for place in rng.integers(0, ends[-1], GROUP).tolist():
            which = int(np.searchsorted(ends, place, "right"))
            scene = scenes[which]
            pixel = scene.live[variant][place - ends[which]]
            x.append(scene.x[variant, pixel])
            if scene.true_x is not None:
                true_x.append(scene.true_x[pixel])
            start.append(scene.start[pixel])
            counts.append(scene.counts[pixel])
        seen = np.stack(x)
        if true_x:
            seen = louder(seen, np.stack(true_x), self.recipe.noise, rng)
        return seen, np.array(start, np.float32), np.stack(counts, -1)

    def _turn(self, turn: int) -> list[Prepared]:
        """The scenes of a turn: all, if they fit the memory, else the next ones."""
        count = len(self.training)
        chosen: list[Path] = []
        for place in range(turn * self._most, turn * self._most + min(self._most, count)):
            order = np.random.default_rng([self.seed, 2, place // count]).permutation(count)
            chosen.append(self.training[order[place % count]])
        if self._most >= count:
            chosen = self.training
        self._loaded = {path: held for path, held in self._loaded.items() if path in chosen}
        for path in chosen:
            if path not in self._loaded:
                self._loaded[path] = prepare(read_shard(path), self.recipe, self.linlog_dn)
        return [self._loaded[path] for path in chosen]


def sample_held_out(
    examples: TrainingExamples, variants: tuple[Variant, ...], pixels: int
) -> Prepared:
    """Draw pixels of the held-out scenes, spread over them; without those of too many events."""
    recipe = dataclasses.replace(examples.recipe, variants=variants, shares=())
    each = -(-pixels // len(examples.held_out))
    parts = []
    for place, path in enumerate(examples.held_out):
        scene = prepare(read_shard(path), recipe, examples.linlog_dn)
        rng = np.random.default_rng([examples.settings.seed, 3, place])
        rule = recipe.architecture.events_per_tick
        slow = np.flatnonzero(followable(scene.counts.transpose(1, 2, 0), rule))
        chosen = np.sort(rng.permutation(slow)[:each])
        seen = scene.x[:, chosen]
        if scene.true_x is not None:
            seen = louder(seen, scene.true_x[chosen], recipe.noise, rng)
        parts.append((seen, scene.start[chosen], scene.counts[chosen]))
    x, start, counts = (
        np.concatenate(part, axis)
        for part, axis in zip(zip(*parts, strict=True), (1, 0, 0), strict=True)
    )
    return Prepared(x, start, counts, ())
