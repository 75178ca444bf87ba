"""An equilibrium verified by initial value integration, element by element, from its own wrenches.

What an integrator finds at the far node of each element (octoplan.model.equilibrium.integration)
differs from what collocation put there; the equilibrium that the integrator would have is, to first
order in that, one Newton step away, by the factorisation of the equilibrium.

Shared with the solver are the mechanics of a cross-section, tensions, loads and the factorisation
that turns defects into an error of the tip; not shared are the kernels and the order of the scheme.
"""

from __future__ import annotations

import numpy as np

from octoplan.model.equilibrium.integration import SCHEME, Integration
from octoplan.model.equilibrium.linearised import Equilibrium
from octoplan.model.forward import estimate
from octoplan.model.paths import Array
from octoplan.model.rod.nodes import POSE
from octoplan.model.support.errors import ConvergenceError
from octoplan.model.support.progress import check_time

SUBSTEPS = (1, 2, 4, 8, 16)


def verify(point: Equilibrium, accuracy: float) -> tuple[Equilibrium, float]:
    """Return an equilibrium corrected by what an integrator says of it, and its estimated error.

    Steps are halved until the corrections of two of them differ by less than an accuracy, over the
    arm's length as the error is. Raises ConvergenceError where they do not.
    """
    system, before, error = point.system, None, np.inf
    strains: Array | None = None
    scale = np.repeat([1.0, system.arm.length], [4, 3])
    for substeps in SUBSTEPS:
        check_time()
        x, elements = point.x.copy(), Integration(system, point.x, substeps)
        y, first = elements.run(elements.begin(strains))
        strains = first[0] if strains is None else strains
        x[system.layout.n_before_states :] -= point.solve(_defects(point, y))
        poses = system.poses(x[system.layout.n_before_states :]) / scale
        if before is not None:
            error = estimate(float(np.abs(poses - before).max()), 1, 2, SCHEME.order)
            if error <= accuracy:
                return Equilibrium(system, x, point), error
        before = poses
    raise ConvergenceError(accuracy, error, f"its check by {SCHEME.name} does not converge")


def _defects(point: Equilibrium, y: Array) -> Array:
    """Return by how much nodes miss what the integrator finds there, y (N, n); (n_states,)."""
    of, states = point.system.layout, point.states
    missed = np.zeros(of.n_states)
    there, w = of.nodes[1:], of.structure.n_wrench
    missed[there[:, :POSE]] = states[there[:, :POSE]] - y[:, :POSE]
    if not w:
        return missed
    wrenches = np.zeros(of.n_states)
    wrenches[there[:, POSE : POSE + w]] = y[:, POSE : POSE + w] - states[there[:, POSE : POSE + w]]
    # What an element makes of another wrench beyond it; a node's own wrench is left out.
    at, inside = of.band, of.band.inside
    products = point.nonzeros[inside] * wrenches[at.columns[inside] - of.n_before_states]
    left = wrenches - np.bincount(at.rows[inside], products, of.n_states)
    stages = of.inside.ravel()
    missed[of.nodes[:, POSE : POSE + w]] = left[of.nodes[:, POSE : POSE + w]]
    missed[stages] = left[stages]
    if of.structure.n_tendon_states:
        reached = y[:, POSE + w :].reshape(of.elements, of.n_tendons, -1)
        if of.kinks[0].size:
            reached[of.kinks] -= point.system.rows_of("tendon_jump", point.x)
        missed[of.tendon_states[1:]] = states[of.tendon_states[1:]] - reached
    return missed
