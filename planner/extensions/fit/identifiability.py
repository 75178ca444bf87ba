"""Identifiability of unknowns, from the Jacobian J of residuals over noise, with priors below.

The right singular vectors of J are directions in which unknowns change together. A direction that
changes no residual is not identifiable. A direction whose standard deviation exceeds half of the
bounds' range is badly identifiable.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import qr

from octoplan.model.paths import Array

# Relative singular values, with columns scaled to length 1, below which a direction is not
# identifiable.
_ZERO = 1e-7
# Standard deviation along a direction, over the bounds' range, above which the direction is badly
# identifiable.
_WIDE = 0.5
# Variance of a uniform distribution on [0, 1], that is, from bound to bound.
UNIFORM = 1 / 12
# Components of a badly identifiable direction, over the largest one, below which it is shown as 0.
_SMALL = 0.1
# The same for directions that are not identifiable, whose small components are rounding errors.
_INVOLVED = 1e-3


@dataclass(frozen=True)
class Direction:
    """A joint change of unknowns that the data do not, or hardly, detect.

    Attributes
    ----------
    names : tuple of str
        Names of the unknowns.
    changes : tuple of float
        Changes of the unknowns, in the units of their keys; the first one is a tenth of its range.
    units : tuple of str
        Units of the changes.
    std : float
        Standard deviation along the direction, over the range of the bounds; inf if not
        identifiable.
    """

    names: tuple[str, ...]
    changes: tuple[float, ...]
    units: tuple[str, ...]
    std: float

    def __str__(self) -> str:
        nothing = not np.isfinite(self.std)
        if len(self.names) == 1:
            which = "no measurement depends on" if nothing else "the data hardly determine"
            return f"{which} {self.names[0]}"
        rows = zip(self.names, self.changes, self.units, strict=True)
        first, *others = (f"{name} {change:+.3g} {unit}".rstrip() for name, change, unit in rows)
        difference = (
            "they change nothing that was measured" if nothing else "they make less than noise"
        )
        return f"a change of {first} trades with {', '.join(others)}: together {difference}"


def information(J: Array) -> tuple[Array, Array, list[tuple[Array, float]]]:
    """Return covariances and badly identified directions from a Jacobian J (n, K), priors included.

    The covariance (K, K) is in units of the bounds' ranges, with inf on the diagonal for unknowns
    that are not identifiable. A second covariance matrix replaces the infinite variances by uniform
    distributions between the bounds. Each direction (K,) that is not, or badly, identifiable has a
    standard deviation.
    """
    K = J.shape[1]
    size = np.linalg.norm(J, axis=0)
    zero = size <= _ZERO * max(float(size.max()), 1e-300)
    lengths = np.where(zero, 1.0, size)
    scaled = np.vstack([np.where(zero, 0.0, J / lengths), np.zeros((K, K))])
    _, s, V = np.linalg.svd(scaled, full_matrices=False)
    null = s <= _ZERO * max(float(s[0]), 1e-300)
    along = V / lengths
    covariance = (along[~null].T / np.square(s[~null])) @ along[~null]
    directions = [(v / np.linalg.norm(v), float("inf")) for v in sparse_basis(along[null])]
    involved = np.abs(np.array([v for v, _ in directions]).reshape(-1, K)) > _INVOLVED
    variances, vectors = np.linalg.eigh(covariance)
    directions += [
        (v, float(np.sqrt(variance)))
        for variance, v in zip(variances[::-1], vectors.T[::-1], strict=True)
        if variance > _WIDE**2
    ]
    null_space = np.linalg.qr(along[null].T)[0]
    bounded = covariance + null_space @ null_space.T * UNIFORM
    covariance[np.diag_indices(K)] += np.where(involved.any(axis=0), np.inf, 0.0)
    return covariance, bounded, directions


def n_determined(J: Array, size: int) -> tuple[int, float]:
    """Return the number of combinations of unknowns that the data determine, in two ways.

    The first number is the rank of the data's Jacobian, the first `size` rows of J (n, K). The
    second number subtracts the share of the priors, the other rows: the trace of the data's part of
    the hat matrix, of which each prior takes up to 1. Source: MacKay, "Bayesian Interpolation",
    Neural Computation 4 (1992), 4.4.
    """
    if len(J) == size:
        rank = _column_space(J).shape[1]
        return rank, float(rank)
    whole = _column_space(J)
    prior_share = float(np.square(whole[size:]).sum())
    return _column_space(J[:size]).shape[1], whole.shape[1] - prior_share


def _column_space(J: Array) -> Array:
    """Return an orthonormal basis of the columns of J (n, K), (n, rank)."""
    lengths = np.linalg.norm(J, axis=0)
    nonzero = lengths > _ZERO * max(float(lengths.max()), 1e-300)
    U, s, _ = np.linalg.svd(J[:, nonzero] / lengths[nonzero], full_matrices=False)
    return np.asarray(U[:, s > _ZERO * max(float(s.max(initial=0.0)), 1e-300)])


def sparse_basis(vectors: Array) -> Array:
    """Return a basis of the span of vectors (r, K), in reduced echelon form with pivoting."""
    if len(vectors) < 2:
        return vectors
    _, R, pivots = qr(vectors, pivoting=True)
    basis = np.zeros_like(vectors)
    basis[:, pivots] = np.linalg.solve(R[:, : len(R)], R)
    return basis


def direction(
    v: Array, std: float, names: Sequence[str], ranges: Array, units: Sequence[str]
) -> Direction:
    """Return a direction v (K,), in units of the bounds' ranges, in the units of the keys."""
    order = np.argsort(-np.abs(v))
    smallest = _SMALL if np.isfinite(std) else _INVOLVED
    kept = [int(k) for k in order if abs(v[k]) >= smallest * abs(v[order[0]])]
    changes = [float(0.1 * v[k] / v[kept[0]] * ranges[k]) for k in kept]
    return Direction(
        tuple(names[k] for k in kept), tuple(changes), tuple(units[k] for k in kept), std
    )
