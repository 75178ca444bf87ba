"""Elements of an equilibrium, or parts of them, integrated as initial value problems.

From pose and wrench at the node below, where collocation put them, eqs. (1), (3) of pose, moment
and force are integrated by an explicit Runge-Kutta scheme, and with friction by how much the
tendons have turned. At each of its stages the strains follow from the wrench there, by the law of
the cross-section linearised about strains that are known,

    v = v_0 + K (w - w_0),        K the inverse of dw/dv at v_0,

and again about what that gives, until the two differ by so little that its square is rounding.

So poses and strains between the nodes are as accurate as at the nodes.
"""

from __future__ import annotations

from functools import lru_cache, partial

import casadi as ca
import numpy as np

from octoplan.model.cross_section.law import join
from octoplan.model.cross_section.sections import Sections
from octoplan.model.effects import Current
from octoplan.model.extensions.contact.effects import bodies_of
from octoplan.model.extensions.obstacles import distances
from octoplan.model.integrators import RK8
from octoplan.model.loads import beyond
from octoplan.model.paths import Array
from octoplan.model.rod.collocation import gauss
from octoplan.model.rod.element import Form, drag_force
from octoplan.model.rod.friction import hermite, turning_function
from octoplan.model.rod.kernels import Places
from octoplan.model.rod.layout import POSE
from octoplan.model.rod.numbers import friction_coefficients
from octoplan.model.rod.system import DiscreteRod
from octoplan.model.rotations import multiply, unit_matrix
from octoplan.model.support.machine.functions import BatchFunction, cached

SCHEME = RK8
# Strains that differ by less, relative to their size and 1, are linearised well enough: what that
# leaves is its square.
_LINEAR, _PASSES = 1e-5, 8
_SAMPLES = np.array(SCHEME.samples)


class Integration:
    """Parts of elements (P,), each integrated from the node below by so many steps.

    What is known beforehand is by step, by node of the scheme and by part: (..., P).

    Parameters
    ----------
    x : (n_x,)
        Tensions, load factor and states.
    parts : (P,), (P,)
        Elements, and the shares of them that are integrated; all of each unless given.
    """

    def __init__(
        self,
        system: DiscreteRod,
        x: Array,
        substeps: int = 1,
        parts: tuple[Places, Array] | None = None,
    ) -> None:
        of, load = system.layout, x[system.layout.n_tendons]
        self._system, self._x, self._states, self._form = system, x, x[of.first :], of.form
        self._elements, reach = parts or (np.arange(of.elements), np.ones(of.elements))
        places = _places(system, substeps, *parts) if parts else _whole(system, substeps)
        self._share, self._sections, dead, drag = places
        self._length = np.diff(system.mesh.s)[self._elements][:, None]
        self._h = reach[:, None] * self._length / substeps
        self._shape = self._share.shape
        self._dead, self._drag = load * dead, drag * np.array([load, 1, 1, 1])[: drag.shape[-1]]
        if of.form.friction:
            self._friction = load * friction_coefficients(system.arm, system.scene)
            # Derivatives of the strains along s, by the polynomials through the stages.
            m = of.form.stages
            weights = np.array([hermite(m, x, 1) for x in self._share.ravel().tolist()])
            values, slopes = np.moveaxis(weights, 1, 0).reshape(2, *self._share.shape, m)
            rates = self._through_stages(values, of.stages) / self._length
            rates += self._through_stages(slopes, of.rates)
            self._rates = rates.reshape(-1, of.form.strains)
        if of.form.pressed:
            self._press()

    def _through_stages(self, weights: Array, places: Places) -> Array:
        """Return the sums (..., P, n) of states at the stages of each part's element by weights."""
        rows = self._states[places].reshape(self._system.layout.elements, self._form.stages, -1)
        return np.asarray(np.einsum("...pm,pmn->...pn", weights, rows[self._elements]))

    def begin(self, before: Array | None = None) -> Array:
        """Return strains (..., P, n) to begin with.

        Where nothing couples the cross-sections what each has by itself: near places where one is
        all but crushed no polynomial is near enough. Else of the polynomials through the stages of
        collocation, or through those of one step an element `before` (nodes, P, n).
        """
        of = self._system.layout
        if not (of.form.loaded or of.form.friction):
            alone = self._sections.unloaded(self._x[None, : of.n_tendons])
            return alone.reshape(*self._shape, -1)
        if before is None:
            return self._through_stages(gauss(of.form.stages).at(self._share), of.stages)
        powers = np.arange(len(before))
        basis = self._share[:, :, :1] ** powers @ np.linalg.inv(_SAMPLES[:, None] ** powers)
        return np.asarray(np.tensordot(basis, before, 1))

    def run(self, v: Array, known: Array | None = None) -> tuple[Array, Array]:
        """Return pose, wrench and turning where the parts end (P, n), and strains (..., P, n).

        Begun about strains (..., P, n); NaN where none are found. The last are those at the ends,
        by pose and wrench that are `known` there (P, n), NaN where they are not.
        """
        of, states = self._system.layout, self._states
        begin = states[of.nodes[self._elements, : of.node_size - of.touching]]
        wrenches = slice(POSE, POSE + of.form.wrench)
        begin[:, wrenches] = self._system.wrenches_beyond(self._x)[self._elements]
        for _ in range(_PASSES):
            self._linearise(v)
            y, result = begin, np.empty_like(v)
            for step, strains in enumerate(result):
                y = SCHEME.step(partial(self._rate, step, strains), y, self._h)
            if known is not None:
                w = known.shape[1]
                y[:, :w] = np.where(np.isnan(known), y[:, :w], known)
            self._rate(len(result) - 1, result[-1], SCHEME.nodes.index(1.0), y)
            change = np.abs(result - v) / (1 + np.abs(v))
            if not np.all(np.isfinite(change)) or change.max(initial=0.0) <= _LINEAR:
                return y, result
            v = result
        return np.full_like(begin, np.nan), np.full_like(v, np.nan)

    def _linearise(self, v: Array) -> None:
        """Linearise the law of all cross-sections about strains (..., P, n)."""
        sections, form, flat = self._sections, self._form, v.reshape(-1, v.shape[-1])
        system, place, tendon = self._system, sections.place, sections.tendon
        pulls = sliding_tensions(system, self._x, sections.s, place, tendon)
        at = sections.balance(flat, pulls)
        self._v, self._wrench = v, at.wrench.reshape(v.shape)
        try:
            inverse = np.linalg.inv(at.jacobian)
        except np.linalg.LinAlgError:
            inverse = np.full_like(at.jacobian, np.nan)
        self._inverse = inverse.reshape(*v.shape, v.shape[-1])
        if form.friction:
            n = system.layout.n_tendons
            unit, slope = np.zeros((2, len(flat), n, flat.shape[1]))
            tensions, turning = np.zeros((2, len(flat), n))
            unit[place, tendon], tensions[place, tendon] = at.units, pulls
            turning[place, tendon], slope[place, tendon] = sections.turning(flat, self._rates)
            self._unit = unit.swapaxes(1, 2).reshape(*v.shape, n)
            self._slope = slope.reshape(*self._shape, n, -1)
            self._tensions, self._turning = (
                each.reshape(*self._shape, n) for each in (tensions, turning)
            )

    def _rate(self, step: int, strains: Array, stage: int, y: Array) -> Array:
        """Return y' (P, n) at a stage of a step, and leave the strains there."""
        k = SCHEME.samples.index(SCHEME.nodes[stage])
        at, form, w = (step, k), self._form, POSE + self._form.wrench
        wrench = self._wrench[at]
        if form.friction:
            pulls = self._x[: self._system.layout.n_tendons] * np.exp(-self._friction * y[:, w:])
            wrench = wrench + np.einsum("pnm,pm->pn", self._unit[at], pulls - self._tensions[at])
        inputs = [y[:, :w], self._v[at], wrench, self._inverse[at], self._dead[at], self._drag[at]]
        if form.pressed:
            normals = distances(self._bodies, y[:, 4:POSE])[1]
            inputs.append(np.einsum("nk,nki->ni", self._pressure[at], normals))
            inputs.append(self._traction[at])
        rates, strains[k] = cached(_rates, form)(*inputs)
        if not form.friction:
            return np.asarray(rates)
        change = strains[k] - self._v[at]
        turning = self._turning[at] + np.einsum("pnm,pm->pn", self._slope[at], change)
        return np.hstack([rates, turning])

    def _press(self) -> None:
        """Note what presses and rubs where the arm lies on obstacles, linear between nodes."""
        system, states, form = self._system, self._states, self._form
        of, x = system.layout, self._share[:, :, :, None, None]
        numbers = system.p[of.equations.numbers_of("pressure")]
        lies = numbers.reshape(of.elements, form.contacts, -1)[self._elements, :, -1:]

        def linear(values: Array) -> Array:
            before, after = values[self._elements], values[self._elements + 1]
            return np.asarray(lies * ((1 - x) * before + x * after))

        self._bodies = bodies_of(system.scene)
        self._pressure = linear(states[of.touches[:, :, 1:]])[..., 0]
        self._traction = np.zeros((*self._shape, 3))
        if form.contact_friction:
            self._traction += linear(states[of.tractions]).sum(axis=3)


@lru_cache(maxsize=32)
def _whole(system: DiscreteRod, substeps: int) -> tuple[Array, Sections, Array, Array]:
    """Return what `_places` does of whole elements."""
    return _places(system, substeps, np.arange(system.mesh.steps), np.ones(system.mesh.steps))


def _places(
    system: DiscreteRod, substeps: int, elements: Places, reach: Array
) -> tuple[Array, Sections, Array, Array]:
    """Return what does not depend on states where the scheme looks, by step, node and part.

    Shares of the elements (substeps, nodes, P), cross-sections, the dead forces beyond (..., 3)
    [N], and of a stream what its drag is in proportion to, and velocity (..., 4).
    """
    arm, scene, mesh, form = system.arm, system.scene, system.mesh, system.layout.form
    share = (np.arange(substeps)[:, None] + _SAMPLES)[:, :, None] / substeps * reach
    s = (mesh.s[elements] + share * np.diff(mesh.s)[elements]).ravel()
    active = np.broadcast_to(mesh.active[elements], share.shape).ravel()
    end = np.broadcast_to(mesh.s[1:][elements], share.shape).ravel()
    sections = Sections(arm, scene, form.law, s, active, form.machine_code)
    dead, drag = beyond(arm, scene, s, end).T.reshape(*share.shape, 3), np.zeros((*share.shape, 0))
    current = scene.find(Current)
    if current and form.current:
        R = arm.radius.evaluate(s, arm.length)[0].reshape(*share.shape, 1)
        velocity = np.broadcast_to(current.velocity, (*share.shape, 3))
        drag = np.concatenate([current.density * current.coefficient * R, velocity], axis=3)
    return share, sections, dead, drag


def _rates(form: Form) -> BatchFunction:
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
    return BatchFunction(function, form.machine_code)


def poses_and_strains(system: DiscreteRod, x: Array, s: Array) -> tuple[Array, Array]:
    """Return poses (N, 7), and strains (N, n) on the base side of arc lengths s (N,).

    Poses and wrenches at nodes are those of the states. Strains balance the wrench there by the law
    of the cross-section.
    """
    mesh = system.mesh
    elements = np.clip(np.searchsorted(mesh.s, s) - 1, 0, mesh.steps - 1)
    reach = (s - mesh.s[elements]) / np.diff(mesh.s)[elements]
    at_nodes = x[
        system.layout.first + system.layout.nodes[elements + 1, : POSE + system.layout.form.wrench]
    ]
    known = np.where(reach[:, None] < 1, np.nan, at_nodes)
    parts = Integration(system, x, 1, (elements, reach))
    y, strains = parts.run(parts.begin(), known)
    return y[:, :POSE], strains[-1, -1]


def sliding_tensions(at: DiscreteRod, x: Array, s: Array, place: Places, tendon: Places) -> Array:
    """Return the tensions (P,) of tendons where they cross arc lengths s[place], unknowns x."""
    T, of = x[tendon], at.layout
    if not of.form.friction:
        return np.asarray(T)
    m, (k, j) = of.form.stages, of.passages
    h, node = np.diff(at.mesh.s), of.first + of.turned
    inside = of.inside[:, k] + of.first
    y = np.vstack(
        [np.full(k.size, x[of.n_tendons]), x[j], x[node[k, j]], x[node[k + 1, j]], x[inside]]
    )
    numbers = at.p[of.equations.numbers_of("sliding_tendon")].reshape(k.size, -1).T
    rates = np.zeros((at.mesh.steps, of.n_tendons, m))
    rates[k, j] = np.array(cached(turning_function, of.form.law, m).map(k.size)(y, numbers)).T
    element = np.clip(np.searchsorted(at.mesh.s, s[place]) - 1, 0, at.mesh.steps - 1)
    share = (s[place] - at.mesh.s[element]) / h[element]
    powers = np.arange(1, m + 1)
    weights = share[:, None] ** powers / powers @ gauss(m).powers
    grows = h[element] * (weights * rates[element, tendon]).sum(axis=1)
    turned = x[node[element, tendon]] + grows
    mu = friction_coefficients(at.arm, at.scene)[tendon]
    return np.asarray(T * np.exp(-x[of.n_tendons] * mu * turned))
