"""Equilibria on a mesh whose tendons winches hold; what `settle` refines."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from model.arm import Arm
from model.equilibrium.complementarity import determined
from model.equilibrium.forward import Collocation, Known
from model.equilibrium.hold import HeldLengths
from model.equilibrium.linearised import Linearised
from model.equilibrium.newton import newton
from model.forward import ForwardMap
from model.loads import is_loaded
from model.paths import Array
from model.scene import Scene
from model.unloaded.by_lengths import UnloadedLengths
from model.winches import Winches

# Of the least give of winches, where steps may be as if they were rigid.
_RIGID = 1e-4
# Newton steps to rounding.
_TIGHTENED = 2


class OnMesh(NamedTuple):
    """An equilibrium on a mesh.

    Attributes
    ----------
    tensions : (n_tendons,)
        [N].
    states, stretch
        See ForwardMap.run.
    left : (n_tendons,)
        What is left of held tendons beyond their paths [m], nan of others; None without any.
    """

    tensions: Array
    states: Array
    stretch: Array
    left: Array | None = None


class Near(NamedTuple):
    """Tensions and states of an equilibrium that another mesh has."""

    tensions: Array
    known: Known | None


@dataclass(frozen=True, eq=False)
class GivenTensions:
    """Tensions that motors hold."""

    tensions: Array
    winches: None = None

    def on(self, forward: ForwardMap, near: Near | None) -> OnMesh:
        """Return the equilibrium on the mesh of a forward map, near that of another if given."""
        known: Any = None if near is None else near.known
        return OnMesh(self.tensions, *forward.run(self.tensions, known))


@dataclass(frozen=True, eq=False)
class GivenLengths:
    """Lengths that winches leave, of some tendons or all."""

    arm: Arm
    scene: Scene
    winches: Winches

    def on(self, forward: ForwardMap, near: Near | None) -> OnMesh:
        """See GivenTensions.on; raises InputError where no shape has the lengths."""
        unloaded = UnloadedLengths(self.arm, self.scene, forward.mesh, self.winches)
        if not (is_loaded(self.scene) and isinstance(forward, Collocation)):
            T, left = unloaded.found(None if near is None else near.tensions)
            return OnMesh(T, *forward.run(T), left)
        hold = HeldLengths(self.winches)
        here = None
        if near is not None and near.known is not None:
            here = forward.near(near.tensions, near.known, hold)
        if here is None:
            here = forward.from_rest(unloaded.found(None)[0], hold)
        here = _tightened(here, hold)
        left = self.winches.lacks(here.lengths, here.tensions)
        return OnMesh(here.tensions, *forward.rows(here), np.where(self.winches.held, left, np.nan))


def _tightened(here: Linearised, hold: HeldLengths) -> Linearised:
    """Return an equilibrium with its weakly determined tensions found as well, to rounding.

    By Newton steps in all unknowns; combinations of tensions that no length feels stay as they are.
    """
    system, winches, T = here.system, hold.winches, here.tensions
    rigid = replace(hold, share=_RIGID)
    here = newton(system, T, 1.0, here.states, hold=rigid) or here
    taut = np.flatnonzero(winches.held & (here.tensions > 0))
    for _ in range(_TIGHTENED):
        at = Linearised.at(system, here.x)
        change, now = -at.solve(at.residual), at.tensions
        M = np.diag(winches.stretch[taut]) - at.length_tension[np.ix_(taut, taut)]
        lacks = winches.lacks(at.lengths + at.length_slopes @ change, now)[taut]
        after = now.copy()
        after[taut] = determined(M, lacks, now[taut], T[taut])
        if after.min(initial=0.0) < 0:
            break
        change += at.by_tensions @ (after - now)
        here = replace(at, x=system.x(after, 1.0, at.states + change))
    return here
