"""What targets measure of a shape: the values of their terms, by name."""

from __future__ import annotations

import math

import numpy as np

from model.arm import Arm
from model.paths import Array
from model.shape import Shape
from model.stiffness import stiffness
from model.winches import pulls
from planner.program.terms import compliance_requests, target_numbers, terms_of
from planner.targets.base import Target
from planner.targets.stiffness import MinimumStiffness

_STIFF_ACCURACY = 1e-8


def measure(
    arm: Arm, targets: tuple[Target, ...], poses: Array, compliances: Array
) -> tuple[dict[str, Array], dict[str, Array], dict[str, Array]]:
    """Return the targets' equality, soft residual and inequality terms by name.

    Of poses (K, 7) at the targets' stations, and of what `compliances_along` returns.
    """
    terms, measured = terms_of(arm, targets), list[dict[str, Array]]()
    values = terms.dense(poses.ravel(), target_numbers(arm, targets), compliances)
    for kind, value in zip(terms.names, values, strict=True):
        flat, names = value.ravel(), np.array(kind)
        measured.append({name: flat[names == name] for name in dict.fromkeys(kind)})
    return measured[0], measured[1], measured[2]


def compliances_along(
    arm: Arm, targets: tuple[Target, ...], shape: Shape, release: bool = False
) -> Array:
    """Return the tip's compliances along the directions of the targets' requests, stacked.

    With lengths held all tendons are locked, as the program's responses have them; or those without
    tension `release`d, as stiffness has it by default.
    """
    if not compliance_requests(targets):
        return np.zeros(0)
    terms, compliances = terms_of(arm, targets), []
    directions = terms.directions.call([target_numbers(arm, targets)])
    for request, along in zip(terms.requests, directions, strict=True):
        k = stiffness(
            arm,
            shape.tensions,
            shape.scene,
            request.hold,
            accuracy=_STIFF_ACCURACY,
            tendon_EA=request.tendon_EA,
            release=release,
            compile=shape.machine_code,
        )
        D = np.array(along)
        compliances.append((D.T @ k.compliance[:3, :3] @ D).ravel("F"))
    return np.concatenate(compliances)


def remark_on_slack(arm: Arm, targets: tuple[Target, ...], shape: Shape) -> str:
    """Return the stiffness of targets with lengths held when slack tendons are released.

    A sentence that begins with a space; empty without such targets, or where all tendons pull.
    """
    slack = np.flatnonzero(~pulls(arm, shape.tensions))
    pairs = [(item, item.compliance_request()) for item in targets]
    requests = [(item, request) for item, request in pairs if request is not None]
    if not slack.size or all(request.hold == "tension" for _, request in requests):
        return ""
    ends = np.cumsum([request.width**2 for _, request in requests])[:-1]
    both = [np.split(compliances_along(arm, targets, shape, item), ends) for item in (False, True)]
    sentences = []
    for (target, request), locked, released in zip(requests, *both, strict=True):
        if request.hold == "length":
            wanted = isinstance(target, MinimumStiffness)
            unit = "times what is wanted" if wanted else "N/m"
            values = [_least_stiffness(item) for item in (locked, released)]
            sentences.append(f"{values[0]:.4g} {unit} locked, {values[1]:.4g} released")
    names = ", ".join(arm.tendon_name(int(j)) for j in slack)
    return (
        " With lengths held all tendons are counted as locked, also those without tension, "
        f"{names}: the tip's stiffness is {'; '.join(sentences)}, as stiffness() has it by default."
    )


def _least_stiffness(compliance: Array) -> float:
    """Return the least stiffness of a compliance, column by column, along its directions."""
    width = math.isqrt(compliance.size)
    C = compliance.reshape(width, width)
    return float(1 / np.linalg.eigvalsh((C + C.T) / 2).max())
