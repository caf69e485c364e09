"""Train a network without one of its parts, and score it on the held-out scenes."""

from __future__ import annotations

import dataclasses
import tempfile
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from unittest.mock import patch

import jax.numpy as jnp
import numpy as np
from jax import Array, lax

from evs.emulator.base.scene import F32, U8
from evs_lab.training import network, training_examples
from evs_lab.training.losses import Terms
from evs_lab.training.recipes import OURS, RECIPES, Recipe
from evs_lab.training.shards import Shard, read_shard
from evs_lab.training.targets import NOISY, event_counts
from evs_lab.training.training_examples import TrainingExamples, followable, prepare
from evs_lab.training.training_loop import LINLOG_DN, fit
from evs_lab.training.validation import Scores, compared, plain_events, predict

SPP = 4
PAPER = "our retrained version of the paper's network"


@dataclass(frozen=True)
class Ablation:
    """A training that differs from that of `evsnet_c8` on 4 fresh samples."""

    name: str
    keys: dict[str, Any] = field(default_factory=dict)
    """of Recipe, in place of its own"""
    architecture: dict[str, Any] = field(default_factory=dict)
    spp: int = SPP
    base: str = "evsnet_c8"
    patched: tuple[str, ...] = ()
    """names of PATCHES"""
    seeds: tuple[int, ...] = (1,)

    def recipe(self, steps: int) -> Recipe:
        """Return the recipe of a training of so many steps."""
        recipe = RECIPES[self.base].of_spp(self.spp)
        architecture = dataclasses.replace(recipe.architecture, **self.architecture)
        return dataclasses.replace(recipe, architecture=architecture, steps=steps, **self.keys)


def without(**terms: Any) -> dict[str, Any]:
    return {"terms": dataclasses.replace(OURS, **terms)}


ABLATIONS = (
    Ablation("`evsnet_c8`", seeds=(1, 2, 3)),
    Ablation("EMD alone", {"terms": Terms(count=0.0), "balanced": False}),
    Ablation("EMD and count, the paper's loss", {"terms": Terms(), "balanced": False}),
    Ablation("without calibrated counts", without(calibration=0.0)),
    Ablation("without edge weighting", without(edge=0.0)),
    Ablation("without silence", without(silence=0.0)),
    Ablation("noise not scaled", {"noise": (1.0, 1.0)}),
    Ablation("two LIF units in place of one BiLIF", patched=("lif",)),
    Ablation("membranes start at zero", patched=("zero",)),
    Ablation("many events per tick", architecture={"events_per_tick": "many"}),
    Ablation("C = 4", architecture={"channels": 4}),
    Ablation("C = 16", architecture={"channels": 16}),
    Ablation(PAPER, base="paper"),
    Ablation("`evsnet_c8`", spp=1),
    Ablation("`evsnet_c8`", spp=16),
    Ablation("`evsnet_c8`", spp=64),
)


def lif(current: Array, start: Array, decay: Array, most: int = 1) -> tuple[Array, Array]:
    """ON spikes of a conventional LIF unit of the positive currents, OFF of the negative ones."""

    def spikes(current: Array, start: Array) -> Array:
        def tick(v: Array, current: Array) -> tuple[Array, Array]:
            charged = jnp.clip(decay * v + current, 0, network.MOST_V)
            fired = network.spikes_of(charged, most)
            return charged - fired, fired

        found: Array = lax.scan(tick, start / decay, current)[1]
        return found

    return (
        spikes(jnp.maximum(current, 0), jnp.maximum(start, 0)),
        spikes(jnp.maximum(-current, 0), jnp.maximum(-start, 0)),
    )


def zero(shard: Shard, tick: int, linlog_dn: float) -> F32:
    """Membranes at zero, in place of those of the true pixels."""
    del tick, linlog_dn
    return np.zeros_like(shard.phase)


PATCHES: dict[str, tuple[object, str, Callable[..., object]]] = {
    "lif": (network, "bilif", lif),
    "zero": (training_examples, "true_membranes", zero),
}


@dataclass(frozen=True)
class Outcome:
    """Scores on the pixels that a network with one event per tick can follow, and on the rest."""

    slow: Scores
    fast: Scores


def ablated(folder: str, ablation: Ablation, steps: int, seed: int) -> Outcome:
    """Train a network on a folder of data and score the last one on the held-out scenes."""
    with ExitStack() as patches, tempfile.TemporaryDirectory() as scratch:
        for name in ablation.patched:
            patches.enter_context(patch.object(*PATCHES[name]))
        recipe = ablation.recipe(steps)
        fitted = fit(Path(folder), recipe, Path(scratch, "c.npz"), seed=seed, validate_every=steps)
        weights = fitted.checkpoint.parameters
        first = recipe.warm_ticks + recipe.architecture.latency_ticks

        def events(x: F32, start: F32) -> U8:
            return predict(weights, recipe.architecture, x, start, first)

        return outcome(folder, ablation, events)


def simplest(folder: str, spp: int) -> dict[str, Outcome]:
    """Scores of the ideal pixel and of silence on light of so many fresh samples."""
    ablation = Ablation("", spp=spp)
    warm = ablation.recipe(1).warm_ticks
    return {
        "silence": outcome(
            folder, ablation, lambda x, _: np.zeros((len(x), 2, x.shape[1] - warm), np.uint8)
        ),
        "`plain`": outcome(folder, ablation, lambda x, start: plain_events(x[:, warm:], start)),
    }


def outcome(folder: str, ablation: Ablation, events: Callable[[F32, F32], U8]) -> Outcome:
    """Score events (P, 2, K) of (P, K) X and (P,) membranes after the warm ticks."""
    # as it was traced
    recipe = dataclasses.replace(ablation.recipe(1), noise=(1.0, 1.0))
    scenes = [
        prepare(read_shard(path), recipe, LINLOG_DN)
        for path in TrainingExamples(folder, recipe, 1, LINLOG_DN).held_out
    ]
    x = np.concatenate([scene.x[0] for scene in scenes])
    found = events(x, np.concatenate([scene.start for scene in scenes]))
    counts = np.concatenate([scene.counts for scene in scenes])
    # look-ahead leaves the last ticks without an output
    true = counts[:, :, recipe.warm_ticks :][:, :, : found.shape[2]]
    slow = followable(counts.transpose(1, 2, 0), "one")
    tick_us = recipe.architecture.tick_us
    return Outcome(*(compared(found[part], true[part], tick_us) for part in (slow, ~slow)))


@dataclass(frozen=True)
class NoisyOutcome:
    """Against events of pixels with a real sensor's noise, on pixels with up to 100 of them."""

    rate_hz: float
    """events of pixels in which converged light causes none"""
    emd: float
    recall: float


def noisy_rows(folder: str, steps: int, seed: int) -> dict[str, NoisyOutcome]:
    """Two ways to the noise of a sensor: learn it, or put it behind a network without any.

    The noise behind the network is that of pixels whose light stands still.
    """
    base = Ablation("", {"noise": (1.0, 1.0)}).recipe(steps)
    warm = base.warm_ticks
    with tempfile.TemporaryDirectory() as scratch:
        ideal, noisy = (
            fit(
                Path(folder),
                dataclasses.replace(Ablation("").recipe(steps), noisy_truth=is_noisy),
                Path(scratch, f"{is_noisy}.npz"),
                seed=seed,
                validate_every=steps,
            ).checkpoint.parameters
            for is_noisy in (False, True)
        )
    shards = [read_shard(path) for path in TrainingExamples(folder, base, 1, LINLOG_DN).held_out]
    scenes = [prepare(shard, base, LINLOG_DN) for shard in shards]
    x = np.concatenate([scene.x[0] for scene in scenes])
    start = np.concatenate([scene.start for scene in scenes])

    def pixels_first(counts: list[U8]) -> U8:
        return np.concatenate([c.transpose(2, 0, 1) for c in counts])[:, :, warm:]

    def again(light: Callable[[Shard], F32]) -> U8:
        """Events of noisy pixels with noise of their own."""
        return pixels_first(
            [
                event_counts(light(shard), shard.phase, NOISY, seed=1000 + i)
                for i, shard in enumerate(shards)
            ]
        )

    true = pixels_first([shard.noisy_counts for shard in shards])
    clean = pixels_first([shard.counts for shard in shards])
    first = warm + base.architecture.latency_ticks
    without = predict(ideal, base.architecture, x, start, first)
    still_light = again(lambda shard: np.repeat(shard.truth[:1], len(shard.truth), 0))
    found = {
        "silence": np.zeros_like(true),
        "the same pixels, other noise": again(lambda shard: shard.truth),
        "trained on ideal pixels": without,
        "trained on noisy pixels": predict(noisy, base.architecture, x, start, first),
        "trained on ideal pixels, noise behind it": without + still_light,
    }
    slow = true.sum((1, 2), dtype=np.int64) <= training_examples.MOST_EVENTS
    still = slow & (clean.sum((1, 2), dtype=np.int64) == 0)
    seconds = 1e-6 * base.architecture.tick_us * true.shape[2] * still.sum()
    outcomes = {}
    for name, events in {"the noisy pixels": true, **found}.items():
        score = compared(events[slow], true[slow], base.architecture.tick_us)
        rate_hz = float(events[still].sum(dtype=np.int64)) / seconds
        outcomes[name] = NoisyOutcome(rate_hz, score.emd, score.recall)
    return outcomes
