"""Calibrate an arm: numbers of arm, effects and measurement from measured shapes."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import get_args

import numpy as np

from octoplan.model import Arm, InputError, Scene
from octoplan.model.equilibrium.newton import STAGES
from octoplan.model.extensions.contact.effects import contacts
from octoplan.model.extensions.printed import PrintedStatics
from octoplan.model.forward import checked_accuracy, estimate
from octoplan.model.loads import convergence_order
from octoplan.model.paths import Array
from octoplan.model.settle import checked_scene
from octoplan.model.support.checks import kind
from octoplan.model.support.errors import OctoplanError, SnapError
from octoplan.model.support.machine.compiled import Compile, checked_compile
from octoplan.model.support.progress import OutOfTime, limited, report, with_progress
from octoplan.planner.extensions.fit.calibration import Calibration
from octoplan.planner.extensions.fit.experiment import CoarseMeshError, Experiment
from octoplan.planner.extensions.fit.fitted import Start, parameters_of
from octoplan.planner.extensions.fit.least_squares import Fit, Loss, fit
from octoplan.planner.extensions.fit.measured import Measured, checked_shapes, crushing_remark
from octoplan.planner.extensions.fit.residuals import Evaluation, UnsettledShapeError, from_rest
from octoplan.planner.extensions.fit.unknowns import Parameters, Unknown

ACCURACY = 1e-5
# How far apart tips are that are on different branches, over the arm's length.
_ASTRAY = 1e-3
# How often a fit begins again from shapes as they are reached from rest.
_ROUNDS = 3
_JUMPS = "it jumps to another shape near the values of the optimum"
# Refinements and stages of the meshes, from that of the first fits to the finest.
_MESHES = ((1, 2), (2, 2), (2, STAGES), (4, STAGES), (8, STAGES))


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
    arm, scene : Arm, Scene
        What all other numbers are taken from, and where a fit begins.
    measured : sequence of Measured
    unknowns : sequence of Unknown
    loss : str
        "linear", or "huber", "soft_l1", "cauchy": robust against outliers; residuals count in full
        up to the noise that most of them have.
    absolute_std : bool
        Whether the standard deviations of the measurements hold as given. Otherwise the residuals
        scale them, if there are surplus data: more numbers than the unknowns can fit. Intervals are
        by Student's t then. Without surplus data the standard deviations hold as given, and
        standard errors are inf if none are given; the outcome says so.
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
    if not isinstance(loss, str) or loss not in get_args(Loss):
        raise InputError("loss", loss, ", ".join(get_args(Loss)))
    if not (isinstance(starts, int) and 1 <= starts <= 1000):
        raise InputError("starts", starts, "a whole number from 1 to 1000")
    shapes = checked_shapes(arm, measured)
    parameters = parameters_of(arm, scene, unknowns, shapes)
    data = sum(shape.size for shape in shapes)
    free = sum(unknown.prior is None for unknown in parameters.unknowns)
    if data < free:
        allowed = f"at most as many unknowns without priors as numbers measured, {data}"
        raise InputError("unknowns", free, allowed)
    kind("absolute_std", absolute_std, bool | np.bool_, "True or False")
    lacking = [shape.name for shape in shapes if not shape.has_stds]
    if absolute_std and lacking:
        allowed = f"False, or give the standard deviations of {lacking[0]}"
        raise InputError("absolute_std", True, allowed)
    counted, machine_code = (loss, bool(absolute_std)), checked_compile(compile)
    search = _Search(parameters, shapes, *counted, checked_accuracy(accuracy), machine_code)
    stopped = False
    with limited(time_limit):
        try:
            search.run(parameters.multistart(starts, seed))
        except OutOfTime:
            stopped = True
        best = search.best
        if best is None:
            raise OutOfTime
    refinement, stages, _ = best.evaluation.experiment.mesh
    return Calibration(
        arm,
        scene,
        shapes,
        parameters.unknowns,
        tuple(best.evaluation.values.tolist()),
        best.noise,
        *counted,
        refinement,
        search.error,
        tuple(search.starts),
        tuple(search.astray),
        search.left_out(best),
        stopped,
        machine_code,
        stages,
        tuple((shapes[i].name, str(why)) for i, why in best.refused.items()),
        best.evaluation.relinearised(),
    )


def supported_scene(arm: Arm, scene: Scene | None) -> Scene:
    """Return a scene whose equations are differentiated by their numbers, or raise InputError."""
    scene = checked_scene(arm, scene)
    if scene.has(PrintedStatics):
        raise InputError("scene", "as printed", "a scene whose equations hold under loads")
    if contacts(scene):
        raise InputError("scene", "contact", "a scene without: it is not differentiated by numbers")
    return scene


@dataclass
class _Search:
    """Fits from several starts on a coarse mesh, the best one followed on finer ones.

    Attributes
    ----------
    best : Fit or None
        So far.
    error : float
        Estimated error of its mesh, over the arm's length.
    starts : list of Start
        Where fits came to.
    astray : dict of None
        Names of shapes that fits had on other branches than the arm takes from rest.
    why : dict of OctoplanError
        Why shapes are left out, by number.
    """

    parameters: Parameters
    shapes: tuple[Measured, ...]
    loss: Loss
    absolute_std: bool
    accuracy: float
    machine_code: bool
    best: Fit | None = None
    error: float = float("inf")
    starts: list[Start] = field(default_factory=list)
    astray: dict[str, None] = field(default_factory=dict)
    why: dict[int, OctoplanError] = field(default_factory=dict)
    _settled: set[int] = field(default_factory=set)

    def run(self, spread: Sequence[Array]) -> None:
        """Fit from several values; raises what keeps all of them from settling."""
        problems = []
        for i, values in enumerate(spread):
            report("fits", i, len(spread))
            start = Start(tuple(values.tolist()), None, float("inf"))
            try:
                optimum = self._fit(self._begin(values), first=True)
            except (UnsettledShapeError, InputError) as reason:
                problems.append(reason)
                self.starts.append(start._replace(why=str(reason)))
                continue
            end = tuple(optimum.evaluation.values.tolist())
            self.starts.append(start._replace(found=end, misfit=optimum.cost))
            if self.best is None or optimum.cost < self.best.cost:
                self.best, origin = optimum, values
        if self.best is None:
            raise problems[-1]
        self.best = self._from_rest(self._refined(self.best.evaluation, origin))

    def left_out(self, best: Fit) -> tuple[tuple[str, str], ...]:
        """Return names of shapes that a fit does without, and why.

        UnsettledShapeError for one that settles nowhere.
        """
        out = [i for i in range(len(self.shapes)) if i not in best.evaluation.equilibria]
        for i in out:
            if i not in self._settled:
                raise UnsettledShapeError(self.shapes[i].name, self.why[i])
        return tuple((self.shapes[i].name, str(self.why[i])) for i in out)

    def _begin(self, values: Array) -> Evaluation:
        """Return all shapes from rest, on the first mesh that is fine enough for those that settle.

        A fit needs one finer mesh at least, which its error is estimated by.
        """
        for mesh in _MESHES[:-1]:
            start = from_rest(self._experiment(*mesh), values)
            if not any(isinstance(why, CoarseMeshError) for why in start.lost.values()):
                break
        return start

    def _refined(self, coarse: Evaluation, origin: Array) -> Evaluation:
        """Return an evaluation on the first mesh that is as accurate as asked, or the finest.

        If no shape settles on a finer mesh, the fit begins there again from its origin: the limit
        of the shapes, at which it ended, is another one.
        """
        first = _MESHES.index(coarse.experiment.mesh[:2]) + 1
        for number, mesh in enumerate(_MESHES[first:], first):
            report("meshes", number, len(_MESHES))
            fine = coarse.near(coarse.values, self._experiment(*mesh))
            if not fine.equilibria:
                coarse = self._fit(from_rest(fine.experiment, origin), first=True).evaluation
                continue
            gap = max((_tip_distance(coarse, fine, i) for i in fine.equilibria), default=0.0)
            (before, m, _), (after, stages, _) = coarse.experiment.mesh, fine.experiment.mesh
            # With more stages it is the error of the coarser one: its own is less.
            order = convergence_order(self.parameters.given.scene, 2 * stages)
            self.error = gap if stages > m else float(estimate(gap, before, after, order))
            coarse = fine
            if self.error <= self.accuracy:
                break
        return coarse

    def _from_rest(self, start: Evaluation) -> Fit:
        """Return the fit that has all shapes as they are reached from rest.

        It is begun again from there where it has some on other branches, or could not follow them;
        those that jump again are left out.
        """
        apart = list[int]()
        for _ in range(_ROUNDS):
            self.best = best = self._fit(start)
            followed = best.evaluation
            start = from_rest(self._experiment(*_MESHES[0]), followed.values)
            if apart := _on_other_branch(followed, start):
                # It may be the coarse mesh that has them elsewhere.
                start = from_rest(followed.experiment, followed.values)
                apart = _on_other_branch(followed, start)
            if not apart:
                return best
            self.astray |= {self.shapes[i].name: None for i in apart if i in followed.equilibria}
        return self._fit(self._fit(start).evaluation, apart)

    def _fit(self, start: Evaluation, jumping: Sequence[int] = (), first: bool = False) -> Fit:
        """Return the fit of the shapes that settle, without those that jump.

        Nor those that the fit cannot follow, unless that is all of them.
        """
        self._settled |= set(start.equilibria)
        self.why |= start.lost
        while True:
            kept = set(start.equilibria).difference(jumping)
            if jumping and kept:
                self.why |= {i: SnapError(1.0, _JUMPS) for i in jumping}
                start = start.only(kept)
            if not start.equilibria:
                i, why = next(iter(start.lost.items()))
                remark = crushing_remark(self.parameters.given.arm, self.shapes)
                raise UnsettledShapeError(self.shapes[i].name, why, remark)
            best = fit(start, self.loss, self.absolute_std, first)
            start, jumping = best.evaluation, tuple(best.refused)
            if len(jumping) in (0, len(start.equilibria)):
                return best

    def _experiment(self, refinement: int, stages: int) -> Experiment:
        return Experiment(self.parameters, self.shapes, refinement, stages, self.machine_code)


def _tip_distance(one: Evaluation, other: Evaluation, i: int) -> float:
    """Return how far apart the tips of a shape are in two evaluations, over the arm's length."""
    pair = [evaluation.equilibria.get(i) for evaluation in (one, other)]
    tips = [each.system.poses(each.states)[-1, 4:] for each in pair if each]
    length = one.experiment.parameters.given.arm.length
    return float(np.linalg.norm(tips[0] - tips[1])) / length if len(tips) == 2 else float("inf")


def _on_other_branch(one: Evaluation, other: Evaluation) -> list[int]:
    """Return which shapes are not on the same branch in two evaluations."""
    either = sorted({*one.equilibria, *other.equilibria})
    return [i for i in either if not _tip_distance(one, other, i) <= _ASTRAY]
