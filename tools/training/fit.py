"""Train a network: steps, validations between them, and the best network."""

from __future__ import annotations

import copy
import dataclasses
import json
import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import jax
import numpy as np

from evs.drivers.clock import monotonic_s
from evs.emulator.evsnet import NetworkWeights
from evs.msgs import EvsError
from evs.tools.training.calibration import Calibration
from evs.tools.training.checkpoint import Checkpoint
from evs.tools.training.initial import INITIAL
from evs.tools.training.network import to_weights
from evs.tools.training.recipes import Recipe
from evs.tools.training.step import Stepper, learning_rate
from evs.tools.training.training_examples import TrainingExamples, sample_held_out
from evs.tools.training.validation import Scores, Validation, overall

LINLOG_DN = math.e
VALIDATION_PIXELS = 1024
LATE, SLACK = 0.8, 1.05
"""In the last fifth, where the rate has fallen, a network is the best one although its score is up
to a twentieth worse: scores of so few pixels wobble by that, and early ones are many."""
TELL_STEPS = 100
"""steps between lines of progress"""


@dataclass(frozen=True)
class TrainedNetwork:
    """The best network so far, and how it came about."""

    weights: NetworkWeights
    score: float
    """of the best; lower is better"""
    scores: list[Scores]
    """of the best, each of the recipe's variants"""
    plain: list[Scores]
    """of an ideal pixel on the same light"""
    silence: Scores
    """of no events at all"""
    checkpoint: Checkpoint
    examples: TrainingExamples
    recipe: Recipe
    seed: int


def _report_nothing(_: object) -> None:
    """Whoever calls `fit` does not want to know."""


def fit(
    folder: Path,
    recipe: Recipe,
    checkpoint: Path,
    *,
    seed: int = 1,
    minutes: float | None = None,
    name: str | None = None,
    validate_every: int = 500,
    report: Callable[[str], None] = _report_nothing,
    improved: Callable[[TrainedNetwork], None] = _report_nothing,
) -> TrainedNetwork:
    """Train until recipe.steps are done or the time is over, whichever comes first.

    A checkpoint that is there is continued: with the same data the end is the same as without the
    interruption, unless the time limit set it. With more scenes it goes on with all of them.
    `improved` gets each new best network.

    Raises:
        EvsError: no data, a checkpoint of something else, a loss that is NaN.
    """
    if minutes is not None and not minutes > 0:
        raise EvsError(f"minutes is {minutes}; give a number over 0")
    examples = TrainingExamples(folder, recipe, seed, LINLOG_DN)
    held_out = sample_held_out(examples, recipe.variants, VALIDATION_PIXELS)
    validation = Validation(held_out, recipe.architecture, recipe.warm_ticks)
    stepper = Stepper(recipe)
    at = _begin(recipe, seed, stepper, checkpoint)
    numbers = [int(path.stem) for path in examples.held_out]
    if at.step and at.held_out != numbers:
        # scenes were added: what was best is so on them
        at.best_score = overall(validation.scores(at.best))
    at.held_out = numbers
    limit_s = math.inf if minutes is None else 60.0 * minutes
    report(_opening(examples, recipe, at))
    begun_s = monotonic_s() - at.elapsed_s

    def fitted() -> TrainedNetwork:
        weights = to_weights(at.best, recipe.architecture, name or recipe.name, recipe.spp)
        best = validation.scores(at.best)
        return TrainedNetwork(weights, at.best_score, best, validation.plain, validation.silence,
                      copy.deepcopy(at), examples, recipe, seed)  # fmt: skip

    recent: list[float] = []
    while True:
        at.elapsed_s = monotonic_s() - begun_s
        ended = at.step >= recipe.steps or at.elapsed_s >= limit_s
        due = at.step % validate_every == 0 or ended
        if due and at.step not in at.curves["step"]:
            progress = max(at.step / recipe.steps, at.elapsed_s / limit_s)
            better = _validate(at, validation, recent, progress >= LATE, report)
            at.save(checkpoint)
            recent = []
            if better:
                improved(fitted())
        if ended:
            return fitted()
        progress = max(at.step / recipe.steps, at.elapsed_s / limit_s)
        rate = learning_rate(recipe, progress)
        recent.append(_advance(at, stepper, examples, rate))
        if at.step % TELL_STEPS == 0:
            mean = float(np.mean(recent[-TELL_STEPS:]))
            each = 1e3 * (monotonic_s() - begun_s) / at.step
            report(f"step {at.step} of {recipe.steps}, loss {mean:.4f}, rate {rate:.2e}, "
                 f"{each:.0f} ms a step")  # fmt: skip


def _begin(recipe: Recipe, seed: int, stepper: Stepper, path: Path) -> Checkpoint:
    """Where it goes on."""
    start = INITIAL[recipe.initial](recipe.architecture, seed, recipe.tau_s)
    # as JSON gives it back
    of = json.loads(json.dumps({"recipe": dataclasses.asdict(recipe), "seed": seed}))
    for key in ("steps", "name"):
        # more steps of the same are no other training
        of["recipe"].pop(key)
    fresh = Checkpoint(
        parameters=start,
        optimiser=stepper.start(start),
        best=start,
        calibration=Calibration.start(len(recipe.variants)),
        curves={key: [] for key in ("step", "loss", "score", "tau_s", "scores")},
        of=of,
    )
    return fresh.load(path) if path.exists() else fresh


def _advance(at: Checkpoint, stepper: Stepper, examples: TrainingExamples, rate: float) -> float:
    """One step; the loss before it."""
    batch = examples.batch(at.step)
    price = at.calibration.prices()[batch.variant]
    weight = at.calibration.weights()[batch.variant]
    if not examples.recipe.balanced:
        weight = np.ones_like(weight)
    outcome = stepper(at.parameters, at.optimiser, batch, price, weight, rate)
    losses = np.asarray(outcome.loss, np.float64)
    loss = float(losses.mean())
    if not math.isfinite(loss):
        raise EvsError(f"the loss is {loss} after {at.step} steps; lower the learning rate")
    at.parameters, at.optimiser = outcome.parameters, outcome.optimiser
    at.calibration.update(
        batch.variant,
        losses,
        np.asarray(outcome.predicted, np.float64),
        np.asarray(outcome.true, np.float64),
        examples.recipe.terms.calibration,
    )
    at.step += 1
    return loss


def _validate(
    at: Checkpoint,
    validation: Validation,
    recent: list[float],
    late: bool,
    report: Callable[[str], None],
) -> bool:
    """Put a validation into the curves; whether it is the best."""
    scores = validation.scores(at.parameters)
    score = overall(scores)
    tau_s = float(np.exp(at.parameters["log_tau"]))
    at.curves["step"].append(at.step)
    at.curves["loss"].append(float(np.mean(recent)) if recent else None)
    at.curves["score"].append(score)
    at.curves["tau_s"].append(tau_s)
    at.curves["scores"].append([one.plain() for one in scores])
    lowest = min([at.best_score, *at.curves["score"]])
    better = score < SLACK * lowest if late else score < at.best_score
    if better:
        at.best, at.best_score, at.best_step = at.parameters, score, at.step
    emds = " ".join(
        f"{one.emd:.3f}/{plain.emd:.3f}"
        for one, plain in zip(scores, validation.plain, strict=True)
    )
    counts = " ".join(f"{one.on:.2f},{one.off:.2f}" for one in scores)
    report(f"step {at.step}, score {score:.4f}{' (best)' if better else ''}, tau {tau_s:.2f} s; "
         f"EMD, of plain: {emds}; counts ON, OFF: {counts}")  # fmt: skip
    return better


def _opening(examples: TrainingExamples, recipe: Recipe, at: Checkpoint) -> str:
    device = jax.devices()[0]
    begun = f"going on from step {at.step}" if at.step else "from the start"
    return (
        f"{recipe.name}: {len(examples.training)} scenes to train on, "
        f"{len(examples.held_out)} held out, {begun}, on {device.platform}"
    )
