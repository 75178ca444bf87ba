"""Linear solutions of the shooting constraints in one sweep from tip to base.

The constraints couple each segment to its neighbours only. Every start of a segment moves by
A w + a, where w is what is free at the tip (its rotation, and the tensions of tendons with
friction), and the base's closure gives w. With a the defects of the constraints that is Newton's
method on all of them at the cost of single shooting; with a the slopes against parameters it is
the implicit function theorem.
Source: Albersmeyer, Diehl, "The lifted Newton method and its application in optimization", SIAM J.
Optim. 20 (2010).
"""

from __future__ import annotations

import casadi as ca
import numpy as np

from model.load_segments import LoadSegments
from model.rotations import multiply
from model.segment import Segment
from model.segment_derivatives import tangents, trail

# A dense factorisation with pivots: the sparse one that is the default fails on tiny entries.
LINEAR = "lapacklu"


class Lifting:
    """The linearised constraints of a system, for Newton steps or for directions of parameters.

    Attributes
    ----------
    directions : (n_p, m) or None
        Changes of the parameters; None for Newton steps.
    """

    def __init__(self, system: LoadSegments, directions: ca.DM | None = None) -> None:
        self.system, self.directions = system, directions
        self.n_w = 3 + system.equations.n_tension
        self.columns = self.n_w + (1 if directions is None else directions.shape[1])

    def solve(self, X: ca.MX, p: ca.MX) -> tuple[list[ca.MX], ca.MX]:
        """Return the change of each start (n_x, m), and that at the base.

        X (n_x, segments) are the states at the starts. Positions change as if the tip's were held.
        """
        moves = []
        end = change = ca.MX()
        for i, segment in enumerate(self.system.segments):
            x = X[:, i]
            move = self._at_tip()(x, p) if i == 0 else self._after(segment)(x, end, change, p)
            moves.append(move)
            across = tangents(self.system, segment, self.columns, self.directions)
            end, change = across(x, move, p)
        left, turn = self._closure()(end, change, p)
        w = -ca.solve(turn, left, LINEAR)
        n = self.n_w
        found = [move[:, :n] @ w + move[:, n:] for move in (*moves, change)]
        return found[:-1], found[-1]

    def turns(self, X: ca.MX, p: ca.MX) -> ca.MX:
        """Return the turns (3, 3 N) of the frames at the nodes for small turns of the tip.

        From tip to base, tensions at the motors kept, and whatever that takes at the base. All are
        the unit matrix without loads. By Jacobi's criterion the equilibrium is stable, in a
        conservative scene, where none is singular.
        """
        end = change = ca.MX()
        rows = []
        for i, segment in enumerate(self.system.segments):
            x = X[:, i]
            move = self._at_tip()(x, p) if i == 0 else self._after(segment)(x, end, change, p)
            along = trail(self.system, segment, self.columns)(x, move, p)
            rows += ca.horzsplit(along, 1 + self.columns)
            end, change = rows[-1][:, 0], rows[-1][:, 1:]
        _, slope = self._closure()(end, change, p)
        free = ca.MX.eye(3)
        if self.n_w > 3:
            free = ca.vertcat(free, -ca.solve(slope[3:, 3:], slope[3:, :3], LINEAR))
        turn = _turn()
        turned = [
            ca.horzcat(*(turn(row[:4, 0], row[:4, 1 + k]) for k in range(self.n_w))) for row in rows
        ]
        return ca.horzcat(*(turned_by @ free for turned_by in turned))

    def _symbols(self) -> tuple[ca.MX, ca.MX, ca.MX, ca.MX]:
        """Return two states, a change of state (n_x, columns), and p."""
        n = self.system.scale.size
        x, y = ca.MX.sym("x", n), ca.MX.sym("y", n)
        p = ca.MX.sym("p", self.system.n_p)
        return x, y, ca.MX.sym("change", n, self.columns), p

    def _own(self, G: ca.MX, p: ca.MX) -> ca.MX:
        """Return what has to vanish of G besides its share of w: its defect, or its slopes."""
        own = G if self.directions is None else ca.jtimes(G, p, self.directions)
        return ca.horzcat(ca.MX(G.numel(), self.n_w), own)

    def _at_tip(self) -> ca.Function:
        """Return (x, p) -> change of the tip's state, whose pose and tensions are free.

        w turns the tip about the base frame's axes and changes the tensions that are states.
        """
        x, _, _, p = self._symbols()
        n, pulls = x.numel(), self.system.tensions
        G = self.system.segments[0].entry(x, ca.DM.zeros(n), p)
        slope = ca.jacobian(G, x)
        turned = [_times(ca.DM([0, *axis]), x[:4]) / 2 for axis in np.eye(3)]
        move = ca.MX(n, self.columns)
        move[:4, :3] = ca.horzcat(*turned)
        move[pulls, 3 : self.n_w] = ca.DM.eye(self.n_w - 3)
        bound = [i for i in range(7, n) if not pulls.start <= i < pulls.stop]
        move[bound, :] = -ca.solve(slope[:, bound], slope @ move + self._own(G, p), LINEAR)
        return ca.Function("tip", [x, p], [ca.densify(move)])

    def _after(self, segment: Segment) -> ca.Function:
        """Return (x, end before, its change, p) -> change of x (n_x, columns)."""
        x, end, change, p = self._symbols()
        G = segment.entry(x, end, p)
        known = ca.jtimes(G, end, change) + self._own(G, p)
        move = -ca.solve(ca.jacobian(G, x), known, LINEAR)
        return ca.Function("after", [x, end, change, p], [ca.densify(move)])

    def _closure(self) -> ca.Function:
        """Return (end, its change, p) -> what is left at the base (n_w, m), its slope against w."""
        x, _, change, p = self._symbols()
        base = self.system.base
        back = ca.vertcat(base[0], -base[1:4])
        pulls = x[self.system.tensions] - p[: self.n_w - 3]
        gap = ca.vertcat(2 * _times(x[:4], back)[1:], pulls)
        moved = ca.jtimes(gap, x, change) + self._own(gap, p)
        return ca.Function("closure", [x, change, p], [moved[:, self.n_w :], moved[:, : self.n_w]])


def _times(p: ca.MX | ca.DM, q: ca.MX | ca.DM) -> ca.MX:
    """Return the product of two quaternions."""
    a, b = ca.SX.sym("a", 4), ca.SX.sym("b", 4)
    return ca.Function("times", [a, b], [multiply(a, b)])(p, q)


def _turn() -> ca.Function:
    """Return (q, its change) -> the small turn (3,) about the base frame's axes."""
    q, change = ca.SX.sym("q", 4), ca.SX.sym("change", 4)
    back = ca.vertcat(q[0], -q[1:])
    return ca.Function("turn", [q, change], [2 * multiply(change, back)[1:] / ca.sumsqr(q)])
