"""How an arm comes to press on itself: tensions grow from none, pairs of places come and go.

The forces at a pair act as point loads; these and the places are found by Newton's method with
Broyden's updates (Nocedal and Wright, "Numerical Optimization", 2006, 11.1) over settled shapes,
from differences of these. Steps in the tensions are so short that parts that are apart cannot pass
through each other within one.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from scipy.linalg import null_space

from model.contact.pairs import Pair, loaded_by, nearest_pairs
from model.errors import OctoplanError, UnsettledContactError
from model.paths import Array
from model.progress import tell
from model.scene import Scene
from model.shape import Shape
from model.time_limit import check_time

# Steps in the share of the tensions; places at which the arm is looked at.
_FIRST, _LEAST, _LOOKS = 0.25, 1 / 1024, 200
# How deep parts may be in each other when a pair begins, over the lesser radius.
_DEEP = 0.5
# Newton's steps; differences over the length and over the force that bends the arm; what is found.
_STEPS, _DIFFERENCE, _FOUND = 25, 1e-5, 2e-10
# A step's longest change of places, over the length; how far apart places are another pair's.
_FARTHEST, _OTHER = 0.05, 0.03
# A push sideways, over the force of a pair.
_PUSH = 1e-3
# How often pairs come and go at one share, and what a gap may be below 0, over the length.
_CHANGES, _THROUGH = 8, 1e-9

# Tensions (n_tendons,), a scene, a shape that is nearby -> the shape.
Settle = Callable[[Array, Scene, Shape | None], Shape]


@dataclass(frozen=True, eq=False)
class _Here:
    shape: Shape
    pairs: tuple[Pair, ...]
    least: float


def pressed_on_itself(tensions: Array, scene: Scene, settle: Settle) -> Shape:
    """Return the shape of an arm whose parts press on each other, in the scene without that.

    Raises UnsettledContactError where none is found, and what `settle` does.
    """
    own = _Following(tensions, scene, settle)
    here, share, step = own.begin(), 0.0, _FIRST
    while share < 1:
        check_time()
        tell("percent of tensions", round(100 * share), 100)
        after = min(1.0, share + step)
        there = own.moved(here, after)
        if there is not None and own.slips(there, after):
            told = "parts that press on each other slip past each other sideways; a little tension "
            raise UnsettledContactError(after, told + "across decides to which side")
        if there is not None:
            here, share, step = there, after, min(2 * step, _FIRST)
        elif step > _LEAST:
            step /= 2
        else:
            raise UnsettledContactError(share, "where it presses on itself is not found")
    touches = [touch for pair in here.pairs for touch in pair.touches(here.shape)]
    return replace(here.shape, on_itself=tuple(sorted(touches, key=lambda touch: touch.s)))


class _Following:
    """The equilibrium followed while tensions grow."""

    def __init__(self, tensions: Array, scene: Scene, settle: Settle) -> None:
        self.tensions, self.scene, self._settle = tensions, scene, settle
        self.unit = 0.0

    def begin(self) -> _Here:
        """Return the arm without tensions; raises UnsettledContactError if it meets itself."""
        shape = self._settle(0 * self.tensions, self.scene, None)
        found, least = nearest_pairs(shape, _LOOKS)
        if found:
            raise UnsettledContactError(0.0, "the arm without tensions is inside of itself")
        radius = float(shape.arm.outer_radius(np.zeros(1))[0][0])
        self.unit = shape.arm.material.E * radius**4 / shape.arm.length**2
        return _Here(shape, (), least)

    def moved(self, here: _Here, share: float) -> _Here | None:
        """Return the equilibrium at a share of the tensions; None if the step was too long."""
        pairs, near = here.pairs, here.shape
        for _ in range(_CHANGES):
            try:
                found = self._solved(share, pairs, near)
            except OctoplanError:
                return None
            if found is None or self._passes(here, found[0]):
                return None
            near, pairs = found
            forces = [pair.pressed(near) for pair in pairs]
            if forces and min(forces) < 0:
                k = int(np.argmin(forces))
                pairs = (*pairs[:k], *pairs[k + 1 :])
                continue
            lowest, least = nearest_pairs(near, _LOOKS)
            new = [own for own in lowest if self._is_new(own, pairs, near)]
            if not new:
                return _Here(near, pairs, least)
            pairs = (*pairs, new[0])
        return None

    def slips(self, here: _Here, share: float) -> bool:
        """Return whether a pair slips off sideways, other forces held.

        It does where the force, which turns with the line that joins the midlines, grows faster
        than the arm's resistance: P > K d, with d the distance of the midlines.
        """
        for k, pair in enumerate(here.pairs):
            across = pair.sideways(here.shape)
            if across is None:
                continue
            push = _PUSH * max(pair.pressed(here.shape), _PUSH * self.unit)
            pushed = replace(pair, force=pair.force + push * across)
            pairs = (*here.pairs[:k], pushed, *here.pairs[k + 1 :])
            scene = loaded_by(here.shape.arm, self.scene, pairs)
            there = self._settle(share * self.tensions, scene, here.shape)
            before, after = (
                np.subtract(*own.position(pair.s)[::-1]) for own in (here.shape, there)
            )
            gives = float(across @ (after - before)) / push
            if gives < 0 or pair.pressed(here.shape) * gives > np.linalg.norm(before):
                return True
        return False

    def _passes(self, here: _Here, shape: Shape) -> bool:
        """Return whether parts that were apart may be deep in each other, or beyond."""
        s = np.linspace(0.0, shape.arm.length, _LOOKS + 1)[1:]
        way = float(np.linalg.norm(shape.position(s) - here.shape.position(s), axis=1).max())
        deep = _DEEP * float(shape.arm.outer_radius(s)[0].min())
        if not np.isfinite(here.least):
            # Nothing had turned by half a turn: it may have since, but not be deep.
            return nearest_pairs(shape, _LOOKS)[1] < -deep
        return 2 * way > max(here.least, 0.0) + 2 * deep and (
            nearest_pairs(shape, _LOOKS)[1] < -deep or way > shape.arm.length / 10
        )

    def _is_new(self, own: Pair, pairs: Sequence[Pair], shape: Shape) -> bool:
        """Return whether a pair of places that are in each other is none of those known."""
        far = _OTHER * shape.arm.length
        known = any(np.abs(pair.s - own.s).max() < far for pair in pairs)
        return not known and own.gap(shape) < -_THROUGH * shape.arm.length

    def _solved(
        self, share: float, pairs: tuple[Pair, ...], near: Shape
    ) -> tuple[Shape, tuple[Pair, ...]] | None:
        """Return the equilibrium with pairs held shut, places that reach the tip held there."""
        if not pairs:
            return self._settle(share * self.tensions, self.scene, near), ()
        found = self._newton(share, pairs, near)
        if found is None:
            return None
        shape, pairs = found
        for k, pair in enumerate(pairs):
            free = replace(pair, at_tip=False)
            if pair.at_tip and free.residual(shape, np.zeros((3, 2)))[4] > 1e-6:
                inside = np.array([pair.s[0], pair.s[1] - 1e-3 * shape.arm.length])
                freed = (*pairs[:k], replace(free, s=inside), *pairs[k + 1 :])
                return self._solved(share, freed, shape)
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
            shape = self._settle(share * self.tensions, loaded_by(by.arm, self.scene, own), by)
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
