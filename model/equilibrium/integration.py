"""One step of an explicit Runge-Kutta scheme across all elements of an equilibrium.

The equations are (1), (3) of pose, moment and force along s, and with friction those of how far the
tendons have turned. At each node of the scheme the strains follow from the wrench there, by the law
of the cross-section linearised about strains that are known,

    v = v_0 + K (w - w_0),        K the inverse of dw/dv at v_0,

and again about what that gives, until the two differ by so little that its square is rounding.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import casadi as ca
import numpy as np

from model.cross_section.law import join, size
from model.cross_section.sections import Sections
from model.effects import Current
from model.equilibrium.dense import coefficients, sliding_tensions
from model.integrators import RK8
from model.loads import beyond, is_loaded
from model.machine.buffered import Mapped
from model.obstacles.base import SIZE, with_gradient
from model.paths import Array
from model.rotations import multiply, unit_matrix
from model.transcription.collocation import gauss
from model.transcription.element import Form
from model.transcription.friction import hermite
from model.transcription.layout import POSE
from model.transcription.system import System

SCHEME = RK8
# Under the root of a stream's speed, which may vanish.
_TINY = 1e-30


class Symbols:
    """Numbers of an element: once, then by node of the scheme; see _Part."""

    def __init__(self, form: Form, n_tendons: int) -> None:
        n, t, K = size(form.law), n_tendons, form.contacts * form.pressed
        self.h, self.load = ca.SX.sym("h"), ca.SX.sym("load")
        self.velocity = ca.SX.sym("velocity", 3 * form.current)
        self.T, self.mu = ca.SX.sym("T", t), ca.SX.sym("mu", t)
        self.bodies = ca.SX.sym("bodies", SIZE, K)
        self.at = [Node(n, form.current, t, K) for _ in SCHEME.samples]
        once = (self.h, self.load, self.velocity, self.T, self.mu, ca.vec(self.bodies))
        self.all = ca.vertcat(*once, *(node.all for node in self.at))


class Node:
    """Numbers of an element at a node of the scheme.

    Strains about which the law is linearised, the wrench there, how strains follow the wrench, dead
    loads beyond, drag; with friction the tendons' wrenches per newton, tensions, turning and its
    derivatives; what presses and rubs.
    """

    def __init__(self, n: int, current: bool, t: int, K: int) -> None:
        self.v, self.wrench = ca.SX.sym("v", n), ca.SX.sym("wrench", n)
        self.inverse = ca.SX.sym("inverse", n, n)
        self.dead, self.drag = ca.SX.sym("dead", 3), ca.SX.sym("drag", int(current))
        self.unit, self.pulls = ca.SX.sym("unit", n, t), ca.SX.sym("pulls", t)
        self.turning, self.slope = ca.SX.sym("turning", t), ca.SX.sym("slope", n, t)
        self.pressure = ca.SX.sym("pressure", K)
        self.traction = ca.SX.sym("traction", 3 * (K > 0))
        self.all = ca.vertcat(*(ca.vec(part) for part in vars(self).values()))


@lru_cache(maxsize=32)
def integrated_step(form: Form, n_tendons: int) -> Mapped:
    """Return (a node's unknowns, numbers) -> these after a step, the strains at SCHEME's nodes."""
    numbers = Symbols(form, n_tendons)
    y = ca.SX.sym("y", POSE + form.wrench + n_tendons)
    entries: dict[float, ca.SX] = {}

    def rate(i: int, inner: ca.SX) -> ca.SX:
        c = SCHEME.nodes[i]
        along, v = _rate(form, numbers, numbers.at[SCHEME.samples.index(c)], inner)
        entries[c] = v  # the last stage at a node is the most accurate
        return along

    after = SCHEME.step(rate, y, numbers.h)
    strains = ca.vertcat(*(entries[c] for c in SCHEME.samples))
    step = ca.Function("integrated", [y, numbers.all], [after, strains], {"cse": True})
    return Mapped(step, form.machine_code)


def _rate(form: Form, numbers: Symbols, node: Node, y: ca.SX) -> tuple[ca.SX, ca.SX]:
    """Return y' and the strains."""
    q, u = y[:4], y[4:POSE]
    M = y[POSE : POSE + 3] if form.loaded else ca.SX.zeros(3)
    frame, F, w = unit_matrix(q), numbers.load * node.dead, POSE + form.wrench
    F = F + y[POSE + 3 : w] if form.moving else F
    local = frame.T @ F
    violation = join(form.law, frame.T @ M, local[0], local[1:]) - node.wrench
    if form.friction:
        pulls = numbers.T * ca.exp(-numbers.load * numbers.mu * y[w:])
        violation -= node.unit @ (pulls - node.pulls)
    v = node.v + node.inverse @ violation
    kappa, nu = form.law.twist(v)
    along = frame @ nu
    rates = [multiply(q, ca.vertcat(0, kappa)) / 2, along]
    if form.loaded:
        rates.append(-ca.cross(along, F))
    if form.moving:
        rates.append(-_pushed(form, numbers, node, u, frame, nu))
    return ca.vertcat(*rates, node.turning + node.slope.T @ (v - node.v)), v


def _pushed(form: Form, numbers: Symbols, node: Node, u: ca.SX, frame: ca.SX, nu: ca.SX) -> ca.SX:
    """Return the force per reference length that depends on the shape (3,) [N/m]."""
    values, t = ca.SX.zeros(3), frame[:, 0]
    if form.current:
        across = numbers.velocity - t * ca.dot(t, numbers.velocity)
        speed = ca.sqrt(ca.sumsqr(across) + _TINY)
        values += numbers.load * node.drag * nu[0] * speed * across
    for k in range(node.pressure.numel()):
        values += node.pressure[k] * with_gradient()(u, numbers.bodies[:, k])[1]
    return values + frame @ node.traction if node.pressure.numel() else values


# Strains that differ by less, relative to their size and 1, are linearised well enough: what that
# leaves is its square.
_LINEAR, _PASSES = 1e-5, 8


class Integration:
    """The integration of an equilibrium's elements, from what is at their first nodes.

    Parameters
    ----------
    y : (N, n)
        Unknowns of the nodes before the elements.
    """

    def __init__(self, system: System, x: Array, y: Array) -> None:
        self.system, self.x, self.y = system, x, y
        self._known: Array | None = None

    def run(self, substeps: int) -> Array:
        """Return the nodes' unknowns (N, n) after the elements, by so many steps in each.

        NaN where the strains are not found.
        """
        part = _Part(self.system, self.x, substeps)
        v = part.by_stages() if self._known is None else part.by_nodes(self._known)
        for _ in range(_PASSES):
            numbers, result, y = part.numbers(v), np.empty_like(v), self.y
            for k in range(substeps):
                y, result[k] = part.step(y, numbers[k])
            change = np.abs(result - v) / (1 + np.abs(v))
            if not np.all(np.isfinite(change)) or change.max() <= _LINEAR:
                self._known = result[0] if substeps == 1 else self._known
                return y
            v = result
        return np.full_like(self.y, np.nan)


@dataclass(frozen=True, eq=False)
class _Places:
    """What does not depend on the states, at places x of the elements, by step, node, element.

    Attributes
    ----------
    x : (substeps, nodes)
        Shares of the elements.
    sections : Sections
        Of all places, one after the other.
    dead : (places, 3)
        The resultant of the dead loads beyond [N].
    drag : (places, 1)
        What the drag is in proportion to [N s2/m3].
    """

    x: Array
    sections: Sections
    dead: Array
    drag: Array


@lru_cache(maxsize=32)
def _places(system: System, substeps: int) -> _Places:
    arm, scene, mesh = system.arm, system.scene, system.mesh
    x = (np.arange(substeps)[:, None] + np.array(SCHEME.samples)) / substeps
    h = np.diff(mesh.s)
    s = (mesh.s[:-1] + x[:, :, None] * h).ravel()
    form = system.of.form
    sections = Sections(arm, scene, form.law, s, np.tile(mesh.active, x.size), form.machine_code)
    dead = np.zeros((s.size, 3))
    if is_loaded(scene):
        dead = beyond(arm, scene, s, np.tile(mesh.s[1:], x.size)).T
    current, drag = scene.find(Current), np.zeros((s.size, 0))
    if current:
        R = arm.radius.evaluate(s, arm.length)[0]
        drag = (current.density * current.coefficient * R)[:, None]
    return _Places(x, sections, dead, drag)


class _Part:
    """The steps of all elements, by numbers; arrays are (substeps, nodes, N, ...)."""

    def __init__(self, system: System, x: Array, substeps: int) -> None:
        self.system, self.x, self.at = system, x, _places(system, substeps)
        self.of, self.form = system.of, system.of.form
        self.N, self.states = self.of.elements, x[self.of.first :]
        self.shape = (*self.at.x.shape, self.N)
        h = np.diff(system.mesh.s)[:, None] / substeps
        current = system.scene.find(Current)
        velocity = current.velocity if current else ()
        once = [h, np.full((self.N, 1), x[self.of.n_tendons]), np.tile(velocity, (self.N, 1))]
        if self.form.friction:
            each = x[: self.of.n_tendons], coefficients(system)
            once += [np.tile(item, (self.N, 1)) for item in each]
        if self.form.pressed:
            once.append(self._pressing()[:, :, :SIZE].reshape(self.N, -1))
        self.once = np.hstack(once)

    def by_stages(self) -> Array:
        """Return the strains of the polynomials through the stages."""
        m = self.form.stages
        v = self.states[self.of.stages].reshape(self.N, m, -1)
        return self._at(gauss(m).powers, v.transpose(1, 0, 2))

    def by_nodes(self, v: Array) -> Array:
        """Return those of the polynomials through the scheme's nodes (nodes, N, n)."""
        return self._at(_powers(), v)

    def _at(self, powers: Array, v: Array) -> Array:
        basis = self.at.x[:, :, None] ** np.arange(len(powers)) @ powers
        return np.asarray(np.tensordot(basis, v, 1))

    def numbers(self, v: Array) -> Array:
        """Return the numbers (substeps, N, n) of the law linearised about strains, and of loads."""
        sections, flat = self.at.sections, v.reshape(-1, v.shape[-1])
        pulls = sections.pulls(self.x)
        if self.form.friction:
            pulls = sliding_tensions(
                self.system, self.x, sections.s, sections.place, sections.tendon
            )
        at = sections.balance(flat, pulls)
        parts = [
            flat,
            at.wrench,
            _inverse(at.jacobian).transpose(0, 2, 1).reshape(len(flat), -1),
            self.at.dead,
            self.at.drag,
        ]
        if self.form.friction:
            parts += self._sliding(flat, pulls, at.units)
        if self.form.pressed:
            parts += [self._pressures(), self._tractions()]
        rows = np.hstack(parts).reshape(*self.shape, -1)
        by_element = rows.transpose(0, 2, 1, 3).reshape(self.shape[0], self.N, -1)
        once = np.broadcast_to(self.once, (self.shape[0], *self.once.shape))
        return np.concatenate([once, by_element], axis=2)

    def step(self, y: Array, numbers: Array) -> tuple[Array, Array]:
        """Return the nodes' unknowns (N, n) after a step, and strains (nodes, N, n) within it."""
        step = integrated_step(self.form, self.of.n_tendons * self.form.friction)
        after, strains = step(y, numbers)
        return after, strains.reshape(self.N, self.shape[1], -1).transpose(1, 0, 2)

    def _sliding(self, flat: Array, pulls: Array, units: Array) -> list[Array]:
        """Return wrench per newton, tension, turning and its Jacobian of tendons at all places."""
        sections, n = self.at.sections, self.of.n_tendons
        unit, slope = np.zeros((2, len(flat), n, flat.shape[1]))
        tensions, turning = np.zeros((2, len(flat), n))
        at = sections.place, sections.tendon
        unit[at], tensions[at] = units, pulls
        weights = [hermite(self.form.stages, x, 1) for x in self.at.x.ravel().tolist()]
        values, jacobian = (np.array(part) for part in zip(*weights, strict=True))
        m, h = self.form.stages, np.diff(self.system.mesh.s)
        stages = self.states[self.of.stages].reshape(self.N, m, -1)
        rates = self.states[self.of.rates].reshape(self.N, m, -1)
        rate = np.einsum("pm,nmk->pnk", values, stages) / h[:, None]
        rate += np.einsum("pm,nmk->pnk", jacobian, rates)
        turning[at], slope[at] = sections.turning(flat, rate.reshape(len(flat), -1))
        return [unit.reshape(len(flat), -1), tensions, turning, slope.reshape(len(flat), -1)]

    def _pressing(self) -> Array:
        """Return the numbers of what presses (N, contacts, n)."""
        values = self.system.p[self.of.equations.numbers_of("pressure")]
        return np.asarray(values.reshape(self.N, self.form.contacts, -1))

    def _pressures(self) -> Array:
        """Return the force per length of each contact at all places (places, contacts) [N/m]."""
        return self._linear(self.states[self.of.touches[:, :, 1:]])

    def _tractions(self) -> Array:
        """Return the friction per length at all places (places, 3) [N/m], in the arm's frames."""
        if not self.form.contact_friction:
            return np.zeros((self.at.x.size * self.N, 3))
        tau = self._linear(self.states[self.of.tractions])
        return np.asarray(tau.reshape(-1, self.form.contacts, 3).sum(axis=1))

    def _linear(self, at_nodes: Array) -> Array:
        """Return what is linear between nodes (N + 1, contacts, n) where parts lie, 0 elsewhere."""
        x = self.at.x[:, :, None, None, None]
        lies = self._pressing()[:, :, -1:]
        result = lies * ((1 - x) * at_nodes[:-1] + x * at_nodes[1:])
        return np.asarray(result.reshape(self.at.x.size * self.N, -1))


def _powers() -> Array:
    """Return the coefficients of the polynomials that are 1 at one of the scheme's nodes."""
    return np.asarray(np.linalg.inv(np.vander(SCHEME.samples, increasing=True)))


def _inverse(A: Array) -> Array:
    """Return the inverses of matrices (N, n, n), NaN of singular ones."""
    try:
        return np.asarray(np.linalg.inv(A))
    except np.linalg.LinAlgError:
        return np.full_like(A, np.nan)
