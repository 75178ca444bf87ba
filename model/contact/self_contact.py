"""How an arm comes to press on itself: tensions grow from none, pairs of places come and go.

Steps in the tensions are so short that parts that are apart cannot pass through each other
within one.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from model.contact.pairs import Pair, loaded_by, nearest_pairs
from model.contact.pairs_shut import PairsShut, Settle
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
# How far apart places are another pair's, over the length.
_OTHER = 0.03
# A push sideways, over the force of a pair.
_PUSH = 1e-3
# How often pairs come and go at one share, and what a gap may be below 0, over the length.
_CHANGES, _THROUGH = 8, 1e-9


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

    def begin(self) -> _Here:
        """Return the arm without tensions; raises UnsettledContactError if it meets itself."""
        shape = self._settle(0 * self.tensions, self.scene, None)
        found, least = nearest_pairs(shape, _LOOKS)
        if found:
            raise UnsettledContactError(0.0, "the arm without tensions is inside of itself")
        radius = float(shape.arm.outer_radius(np.zeros(1))[0][0])
        unit = shape.arm.material.E * radius**4 / shape.arm.length**2
        self._shut = PairsShut(self.tensions, self.scene, self._settle, unit)
        return _Here(shape, (), least)

    def moved(self, here: _Here, share: float) -> _Here | None:
        """Return the equilibrium at a share of the tensions; None if the step was too long."""
        pairs, near = here.pairs, here.shape
        for _ in range(_CHANGES):
            try:
                found = self._shut.solved(share, pairs, near)
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
            push = _PUSH * max(pair.pressed(here.shape), _PUSH * self._shut.unit)
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
