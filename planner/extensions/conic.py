"""Conic programs: quadratic objectives within nonnegative and second-order cones."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import clarabel
import numpy as np
from scipy.sparse import csc_array

from octoplan.model.paths import Array

# Tolerance of the solver.
_TOLERANCE = 1e-11
# A kind of cone, rows and offsets: rows @ x + offsets is in the cone.
Cone = tuple[Any, Array, Array]


def conic_program(H: Array, cost: Array, cones: Sequence[Cone]) -> tuple[Array, Array] | None:
    """Return the minimiser of x . H x / 2 + cost . x within cones, and the multipliers, or None.

    By clarabel (Goulart and Chen, arXiv:2405.12762, 2024).
    """
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = _TOLERANCE
    kinds, rows, numbers = zip(*cones, strict=True)
    sized = [kind(len(offsets)) for kind, offsets in zip(kinds, numbers, strict=True)]
    A, b = _sparse(-np.vstack(rows)), np.concatenate(numbers)
    solution = clarabel.DefaultSolver(_sparse(np.triu(H)), cost, A, b, sized, settings).solve()
    solved = str(solution.status) in ("Solved", "AlmostSolved", "InsufficientProgress")
    return (np.array(solution.x), np.array(solution.z)) if solved else None


def _sparse(dense: Array) -> csc_array:
    """Return a small matrix as a sparse one, with less overhead than the constructor of SciPy."""
    columns, rows = np.nonzero(dense.T)
    starts = np.searchsorted(columns, np.arange(dense.shape[1] + 1))
    return csc_array((dense[rows, columns], rows, starts), shape=dense.shape)
