"""Checkpoint: the state of a training, which continues from its .npz file to the same end."""

from __future__ import annotations

import contextlib
import json
import os
import zipfile
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from evs.msgs import EvsError
from evs.tools.training.calibration import Calibration
from evs.tools.training.network import Parameters


@dataclass
class Checkpoint:
    """All that the next step depends on, and the curves for the report."""

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
    """numbers of the scenes that the scores are of"""
    of: dict[str, Any] = field(default_factory=dict)
    """recipe and seed: what it can be continued with"""

    def save(self, path: Path) -> None:
        """Whole or not at all.

        Raises:
            EvsError: the disk does not take it.
        """
        leaves = jax.tree.leaves((self.parameters, self.optimiser, self.best))
        held = self.calibration
        told = {
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
                    predicted=held.predicted,
                    true=held.true,
                    integral=held.integral,
                    loss=held.loss,
                    told=np.array(json.dumps(told)),
                )
            part.replace(path)
        except OSError as reason:
            raise EvsError(f"cannot write {path}: {reason.strerror}") from None
        finally:
            with contextlib.suppress(OSError):
                part.unlink()

    def load(self, path: Path) -> Checkpoint:
        """The checkpoint that was saved; this one, fresh, tells what it must look like.

        Raises:
            EvsError: no checkpoint, damaged, or one of another recipe or seed.
        """
        shape = jax.tree.structure((self.parameters, self.optimiser, self.best))
        mine = jax.tree.leaves((self.parameters, self.optimiser, self.best))
        try:
            with path.open("rb") as file, np.load(file, allow_pickle=False) as archive:
                told = json.loads(str(archive["told"][()]))
                leaves = [archive[f"leaf{i}"] for i in range(len(mine))]
                held = [archive[name] for name in ("predicted", "true", "integral", "loss")]
        except (OSError, ValueError, KeyError, zipfile.BadZipFile, EOFError) as reason:
            raise EvsError(f"cannot read the checkpoint {path}: {reason}; delete it") from None
        if told["of"] != self.of:
            differ = [key for key in self.of if told["of"].get(key) != self.of[key]]
            raise EvsError(
                f"{path} is a training with another {', '.join(differ)}; give the same, "
                "another --checkpoint, or delete it"
            )
        parameters, optimiser, best = jax.tree.unflatten(shape, map(jnp.asarray, leaves))
        rest = {key: told[key] for key in told if key != "of"}
        return Checkpoint(parameters, optimiser, best, Calibration(*held), of=self.of, **rest)
