"""Quantities of winches: strokes, sensitivity of the tip to lengths, slack tendons."""

from __future__ import annotations

from typing import Any

import numpy as np

from octoplan.model.arm import Arm
from octoplan.model.compliance import length_response
from octoplan.model.paths import Array
from octoplan.model.shape import Shape
from octoplan.model.tendons import is_taut, rest_lengths
from octoplan.planner.targets.target_set import TargetSet


def remark_on_slack(targets: TargetSet, shape: Shape) -> str:
    """Return a sentence about the tip's stiffness with slack tendons released, after a space.

    Empty without targets of stiffness at held lengths, and if no tendon is slack.
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
            locked, released = (1 / np.linalg.eigvalsh(C).max() for C in compliances)
            sentences.append(
                f"{locked:.4g} {target.stiffness_unit} locked, {released:.4g} released"
            )
    return (
        " With lengths held all tendons are counted as locked, also those without tension, "
        f"{', '.join(slack)}: the tip's stiffness is {'; '.join(sentences)}, as stiffness() has it "
        "by default."
    )


def length_error(shape: Shape) -> dict[str, float]:
    """Return the displacement of the tip per error of a tendon length [-], by taut tendon.

    See octoplan.model.compliance.
    """
    response = length_response(shape)
    taut = np.flatnonzero(response.taut)
    each = np.linalg.norm(response.tip[:, taut], axis=0)
    names = (shape.arm.tendon_name(int(j)) for j in taut)
    return dict(zip(names, each.tolist(), strict=True))


def strokes(shape: Shape, zero: Any = None) -> Array:
    """Return the strokes of the winches (n_tendons,) [m]: lengths at zero minus lengths.

    `zero` are the lengths (n_tendons,) at which winches are zeroed [m]; those of the straight arm
    at rest unless given. The stroke of a slack tendon is its maximum without tension.
    """
    left = shape.tendon_lengths
    if shape.winches is not None:
        left = np.where(shape.winches.held, shape.winches.lengths, left)
    return taken_in(shape.arm, left, zero)


def taken_in(arm: Arm, lengths: Array, zero: Any = None) -> Array:
    """Return the strokes for tendon lengths (..., n_tendons) [m]; see strokes."""
    return np.asarray((rest_lengths(arm) if zero is None else np.array(zero)) - lengths)
