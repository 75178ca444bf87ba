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


class Pulled:
    """The equilibria of one arm in one scene that are known, and those that follow from them."""

    def __init__(self, system: System) -> None:
        self.system, self.forward = system, Collocation.on(system)
        self.known: list[tuple[Array, Linearised]] = []

    def at(self, tensions: Array) -> Linearised:
        """Return the equilibrium under tensions (n_tendons,); raises what `settle` does."""
        found = self._at(tensions)
        check_stretch(self.forward, self.forward.rows(found)[1])
        return found

    def _at(self, tensions: Array) -> Linearised:
        if not is_loaded(self.system.scene):
            return self.forward.found(tensions)
        if not self.known:
            none = np.zeros_like(tensions)
            self.known.append((none, self.forward.found(none)))
        start, here = min(self.known, key=lambda own: float(np.linalg.norm(own[0] - tensions)))
        found = self._drawn(start, here, tensions) or self.forward.found(tensions)
        self.known.append((tensions, found))
        return found

    def _drawn(self, start: Array, here: Linearised, end: Array) -> Linearised | None:
        """Return the equilibrium at the end of a straight way of the tensions."""
        share, step, change = 0.0, 1.0, end - start
        while share < 1 and step >= _LEAST:
            to = min(1.0, share + step)
            here = Linearised(self.system, here.x)
            guess = here.states + here.by_tensions @ (change * (to - share))
            found = newton(self.system, start + to * change, 1.0, guess, FARTHEST)
            if found is None:
                step /= 2
            else:
                here, share, step = found, to, 2 * step
        return here if share >= 1 else None
