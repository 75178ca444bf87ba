"""Poses, strains and tensions of an equilibrium anywhere along the arm.

From a node on, where pose and wrench are known, the equations of a shorter element say where it
ends; at its end the cross-section's law gives the strains. So what is read off between the nodes is
as accurate as what is read off at them. Tensions are the same all along but for friction; see
model.transcription.friction.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from model.cross_section.law import forces, moments
from model.cross_section.sections import Sections
from model.effects import Friction
from model.loads import beyond, directions
from model.machine.buffered import mapped
from model.paths import Array
from model.rotations import matrices
from model.stations import Counts
from model.transcription.collocation import gauss
from model.transcription.element import element
from model.transcription.friction import turning_function
from model.transcription.kernel import Places
from model.transcription.layout import POSE
from model.transcription.numbers import element_numbers
from model.transcription.system import System
from model.transcription.touch import pressure

# Steps, how small the last one is, and by how much steps shrink while a Jacobian is kept.
_STEPS, _SETTLED, _SHRUNK = 16, 1e-12, 0.1


def poses_and_strains(system: System, x: Array, s: Array) -> tuple[Array, Array]:
    """Return poses (N, 7), and strains (N, n) on the base side of arc lengths s (N,)."""
    inside = _Parts(system, x, s)
    g, w = inside.ends()
    return g, inside.strains(g, w)


class _Parts:
    """Parts of elements, from the node below each s to s."""

    def __init__(self, system: System, x: Array, s: Array) -> None:
        mesh, of = system.mesh, system.of
        self.system, self.x, self.states, self.s = system, x, x[of.first :], s
        self.form, m = replace(of.form, friction=False), of.form.stages
        self.step = np.clip(np.searchsorted(mesh.s, s, side="left") - 1, 0, mesh.steps - 1)
        self.left = mesh.s[self.step]
        self.h = np.maximum(s - self.left, 1e-12 * system.arm.length)
        self.active, self.end = mesh.active[self.step], mesh.s[self.step + 1]
        self.share = self.h / (self.end - self.left)
        self.at = (self.left[:, None] + self.h[:, None] * gauss(m).c).ravel()

    def ends(self) -> tuple[Array, Array]:
        """Return poses (N, 7) and wrenches (N, n_w) at s, on the base side."""
        between = np.flatnonzero(self.share < 1)
        result = self.states[self.system.of.nodes[self.step + 1, : POSE + self.form.wrench]]
        if between.size:
            result[between] = _Parts(self.system, self.x, self.s[between])._solved()
        return result[:, :POSE], result[:, POSE:]

    def _solved(self) -> Array:
        """Return poses and wrenches (N, 7 + n_w) where the parts end."""
        form, N = self.form, self.s.size
        m, n, w = form.stages, form.strains, form.wrench
        poses = self.states[self.system.of.nodes[self.step, :POSE]]
        node = np.hstack([poses, self.system.wrenches_beyond(self.x)[self.step]])
        sections = self._sections(self.at, np.repeat(self.active, m))
        pulls = self._pulls(sections)
        v = self._interpolated(gauss(m).c[None, :] * self.share[:, None]).reshape(N * m, n)
        ends = np.repeat(self.end, m)
        c = element_numbers(self.system.arm, self.system.scene, form, self.at, self.h, ends).T
        load = self.x[self.system.of.n_tendons]
        known = np.hstack([np.full((N, int(form.loaded)), load), node])
        first = known.shape[1]
        free = first + np.arange(m * n + POSE + w)
        next_node = node.copy()
        derivative, i, j = element(form).jacobian
        value, jacobian = (
            mapped(each, form.machine_code) for each in (element(form).value, derivative)
        )
        inverse: Array = np.empty(0)
        last = 0.0
        for _ in range(_STEPS):
            y = np.hstack([known, v.reshape(N, -1), next_node])
            (r,) = value(y, c)
            local = sections.balance(v, pulls)
            r[:, w : w + m * n] += local.wrench.reshape(N, -1)
            if form.pressed:
                self._press(r, node, v.reshape(N, -1))
            if last == 0:
                J = np.zeros((N, r.shape[1], y.shape[1]))
                J[:, i, j] += jacobian(y, c)[0]
                for k in range(m):
                    rows = w + k * n + np.arange(n)
                    J[:, rows[:, None], free[0] + rows - w] += local.jacobian.reshape(N, m, n, n)[
                        :, k
                    ]
                inverse = np.asarray(np.linalg.inv(J[:, :, free]))
            step = -(inverse @ r[:, :, None])[:, :, 0]
            v, next_node = v + step[:, : m * n].reshape(N * m, n), next_node + step[:, m * n :]
            size = float(np.abs(step).max())
            if size <= _SETTLED * (1 + np.abs(v).max()):
                break
            # A Jacobian is kept as long as steps shrink by it.
            last = size if last == 0 or size < _SHRUNK * last else 0.0
        return next_node

    def _press(self, r: Array, node: Array, v: Array) -> None:
        """Add the pressure of each obstacle to residuals (N, n_r) at strains v (N, m n).

        Too little depends on the strains for their Jacobian to know of it.
        """
        of = self.system.of
        kernel = pressure(of.form.law, of.form.stages, of.form.contact_friction)
        values = self.system.p[of.equations.numbers_of("pressure")]
        values = values.reshape(of.elements, of.form.contacts, -1)[self.step]
        parts = [of.touches[:, :, 1:], *[of.tractions] * of.form.contact_friction]
        at_nodes = self.states[np.concatenate(parts, axis=2)]
        before, after = at_nodes[self.step], at_nodes[self.step + 1]
        after = before + self.share[:, None, None] * (after - before)
        for j in range(of.form.contacts):
            numbers = values[:, j].copy()
            numbers[:, -2] = self.h
            ends = [before[:, j, :1], after[:, j, :1], before[:, j, 1:], after[:, j, 1:]]
            (result,) = mapped(kernel.value)(np.hstack([node[:, :POSE], v, *ends]), numbers)
            r[:, : result.shape[1]] += result

    def strains(self, g: Array, w: Array) -> Array:
        """Return the strains (N, n) where pose and wrench are known."""
        system, law, scene = self.system, self.system.of.form.law, self.system.scene
        sections = self._sections(self.s, self.active)
        first = self._interpolated(self.share[:, None])[:, 0]
        frame = matrices(g[:, :4])
        local = np.zeros((2, self.s.size, 3))
        if system.of.form.loaded:
            load = self.x[system.of.n_tendons]
            force = load * beyond(system.arm, scene, self.s, self.end).T
            force = force + w[:, 3:] if system.of.form.moving else force
            local = np.einsum("nij,kni->knj", frame, np.stack([w[:, :3], force]))
        wrench = np.hstack([local[0][:, list(moments(law))], local[1][:, list(forces(law))]])
        return sections.solve(first, wrench, self._pulls(sections))

    def _pulls(self, sections: Sections) -> Array:
        return sliding_tensions(self.system, self.x, sections.s, sections.place, sections.tendon)

    def _sections(self, s: Array, active: Counts) -> Sections:
        system = self.system
        form = system.of.form
        return Sections(system.arm, system.scene, form.law, s, active, form.machine_code)

    def _interpolated(self, x: Array) -> Array:
        """Return the stages' polynomials (N, k, n) at shares x (N, k) of their elements."""
        of = self.system.of
        stages = self.states[of.stages].reshape(-1, of.form.stages, of.form.strains)[self.step]
        return np.asarray(gauss(of.form.stages).at(x) @ stages)


def sliding_tensions(at: System, x: Array, s: Array, place: Places, tendon: Places) -> Array:
    """Return the tensions (P,) of tendons where they cross arc lengths s[place], unknowns x."""
    T, of = x[tendon], at.of
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
    rates[k, j] = np.array(turning_function(of.form.law, m).map(k.size)(y, numbers)).T
    element = np.clip(np.searchsorted(at.mesh.s, s[place]) - 1, 0, at.mesh.steps - 1)
    share = (s[place] - at.mesh.s[element]) / h[element]
    powers = np.arange(1, m + 1)
    weights = share[:, None] ** powers / powers @ gauss(m).powers
    grows = h[element] * (weights * rates[element, tendon]).sum(axis=1)
    turned = x[node[element, tendon]] + grows
    return np.asarray(T * np.exp(-x[of.n_tendons] * coefficients(at)[tendon] * turned))


def coefficients(at: System) -> Array:
    """Return direction times coefficient of friction of each tendon (n_tendons,)."""
    friction = at.scene.find(Friction)
    assert friction is not None
    return np.asarray(friction.mu * np.array(directions(at.arm, friction)))


def kink_angles(at: System, x: Array) -> Array:
    """Return the angle by which each tendon turns at each kink, with a minus (P,) [rad]."""
    of = at.of
    (term,) = (term for term in of.equations.terms if term.kernel.name == "kink")
    c = at.p[of.equations.numbers_of("kink")].reshape(term.count, -1).T
    return np.asarray(np.array(term.kernel.value.map(term.count)(x[term.unknowns], c))[0])
