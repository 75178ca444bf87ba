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

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property

import casadi as ca
import numpy as np
from scipy.linalg import qr
from scipy.optimize import least_squares, lsq_linear, minimize

from model.contact.friction import tangents
from model.contact.touches import Touches, resultants, second
from model.equilibrium.linearised import Linearised
from model.equilibrium.stability import stability
from model.errors import OctoplanError
from model.loads import contacts
from model.obstacles.base import distances
from model.paths import Array
from model.time_limit import check_time
from model.transcription.layout import POSE
from planner.contact.grasp import Grasp
from planner.program.limits import natural_tensions
from planner.program.terms import stations_of, target_numbers, terms_of
from planner.solve.task import Task
from planner.targets.hold import LEVER, Hold

# How often settling may fail in one solve: where the arm would snap steps lead nowhere.
_FAILURES = 20
# Residuals where no shape is settled; constraints that are active; rows that depend on others, over
# the largest; steps of differences in scaled unknowns: of states, and of shapes settled anew.
_UNSETTLED, _ACTIVE, _DEPENDENT, _STEP, _CHANGE = 1e3, 1e-6, 1e-9, 1e-6, 1e-4
# By how much cones are blunt at their tips, and what tangential forces cost, so that those that
# nothing determines are small.
_BLUNT, _COST = 1e-7, 1e-9
_SLSQP = {"ftol": 1e-14, "maxiter": 60}

# Tensions (n_tendons,) -> the equilibrium, derivatives (n_states, n_tendons) of its states.
Settle = Callable[[Array], tuple[Linearised, Array]]


@dataclass(frozen=True, eq=False)
class Optimality:
    """The residual of the first-order conditions, and multipliers of tensions and stability."""

    residual: float
    lam_bounds: Array
    lam_stability: float


@dataclass(frozen=True, eq=False)
class Rows:
    """Constraints at an equilibrium: values (m,), derivatives (m, n), how many are equalities."""

    here: Linearised
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

    def sized(self, like: Rows) -> Rows:
        """Return as many rows as others have: the last are those of places, which come and go."""
        m = like.values.size
        values, jacobian = np.zeros(m), np.zeros((m, self.jacobian.shape[1]))
        k = min(m, self.values.size)
        values[:k], jacobian[:k] = self.values[:k], self.jacobian[:k]
        return Rows(self.here, values, jacobian, self.equalities)


class Reduced:
    """The program of a task; unknowns are scaled tensions, then tangential forces on objects.

    Attributes
    ----------
    least : float
        The stability that shapes are held to; none with 0.
    """

    def __init__(self, task: Task, settle: Settle, least: float = 0.0) -> None:
        self.task, self._settle, self.least = task, settle, least
        self.unit, self.n = float(natural_tensions(task.arm).max()), task.arm.n_tendons
        self._holds = [target for target in task.targets if isinstance(target, Hold)]
        self._stations = stations_of(task.arm, task.targets)
        self._numbers = target_numbers(task.arm, task.targets)
        self._known = dict[bytes, Rows | OctoplanError]()

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

    def start(self, here: Linearised) -> Array:
        """Return the unknowns at an equilibrium, with the best tangential forces."""
        held = [
            np.einsum("kij,ki->kj", grasp.bases, grasp.best()).ravel() / hold.size(self.task.arm)
            for hold, grasp in zip(self._holds, self._grasps(here)(here.states), strict=True)
        ]
        return np.concatenate([here.tensions / self.unit, *held])

    def tensions(self, y: Array) -> Array:
        """Return the tensions in unknowns, within limits to the last digit (n_tendons,) [N]."""
        allowed = self.task.allowed
        return np.clip(self.unit * y[: self.n], allowed.lower, allowed.upper)

    def _grasps(self, here: Linearised) -> Callable[[Array], list[Grasp]]:
        """Return states (n_states,) near those of an equilibrium -> the grasps of what is held."""
        system, arm = here.system, self.task.arm
        bodies = [contact.obstacle for contact in contacts(system.scene)]
        touches = Touches.of(system)
        at = [
            (hold, j, np.flatnonzero((touches.held | touches.inside)[:, j]))
            for hold in self._holds
            for j in [bodies.index(hold.obstacle)]
        ]
        along = [tangents(here, system.mesh.s[nodes]) for _, _, nodes in at]

        def grasps(states: Array) -> list[Grasp]:
            pressed, results = resultants(system, states, touches), []
            shifts = second(system, states) * touches.moves
            for (hold, j, nodes), tangent in zip(at, along, strict=True):
                numbers = hold.obstacle.numbers
                places = system.poses(states)[nodes, 4:] + shifts[nodes, j, None] * tangent
                distance, normals = (each[:, 0] for each in distances(numbers[None], places))
                points = places - distance[:, None] * normals - numbers[:3]
                wrench, lever = np.array(hold.wrench), LEVER * arm.length
                size = pressed[nodes, j]
                results.append(Grasp(points, normals, size, wrench, hold.friction, lever))
            return results

        return grasps

    def _balance(self, grasps: list[Grasp], forces: Array) -> Array:
        """Return what is left of wrenches, then in cones, over the sizes of the wrenches.

        With tangential forces along the bases of the places that touch; those beyond are 0.
        """
        left, cones = list[Array](), list[Array]()
        for hold, grasp in zip(self._holds, grasps, strict=True):
            size, count = hold.size(self.task.arm), 2 * grasp.normal.size
            values, forces = forces[:count], forces[count:]
            z = np.pad(values, (0, count - values.size)).reshape(-1, 2)
            tangential = size * np.einsum("kij,kj->ki", grasp.bases, z)
            left.append(grasp.scaled(grasp.left(tangential)) / size)
            blunt = np.sqrt((z**2).sum(axis=1) + _BLUNT**2) - _BLUNT
            cones.append(hold.friction * grasp.normal / size - blunt)
        return np.concatenate(left + cones)

    def _held(self, here: Linearised, by_tensions: Array, y: Array) -> tuple[Array, Array]:
        """Return `_balance` at unknowns, and its derivatives by differences."""
        n, grasps = self.n, self._grasps(here)

        def balance(change: Array) -> Array:
            states = here.states + self.unit * by_tensions @ change[:n]
            return self._balance(grasps(states), y[n:] + change[n:])

        steps = _STEP * np.eye(y.size)
        rates = [(balance(step) - balance(-step)) / (2 * _STEP) for step in steps]
        return balance(np.zeros(y.size)), np.array(rates).T

    def _margin(self, here: Linearised, y: Array) -> tuple[Array, Array]:
        """Return stability beyond what it is held to, and its derivatives by differences."""

        def at(tensions: Array) -> float:
            return stability(self._settle(self.unit * tensions)[0])

        T, steps = y[: self.n], _CHANGE * np.eye(self.n)
        rates = [(at(T + step) - at(T - step)) / (2 * _CHANGE) for step in steps]
        return np.array([stability(here) - self.least]), np.array([rates])

    def rows(self, y: Array) -> Rows:
        """Return the constraints at unknowns; raises what settling does."""
        if y.tobytes() not in self._known:
            check_time()
            try:
                self._known[y.tobytes()] = self._evaluated(y)
            except OctoplanError as problem:
                self._known[y.tobytes()] = problem
        result = self._known[y.tobytes()]
        if isinstance(result, OctoplanError):
            raise result
        return result

    def _evaluated(self, y: Array) -> Rows:
        here, by_tensions = self._settle(self.unit * y[: self.n])
        system, total = here.system, self.task.allowed.total
        places = system.of.nodes[[system.mesh.node(s) for s in self._stations], :POSE]
        parts = [np.array(each) for each in self._terms(here.states[places].T, self._numbers)]
        by_poses = self.unit * by_tensions[places.ravel()]
        blocks = [(parts[k].ravel(), parts[2 + k] @ by_poses) for k in range(2)]
        equalities = blocks[0][0].size
        if self.least:
            blocks.append(self._margin(here, y))
        if total is not None:
            left = total / self.unit - y[: self.n].sum()
            blocks.append((np.array([left]), -np.ones((1, self.n))))
        if self._holds:
            values, jacobian = self._held(here, by_tensions, y)
            m = sum(len(hold.wrench) for hold in self._holds)
            blocks[1:1], equalities = [(values[:m], jacobian[:m])], equalities + m
            blocks.append((values[m:], jacobian[m:]))
        padded = [np.pad(J, ((0, 0), (0, y.size - J.shape[1]))) for _, J in blocks]
        values = np.concatenate([values for values, _ in blocks])
        return Rows(here, values, np.concatenate(padded), equalities)

    def _bounds(self, size: int) -> tuple[Array, Array]:
        """Return the bounds of unknowns."""
        free, allowed = np.full(size - self.n, np.inf), self.task.allowed
        low, high = np.array(allowed.lower) / self.unit, np.array(allowed.upper) / self.unit
        return np.append(low, -free), np.append(high, free)

    def _around(self, start: Array) -> Callable[[Array], Rows]:
        """Return the constraints as many as at the start; large ones where nothing is settled.

        They raise what settling does where it has failed too often.
        """
        last = first = self.rows(start)
        failed = set[bytes]()

        def rows(y: Array) -> Rows:
            nonlocal last
            try:
                last = self.rows(y).sized(first)
            except OctoplanError:
                failed.add(y.tobytes())
                if len(failed) > _FAILURES:
                    raise
                return replace(last, values=np.full_like(first.values, -_UNSETTLED))
            return last

        return rows

    def solve(self, start: Array, visit: Callable[[Array], None]) -> Array:
        """Return the unknowns that steps lead to, each of which `visit` takes.

        Equalities that depend on others there, as of an arm that stays in its plane, are left out:
        whether they are met is looked at in the end.
        """
        rows, first, end = self._around(start), self.rows(start), start
        n, weights = first.equalities, np.where(np.arange(start.size) < self.n, 1.0, _COST)
        _, R, order = qr(first.jacobian[:n].T, mode="economic", pivoting=True)
        sizes = np.abs(np.diag(R))
        apart = np.sort(order[: sizes.size][sizes > _DEPENDENT * sizes.max(initial=0.0)])
        kinds = {"eq": apart, "ineq": np.arange(n, first.values.size)}
        constraints = [
            {
                "type": kind,
                "fun": lambda y, at=at: rows(y).values[at],
                "jac": lambda y, at=at: rows(y).jacobian[at],
            }
            for kind, at in kinds.items()
        ]

        def step(y: Array) -> None:
            nonlocal end
            with suppress(OctoplanError):
                self.rows(y)
                end = y.copy()
                visit(end)

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
        rows, (low, high) = self._around(start), self._bounds(start.size)
        high = np.maximum(high, low + 2 * _STEP)
        inside = np.clip(start, low + _STEP / 2, high - _STEP / 2)

        def jacobian(y: Array) -> Array:
            here = rows(y)
            return np.where(here.short[:, None] != 0, here.jacobian, 0.0)

        with suppress(OctoplanError):
            most = _SLSQP["maxiter"] // 2
            box = low, high
            end = least_squares(lambda y: rows(y).short, inside, jacobian, box, max_nfev=most)
            self.rows(end.x)
            return np.asarray(end.x)
        return start

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
