"""The equilibrium of an arm with pairs of its places held shut, at which it presses on itself.

The forces at a pair act as point loads; these and the places are found by Newton's method with
Broyden's updates (Nocedal and Wright, "Numerical Optimization", 2006, 11.1) over settled shapes,
from differences of these.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from scipy.linalg import null_space

from model.contact.pairs import Pair, loaded_by
from model.paths import Array
from model.scene import Scene
from model.shape import Shape
from model.time_limit import check_time

# Newton's steps; differences over the length and over the force that bends the arm; what is found.
_STEPS, _DIFFERENCE, _FOUND = 25, 1e-5, 2e-10
# A step's longest change of places, over the length.
_FARTHEST = 0.05

# Tensions (n_tendons,), a scene, a shape that is nearby -> the shape.
Settle = Callable[[Array, Scene, Shape | None], Shape]


@dataclass(frozen=True, eq=False)
class PairsShut:
    """What finds the equilibria.

    Attributes
    ----------
    tensions : (n_tendons,)
    scene : Scene
        Without contact of the arm with itself.
    settle : Settle
    unit : float
        Of forces: what bends the arm [N].
    """

    tensions: Array
    scene: Scene
    settle: Settle
    unit: float

    def solved(
        self, share: float, pairs: tuple[Pair, ...], near: Shape
    ) -> tuple[Shape, tuple[Pair, ...]] | None:
        """Return the equilibrium with pairs held shut, places that reach the tip held there."""
        if not pairs:
            return self.settle(share * self.tensions, self.scene, near), ()
        found = self._newton(share, pairs, near)
        if found is None:
            return None
        shape, pairs = found
        for k, pair in enumerate(pairs):
            free = replace(pair, at_tip=False)
            if pair.at_tip and free.residual(shape, np.zeros((3, 2)))[4] > 1e-6:
                inside = np.array([pair.s[0], pair.s[1] - 1e-3 * shape.arm.length])
                freed = (*pairs[:k], replace(free, s=inside), *pairs[k + 1 :])
                return self.solved(share, freed, shape)
        return found

    def _newton(
        self, share: float, pairs: tuple[Pair, ...], near: Shape
    ) -> tuple[Shape, tuple[Pair, ...]] | None:
        """Return the shape and pairs whose residuals vanish; None where steps do not lead there."""
        across = [null_space(np.subtract(*near.position(pair.s)[::-1])[None]) for pair in pairs]
        L, length = near.arm.length, [pair.unknowns.size for pair in pairs]
        cuts = np.cumsum(length)[:-1]
        units = np.concatenate([[*[self.unit] * 3, *[L] * (n - 3)] for n in length])
        scales = np.concatenate([[L, self.unit, self.unit, *[1.0] * (n - 3)] for n in length])

        def at(z: Array, by: Shape) -> tuple[Array, Shape, tuple[Pair, ...]]:
            parts_of_z = np.split(z * units, cuts)
            own = tuple(p.at(part) for p, part in zip(pairs, parts_of_z, strict=True))
            shape = self.settle(share * self.tensions, loaded_by(by.arm, self.scene, own), by)
            parts = [p.residual(shape, e) for p, e in zip(own, across, strict=True)]
            return np.concatenate(parts) / scales, shape, own

        z = np.concatenate([pair.unknowns for pair in pairs]) / units
        r, shape, own = at(z, near)
        J, fresh = self._jacobian(partial(at, by=shape), z, r), True
        for _ in range(_STEPS):
            check_time()
            if np.abs(r).max() < _FOUND:
                return shape, own
            step = np.linalg.lstsq(J, -r, rcond=1e-12)[0]
            places = np.abs(step[units == L]).max()
            step *= min(1.0, _FARTHEST / max(places, 1e-300))
            after = z + step
            for k, pair in enumerate(pairs):
                if not pair.at_tip and np.split(after, cuts)[k][4] >= 1:
                    tip = replace(own[k], s=np.array([own[k].s[0], L]), at_tip=True)
                    return self._newton(share, (*own[:k], tip, *own[k + 1 :]), shape)
            if (after[units == L] <= 0).any():
                return None
            r_after, shape, own = at(after, shape)
            if np.abs(r_after).max() > 0.5 * np.abs(r).max() and not fresh:
                z, r = after, r_after
                J, fresh = self._jacobian(partial(at, by=shape), z, r), True
                continue
            J = J + np.outer(r_after - r - J @ step, step) / max(step @ step, 1e-300)
            z, r, fresh = after, r_after, False
        return None

    @staticmethod
    def _jacobian(
        at: Callable[[Array], tuple[Array, Shape, tuple[Pair, ...]]], z: Array, r: Array
    ) -> Array:
        """Return the derivatives of residuals by differences, towards the base for places."""
        columns = []
        for k in range(z.size):
            moved, h = z.copy(), -_DIFFERENCE
            moved[k] += h
            columns.append((at(moved)[0] - r) / h)
        return np.array(columns).T
