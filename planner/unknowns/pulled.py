"""Equilibria as they are reached from rest: loads in full first, then tensions drawn evenly.

That is the way that an arm takes which is measured, and it is a short one from the shapes under
tensions nearby. Where it leads nowhere the arm is settled as `settle` does it.
"""

from __future__ import annotations

import numpy as np

from model.equilibrium.forward import Collocation
from model.equilibrium.linearised import Linearised
from model.equilibrium.newton import newton
from model.loads import is_loaded
from model.paths import Array
from model.transcription.system import System
from model.unloaded.stretch import check_stretch

# The farthest that Newton's method may correct a predicted frame, as a change of its quaternion,
# and the least step of the tensions, over their whole change.
FARTHEST, _LEAST = 0.1, 1 / 128
# States as near as this have the same tangents, for a guess.
_SAME = 1e-6


class Pulled:
    """The equilibria of one arm in one scene that are known, and those that follow from them."""

    def __init__(self, system: System) -> None:
        self.system, self.forward = system, Collocation.on(system)
        self.known: list[tuple[Array, Linearised]] = []

    def at(self, tensions: Array, near: Linearised | None = None) -> Linearised:
        """Return the equilibrium under tensions (n_tendons,); raises what `settle` does.

        An equilibrium that may be `near` spares factorisations if it is.
        """
        found = self._at(tensions, near)
        check_stretch(self.forward, self.forward.rows(found)[1])
        return found

    def _at(self, tensions: Array, near: Linearised | None) -> Linearised:
        if not is_loaded(self.system.scene):
            return self.forward.found(tensions)
        if not self.known:
            none = np.zeros_like(tensions)
            self.known.append((none, self.forward.found(none)))
        start, here = min(self.known, key=lambda own: float(np.linalg.norm(own[0] - tensions)))
        found = self._beside(start, here, tensions, near) if near else None
        found = found or self._drawn(start, here, tensions) or self.forward.found(tensions)
        self.known.append((tensions, found))
        return found

    def _beside(
        self, start: Array, here: Linearised, end: Array, near: Linearised
    ) -> Linearised | None:
        """Return the equilibrium that one step leads to, if it is near another."""
        guess = here.states + here.by_tensions @ (end - start)
        found = newton(self.system, end, 1.0, guess, FARTHEST, kept=near)
        if found is None or np.abs(found.states - near.states).max() > _SAME:
            return found
        return Linearised(self.system, found.x, near)

    def _drawn(self, start: Array, here: Linearised, end: Array) -> Linearised | None:
        """Return the equilibrium at the end of a straight way of the tensions."""
        share, step, change, longer = 0.0, 1.0, end - start, 2.0
        while share < 1 and step >= _LEAST:
            to = min(1.0, share + step)
            here = here.refreshed
            guess = here.states + here.by_tensions @ (change * (to - share))
            found = newton(self.system, start + to * change, 1.0, guess, FARTHEST)
            if found is None:
                step, longer = (to - share) / 2, 1.0
            else:
                here, share, step, longer = found, to, longer * step, 2.0
        return here if share >= 1 else None
