"""Train a network: steps, validations between them, the best network, and checkpoints."""

from __future__ import annotations

import contextlib
import copy
import dataclasses
import json
import math
import os
import zipfile
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from evs.drivers.clock import monotonic_s
from evs.emulator.base.small_files import open_file
from evs.emulator.evsnet import NetworkWeights
from evs.msgs import EvsError
from evs_lab.training.calibration import Calibration
from evs_lab.training.network import INITIAL, Parameters, to_weights
from evs_lab.training.recipes import Recipe
from evs_lab.training.step import Stepper, learning_rate
from evs_lab.training.training_examples import TrainingExamples, sample_held_out
from evs_lab.training.validation import Scores, Validation, overall


@dataclass
class Checkpoint:
    """State that the next step depends on, and the curves for the report."""

    parameters: Parameters
    optimiser: Any
    best: Parameters
    """of the lowest score so far"""
    calibration: Calibration
    step: int = 0
    """steps done"""
    elapsed_s: float = 0.0
    """time spent on them"""
    best_score: float = float("inf")
    best_step: int = 0
    curves: dict[str, list[Any]] = field(default_factory=dict)
    """name -> a value for each validation"""
    held_out: list[int] = field(default_factory=list)
    """numbers of the scenes that the scores were computed on"""
    of: dict[str, Any] = field(default_factory=dict)
    """recipe and seed; it can be continued with the same only"""

    def save(self, path: Path) -> None:
        """Write the file, completely or not at all.

        Raises:
            EvsError: the disk is full, or the file cannot be written.
        """
        leaves = jax.tree.leaves((self.parameters, self.optimiser, self.best))
        calibration = self.calibration
        stored = {
            "step": self.step,
            "elapsed_s": self.elapsed_s,
            "best_score": self.best_score,
            "best_step": self.best_step,
            "curves": self.curves,
            "held_out": self.held_out,
            "of": self.of,
        }
        arrays = {f"leaf{i}": np.asarray(leaf) for i, leaf in enumerate(leaves)}
        part = path.with_name(f".{path.name}.{os.getpid()}")
        try:
            with part.open("wb") as file:
                np.savez(
                    file,
                    allow_pickle=False,
                    **arrays,
                    predicted=calibration.predicted,
                    true=calibration.true,
                    integral=calibration.integral,
                    loss=calibration.loss,
                    told=np.array(json.dumps(stored)),
                )
            part.replace(path)
        except OSError as reason:
            raise EvsError(f"cannot write {path}: {reason.strerror}") from None
        finally:
            with contextlib.suppress(OSError):
                part.unlink()

    def load(self, path: Path) -> Checkpoint:
        """Load the checkpoint that was saved; this one, fresh, defines its structure.

        Raises:
            EvsError: no checkpoint, damaged, or one of another recipe or seed.
        """
        shape = jax.tree.structure((self.parameters, self.optimiser, self.best))
        mine = jax.tree.leaves((self.parameters, self.optimiser, self.best))
        try:
            with open_file(path) as file, np.load(file, allow_pickle=False) as archive:
                stored = json.loads(str(archive["told"][()]))
                leaves = [archive[f"leaf{i}"] for i in range(len(mine))]
                sums = [archive[name] for name in ("predicted", "true", "integral", "loss")]
        except (OSError, ValueError, KeyError, zipfile.BadZipFile, EOFError) as reason:
            raise EvsError(f"cannot read the checkpoint {path}: {reason}; delete it") from None
        if stored["of"] != self.of:
            differ = [key for key in self.of if stored["of"].get(key) != self.of[key]]
            raise EvsError(
                f"{path} is a training with another {', '.join(differ)}; give the same, "
                "another --checkpoint, or delete it"
            )
        parameters, optimiser, best = jax.tree.unflatten(shape, map(jnp.asarray, leaves))
        rest = {key: stored[key] for key in stored if key != "of"}
        return Checkpoint(parameters, optimiser, best, Calibration(*sums), of=self.of, **rest)


LINLOG_DN = math.e
VALIDATION_PIXELS = 1024
LATE, SLACK = 0.8, 1.05
"""In the last fifth, where the rate has fallen, a network counts as the best even if its score is
up to a twentieth worse: scores of so few pixels vary by that, and there are many early ones."""
REPORT_STEPS = 100
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
    """Ignore a report."""


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

    An existing checkpoint is continued. With the same data the result is the same as without the
    interruption, unless the time limit ended the training. With more scenes it continues with all
    of them.

    Args:
        folder: training data.
        recipe: the network and the settings of its training.
        checkpoint: file to continue, or to write.
        seed: of weights and order.
        minutes: time limit; None: no limit.
        name: of the network; None: the recipe's.
        validate_every: steps between validations.
        report: called with lines of progress.
        improved: called with each new best network.

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
        # scenes were added: score the best network on them
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
        if at.step % REPORT_STEPS == 0:
            mean = float(np.mean(recent[-REPORT_STEPS:]))
            each = 1e3 * (monotonic_s() - begun_s) / at.step
            report(f"step {at.step} of {recipe.steps}, loss {mean:.4f}, rate {rate:.2e}, "
                 f"{each:.0f} ms a step")  # fmt: skip


def _begin(recipe: Recipe, seed: int, stepper: Stepper, path: Path) -> Checkpoint:
    """The checkpoint to continue, or a fresh one."""
    start = INITIAL[recipe.initial](recipe.architecture, seed, recipe.tau_s)
    # as JSON gives it back
    of = json.loads(json.dumps({"recipe": dataclasses.asdict(recipe), "seed": seed}))
    for key in ("steps", "name"):
        # more steps of the same are no other training
        of["recipe"].pop(key)
    if recipe.architecture.events_per_tick == "one":
        # as before there was another
        of["recipe"]["architecture"].pop("events_per_tick")
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
