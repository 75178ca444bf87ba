"""The forward map by collocation: the equilibrium that an arm reaches under given tensions.

The equilibrium depends on the history of the arm: the loads act first, then the tendons are pulled
in proportion. An arm that does not bear its loads without tension, such as an upright arm that is
stiffened by antagonists, is pulled first and loaded afterwards. Weak loads, under which the arm has
at most one equilibrium, are added along the branch, usually in one step, to the closed form under
full tension. Many sets of
tensions are solved side by side.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property, partial
from typing import ClassVar

import numpy as np

from octoplan.model.cross_section.sections import Sections
from octoplan.model.equilibrium.continuation import (
    LEAST_STEP,
    MAX_TOLERANCE_FACTOR,
    ROUGH_STEP,
    SNAPS,
    BranchEnd,
    CrushedCheck,
    change_loads,
    continue_branches,
)
from octoplan.model.equilibrium.linearised import AnyEquilibrium, Equilibrium, History, linearised
from octoplan.model.equilibrium.newton import CHORD_RADIUS, Start, newton, step_sizes
from octoplan.model.loads import has_unique_equilibrium, is_coupled
from octoplan.model.paths import Array
from octoplan.model.rod.collocation import gauss
from octoplan.model.rod.discrete_rod import DiscreteRod
from octoplan.model.support.errors import (
    CollapsedError,
    OctoplanError,
    SnapError,
    UnsettledSectionError,
)


class CollocationMap:
    """Map from tensions to equilibria on one mesh, by the collocation equations.

    Attributes
    ----------
    system : DiscreteRod
    """

    # Error of the tip over arm length by rounding in Newton's method.
    rounding: ClassVar[float] = 5e-13
    # Limit of the processor time of the equilibrium on a mesh [s].
    patience: ClassVar[float] = math.inf
    # Whether a cross-section without an equilibrium has no equilibrium on finer meshes.
    sections_are_exact: ClassVar[bool] = True

    def __init__(self, system: DiscreteRod) -> None:
        self.system = system
        self.mesh = system.mesh
        self._loaded = is_coupled(system.arm, system.scene)

    def solve(
        self, tensions: Array, near: AnyEquilibrium | None = None, tolerance_factor: float = 1.0
    ) -> Equilibrium:
        """Return the equilibrium under tensions (n_tendons,).

        `near` is an equilibrium of any mesh: the result is on its branch if the branch reaches the
        tensions. Otherwise the arm is loaded and pulled from rest.

        Raises
        ------
        SnapError
            If the branch ends or becomes unstable.
        UnsettledSectionError
            If a cross-section has no equilibrium, or the tensions shorten a tendon to nothing.
        """
        begin = list[Equilibrium]()
        if self._loaded and isinstance(near, Equilibrium):
            begin = [near]
        elif self._loaded and near is not None:
            # `near` is an equilibrium without loads: add the loads to the pulled arm.
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
        """Return the equilibrium or the error of each set of tensions (M, n_tendons).

        See `solve`. Each set may have its own nearby equilibrium, on any mesh, or None.
        """
        ends: list[Equilibrium | OctoplanError | None] = [None] * len(tensions)
        begun = [(i, each) for i, each in enumerate(near) if each is not None]
        if begun:
            points = self._from_nearby(tensions[[i for i, _ in begun]], [e for _, e in begun])
            for (i, _), point in zip(begun, points, strict=True):
                ends[i] = point
        left = [i for i, end in enumerate(ends) if end is None]
        if left:
            solve = self._pulled if self.loads_first else self._loaded_last
            for i, end in zip(left, solve(tensions[left], tolerance_factor), strict=True):
                ends[i] = end
        return [end for end in ends if end]

    def _from_nearby(
        self, tensions: Array, near: Sequence[Equilibrium]
    ) -> list[Equilibrium | None]:
        """Return the equilibrium on the branch of each nearby equilibrium, or None.

        One step along the tangent is tried first, then continuation along the line of tensions.
        """
        moved = [
            not np.array_equal(T, each.tensions) or each.system.scene != self.system.scene
            for T, each in zip(tensions, near, strict=True)
        ]
        states = self.transfer_states(tensions, near)
        starts = [
            Start(T, 1.0, row, history="near" if new else each.history)
            for T, row, each, new in zip(tensions, states, near, moved, strict=True)
        ]
        ends = newton(self.system, starts, CHORD_RADIUS)
        far = [i for i, end in enumerate(ends) if end is None and moved[i]]
        if not far:
            return ends
        others = [near[i] for i in far]
        before = np.array([each.tensions for each in others])
        states = self.transfer_states(before, others)
        starts = [Start(T, 1.0, row, history="near") for T, row in zip(before, states, strict=True)]
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

    def solve_towards(self, tensions: Array) -> Equilibrium:
        """Return the last equilibrium on the line from rest to tensions (n_tendons,).

        The end of the branch is located to ROUGH_STEP.
        """
        if not self.loads_first:
            return self.solve(tensions)
        lines = self._line(0 * tensions[None], 1.0), self._line(tensions[None], 1.0)
        begin = BranchEnd(self._under_loads.point, 0.0)
        (end,) = continue_branches(
            [begin], lines, ROUGH_STEP, path_tolerance_factor=MAX_TOLERANCE_FACTOR
        )
        return end.point

    def solve_along(self, tensions: Array) -> list[Equilibrium]:
        """Return the equilibria on the lines from rest to sets of tensions (M, n_tendons).

        If the loads act first and the history matters, return the equilibria of all steps up to the
        ends of the branches. Otherwise return the equilibria at the ends of the lines.
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
            visited=points,
        )
        return points

    @cached_property
    def loads_first(self) -> bool:
        """Whether several equilibria may exist, and the arm bears its loads without tension."""
        if not self._loaded or has_unique_equilibrium(self.system.arm, self.system.scene):
            return False
        return not self._under_loads.why

    @cached_property
    def _under_loads(self) -> BranchEnd:
        """The end of the branch on which the loads grow without tension."""
        none = np.zeros(self.system.layout.n_tendons)
        x = self.system.x(none, 0.0, self.without_loads(none))
        start = BranchEnd(Equilibrium(self.system, x), 0.0)
        lines = self._line(none[None], 0.0), self._line(none[None], 1.0)
        return continue_branches(
            [start], lines, LEAST_STEP, path_tolerance_factor=MAX_TOLERANCE_FACTOR
        )[0]

    def _pulled(
        self, tensions: Array, tolerance_factor: float
    ) -> list[Equilibrium | OctoplanError]:
        """Return the equilibrium or the error of each set of tensions that grows in proportion."""
        crushed: list[CrushedCheck] = [partial(_crushed, self.system.sections, T) for T in tensions]
        starts = [BranchEnd(self._under_loads.point, 0.0)] * len(tensions)
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
        """Return the equilibrium or the error of each set of tensions that acts before the loads.

        Without loads, each cross-section is in equilibrium by itself.
        """
        system = self.system
        is_unique = not self._loaded or has_unique_equilibrium(system.arm, system.scene)
        unpulled = None if is_unique else self._under_loads
        # If there is one equilibrium, the order does not matter: the default is reported.
        history: History = "loads first" if is_unique else "tensions first"
        strains = system.sections.unloaded(tensions)
        lost = np.asarray(np.isnan(strains).any(axis=2), dtype=bool)
        some = ~lost.any(axis=1)
        T = tensions[some]
        v = strains[some]
        crushed: list[CrushedCheck] = [partial(system.sections.crushed, each) for each in v]
        followed = list[BranchEnd]()
        if len(T):
            x = system.x(T, 1.0 - self._loaded, system.initial_states(T, v))
            if self._loaded:
                points, _ = linearised(system, x, [None] * len(x))
                starts = [BranchEnd(replace(point, history=history), 0.0) for point in points]
                lines = self._line(T, 0.0), self._line(T, 1.0)
                followed = continue_branches(
                    starts, lines, LEAST_STEP, crushed, tolerance_factor, MAX_TOLERANCE_FACTOR
                )
            else:
                followed = [BranchEnd(Equilibrium(system, row), 1.0) for row in x]
        known = iter(zip(followed, crushed, strict=True))
        before = ""
        if unpulled is not None and tensions.any():
            before = (
                f"without tension {unpulled.why} at {100 * unpulled.fraction:.1f} %, pulled first "
            )
        ends = list[Equilibrium | OctoplanError]()
        for sections in lost:
            if sections.any():
                ends.append(UnsettledSectionError(float(system.s[np.argmax(sections)])))
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
        """Return ends of lines (M, n_tendons + 1): tensions (M, n_tendons) and load factor."""
        return np.column_stack([tensions, np.full(len(tensions), load)])

    def solve_from(self, point: Equilibrium, tensions: Array) -> Equilibrium | None:
        """Return the equilibrium under tensions near an equilibrium of this mesh.

        Return None if Newton's method does not converge.
        """
        change = point.by_tensions @ (tensions - point.tensions)
        _, (size,) = step_sizes(point.system, change[None], point.states[None])
        load = float(point.x[point.system.layout.n_tendons])
        origin = point if size < CHORD_RADIUS else None
        start = Start(tensions, load, point.states + change, linearised_at=origin)
        return newton(point.system, [start])[0]

    def without_loads(self, tensions: Array) -> Array:
        """Return the states under tensions without loads; raise UnsettledSectionError."""
        return self.system.initial_states(tensions, self.system.sections.strains(tensions))

    def transfer_states(self, tensions: Array, near: Sequence[Equilibrium]) -> Array:
        """Return states (M, n_states) of this mesh from the strains of equilibria on other meshes.

        Each set of tensions (M, n_tendons) has its own equilibrium and mesh. If the tensions
        differ, the derivatives of the equilibrium predict the states first.
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
    """Return the error if tensions (n_tendons,) crush an arm without loads; None otherwise."""
    try:
        return sections.crushed(sections.strains(tensions))
    except UnsettledSectionError as problem:
        return problem


def predict_states(near: Equilibrium, tensions: Array) -> Array:
    """Return the states under tensions (n_tendons,) from the derivatives of an equilibrium."""
    if np.array_equal(tensions, near.tensions):
        return near.states
    return near.states + near.by_tensions @ (tensions - near.tensions)


def transfer_strains(before: DiscreteRod, strains: Array, after: DiscreteRod) -> Array:
    """Interpolate strains (N stages, ...) at the stages of one mesh to the stages of another."""
    mesh = before.mesh
    m = before.layout.structure.stages
    step = np.clip(np.searchsorted(mesh.s, after.s) - 1, 0, before.layout.elements - 1)
    x = (after.s - mesh.s[step]) / np.diff(mesh.s)[step]
    by_element = strains.reshape(before.layout.elements, m, *strains.shape[1:])
    return np.asarray(np.einsum("nm,nm...->n...", gauss(m).at(x), by_element[step]))
