"""What couples the waypoints of a motion, and where a motion stands: values at all of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csc_array, eye_array, hstack, kron

from model.equilibrium.forward import STAGES, Collocation
from model.loads import is_loaded
from model.paths import Array
from model.unloaded.tendon_lengths import tendon_lengths
from planner.program.problem import Problem
from planner.program.reduced import Reduced
from planner.trajectory.restoration import Stop

Counts = NDArray[np.int64]
# Of effort where time is made least, over the time; of time where it is given, over effort.
_TRACE, _PENALTY = 1e-3, 1e3
_MERIT = 1e2


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

    @cached_property
    def differences(self) -> Any:
        """The matrix (N, N) of what changes from waypoint to waypoint."""
        return eye_array(self.group.size) - eye_array(self.group.size, k=-1)

    @cached_property
    def tension_rows(self) -> list[Any]:
        """The rows that rates of tension give of tensions and durations, up and down; see step."""
        finite = np.isfinite(self.rate)
        if not finite.any():
            return []
        keep = csc_array(np.diag(1.0 / np.where(finite, self.rate, 1.0))[finite])
        return self.both_ways(kron(self.differences, keep), int(finite.sum()))

    def both_ways(self, moved: Any, each: int) -> list[Any]:
        """Return rows of what moves, `each` a waypoint, less the durations, up and down."""
        N, M = self.group.size, self.least.size
        shares = csc_array((self.shares, (np.arange(N), self.group)), shape=(N, M))
        durations = kron(shares, np.ones((each, 1)))
        return [hstack([sign * moved, -durations]) for sign in (1.0, -1.0)]

    def durations(self, here: Here) -> Array:
        """Return the least durations (M,) that tensions allow [s]."""
        steps = np.abs(np.diff(np.vstack([self.start, here.a]), axis=0)) / self.rate
        needed = steps.max(axis=1)
        if np.isfinite(self.stroke):
            strokes = np.abs(np.diff(np.vstack([self.start_lengths, here.lengths]), axis=0))
            needed = np.maximum(needed, strokes.max(axis=1) / self.stroke)
        found = self.least.copy()
        np.maximum.at(found, self.group, needed / self.shares)
        return found


@dataclass(frozen=True, eq=False)
class Here:
    """Scaled tensions (N, n), and values and derivatives there; lengths [m] if strokes count."""

    a: Array
    first: Sequence[Reduced]
    lengths: Array
    jacobian: list[Array]

    @classmethod
    def at(cls, stops: list[Stop], coupling: Coupling, a: Array, first: Sequence[Reduced]) -> Here:
        """Return what is known at scaled tensions."""
        if not np.isfinite(coupling.stroke):
            return cls(a, first, np.zeros(a.shape), [])
        pairs = [lengths_of(stop.problem, own, stop.p) for stop, own in zip(stops, a, strict=True)]
        return cls(a, first, np.array([own for own, _ in pairs]), [own for _, own in pairs])


def weights(coupling: Coupling) -> tuple[float, float]:
    """Return the weights of effort and of time."""
    return (1.0, _PENALTY) if coupling.timed else (_TRACE, 1.0)


def merit(stops: list[Stop], coupling: Coupling, here: Here) -> float:
    """Return the l1 merit function: what is made least, and what constraints lack."""
    effort, time = weights(coupling)
    over = (coupling.durations(here) - coupling.least * coupling.timed).sum()
    lacks = sum(
        float(np.abs(stop.lack(at.g)).sum()) for stop, at in zip(stops, here.first, strict=True)
    )
    efforts = sum(at.f for at in here.first)
    return float(effort * efforts + time * over + _MERIT * max(effort, time) * lacks)


def lengths_of(problem: Problem, a: Array, p: Array) -> tuple[Array, Array]:
    """Return the tendons' lengths (n,) [m] at scaled tensions, and their derivatives (n, n)."""
    start, arm, scene = problem.program.objective.n_numbers, problem.arm, problem.scene
    unit = p[start : start + a.size]
    T = np.maximum(a, 0.0) * unit
    if not is_loaded(scene):
        found = tendon_lengths(arm, scene, problem.machine_code)(T)
        return found.lengths, found.length_tension * unit
    mesh = STAGES, problem.statement.refinement, (), True, problem.machine_code
    here = Collocation(arm, scene, *mesh).found(T)
    return here.lengths, here.length_tension * unit
