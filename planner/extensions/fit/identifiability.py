"""Which unknowns the data identify, and which trade with each other.

It is told by the Jacobian J of residuals over noise, priors below. Its right singular vectors are
the directions in which unknowns change together; a direction that changes nothing that was measured
is not identifiable, one that is uncertain by half of the bounds' range badly so.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import qr

from octoplan.model.paths import Array

# Singular values over the largest, columns at length 1, below which a direction is not
# identifiable; and the standard deviation along one, over the bounds' range, above which it is
# badly so.
_ZERO, _WIDE = 1e-7, 0.5
# The variance of a uniform distribution from bound to bound.
UNIFORM = 1 / 12
# Parts of a direction that are left out of it, over the largest: where the data tell it badly, and
# where they do not tell it, where only rounding is.
_SMALL, _INVOLVED = 0.1, 1e-3


@dataclass(frozen=True)
class Direction:
    """Unknowns that change together without the data telling.

    Attributes
    ----------
    names : tuple of str
        Of the unknowns.
    changes : tuple of float
        What each changes by, in the unit of its key, when the first does by a tenth of its range.
    units : tuple of str
    std : float
        Standard deviation along the direction, over the range of the bounds; inf if nothing tells.
    """

    names: tuple[str, ...]
    changes: tuple[float, ...]
    units: tuple[str, ...]
    std: float

    def __str__(self) -> str:
        nothing = not np.isfinite(self.std)
        if len(self.names) == 1:
            which = "nothing that was measured tells" if nothing else "the data hardly tell"
            return f"{which} {self.names[0]}"
        rows = zip(self.names, self.changes, self.units, strict=True)
        first, *others = (f"{name} {change:+.3g} {unit}".rstrip() for name, change, unit in rows)
        difference = (
            "they change nothing that was measured" if nothing else "they make less than noise"
        )
        return f"a change of {first} trades with {', '.join(others)}: together {difference}"


def information(J: Array) -> tuple[Array, Array, list[tuple[Array, float]]]:
    """Return what residuals over noise with derivatives J (n, K), priors included, say.

    The covariance (K, K) in units of the bounds' ranges, inf on the diagonal where nothing tells;
    the same with what the bounds say there, which count as a uniform distribution; and directions
    (K,) that are not identifiable, or badly so, each with its standard deviation.
    """
    K = J.shape[1]
    size = np.linalg.norm(J, axis=0)
    blind = size <= _ZERO * max(float(size.max()), 1e-300)
    lengths = np.where(blind, 1.0, size)
    scaled = np.vstack([np.where(blind, 0.0, J / lengths), np.zeros((K, K))])
    _, s, V = np.linalg.svd(scaled, full_matrices=False)
    null = s <= _ZERO * max(float(s[0]), 1e-300)
    along = V / lengths
    covariance = (along[~null].T / np.square(s[~null])) @ along[~null]
    directions = [(v / np.linalg.norm(v), float("inf")) for v in _sparse(along[null])]
    involved = np.abs(np.array([v for v, _ in directions]).reshape(-1, K)) > _INVOLVED
    variances, vectors = np.linalg.eigh(covariance)
    directions += [
        (v, float(np.sqrt(variance)))
        for variance, v in zip(variances[::-1], vectors.T[::-1], strict=True)
        if variance > _WIDE**2
    ]
    untold = np.linalg.qr(along[null].T)[0]
    bounded = covariance + untold @ untold.T * UNIFORM
    covariance[np.diag_indices(K)] += np.where(involved.any(axis=0), np.inf, 0.0)
    return covariance, bounded, directions


def n_determined(J: Array, size: int) -> tuple[int, float]:
    """Return how many combinations of unknowns the data determine, and how many without the priors.

    The first is the rank of the derivatives of the data, the first `size` rows of J (n, K); the
    second leaves out what priors, the other rows, hold: the trace of the data's part of the hat
    matrix, of which each prior takes up to 1. Source: MacKay, "Bayesian Interpolation", Neural
    Computation 4 (1992), 4.4.
    """
    if len(J) == size:
        rank = _column_space(J).shape[1]
        return rank, float(rank)
    whole = _column_space(J)
    held = float(np.square(whole[size:]).sum())
    return _column_space(J[:size]).shape[1], whole.shape[1] - held


def _column_space(J: Array) -> Array:
    """Return an orthonormal basis of the columns of J (n, K), (n, rank)."""
    lengths = np.linalg.norm(J, axis=0)
    seen = lengths > _ZERO * max(float(lengths.max()), 1e-300)
    U, s, _ = np.linalg.svd(J[:, seen] / lengths[seen], full_matrices=False)
    return np.asarray(U[:, s > _ZERO * max(float(s.max(initial=0.0)), 1e-300)])


def _sparse(vectors: Array) -> Array:
    """Return a basis of the space of vectors (r, K), each without what leads the others."""
    if len(vectors) < 2:
        return vectors
    _, R, pivots = qr(vectors, pivoting=True)
    basis = np.zeros_like(vectors)
    basis[:, pivots] = np.linalg.solve(R[:, : len(R)], R)
    return basis


def direction(
    v: Array, std: float, names: Sequence[str], ranges: Array, units: Sequence[str]
) -> Direction:
    """Return a direction v (K,), counted in the ranges of the bounds, in the keys' units."""
    order = np.argsort(-np.abs(v))
    least = _SMALL if np.isfinite(std) else _INVOLVED
    kept = [int(k) for k in order if abs(v[k]) >= least * abs(v[order[0]])]
    changes = [float(0.1 * v[k] / v[kept[0]] * ranges[k]) for k in kept]
    return Direction(
        tuple(names[k] for k in kept), tuple(changes), tuple(units[k] for k in kept), std
    )
