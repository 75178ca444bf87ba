"""An equilibrium verified by initial value integration, element by element, from its own wrenches.

From pose and wrench at each node, where collocation put them, eqs. (1), (3) of pose, moment and
force are integrated to the next node by an explicit Runge-Kutta scheme, and with friction by how
much the tendons have turned. At each of its stages the strains follow from the wrench there, by the
law of the cross-section linearised about strains that are known,

    v = v_0 + K (w - w_0),        K the inverse of dw/dv at v_0,

and again about what that gives, until the two differ by so little that its square is rounding.

What is found at the next node differs from what is there; the equilibrium that the integrator would
have is, to first order in that, one Newton step away, by the factorisation of the equilibrium.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache, partial

import casadi as ca
import numpy as np

from model.cross_section.law import join
from model.cross_section.sections import Sections
from model.effects import Current
from model.equilibrium.dense import coefficients, kink_angles, sliding_tensions
from model.equilibrium.linearised import Linearised
from model.errors import ConvergenceError
from model.integrators import RK8
from model.loads import beyond, contacts
from model.machine.buffered import Mapped
from model.mesh import estimate
from model.obstacles import distances, numbers_of
from model.paths import Array
from model.rotations import multiply, unit_matrix
from model.time_limit import check_time
from model.transcription.collocation import gauss
from model.transcription.element import Form, drag_force
from model.transcription.friction import hermite
from model.transcription.layout import POSE
from model.transcription.system import System

SCHEME = RK8
SUBSTEPS = (1, 2, 4, 8, 16)
# Strains that differ by less, relative to their size and 1, are linearised well enough: what that
# leaves is its square.
_LINEAR, _PASSES = 1e-5, 8


@dataclass(frozen=True, eq=False)
class Verified:
    """An equilibrium as an initial value integrator has it.

    Attributes
    ----------
    here : Linearised
        The equilibrium by collocation, at the corrected states.
    error : float
        Estimated error of the tip, over arm length.
    """

    point: Linearised
    error: float


def verified(point: Linearised, accuracy: float) -> Verified:
    """Return an equilibrium corrected by what an integrator says of it.

    Steps are halved until the corrections of two of them differ by less than an accuracy, over the
    arm's length. Raises ConvergenceError where they do not.
    """
    system, before, error = point.system, None, np.inf
    strains: Array | None = None
    scale = np.repeat([1.0, system.arm.length], [4, 3])
    for substeps in SUBSTEPS:
        check_time()
        x, elements = point.x.copy(), Integration(point, substeps)
        begin = elements.by_stages if strains is None else elements.within(strains)
        y, first = elements.run(begin)
        strains = first if strains is None else strains
        x[system.of.first :] -= point.solve(_defects(point, y))
        poses = system.poses(x[system.of.first :]) / scale
        if before is not None:
            error = estimate(float(np.abs(poses - before).max()), 1, 2, SCHEME.order)
            if error <= accuracy:
                return Verified(Linearised(system, x, point), error)
        before = poses
    raise ConvergenceError(accuracy, error, f"its check by {SCHEME.name} does not converge")


class Integration:
    """The elements of an equilibrium, each integrated from its first node by so many steps.

    What is known beforehand is by step, by node of the scheme and by element: (..., N).
    """

    def __init__(self, point: Linearised, substeps: int) -> None:
        self.point, of, load = point, point.system.of, point.x[point.system.of.n_tendons]
        self._form, self._h = of.form, np.diff(point.system.mesh.s)[:, None] / substeps
        self._share, self._sections, dead, drag = _places(point.system, substeps)
        self._shape = (*self._share.shape, of.elements)
        self._dead, self._drag = load * dead, drag * np.array([load, 1, 1, 1])[: drag.shape[-1]]
        if of.form.friction:
            self._friction = load * coefficients(point.system)
        if of.form.pressed:
            self._press()

    @property
    def by_stages(self) -> Array:
        """The strains (..., N, n) of the polynomials through the stages of collocation."""
        of, m = self.point.system.of, self._form.stages
        stages = self.point.states[of.stages].reshape(of.elements, m, -1).transpose(1, 0, 2)
        return np.asarray(np.tensordot(gauss(m).at(self._share), stages, 1))

    def within(self, strains: Array) -> Array:
        """Return those of the polynomials through others (nodes, N, n) that are one step's."""
        powers = np.arange(len(strains))
        basis = self._share[:, :, None] ** powers @ np.linalg.inv(
            np.array(SCHEME.samples)[:, None] ** powers
        )
        return np.asarray(np.tensordot(basis, strains, 1))

    def run(self, v: Array) -> tuple[Array, Array]:
        """Return the unknowns of the far nodes (N, n), and the strains of the first step.

        Begun about strains (..., N, n); NaN where none are found.
        """
        of, states = self.point.system.of, self.point.states
        begin = states[of.nodes[:-1, : of.node_size - of.touching]].copy()
        wrenches = slice(POSE, POSE + of.form.wrench)
        begin[:, wrenches] = self.point.system.wrenches_beyond(self.point.x)[:-1]
        for _ in range(_PASSES):
            self._linearise(v)
            y, result = begin, np.empty_like(v)
            for step, strains in enumerate(result):
                y = SCHEME.step(partial(self._rate, step, strains), y, self._h)
            change = np.abs(result - v) / (1 + np.abs(v))
            if not np.all(np.isfinite(change)) or change.max() <= _LINEAR:
                return y, result[0]
            v = result
        return np.full_like(begin, np.nan), v[0]

    def _linearise(self, v: Array) -> None:
        """Linearise the law of all cross-sections about strains (..., N, n)."""
        sections, form, flat = self._sections, self._form, v.reshape(-1, v.shape[-1])
        system, place, tendon = self.point.system, sections.place, sections.tendon
        pulls = sliding_tensions(system, self.point.x, sections.s, place, tendon)
        at = sections.balance(flat, pulls)
        self._v, self._wrench = v, at.wrench.reshape(v.shape)
        try:
            inverse = np.linalg.inv(at.jacobian)
        except np.linalg.LinAlgError:
            inverse = np.full_like(at.jacobian, np.nan)
        self._inverse = inverse.reshape(*self._shape, -1)
        if form.friction:
            n = system.of.n_tendons
            unit, slope = np.zeros((2, len(flat), n, flat.shape[1]))
            tensions, turning = np.zeros((2, len(flat), n))
            unit[place, tendon], tensions[place, tendon] = at.units, pulls
            turning[place, tendon], slope[place, tendon] = sections.turning(flat, self._rates())
            self._unit = unit.swapaxes(1, 2).reshape(*v.shape, n)
            self._slope = slope.reshape(*self._shape, n, -1)
            self._tensions, self._turning = (
                each.reshape(*self._shape, n) for each in (tensions, turning)
            )

    def _rates(self) -> Array:
        """Return the derivatives of the strains along s, by the polynomials through the stages."""
        of, states, m = self.point.system.of, self.point.states, self._form.stages
        weights = [hermite(m, x, 1) for x in self._share.ravel().tolist()]
        values, slopes = (np.array(part) for part in zip(*weights, strict=True))
        stages, rates = (states[at].reshape(of.elements, m, -1) for at in (of.stages, of.rates))
        h = np.diff(self.point.system.mesh.s)[:, None]
        result = np.einsum("pm,nmk->pnk", values, stages) / h
        result += np.einsum("pm,nmk->pnk", slopes, rates)
        return np.asarray(result.reshape(-1, of.form.strains))

    def _rate(self, step: int, strains: Array, stage: int, y: Array) -> Array:
        """Return y' (N, n) at a stage of a step, and leave the strains there."""
        k = SCHEME.samples.index(SCHEME.nodes[stage])
        at, form, w = (step, k), self._form, POSE + self._form.wrench
        wrench = self._wrench[at]
        if form.friction:
            pulls = self.point.tensions * np.exp(-self._friction * y[:, w:])
            wrench = wrench + _times(self._unit[at], pulls - self._tensions[at])
        inputs = [y[:, :w], self._v[at], wrench, self._inverse[at], self._dead[at], self._drag[at]]
        if form.pressed:
            normals = distances(self._bodies, y[:, 4:POSE])[1]
            inputs.append(np.einsum("nk,nki->ni", self._pressure[at], normals))
            inputs.append(self._traction[at])
        rates, strains[k] = _rates(form)(*inputs)
        if not form.friction:
            return rates
        turning = self._turning[at] + _times(self._slope[at], strains[k] - self._v[at])
        return np.hstack([rates, turning])

    def _press(self) -> None:
        """Note what presses and rubs where the arm lies on obstacles, linear between nodes."""
        system, states, form = self.point.system, self.point.states, self._form
        of, x = system.of, self._share[:, :, None, None, None]
        numbers = system.p[of.equations.numbers_of("pressure")]
        lies = numbers.reshape(of.elements, form.contacts, -1)[:, :, -1:]

        def linear(values: Array) -> Array:
            return np.asarray(lies * ((1 - x) * values[:-1] + x * values[1:]))

        self._bodies = numbers_of([contact.obstacle for contact in contacts(system.scene)])
        self._pressure = linear(states[of.touches[:, :, 1:]])[..., 0]
        self._traction = np.zeros((*self._shape, 3))
        if form.contact_friction:
            self._traction += linear(states[of.tractions]).sum(axis=3)


@lru_cache(maxsize=32)
def _places(system: System, substeps: int) -> tuple[Array, Sections, Array, Array]:
    """Return what does not depend on states where the scheme looks, by step, node and element.

    Shares of the elements (substeps, nodes), cross-sections, the dead forces beyond (..., 3) [N],
    and of a stream what its drag is in proportion to, and velocity (..., 4).
    """
    arm, scene, mesh, form = system.arm, system.scene, system.mesh, system.of.form
    share = (np.arange(substeps)[:, None] + np.array(SCHEME.samples)) / substeps
    s = (mesh.s[:-1] + share[:, :, None] * np.diff(mesh.s)).ravel()
    active, end = np.tile(mesh.active, share.size), np.tile(mesh.s[1:], share.size)
    sections = Sections(arm, scene, form.law, s, active, form.machine_code)
    shape, current = (*share.shape, mesh.steps), scene.find(Current)
    dead, drag = beyond(arm, scene, s, end).T.reshape(*shape, 3), np.zeros((*shape, 0))
    if current and form.current:
        R = arm.radius.evaluate(s, arm.length)[0].reshape(*shape, 1)
        velocity = np.broadcast_to(current.velocity, (*shape, 3))
        drag = np.concatenate([current.density * current.coefficient * R, velocity], axis=3)
    return share, sections, dead, drag


@lru_cache(maxsize=32)
def _rates(form: Form) -> Mapped:
    """Return the equations along s: pose and wrench of a cross-section -> their derivatives, v.

    Further arguments are v_0, w_0 and K (see above), the dead force beyond, drag and velocity of a
    stream, and with pressure what presses, base frame, and rubs, local frame, per length.
    """
    law, n = form.law, form.strains
    y, known, wrench = ca.SX.sym("y", POSE + form.wrench), ca.SX.sym("v", n), ca.SX.sym("w", n)
    inverse, dead = ca.SX.sym("inverse", n, n), ca.SX.sym("dead", 3)
    drag = ca.SX.sym("drag", 4 * form.current)
    presses, rubs = (ca.SX.sym(name, 3 * form.pressed) for name in ("presses", "rubs"))
    q, frame = y[:4], unit_matrix(y[:4])
    F = dead + y[POSE + 3 :] if form.moving else dead
    M, force = y[POSE : POSE + 3] if form.loaded else ca.SX.zeros(3), frame.T @ F
    v = known + inverse.T @ (join(law, frame.T @ M, force[0], force[1:]) - wrench)
    kappa, nu = law.twist(v)
    along = frame @ nu
    rates = [multiply(q, ca.vertcat(0, kappa)) / 2, along]
    if form.loaded:
        rates.append(-ca.cross(along, F))
    if form.moving:
        f = drag_force(frame[:, 0], nu, drag[0], drag[1:]) if form.current else ca.SX.zeros(3)
        rates.append(-(f + presses + frame @ rubs if form.pressed else f))
    inputs = [y, known, wrench, ca.vec(inverse), dead, drag]
    inputs += [presses, rubs] * form.pressed
    function = ca.Function("rates", inputs, [ca.vertcat(*rates), v], {"cse": True})
    return Mapped(function, form.machine_code)


def _times(A: Array, v: Array) -> Array:
    """Return the products (N, n) of matrices (N, n, m) and vectors (N, m)."""
    return np.asarray((A @ v[:, :, None])[:, :, 0])


def _defects(point: Linearised, y: Array) -> Array:
    """Return by how much nodes miss what the integrator finds there, y (N, n); (n_states,)."""
    of, states = point.system.of, point.states
    missed = np.zeros(of.n_states)
    there, w = of.nodes[1:, : y.shape[1]], of.form.wrench
    missed[there[:, :POSE]] = states[there[:, :POSE]] - y[:, :POSE]
    if not w:
        return missed
    wrenches = np.zeros(of.n_states)
    wrenches[there[:, POSE : POSE + w]] = y[:, POSE : POSE + w] - states[there[:, POSE : POSE + w]]
    # What an element makes of another wrench beyond it; a node's own wrench is left out.
    left = wrenches - point.times(wrenches)
    stages = of.inside.ravel()
    missed[of.nodes[:, POSE : POSE + w]] = left[of.nodes[:, POSE : POSE + w]]
    missed[stages] = left[stages]
    missed[of.turned[1:]] = (states[there] - y)[:, POSE + w :] - _kinks(point)
    return missed


def _kinks(point: Linearised) -> Array:
    """Return by how much each tendon turns at the far node of each element (N, n_tendons)."""
    of = point.system.of
    values = np.zeros((of.elements, of.n_tendons * of.form.friction))
    k, j = of.kinks
    if of.form.friction and k.size:
        values[k, j] = -kink_angles(point.system, point.x)
    return values
