"""Verification of an equilibrium by initial value integration of each element.

The integrator (octoplan.model.equilibrium.integration) starts from the state of the first node of
an element and differs from collocation at the last node. These defects are converted to an error of
the tip to first order: one Newton step with the factorisation of the equilibrium.

The solver and this check share the mechanics of a cross-section, tensions, loads and the
factorisation. They do not share the kernels and the order of the scheme.
"""

from __future__ import annotations

import numpy as np

from octoplan.model.equilibrium.integration import SCHEME, Integration
from octoplan.model.equilibrium.linearised import Equilibrium
from octoplan.model.forward import estimate
from octoplan.model.paths import Array
from octoplan.model.rotations import POSE
from octoplan.model.support.errors import ConvergenceError
from octoplan.model.support.progress import check_time

# Numbers of steps per element that are tried in turn.
SUBSTEPS = (1, 2, 4, 8, 16)


def verify(point: Equilibrium, accuracy: float) -> tuple[Equilibrium, float]:
    """Return an equilibrium corrected by the defects of an integrator, and its estimated error.

    Steps are halved until the corrected poses of two step lengths differ by less than `accuracy`,
    relative to the length of the arm. Raise ConvergenceError if the finest steps differ by more.
    """
    system = point.system
    before = None
    error = np.inf
    strains: Array | None = None
    scale = np.repeat([1.0, system.arm.length], [4, 3])
    for substeps in SUBSTEPS:
        check_time()
        x = point.x.copy()
        elements = Integration(system, point.x, substeps)
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
    """Return the defects (n_states,) of an equilibrium at the results y (N, n) of an integrator.

    The defect of a pose is the state minus the result at the last node of each element.
    """
    layout = point.system.layout
    states = point.states
    w = layout.structure.n_wrench
    poses = layout.nodes[1:, :POSE]
    wrenches = layout.nodes[1:, POSE : POSE + w]
    defects = np.zeros(layout.n_states)
    defects[poses] = states[poses] - y[:, :POSE]
    if not w:
        return defects
    change = np.zeros(layout.n_states)
    change[wrenches] = y[:, POSE : POSE + w] - states[wrenches]
    # The balance of an element changes with the wrench at the last node. The share of this change
    # in the balance of the node itself is left out.
    band = layout.band
    columns = band.columns[band.inside] - layout.n_before_states
    products = point.nonzeros[band.inside] * change[columns]
    balance = change - np.bincount(band.rows[band.inside], products, layout.n_states)
    stages = layout.inside.ravel()
    all_wrenches = layout.nodes[:, POSE : POSE + w]
    defects[all_wrenches] = balance[all_wrenches]
    defects[stages] = balance[stages]
    if layout.structure.n_tendon_states:
        reached = y[:, POSE + w :].reshape(layout.elements, layout.n_tendons, -1)
        if layout.kinks[0].size:
            reached[layout.kinks] -= point.system.rows_of("tendon_jump", point.x)
        tendon_states = layout.tendon_states[1:]
        defects[tendon_states] = states[tendon_states] - reached
    return defects
