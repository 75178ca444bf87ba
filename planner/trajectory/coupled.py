"""Waypoints of a motion as one program: least effort or time, coupled by rates.

With tensions a_k (scaled) at the waypoints, durations d_m from target to target, of which each
waypoint on the way has its share s_k, and the constraints g_k of each waypoint alone, its targets
and inequalities with the states eliminated,

    minimise    sum effort(a_k) + w sum d_m
    subject to  g_k(a_k) within bounds            |a_k - a_(k-1)| <= rate s_k d_m
                |l(a_k) - l(a_(k-1))| <= stroke rate s_k d_m      d_m >= what is given

by sequential quadratic programming with a trust region: Hessians are exact by waypoint, so that
matrices are block-diagonal and tridiagonal, and the work grows with the number of waypoints.
Source: Nocedal, Wright, "Numerical Optimization" (2006), 18.3, 18.5 (l1 merit function).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray
from scipy.sparse import block_diag, csc_array, eye_array, hstack, kron, vstack

from model.equilibrium.forward import STAGES, Collocation
from model.paths import Array
from model.time_limit import check_time
from planner.program.problem import Bounds, Problem

Counts = NDArray[np.int64]
_STEPS, _SMALL, _TRUST, _LEAST_TRUST = 40, 1e-7, 0.25, 1e-7
# Of effort where time is made least, over the time; of time where it is given, over effort.
_TRACE, _PENALTY = 1e-3, 1e3
# What a step has to gain, over what is made least, for another one.
_GAIN = 1e-5
# Steps back to the constraints, and when they are met.
_RESTORING, _EXACT = 4, 1e-10
_MERIT, _LEAST_CURVATURE = 1e2, 1e-6


@dataclass(frozen=True, eq=False)
class Stop:
    """A waypoint as a program of its own: see planner.program.problem."""

    problem: Problem
    p: Array
    bounds: Bounds


@dataclass(frozen=True, eq=False)
class Coupling:
    """What couples the waypoints.

    Attributes
    ----------
    start : (n,)
        Scaled tensions that the motion begins at.
    rate : (n,)
        Of scaled tensions [1/s].
    least : (M,)
        Least durations from target to target [s].
    group : (N,)
        Which of these each waypoint is in.
    shares : (N,)
        The waypoint's share of it.
    timed : bool
        Whether these are what is wanted, so that effort is made least; else time is.
    stroke : float
        Rate of the tendons' lengths [m/s].
    start_lengths : (n,)
        [m].
    """

    start: Array
    rate: Array
    least: Array
    group: Counts
    shares: Array
    timed: bool
    stroke: float
    start_lengths: Array


@dataclass(frozen=True, eq=False)
class Way:
    """Scaled tensions (N, n), durations (N,) [s], multipliers of the waypoints' constraints."""

    a: Array
    durations: Array
    lam: list[Array]
    missed: float


@dataclass(frozen=True, eq=False)
class _Here:
    """Values and derivatives at the waypoints."""

    f: float
    gradient: list[Array]
    g: list[Array]
    jacobian: list[Array]
    lengths: Array
    slopes: list[Array]


def solved(stops: list[Stop], coupling: Coupling, a: Array, steps: int = _STEPS) -> Way:
    """Return the best way near scaled tensions a (N, n), after so many steps at most."""
    a = np.array([_restored(stop, own) for stop, own in zip(stops, a, strict=True)])
    lam = [np.zeros(stop.bounds[2].size) for stop in stops]
    here, trust = _here(stops, coupling, a), _TRUST
    merit = _merit(stops, coupling, a, here)
    for _ in range(steps):
        check_time()
        step, new = _quadratic(stops, coupling, a, here, lam, trust)
        if step is None:
            break
        trial = np.array([_restored(stop, own) for stop, own in zip(stops, a + step, strict=True)])
        there = _here(stops, coupling, trial)
        found = _merit(stops, coupling, trial, there)
        size = float(np.abs(step).max())
        if np.isfinite(found) and found <= merit + 1e-12 * (1 + abs(merit)):
            gain = merit - found
            a, here, merit, lam = trial, there, found, new
            trust = min(2 * trust, 1.0) if size > 0.9 * trust else trust
            if size < _SMALL or gain < _GAIN * abs(merit):
                break
        else:
            trust = size / 4
            if trust < _LEAST_TRUST:
                break
    durations = _durations(coupling, a, here)[coupling.group] * coupling.shares
    return Way(a, durations, lam, _missed(stops, here))


def _here(stops: list[Stop], coupling: Coupling, a: Array) -> _Here:
    found = [stop.problem.condensed.first(own, stop.p) for stop, own in zip(stops, a, strict=True)]
    lengths, slopes = np.zeros(a.shape), [np.zeros((0, 0))] * len(a)
    if np.isfinite(coupling.stroke):
        pairs = [lengths_of(stop.problem, own, stop.p) for stop, own in zip(stops, a, strict=True)]
        lengths, slopes = np.array([own for own, _ in pairs]), [own for _, own in pairs]
    return _Here(
        sum(one.f for one in found),
        [one.gradient for one in found],
        [one.g for one in found],
        [one.jacobian for one in found],
        lengths,
        slopes,
    )


def _restored(stop: Stop, a: Array) -> Array:
    """Return scaled tensions near a that meet a waypoint's constraints, if a few steps lead there.

    Newton's method for the rows that are violated, by the shortest steps within the bounds.
    """
    lbx, ubx, lbg, ubg = stop.bounds
    a = np.clip(a, lbx, ubx)
    for _ in range(_RESTORING):
        _, _, g, J = stop.problem.condensed.first(a, stop.p)
        lack = np.where(g < lbg, lbg - g, np.where(g > ubg, ubg - g, 0.0))
        rows = (np.abs(lack) > _EXACT) | np.equal(lbg, ubg)
        if not np.all(np.isfinite(J)) or np.abs(lack).max(initial=0.0) < _EXACT:
            break
        step = np.linalg.lstsq(J[rows], lack[rows], rcond=1e-12)[0]
        free = (a + step > lbx) & (a + step < ubx)
        if not free.all() and free.any():
            held = np.clip(a + step, lbx, ubx) - a
            left = lack[rows] - J[rows][:, ~free] @ held[~free]
            step = held
            step[free] = np.linalg.lstsq(J[rows][:, free], left, rcond=1e-12)[0]
        a = np.clip(a + step, lbx, ubx)
    return a


def lengths_of(problem: Problem, a: Array, p: Array) -> tuple[Array, Array]:
    """Return the tendons' lengths (n,) [m] at scaled tensions, and their derivatives (n, n)."""
    start = problem.program.sizes[0]
    unit = p[start : start + a.size]
    mesh = problem.statement.refinement
    forward = Collocation(problem.arm, problem.scene, STAGES, mesh)
    here = forward.found(np.maximum(a, 0.0) * unit)
    slopes = forward.system.length_slopes(here.x) @ here.by_tensions
    return forward.system.lengths(here.x), slopes * unit


def _missed(stops: list[Stop], here: _Here) -> float:
    """Return the largest violation of a waypoint's constraints."""
    lacks = [
        np.maximum(stop.bounds[2] - g, g - stop.bounds[3]).max(initial=0.0)
        for stop, g in zip(stops, here.g, strict=True)
    ]
    return float(max(lacks))


def _durations(coupling: Coupling, a: Array, here: _Here) -> Array:
    """Return the least durations (M,) that tensions allow [s]."""
    steps = np.abs(np.diff(np.vstack([coupling.start, a]), axis=0)) / coupling.rate
    needed = steps.max(axis=1)
    if np.isfinite(coupling.stroke):
        strokes = np.abs(np.diff(np.vstack([coupling.start_lengths, here.lengths]), axis=0))
        needed = np.maximum(needed, strokes.max(axis=1) / coupling.stroke)
    found = coupling.least.copy()
    np.maximum.at(found, coupling.group, needed / coupling.shares)
    return found


def _weights(coupling: Coupling) -> tuple[float, float]:
    """Return the weights of effort and of time."""
    return (1.0, _PENALTY) if coupling.timed else (_TRACE, 1.0)


def _merit(stops: list[Stop], coupling: Coupling, a: Array, here: _Here) -> float:
    effort, time = _weights(coupling)
    over = (_durations(coupling, a, here) - coupling.least * coupling.timed).sum()
    lacks = sum(
        float(np.maximum(np.maximum(stop.bounds[2] - g, g - stop.bounds[3]), 0).sum())
        for stop, g in zip(stops, here.g, strict=True)
    )
    return float(effort * here.f + time * over + _MERIT * max(effort, time) * lacks)


def _quadratic(
    stops: list[Stop],
    coupling: Coupling,
    a: Array,
    here: _Here,
    lam: list[Array],
    trust: float,
) -> tuple[Array | None, list[Array]]:
    """Return the step (N, n) and multipliers of the quadratic program at a."""
    (N, n), M = a.shape, coupling.least.size
    effort, time = _weights(coupling)
    H = block_diag(
        [
            _convex(stop.problem.condensed.second(own, stop.p, effort, multipliers))
            for stop, own, multipliers in zip(stops, a, lam, strict=True)
        ]
        + [1e-9 * np.eye(M)]
    )
    gradient = np.concatenate([effort * np.concatenate(here.gradient), np.full(M, time)])
    rows = block_diag(here.jacobian)
    lower = np.concatenate([s.bounds[2] - g for s, g in zip(stops, here.g, strict=True)])
    upper = np.concatenate([s.bounds[3] - g for s, g in zip(stops, here.g, strict=True)])
    m = rows.shape[0]
    parts = [hstack([rows, csc_array((m, M))])]
    lows, highs = [lower], [upper]
    finite = np.isfinite(coupling.rate)
    differences = eye_array(N) - eye_array(N, k=-1)
    coupled, at = [], (np.arange(N), coupling.group)
    shares = csc_array((coupling.shares, at), shape=(N, M))
    if finite.any():
        keep = csc_array(np.diag(1.0 / np.where(finite, coupling.rate, 1.0))[finite])
        moved = np.diff(np.vstack([coupling.start, a]), axis=0)[:, finite] / coupling.rate[finite]
        coupled.append((kron(differences, keep), moved))
    if np.isfinite(coupling.stroke):
        slopes = block_diag(here.slopes) / coupling.stroke
        moved = np.diff(np.vstack([coupling.start_lengths, here.lengths]), axis=0)
        coupled.append((kron(differences, eye_array(n)) @ slopes, moved / coupling.stroke))
    for matrix, moved in coupled:
        own = kron(shares, np.ones((moved.shape[1], 1)))
        for sign in (1.0, -1.0):
            parts.append(hstack([sign * matrix, -own]))
            lows.append(np.full(moved.size, -np.inf))
            highs.append(-sign * moved.ravel())
    A = csc_array(vstack(parts))
    lbx = np.maximum(np.array([s.bounds[0] for s in stops]) - a, -trust)
    ubx = np.minimum(np.array([s.bounds[1] for s in stops]) - a, trust)
    found = _solve(
        csc_array(H),
        gradient,
        A,
        (np.concatenate(lows), np.concatenate(highs)),
        (
            np.concatenate([lbx.ravel(), coupling.least]),
            np.concatenate([ubx.ravel(), np.full(M, np.inf)]),
        ),
    )
    if found is None:
        return None, lam
    x, multipliers = found
    ends = np.cumsum([g.size for g in here.g])[:-1]
    return x[: N * n].reshape(N, n), np.split(multipliers[:m], ends)


def _convex(H: Array) -> Array:
    """Return the matrix with negative eigenvalues turned to positive ones."""
    values, vectors = np.linalg.eigh((H + H.T) / 2)
    return np.asarray(vectors * np.maximum(np.abs(values), _LEAST_CURVATURE) @ vectors.T)


def _solve(
    H: csc_array, g: Array, A: csc_array, la: tuple[Array, Array], lx: tuple[Array, Array]
) -> tuple[Array, Array] | None:
    """Return the solution of a sparse quadratic program and multipliers of its rows, or None."""
    hs, as_ = (
        ca.Sparsity(M.shape[0], M.shape[1], M.indptr.tolist(), M.indices.tolist()) for M in (H, A)
    )
    for M in (H, A):
        M.sort_indices()
    options: Any = {"error_on_fail": False, "print_time": False, "piqp": {"verbose": False}}
    solver = ca.conic("qp", "piqp", {"h": hs, "a": as_}, options)
    found = solver(
        h=ca.DM(hs, H.data), g=g, a=ca.DM(as_, A.data), lba=la[0], uba=la[1], lbx=lx[0], ubx=lx[1]
    )
    x = np.array(found["x"]).ravel()
    if not np.all(np.isfinite(x)):
        return None
    return x, np.array(found["lam_a"]).ravel()
