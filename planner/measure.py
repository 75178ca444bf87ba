"""What targets measure of a shape: the values of their terms, by name."""

from __future__ import annotations

import numpy as np

from model.arm import Arm
from model.paths import Array
from model.shape import Shape
from model.stiffness import stiffness
from planner.program.terms import (
    compliance_requests,
    directions_function,
    term_names,
    terms_function,
)
from planner.targets.base import Target

_STIFF_ACCURACY = 1e-8


def measure(
    arm: Arm, targets: tuple[Target, ...], poses: Array, given: Array
) -> tuple[dict[str, Array], dict[str, Array], dict[str, Array]]:
    """Return the targets' match, approach and margin terms by name.

    Of poses (K, 7) at the targets' stations, and of what `compliances_along` returns.
    """
    numbers = np.concatenate([target.parameters(arm) for target in targets])
    values = terms_function(arm, targets)(poses.T, numbers, given)
    names = term_names(arm, targets)
    found: list[dict[str, Array]] = []
    for kind, value in zip(names, values, strict=True):
        flat = np.array(value).ravel()
        own = np.array(kind)
        found.append({name: flat[own == name] for name in dict.fromkeys(kind)})
    return found[0], found[1], found[2]


def compliances_along(arm: Arm, targets: tuple[Target, ...], shape: Shape) -> Array:
    """Return the tip's compliances along the directions of the targets' requests, stacked."""
    requests = compliance_requests(targets)
    numbers = np.concatenate([target.parameters(arm) for target in targets])
    found = [np.zeros(0)]
    for request, along in zip(
        requests, directions_function(arm, targets).call([numbers]), strict=True
    ):
        k = stiffness(
            arm,
            shape.tensions,
            shape.scene,
            request.hold,
            accuracy=_STIFF_ACCURACY,
            tendon_EA=request.tendon_EA,
            compile=shape.machine_code,
        )
        D = np.array(along)
        found.append((D.T @ k.compliance[:3, :3] @ D).ravel("F"))
    return np.concatenate(found)
