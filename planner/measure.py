"""What is told of a shape's winches: what they take in, errors of lengths, slack tendons."""

from __future__ import annotations

from typing import Any

import numpy as np

from octoplan.model.arm import Arm
from octoplan.model.compliance import length_response
from octoplan.model.paths import Array
from octoplan.model.shape import Shape
from octoplan.model.tendons import is_taut, rest_lengths
from octoplan.planner.targets.stiffness import MinimumStiffness
from octoplan.planner.targets.target_set import TargetSet


def remark_on_slack(targets: TargetSet, shape: Shape) -> str:
    """Return the stiffness of targets with lengths held when slack tendons are released.

    A sentence that begins with a space; empty without such targets, or where all tendons pull.
    """
    arm = targets.arm
    slack = [arm.tendon_name(int(j)) for j in np.flatnonzero(~is_taut(arm, shape.tensions))]
    if not slack or all(request.hold == "tension" for request in targets.requests):
        return ""
    asking = [target for target in targets.each if target.compliance_request()]
    both = [targets.compliances(shape, release) for release in (False, True)]
    sentences = []
    for target, request, *compliances in zip(asking, targets.requests, *both, strict=True):
        if request.hold == "length":
            unit = "times what is wanted" if isinstance(target, MinimumStiffness) else "N/m"
            locked, released = (1 / np.linalg.eigvalsh(C).max() for C in compliances)
            sentences.append(f"{locked:.4g} {unit} locked, {released:.4g} released")
    return (
        " With lengths held all tendons are counted as locked, also those without tension, "
        f"{', '.join(slack)}: the tip's stiffness is {'; '.join(sentences)}, as stiffness() has it "
        "by default."
    )


def length_error(shape: Shape) -> dict[str, float]:
    """Return how far the tip of a shape goes where a winch is off by some length.

    Over the error of the winch [-], as mm per mm, by the names of the taut tendons; see
    octoplan.model.compliance.
    """
    response = length_response(shape)
    taut = np.flatnonzero(response.taut)
    each = np.linalg.norm(response.tip[:, taut], axis=0)
    names = (shape.arm.tendon_name(int(j)) for j in taut)
    return dict(zip(names, each.tolist(), strict=True))


def strokes(shape: Shape, zero: Any = None) -> Array:
    """Return what winches have taken in from where they are zeroed (n_tendons,) [m].

    Where the shape's tendons have these lengths `zero` [m]; in the straight arm at rest unless
    given. Of a slack tendon it is the most that may be taken in without its pulling.
    """
    left = shape.tendon_lengths
    if shape.winches is not None:
        left = np.where(shape.winches.held, shape.winches.lengths, left)
    return taken_in(shape.arm, left, zero)


def taken_in(arm: Arm, lengths: Array, zero: Any = None) -> Array:
    """Return what winches that leave lengths (..., n_tendons) have taken in [m]; see strokes."""
    return np.asarray((rest_lengths(arm) if zero is None else np.array(zero)) - lengths)
