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

from model.equilibrium.dense import kink_angles
from model.equilibrium.integration import SCHEME, Integration
from model.equilibrium.linearised import Linearised
from model.errors import ConvergenceError
from model.mesh import estimate
from model.paths import Array
from model.time_limit import check_time
from model.transcription.layout import POSE

SUBSTEPS = (1, 2, 4, 8, 16)


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
    elements = Integration(system, here.x, _before(here))
    for substeps in SUBSTEPS:
        check_time()
        x = here.x.copy()
        x[system.of.first :] -= here.solve(_defects(here, elements.run(substeps)))
        poses = system.poses(x[system.of.first :]) / scale
        if before is not None:
            error = estimate(float(np.abs(poses - before).max()), 1, 2, SCHEME.order)
            if error <= accuracy:
                return Verified(Linearised(system, x, here), error)
        before = poses
    raise ConvergenceError(accuracy, error, f"its check by {SCHEME.name} does not converge")


def _before(here: Linearised) -> Array:
    """Return the unknowns of the nodes before the elements (N, n), wrenches beyond the nodes."""
    of = here.system.of
    result = here.states[of.nodes[:-1, : of.node_size - of.touching]].copy()
    result[:, POSE : POSE + of.form.wrench] = here.system.wrenches_beyond(here.x)[:-1]
    return result


def _defects(here: Linearised, y: Array) -> Array:
    """Return by how much nodes miss what the integrator finds there, y (N, n); (n_states,)."""
    of, states = here.system.of, here.states
    missed = np.zeros(of.n_states)
    there, w = of.nodes[1:, : y.shape[1]], of.form.wrench
    missed[there[:, :POSE]] = states[there[:, :POSE]] - y[:, :POSE]
    if not w:
        return missed
    wrenches = np.zeros(of.n_states)
    wrenches[there[:, POSE : POSE + w]] = y[:, POSE : POSE + w] - states[there[:, POSE : POSE + w]]
    # What an element makes of another wrench beyond it; a node's own wrench is left out.
    left = wrenches - here.times(wrenches)
    stages = of.inside.ravel()
    missed[of.nodes[:, POSE : POSE + w]] = left[of.nodes[:, POSE : POSE + w]]
    missed[stages] = left[stages]
    missed[of.turned[1:]] = (states[there] - y)[:, POSE + w :] - _kinks(here)
    return missed


def _kinks(here: Linearised) -> Array:
    """Return by how much each tendon turns at the far node of each element (N, n_tendons)."""
    of = here.system.of
    values = np.zeros((of.elements, of.n_tendons * of.form.friction))
    k, j = of.kinks
    if of.form.friction and k.size:
        values[k, j] = -kink_angles(here.system, here.x)
    return values
