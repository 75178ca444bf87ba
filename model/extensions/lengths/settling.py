"""Settle an arm with given tendon lengths."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from octoplan.model.equilibrium.linearised import AnyEquilibrium, Equilibrium, check_stretch
from octoplan.model.extensions.lengths.by_lengths import GivenLengths
from octoplan.model.extensions.lengths.least_energy import LeastEnergy
from octoplan.model.extensions.lengths.shortest import buckling_lengths, crushing_lengths
from octoplan.model.extensions.lengths.winches import Winches
from octoplan.model.extensions.printed import PrintedStatics
from octoplan.model.forward import ForwardMap, ForwardMaps
from octoplan.model.loads import is_path_dependent
from octoplan.model.settle import SettlingProblem, settle_on_meshes
from octoplan.model.shape import Shape
from octoplan.model.support.errors import (
    CollapsedError,
    Described,
    InputError,
    UnsettledSectionError,
)
from octoplan.model.support.units import TENDONS, warn_unusual


def settle_lengths(
    problem: SettlingProblem, maps: ForwardMaps, near: AnyEquilibrium | None
) -> Shape:
    """Return the shape with the tendon lengths of a problem; see settle.

    Raises InputError if no shape has the lengths or if the lengths crush the arm, naming a tendon.
    """
    winches = _checked_winches(problem)
    lengths = GivenLengths(maps, winches, None if near is None else near.tensions)

    def solve(forward: ForwardMap, near: AnyEquilibrium | None, _: float) -> AnyEquilibrium:
        return lengths.on(forward, near)

    try:
        shape = settle_on_meshes(maps, solve, problem.accuracy, near)
        end = lengths.finished(maps.on(shape.refinement), shape.equilibrium)
        check_stretch(end)
    except (CollapsedError, UnsettledSectionError) as reason:
        raise crushing_lengths(problem.arm, winches, reason) from None
    if problem.arm.is_guided and isinstance(end, Equilibrium):
        _check_spans(end, winches)
    return replace(shape, equilibrium=end, winches=winches)


def _check_spans(end: Equilibrium, winches: Winches) -> None:
    """Raise InputError if an arm with guides is at a saddle point of its energy.

    Held lengths keep an arm with continuous guides from buckling, but not its spans between guides.
    """
    system = end.system
    strains = end.states[system.layout.stages]
    if not LeastEnergy(system).is_minimum(end.tensions, strains, winches):
        raise buckling_lengths(system.arm, winches)


def _checked_winches(problem: SettlingProblem) -> Winches:
    """Return the winches of a problem with lengths; raise InputError."""
    if problem.scene.has(PrintedStatics):
        raise InputError("lengths", Described("given"), "None in a scene as printed; pass tensions")
    if is_path_dependent(problem.scene):
        allowed = "None in a scene whose contacts have friction; pass tensions"
        raise InputError("lengths", Described("given"), allowed)
    winches = Winches.of(
        problem.arm,
        problem.tensions,
        problem.lengths,
        problem.tendon_EA,
        problem.tendon_outside,
    )
    relative = np.sort(winches.lengths[winches.held] / problem.arm.length)
    median = relative[relative.size // 2 :][:1]
    warn_unusual("lengths", median.tolist(), TENDONS)
    return winches
