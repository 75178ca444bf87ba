"""Load stepping: from equilibria without loads along their branches up to the full loads.

In one step if that is safe. Many arms alike but for their tensions are followed side by side.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from itertools import repeat
from typing import NamedTuple

import numpy as np

from model.equilibrium.linearised import Equilibrium, Linearised, linearised
from model.equilibrium.newton import CLOSE, FOLLOWED, TURN, Start, newton, step_sizes
from model.equilibrium.stability import stands, stands_each
from model.errors import CollapsedError, OctoplanError, SnapError, UnsettledSectionError
from model.loads import is_loaded
from model.paths import Array
from model.progress import check_time, tell
from model.transcription.collocation import gauss
from model.transcription.system import System

# The least step in the load factor over what is reached; before the first step, over itself.
LEAST_STEP = 1 / 8192
# How many times larger last steps may be where the equilibrium is there to begin the next one with.
ROUGHEST = 1e6
# Where a tendon has no length left any load moves it by many times the width that keeps its root
# smooth: steps in the loads shrink with that, and come to an end in a few or not at all.
_SOON_IF_CRUSHED = 30
SNAPS, BUCKLES = "it snaps or folds", "it buckles"


class Followed(NamedTuple):
    """The last equilibrium on a branch, the load factor there, and what happens beyond."""

    point: Linearised
    load: float
    why: str


def follow_on(
    starts: Sequence[Followed],
    most: float,
    least: float,
    crushed: Sequence[Callable[[], CollapsedError | None]] = (),
    looser: float = 1.0,
    on_the_way: float = 1.0,
) -> list[Followed]:
    """Follow the branches of equilibria of one system on, up to a load factor.

    No step is so long that the tangent turns a frame far. One that leads to no
    equilibrium is halved; the end is where it is down to `least` of the load factor that is
    reached, or soon where the arm is `crushed` without loads. `looser` is that of Newton's method;
    on the way, until a step fails, `on_the_way` is.
    """
    system, ends, count = starts[0].point.system, [*starts], len(starts)
    steps, loads, levels = [min(1.0, most)] * count, [0.0] * count, [on_the_way] * count
    begin_stable: list[bool | None] = [None] * count
    n, quaternions = system.of.n_tendons, system.of.nodes[:, :4]
    tried, going = 0, [*range(count)]
    while going:
        check_time()
        going, before = list[int](), going
        begun = list[Start]()
        for i in before:
            point, reached, _ = ends[i]
            steps[i] = min(steps[i], most - reached)
            if steps[i] <= 0 or steps[i] < least * max(reached, least):
                continue
            if tried == _SOON_IF_CRUSHED and crushed and crushed[i]():
                continue
            if point.factor is None:
                ends[i] = ends[i]._replace(why=BUCKLES)
                continue
            rate = point.by_unknowns(n, n + 1)[:, 0]
            turned = 2 * steps[i] * float(np.abs(rate[quaternions]).max())
            loads[i] = reached + steps[i] * min(1.0, TURN / max(turned, TURN))
            states = point.states + (loads[i] - reached) * rate
            level = looser if loads[i] == most else levels[i]
            begun.append(Start(point.tensions, loads[i], states, looser=level))
            going.append(i)
        if not going:
            break
        tell("percent of the loads", round(100 * min(loads) / most), 100)
        tried, points = tried + 1, newton(system, begun)
        for k, (i, there) in enumerate(zip(going, points, strict=True)):
            if there is not None:
                both = ends[i].point.states[quaternions] * there.states[quaternions]
                if np.abs(both.sum(axis=1)).min() <= np.cos(FOLLOWED / 2):
                    points[k] = None
        for i, there, stable in zip(going, points, stands_each(points), strict=True):
            if there is not None and not stable and begin_stable[i] is None:
                # What is unstable without loads, or where it begins, is not their doing.
                begin_stable[i] = stands(starts[i].point)
            if there is None or (not stable and begin_stable[i]):
                ends[i] = ends[i]._replace(why=SNAPS if there is None else BUCKLES)
                steps[i], levels[i] = (loads[i] - ends[i].load) / 2, 1.0
            else:
                ends[i], steps[i] = Followed(there, loads[i], ""), 2 * steps[i]
    return ends


class Collocation:
    """The equations of an arm on a mesh, which settle tensions to equilibria.

    Attributes
    ----------
    system : System
    """

    def __init__(self, system: System) -> None:
        self.system, self.mesh, self._loaded = system, system.mesh, is_loaded(system.scene)

    def solve(
        self, tensions: Array, near: Equilibrium | None = None, looser: float = 1.0
    ) -> Linearised:
        """Return the equilibrium under tensions (n_tendons,), near that of another mesh if any is.

        Else the one that the unloaded arm comes to; without loads its states are that. The last
        steps of Newton's method may be so many times `looser` than elsewhere. Raises SnapError,
        which says where its branch ends or loses its stability, and UnsettledSectionError where a
        section has none, or tensions that leave a tendon no length keep loads from being applied in
        steps.
        """
        begin = [near] if isinstance(near, Linearised) and self._loaded else []
        (end,) = self.many(tensions[None], begin, looser)
        if isinstance(end, OctoplanError):
            raise end
        return end

    def many(
        self, tensions: Array, near: Sequence[Linearised] = (), looser: float = 1.0
    ) -> list[Linearised | OctoplanError]:
        """Return the equilibria under sets of tensions (M, n_tendons), or why there are none.

        As `solve` does, near those of another mesh, one for each set, if any are.
        """
        ends: list[Linearised | OctoplanError | None] = [None] * len(tensions)
        if near:
            starts = map(Start, tensions, repeat(1.0), self.carried(tensions, near))
            ends[:] = newton(self.system, [*starts], CLOSE)
        left = [i for i, end in enumerate(ends) if end is None]
        if left:
            for i, end in zip(left, self._from_rest(tensions[left], looser), strict=True):
                ends[i] = end
        return [end for end in ends if end]

    def _from_rest(self, tensions: Array, looser: float) -> list[Linearised | OctoplanError]:
        """Return what unloaded arms come to under sets of tensions (M, n_tendons)."""
        at, ends = self.system, list[Linearised | OctoplanError]()
        strains = at.sections.unloaded(tensions)
        lost = np.asarray(np.isnan(strains).any(axis=2), dtype=bool)
        some = ~lost.any(axis=1)
        T, v = tensions[some], strains[some]
        crushed = [partial(at.sections.crushed, each) for each in v]
        followed = list[Followed]()
        if len(T):
            x = at.x(T, 1.0 - self._loaded, at.start(T, v))
            if self._loaded:
                points, _ = linearised(at, x, [None] * len(x))
                starts = [Followed(point, 0.0, "") for point in points]
                followed = follow_on(starts, 1.0, LEAST_STEP, crushed, looser, ROUGHEST)
            else:
                followed = [Followed(Linearised(at, row), 0.0, "") for row in x]
        known = iter(zip(followed, crushed, strict=True))
        for sections in lost:
            if sections.any():
                ends.append(UnsettledSectionError(float(at.s[np.argmax(sections)])))
                continue
            end, fails = next(known)
            if end.load >= self._loaded:
                ends.append(end.point)
            elif section := fails():
                ends.append(UnsettledSectionError(section.s))
            else:
                ends.append(SnapError(end.load, end.why or SNAPS))
        return ends

    def led_to(self, at: Linearised, tensions: Array) -> Linearised | None:
        """Return the equilibrium under tensions near another of this mesh; None for none."""
        of, change = at.system.of, at.by_tensions @ (tensions - at.tensions)
        _, (size,) = step_sizes(at.system, change[None], at.states[None])
        load, states = float(at.x[of.n_tendons]), at.states + change
        start = Start(tensions, load, states, near=at if size < CLOSE else None)
        return newton(at.system, [start])[0]

    def without_loads(self, tensions: Array) -> Array:
        """Return the states under tensions without loads; raises UnsettledSectionError."""
        return self.system.start(tensions, self.system.sections.strains(tensions))

    def carried(self, tensions: Array, near: Sequence[Linearised]) -> Array:
        """Return the states (M, n_states) of this mesh by the polynomials of others' strains.

        Others of one system. Where tensions (M, n_tendons) differ, of the states at these by
        derivatives.
        """
        before, states = near[0].system, np.array([*map(predicted, near, tensions)])
        if before.of is self.system.of and np.array_equal(before.mesh.s, self.mesh.s):
            return states
        strains = states[:, before.of.stages].transpose(1, 2, 0)
        strains = carried_strains(before, strains, self.system)
        return self.system.start(tensions, strains.transpose(2, 0, 1), 1.0)


def predicted(near: Linearised, tensions: Array) -> Array:
    """Return states under tensions (n_tendons,) by the derivatives of an equilibrium nearby."""
    if np.array_equal(tensions, near.tensions):
        return near.states
    return near.states + near.by_tensions @ (tensions - near.tensions)


def carried_strains(before: System, strains: Array, after: System) -> Array:
    """Return the strains (N stages, ...) at the stages of a mesh by those of another's stages."""
    mesh, m = before.mesh, before.of.form.stages
    step = np.clip(np.searchsorted(mesh.s, after.s) - 1, 0, before.of.elements - 1)
    x = (after.s - mesh.s[step]) / np.diff(mesh.s)[step]
    by_element = strains.reshape(before.of.elements, m, *strains.shape[1:])
    return np.asarray(np.einsum("nm,nm...->n...", gauss(m).at(x), by_element[step]))
