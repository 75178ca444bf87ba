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
# Places in each step of a mesh at which curvature is looked at.
_PLACES = 4
# What tensions bend a section by at most, as curvature times radius, from which on that is looked
# at: a bound without loads by the bending stiffness at rest, which holds within a factor of five.
_LIGHT = 0.2


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
    if not is_loaded(shape.scene) and float(shape.tensions @ _leverage(arm)) < _LIGHT:
        return ""
    nodes = shape.s
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
    """Return the most of y R / E J along each tendon (n_tendons,) [1/N]."""
    mesh = graded(arm, 1)
    ends = np.column_stack([mesh.s[:-1], mesh.s[1:]]).ravel()
    at = stations(arm, ends, np.repeat(mesh.active, 2))
    place, tendon = np.nonzero(crossing(arm, at))
    y, most = tendon_paths(arm, at, place, tendon)[:2], np.zeros(arm.n_tendons)
    radius = arm.radius.evaluate(ends, arm.length)[0]
    share = np.hypot(*y) * radius[place] / at.body[1, place]
    np.maximum.at(most, tendon, share)
    return most
