"""Whether an arm stands that leans on things: its energy's Hessian where what touches stays shut.

Of the directions in which the arm can move with its contacts: with these as equations the inverse
of the Jacobian, in the strains, is that of the Hessian there, and 0 across. So the reciprocals of
its eigenvalues are those of the Hessian, less one 0 for each contact. See
model.equilibrium.stability for the scale.
"""

from __future__ import annotations

import numpy as np

from model.contact.touches import Touches
from model.equilibrium.linearised import Linearised
from model.equilibrium.stability import rest_stiffness
from model.errors import SingularError
from model.paths import Array


def held_stability(here: Linearised) -> float:
    """Return the least eigenvalue of the scaled Hessian; below 0 it does not stand.

    Of a Hessian that is not symmetric the least real part. 0 where the arm is about to give way.
    """
    try:
        inverse = _inverse(here)
    except SingularError:
        return 0.0
    even = (inverse + inverse.T) / 2
    if np.abs(inverse - even).max() <= 1e-3 * np.abs(inverse).max():
        values = np.linalg.eigvalsh(even)
    else:
        values = np.linalg.eigvals(inverse).real
    touches = Touches.of(here.system)
    shut = int(touches.held.sum() + touches.inside.sum() + touches.end.sum())
    values = values[np.argsort(np.abs(values))][shut:]
    if (values < 0).any():
        return float(1 / values[values < 0].max())
    return float(1 / values.max()) if values.size else np.inf


def _inverse(here: Linearised) -> Array:
    of = here.system.of
    places, n = np.ravel(of.stages), of.stages.size
    unit = np.zeros((of.n_states, n), order="F")
    unit[places, np.arange(n)] = 1.0
    weight, stiff = rest_stiffness(here.system)
    right = np.sqrt(weight * stiff)[:, None] * here.solve(unit)[places]
    return np.asarray(right * np.sqrt(stiff / weight))
