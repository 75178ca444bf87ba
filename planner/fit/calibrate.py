"""Calibrate an arm: numbers of arm, effects and measurement from measured shapes."""

from __future__ import annotations

import logging
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from model import Arm, InputError, Scene
from model.checks import kind
from model.effects import Friction, PrintedStatics
from model.equilibrium.forward import STAGES, collocation_order
from model.equilibrium.linearised import Linearised
from model.errors import OctoplanError, SnapError, TimeLimitError
from model.loads import contacts
from model.machine.compiled import Compile, checked_compile
from model.mesh_refinement import checked_accuracy, estimate
from model.paths import Array
from model.progress import tell, with_progress
from model.settle import checked_scene
from model.time_limit import OutOfTime, time_limit
from planner.fit.calibration import Calibration
from planner.fit.fitted import Start, point_table
from planner.fit.least_squares import LOSSES, Fit, Loss, Weights, fit
from planner.fit.measured import Measured, check_scale
from planner.fit.residuals import Evaluation, Experiment, UnsettledShapeError
from planner.fit.unknowns import Parameters, Unknown

LOG = logging.getLogger(__name__)
ACCURACY = 1e-5
# How far apart tips are that are on different branches, over the arm's length.
_ASTRAY = 1e-3
# How near to optima fits come, by the logarithm of the likelihood: on the coarse mesh, and last.
_COARSE_FIT, _FINE_FIT = 1e-1, 1e-5
# How often a fit begins again from shapes as they are reached from rest.
_ROUNDS = 3
_JUMPS = "it jumps to another shape near the values of the optimum"
# Refinements and stages of the meshes: of the first fits, then until one is as accurate as asked.
_COARSE, _FINER = (1, 2), ((2, 2), (2, STAGES), (4, STAGES), (8, STAGES))


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
    time_limit: float | None = None,
    progress: bool | None = None,
) -> Calibration:
    """Return the arm, and the scene, that explain measured shapes best.

    Least squares over all shapes at once, with derivatives by the implicit function theorem.

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
        Whether to work by machine code; see settle.
    time_limit : float
        After how long the best values so far are returned [s]; their outcome says so.
    progress : bool
        Whether a line tells how far it is: unless given, after two seconds, on terminals and in
        notebooks.

    Raises
    ------
    InputError
        For what does not fit together: markers off the arm or in other units, unknown keys, bounds
        that exclude what the arm has, fewer data than unknowns, scenes as printed or with contact.
    UnsettledShapeError
        If a shape settles neither at the given values nor at those that are found. One that does
        but cannot be followed to an optimum is left out of it, and named; see Calibration.left_out.
    TimeLimitError
        If the time limit is reached before a fit has begun.
    CompilerError
        If `compile` is True, and there is no compiler or it fails.
    """
    scene = supported_scene(arm, scene)
    if loss not in LOSSES:
        raise InputError("loss", loss, ", ".join(LOSSES))
    if not (isinstance(starts, int) and 1 <= starts <= 1000):
        raise InputError("starts", starts, "a whole number from 1 to 1000")
    shapes = _checked(arm, measured)
    sessions = sorted({shape.session for shape in shapes} - {""})
    parameters = Parameters.of(arm, scene, unknowns, point_table(shapes), sessions)
    _check_enough(shapes, parameters)
    weights, machine_code = Weights(loss, bool(absolute_std)), checked_compile(compile)
    search = _Search(parameters, shapes, weights, checked_accuracy(accuracy), machine_code)
    return search.run(arm, scene, parameters.multistart(starts, seed), time_limit)


def supported_scene(arm: Arm, scene: Scene | None) -> Scene:
    """Return a scene whose equations are differentiated by their numbers, or raise InputError."""
    scene = checked_scene(arm, scene)
    if scene.has(PrintedStatics):
        raise InputError("scene", "as printed", "a scene whose equations hold under loads")
    if contacts(scene):
        raise InputError("scene", "contact", "a scene without: it is not differentiated by numbers")
    return scene


def _checked(arm: Arm, measured: Iterable[Measured]) -> tuple[Measured, ...]:
    given = tuple(measured)
    if not given:
        raise InputError("measured", given, "at least one shape")
    for i, shape in enumerate(given):
        kind(f"measured[{i}]", shape, Measured, "a Measured")
    names = [shape.name or f"measured[{i}]" for i, shape in enumerate(given)]
    for name in names:
        if names.count(name) > 1:
            raise InputError("Measured.name", name, "each name once")
    check_scale(arm, given)
    return tuple(shape.checked(arm, name) for shape, name in zip(given, names, strict=True))


def _check_enough(shapes: Sequence[Measured], parameters: Parameters) -> None:
    data = sum(shape.size for shape in shapes)
    free = sum(unknown.prior is None for unknown in parameters.unknowns)
    if data < free:
        allowed = f"at most as many unknowns without priors as numbers measured, {data}"
        raise InputError("unknowns", free, allowed)


@dataclass
class _Search:
    """Fits from several starts on a coarse mesh, the best one followed on finer ones.

    It keeps where fits came to, shapes that were on other branches, and why shapes are left out.
    """

    parameters: Parameters
    shapes: tuple[Measured, ...]
    weights: Weights
    accuracy: float
    machine_code: bool
    problem: OctoplanError = field(default_factory=OctoplanError)
    starts: list[Start] = field(default_factory=list)
    astray: dict[str, None] = field(default_factory=dict)
    settled: set[int] = field(default_factory=set)
    why: dict[int, OctoplanError] = field(default_factory=dict)

    def run(
        self, arm: Arm, scene: Scene, spread: Sequence[Array], seconds: float | None
    ) -> Calibration:
        """Return the calibration that the best of fits from several values leads to."""
        best, error, stopped = None, float("inf"), False
        try:
            with time_limit(seconds):
                for i, values in enumerate(spread):
                    tell("fits", i, len(spread))
                    found = self._begun(values)
                    best = min(filter(None, (best, found)), key=lambda own: own.cost, default=None)
                if best is None:
                    raise self.problem
                best = self._from_rest(best)
                for i, mesh in enumerate(_FINER):
                    tell("meshes", i, len(_FINER))
                    fine, error = self._finer(best.evaluation, mesh)
                    best = replace(best, evaluation=fine)
                    if error <= self.accuracy:
                        break
                best = self._fit(best.evaluation, _FINE_FIT)
        except OutOfTime:
            if best is None:
                raise TimeLimitError(seconds or 0.0) from None
            stopped = True
        out = [i for i in range(len(self.shapes)) if i not in best.evaluation.present]
        for i in out:
            if i not in self.settled:
                raise UnsettledShapeError(self.shapes[i].name, self.why[i])
        return Calibration(
            arm,
            scene,
            self.shapes,
            self.parameters.unknowns,
            tuple(best.evaluation.values.tolist()),
            best.noise,
            self.weights,
            best.evaluation.experiment.refinement,
            error,
            tuple(self.starts),
            tuple(self.astray),
            tuple((self.shapes[i].name, str(self.why[i])) for i in out),
            stopped,
            self.machine_code,
            best.evaluation.experiment.stages,
            best.evaluation,
        )

    def _begun(self, values: Array) -> Fit | None:
        """Return the fit that begins with values, None where no shape settles there."""
        given = tuple(values.tolist())
        try:
            found = self._fit(self._on(*_COARSE).from_rest(values))
        except (UnsettledShapeError, InputError) as reason:
            self.problem = reason
            self.starts.append(Start(given, None, float("inf"), str(reason)))
            return None
        LOG.debug("noise %.4g after %d evaluations", found.noise, found.evaluations)
        self.starts.append(Start(given, tuple(found.evaluation.values.tolist()), found.cost))
        return found

    def _from_rest(self, best: Fit) -> Fit:
        """Return a fit that has all shapes as they are reached from rest.

        It is begun again from there where it has some on other branches, or could not follow them;
        those that jump again are left out.
        """
        for again in range(_ROUNDS + 1):
            here = best.evaluation
            rest = here.experiment.from_rest(here.values)
            either = sorted({*here.present, *rest.present})
            gaps = [_gap(here.equilibria[i], rest.equilibria[i]) for i in either]
            apart = [i for i, gap in zip(either, gaps, strict=True) if not gap <= _ASTRAY]
            if not apart:
                break
            if again == _ROUNDS:
                return self._without(best, apart)
            self.astray |= {self.shapes[i].name: None for i in apart if i in here.present}
            best = self._fit(rest)
        return best

    def _finer(self, coarse: Evaluation, mesh: tuple[int, int]) -> tuple[Evaluation, float]:
        """Return an evaluation on a finer mesh, with the error that this leaves over the length."""
        finer = self._on(*mesh)
        fine = coarse.near(coarse.values, finer)
        if fine.lost:
            fine = finer.from_rest(coarse.values)
        gaps = {i: _gap(coarse.equilibria[i], fine.equilibria[i]) for i in coarse.present}
        self.astray |= {self.shapes[i].name: None for i, gap in gaps.items() if not gap <= _ASTRAY}
        gap = max((gap for gap in gaps.values() if gap <= _ASTRAY), default=0.0)
        before = coarse.experiment
        if finer.stages > before.stages:
            return fine, gap  # the error of the coarser one: its own is less
        rubs = any(own.system.scene.has(Friction) for own in fine.settings.values())
        order = collocation_order(finer.stages, rubs)
        return fine, float(estimate(gap, before.refinement, finer.refinement, order))

    def _fit(self, start: Evaluation, tolerance: float = _COARSE_FIT) -> Fit:
        """Return the fit of the shapes that settle, without those that cannot be followed."""
        self.settled |= set(start.present)
        self.why |= start.lost
        if not start.present:
            first = min(start.lost)
            raise UnsettledShapeError(self.shapes[first].name, start.lost[first])
        best = fit(start, self.weights, tolerance)
        while best.refused and len(best.refused) < len(best.evaluation.present):
            best = self._without(best, best.refused, tolerance)
        return best

    def _without(self, best: Fit, jumping: Sequence[int], tolerance: float = _COARSE_FIT) -> Fit:
        """Return the fit without shapes that jump."""
        kept = [i for i in best.evaluation.present if i not in jumping]
        self.why |= {i: SnapError(1.0, _JUMPS) for i in jumping}
        return fit(best.evaluation.only(kept), self.weights, tolerance) if kept else best

    def _on(self, refinement: int, stages: int) -> Experiment:
        mesh = refinement, stages, self.machine_code
        return Experiment(self.parameters, self.shapes, *mesh)


def _gap(one: Linearised | None, other: Linearised | None) -> float:
    """Return how far apart the tips of two equilibria are, over the arm's length."""
    if one is None or other is None:
        return float("inf")
    tips = [here.system.poses(here.states)[-1, 4:] for here in (one, other)]
    return float(np.linalg.norm(tips[0] - tips[1])) / float(one.system.arm.length)
