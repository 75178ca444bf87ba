"""Loaded equilibrium: Newton's method on the shooting constraints, loads brought on by steps."""

from __future__ import annotations

import casadi as ca
import numpy as np

from model.errors import SnapError
from model.loaded.lifting import Lifting
from model.loaded.segments import LoadSegments
from model.paths import Array
from model.patience import check_time
from model.progress import tell
from model.response.jacobi import Jacobi

_STEPS = 12
_SETTLED = 1e-10
_CONTRACTION = 0.25
_TURN, _NEAR = 0.25, 0.02
_SMALL = 1e-3
# The least step in the loads over the share of them that acts; before the first, over a millionth.
_LEAST_STEP, _FIRST = 1 / 8192, 1e-6
_FOLLOWED = 0.6
_SNAPS = "it snaps or folds"


class LoadedEquilibrium:
    """Finds the states at the segments' starts that settle a loaded arm.

    Attributes
    ----------
    step : casadi.Function
        states X (n_x, segments) in SI units, p -> change of X by a Newton step.
    jacobi : Jacobi
        Tells what has lost its stability.
    frames : casadi.Function
        states X, p -> quaternions (4, N) at the tip and at all further nodes.
    """

    def __init__(self, system: LoadSegments) -> None:
        self.system = system
        X = ca.MX.sym("X", system.scale.size, len(system.segments))
        p = ca.MX.sym("p", system.n_p)
        lifting = Lifting(system)
        crossings = lifting.sweep(X, p)
        self.step = ca.Function("step", [X, p], [ca.horzcat(*lifting.solve(crossings, p)[0])])
        self.jacobi = Jacobi(lifting, crossings, X, p)
        paths = [segment.map(X[:, i], p)[:4, :] for i, segment in enumerate(system.segments)]
        self.frames = ca.Function("frames", [X, p], [ca.horzcat(X[:4, 0], *paths)])

    def near(self, X: Array, tensions: Array) -> Array | None:
        """Return the states X (n_x, segments) under the full loads, if others near them lead there.

        Those may be of another mesh, where the loads may have led elsewhere: what is not quite near
        is not taken.
        """
        return self._newton(X, self.system.p(tensions, 1.0), _NEAR)

    def bring_on(self, X: Array, tensions: Array) -> Array:
        """Return the states under the full loads, on the branch that begins at X without any.

        Raises SnapError where it ends or loses its stability before.
        """
        X, share, why = self.follow(X, tensions, 1.0, _LEAST_STEP)
        if share < 1:
            raise SnapError(share, why)
        return X

    def follow(
        self, X: Array, tensions: Array, most: float, least: float
    ) -> tuple[Array, float, str]:
        """Follow the branch that begins at the states X without loads, up to a share of them.

        A step in the loads is halved where there is nothing that it leads to; the end is where it
        is down to `least` of the share that is reached.

        Returns
        -------
        X, share, why
            The last states, the share of the loads there, and what happens beyond.
        """
        share, step, why = 0.0, min(1.0, most), ""
        frames = self._frames(X, self.system.p(tensions, share))
        while share < most and step >= least * max(share, _FIRST):
            check_time()
            tell("percent of the loads", round(100 * share / most), 100)
            trial = min(most, share + step)
            found, why = self._next(X, frames, self.system.p(tensions, trial))
            if found is None:
                step = step / 2
            else:
                (X, frames), share, step = found, trial, 2 * step
        return X, share, why

    def _next(self, X: Array, frames: Array, p: Array) -> tuple[tuple[Array, Array] | None, str]:
        """Return the states and frames that a step in the loads leads to, or why there are none.

        Newton's method has to contract from the start, no frame to turn far, and the equilibrium
        to have kept its stability.
        """
        found = self._newton(X, p)
        if found is None:
            return None, _SNAPS
        moved = self._frames(found, p)
        if not _is_near(frames, moved):
            return None, _SNAPS
        why = self.jacobi.lost(found, p)
        return (None if why else (found, moved)), why

    def _frames(self, X: Array, p: Array) -> Array:
        """Return the quaternions (4, N) at all nodes of all segments."""
        quaternions = np.array(self.frames(X, p))
        # What a sweep has blown up is near nothing, and is not taken.
        with np.errstate(all="ignore"):
            return np.asarray(quaternions / np.linalg.norm(quaternions, axis=0))

    def _newton(self, X: Array, p: Array, farthest: float = _TURN) -> Array | None:
        """Return the solution near X, or None where the steps are not small or do not shrink.

        That keeps to the branch that X is on. The last step need not be seen to vanish: it shrinks
        quadratically.
        """
        last = 0.0
        for _ in range(_STEPS):
            change = self._change(X, p)
            if change is None:
                return None
            X = X + change
            size = self._size(change, X)
            shrinks = size <= max(_CONTRACTION * last, _SMALL)
            if not (shrinks if last else np.abs(change[:4]).max() <= farthest):
                return None
            if size < _SETTLED or size**2 < _SETTLED * last:
                return self._placed(X, p)
            last = size
        return None

    def _change(self, X: Array, p: Array) -> Array | None:
        """Return a Newton step, or None where there is none."""
        try:
            change = np.array(self.step(X, p))
        except RuntimeError:  # a singular matrix, in CasADi's words
            return None
        return change if np.all(np.isfinite(change)) else None

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


def _is_near(before: Array, after: Array) -> bool:
    """Return whether no frame turns by more than is followed in one step."""
    return bool(np.abs((before * after).sum(axis=0)).min() > np.cos(_FOLLOWED / 2))
