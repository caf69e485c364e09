"""One step of training: the gradient of a batch, clipped, and AdamW."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
import optax
from jax import Array, lax

from evs.emulator.base.scene import F32
from evs_lab.training.losses import edge_weight, objective
from evs_lab.training.network import Parameters, stream
from evs_lab.training.recipes import Recipe
from evs_lab.training.training_examples import Batch


@dataclass(frozen=True)
class StepResult:
    """Result of one step."""

    parameters: Parameters
    optimiser: Any
    """state of optax"""
    loss: Array
    """(G,) mean over each group's pixels, not weighted"""
    predicted: Array
    """(G, 2) ON and OFF events of each group, weighted as its pixels are"""
    true: Array
    """(G, 2)"""


class Stepper:
    """The step of a recipe, compiled at its first call."""

    def __init__(self, recipe: Recipe) -> None:
        self._recipe = recipe
        self._optimiser = optax.chain(
            optax.clip_by_global_norm(recipe.clip),
            optax.scale_by_adam(),
            optax.add_decayed_weights(recipe.weight_decay, mask=_decays),
            optax.masked(optax.scale(SLOW), _is_tau),
        )
        # small groups one after another stay in a CPU's cache; a GPU wants all at once
        groups = _one_by_one if jax.default_backend() == "cpu" else _together
        self._step = jax.jit(self._build(groups))

    def start(self, parameters: Parameters) -> Any:
        """The optimiser's state before the first step."""
        return self._optimiser.init(parameters)

    def __call__(
        self,
        parameters: Parameters,
        optimiser: Any,
        batch: Batch,
        price: F32,
        weight: F32,
        rate: float,
    ) -> StepResult:
        """Do one step.

        Args:
            parameters: weights of the network.
            optimiser: state of the optimiser.
            batch: G groups of pixels.
            price: (G, 2) price of an ON and an OFF event.
            weight: (G,) weight of each group.
            rate: learning rate.
        """
        data = (batch.x, batch.start, batch.counts, price, weight)
        return StepResult(*self._step(parameters, optimiser, data, jnp.float32(rate)))

    def _build(self, groups: _Groups) -> Callable[..., tuple[Any, ...]]:
        gradient = jax.value_and_grad(self._loss, has_aux=True)

        def step(parameters: Parameters, state: Any, data: _Data, rate: Array) -> tuple[Any, ...]:
            pixels = data[1].size
            summed, found = groups(gradient, parameters, data)
            mean = jax.tree.map(lambda part: part / pixels, summed)
            updates, state = self._optimiser.update(mean, state, parameters)
            moved = jax.tree.map(lambda p, u: p - rate * u, parameters, updates)
            return moved, state, *found

        return step

    def _loss(
        self,
        parameters: Parameters,
        x: Array,
        start: Array,
        counts: Array,
        price: Array,
        weight: Array,
    ) -> tuple[Array, _Found]:
        """Weighted sum of the loss over pixels.

        Args:
            parameters: weights of the network.
            x: (P, K) input of the network.
            start: (P,) V before the first tick.
            counts: (2, K, P) true events.
            price: (2, P) price of an ON and an OFF event.
            weight: (P,) weight of each pixel.

        Returns:
            The sum, and of each pixel its loss (P,) and its predicted and true events, (2, P) each.
        """
        recipe = self._recipe
        late, warm = recipe.architecture.latency_ticks, recipe.warm_ticks
        on, off = stream(parameters, x, start, recipe.architecture, warm + late)
        counted = counts[:, warm : counts.shape[1] - late].astype(jnp.float32)
        true = counted[0], counted[1]
        loss = objective(true, (on, off), recipe.terms, price)
        share = edge_weight(true, recipe.terms.edge)
        events = jnp.stack([on.sum(0), off.sum(0)]) * share
        return jnp.sum(weight * loss), (loss, events, counted.sum(1) * share)


SLOW = 0.03
"""tau's learning rate, relative: at first a short tau is the quickest way to remove noise, and with
a short tau slow changes are lost for good"""

_Data = tuple[Array, Array, Array, Array, Array]
_Found = tuple[Array, Array, Array]
_Groups = Callable[[Callable[..., Any], Parameters, Any], tuple[Parameters, _Found]]


def _one_by_one(
    gradient: Callable[..., Any], parameters: Parameters, data: _Data
) -> tuple[Parameters, _Found]:
    """The gradient's sum over groups; of each group its mean loss and its events."""

    def group(summed: Parameters, part: _Data) -> tuple[Parameters, _Found]:
        x, start, counts, price, weight = part
        each = x.shape[0]
        prices = jnp.broadcast_to(price[:, jnp.newaxis], (2, each))
        (_, found), slope = gradient(
            parameters, x, start, counts, prices, jnp.broadcast_to(weight, (each,))
        )
        loss, predicted, true = found
        return jax.tree.map(jnp.add, summed, slope), (loss.mean(), predicted.sum(1), true.sum(1))

    zero = jax.tree.map(jnp.zeros_like, parameters)
    summed: tuple[Parameters, _Found] = lax.scan(group, zero, data)
    return summed


def _together(
    gradient: Callable[..., Any], parameters: Parameters, data: _Data
) -> tuple[Parameters, _Found]:
    """The same, all groups at once."""
    x, start, counts, price, weight = data
    groups, each, ticks = x.shape
    merged = jnp.transpose(counts, (1, 2, 0, 3)).reshape(2, ticks, -1)
    (_, found), slope = gradient(
        parameters,
        x.reshape(-1, ticks),
        start.reshape(-1),
        merged,
        jnp.repeat(price.T, each, 1),
        jnp.repeat(weight, each),
    )
    predicted, true = (part.reshape(2, groups, each).sum(2).T for part in found[1:])
    return slope, (found[0].reshape(groups, each).mean(1), predicted, true)


def _is_tau(parameters: Parameters) -> Parameters:
    """Which parameter is tau."""
    return {
        key: jax.tree.map(lambda _, key=key: key == "log_tau", part)
        for key, part in parameters.items()
    }


def _decays(parameters: Parameters) -> Parameters:
    """Which parameters decay: filters, not biases and not tau."""
    decays: Parameters = jax.tree_util.tree_map_with_path(
        lambda path, _: (
            not any(getattr(key, "key", "") in ("bias", "last_bias", "log_tau") for key in path)
        ),
        parameters,
    )
    return decays


def learning_rate(recipe: Recipe, progress: float) -> float:
    """Learning rate at a share of the training, `progress`: a warm-up, then a cosine."""
    if progress < recipe.warm_up:
        return recipe.learning_rate * (progress + 1e-3) / (recipe.warm_up + 1e-3)
    done = min(1.0, (progress - recipe.warm_up) / (1.0 - recipe.warm_up))
    low = 0.01
    return recipe.learning_rate * (low + (1.0 - low) * 0.5 * (1.0 + math.cos(math.pi * done)))
