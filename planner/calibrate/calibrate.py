"""Calibrate an arm: numbers of arm, effects and measurement from measured shapes."""

from __future__ import annotations

import logging
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from model import Arm, InputError, Scene
from model.checks import kind
from model.effects import Friction, PrintedStatics
from model.equilibrium.forward import STAGES, collocation_order
from model.errors import OctoplanError
from model.machine.compiled import Compile, checked_compile
from model.mesh_refinement import checked_accuracy, estimate
from model.paths import Array
from model.progress import tell, with_progress
from model.settle import checked_scene
from planner.calibrate.calibration import Calibration
from planner.calibrate.experiment import Evaluation, Experiment, UnsettledShapeError
from planner.calibrate.fit import LOSSES, Fit, Loss, Weights, fit
from planner.calibrate.fitted import Start
from planner.calibrate.measured import Measured, check_scale
from planner.calibrate.session import point_table
from planner.unknowns.parameters import Parameters, spread
from planner.unknowns.unknown import Unknown

LOG = logging.getLogger(__name__)
ACCURACY = 1e-5
# How far apart shapes are that are on different branches, over the arm's length.
_ASTRAY = 1e-3
# Stages of elements while starts are compared, how near to the optima that is done, in standard
# errors, and how often shapes that are not those from rest are followed from there.
_COARSE, _NEAR, _AFRESH = 2, 0.1, 3
# By how much more Newton's method may leave of equilibria then.
_LOOSER = 1e4
# Refinements and stages of the meshes that follow, until one is as accurate as asked.
_FINER = ((2, _COARSE), (2, STAGES), (4, STAGES), (8, STAGES))


@with_progress
def calibrate(
    arm: Arm,
    scene: Scene | None,
    measured: Iterable[Measured],
    unknowns: Iterable[Unknown],
    *,
    loss: Loss = "linear",
    absolute_std: bool = False,
    starts: int = 1,
    seed: int = 0,
    accuracy: float = ACCURACY,
    compile: Compile = False,  # noqa: A002  (the name that scripts use)
    progress: bool | None = None,
) -> Calibration:
    """Return the arm, and the scene, that explain measured shapes best.

    Least squares over all shapes at once, with exact derivatives by the implicit function theorem.

    Parameters
    ----------
    measured : sequence of Measured
    unknowns : sequence of Unknown
    loss : str
        "linear", or "huber", "soft_l1", "cauchy": robust against outliers; residuals count in full
        up to the noise that most of them have.
    absolute_std : bool
        Whether the standard deviations of the measurements hold as they are; else the residuals
        say what they are multiplied by.
    starts : int
        How many fits begin, the first with what arm and scene have, the others spread evenly over
        the bounds; the best is returned.
    seed : int
        Of the other starts.
    accuracy : float
        Error of what is predicted, over the arm's length, that meshes may have.
    compile : bool or "auto"
        Whether to work by machine code; see settle. All shapes are settled side by side then, and
        values differ by less than a thousandth of their standard errors.
    progress : bool
        Whether a line tells how far it is: unless given, after two seconds, on terminals and in
        notebooks.

    Raises
    ------
    InputError
        For what does not fit together: markers off the arm or in other units, unknown keys, bounds
        that exclude what the arm has, fewer data than unknowns.
    UnsettledShapeError
        If from no start all shapes settle.
    CompilerError
        If `compile` is True, and there is no compiler or it fails.
    """
    scene = checked_scene(arm, scene)
    if scene.has(PrintedStatics):
        raise InputError("scene", "as printed", "a scene whose equations hold under loads")
    if loss not in LOSSES:
        raise InputError("loss", loss, ", ".join(LOSSES))
    if not (isinstance(starts, int) and 1 <= starts <= 1000):
        raise InputError("starts", starts, "a whole number from 1 to 1000")
    shapes = _checked(arm, measured)
    sessions = sorted({shape.session for shape in shapes} - {""})
    parameters = Parameters.of(arm, scene, unknowns, point_table(shapes), sessions)
    _check_enough(shapes, parameters)
    weights = Weights(loss, bool(absolute_std))
    asked = (parameters, shapes, weights, checked_accuracy(accuracy), checked_compile(compile))
    search = _Search(arm, scene, *asked)
    return search.run(spread(parameters, starts, seed))


def _checked(arm: Arm, measured: Iterable[Measured]) -> tuple[Measured, ...]:
    given = tuple(measured)
    if not given:
        raise InputError("measured", given, "at least one shape")
    for i, shape in enumerate(given):
        kind(f"measured[{i}]", shape, Measured, "a Measured")
    named = [shape.name or f"measured[{i}]" for i, shape in enumerate(given)]
    for name in named:
        if named.count(name) > 1:
            raise InputError("Measured.name", name, "each name once")
    check_scale(arm, given)
    return tuple(shape.checked(arm, name) for shape, name in zip(given, named, strict=True))


def _check_enough(shapes: Sequence[Measured], parameters: Parameters) -> None:
    data = sum(shape.size for shape in shapes)
    free = sum(own.prior is None for own in parameters.unknowns)
    if data < free:
        allowed = f"at most as many unknowns without priors as numbers measured, {data}"
        raise InputError("unknowns", free, allowed)


@dataclass
class _Search:
    """Fits from several starts on a coarse mesh, the best one followed on finer ones."""

    arm: Arm
    scene: Scene
    parameters: Parameters
    shapes: tuple[Measured, ...]
    weights: Weights
    accuracy: float
    machine_code: bool

    def run(self, spread: list[Array]) -> Calibration:
        fits, told = self._fits(spread)
        best, astray = self._from_rest(min(fits, key=lambda own: own.misfit))
        best, error, lost = self._on_finer(best)
        mesh = best.found.experiment
        return Calibration(
            self.arm,
            self.scene,
            self.shapes,
            self.parameters.unknowns,
            tuple(best.found.values.tolist()),
            best.noise,
            self.weights,
            mesh.refinement,
            error,
            tuple(told),
            astray or lost,
            self.machine_code,
            mesh.stages,
        )

    def _fits(self, spread: list[Array]) -> tuple[list[Fit], list[Start]]:
        fits: list[Fit] = []
        told: list[Start] = []
        problem: OctoplanError | None = None
        for i, values in enumerate(spread):
            tell("fits", i, len(spread))
            try:
                found = fit(self._on(1, _COARSE, _LOOSER).at(values), self.weights, _NEAR)
            except (UnsettledShapeError, InputError) as reason:
                problem = problem or reason
                told.append(Start(tuple(values.tolist()), None, float("inf"), str(reason)))
                continue
            LOG.debug(
                "start %d: noise %.4g after %d evaluations", i, found.noise, found.evaluations
            )
            fits.append(found)
            ended = tuple(found.found.values.tolist())
            told.append(Start(tuple(values.tolist()), ended, found.misfit))
        if not fits:
            assert problem is not None
            raise problem
        return fits, told

    def _on(self, refinement: int, stages: int, looser: float = 1.0) -> Experiment:
        mesh = refinement, self.machine_code, stages, looser
        return Experiment(self.parameters, self.shapes, *mesh)

    def _from_rest(self, best: Fit) -> tuple[Fit, tuple[str, ...]]:
        """Return a fit with all shapes as they are reached from rest, and those that were not."""
        astray: tuple[str, ...] = ()
        for _ in range(_AFRESH):
            led = best.differentiated  # its factors serve to follow the tensions from rest
            fresh = led.experiment.from_rest(led)
            lost, _ = self._apart(led, fresh)
            if not lost:
                break
            astray = astray or lost
            best = fit(fresh, self.weights, _NEAR)
        return best, astray

    def _on_finer(self, best: Fit) -> tuple[Fit, float, tuple[str, ...]]:
        """Return the fit on a mesh that is accurate enough, beginning with that on a coarse one.

        With the error that its mesh leaves, by the difference to the one before, and the shapes
        that finer meshes have elsewhere.
        """
        at, astray = best.found, tuple[str, ...]()
        for refinement, stages in _FINER:
            fine = self._on(refinement, stages).at(at.values, at)
            lost, gap = self._apart(at, fine)
            error = _error(gap, at, fine)
            at, astray = fine, astray or lost
            if not lost and error <= self.accuracy:
                break
        return fit(at, self.weights), error, astray

    def _apart(self, one: Evaluation, other: Evaluation) -> tuple[tuple[str, ...], float]:
        """Return the shapes that two evaluations have on different branches.

        And how far apart the tips of the others are at most, over the arm's length.
        """
        gaps = [_gap(a, b) for a, b in zip(one.heres, other.heres, strict=True)]
        named = zip(self.shapes, gaps, strict=True)
        lost = tuple(shape.name for shape, gap in named if gap > _ASTRAY)
        return lost, max((gap for gap in gaps if gap <= _ASTRAY), default=0.0)


def _gap(one: Any, other: Any) -> float:
    """Return how far apart the tips of two equilibria are, over the arm's length."""
    tips = [here.system.poses(here.states)[-1, 4:] for here in (one, other)]
    return float(np.linalg.norm(tips[0] - tips[1])) / float(one.system.arm.length)


def _error(gap: float, coarse: Evaluation, fine: Evaluation) -> float:
    """Return the error of the finer of two meshes whose tips are a gap apart, over the length.

    Where it has more stages, that is the other's: its own is less.
    """
    one, other = coarse.experiment, fine.experiment
    if other.stages > one.stages:
        return gap
    friction = fine.heres[0].system.scene.has(Friction)
    order = collocation_order(other.stages, friction)
    return float(estimate(gap, one.refinement, other.refinement, order))
