"""Programs in the tensions of an arm in contact: its shape is settled, contacts sharp, for each.

    minimise    sum T^2 / 2
    subject to  equalities = 0, inequalities >= 0     of the targets, at the shape x(T)
                forces on each object that is held balance its wrench, tangential ones f in cones:
                n . f = 0, |f| <= mu N
                the least eigenvalue of the energy's Hessian >= a margin, where that is asked for
                lower <= T <= upper, sum T <= total pull

By SLSQP (Kraft, A software package for sequential quadratic programming, DFVLR-FB 88-28, 1988), the
shape's derivatives by the implicit function theorem; where constraints cannot be met, the least
squares of their violations (Branch, Coleman and Li, SIAM J. Sci. Comput. 21, 1999).
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property

import casadi as ca
import numpy as np
from scipy.linalg import qr
from scipy.optimize import least_squares, lsq_linear, minimize

from model.contact.contacts import touches_of
from model.equilibrium.linearised import Linearised
from model.equilibrium.stability import stability
from model.errors import OctoplanError, UnsettledContactError
from model.paths import Array
from model.time_limit import check_time
from model.transcription.layout import POSE
from planner.contact.equilibria import Settle
from planner.contact.grasp import Grasp
from planner.program.limits import natural_tensions
from planner.program.terms import stations_of, target_numbers, terms_of
from planner.solve.task import Task
from planner.targets.hold import Hold

# How often settling may fail in one program.
_FAILURES = 20
# Violations where no shape is settled; constraints that are active; rows that depend on others,
# over the largest; steps of differences in scaled unknowns: of states, and of shapes settled anew.
_UNSETTLED, _ACTIVE, _DEPENDENT, _STEP, _CHANGE = 1e3, 1e-6, 1e-9, 1e-6, 1e-4
# By how much cones are blunt at their tips, and what tangential forces cost, so that those that
# nothing determines are small.
_BLUNT, _COST = 1e-7, 1e-9
# Stability is rounded to some 1e-13: lesser violations are not waited for.
_SLSQP = {"ftol": 1e-12, "maxiter": 60}


@dataclass(frozen=True, eq=False)
class Optimality:
    """The residual of the first-order conditions, and multipliers of tensions and stability."""

    residual: float
    lam_bounds: Array
    lam_stability: float


@dataclass(frozen=True, eq=False)
class Constraints:
    """Constraints at an equilibrium: values (m,), derivatives (m, n), how many are equalities."""

    point: Linearised
    values: Array
    jacobian: Array
    equalities: int

    @property
    def short(self) -> Array:
        """Residuals of the equalities, and what inequalities are below 0 (m,)."""
        n = self.equalities
        return np.append(self.values[:n], np.minimum(self.values[n:], 0.0))

    @property
    def violation(self) -> float:
        """The largest violation."""
        return float(np.abs(self.short).max(initial=0.0))


class TensionProgram:
    """The program of a task; unknowns are scaled tensions, then tangential forces on objects.

    Attributes
    ----------
    start : (n,)
        The unknowns at the equilibrium that it begins with, with the best tangential forces.
    places : list of int
        How many places touch each object there: as many have tangential forces.
    least : float
        The stability that shapes are held to; none with 0.
    visited : list of (n_tendons,)
        Tensions of the steps taken so far.
    """

    def __init__(self, task: Task, settle: Settle, begin: Linearised, least: float = 0.0) -> None:
        self.task, self.least, self._settle = task, least, settle
        self.unit, self.n = float(natural_tensions(task.arm).max()), task.arm.n_tendons
        self._holds = [target for target in task.targets if isinstance(target, Hold)]
        self._stations = stations_of(task.arm, task.targets)
        self._numbers = target_numbers(task.arm, task.targets)
        self._known, self.visited = dict[bytes, Constraints | None](), list[Array]()
        self.places, held = self.touching(begin), [begin.tensions / self.unit]
        for hold, grasp in zip(self._holds, self._grasps(begin), strict=True):
            tangential = np.einsum("kij,ki->kj", grasp.bases, grasp.best())
            held.append(tangential.ravel() / hold.size(task.arm))
        self.start = np.concatenate(held)

    @cached_property
    def _terms(self) -> ca.Function:
        """Poses, numbers -> equalities and soft residuals, inequalities, their derivatives."""
        terms = terms_of(self.task.arm, self.task.targets).function
        poses = ca.MX.sym("poses", *terms.size_in(0))
        numbers = ca.MX.sym("numbers", *terms.size_in(1))
        equality, soft, inequality, _ = terms(poses, numbers, ca.MX(0, 1))
        rows = [ca.vertcat(equality, soft), inequality]
        jacobians = [ca.densify(ca.jacobian(row, poses)) for row in rows]
        return ca.Function("terms", [poses, numbers], [*rows, *jacobians])

    def _grasps(self, point: Linearised) -> list[Grasp]:
        touches = touches_of(point, shifted=True) if self._holds else ()
        return [Grasp.of(self.task.arm, touches, hold) for hold in self._holds]

    def touching(self, point: Linearised) -> list[int]:
        """Return at how many places an arm touches each object that it holds."""
        return [grasp.normal.size for grasp in self._grasps(point)]

    def _balance(self, grasps: list[Grasp], forces: Array) -> Array:
        """Return what is left of wrenches, then in cones, over the sizes of the wrenches.

        With tangential forces along the bases of the places that touch; no others act.
        """
        left, cones = list[Array](), list[Array]()
        ends = np.cumsum(self.places)[:-1]
        for hold, grasp, z in zip(
            self._holds, grasps, np.split(forces.reshape(-1, 2), ends), strict=True
        ):
            size, k = hold.size(self.task.arm), min(len(z), grasp.normal.size)
            tangential, room = np.zeros((grasp.normal.size, 3)), np.zeros(len(z))
            tangential[:k] = size * np.einsum("kij,kj->ki", grasp.bases[:k], z[:k])
            room[:k] = hold.friction * grasp.normal[:k] / size
            left.append(grasp.scaled(grasp.left(tangential)) / size)
            cones.append(room + _BLUNT - np.sqrt((z**2).sum(axis=1) + _BLUNT**2))
        return np.concatenate(left + cones)

    def _held(self, point: Linearised, by_tensions: Array, y: Array) -> tuple[Array, Array]:
        """Return `_balance` at unknowns, and its derivatives by differences."""
        n, grasps = self.n, self._grasps(point)
        by_unknowns = np.zeros((point.x.size, n))
        by_unknowns[point.system.of.first :] = self.unit * by_tensions

        def balance(step: Array) -> Array:
            changed = grasps
            if step[:n].any():
                x = point.x + by_unknowns @ step[:n]
                changed = self._grasps(Linearised(point.system, x))
            return self._balance(changed, y[n:] + step[n:])

        steps = _STEP * np.eye(y.size)
        rates = [(balance(step) - balance(-step)) / (2 * _STEP) for step in steps]
        return self._balance(grasps, y[n:]), np.array(rates).T

    def _margin(self, point: Linearised, T: Array) -> tuple[Array, Array]:
        """Return stability beyond what it is held to, and its derivatives by differences."""

        def at(step: Array) -> float:
            return stability(self._settle(self.unit * (T + step))[0])

        rates = [(at(step) - at(-step)) / (2 * _CHANGE) for step in _CHANGE * np.eye(self.n)]
        return np.array([stability(point) - self.least]), np.array([rates])

    def rows(self, y: Array) -> Constraints:
        """Return the constraints at unknowns; raises what settling does."""
        rows = self._rows(y)
        if rows is None:
            raise UnsettledContactError(1.0, "none is found under these tensions")
        return rows

    def _rows(self, y: Array) -> Constraints | None:
        """Return the constraints at unknowns, None where nothing is settled; each sought once."""
        if y.tobytes() not in self._known:
            check_time()
            self._known[y.tobytes()] = None
            with suppress(OctoplanError):
                self._known[y.tobytes()] = self._evaluated(y)
        return self._known[y.tobytes()]

    def _evaluated(self, y: Array) -> Constraints:
        point, by_tensions = self._settle(self.unit * y[: self.n])
        system, total = point.system, self.task.allowed.total
        places = system.of.nodes[[system.mesh.node(s) for s in self._stations], :POSE]
        parts = [np.array(each) for each in self._terms(point.states[places].T, self._numbers)]
        by_poses = self.unit * by_tensions[places.ravel()]
        equal, unequal = ([(parts[k].ravel(), parts[2 + k] @ by_poses)] for k in range(2))
        if self.least:
            unequal.append(self._margin(point, y[: self.n]))
        if total is not None:
            left = total / self.unit - y[: self.n].sum()
            unequal.append((np.array([left]), -np.ones((1, self.n))))
        if self._holds:
            values, jacobian = self._held(point, by_tensions, y)
            m = sum(len(hold.wrench) for hold in self._holds)
            equal.append((values[:m], jacobian[:m]))
            unequal.append((values[m:], jacobian[m:]))
        values = np.concatenate([values for values, _ in equal + unequal])
        jacobian = np.zeros((values.size, y.size))
        first = 0
        for part, by_unknowns in equal + unequal:
            jacobian[first : first + part.size, : by_unknowns.shape[1]] = by_unknowns
            first += part.size
        return Constraints(point, values, jacobian, sum(part.size for part, _ in equal))

    def _near(self, y: Array, last: Constraints) -> Constraints:
        """Return the constraints at unknowns; large ones where nothing is settled.

        Raises UnsettledContactError where settling has failed too often.
        """
        rows = self._rows(y)
        if rows is None and list(self._known.values()).count(None) > _FAILURES:
            raise UnsettledContactError(1.0, "none is found under many tensions")
        return rows or replace(last, values=np.full_like(last.values, -_UNSETTLED))

    def _bounds(self, size: int) -> tuple[Array, Array]:
        """Return the bounds of unknowns."""
        free, allowed = np.full(size - self.n, np.inf), self.task.allowed
        low, high = np.array(allowed.lower) / self.unit, np.array(allowed.upper) / self.unit
        return np.append(low, -free), np.append(high, free)

    def solve(self, start: Array) -> Array:
        """Return the unknowns that steps of SLSQP lead to.

        Equalities that depend on others there, as of an arm that stays in its plane, are left out:
        whether they are met is looked at in the end.
        """
        first, end = self.rows(start), start
        n, weights = first.equalities, np.where(np.arange(start.size) < self.n, 1.0, _COST)
        _, R, order = qr(first.jacobian[:n].T, mode="economic", pivoting=True)
        sizes = np.abs(np.diag(R))
        apart = np.sort(order[: sizes.size][sizes > _DEPENDENT * sizes.max(initial=0.0)])
        constraints = [
            {
                "type": kind,
                "fun": lambda y, at=at: self._near(y, first).values[at],
                "jac": lambda y, at=at: self._near(y, first).jacobian[at],
            }
            for kind, at in (("eq", apart), ("ineq", np.arange(n, first.values.size)))
        ]

        def step(y: Array) -> None:
            nonlocal end
            if self._rows(y) is not None:
                end = y.copy()
                self._visit(end)

        with suppress(OctoplanError):
            minimize(
                lambda y: (y @ (weights * y) / 2, weights * y),
                start,
                jac=True,
                bounds=list(zip(*self._bounds(start.size), strict=True)),
                constraints=constraints,
                method="SLSQP",
                options=_SLSQP,
                callback=step,
            )
        return end

    def nearest(self, start: Array) -> Array:
        """Return unknowns nearby at which the violations' least squares are."""
        first, (low, high) = self.rows(start), self._bounds(start.size)
        high = np.maximum(high, low + 2 * _STEP)
        inside = np.clip(start, low + _STEP / 2, high - _STEP / 2)

        def jacobian(y: Array) -> Array:
            rows = self._near(y, first)
            return np.where(rows.short[:, None] != 0, rows.jacobian, 0.0)

        with suppress(OctoplanError):
            end = least_squares(
                lambda y: self._near(y, first).short,
                inside,
                jacobian,
                (low, high),
                max_nfev=_SLSQP["maxiter"] // 2,
            ).x
            self.rows(end)
            self._visit(end)
            return np.asarray(end)
        return start

    def _visit(self, y: Array) -> None:
        """Take note of the tensions in unknowns, within limits to the last digit."""
        allowed = self.task.allowed
        self.visited.append(np.clip(self.unit * y[: self.n], allowed.lower, allowed.upper))

    def optimality(self, y: Array) -> Optimality:
        """Return how far unknowns are from the first-order conditions.

        The multipliers of what is active leave least of the gradient.
        """
        (low, high), rows, eye = self._bounds(y.size), self.rows(y), np.eye(y.size)
        n, J = rows.equalities, rows.jacobian
        tight = n + np.flatnonzero(rows.values[n:] < _ACTIVE)
        active = np.vstack([J[:n], -J[tight], -eye[y <= low + _ACTIVE], eye[y >= high - _ACTIVE]])
        least = np.append(np.full(n, -np.inf), np.zeros(len(active) - n))
        gradient, lam = np.where(np.arange(y.size) < self.n, y, 0.0), np.zeros(len(active))
        with np.errstate(invalid="ignore"):
            lam = lsq_linear(active.T, -gradient, (least, np.inf)).x
        off = np.abs(gradient + active.T @ lam).max() / (1 + np.abs(lam).max(initial=0.0))
        ends, margin = n + tight.size, n + int(self._terms.numel_out(1))
        pushed = lam[ends:] @ active[ends:]
        at_margin = float(lam[n:ends][tight == margin].sum()) if self.least else 0.0
        return Optimality(float(off), pushed[: self.n], -at_margin)
