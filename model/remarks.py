"""What no arm does though its equations have it: what a settled shape tells besides its numbers."""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np

from model.centreline import Centreline, Settled
from model.clearance.nearest import ITSELF, clearances
from model.equilibrium.equilibrium import Equilibrium
from model.paths import Array
from model.winches import rest_lengths

# How deep parts may be in each other, over the arm's length: what contact of them leaves.
_TOUCHES = 1e-6
# Places in each step of a mesh at which curvature is looked at, where at the mesh's own places it
# comes as near to one over the radius as this.
_PLACES, _NEAR = 4, 0.7


class Bent(Settled, Protocol):
    """A settled shape; see model.shape.Shape."""

    @property
    def equilibrium(self) -> Equilibrium:
        """What it is read off."""

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

    Its inner side would have no length left. Empty where it does not.
    """
    if shape.equilibrium.bend < _NEAR:
        return ""
    arm, nodes = shape.arm, shape.s
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
