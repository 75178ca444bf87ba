"""Continuation: equilibria along straight lines of tensions and loads, from rest to those in full.

The equilibrium depends on the history of an arm: the loads act first, then the tendons are pulled
in proportion. An arm that does not bear its loads without tension, such as an upright arm that is
stiffened by antagonists, is pulled first and loaded afterwards. Weak loads, under which the arm has
one equilibrium at most, allow the shortest way. Many sets of tensions are followed side by side.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cached_property, partial
from typing import ClassVar, NamedTuple

import numpy as np

from octoplan.model.cross_section.sections import Sections
from octoplan.model.equilibrium.linearised import AnyEquilibrium, Equilibrium, History, linearised
from octoplan.model.equilibrium.load_changes import change_loads
from octoplan.model.equilibrium.newton import (
    CHORD_RADIUS,
    MAX_BRANCH_ROTATION,
    MAX_STEP_ROTATION,
    Start,
    newton,
    step_sizes,
)
from octoplan.model.equilibrium.stability import are_stable, is_stable
from octoplan.model.equilibrium.uniqueness import has_unique_equilibrium
from octoplan.model.loads import is_loaded
from octoplan.model.paths import Array
from octoplan.model.rod.collocation import gauss
from octoplan.model.rod.discrete_rod import DiscreteRod
from octoplan.model.support.errors import (
    CollapsedError,
    OctoplanError,
    SnapError,
    UnsettledSectionError,
)
from octoplan.model.support.progress import check_time, report

# Smallest step over the fraction of the line that is reached; before the first step, over itself.
LEAST_STEP = 1 / 8192
# The same if the place where a branch ends is not asked for.
ROUGH_STEP = 1 / 32
# How many times larger the last steps of Newton's method may be on the way.
MAX_TOLERANCE_FACTOR = 1e6
# Number of rounds after which tensions are checked for a tendon without length: any load moves such
# a tendon by many times the width that keeps its root smooth, so that steps shrink without end.
_SOON_IF_CRUSHED = 30
SNAPS = "it snaps or folds"
BUCKLES = "it buckles"


class BranchEnd(NamedTuple):
    """The last equilibrium on a branch.

    Attributes
    ----------
    point : Equilibrium
    fraction : float
        The fraction of the line of tensions and loads that is reached.
    why : str
        What happens beyond; empty at the end of the line.
    """

    point: Equilibrium
    fraction: float
    why: str = ""


def continue_branches(
    starts: Sequence[BranchEnd],
    lines: tuple[Array, Array],
    least: float,
    crushed: Sequence[Callable[[], CollapsedError | UnsettledSectionError | None]] = (),
    tolerance_factor: float = 1.0,
    path_tolerance_factor: float = 1.0,
    first_step: float = 1.0,
    passed: list[Equilibrium] | None = None,
) -> list[BranchEnd]:
    """Follow branches of equilibria of one system along lines of tensions and load factor.

    A step is shortened if the tangent rotates a frame far, and halved if it leads to no stable
    equilibrium. A branch ends if its step is `least` of the fraction that is reached.

    Parameters
    ----------
    starts : sequence of BranchEnd
    lines : (M, n_tendons + 1), (M, n_tendons + 1)
        Tensions [N] and load factor at the fractions 0 and 1.
    least, first_step : float
        Smallest step over the fraction that is reached, and the first step.
    crushed : sequence of callable
        Whether the tensions at the end of a line crush the arm without loads: a reason to stop.
    tolerance_factor, path_tolerance_factor : float
        Factors of the tolerance of Newton's method, at the end of the line and before; see Start.
    passed : list of Equilibrium
        Receives the equilibrium of each step on any of the branches.
    """
    system = starts[0].point.system
    begins, ends_at = lines
    ends = [*starts]
    steps = [first_step] * len(starts)
    fractions = [0.0] * len(starts)
    levels = [path_tolerance_factor] * len(starts)
    begin_stable: list[bool | None] = [None] * len(starts)
    n, quaternions = system.layout.n_tendons, system.layout.nodes[:, :4]
    tried, going = 0, [*range(len(starts))]
    while going:
        check_time()
        going, before = list[int](), going
        begun = list[Start]()
        for i in before:
            point, reached, _ = ends[i]
            steps[i] = min(steps[i], 1.0 - reached)
            if steps[i] <= 0 or steps[i] < least * max(reached, least):
                continue
            if tried == _SOON_IF_CRUSHED and crushed and crushed[i]():
                continue
            if point.factor is None:
                ends[i] = ends[i]._replace(why=BUCKLES)
                continue
            rate = point.by_direction(ends_at[i] - begins[i])
            turned = 2 * steps[i] * float(np.abs(rate[quaternions]).max())
            step = steps[i] * min(1.0, MAX_STEP_ROTATION / max(turned, MAX_STEP_ROTATION))
            # The end of the line to the last digit, in spite of rounding.
            fractions[i] = 1.0 if step == 1.0 - reached else reached + step
            states = point.states + (fractions[i] - reached) * rate
            level = tolerance_factor if fractions[i] == 1.0 else levels[i]
            now = begins[i] + fractions[i] * (ends_at[i] - begins[i])
            history = point.history
            begun.append(
                Start(now[:n], float(now[n]), states, tolerance_factor=level, history=history)
            )
            going.append(i)
        if not going:
            break
        report("percent of tensions and loads", round(100 * min(fractions)), 100)
        tried, points = tried + 1, newton(system, begun)
        for k, (i, there) in enumerate(zip(going, points, strict=True)):
            if there is not None:
                both = ends[i].point.states[quaternions] * there.states[quaternions]
                if np.abs(both.sum(axis=1)).min() <= np.cos(MAX_BRANCH_ROTATION / 2):
                    points[k] = None
        for i, there, stable in zip(going, points, are_stable(points), strict=True):
            if there is not None and not stable and begin_stable[i] is None:
                # An instability that exists at the start does not end the branch.
                begin_stable[i] = is_stable(starts[i].point)
            if there is None or (not stable and begin_stable[i]):
                ends[i] = ends[i]._replace(why=SNAPS if there is None else BUCKLES)
                steps[i], levels[i] = (fractions[i] - ends[i].fraction) / 2, 1.0
            else:
                ends[i], steps[i] = BranchEnd(there, fractions[i]), 2 * steps[i]
                if passed is not None:
                    # Without factors, of which a hundred equilibria have many megabytes.
                    passed.append(Equilibrium(system, there.x, history=there.history))
    return ends


class Collocation:
    """The equations of an arm on a mesh, which settle tensions to equilibria.

    Attributes
    ----------
    system : DiscreteRod
    """

    # Error of the tip that Newton's method leaves by rounding, over the arm's length.
    rounding: ClassVar[float] = 5e-13
    # Processor time that the equilibrium on a mesh may take [s].
    patience: ClassVar[float] = math.inf
    # Whether a cross-section without an equilibrium has none on a finer mesh either.
    sections_are_exact: ClassVar[bool] = True

    def __init__(self, system: DiscreteRod) -> None:
        self.system, self.mesh, self._loaded = system, system.mesh, is_loaded(system.scene)

    def solve(
        self, tensions: Array, near: AnyEquilibrium | None = None, tolerance_factor: float = 1.0
    ) -> Equilibrium:
        """Return the equilibrium under tensions (n_tendons,).

        With `near`, an equilibrium of this or another mesh, that on its branch if the branch leads
        to the tensions; otherwise that which the arm reaches from rest.

        Raises
        ------
        SnapError
            If the arm loses its equilibrium or its stability on the way.
        UnsettledSectionError
            If a cross-section has no equilibrium, or a tendon is left no length.
        """
        begin = list[Equilibrium]()
        if self._loaded and isinstance(near, Equilibrium):
            begin = [near]
        elif self._loaded and near is not None:
            # The loads act on an arm that is pulled without them.
            (loaded,) = self._loaded_last(near.tensions[None], tolerance_factor)
            if isinstance(loaded, Equilibrium):
                begin = [replace(loaded, history="near")]
        (end,) = self.many(tensions[None], begin, tolerance_factor)
        if isinstance(end, OctoplanError):
            raise end
        return end

    def many(
        self,
        tensions: Array,
        near: Sequence[Equilibrium | None] = (),
        tolerance_factor: float = 1.0,
    ) -> list[Equilibrium | OctoplanError]:
        """Return the equilibria under sets of tensions (M, n_tendons), or why there are none.

        As `solve` does. Each set may begin near an equilibrium of its own, of any other mesh, or
        near none.
        """
        ends: list[Equilibrium | OctoplanError | None] = [None] * len(tensions)
        begun = [(i, each) for i, each in enumerate(near) if each is not None]
        if begun:
            points = self._from_nearby(tensions[[i for i, _ in begun]], [e for _, e in begun])
            for (i, _), point in zip(begun, points, strict=True):
                ends[i] = point
        left = [i for i, end in enumerate(ends) if end is None]
        if left:
            for i, end in zip(left, self._from_rest(tensions[left], tolerance_factor), strict=True):
                ends[i] = end
        return [end for end in ends if end]

    def _from_nearby(
        self, tensions: Array, near: Sequence[Equilibrium]
    ) -> list[Equilibrium | None]:
        """Return the equilibria on the branches of others, each under tensions of its own.

        In one step if the tangent leads there; else along the line of tensions from those of the
        other equilibrium.
        """
        moved = [
            not np.array_equal(T, each.tensions) or each.system.scene != self.system.scene
            for T, each in zip(tensions, near, strict=True)
        ]
        ends = newton(self.system, self._starts(tensions, near, moved), CHORD_RADIUS)
        far = [i for i, end in enumerate(ends) if end is None and moved[i]]
        if not far:
            return ends
        others = [near[i] for i in far]
        starts = self._starts(
            np.array([each.tensions for each in others]), others, [True] * len(far)
        )
        begun = newton(self.system, starts, CHORD_RADIUS)
        for k, other in enumerate(others):
            if begun[k] is None and other.system.scene != self.system.scene:
                strains = other.states[other.system.layout.stages]
                strains = transfer_strains(other.system, strains, self.system)
                begun[k] = change_loads(self.system, other, strains)
        on_line = [(i, point) for i, point in zip(far, begun, strict=True) if point is not None]
        if on_line:
            lines = (
                self._line(np.array([point.tensions for _, point in on_line]), 1.0),
                self._line(tensions[[i for i, _ in on_line]], 1.0),
            )
            begins = [BranchEnd(point, 0.0) for _, point in on_line]
            followed = continue_branches(
                begins, lines, LEAST_STEP, path_tolerance_factor=MAX_TOLERANCE_FACTOR
            )
            for (i, _), end in zip(on_line, followed, strict=True):
                ends[i] = end.point if end.fraction == 1.0 else None
        return ends

    def _starts(
        self, tensions: Array, near: Sequence[Equilibrium], moved: Sequence[bool]
    ) -> list[Start]:
        """Return where Newton's method begins; `moved` says which tensions or loads are new."""
        states = self.transfer_states(tensions, near)
        return [
            Start(T, 1.0, row, history="near" if new else each.history)
            for T, row, each, new in zip(tensions, states, near, moved, strict=True)
        ]

    def solve_towards(self, tensions: Array) -> Equilibrium:
        """Return the equilibrium from rest that comes nearest to tensions (n_tendons,) on its line.

        The place where the branch ends is located roughly.
        """
        if not self.loads_first:
            return self.solve(tensions)
        lines = self._line(0 * tensions[None], 1.0), self._line(tensions[None], 1.0)
        begin = BranchEnd(self._under_loads.point, 0.0)
        (end,) = continue_branches(
            [begin], lines, ROUGH_STEP, path_tolerance_factor=MAX_TOLERANCE_FACTOR
        )
        return end.point

    def passed(self, tensions: Array) -> list[Equilibrium]:
        """Return the equilibria on the lines from rest to sets of tensions (M, n_tendons).

        These are the equilibria of all steps, as far as the branches lead; only those at the ends
        of the lines unless the loads act before the tensions and the history matters.
        """
        if not self.loads_first:
            return [end for end in self.many(tensions) if isinstance(end, Equilibrium)]
        points = list[Equilibrium]()
        continue_branches(
            [BranchEnd(self._under_loads.point, 0.0)] * len(tensions),
            (self._line(0 * tensions, 1.0), self._line(tensions, 1.0)),
            ROUGH_STEP,
            tolerance_factor=MAX_TOLERANCE_FACTOR,
            path_tolerance_factor=MAX_TOLERANCE_FACTOR,
            passed=points,
        )
        return points

    @cached_property
    def loads_first(self) -> bool:
        """Whether the history matters, and the arm bears its loads without tension."""
        if not self._loaded or has_unique_equilibrium(self.system.arm, self.system.scene):
            return False
        return not self._under_loads.why

    def _from_rest(
        self, tensions: Array, tolerance_factor: float
    ) -> list[Equilibrium | OctoplanError]:
        """Return the equilibria that the arm reaches from rest under sets (M, n_tendons)."""
        if self.loads_first:
            return self._pulled(self._under_loads.point, tensions, tolerance_factor)
        return self._loaded_last(tensions, tolerance_factor)

    @cached_property
    def _under_loads(self) -> BranchEnd:
        """The arm without tension as far as it bears its loads."""
        none = np.zeros(self.system.layout.n_tendons)
        x = self.system.x(none, 0.0, self.without_loads(none))
        start = BranchEnd(Equilibrium(self.system, x), 0.0)
        lines = self._line(none[None], 0.0), self._line(none[None], 1.0)
        return continue_branches(
            [start], lines, LEAST_STEP, path_tolerance_factor=MAX_TOLERANCE_FACTOR
        )[0]

    def _pulled(
        self, rest: Equilibrium, tensions: Array, tolerance_factor: float
    ) -> list[Equilibrium | OctoplanError]:
        """Return the equilibria of a loaded arm whose tendons are pulled in proportion."""
        at = self.system.sections
        crushed = [partial(_crushed, at, T) for T in tensions]
        starts = [BranchEnd(rest, 0.0)] * len(tensions)
        lines = self._line(0 * tensions, 1.0), self._line(tensions, 1.0)
        followed = continue_branches(
            starts, lines, LEAST_STEP, crushed, tolerance_factor, MAX_TOLERANCE_FACTOR
        )
        ends = list[Equilibrium | OctoplanError]()
        for end, fails in zip(followed, crushed, strict=True):
            if not end.why and end.fraction == 1.0:
                ends.append(end.point)
            elif section := fails():
                ends.append(UnsettledSectionError(section.s))
            else:
                ends.append(SnapError(1.0, end.why or SNAPS, end.fraction, "loads first"))
        return ends

    def _loaded_last(
        self, tensions: Array, tolerance_factor: float
    ) -> list[Equilibrium | OctoplanError]:
        """Return the equilibria of arms that are pulled before their loads act.

        Without loads each cross-section settles by itself.
        """
        at, ends = self.system, list[Equilibrium | OctoplanError]()
        is_unique = not self._loaded or has_unique_equilibrium(at.arm, at.scene)
        unpulled = None if is_unique else self._under_loads
        history: History = "loads first" if is_unique else "tensions first"
        strains = at.sections.unloaded(tensions)
        lost = np.asarray(np.isnan(strains).any(axis=2), dtype=bool)
        some = ~lost.any(axis=1)
        T, v = tensions[some], strains[some]
        crushed = [partial(at.sections.crushed, each) for each in v]
        followed = list[BranchEnd]()
        if len(T):
            x = at.x(T, 1.0 - self._loaded, at.initial_states(T, v))
            if self._loaded:
                points, _ = linearised(at, x, [None] * len(x))
                starts = [BranchEnd(replace(point, history=history), 0.0) for point in points]
                lines = self._line(T, 0.0), self._line(T, 1.0)
                followed = continue_branches(
                    starts, lines, LEAST_STEP, crushed, tolerance_factor, MAX_TOLERANCE_FACTOR
                )
            else:
                followed = [BranchEnd(Equilibrium(at, row), 1.0) for row in x]
        known = iter(zip(followed, crushed, strict=True))
        before = ""
        if unpulled is not None and tensions.any():
            before = (
                f"without tension {unpulled.why} at {100 * unpulled.fraction:.1f} %, pulled first "
            )
        for sections in lost:
            if sections.any():
                ends.append(UnsettledSectionError(float(at.s[np.argmax(sections)])))
                continue
            end, fails = next(known)
            if end.fraction == 1.0:
                ends.append(end.point)
            elif section := fails():
                ends.append(UnsettledSectionError(section.s))
            else:
                ends.append(
                    SnapError(end.fraction, end.why or SNAPS, 1.0, "tensions first", before)
                )
        return ends

    def _line(self, tensions: Array, load: float) -> Array:
        """Return points of lines (M, n_tendons + 1): tensions (M, n_tendons), load factor."""
        return np.column_stack([tensions, np.full(len(tensions), load)])

    def solve_from(self, at: Equilibrium, tensions: Array) -> Equilibrium | None:
        """Return the equilibrium under tensions near another of this mesh; None for none."""
        of, change = at.system.layout, at.by_tensions @ (tensions - at.tensions)
        _, (size,) = step_sizes(at.system, change[None], at.states[None])
        load, states = float(at.x[of.n_tendons]), at.states + change
        start = Start(tensions, load, states, linearised_at=at if size < CHORD_RADIUS else None)
        return newton(at.system, [start])[0]

    def without_loads(self, tensions: Array) -> Array:
        """Return the states under tensions without loads; raises UnsettledSectionError."""
        return self.system.initial_states(tensions, self.system.sections.strains(tensions))

    def transfer_states(self, tensions: Array, near: Sequence[Equilibrium]) -> Array:
        """Return the states (M, n_states) of this mesh by the strains of equilibria on others.

        Each set of tensions (M, n_tendons) has an equilibrium of its own, on a mesh of its own.
        Where its tensions differ, derivatives predict the states under these first.
        """
        result = np.empty((len(near), self.system.layout.n_states))
        systems = np.array([id(each.system) for each in near])
        for one in np.unique(systems):
            alike = np.flatnonzero(systems == one).tolist()
            before = near[alike[0]].system
            states = np.array([predict_states(near[i], tensions[i]) for i in alike])
            if before.layout is not self.system.layout or not np.array_equal(
                before.mesh.s, self.mesh.s
            ):
                strains = states[:, before.layout.stages].transpose(1, 2, 0)
                strains = transfer_strains(before, strains, self.system).transpose(2, 0, 1)
                states = self.system.initial_states(tensions[alike], strains, 1.0)
            result[alike] = states
        return result


def _crushed(sections: Sections, tensions: Array) -> CollapsedError | UnsettledSectionError | None:
    """Return where tensions (n_tendons,) crush an arm without loads; None if nowhere."""
    try:
        return sections.crushed(sections.strains(tensions))
    except UnsettledSectionError as problem:
        return problem


def predict_states(near: Equilibrium, tensions: Array) -> Array:
    """Return states under tensions (n_tendons,) by the derivatives of an equilibrium nearby."""
    if np.array_equal(tensions, near.tensions):
        return near.states
    return near.states + near.by_tensions @ (tensions - near.tensions)


def transfer_strains(before: DiscreteRod, strains: Array, after: DiscreteRod) -> Array:
    """Return the strains (N stages, ...) at the stages of a mesh by those of another's stages."""
    mesh, m = before.mesh, before.layout.structure.stages
    step = np.clip(np.searchsorted(mesh.s, after.s) - 1, 0, before.layout.elements - 1)
    x = (after.s - mesh.s[step]) / np.diff(mesh.s)[step]
    by_element = strains.reshape(before.layout.elements, m, *strains.shape[1:])
    return np.asarray(np.einsum("nm,nm...->n...", gauss(m).at(x), by_element[step]))
