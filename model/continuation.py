"""Loaded equilibrium: Newton's method on the shooting constraints, loads brought on by steps.

The constraints couple each segment to its neighbours only, so that a Newton step is found in one
sweep from tip to base: every start of a segment moves by A w + a, where w is what is free at the
tip (its rotation, and the tensions of tendons with friction), and the base's closure gives w. That
is Newton's method on all constraints at the cost of single shooting.
Source: Albersmeyer, Diehl, "The lifted Newton method and its application in optimization", SIAM J.
Optim. 20 (2010).
"""

from __future__ import annotations

import casadi as ca
import numpy as np

from model.errors import SnapError
from model.load_segments import LoadSegments
from model.paths import Array
from model.rotations import multiply
from model.segment import Segment
from model.segment_derivatives import tangents

_STEPS = 12
_SETTLED = 1e-10
_CONTRACTION = 0.25
_TURN, _NEAR = 0.25, 0.02
_SMALL = 1e-3
_LEAST_SHARE = 1 / 1024
_FOLLOWED = 0.6


class LoadedEquilibrium:
    """Finds the states at the segments' starts that settle a loaded arm.

    Attributes
    ----------
    step : casadi.Function
        states X (n_x, segments) in SI units, p -> change of X by a Newton step, and the map (3, 3)
        from a small turn of the tip to the turn of the base: the unit matrix without loads,
        singular where the equilibrium is critical.
    frames : casadi.Function
        states X, p -> quaternions (4, N) at the tip and at all further nodes.
    """

    def __init__(self, system: LoadSegments) -> None:
        self.system = system
        self.n_w = 3 + system.equations.n_tension
        X = ca.MX.sym("X", system.scale.size, len(system.segments))
        p = ca.MX.sym("p", system.arm.n_tendons + 1)
        self.step = ca.Function("step", [X, p], self._step(X, p))
        paths = [segment.map(X[:, i], p)[:4, :] for i, segment in enumerate(system.segments)]
        self.frames = ca.Function("frames", [X, p], [ca.horzcat(X[:4, 0], *paths)])

    def _step(self, X: ca.MX, p: ca.MX) -> list[ca.MX]:
        moves = []
        end = change = ca.MX()
        for i, segment in enumerate(self.system.segments):
            x = X[:, i]
            move = self._at_tip()(x, p) if i == 0 else self._after(segment)(x, end, change, p)
            moves.append(move)
            end, change = tangents(self.system, segment, self.n_w + 1)(x, move, p)
        closure, turn = self._closure()(end, change, p)
        w = ca.vertcat(-ca.solve(turn, closure), 1)
        found = ca.horzcat(*(move @ w for move in moves))
        if self.n_w > 3:
            turn = turn[:3, :3] - turn[:3, 3:] @ ca.solve(turn[3:, 3:], turn[3:, :3])
        return [found, turn]

    def _symbols(self) -> tuple[ca.MX, ca.MX, ca.MX, ca.MX]:
        """Return two states, a change of state (n_x, n_w + 1), and p."""
        n = self.system.scale.size
        x, y = ca.MX.sym("x", n), ca.MX.sym("y", n)
        p = ca.MX.sym("p", self.system.arm.n_tendons + 1)
        return x, y, ca.MX.sym("change", n, self.n_w + 1), p

    def _at_tip(self) -> ca.Function:
        """Return (x, p) -> change of the tip's state: per unit of w, and to meet what holds there.

        w turns the tip about the base frame's axes and changes the tensions that are states.
        """
        x, _, _, p = self._symbols()
        e, n = self.system.equations, x.numel()
        own = 7 + e.statics.size + e.n_force
        G = self.system.segments[0].entry(x, ca.DM.zeros(n), p)
        slope = ca.jacobian(G, x)
        turned = [_times(ca.DM([0, *axis]), x[:4]) / 2 for axis in np.eye(3)]
        free = ca.MX(n, self.n_w)
        free[:4, :3] = ca.horzcat(*turned)
        free[own:, 3:] = ca.DM.eye(e.n_tension)
        met = -ca.solve(slope[:, 7:own], ca.horzcat(slope @ free, G))
        move = ca.horzcat(free, ca.MX(n, 1))
        move[7:own, :] = met
        return ca.Function("tip", [x, p], [ca.densify(move)])

    def _after(self, segment: Segment) -> ca.Function:
        """Return (x, end before, its change, p) -> change of x (n_x, n_w + 1)."""
        x, end, change, p = self._symbols()
        G = segment.entry(x, end, p)
        known = ca.jtimes(G, end, change) + ca.horzcat(ca.MX(x.numel(), self.n_w), G)
        move = -ca.solve(ca.jacobian(G, x), known)
        return ca.Function("after", [x, end, change, p], [ca.densify(move)])

    def _closure(self) -> ca.Function:
        """Return (end, its change, p) -> what is left at the base (n_w,), its slope against w."""
        x, _, change, p = self._symbols()
        n, base = self.n_w - 3, self.system.base
        back = ca.vertcat(base[0], -base[1:4])
        gap = ca.vertcat(2 * _times(x[:4], back)[1:], x[x.numel() - n :] - p[:n])
        moved = ca.jtimes(gap, x, change)
        return ca.Function("closure", [x, change, p], [gap + moved[:, -1], moved[:, :-1]])

    def near(self, X: Array, tensions: Array) -> Array | None:
        """Return the states X (n_x, segments) under the full loads, if others near them lead there.

        Those may be of another mesh, where the loads may have led elsewhere: what is not quite near
        is not taken.
        """
        return self._newton(X, np.append(tensions, 1.0), _NEAR)

    def bring_on(self, X: Array, tensions: Array) -> Array:
        """Return the states under the full loads, on the branch that begins at X without any.

        A step in the loads is taken if Newton's method contracts from the start and no frame turns
        far, and halved if not, or if the equilibrium it leads to has lost its stability.
        """
        share, step = 0.0, 1.0
        frames = self._frames(X, np.append(tensions, share))
        while share < 1:
            trial = np.append(tensions, min(1.0, share + step))
            found = self._newton(X, trial)
            moved = None if found is None else self._frames(found, trial)
            critical = False
            if found is not None and moved is not None and _is_near(frames, moved):
                critical = self._is_past_critical(found, trial)
                if not critical:
                    X, frames, share, step = found, moved, trial[-1], 2 * step
                    continue
            step /= 2
            if step < _LEAST_SHARE:
                raise SnapError(share, "it buckles" if critical else "it snaps or folds")
        return X

    def _frames(self, X: Array, p: Array) -> Array:
        """Return the quaternions (4, N) at all nodes of all segments."""
        quaternions = np.array(self.frames(X, p))
        return np.asarray(quaternions / np.linalg.norm(quaternions, axis=0))

    def _newton(self, X: Array, p: Array, farthest: float = _TURN) -> Array | None:
        """Return the solution near X, or None where the steps are not small or do not shrink.

        That keeps to the branch that X is on. The last step need not be seen to vanish: it shrinks
        quadratically.
        """
        last: float | None = None
        for _ in range(_STEPS):
            change = np.array(self.step(X, p)[0])
            if not np.all(np.isfinite(change)):
                return None
            X = X + change
            size = self._size(change, X)
            if last is None:
                if np.abs(change[:4]).max() > farthest:
                    return None
                shrinks = 1.0
            else:
                shrinks = size / last
                if shrinks > _CONTRACTION and size > _SMALL:
                    return None
            if size * min(shrinks, 1.0) < _SETTLED:
                return self._placed(X, p)
            last = size
        return None

    def _size(self, change: Array, X: Array) -> float:
        scale = self.system.scale[:, None]
        relative = np.abs(change / scale) / (1 + np.abs(X / scale))
        return float(np.delete(relative, (4, 5, 6), axis=0).max())

    def _placed(self, X: Array, p: Array) -> Array:
        """Return X moved as a whole, so that the arm begins at its base.

        Newton's method leaves the position of the tip and the length of the quaternions alone.
        """
        end = np.array(self.system.segments[-1].map(X[:, -1], p))[:, -1]
        X[4:7] += (np.array(self.system.base[4:7]).ravel() - end[4:7])[:, None]
        X[:4] /= np.linalg.norm(end[:4])
        return X

    def _is_past_critical(self, X: Array, p: Array) -> bool:
        turn = np.array(self.step(X, p)[1])
        values = np.linalg.eigvals(turn)
        real = np.abs(values.imag) < 1e-6 * np.abs(values)
        return bool(np.any(values.real[real] <= 0))


def _times(p: ca.MX | ca.DM, q: ca.MX | ca.DM) -> ca.MX:
    """Return the product of two quaternions."""
    a, b = ca.SX.sym("a", 4), ca.SX.sym("b", 4)
    return ca.Function("times", [a, b], [multiply(a, b)])(p, q)


def _is_near(before: Array, after: Array) -> bool:
    """Return whether no frame turns by more than is followed in one step."""
    return bool(np.abs((before * after).sum(axis=0)).min() > np.cos(_FOLLOWED / 2))
