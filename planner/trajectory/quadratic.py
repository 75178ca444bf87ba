"""The quadratic program of a step of the whole motion: block-diagonal and tridiagonal matrices."""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray
from scipy.sparse import block_diag, csc_array, eye_array, hstack, kron, vstack

from model.paths import Array
from planner.program.reduced import Reduced
from planner.trajectory.coupling import Coupling, Here, weights
from planner.trajectory.restoration import Stop

_LEAST_CURVATURE, _DURATION = 1e-6, 1e-9
Limits = tuple[Array, Array]
Mask = NDArray[np.bool_]


def step(
    stops: list[Stop],
    rough: list[Stop],
    coupling: Coupling,
    here: Here,
    lam: list[Array],
    trust: float,
) -> tuple[Array | None, list[Array], float]:
    """Return the step (N, n), None where there is none, multipliers of the waypoints' rows, gain.

    The gain is what the objective falls by in the quadratic program.
    """
    (N, n), M = here.a.shape, coupling.least.size
    effort, time = weights(coupling)
    curved = [
        stop.functions.second(own, stop.p, effort, multipliers)
        for stop, own, multipliers in zip(rough, here.a, lam, strict=True)
    ]
    H = block_diag([*_convex(np.array(curved)), _DURATION * np.eye(M)])
    efforts = [effort * own.gradient for own in here.first]
    gradient = np.concatenate([*efforts, np.full(M, time)])
    near = [_near(stop, at, trust) for stop, at in zip(stops, here.first, strict=True)]
    rows = block_diag([at.jacobian[which] for at, which in zip(here.first, near, strict=True)])
    own = [
        ((stop.bounds[2] - at.g)[which], (stop.bounds[3] - at.g)[which])
        for stop, at, which in zip(stops, here.first, near, strict=True)
    ]
    coupled, most = _coupled(coupling, here)
    A = vstack([hstack([rows, csc_array((rows.shape[0], M))]), *coupled])
    lower = np.concatenate([*(low for low, _ in own), np.full(most.size, -np.inf)])
    upper = np.concatenate([*(high for _, high in own), most])
    lbx = np.maximum(np.array([s.bounds[0] for s in stops]) - here.a, -trust).ravel()
    ubx = np.minimum(np.array([s.bounds[1] for s in stops]) - here.a, trust).ravel()
    within = np.concatenate([lbx, coupling.least]), np.append(ubx, np.full(M, np.inf))
    found = _solve(csc_array(H), gradient, csc_array(A), (lower, upper), within)
    if found is None:
        return None, lam, 0.0
    x, multipliers = found
    known, first = [], 0
    for which in near:
        known.append(np.zeros(which.size))
        known[-1][which] = multipliers[first : first + which.sum()]
        first += which.sum()
    now = time * coupling.durations(here).sum()
    gain = now - float(gradient @ x + x @ (H @ x) / 2)
    return x[: N * n].reshape(N, n), known, gain


def _near(stop: Stop, at: Reduced, trust: float) -> Mask:
    """Return which constraints (m,) a step within the trust region can make active."""
    low, high = stop.bounds[2:]
    reach = trust * np.abs(at.jacobian).sum(axis=1)
    return np.asarray((at.g - low <= reach) | (high - at.g <= reach))


def _coupled(coupling: Coupling, here: Here) -> tuple[list[Any], Array]:
    """Return the rows of tensions and durations that the rates give, and what they are at most."""
    rows, most, finite = list(coupling.tension_rows), [np.zeros(0)], np.isfinite(coupling.rate)
    if rows:
        moved = np.diff(np.vstack([coupling.start, here.a]), axis=0)[:, finite]
        most += [sign * (moved / coupling.rate[finite]).ravel() for sign in (-1.0, 1.0)]
    if np.isfinite(coupling.stroke):
        n = here.a.shape[1]
        jacobian = block_diag(here.jacobian) / coupling.stroke
        moved = np.diff(np.vstack([coupling.start_lengths, here.lengths]), axis=0)
        rows += coupling.both_ways(kron(coupling.differences, eye_array(n)) @ jacobian, n)
        most += [sign * (moved / coupling.stroke).ravel() for sign in (-1.0, 1.0)]
    return rows, np.concatenate(most)


def _convex(H: Array) -> Array:
    """Return matrices (N, n, n) with negative eigenvalues turned to positive ones."""
    values, vectors = np.linalg.eigh((H + H.transpose(0, 2, 1)) / 2)
    scaled = vectors * np.maximum(np.abs(values), _LEAST_CURVATURE)[:, None]
    return np.asarray(scaled @ vectors.transpose(0, 2, 1))


def _solve(
    H: csc_array, g: Array, A: csc_array, la: Limits, lx: Limits
) -> tuple[Array, Array] | None:
    """Return the solution of a sparse quadratic program and multipliers of its rows, or None."""
    hs, as_ = (
        ca.Sparsity(M.shape[0], M.shape[1], M.indptr.tolist(), M.indices.tolist()) for M in (H, A)
    )
    for M in (H, A):
        M.sort_indices()
    given: dict[str, Any] = {"h": ca.DM(hs, H.data), "g": g, "a": ca.DM(as_, A.data)}
    found = _solver(hs, as_)(**given, lba=la[0], uba=la[1], lbx=lx[0], ubx=lx[1])
    x = np.array(found["x"]).ravel()
    if not np.all(np.isfinite(x)):
        return None
    return x, np.array(found["lam_a"]).ravel()


def _solver(h: ca.Sparsity, a: ca.Sparsity) -> ca.Function:
    options: Any = {"error_on_fail": False, "print_time": False, "piqp": {"verbose": False}}
    return ca.conic("qp", "piqp", {"h": h, "a": a}, options)
