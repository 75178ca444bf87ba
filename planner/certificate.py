"""Certificates: check a plan by another integrator than the integrator that found it."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

import numpy as np

from octoplan.model.centreline import Centreline
from octoplan.model.equilibrium.collocation_map import CollocationMap
from octoplan.model.equilibrium.continuation import LEAST_STEP, BranchEnd, continue_branches
from octoplan.model.equilibrium.integration import SCHEME
from octoplan.model.equilibrium.modes import stability
from octoplan.model.equilibrium.newton import STAGES
from octoplan.model.equilibrium.verification import verify
from octoplan.model.forward import collocation_map
from octoplan.model.loads import has_complementarity, is_coupled
from octoplan.model.paths import Array
from octoplan.model.rod.discrete_rod import system
from octoplan.model.shape import Shape, sharp, stretched
from octoplan.model.support.errors import OctoplanError
from octoplan.model.support.progress import OUT_OF_TIME, OutOfTime, report
from octoplan.model.support.text import HtmlRepr, to_text
from octoplan.model.tendons import strokes
from octoplan.planner.entry_points import CERTIFICATE_CHECKS, load
from octoplan.planner.limits import TendonLimits
from octoplan.planner.planning_problem import PlanningProblem
from octoplan.planner.solution import KKT_TOLERANCE, STABILITY_TOLERANCE

# Stability [-], and fraction of additional loads at which the arm yields, below which an arm is on
# the brink.
BRINK = 0.1
# Name of the check that the extension for contact adds.
COMPLEMENTARITY = "complementarity missed by"
# Largest load factor of the continuation of the loads [-].
MOST_LOADS = 3.0


@dataclass(frozen=True)
class Check:
    """A quantity that an extension verifies.

    Attributes
    ----------
    value : float
    allowed : float
        Largest value that passes.
    """

    value: float
    allowed: float


@dataclass(frozen=True)
class Optimality:
    """The first-order conditions of a plan.

    Attributes
    ----------
    residual : float
        Residual of the conditions, scaled.
    saving : float or None
        Effort that the best descent direction saves, to first order [N]; None if not computed.
    """

    residual: float
    saving: float | None = None


@dataclass(frozen=True)
class Certificate(HtmlRepr):
    """The results of the check of a plan. Lengths are divided by the arm's, angles are in rad.

    Attributes
    ----------
    equality : norm of the residual of each equality of the targets
    soft_residual : norm of each residual that is minimised within the limits
    inequality : smallest value of each quantity that has to be at least 0
    bounds : largest violation of a tension limit [N]
    strokes : largest violation of a stroke limit
    kkt : residual of the first-order conditions, scaled, with the multipliers of the plan
    saving : effort that the best descent direction saves, to first order [N]; None if not computed
    agreement : distance between the settled tip and the tip of the check
    error : estimated tip error of the check
    stability : smallest eigenvalue of the scaled Hessian of the energy; below 0 the arm is unstable
    stability_margin : smallest accepted stability
    scheme : integrator of the check
    tolerance : tolerance of equality, inequality and agreement
    problem : error that prevented the check; empty otherwise
    gaps_asked : distance of the arm's surface from each kind of body with a required clearance [m]
    least_gaps : required clearances [m]
    clearances : clearance of the arm from each kind of body, by name; see
        octoplan.model.extensions.clearance
    load_factor : multiple of the loads at which the arm yields at constant tensions; infinite above
        MOST_LOADS, None without loads, in contact, and if the time limit was reached
    units : units by name: "L" for lengths over the arm's, "rad" for angles
    checks : further quantities that extensions verify, by name
    bends : description of the place where the radius of curvature is below the arm's radius
    stretches : description of the place where the stretch is beyond the law of the body
    """

    equality: Mapping[str, float] = field(default_factory=dict)
    soft_residual: Mapping[str, float] = field(default_factory=dict)
    inequality: Mapping[str, float] = field(default_factory=dict)
    bounds: float = np.inf
    kkt: float = field(default=np.inf, compare=False)
    saving: float | None = field(default=None, compare=False, kw_only=True)
    agreement: float = np.inf
    error: float = np.inf
    stability: float = np.inf
    stability_margin: float = 0.0
    scheme: str = ""
    tolerance: float = 1e-6
    problem: str = ""
    gaps_asked: Mapping[str, float] = field(default_factory=dict)
    least_gaps: Mapping[str, float] = field(default_factory=dict)
    clearances: Mapping[str, Any] = field(default_factory=dict, compare=False)
    load_factor: float | None = field(default=None, compare=False)
    units: Mapping[str, str] = field(default_factory=dict)
    strokes: float = 0.0
    checks: Mapping[str, Check] = field(default_factory=dict)
    bends: str = ""
    stretches: str = ""

    @property
    def gaps(self) -> Mapping[str, float]:
        """The distance of the arm's surface from each kind of body [m]."""
        return {name: clearance.gap for name, clearance in self.clearances.items()}

    @property
    def nearest(self) -> str:
        """A description of the nearest body."""
        return str(min(self.clearances.values(), key=lambda clear: clear.gap, default=""))

    @property
    def clearance(self) -> float:
        """The distance of the arm's surface from obstacles, itself and behind its base [m].

        A lower bound; below 0 for penetration, infinite without any body.
        """
        return min(self.gaps.values(), default=np.inf)

    @property
    def too_near(self) -> Mapping[str, float]:
        """Required clearance minus clearance of the bodies that are too near, by name [m]."""
        missing = {name: least - self.gaps_asked[name] for name, least in self.least_gaps.items()}
        return {name: distance for name, distance in missing.items() if distance > 0}

    @property
    def complementarity(self) -> float | None:
        """The largest violation of gap >= 0 [m], force >= 0 [N] and gap times force = 0 [N m].

        None without contact.
        """
        check = self.checks.get(COMPLEMENTARITY)
        return None if check is None else check.value

    @property
    def warnings(self) -> tuple[str, ...]:
        """Sentences about results that are doubtful although nothing forbids them."""
        sentences = [
            f"the arm passes through {name} by {-1e3 * gap:.3g} mm"
            for name, gap in self.gaps.items()
            if gap < 0 and name not in self.least_gaps
        ]
        sentences += [each for each in (self.bends, self.stretches) if each]
        soon = (self.load_factor or np.inf) < 1 + BRINK
        if self.stability >= 0 and (soon or (self.stability < BRINK and not self.stability_margin)):
            reasons = [f"its stability is {self.stability:.2g}"] * (not soon)
            reasons += [f"it {self.bears}"] * bool(self.bears)
            sentences.append(f"it stands on the brink: {', though '.join(reasons)}")
        return tuple(sentences)

    @property
    def residual(self) -> float:
        """The largest residual of the equalities."""
        return max(self.equality.values(), default=0.0)

    @property
    def attained(self) -> bool:
        """Whether the equalities and the inequalities of the targets are met."""
        missed = max(self.residual, -min(self.inequality.values(), default=0.0))
        return not self.problem and missed <= self.tolerance

    @property
    def optimal(self) -> bool:
        """Whether the first-order conditions of a least effort are verified."""
        return self.kkt <= KKT_TOLERANCE

    @property
    def optimality(self) -> str:
        """A description of the first-order conditions."""
        if self.optimal:
            return "locally optimal"
        if not np.isfinite(self.kkt):
            return "not proven optimal (optimality residual unknown)"
        if not self.saving:
            return f"not proven optimal (optimality residual {self.kkt:.1e})"
        return f"not proven optimal (a descent direction saves {self.saving:.2g} N)"

    @property
    def failures(self) -> tuple[str, ...]:
        """Sentences about the checks that failed.

        A plan that meets its targets within the limits need not be optimal. The nearest plan to a
        target is defined by its optimality, which is then one of the checks.
        """
        if self.problem:
            return (self.problem,)
        as_near = max(self.soft_residual.values(), default=0.0) > self.tolerance
        least = self.stability_margin
        below = f"stability below its margin of {least:g} by"
        unstable = below if self.stability >= 0 else "the arm does not stand; stability below 0 by"
        checks = [
            (self.residual, self.tolerance, "target residual [L, rad]"),
            (-min(self.inequality.values(), default=0.0), self.tolerance, "inequality below 0 by"),
            (self.bounds, 0.0, "tension limit violated by [N]"),
            (self.strokes, self.tolerance, "stroke limit violated by [L]"),
            *((self.kkt, KKT_TOLERANCE, "optimality residual") for _ in range(as_near)),
            (self.agreement, self.tolerance, "integrators differ by"),
            (least - self.stability, STABILITY_TOLERANCE if least > 0 else 0.0, unstable),
            *((check.value, check.allowed, name) for name, check in self.checks.items()),
            *((1e3 * gap, 0.0, f"too near {name} by [mm]") for name, gap in self.too_near.items()),
        ]
        failed = [check for check in checks if not check[0] <= check[1]]
        return tuple(f"{name} {value:.2g}, allowed {limit:.2g}" for value, limit, name in failed)

    @property
    def bears(self) -> str:
        """A description of the load factor; empty without loads."""
        if self.load_factor is None:
            return ""
        if np.isinf(self.load_factor):
            return f"bears at least {MOST_LOADS:g} times its loads"
        return f"yields at {self.load_factor:.2f} times its loads"

    @property
    def passed(self) -> bool:
        """Whether targets, limits and stability are verified to the tolerances; see `optimal`."""
        return not self.failures

    @property
    def rows(self) -> list[list[str]]:
        """A table of the checks: name with unit, value, allowed values; first the head."""
        most, least = f"at most {self.tolerance:.0e}", "as small as the limits allow"
        measured = ((self.equality, most), (self.soft_residual, least))
        load_factor = None if self.load_factor is None else min(self.load_factor, MOST_LOADS)
        rows: list[tuple[str, float | None, str]] = [
            *(
                (f"{name} [{self.units.get(name, '-')}]", value, allowed)
                for values, allowed in (*measured, (self.inequality, "at least 0"))
                for name, value in values.items()
            ),
            ("limits violated by [N]", self.bounds, "at most 0"),
            ("optimality residual [-]", self.kkt, f"at most {KKT_TOLERANCE:.0e} if optimal"),
            ("effort that descent saves [N]", self.saving, ""),
            ("integrators differ by [L]", self.agreement, most),
            ("estimated tip error [L]", self.error, ""),
            ("stability [-]", self.stability, f"at least {self.stability_margin:g}; 1 at rest"),
            ("load factor [-]", load_factor, self.bears),
            *((name, check.value, "") for name, check in self.checks.items()),
            ("clearance [mm]", 1e3 * self.clearance, self.nearest or "can meet nothing"),
        ]
        known = ([name, _digits(x), allowed] for name, x, allowed in rows if x is not None)
        return [["checked", "value", "allowed"], *known]

    def __str__(self) -> str:
        return to_text(self)


def _digits(value: float) -> str:
    """Return a number with three digits, with an exponent if the number is small or large."""
    return f"{value:.3g}" if value == 0 or 1e-2 <= abs(value) < 1e5 else f"{value:.2e}"


def certify(
    problem: PlanningProblem,
    tensions: Array,
    settled: Callable[[], Shape],
    optimality: Callable[[], Optimality],
) -> Certificate:
    """Verify tensions by initial value integration; evaluate targets, limits and optimality.

    Parameters
    ----------
    problem : PlanningProblem
    tensions : (n_tendons,)
        [N].
    settled : function
        Returns the shape, more accurate than the problem asks for.
    optimality : function
        Returns the first-order conditions at this shape.

    The certificate reports errors, and the end of the time limit, as its `problem`.
    """
    begun = Certificate(
        bounds=tension_excess(tensions, problem.limits),
        scheme=SCHEME.name,
        tolerance=problem.accuracy,
    )
    try:
        return _checked(begun, problem, settled(), optimality)
    except OutOfTime:
        return replace(begun, problem=OUT_OF_TIME)
    except OctoplanError as reason:
        return replace(begun, problem=str(reason))


def _checked(
    begun: Certificate,
    problem: PlanningProblem,
    shape: Shape,
    optimality: Callable[[], Optimality],
) -> Certificate:
    """Return a certificate with the checks of a shape; raises the errors of the integration."""
    arm, targets, limits = problem.arm, problem.target_set, problem.limits
    report("verifying by initial value integration")
    poses, tip, error, least, line = _integrated(
        shape, targets.stations, problem.reference_accuracy
    )
    equality, soft_residual, inequality, _ = targets.values(poses, targets.compliances(shape))
    for target in problem.targets:
        for name, bound in target.least_along(line, problem.accuracy).items():
            inequality[name] = np.append(inequality[name], bound)
        for name, residual in target.equilibrium_residuals(shape).items():
            equality[name] = np.append(equality.get(name, np.zeros(0)), residual)
    over = 0.0
    if limits.strokes is not None:
        (low, high), taken = limits.strokes, strokes(shape, limits.stroke_zero)
        over = float(np.max([low - taken, taken - high], initial=0.0)) / arm.length
    fields = _extension_fields(problem, shape, line)
    report("verifying optimality")
    # Optimality is reported beside the verdict, which does not wait for it.
    conditions = Optimality(np.inf)
    with suppress(OutOfTime):
        conditions = optimality()
    checked = replace(
        begun,
        equality={name: float(np.linalg.norm(values)) for name, values in equality.items()},
        soft_residual={
            name: float(np.linalg.norm(values)) for name, values in soft_residual.items()
        },
        inequality={name: float(np.min(values)) for name, values in inequality.items()},
        kkt=conditions.residual,
        saving=conditions.saving,
        agreement=math.dist(tip, shape.tip) / arm.length,
        error=error,
        stability=least,
        stability_margin=problem.options.margin,
        units=targets.terms.units,
        strokes=over,
        bends=sharp(shape),
        stretches=stretched(shape),
        **fields,
    )
    # The load factor is no part of the verdict.
    with suppress(OutOfTime):
        return replace(checked, load_factor=_load_factor(shape))
    return checked


def _extension_fields(
    problem: PlanningProblem, shape: Shape, line: Callable[[], Centreline]
) -> dict[str, Any]:
    """Return the fields of a certificate that extensions compute: clearances, further checks."""
    named = sorted({effect.plan_strategy for effect in problem.scene.effects} | {""})
    fields: dict[str, Any] = {}
    for name in named:
        if name in CERTIFICATE_CHECKS:
            fields |= load(CERTIFICATE_CHECKS[name])(problem, shape, line)
    if problem.placement is not None:
        fields["checks"] = {**fields.get("checks", {}), **problem.placement.checks()}
    return fields


def tension_excess(tensions: Array, limits: TendonLimits) -> float:
    """Return the largest violation of a limit of tensions [N]."""
    total = np.inf if limits.total is None else limits.total * (1 + 1e-9)
    beyond = limits.lower - tensions, tensions - limits.upper, [tensions.sum() - total, 0.0]
    return float(np.concatenate(beyond).max())


def _integrated(
    shape: Shape, stations: tuple[float, ...], accuracy: float
) -> tuple[Array, Array, float, float, Callable[[], Centreline]]:
    """Integrate a shape as an initial value problem.

    The check starts on a mesh half as fine as the shape's and corrects the defects of the node
    wrenches to first order. If the tip pose then differs by more than ten accuracies, the check
    starts again on the shape's mesh.

    Returns
    -------
    poses : (K, 7)
        At the stations.
    tip : (3,)
        [m].
    error : float
        Estimated error of the tip, over the arm's length.
    stability : float
    line : function
        Returns the midline.
    """
    arm, scene, touching = shape.arm, shape.scene, has_complementarity(shape.scene)
    coarser = min(shape.refinement, max(2, shape.refinement // 2))
    meshes = {shape.refinement} if touching else {coarser, shape.refinement}
    scale = np.repeat([1.0, arm.length], [4, 3])
    for mesh in sorted(meshes):
        forward = collocation_map(arm, scene, mesh, stations, shape.machine_code)
        equilibrium = forward.solve(shape.tensions, shape.collocated)
        check, error = verify(equilibrium, accuracy)
        system, poses = check.system, check.poses
        gap = np.abs(poses[-1] - shape.poses(arm.length)) / scale
        if gap.max() <= 10 * accuracy:
            break
    places = [system.mesh.node(s) for s in stations]
    line = partial(Centreline.at_states, system, check.states)
    # The integrated states do not contain the set of closed contacts.
    least = stability(equilibrium if touching else check)
    return poses[places], poses[-1, 4:], error, least, line


def _load_factor(shape: Shape) -> float | None:
    """Return the multiple of the loads at which the arm yields; infinite above MOST_LOADS.

    None without loads, and in contact.
    """
    if not is_coupled(shape.arm, shape.scene) or has_complementarity(shape.scene):
        return None
    mesh = STAGES, 1, (), True, shape.machine_code
    coarsest = CollocationMap(system(shape.arm, shape.scene, *mesh))
    begin = BranchEnd(coarsest.solve(shape.tensions, shape.collocated), 1 / MOST_LOADS)
    lines = np.append(shape.tensions, 0.0)[None], np.append(shape.tensions, MOST_LOADS)[None]
    (end,) = continue_branches([begin], lines, LEAST_STEP, first_step=1 / MOST_LOADS)
    return MOST_LOADS * end.fraction if end.why else np.inf
