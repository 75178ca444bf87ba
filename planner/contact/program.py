"""Programs in the tensions of an arm in contact: its shape is settled, contacts sharp, for each.

    minimise    sum T^2 / 2
    subject to  equalities = 0, inequalities >= 0     of the targets, at the shape x(T)
                forces on each object that is held balance its wrench, tangential ones f in cones:
                n . f = 0, |f| <= mu N
                the least eigenvalue of the energy's Hessian >= a margin, where that is asked for
                lower <= T <= upper, sum T <= total pull

By the exact penalty of the violations' norm in a trust region, which steps over kinks where places
come and go (Fletcher, Practical Methods of Optimization, 1987, section 14.3). The shape's
derivatives are by the implicit function theorem; each step is a conic program, in which tangential
forces are unknowns within their cones. Where constraints cannot be met violations become least.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import casadi as ca
import clarabel
import numpy as np
from scipy.linalg import block_diag

from model.contact.touches import Touches, resultants, second
from model.equilibrium.linearised import Linearised
from model.equilibrium.stability import stability
from model.errors import UnsettledContactError
from model.loads import contacts
from model.paths import Array
from model.transcription.layout import POSE
from planner.contact.equilibria import Equilibria
from planner.contact.grasp import COST, Cone, Grasp, conic_program
from planner.program.limits import natural_tensions
from planner.program.terms import stations_of, target_numbers, terms_of
from planner.targets.hold import Hold

# Steps of differences in scaled tensions: of states, and of shapes settled anew.
_STEP, _CHANGE = 1e-6, 1e-4


@dataclass(frozen=True, eq=False)
class Step:
    """A step of least linearised merit.

    Attributes
    ----------
    change : (n,)
        Of scaled tensions.
    tangential : (2 k,)
        Forces on objects after it, along the bases of their grasps.
    decrease : float
        How much less the merit is by its model.
    multipliers : (2 n + m,)
        Of bounds above and below, then of the constraints as their cones have them; 0 for the
        violation, whose multiplier is the penalty.
    """

    change: Array
    tangential: Array
    decrease: float
    multipliers: Array

    @property
    def residual(self) -> float:
        """How far the first-order conditions are from being met, if it had the effort's Hessian."""
        return float(np.abs(self.change).max() / (1 + np.abs(self.multipliers).max()))

    @property
    def lam_bounds(self) -> Array:
        """The multipliers of limits (n,), above 0 at the upper ones."""
        n = self.change.size
        return self.multipliers[:n] - self.multipliers[n : 2 * n]

    @property
    def lam_stability(self) -> float:
        """The multiplier of the margin of stability, where there is one."""
        return -float(self.multipliers[2 * self.change.size])


@dataclass(frozen=True, eq=False)
class Constraints:
    """Constraints at an equilibrium, linearised in scaled tensions (n,).

    Attributes
    ----------
    point : Linearised
    tensions, low, high : (n,)
        Scaled, and their bounds.
    equal, unequal : (m, 1 + n)
        Residuals, and inequalities, met at 0 and above; then their derivatives. The first
        inequality is the margin of stability, where there is one.
    grasps : tuple of Grasp
        Of the objects held.
    grasp_rates : (n, m)
        The derivatives of their numbers, see `numbers_of`.
    tangential : (2 k,)
        Forces on objects at which they are linearised, along the bases of their grasps.
    """

    point: Linearised
    tensions: Array
    low: Array
    high: Array
    equal: Array
    unequal: Array
    grasps: tuple[Grasp, ...]
    grasp_rates: Array
    tangential: Array

    @cached_property
    def violation(self) -> float:
        """The norm of all violations, with the best tangential forces."""
        short = np.minimum(self.unequal[:, 0], 0.0)
        left = [grasp.least for grasp in self.grasps]
        return float(np.linalg.norm(np.concatenate([self.equal[:, 0], short, *left])))

    def merit(self, penalty: float) -> float:
        """Return half of the squared norm of scaled tensions, and the penalty of the violation."""
        return float(self.tensions @ self.tensions) / 2 + penalty * self.violation

    @cached_property
    def cones(self) -> list[Cone]:
        """The linearised constraints, as cones of unknowns.

        These are changes of tensions, tangential forces, slacks of inequalities, the violation.
        """
        n, k, q = self.tensions.size, self.tangential.size, len(self.unequal)
        T, f, slack, t = np.split(np.eye(n + k + q + 1), np.cumsum([n, k, q]))
        still, most, columns = numbers_of(self.grasps)
        m, rates = still.size, self.grasp_rates.T
        by_columns = rates[m + most.size :].reshape(m, k, n)
        by_wrench = rates[:m] + np.einsum("mkn,k->mn", by_columns, self.tangential)
        left = [t, self.equal[:, 1:] @ T, by_wrench @ T + columns @ f, slack]
        values = [np.zeros(1), self.equal[:, 0], still, np.zeros(q)]
        cones: list[Cone] = [
            (clarabel.NonnegativeConeT, self.unequal[:, 1:] @ T + slack, self.unequal[:, 0]),
            (clarabel.SecondOrderConeT, np.vstack(left), np.concatenate(values)),
        ]
        for i, bound in enumerate(most):
            rows = np.vstack([rates[m + i] @ T, f[2 * i : 2 * i + 2]])
            cones.append((clarabel.SecondOrderConeT, rows, np.array([bound, 0.0, 0.0])))
        return cones

    @property
    def by_tensions(self) -> Array:
        """The rows of the cones against tensions (m, n)."""
        return np.vstack([rows[:, : self.tensions.size] for _, rows, _ in self.cones])

    def step(self, hessian: Array, radius: Array, penalty: float) -> Step:
        """Return the step of least merit in a trust region (n,), by the Lagrangian's Hessian.

        Raises UnsettledContactError if none is found.
        """
        n, k, size = self.tensions.size, self.tangential.size, self.cones[0][1].shape[1]
        T, f, (*_, t) = np.split(np.eye(size), [n, n + k])
        above = np.minimum(self.high - self.tensions, radius)
        bounds = np.append(above, np.minimum(self.tensions - self.low, radius))
        limits = (clarabel.NonnegativeConeT, np.vstack([-T, T]), bounds)
        H = T.T @ hessian @ T + COST * f.T @ f
        cost = T.T @ self.tensions + penalty * t
        solution = conic_program(H, cost, [limits, *self.cones])
        if solution is None:
            raise UnsettledContactError(1.0, "no step is found")
        x, lam = solution
        lam[2 * n + len(self.unequal)] = 0.0
        decrease = penalty * self.violation - x @ (cost + H @ x / 2)
        return Step(x[:n], x[n : n + k], float(decrease), lam)


def numbers_of(grasps: tuple[Grasp, ...]) -> tuple[Array, Array, Array]:
    """Return wrenches left without tangential forces (m,), bounds (k,) and columns (m, 2 k)."""
    still = np.concatenate([np.zeros(0), *(grasp.still for grasp in grasps)])
    most = np.concatenate([np.zeros(0), *(grasp.friction * grasp.normal for grasp in grasps)])
    columns = block_diag(*(grasp.columns for grasp in grasps))
    return still, most, columns[: still.size, : 2 * most.size]


class TensionProgram:
    """The program of a task in scaled tensions, near an equilibrium.

    Attributes
    ----------
    unit : float
        Of tensions [N].
    least : float
        The stability that shapes are held to; none with 0.
    """

    def __init__(self, equilibria: Equilibria, begin: Linearised, least: float = 0.0) -> None:
        self.task, self.least, task = equilibria.task, least, equilibria.task
        self._equilibria, self._begin = equilibria, begin
        self.unit, self.n = float(natural_tensions(task.arm).max()), task.arm.n_tendons
        self._holds = [target for target in task.targets if isinstance(target, Hold)]
        self._stations = stations_of(task.arm, task.targets)
        self._numbers = target_numbers(task.arm, task.targets)

    @cached_property
    def _terms(self) -> ca.Function:
        """Poses, numbers -> equalities and soft residuals, inequalities, their derivatives."""
        terms = terms_of(self.task.arm, self.task.targets).function
        poses = ca.MX.sym("poses", *terms.size_in(0))
        numbers = ca.MX.sym("numbers", *terms.size_in(1))
        equality, soft, inequality, _ = terms(poses, numbers, ca.MX(0, 1))
        rows = [ca.vertcat(equality, soft), inequality]
        return ca.Function(
            "terms",
            [poses, numbers],
            [ca.densify(ca.horzcat(row, ca.jacobian(row, poses))) for row in rows],
        )

    def at(self, tensions: Array, near: Linearised, tangential: Array | None = None) -> Constraints:
        """Return the constraints at scaled tensions, next to an equilibrium; raises as settling.

        Linearised at tangential forces, or the best ones where others touch, or none are given.
        """
        allowed = self.task.allowed
        low, high = np.array(allowed.lower) / self.unit, np.array(allowed.upper) / self.unit
        # Steps are within limits to the rounding of the conic program.
        tensions = np.clip(tensions, low, high)
        point, by_tensions = self._beside(tensions, near)
        system = point.system
        places = system.of.nodes[[system.mesh.node(s) for s in self._stations], :POSE]
        by_poses = block_diag(1.0, self.unit * by_tensions[places.ravel()])
        terms = self._terms(point.states[places].T, self._numbers)
        equal, unequal = (np.array(each) @ by_poses for each in terms)
        if self.least:
            unequal = np.vstack([self._margin(point, tensions), unequal])
        if allowed.total is not None:
            left = allowed.total / self.unit - tensions.sum()
            unequal = np.vstack([unequal, np.append(left, np.full(self.n, -1.0))])
        here, rates = self._grasps(point, self.unit * by_tensions)
        if any(not grasp.normal.size for grasp in here):
            raise UnsettledContactError(1.0, "none is found in which the arm touches what it holds")
        best = np.concatenate([np.zeros(0), *(grasp.best for grasp in here)])
        f = best if tangential is None or tangential.size != best.size else tangential
        return Constraints(point, tensions, low, high, equal, unequal, here, rates, f)

    def _beside(self, tensions: Array, near: Linearised) -> tuple[Linearised, Array]:
        return self._equilibria.beside(self.unit * tensions, near, self._begin)

    def _grasps(self, point: Linearised, by_tensions: Array) -> tuple[tuple[Grasp, ...], Array]:
        """Return the grasps of an equilibrium, and the derivatives of their numbers."""
        system, arm = point.system, self.task.arm
        touches, bodies = Touches.of(system), contacts(system.scene)
        which, step = np.nonzero(touches.touching), _STEP * arm.length
        s = system.mesh.s[which[0]]
        before, after = np.split(point.at(np.append(s - step, s))[0][:, 4:], 2)
        tangents = (after - before) / step * touches.moves[which][:, None]

        def at(change: Array) -> tuple[Grasp, ...]:
            states = point.states + change
            moved = second(system, change)[which][:, None] * tangents
            places, forces = system.poses(states)[which[0], 4:] + moved, resultants(system, states)
            grasps = list[Grasp]()
            for hold in self._holds:
                on = np.array([bodies[j].obstacle == hold.obstacle for j in which[1]], dtype=bool)
                normals, gaps = (
                    f(places[on]) for f in (hold.obstacle.gradient, hold.obstacle.distance)
                )
                points = places[on] - gaps[:, None] * normals
                grasps.append(Grasp.at(arm, hold, points, normals, forces[which][on]))
            return tuple(grasps)

        def flat(change: Array) -> Array:
            return np.concatenate([each.ravel() for each in numbers_of(at(change))])

        steps = _STEP * by_tensions.T
        rates = [(flat(step) - flat(-step)) / (2 * _STEP) for step in steps]
        return at(0 * point.states), np.array(rates)

    def _margin(self, point: Linearised, tensions: Array) -> Array:
        """Return stability beyond what it is held to, and its derivatives by differences.

        Far from what it is held to these do not count.
        """
        beyond = stability(point) - self.least
        if beyond > self.least:
            return np.append(beyond, np.zeros(self.n))

        def at(step: Array) -> float:
            return stability(self._beside(tensions + step, point)[0])

        rates = [(at(step) - at(-step)) / (2 * _CHANGE) for step in _CHANGE * np.eye(self.n)]
        return np.append(beyond, rates)
