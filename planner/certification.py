"""Certification: check a plan by another integrator than the integrator that found it."""

from __future__ import annotations

import math
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
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
from octoplan.model.loads import has_complementarity, is_loaded
from octoplan.model.paths import Array
from octoplan.model.rod.discrete_rod import system
from octoplan.model.shape import Shape, sharp, stretched
from octoplan.model.support.errors import OctoplanError
from octoplan.model.support.progress import OUT_OF_TIME, OutOfTime, report
from octoplan.model.tendons import strokes
from octoplan.planner.certificate import MOST_LOADS, Certificate, Optimality
from octoplan.planner.entry_points import CERTIFICATE_CHECKS, load
from octoplan.planner.limits import TendonLimits
from octoplan.planner.planning_problem import PlanningProblem


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
    if not is_loaded(shape.arm, shape.scene) or has_complementarity(shape.scene):
        return None
    mesh = STAGES, 1, (), True, shape.machine_code
    coarsest = CollocationMap(system(shape.arm, shape.scene, *mesh))
    begin = BranchEnd(coarsest.solve(shape.tensions, shape.collocated), 1 / MOST_LOADS)
    lines = np.append(shape.tensions, 0.0)[None], np.append(shape.tensions, MOST_LOADS)[None]
    (end,) = continue_branches([begin], lines, LEAST_STEP, first_step=1 / MOST_LOADS)
    return MOST_LOADS * end.fraction if end.why else np.inf
