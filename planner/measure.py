"""What is measured of a shape: the values of targets' terms by name, what winches take in."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from model.arm import Arm
from model.compliance import length_response
from model.paths import Array
from model.shape import Shape
from model.stiffness import stiffness
from model.winches import pulls, rest_lengths
from planner.program.terms import target_numbers, terms_of
from planner.targets.base import Target
from planner.targets.stiffness import MinimumStiffness


def measure(
    arm: Arm, targets: tuple[Target, ...], poses: Array, compliances: Sequence[Array]
) -> tuple[dict[str, Array], dict[str, Array], dict[str, Array]]:
    """Return the targets' equality, soft residual and inequality terms by name.

    Of poses (K, 7) at the targets' stations, and of what `compliances_along` returns.
    """
    terms, measured = terms_of(arm, targets), list[dict[str, Array]]()
    along = np.concatenate([np.zeros(0), *(C.ravel() for C in compliances)])
    values = terms.dense(poses.ravel(), target_numbers(arm, targets), along)
    for kind, value in zip(terms.names, values, strict=True):
        flat, names = value.ravel(), np.array(kind)
        measured.append({name: flat[names == name] for name in dict.fromkeys(kind)})
    return measured[0], measured[1], measured[2]


def compliances_along(
    arm: Arm, targets: tuple[Target, ...], shape: Shape, release: bool = False
) -> list[Array]:
    """Return the tip's compliance (k, k) along the k directions of each of the targets' requests.

    With lengths held all tendons are locked, as the program's responses have them; or those without
    tension `release`d, as stiffness has it by default.
    """
    terms, compliances = terms_of(arm, targets), []
    directions = terms.directions.call([target_numbers(arm, targets)])
    for request, along in zip(terms.requests, directions, strict=True):
        k = stiffness(
            arm,
            shape.tensions,
            shape.scene,
            request.hold,
            accuracy=1e-8,
            tendon_EA=request.tendon_EA,
            release=release,
            compile=shape.machine_code,
        )
        D = np.array(along)
        compliances.append(D.T @ k.compliance[:3, :3] @ D)
    return compliances


def remark_on_slack(arm: Arm, targets: tuple[Target, ...], shape: Shape) -> str:
    """Return the stiffness of targets with lengths held when slack tendons are released.

    A sentence that begins with a space; empty without such targets, or where all tendons pull.
    """
    slack = [arm.tendon_name(int(j)) for j in np.flatnonzero(~pulls(arm, shape.tensions))]
    pairs = [(target, request) for target in targets if (request := target.compliance_request())]
    if not slack or all(request.hold == "tension" for _, request in pairs):
        return ""
    both = [compliances_along(arm, targets, shape, release) for release in (False, True)]
    sentences = []
    for (target, request), *compliances in zip(pairs, *both, strict=True):
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
    model.compliance.
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
    return np.asarray((rest_lengths(shape.arm) if zero is None else np.array(zero)) - left)
