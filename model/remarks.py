"""What no arm does though its equations have it: what a settled shape tells besides its numbers."""

from __future__ import annotations

from functools import lru_cache
from typing import Any, Protocol

import numpy as np

from model.arm import Arm
from model.centreline import Centreline, Settled
from model.clearance.nearest import ITSELF, clearances
from model.loads import is_loaded
from model.mesh import graded
from model.paths import Array
from model.stations import crossing, stations, tendon_paths
from model.winches import rest_lengths

# How deep parts may be in each other, over the arm's length: what contact of them leaves.
_TOUCHES = 1e-6
# Places in each step of a mesh at which curvature is looked at, where the mean of a step comes as
# near to one over the radius as this.
_PLACES, _NEAR = 4, 0.7
# Curvature times radius, by tensions and the stiffness at rest, up to which that is not looked at.
_LIGHT = 0.8


class Bent(Settled, Protocol):
    """A settled shape; see model.shape.Shape."""

    @property
    def tensions(self) -> Array:
        """The tensions (n_tendons,) [N]."""

    @property
    def tendon_lengths(self) -> Array:
        """The lengths of the tendons (n_tendons,) [m]."""

    @property
    def folded(self) -> float | None:
        """Where a tendon has no length left [m], None where all have some."""


def remarks(shape: Bent) -> tuple[str, ...]:
    """Return what is not to be believed of a shape, a sentence each; see sharp and crosses."""
    folded = shape.folded
    told = [sharp(shape), crosses(shape)]
    if folded is not None:
        told.append(
            f"no arm bends so far: at s = {folded:.6g} m a tendon has no length left; "
            "lower the tensions that cross it"
        )
    return tuple(sentence for sentence in told if sentence)


def sharp(shape: Bent) -> str:
    """Return where the body bends by less than its own radius, and what that takes of tendons.

    Its inner side would have no length left. Empty where it does not; without loads, where tensions
    are too light for that, nothing is looked at.
    """
    arm = shape.arm
    if not is_loaded(shape.scene) and float((_leverage(arm) @ shape.tensions).max()) < _LIGHT:
        return ""
    nodes, poses = shape.s, shape.states
    turned = 2 * np.arccos(np.minimum(np.abs((poses[1:, :4] * poses[:-1, :4]).sum(axis=1)), 1.0))
    run = np.linalg.norm(np.diff(poses[:, 4:], axis=0), axis=1)
    radius = arm.radius.evaluate(nodes, arm.length)[0]
    if (turned * np.maximum(radius[1:], radius[:-1]) < _NEAR * run).all():
        return ""
    share = np.arange(_PLACES) / _PLACES
    s = np.append((nodes[:-1, None] + np.diff(nodes)[:, None] * share).ravel(), nodes[-1])
    _, xi, k, *_ = shape.strains(s).T
    curvature, radius = np.hypot(xi, k), arm.radius.evaluate(s, arm.length)[0]
    worst = int(np.argmax(curvature * radius))
    if not curvature[worst] * radius[worst] >= 1:
        return ""
    lengths, rest = shape.tendon_lengths, rest_lengths(arm)
    j = int(np.argmax(lengths - rest))
    told = (
        f"the arm bends sharper than its own radius: by a radius of {1e3 / curvature[worst]:.3g} "
        f"mm at s = {s[worst]:.6g} m, where its body has one of {1e3 * radius[worst]:.3g} mm"
    )
    if lengths[j] > rest[j]:
        told += (
            f", and tendon {arm.tendon_name(j)} would have to be {1e3 * lengths[j]:.4g} mm long, "
            f"{1e3 * rest[j]:.4g} mm at rest"
        )
    return f"{told}; lower the tensions or the loads"


def crosses(shape: Bent) -> str:
    """Return where the arm passes through itself; empty where it does not."""
    found: Any = clearances(Centreline.of(shape), (), {ITSELF})[ITSELF]
    if found.gap >= -_TOUCHES * shape.arm.length:
        return ""
    return f"{found}; SelfContact among the effects keeps its parts apart"


@lru_cache(maxsize=256)
def _leverage(arm: Arm) -> Array:
    """Return y R / E J + 1 / E A of each tendon (K, n_tendons) [1/N] at both ends of all steps.

    Where their sum times the tensions is below 1, curvature times radius is, by the balance of the
    paper and of exact tendons on a linear body alike; a neo-Hookean one is stiffer.
    """
    mesh = graded(arm, 1)
    ends = np.column_stack([mesh.s[:-1], mesh.s[1:]]).ravel()
    at = stations(arm, ends, np.repeat(mesh.active, 2))
    place, tendon = np.nonzero(crossing(arm, at))
    y, found = tendon_paths(arm, at, place, tendon)[:2], np.zeros((ends.size, arm.n_tendons))
    radius = arm.radius.evaluate(ends, arm.length)[0]
    share = np.hypot(*y) * radius[place] / at.body[1, place]
    found[place, tendon] = share + 1 / at.body[0, place]
    return found
