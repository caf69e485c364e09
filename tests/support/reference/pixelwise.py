"""Are two pictures the same but for noise? Welch's test per pixel, per block, and of the whole.

Each picture comes as independent batches of samples, so that its noise is known. The family of all
tests of one comparison is corrected after Sidak; on failure, the pictures are written to files.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt
import scipy
from PIL import Image

F64 = npt.NDArray[np.float64]

SIGNIFICANCE = 1e-3
"""Family-wise: with new seeds, one comparison in a thousand fails although nothing is wrong."""
ROUNDING = 2e-5
"""Relative; both sides compute in float32, with a few dozen roundings of 6e-8 and their sums."""
SCALES = (1, 4, 12, 0)
"""Sides of the blocks that are compared, px; 0 is the whole picture."""


@dataclass(frozen=True)
class Verdict:
    """How far two pictures are apart, relative to their noise and to their means."""

    z: dict[int, F64]
    """block side -> Welch's statistic of each block"""
    p: float
    """the smallest p-value, corrected for all tests: how likely chance gives one as small"""
    worst: str
    """the block with that p-value"""
    difference: float
    """relative difference of the pictures' means"""
    sharpness: float
    """the relative difference of the means that would be just significant"""


def judge(ours: F64, theirs: F64) -> Verdict:
    """Compare two stacks (batches, h, w) of independent estimates of one picture.

    Raises:
        AssertionError: If a value is not finite.
    """
    if not (np.isfinite(ours).all() and np.isfinite(theirs).all()):
        raise AssertionError("not a number, or infinite")
    tests, found = 0, {}
    # a picture may be smaller than a block
    scales = [side for side in SCALES if side <= min(ours.shape[1:])]
    for side in scales:
        a, b = (_blocks(stack, side) for stack in (ours, theirs))
        z, freedom, error = _welch(a, b)
        found[side] = z, 2 * scipy.stats.t.sf(np.abs(z), freedom)
        tests += z.size
    side = min(scales, key=lambda s: found[s][1].min())
    least = float(found[side][1].min())
    row, column = np.unravel_index(np.argmin(found[side][1]), found[side][1].shape)
    # the whole picture came last
    mean = float(theirs.mean())
    needed = scipy.stats.t.isf(sidak(SIGNIFICANCE, tests) / 2, freedom[0, 0])
    return Verdict(
        {key: value[0] for key, value in found.items()},
        float(-np.expm1(tests * np.log1p(-min(least, 1 - 1e-16)))),
        f"{side or 'all'} px block (row {row}, column {column})",
        float(ours.mean()) / mean - 1,
        float(error[0, 0] * needed / mean),
    )


def sidak(significance: float, tests: int) -> float:
    """The level of each of `tests` tests that gives all together the level `significance`."""
    return float(-np.expm1(np.log1p(-significance) / tests))


def assert_same_picture(
    name: str, ours: F64, theirs: F64, folder: Path, sharp: float = 0.01
) -> Verdict:
    """Check that two pictures differ by no more than their noise.

    Args:
        name: The name of the files that a failure writes.
        ours: Independent estimates of our picture, (batches, h, w).
        theirs: Independent estimates of their picture, (batches, h, w).
        folder: The folder of those files.
        sharp: The relative difference of the means that the comparison must be able to detect;
            otherwise it is worth nothing.

    Raises:
        AssertionError: If they differ by more than their noise, or if the noise hides `sharp`.
    """
    verdict = judge(ours, theirs)
    found = (
        f"{name}: means differ by {verdict.difference:+.4%} (just significant: "
        f"{verdict.sharpness:.4%}), p {verdict.p:.2g}"
    )
    if verdict.p < SIGNIFICANCE:
        files = write_pictures(name, ours, theirs, verdict, folder)
        raise AssertionError(f"{found} at the {verdict.worst}: see {files}")
    if verdict.sharpness > sharp:
        raise AssertionError(f"{found}: too noisy to see {sharp:.2%}, take more samples")
    return verdict


def write_pictures(name: str, ours: F64, theirs: F64, verdict: Verdict, folder: Path) -> str:
    """Write both pictures and their difference in standard errors as files; return their path."""
    folder.mkdir(parents=True, exist_ok=True)
    a, b = ours.mean(0), theirs.mean(0)
    white = max(float(np.quantile(b, 0.99)), 1e-30)
    z = np.clip(verdict.z[1] / 8, -1, 1)
    # red: ours is brighter, blue: theirs is
    signed = 1 - np.stack([np.maximum(-z, 0), np.abs(z), np.maximum(z, 0)], -1)
    for part, picture in (("ours", a / white), ("theirs", b / white), ("z", signed)):
        coded = np.clip(picture, 0, 1) ** (1 if part == "z" else 1 / 2.2)
        image = Image.fromarray(np.round(255 * coded).astype(np.uint8))
        image.resize((8 * a.shape[1], 8 * a.shape[0]), Image.Resampling.NEAREST).save(
            folder / f"{name}_{part}.png"
        )
    np.savez(folder / f"{name}.npz", ours=ours, theirs=theirs, z=verdict.z[1])
    return str(folder / f"{name}*")


def _blocks(stack: F64, side: int) -> F64:
    """Means over whole blocks, (batches, rows, columns); partial blocks at edges are left out."""
    count, height, width = stack.shape
    if side == 0:
        return stack.mean((1, 2)).reshape(count, 1, 1)
    rows, columns = height // side, width // side
    cut = stack[:, : rows * side, : columns * side]
    return cut.reshape(count, rows, side, columns, side).mean((2, 4))


def _welch(a: F64, b: F64) -> tuple[F64, F64, F64]:
    """Welch's statistic, degrees of freedom, standard error; rounding adds a known variance."""
    va, vb = (np.var(s, 0, ddof=1) / len(s) for s in (a, b))
    apart, level = a.mean(0) - b.mean(0), np.maximum(np.abs(a.mean(0)), np.abs(b.mean(0)))
    known = (ROUNDING * level) ** 2 + 1e-30
    total = va + vb + known
    freedom = total**2 / np.maximum(va**2 / (len(a) - 1) + vb**2 / (len(b) - 1), 1e-300)
    return apart / np.sqrt(total), np.minimum(freedom, 1e9), np.sqrt(total)
