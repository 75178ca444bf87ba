"""How tensions change along tendons that slide with friction, at an equilibrium.

Equations are in model.transcription.friction; without friction tensions are the same all along.
"""

from __future__ import annotations

import numpy as np

from model.effects import Friction
from model.loads import directions
from model.paths import Array
from model.transcription.collocation import gauss
from model.transcription.friction import turning_function
from model.transcription.kernel import Places
from model.transcription.system import System


def pulls(at: System, x: Array, s: Array, place: Places, tendon: Places) -> Array:
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
