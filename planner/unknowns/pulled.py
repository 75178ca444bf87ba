"""Equilibria as they are reached from rest: loads in full first, then tensions drawn evenly.

That is the way that an arm takes which is measured, and it is a short one from the shapes under
tensions nearby. Where it leads nowhere the arm is settled as `settle` does it.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from model import OctoplanError
from model.equilibrium.forward import Collocation
from model.equilibrium.linearised import Linearised
from model.equilibrium.newton import newton_many
from model.loads import is_loaded
from model.paths import Array
from model.transcription.system import System
from model.unloaded.stretch import check_stretch

# The farthest that Newton's method may correct a predicted frame, as a change of its quaternion,
# and the least step of the tensions, over their whole change.
FARTHEST, _LEAST = 0.1, 1 / 128
# What is corrected grows as the square of a step: the next one is to need such a share of the
# farthest, and is so many times shorter or longer at most.
_AIM, _SHORTER, _LONGER = 0.8, 1 / 8, 4.0
# How much looser Newton's method is before the end.
_ON_THE_WAY = 1e6
# States as near as this are those of one equilibrium.
_SAME = 1e-6


class Pulled:
    """The equilibria of one arm in one scene that are known, and those that follow from them.

    `looser` is that of Newton's method; see newton_many.
    """

    def __init__(self, system: System, looser: float = 1.0) -> None:
        self.system, self.forward = system, Collocation.on(system)
        self.looser = looser
        self.known: list[tuple[Array, Linearised]] = []

    def at(self, tensions: Array) -> Linearised:
        """Return the equilibrium under tensions (n_tendons,); raises what `settle` does."""
        (found,) = self.all([tensions])
        if isinstance(found, OctoplanError):
            raise found
        return found

    def all(self, tensions: Sequence[Array]) -> list[Linearised | OctoplanError]:
        """Return the equilibria under tensions (n_tendons,), or why there is none, of each."""
        found: dict[int, Linearised | OctoplanError] = {}
        loaded = is_loaded(self.system.scene)
        for level in self._levels(tensions) if loaded else [range(len(tensions))]:
            for i, drawn in zip(level, self._drawn([tensions[i] for i in level]), strict=True):
                try:
                    here = drawn or self.forward.found(tensions[i])
                    check_stretch(self.forward, self.forward.rows(here)[1])
                except OctoplanError as reason:
                    found[i] = reason
                    continue
                self.known.append((tensions[i], here))
                found[i] = here
        return [found[i] for i in range(len(tensions))]

    def confirmed(self, tensions: Sequence[Array], found: Sequence[Linearised]) -> list[bool]:
        """Return whether equilibria found otherwise are those that are reached from rest.

        They are if one step of the tensions leads to each of them from that of the next lesser
        tensions, and so on from rest: a chord of Newton's method with the factors that they have.
        """
        if not is_loaded(self.system.scene):
            return [False] * len(found)
        before, T = self._before(tensions), np.array(tensions)
        starts = [
            (tensions[k], found[k]) if k >= 0 else self._nearest(tensions[i])
            for i, k in enumerate(before)
        ]
        guesses = [
            here.states + here.by_tensions @ (own - start)
            for own, (start, here) in zip(tensions, starts, strict=True)
        ]
        ends = newton_many(
            self.system, T, 1.0, np.array(guesses), FARTHEST, kept=found, looser=self.looser
        ).solutions
        sure = [False] * len(found)
        for i in np.argsort(np.linalg.norm(T, axis=1), kind="stable").tolist():
            end = ends[i]
            led = end is not None and np.abs(end.states - found[i].states).max() <= _SAME
            sure[i] = bool(led) and (before[i] < 0 or sure[before[i]])
            if sure[i]:
                self.known.append((tensions[i], found[i]))
        return sure

    def _before(self, tensions: Sequence[Array]) -> list[int]:
        """Return which of tensions with less pull each is nearest to; -1 for what is known."""
        pulls = [float(np.linalg.norm(T)) for T in tensions]
        before, done = [-1] * len(pulls), list[int]()
        if not self.known and len(pulls):
            none = np.zeros_like(tensions[0])
            self.known.append((none, self.forward.found(none)))
        for i in np.argsort(pulls, kind="stable").tolist():
            apart = min(float(np.linalg.norm(tensions[i] - T)) for T, _ in self.known)
            for k in done:
                nearer = float(np.linalg.norm(tensions[i] - tensions[k]))
                if nearer < apart:
                    before[i], apart = k, nearer
            done.append(i)
        return before

    def _levels(self, tensions: Sequence[Array]) -> list[list[int]]:
        """Return which equilibria to find together: each after the one that it is nearest to."""
        before, levels = self._before(tensions), list[list[int]]()
        left = list(range(len(before)))
        while left:
            levels.append([i for i in left if before[i] not in left])
            left = [i for i in left if before[i] in left]
        return levels

    def _drawn(self, tensions: Sequence[Array]) -> list[Linearised | None]:
        """Return the equilibria at the ends of straight ways of the tensions, side by side."""
        N = len(tensions)
        if not is_loaded(self.system.scene):
            return [None] * N
        starts = [self._nearest(T) for T in tensions]
        start, here = np.array([own[0] for own in starts]), [own[1] for own in starts]
        tangents, found = list(here), list[Linearised | None]([None] * N)
        change, share, step = np.array(tensions) - start, np.zeros(N), np.ones(N)
        alive = np.arange(N)
        while alive.size:
            to = np.minimum(1.0, share[alive] + step[alive])
            ahead = change[alive] * (to - share[alive])[:, None]
            guesses = [
                here[i].states + tangents[i].by_tensions @ own
                for i, own in zip(alive, ahead, strict=True)
            ]
            T = start[alive] + to[:, None] * change[alive]
            looser = np.where(to < 1, max(_ON_THE_WAY, self.looser), self.looser)
            steps = newton_many(self.system, T, 1.0, np.array(guesses), FARTHEST, looser=looser)
            factor = np.sqrt(_AIM * FARTHEST / np.maximum(steps.turned, 1e-300))
            for k, i in enumerate(alive):
                end, length = steps.solutions[k], float(to[k] - share[i])
                if end is None:
                    step[i] = length * min(max(factor[k], _SHORTER), 0.5)
                    continue
                here[i], share[i] = end, to[k]
                tangents[i] = steps.last[k] or end
                step[i] = length * min(max(factor[k], 0.5), _LONGER)
                if to[k] >= 1:
                    found[i] = end
            alive = alive[(share[alive] < 1) & (step[alive] >= _LEAST)]
        return found

    def _nearest(self, tensions: Array) -> tuple[Array, Linearised]:
        return min(self.known, key=lambda own: float(np.linalg.norm(own[0] - tensions)))
