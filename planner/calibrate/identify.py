"""Which unknowns the data tell, and which trade with each other: singular vectors in words.

The Jacobian J of residuals over noise, priors below, in unknowns counted from bound to bound. Its
right singular vectors are the directions in which unknowns move together; a direction that moves
nothing that was measured is not identifiable, one that is uncertain by half of the bounds' range
badly so.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import qr

from model.paths import Array

# Singular values over the largest, columns at length 1, below which nothing is told; and the
# standard deviation along a direction, over the range of the bounds, above which too little is.
_NOTHING, _LITTLE = 1e-7, 0.5
# Parts of a direction that are left out of it, over the largest.
_SMALL, _INVOLVED = 0.1, 1e-3


@dataclass(frozen=True)
class Direction:
    """Unknowns that move together without the data telling.

    Attributes
    ----------
    names : tuple of str
        Of the unknowns.
    changes : tuple of float
        What each moves by, in the unit of its key, when the first moves by a tenth of its range.
    units : tuple of str
    std : float
        Standard deviation along the direction, over the range of the bounds; inf if nothing tells.
    """

    names: tuple[str, ...]
    changes: tuple[float, ...]
    units: tuple[str, ...]
    std: float

    def __str__(self) -> str:
        moves = [
            f"{name} {change:+.3g}{f' {unit}' if unit else ''}"
            for name, change, unit in zip(self.names, self.changes, self.units, strict=True)
        ]
        nothing = not np.isfinite(self.std)
        if len(moves) == 1:
            told = "nothing that was measured tells" if nothing else "the data hardly tell"
            return f"{told} {self.names[0]}"
        told = "no difference to what was measured" if nothing else "less than noise"
        return f"{moves[0]} trades with {', '.join(moves[1:])}: together they make {told}"


@dataclass(frozen=True, eq=False)
class Information:
    """What data and priors say of K unknowns.

    Attributes
    ----------
    covariance : (K, K)
        In units of the bounds' ranges; inf on the diagonal where nothing tells.
    directions : list of (vector (K,), standard deviation)
        Those that are not identifiable, or badly so; counted like the covariance.
    """

    covariance: Array
    directions: list[tuple[Array, float]]


def information(J: Array) -> Information:
    """Return what residuals over noise with derivatives J (n, K), priors included, say."""
    size = np.linalg.norm(J, axis=0)
    blind = size <= _NOTHING * max(float(size.max()), 1e-300)
    lengths = np.where(blind, 1.0, size)
    seen = np.where(blind, 0.0, J / lengths)
    _, s, V = np.linalg.svd(np.vstack([seen, np.zeros((J.shape[1], J.shape[1]))]), False)
    lost = s <= _NOTHING * s[0] if s[0] else np.full(s.size, True)
    along = V / lengths
    covariance = (along[~lost].T / np.square(s[~lost])) @ along[~lost]
    directions = [(_unit(v), float("inf")) for v in _sparse(along[lost])]
    spread, vectors = np.linalg.eigh(covariance)
    for variance, v in zip(spread[::-1], vectors.T[::-1], strict=True):
        if variance > _LITTLE**2:
            directions.append((_unit(v), float(np.sqrt(variance))))
    involved = np.abs(np.array([v for v, std in directions if np.isinf(std)]).reshape(-1, len(V)))
    unknown = (involved > _INVOLVED).any(axis=0)
    covariance[np.diag_indices_from(covariance)] += np.where(unknown, np.inf, 0.0)
    return Information(covariance, directions)


def _sparse(vectors: Array) -> Array:
    """Return a basis of the space of vectors (r, K), each without what leads the others."""
    if len(vectors) < 2:
        return vectors
    _, R, pivots = qr(vectors, pivoting=True)
    found = np.zeros_like(vectors)
    found[:, pivots] = np.linalg.solve(R[:, : len(R)], R)
    return found


def _unit(v: Array) -> Array:
    return np.asarray(v / np.linalg.norm(v))


def direction(
    v: Array, std: float, names: Sequence[str], ranges: Array, units: Sequence[str]
) -> Direction:
    """Return a direction v (K,), counted in the ranges of the bounds, in the keys' units."""
    order = np.argsort(-np.abs(v))
    kept = [int(k) for k in order if abs(v[k]) >= _SMALL * abs(v[order[0]])]
    changes = [float(0.1 * v[k] / v[kept[0]] * ranges[k]) for k in kept]
    return Direction(
        tuple(names[k] for k in kept), tuple(changes), tuple(units[k] for k in kept), std
    )
