"""Linear solutions of the shooting constraints in one sweep from tip to base and back.

The constraints couple each segment to its neighbours only. Every start of a segment moves by
Q w + a, where w is what is free beyond it: as many numbers as at the tip, its rotation and the
tensions of tendons with friction. The base's closure gives the last w, and each w the one before.
With a the defects of the constraints that is Newton's method on all of them at the cost of single
shooting; with a the slopes against parameters it is the implicit function theorem.

Under a heavy pull what is free at the tip is felt at the base e^50 times over. So each segment has
its own w: the columns Q that come to it are made orthonormal, a is made orthogonal to them, and w
follows from that before by R w + c.
Sources: Albersmeyer, Diehl, "The lifted Newton method and its application in optimization", SIAM J.
Optim. 20 (2010); Conte, "The numerical solution of linear boundary value problems", SIAM Review 8
(1966), for the orthonormal columns.
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca

from model.integrators.orthonormal import Orthonormal
from model.loaded.segment_tangents import tangents
from model.loaded.segments import LoadSegments
from model.loaded.small_systems import solve_small
from model.rotations import small_turns, turning
from model.segment import Segment


@dataclass(frozen=True, eq=False)
class Crossing:
    """How the states of one segment move.

    Attributes
    ----------
    start : (n_x, 1 + columns)
        At the first node, on the tip side: the state, then Q and a.
    further : (n_x, N (1 + columns))
        The same at each of N further nodes, side by side.
    R, c : (n_w, n_w), (n_w, m)
        w = R w_before + c; of no meaning at the tip.
    """

    start: ca.MX
    further: ca.MX
    R: ca.MX
    c: ca.MX

    @property
    def end(self) -> ca.MX:
        """The last node, on the base side."""
        return self.further[:, -self.start.shape[1] :]

    @property
    def nodes(self) -> list[ca.MX]:
        """All nodes from tip to base."""
        return [self.start, *ca.horzsplit(self.further, self.start.shape[1])]


class Lifting:
    """The linearised constraints of a system, for Newton steps or for directions of parameters.

    Attributes
    ----------
    directions : (n_p, m) or None
        Changes of the parameters; None for Newton steps.
    n_w : int
        How much is free at the tip.
    """

    def __init__(self, system: LoadSegments, directions: ca.DM | None = None) -> None:
        self.system, self.directions = system, directions
        self.n_w = 3 + system.equations.n_tension
        self.columns = self.n_w + (1 if directions is None else directions.shape[1])
        self.orthonormal = Orthonormal(self._weights(), self.n_w, self.columns - self.n_w)

    def sweep(self, X: ca.MX, p: ca.MX) -> list[Crossing]:
        """Return how the segments move, tip side first.

        X (n_x, segments) are the states at the starts. Positions move as if the tip's were held.
        """
        found: list[Crossing] = []
        for i, segment in enumerate(self.system.segments):
            x = X[:, i]
            if found:
                end = found[-1].end
                move = self._after(segment)(x, end[:, 0], end[:, 1:], p)
            else:
                move = self._at_tip()(x, p)
            move, R, c = self.orthonormal.columns(move)
            further = tangents(self.system, segment, self.columns, self.directions)(x, move, p)
            found.append(Crossing(ca.horzcat(x, move), further, R, c))
        return found

    def solve(self, crossings: list[Crossing], p: ca.MX) -> tuple[list[ca.MX], ca.MX]:
        """Return the change of each start (n_x, m), and that at the base."""
        n, end = self.n_w, crossings[-1].end
        gap = self._gap(end, p)
        w = -solve_small(gap[:, :n], gap[:, n:])
        base, moves = _moved(end, w), []
        for crossing in reversed(crossings):
            moves.append(_moved(crossing.start, w))
            w = self.orthonormal.before(crossing.R, w - crossing.c)
        return moves[::-1], base

    def turns(self, crossing: Crossing) -> ca.MX:
        """Return how the frames at a segment's nodes turn with w (3, n_w (N + 1))."""
        turn, w = small_turns(), slice(1, 1 + self.n_w)
        return ca.horzcat(*(turn(node[:4, 0]) @ node[:4, w] for node in crossing.nodes))

    def held(self, crossings: list[Crossing], p: ca.MX) -> ca.MX:
        """Return how the tensions at the motors change with the last w (n_tension, n_w)."""
        return self._gap(crossings[-1].end, p)[3:, : self.n_w]

    def _weights(self) -> tuple[float, ...]:
        """Return what the components of a change of state count in its size.

        Positions and lengths count for nothing: nothing else depends on them.
        """
        weights = 1 / self.system.scale
        weights[4:7] = 0
        weights[self.system.equations.tensions.stop :] = 0
        return tuple(weights.tolist())

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
        n, pulls = x.numel(), self.system.equations.tensions
        G = self.system.segments[0].entry(x, ca.DM.zeros(n), p)
        slope = ca.jacobian(G, x)
        move = ca.MX(n, self.columns)
        move[:4, :3] = turning()(x[:4])
        move[pulls, 3 : self.n_w] = ca.DM.eye(self.n_w - 3)
        bound = [i for i in range(7, n) if not pulls.start <= i < pulls.stop]
        move[bound, :] = -solve_small(slope[:, bound], slope @ move + self._own(G, p))
        return ca.Function("tip", [x, p], [ca.densify(move)])

    def _after(self, segment: Segment) -> ca.Function:
        """Return (x, end before, its change, p) -> change of x (n_x, columns)."""
        x, end, change, p = self._symbols()
        G = segment.entry(x, end, p)
        known = ca.jtimes(G, end, change) + self._own(G, p)
        move = -solve_small(ca.jacobian(G, x), known)
        return ca.Function("after", [x, end, change, p], [ca.densify(move)])

    def _gap(self, end: ca.MX, p: ca.MX) -> ca.MX:
        """Return how the base's gap changes with w, and what is left of it (n_w, columns).

        The gap is its turn from the clamp, and the tensions there less those at the motors.
        """
        x, _, change, p_ = self._symbols()
        turned = small_turns()(self.system.base[:4]) @ x[:4]
        gap = ca.vertcat(turned, x[self.system.equations.tensions] - p_[: self.n_w - 3])
        moved = ca.jtimes(gap, x, change) + self._own(gap, p_)
        return ca.Function("closure", [x, change, p_], [moved])(end[:, 0], end[:, 1:], p)


def _moved(node: ca.MX, w: ca.MX) -> ca.MX:
    """Return the change of state (n_x, m) of a node of a crossing for w (n_w, m)."""
    n = w.shape[0]
    return node[:, 1 : 1 + n] @ w + node[:, 1 + n :]
