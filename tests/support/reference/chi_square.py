"""Does a sampler draw from the density that it states? Pearson's chi-square over cells."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import numpy.typing as npt
import scipy

F64 = npt.NDArray[np.float64]

FEWEST = 10.0
"""Fewest expected draws of a cell; rarer cells are pooled, so that the statistic is chi-square."""


def p_of_counts(counts: F64, expected: F64) -> float:
    """Return how likely draws from `expected` differ from it as much as `counts` do.

    A draw in a cell where none is possible makes it 0.

    Args:
        counts: The number of draws in each cell, of any shape.
        expected: The mean number of draws in each cell, of the same shape.
    """
    order = np.argsort(expected, axis=None)
    counts, expected = counts.ravel()[order], expected.ravel()[order]
    if counts[expected <= 0].any():
        return 0.0
    # pool cells, from the rarest on, until they expect enough draws
    rare = np.searchsorted(expected, FEWEST)
    while rare and rare < len(expected) and expected[:rare].sum() < FEWEST:
        rare += 1
    pooled = [expected[:rare].sum()] if rare and expected[:rare].sum() > 0 else []
    drawn = [counts[:rare].sum()] if pooled else []
    wanted = np.concatenate([pooled, expected[rare:]])
    found = np.concatenate([drawn, counts[rare:]])
    statistic = float(np.sum((found - wanted) ** 2 / wanted))
    return float(scipy.stats.chi2.sf(statistic, len(wanted) - 1))


def p_of_directions(
    directions: F64,
    density: Callable[[F64], F64],
    lost: int = 0,
    cells: tuple[int, int] = (24, 48),
) -> float:
    """Compare directions with their density per sr, over cells of the sphere around z.

    Args:
        directions: The unit vectors that were drawn, (n, 3).
        density: Maps unit vectors (..., 3) to their density per sr (...).
        lost: How many further draws gave no direction; the density's integral falls short of 1 by
            their expected share.
        cells: Rows from pole to pole, and columns around z.

    Returns:
        The p-value of the chi-square test.

    Raises:
        AssertionError: If the density's integral exceeds 1.
    """
    rows, columns = cells
    polar = np.arccos(np.clip(directions[:, 2], -1, 1)) / np.pi * rows
    around = np.arctan2(directions[:, 1], directions[:, 0]) / (2 * np.pi) % 1 * columns
    row, column = (
        np.minimum(polar.astype(int), rows - 1),
        np.minimum(around.astype(int), columns - 1),
    )
    counts = np.bincount(row * columns + column, minlength=rows * columns).astype(np.float64)
    share = cell_integrals(density, cells)
    if share.sum() > 1 + 1e-3:
        raise AssertionError(f"the density's integral is {share.sum():.5f}, over 1")
    draws = len(directions) + lost
    expected = np.append(draws * share.ravel(), max(0.0, draws * (1 - share.sum())))
    if not lost:
        # the error of the quadrature is not a cell
        expected[-1] = 0.0
        expected *= draws / expected.sum()
    return p_of_counts(np.append(counts, lost), expected)


def cell_integrals(density: Callable[[F64], F64], cells: tuple[int, int], nodes: int = 24) -> F64:
    """Integrate over each cell of the sphere by Gauss's quadrature: (rows, columns)."""
    rows, columns = cells
    x, w = np.polynomial.legendre.leggauss(nodes)
    x, w = (x + 1) / 2, w / 2
    polar = (np.arange(rows)[:, None] + x) * (np.pi / rows)
    around = (np.arange(columns)[:, None] + x) * (2 * np.pi / columns)
    a, b = polar[:, None, :, None], around[None, :, None, :]
    direction = np.stack(
        np.broadcast_arrays(np.sin(a) * np.cos(b), np.sin(a) * np.sin(b), np.cos(a)), -1
    )
    values = density(direction) * np.sin(a)
    cell = np.pi / rows * 2 * np.pi / columns
    return np.asarray(np.einsum("rcij,i,j->rc", values, w, w) * cell)
