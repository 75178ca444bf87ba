"""An equilibrium verified by initial value integration, element by element, from its own wrenches.

From pose and wrench at each node, where collocation put them, eqs. (1), (3) of pose, moment and
force are integrated to the next node by an explicit Runge-Kutta scheme, the strains following from
the law of the cross-section at each of its stages. What is found at the next node differs from what
is there; the equilibrium that the integrator would have is, to first order in that, one Newton step
away, by the factorisation of the equilibrium.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from model.cross_section.law import forces, moments
from model.cross_section.reported import kinematics
from model.cross_section.sections import Sections
from model.effects import Current
from model.equilibrium.linearised import Linearised
from model.errors import ConvergenceError
from model.integrators.runge_kutta import RK8, RungeKutta
from model.loads import beyond, is_loaded
from model.mesh_refinement import estimate
from model.obstacles import distances
from model.obstacles.base import SIZE
from model.paths import Array
from model.rotations import cross, matrices
from model.time_limit import check_time
from model.transcription.collocation import gauss
from model.transcription.friction import hermite
from model.transcription.layout import POSE

SCHEME = RK8.name
_SUBSTEPS = (1, 2, 4, 8, 16)


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

    here: Linearised
    error: float


def verified(here: Linearised, accuracy: float) -> Verified:
    """Return an equilibrium corrected by what an integrator says of it.

    Steps are halved until the corrections of two of them differ by less than an accuracy, over the
    arm's length. Raises ConvergenceError where they do not.
    """
    system, before, error = here.system, None, np.inf
    scale = np.repeat([1.0, system.arm.length], [4, 3])
    for substeps in _SUBSTEPS:
        check_time()
        x = here.x.copy()
        x[system.of.first :] -= here.solve(_defects(here, RK8, substeps))
        poses = system.poses(x[system.of.first :]) / scale
        if before is not None:
            error = estimate(float(np.abs(poses - before).max()), 1, 2, RK8.order)
            if error <= accuracy:
                return Verified(Linearised(system, x, here), error)
        before = poses
    raise ConvergenceError(accuracy, error, f"its check by {SCHEME} does not converge")


def _defects(here: Linearised, scheme: RungeKutta, substeps: int) -> Array:
    """Return by how much each node misses what the integrator finds there (n_states,)."""
    of, states = here.system.of, here.states
    segment = _Elements(here)
    y = states[of.nodes[:-1]].copy()
    y[:, POSE : POSE + of.form.wrench] = here.system.wrenches_beyond(here.x)[:-1]
    for k in range(substeps):
        y = _step(segment, scheme, y, k / substeps, 1 / substeps)
    missed = np.zeros(of.n_states)
    there, w = of.nodes[1:], of.form.wrench
    missed[there[:, :POSE]] = states[there[:, :POSE]] - y[:, :POSE]
    wrenches = np.zeros(of.n_states)
    wrenches[there[:, POSE : POSE + w]] = y[:, POSE : POSE + w] - states[there[:, POSE : POSE + w]]
    # What an element makes of another wrench beyond it; a node's own wrench is left out.
    left = wrenches - here.times(wrenches)
    stages = of.inside.ravel()
    missed[of.nodes[:, POSE : POSE + w]] = left[of.nodes[:, POSE : POSE + w]]
    missed[stages] = left[stages]
    turned = slice(POSE + w, POSE + w + of.turned.shape[1])
    missed[of.turned[1:]] = (states[there] - y)[:, turned] - segment.kinks()
    return missed


def _step(of: _Elements, scheme: RungeKutta, y: Array, start: float, share: float) -> Array:
    """Return the nodes' unknowns after a share of all elements."""
    h, slopes = share * of.h[:, None], list[Array]()
    for c, row in zip(scheme.nodes, scheme.rows, strict=True):
        inner = y + h * sum((a * f for a, f in zip(row, slopes, strict=True) if a), np.zeros(1))
        slopes.append(of.rate(start + c * share, inner))
    return y + h * sum((b * f for b, f in zip(scheme.weights, slopes, strict=True)), np.zeros(1))


class _Elements:
    """The right-hand sides of all elements at once; y (N, node size) are a node's unknowns."""

    def __init__(self, here: Linearised) -> None:
        self.here, self.system = here, here.system
        system = self.system
        self.h, self.left, self.right = (
            np.diff(system.mesh.s),
            system.mesh.s[:-1],
            system.mesh.s[1:],
        )
        form, self.loaded = system.of.form, is_loaded(system.scene)
        shape = (system.mesh.steps, form.stages, form.strains)
        self.v = here.states[system.of.stages].reshape(shape)
        self.v_rate = here.states[system.of.rates].reshape(shape) if form.friction else None
        self._sections: dict[float, Sections] = {}

    def rate(self, x: float, y: Array) -> Array:
        """Return y' at a share x of each element."""
        system, form, load = self.system, self.system.of.form, self.here.x[self.system.of.n_tendons]
        s, w = self.left + x * self.h, form.wrench
        frame, M = matrices(y[:, :4]), y[:, POSE : POSE + 3]
        F = load * beyond(system.arm, system.scene, s, self.right).T if self.loaded else 0 * M
        F = F + y[:, POSE + 3 : POSE + w] if form.moving else F
        v = self._strains(x, frame, M, F, y)
        kappa, nu = kinematics(form.law, v)
        along = np.einsum("nij,nj->ni", frame, nu)
        found = np.zeros_like(y)
        found[:, :4] = _turning(y[:, :4], kappa)
        found[:, 4:POSE] = along
        found[:, POSE : POSE + 3] = -cross(along, F)
        if form.pressed:
            found[:, POSE + 3 : POSE + w] -= self._pressed(x, y[:, 4:POSE])
        if form.current:
            found[:, POSE + 3 : POSE + w] = -load * self._drag(s, frame[:, :, 0], nu)
        if form.friction:
            found[:, POSE + w :] = self._turned(x, v)
        return found

    def _strains(self, x: float, frame: Array, M: Array, F: Array, y: Array) -> Array:
        law, of = self.system.of.form.law, self.system.of
        local = np.einsum("nij,kni->knj", frame, np.stack([M, F]))
        wrench = np.hstack([local[0][:, list(moments(law))], local[1][:, list(forces(law))]])
        sections = self._at(x)
        pulls = self.here.x[sections.tendon]
        if of.form.friction:
            turned = y[sections.place, POSE + of.form.wrench + sections.tendon]
            load = self.here.x[of.n_tendons]
            pulls = pulls * np.exp(-load * self.system.mu[sections.tendon] * turned)
        return sections.solve(self._guess(x), wrench, pulls)

    def _at(self, x: float) -> Sections:
        if x not in self._sections:
            system, s = self.system, self.left + x * self.h
            given = (system.arm, system.scene, system.of.form.law, s, system.mesh.active)
            self._sections[x] = Sections(*given)
        return self._sections[x]

    def _guess(self, x: float) -> Array:
        """Return the strains (N, n) of the stages' polynomials at a share x."""
        m = self.system.of.form.stages
        return np.asarray(np.einsum("m,nmk->nk", x ** np.arange(m) @ gauss(m).powers, self.v))

    def _drag(self, s: Array, t: Array, nu: Array) -> Array:
        current = self.system.scene.find(Current)
        assert current is not None
        R = self.system.arm.radius.evaluate(s, self.system.arm.length)[0]
        across = np.array(current.velocity) - t * (t @ np.array(current.velocity))[:, None]
        drag = current.density * current.coefficient * R * nu[:, 0] * np.linalg.norm(across, axis=1)
        return np.asarray(drag[:, None] * across)

    def _pressed(self, x: float, u: Array) -> Array:
        """Return the force per length of what the elements lie on (N, 3) [N/m]."""
        of, K = self.system.of, self.system.of.form.contacts
        own = self.system.p[of.equations.numbers_of("pressure")].reshape(of.elements, K, -1)
        p = self.here.states[of.touches[:, :, 1]]
        size = own[:, :, -1] * ((1 - x) * p[:-1] + x * p[1:])
        bodies = own[0, :, :SIZE]
        return np.asarray(np.einsum("nk,nki->ni", size, distances(bodies, u)[1]))

    def _turned(self, x: float, v: Array) -> Array:
        """Return how fast each tendon turns (N, n_tendons) [rad/m]."""
        form, sections = self.system.of.form, self._at(x)
        values, slopes = hermite(form.stages, x, 1)
        assert self.v_rate is not None
        rate = np.einsum("m,nmk->nk", values, self.v) / self.h[:, None]
        rate += np.einsum("m,nmk->nk", slopes, self.v_rate)
        found = np.zeros((self.h.size, self.system.of.n_tendons))
        found[sections.place, sections.tendon] = sections.turning(v, rate)
        return found

    def kinks(self) -> Array:
        """Return by how much each tendon turns at the far node of each element (N, n_tendons)."""
        of, system = self.system.of, self.system
        found = np.zeros((self.h.size, of.n_tendons * of.form.friction))
        k, j = of.kinks
        if of.form.friction and k.size:
            found[k, j] = -system.kink_angles(self.here.x)
        return found


def _turning(q: Array, kappa: Array) -> Array:
    """Return q' = q (0, kappa) / 2 (N, 4)."""
    w, r = q[:, :1], q[:, 1:]
    scalar = -(r * kappa).sum(axis=1, keepdims=True)
    return np.asarray(np.hstack([scalar, w * kappa + cross(r, kappa)]) / 2)
