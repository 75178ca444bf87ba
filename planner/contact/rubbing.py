"""Plans against friction of contacts: tensions from a plan nearby, in a straight line, by SLSQP.

Friction acts against the motion from there, so that shapes are functions of the tensions at the end
of the way; these move as all of it does (model.contact.rubbed). Where the arm still sticks no
tensions tell how to move it: steps begin at what the target takes without friction, and beyond.
Source: Kraft, A software package for sequential quadratic programming, DFVLR-FB 88-28, 1988.
"""

from __future__ import annotations

from functools import cached_property

import casadi as ca
import numpy as np
from scipy.linalg import qr
from scipy.optimize import lsq_linear, minimize

from model.contact.forward import TouchingMap
from model.contact.friction import path_sensitivities
from model.equilibrium.equilibrium import Collocated
from model.equilibrium.forward import STAGES
from model.equilibrium.linearised import Linearised
from model.errors import OctoplanError
from model.loads import without_friction
from model.paths import Array
from model.time_limit import OutOfTime, check_time, time_limit
from model.transcription.layout import POSE
from planner.contact.load_path import LoadPath
from planner.program.limits import natural_tensions
from planner.program.terms import stations_of, terms_function
from planner.solve.task import SearchResult, Task, Trial

# What is taken of the way to tensions without friction, and beyond.
SLID = (1.0, 1.5, 2.5)
# The mesh; what is missed where the arm jumps; a bound that holds, over a unit of tension; rows
# that depend on others, over the largest.
_MESH, _JUMPED, _ACTIVE, _DEPENDENT = 2, 1e3, 1e-7, 1e-9


class Sliding:
    """Terms of targets at the end of a straight line of tensions from the end of a load path."""

    def __init__(self, task: Task, begin: LoadPath) -> None:
        self.task, arm = task, task.arm
        self.stations, self.unit = stations_of(arm, task.targets), natural_tensions(arm).max()
        mesh = (STAGES, _MESH, self.stations, task.machine_code)
        self._map = TouchingMap(arm, task.scene, *mesh)
        smooth, T = TouchingMap(arm, without_friction(task.scene), *mesh), np.array(begin[0])
        begin_at: Collocated = smooth.equilibrium(T)
        for after in map(np.array, begin[1:]):
            begin_at, T = Collocated(self._at(after, begin_at)[0], _MESH), after
        self.begin, self._begin_at = T, begin_at
        self._last: tuple[Array, tuple[Array, Array, int]] | None = None

    def _at(self, tensions: Array, before: Collocated) -> tuple[Linearised, Array]:
        """Return the equilibrium that a straight line of tensions leads to, and its dx/dT."""
        end = self._map.led(tensions, before, False)
        return end.settled.here, path_sensitivities(end.path)

    @cached_property
    def _terms(self) -> ca.Function:
        """Poses, numbers -> equalities and soft residuals, inequalities, their derivatives."""
        terms = terms_function(self.task.arm, self.task.targets)
        poses = ca.MX.sym("poses", *terms.size_in(0))
        numbers = ca.MX.sym("numbers", *terms.size_in(1))
        equality, soft, inequality, _ = terms(poses, numbers, ca.MX(0, 1))
        rows = [ca.vertcat(equality, soft), inequality]
        jacobians = [ca.densify(ca.jacobian(row, poses)) for row in rows]
        return ca.Function("terms", [poses, numbers], [*rows, *jacobians])

    def rows(self, tensions: Array) -> tuple[Array, Array, int]:
        """Return terms (m,), their derivatives (m, n_tendons) [1/N], how many are equalities."""
        if self._last is not None and np.array_equal(self._last[0], tensions):
            return self._last[1]
        check_time()
        try:
            here, by_tensions = self._at(tensions, self._begin_at)
        except OctoplanError:
            if self._last is None:
                raise
            values, J, n = self._last[1]
            return np.full_like(values, _JUMPED), J, n
        system = here.system
        nodes = [system.mesh.node(s) for s in self.stations]
        places = system.of.nodes[nodes, :POSE]
        numbers = [target.parameters(self.task.arm) for target in self.task.targets]
        parts = [np.array(v) for v in self._terms(here.states[places].T, np.concatenate(numbers))]
        J = np.vstack(parts[2:]) @ by_tensions[places.ravel()]
        rows = np.vstack(parts[:2]).ravel(), J, parts[0].size
        self._last = tensions.copy(), rows
        return rows

    def solve(self, start: Array) -> Array:
        """Return the tensions that steps lead to.

        Equalities that depend on others there, as of an arm that stays in its plane, are left out:
        whether they are met is looked at in the end.
        """
        allowed, unit = self.task.allowed, self.unit
        _, J, n = self.rows(start)
        _, R, order = qr(J[:n].T, mode="economic", pivoting=True)
        sizes = np.abs(np.diag(R))
        apart = order[: sizes.size][sizes > _DEPENDENT * sizes.max(initial=0.0)]

        def part(kind: str, k: int) -> dict[str, object]:
            def evaluated(x: Array) -> Array:
                values, J, n = self.rows(unit * x)
                solution = (values, unit * J)[k]
                return solution[apart] if kind == "eq" else solution[n:]

            return {"type": kind, "fun": evaluated} if k == 0 else {"jac": evaluated}

        rows = [part(kind, 0) | part(kind, 1) for kind in ("eq", "ineq")]
        if allowed.total is not None:
            total = allowed.total / unit
            rows.append({"type": "ineq", "fun": lambda x: total - x.sum()})
        bounds = list(
            zip(np.array(allowed.lower) / unit, np.array(allowed.upper) / unit, strict=True)
        )
        solution = minimize(
            lambda x: (x @ x / 2, x),
            start / unit,
            jac=True,
            bounds=bounds,
            constraints=rows,
            method="SLSQP",
            options={"ftol": 1e-14, "maxiter": 60},
        )
        return np.asarray(np.clip(unit * solution.x, allowed.lower, allowed.upper))

    def violation(self, tensions: Array) -> float:
        """Return by how much targets are missed."""
        values, _, n = self.rows(tensions)
        return float(np.abs(values[:n]).max(initial=0) + np.maximum(-values[n:], 0).max(initial=0))

    def optimality(self, tensions: Array) -> tuple[float, Array]:
        """Return the residual of the first-order conditions, and multipliers of tensions."""
        allowed, unit = self.task.allowed, self.unit
        values, J, n = self.rows(tensions)
        low = np.flatnonzero(tensions <= np.array(allowed.lower) + _ACTIVE * unit)
        high = np.flatnonzero(tensions >= np.array(allowed.upper) - _ACTIVE * unit)
        tight, eye = n + np.flatnonzero(values[n:] < _ACTIVE), np.eye(tensions.size)
        active = np.vstack([unit * J[:n], -unit * J[tight], -eye[low], eye[high]])
        least = np.append(np.full(n, -np.inf), np.zeros(len(active) - n))
        x, lam = tensions / unit, np.zeros(len(active))
        with np.errstate(invalid="ignore"):
            lam = lsq_linear(active.T, -x, (least, np.inf)).x
        off = np.abs(x + active.T @ lam).max() / (1 + np.abs(lam).max(initial=0.0))
        ends = n + tight.size
        return float(off), lam[ends:] @ active[ends:]


def against_friction(
    task: Task, begin: LoadPath, smooth: Array, seconds: float | None
) -> SearchResult:
    """Return the best tensions from those that the targets take without friction."""
    statement, best, stopped = task.statement.but(mode="nearest", refinement=_MESH), None, False
    trials, low = list[Trial](), np.array(task.allowed.lower)
    start = np.array(begin[-1])
    with time_limit(seconds):
        try:
            sliding = Sliding(task, begin)
            for share in SLID[: task.starts]:
                try:
                    T = sliding.solve(np.maximum(start + share * (smooth - start), low))
                    violation = sliding.violation(T)
                except OctoplanError:
                    continue
                met = violation < task.accuracy
                trials.append(Trial(float(np.linalg.norm(T)), met, 0))
                if best is None or (not met, violation * (not met), np.linalg.norm(T)) < best[0]:
                    best = (not met, violation * (not met), np.linalg.norm(T)), T
        except OutOfTime:
            stopped = True
        if best is None:
            T = task.arm.by_section(start)
            return SearchResult(statement, T, (), (), tuple(trials), stopped, load_path=begin[:-1])
        met, T = not best[0][0], best[1]
        lam = tuple(sliding.optimality(T)[1].tolist())
        statement = statement.but(mode="exact" if met else "nearest")
        found = task.arm.by_section(T)
        return SearchResult(statement, found, lam, (), tuple(trials), stopped, load_path=begin)
