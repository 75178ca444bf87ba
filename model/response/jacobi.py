"""Whether a loaded equilibrium has lost its stability, by Jacobi's criterion.

Let the base turn as it will, the tensions at the motors kept: small turns of the tip then turn the
frames along the arm, none of them without loads more than another. In a conservative scene the
equilibrium is stable where no small turn of the tip leaves a frame on the way unturned.
Source: Gelfand, Fomin, "Calculus of variations", Prentice-Hall 1963, section 26.
"""

from __future__ import annotations

import casadi as ca
import numpy as np

from model.loaded.lifting import Crossing, Lifting
from model.paths import Array

OVERFLOW = "its equations overflow"
BUCKLES = "it buckles"


class Jacobi:
    """The criterion for one system.

    Attributes
    ----------
    function : casadi.Function
        States X (n_x, segments) at the starts, p -> how the frames at all nodes turn with the w of
        their segment (3, n_w nodes), all R (n_w, n_w segments), and how the tensions at the motors
        change with the last w (n_tension, n_w); see model.loaded.lifting.
    """

    def __init__(self, lifting: Lifting, crossings: list[Crossing], X: ca.MX, p: ca.MX) -> None:
        self.n_w = lifting.n_w
        turns = [lifting.turns(crossing) for crossing in crossings]
        R = [ca.densify(crossing.R) for crossing in crossings]
        outputs = [ca.horzcat(*turns), ca.horzcat(*R), ca.densify(lifting.held(crossings, p))]
        self.function = ca.Function("turns", [X, p], outputs)
        counts = [turn.shape[1] // self.n_w for turn in turns]
        self.segment = np.repeat(np.arange(len(turns)), counts)

    def lost(self, X: Array, p: Array) -> str:
        """Return what happens to an equilibrium that has lost its stability, nothing if it has not.

        Where a turn is singular between two nodes, the map from one node's turn to the next has an
        eigenvalue on the negative side, once for each direction that turns over. It does not matter
        against which three numbers the turns of a segment are.
        """
        found, R, held = (value.full() for value in self.function(X, p))
        if not (np.isfinite(found).all() and np.isfinite(R).all()):
            return OVERFLOW
        turns = np.moveaxis(found.reshape(3, -1, self.n_w), 1, 0)
        if held.size:
            turns = turns @ self._free(R, held)[self.segment]
        inside = self.segment[1:] == self.segment[:-1]
        steps = turns[1:][inside] @ np.linalg.pinv(turns[:-1][inside])
        return BUCKLES if np.linalg.eigvals(steps).real.min() < 0 else ""

    def _free(self, R: Array, held: Array) -> Array:
        """Return the w that keep the tensions at the motors (segments, n_w, 3), orthonormal."""
        free = [np.linalg.svd(held)[2][held.shape[0] :].T]
        for passage in np.hsplit(R, R.shape[1] // self.n_w)[:0:-1]:
            free.append(np.linalg.qr(np.linalg.solve(passage, free[-1]))[0])
        return np.array(free[::-1])
