"""Calibrate an arm: parameters of arm, effects and sensors from measured shapes."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from operator import attrgetter
from typing import Any, get_args

import numpy as np

from octoplan.model import Arm, InputError, Scene
from octoplan.model.equilibrium.newton import STAGES, STEP_TOL
from octoplan.model.extensions.lengths.winches import PLAIN_WINCHES, WinchSettings
from octoplan.model.extensions.printed import PrintedStatics
from octoplan.model.forward import checked_accuracy, estimate
from octoplan.model.loads import convergence_order
from octoplan.model.paths import Array
from octoplan.model.settle import checked_scene
from octoplan.model.support.checks import flag, not_negative, such, whole
from octoplan.model.support.errors import Described, OctoplanError, SnapError
from octoplan.model.support.machine.compiled import Compile, checked_compile
from octoplan.model.support.progress import OutOfTime, limited, report, with_progress
from octoplan.model.tendons import checked_EA
from octoplan.planner.extensions.fit.calibration import Calibration
from octoplan.planner.extensions.fit.experiment import LOOSER, CoarseMeshError, Experiment
from octoplan.planner.extensions.fit.fitted import Start, parameters_of
from octoplan.planner.extensions.fit.least_squares import Fit, Loss, fit
from octoplan.planner.extensions.fit.measured import Measured, checked_shapes, crushing_remark
from octoplan.planner.extensions.fit.orders import (
    Order,
    Tendons,
    common_orders,
    is_bad,
    section_orders,
)
from octoplan.planner.extensions.fit.residuals import (
    Evaluation,
    UnsettledShapeError,
    from_rest,
    mean_distance,
    unreached,
)
from octoplan.planner.extensions.fit.unknowns import Parameters, Unknown

ACCURACY = 1e-5
# Distance between tips, over the arm's length, above which two shapes are on different branches.
_ASTRAY = 1e-3
# Largest number of fits from different values if none is given and shapes are missed.
_STARTS = 8
# Largest number of fits that restart from shapes settled from rest.
_ROUNDS = 3
# Change of a measured number from bound to bound of an unknown, over the arm's length, below which
# the number does not depend on the unknown. Steps of Newton's method in fits end at 1e-7, where
# derivatives from bound to bound have errors of up to 3e-6.
_UNDETERMINED = 100 * LOOSER * STEP_TOL
_JUMPS = "it jumps to another shape near the values of the optimum"
# Refinement and number of stages of the meshes, from the first fits to the finest mesh.
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
    tendon_EA: float | None = None,
    tendon_outside: float = 0.0,
    starts: int | None = None,
    seed: int = 0,
    accuracy: float = ACCURACY,
    compile: Compile = False,  # noqa: A002  (the name that scripts use)
    time_limit: float | None = None,
    progress: bool | None = None,
) -> Calibration:
    """Estimate parameters of the arm and the scene from measured shapes.

    Nonlinear least squares over all shapes, with derivatives by the implicit function theorem.

    Parameters
    ----------
    arm, scene : Arm, Scene
        Initial guess of the unknowns, and the values of all other parameters.
    measured : sequence of Measured
        Measured shapes.
    unknowns : sequence of Unknown
        Parameters to estimate, with bounds and priors.
    loss : str
        "linear", or one of the robust losses "huber", "soft_l1" and "cauchy". Robust losses reduce
        the weight of residuals above the noise of the majority.
    absolute_std : bool
        Whether to use the standard deviations of the measurements as given. Otherwise the residuals
        scale the standard deviations if there are surplus data, that is, more data than the
        unknowns can fit; intervals then follow Student's t distribution. Without surplus data the
        standard deviations apply as given. If none are given either, standard errors are inf, and
        the outcome reports the reason.
    tendon_EA : float
        Stiffness E A of tendons with measured lengths or strokes [N]; the default is inextensible
        tendons. With the unknown "winches.tendon_EA_N", the initial guess; by default the geometric
        mean of the bounds.
    tendon_outside : float
        Length of each tendon between winch and base, which also stretches [m].
    starts : int
        Number of fits. The first one starts at the values of arm and scene, the others at values
        that are spread evenly over the bounds. The best fit is returned. By default 1, and up to 8
        if shapes are off by a tenth of the arm's length. If the best fit is bad, mirrored and
        shifted orders of the tendons are tried; see Calibration.orders.
    seed : int
        Random seed of the other starts.
    accuracy : float
        Allowed error of predictions due to the mesh, over the arm's length.
    compile : bool or "auto"
        Whether to use compiled kernels; see settle.
    time_limit : float
        Time after which the best values so far are returned [s]; the outcome reports the limit.
    progress : bool
        Whether to show progress. By default, progress is shown after two seconds on terminals and
        in notebooks.

    Raises
    ------
    InputError
        If markers are off the arm or in other units, if keys are unknown, if bounds exclude the
        given value, if there are fewer data than unknowns, if places lack the coordinates that
        depend on unknowns, or if the scene is as printed or has contact.
    UnsettledShapeError
        If a shape settles neither at the given values nor at the estimate. A shape that settles but
        cannot be followed to the optimum is excluded instead; see Calibration.left_out.
    TimeLimitError
        If the time limit is reached before the first fit starts.
    CompilerError
        If `compile` is True, and the compiler is missing or fails.
    """
    scene = supported_scene(arm, scene)
    if not isinstance(loss, str) or loss not in get_args(Loss):
        raise InputError("loss", loss, such(Loss))
    starts = None if starts is None else whole("starts", starts, 1, 1000)
    shapes = checked_shapes(arm, measured)
    winches = _checked_winches(tendon_EA, tendon_outside, shapes)
    parameters = parameters_of(arm, scene, unknowns, shapes, winches)
    data = sum(shape.size for shape in shapes)
    free = sum(unknown.prior is None for unknown in parameters.unknowns)
    if data < free:
        allowed = f"at most as many unknowns without priors as numbers measured, {data}"
        raise InputError("unknowns", free, allowed)
    absolute_std = flag("absolute_std", absolute_std)
    lacking = [shape.name for shape in shapes if not shape.has_stds]
    if absolute_std and lacking:
        allowed = f"False, or give the standard deviations of {lacking[0]}"
        raise InputError("absolute_std", True, allowed)
    machine_code = checked_compile(compile)
    search = _Search(
        parameters=parameters,
        shapes=shapes,
        loss=loss,
        absolute_std=absolute_std,
        accuracy=checked_accuracy(accuracy),
        machine_code=machine_code,
    )
    stopped = False
    with limited(time_limit):
        try:
            initial = parameters.multistart(starts or _STARTS, seed)
            search.run(initial[: starts or 1], initial[starts or 1 :])
        except OutOfTime:
            stopped = True
        best = search.best
        if best is None:
            raise OutOfTime
    refinement, stages, _ = best.evaluation.experiment.mesh
    return Calibration(
        given_arm=arm,
        given_scene=scene,
        measured=search.shapes,
        unknowns=parameters.unknowns,
        values=tuple(best.evaluation.values.tolist()),
        noise=best.noise,
        loss=loss,
        absolute_std=absolute_std,
        refinement=refinement,
        error=search.error,
        starts=tuple(search.starts),
        astray=tuple(search.astray),
        left_out=search.left_out(best),
        stopped=stopped,
        machine_code=machine_code,
        stages=stages,
        blocked=tuple((shapes[i].name, str(why)) for i, why in best.refused.items()),
        given_winches=winches,
        orders=search.orders,
        known=best.evaluation.relinearised(),
    )


def _checked_winches(EA: Any, outside: Any, shapes: Sequence[Measured]) -> WinchSettings:
    """Return the winches; raise InputError for a stiffness without lengths or strokes."""
    settings = WinchSettings(
        tendon_EA=None if EA is None else checked_EA(EA),
        outside=not_negative("tendon_outside", outside),
    )
    has_lengths = any(shape.by_length or shape.tendon_residuals for shape in shapes)
    if settings != PLAIN_WINCHES and not has_lengths:
        name, given = ("tendon_EA", EA) if EA is not None else ("tendon_outside", outside)
        raise InputError(name, given, "omitted if no lengths or strokes are measured")
    return settings


def supported_scene(arm: Arm, scene: Scene | None) -> Scene:
    """Return a scene whose equations have parameter derivatives, or raise InputError."""
    scene = checked_scene(arm, scene)
    if scene.has(PrintedStatics):
        raise InputError(
            "scene", Described("a scene as printed"), "a scene whose equations hold under loads"
        )
    return scene


@dataclass
class _Search:
    """Fit from several starts on a coarse mesh, then refine the mesh of the best fit.

    Attributes
    ----------
    best : Fit or None
        Best fit so far.
    error : float
        Estimated error of the mesh of the best fit, over the arm's length.
    starts : list of Start
        Initial and final values of each fit.
    astray : dict of None
        Names of shapes that a fit had on another branch than the arm reaches from rest.
    why : dict of OctoplanError
        Errors of the shapes that are left out, by index of the shape.
    orders : tuple of Order
        Orders of the tendons that were tried, the one in use first; see Fitted.
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
    orders: tuple[Order, ...] = ()
    _settled: set[int] = field(default_factory=set)
    _origin: Array = field(default_factory=lambda: np.zeros(0))

    def run(self, initial: Sequence[Array], more: Sequence[Array]) -> None:
        """Fit from several initial values; raise the last error if every fit fails.

        Fit from `more` values until all shapes are reached; then try other orders of the tendons.
        """
        problems = []
        for i, values in enumerate([*initial, *more]):
            if i >= len(initial) and (self.best is None or not unreached(self.best.evaluation)):
                break
            report("fits", i, len(initial))
            try:
                self._fit_from(values)
            except (UnsettledShapeError, InputError) as reason:
                problems.append(reason)
                self.starts.append(Start(tuple(values.tolist()), None, float("inf"), str(reason)))
        if self.best is None:
            raise problems[-1]
        if self.is_bad:
            self._try_orders()
        self.best = self._from_rest(self._refined(self.best.evaluation, self._origin))
        _check_partial_places(self.best.evaluation)

    def _fit_from(self, values: Array) -> None:
        """Fit from initial values, and keep the fit if it is the best."""
        optimum = self._fit(self._initial_evaluation(values), first=True)
        end = tuple(optimum.evaluation.values.tolist())
        self.starts.append(Start(tuple(values.tolist()), end, optimum.cost))
        if self.best is None or optimum.cost < self.best.cost:
            self.best = optimum
            self._origin = values

    def _try_orders(self) -> None:
        """Fit with the tendons in other orders, and take the best if its errors are half as large.

        First, all sections are mirrored or shifted alike; if the fit remains bad, one after the
        other.
        """
        arm = self.parameters.given.arm
        given = tuple(range(arm.n_tendons))
        searches: dict[Tendons, _Search] = {given: self}
        orders = {given: self._as_order(given)}
        best = given
        for section in (None, *range(len(arm.sections))):
            if section is not None and not searches[best].is_bad:
                break
            others = common_orders(arm) if section is None else section_orders(arm, best, section)
            for tendons in [each for each in others if each not in searches]:
                report("orders of tendons", len(orders))
                searches[tendons] = self._reordered(tendons)
                orders[tendons] = searches[tendons]._as_order(tendons)
            best = min(orders, key=lambda tendons: orders[tendons].misfit)
        if not orders[best].mean_error <= orders[given].mean_error / 2:
            best = given
        found = searches[best]
        ranked = sorted(orders.values(), key=attrgetter("misfit"))
        self.orders = (orders[best], *(order for order in ranked if order.tendons != best))
        for name in ("shapes", "best", "starts", "astray", "why", "_settled", "_origin"):
            setattr(self, name, getattr(found, name))

    def _reordered(self, tendons: Tendons) -> _Search:
        """Return the fit from the given values with the tendons in another order."""
        search = _Search(
            parameters=self.parameters,
            shapes=tuple(shape.reordered(tendons) for shape in self.shapes),
            loss=self.loss,
            absolute_std=self.absolute_std,
            accuracy=self.accuracy,
            machine_code=self.machine_code,
        )
        with suppress(UnsettledShapeError, InputError):
            search._fit_from(self.parameters.start)
        return search

    @property
    def is_bad(self) -> bool:
        """Whether the best fit is bad, or no shapes settle; see orders.is_bad."""
        return self.best is None or is_bad(self.best.evaluation)

    def _as_order(self, tendons: Tendons) -> Order:
        """Return the order of the tendons with the result of the fit."""
        if self.best is None:
            return Order(tendons, float("inf"), float("inf"))
        return Order(tendons, self.best.cost, mean_distance(self.best.evaluation.named()))

    def left_out(self, best: Fit) -> tuple[tuple[str, str], ...]:
        """Return the names of the shapes that a fit excludes, each with the reason.

        Raises UnsettledShapeError if such a shape has settled in no fit.
        """
        out = [i for i in range(len(self.shapes)) if i not in best.evaluation.equilibria]
        for i in out:
            if i not in self._settled:
                raise UnsettledShapeError(self.shapes[i].name, self.why[i])
        return tuple((self.shapes[i].name, str(self.why[i])) for i in out)

    def _initial_evaluation(self, values: Array) -> Evaluation:
        """Settle all shapes from rest on the first mesh that is fine enough.

        The finest mesh is excluded: the error estimate of a fit requires a finer mesh.
        """
        for mesh in _MESHES[:-1]:
            start = from_rest(self._experiment(*mesh), values)
            if not any(isinstance(why, CoarseMeshError) for why in start.failed.values()):
                break
        return start

    def _refined(self, coarse: Evaluation, origin: Array) -> Evaluation:
        """Refine an evaluation until the mesh error meets the accuracy, or to the finest mesh.

        If no shape settles on a finer mesh, the fit restarts on this mesh from `origin`, because
        the limit of the shapes, at which the coarse fit ended, differs between the meshes.
        """
        first = _MESHES.index(coarse.experiment.mesh[:2]) + 1
        for number, mesh in enumerate(_MESHES[first:], first):
            report("meshes", number, len(_MESHES))
            fine = coarse.near(coarse.values, self._experiment(*mesh))
            if not fine.equilibria:
                coarse = self._fit(from_rest(fine.experiment, origin), first=True).evaluation
                continue
            gap = max((_tip_distance(coarse, fine, i) for i in fine.equilibria), default=0.0)
            before, m, _ = coarse.experiment.mesh
            after, stages, _ = fine.experiment.mesh
            # If the number of stages differs, the gap is the error of the coarser mesh, an upper
            # bound of the error of the finer mesh.
            order = convergence_order(self.parameters.given.scene, 2 * stages)
            self.error = gap if stages > m else float(estimate(gap, before, after, order))
            coarse = fine
            if self.error <= self.accuracy:
                break
        return coarse

    def _from_rest(self, start: Evaluation) -> Fit:
        """Return a fit in which all shapes are on the branch that the arm reaches from rest.

        The fit restarts from shapes settled from rest if some of its shapes are on other branches
        or could not be followed. Shapes that jump again are left out.
        """
        apart = list[int]()
        for _ in range(_ROUNDS):
            self.best = best = self._fit(start)
            followed = best.evaluation
            start = from_rest(self._experiment(*_MESHES[0]), followed.values)
            if apart := _on_other_branch(followed, start):
                # The coarse mesh may have settled on another branch: repeat on the mesh of the fit.
                start = from_rest(followed.experiment, followed.values)
                apart = _on_other_branch(followed, start)
            if not apart:
                return best
            self.astray |= {self.shapes[i].name: None for i in apart if i in followed.equilibria}
        return self._fit(self._fit(start).evaluation, apart)

    def _fit(self, start: Evaluation, jumping: Sequence[int] = (), first: bool = False) -> Fit:
        """Return the fit of the shapes that settle, without the shapes that jump.

        Shapes that the fit cannot follow are removed too, unless these are all shapes.
        """
        self._settled |= set(start.equilibria)
        self.why |= start.failed
        while True:
            kept = set(start.equilibria).difference(jumping)
            if jumping and kept:
                self.why |= {i: SnapError(1.0, _JUMPS) for i in jumping}
                start = start.only(kept)
            if not start.equilibria:
                i, why = next(iter(start.failed.items()))
                remark = crushing_remark(self.parameters.given.arm, self.shapes)
                raise UnsettledShapeError(self.shapes[i].name, why, remark)
            best = fit(start, self.loss, self.absolute_std, first)
            start = best.evaluation
            jumping = tuple(best.refused)
            if len(jumping) in (0, len(start.equilibria)):
                return best

    def _experiment(self, refinement: int, stages: int) -> Experiment:
        return Experiment(self.parameters, self.shapes, refinement, stages, self.machine_code)


def _check_partial_places(best: Evaluation) -> None:
    """Raise InputError if places lack coordinates, and no unknown changes any measured number."""
    partial = [
        (shape, sensor)
        for shape in best.experiment.shapes
        for sensor in shape.markers
        if None in sensor.value
    ]
    if not partial:
        return
    parameters = best.experiment.parameters
    tolerance = _UNDETERMINED * parameters.given.arm.length
    changes = [np.abs(J * parameters.range).max(initial=0.0) for J in best.jacobians.values()]
    if max(changes, default=0.0) < tolerance:
        shape, sensor = partial[0]
        names = ", ".join(unknown.name for unknown in parameters.unknowns)
        allowed = f"coordinates that depend on {names}; nothing that was measured does"
        raise InputError(f"{shape.name}: {sensor.what}", sensor.value, allowed)


def _tip_distance(one: Evaluation, other: Evaluation, i: int) -> float:
    """Return the distance between the tips of a shape in two evaluations, over the arm's length."""
    pair = [evaluation.equilibria.get(i) for evaluation in (one, other)]
    tips = [each.system.poses(each.states)[-1, 4:] for each in pair if each]
    length = one.experiment.parameters.given.arm.length
    return float(np.linalg.norm(tips[0] - tips[1])) / length if len(tips) == 2 else float("inf")


def _on_other_branch(one: Evaluation, other: Evaluation) -> list[int]:
    """Return the indices of the shapes that are on different branches in two evaluations."""
    either = sorted({*one.equilibria, *other.equilibria})
    return [i for i in either if not _tip_distance(one, other, i) <= _ASTRAY]
