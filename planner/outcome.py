"""Outcomes: the result of a plan, the limits that are active, and a remedy, as sentences."""

from __future__ import annotations

import math
from operator import attrgetter
from typing import Any

import numpy as np

from octoplan.model.shape import Shape
from octoplan.model.support.progress import OUT_OF_TIME
from octoplan.model.tendons import is_taut
from octoplan.planner.blocks import CRUSHED
from octoplan.planner.certificate import Certificate
from octoplan.planner.program_instance import RESOLVED, tension_scales
from octoplan.planner.solution import STABILITY_TOLERANCE
from octoplan.planner.targets.base import OVER_WANTED
from octoplan.planner.targets.target_set import TargetSet

# Functions of this file take a Plan; its class imports this file.


def outcome(plan: Any) -> str:
    """Return the outcome of a plan: verdict, warnings, and remarks."""
    solution, text = plan.solution, verdict(plan)
    if solution.jump:
        text = text.removesuffix(".") + "; left the branch of the plan before: "
        text += f"tensions jump by {100 * solution.jump:.0f} %."
    if solution.lost:
        text += f" An optimum {100 * solution.lost:.0f} % cheaper on the coarse mesh was lost on "
        text += "finer meshes; pass more starts."
    text += plan.remarks
    if not plan.scene.effects:
        text += " Statics: bending alone, as in Scene()."
    return f"Stopped at the time limit, the best so far. {text}" if solution.stopped else text


def remarks(plan: Any) -> str:
    """Return sentences about mirror images, targets and slack tendons, each after a space."""
    certificate, problem, solution = plan.certificate, plan.problem, plan.solution
    if certificate.problem:
        return ""
    text = ""
    if plan.placed.placement is not None:
        text += f" {plan.placed.placement.remark()}"
    if images := plan.mirror_images():
        planes = ", ".join(f"{math.degrees(angle):.3g} deg" for angle, _ in images)
        text = f" Its mirror image across the plane at {planes} from n costs the same."
    missed = not certificate.attained and not solution.stopped
    for target in problem.targets:
        remark = target.remark(plan.shape, problem.limits, missed, problem.accuracy)
        text += f" {remark}" if remark else ""
    return text + _remark_on_slack(problem.target_set, plan.shape)


def holding(plan: Any) -> list[str]:
    """Return the names of the limits that are active, by decreasing multiplier."""
    problem, solution = plan.problem, plan.solution
    if not solution.lam_x:
        return []
    arm, limits, allowed = problem.arm, problem.limits, problem.allowed
    T, lam = np.ravel(solution.tensions), np.array(solution.lam_x)
    near, lam = 1e-6 * tension_scales(arm, limits), lam[: T.size]
    upper, lower = np.array(limits.upper), np.array(limits.lower)
    at_most = (np.array(allowed.upper) == upper) & (upper - near <= T) & (lam > 1e-9)
    # A minimum of 0 is no limit: tendons cannot push.
    at_least = (lower > 0) & (lower + near >= T) & (lam < -1e-9)
    active = [
        (abs(lam[j]), f"{arm.tendon_name(j)} at its {name} of {bounds[j]:g} N")
        for name, bounds, holds in (("maximum", upper, at_most), ("minimum", lower, at_least))
        for j in np.flatnonzero(holds).tolist()
    ]
    active += plan.active_rows()
    total = limits.total
    if total is not None and T.sum() >= total * (1 - 1e-6):
        active.append((np.inf, f"the total pull at its maximum of {total:g} N"))
    return [name for _, name in sorted(active, key=lambda item: -item[0])]


def verdict(plan: Any) -> str:
    """Return whether the plan reaches its target, and the warnings of its certificate."""
    certificate = plan.certificate
    beware = "".join(f" Beware: {warning}." for warning in certificate.warnings)
    return f"{_verdict(plan, certificate)}.{beware}"


def _verdict(plan: Any, certificate: Certificate) -> str:
    solution, length = plan.solution, plan.problem.arm.length
    if certificate.problem:
        more = "; raise time_limit, or certify the plan" * (certificate.problem == OUT_OF_TIME)
        return f"Not certified: {certificate.problem}{more}"
    count = len(solution.starts)
    guesses = "initial guess" if count == 1 else "initial guesses"
    samples = f" and {solution.sampled} sampled shapes" if solution.sampled else ""
    equal = solution.n_equal_optima
    tried = f"{count} {guesses}{samples} tried, {equal} led to the best optimum"
    if certificate.passed:
        stable = f"stability {certificate.stability:.3g}, {certificate.bears}; "
        bears = stable if certificate.bears else ""
        cost = f"effort {plan.effort:.4g} N, {certificate.optimality}"
        return f"{_verb(plan)}{_success(plan)}; {cost}; {bears}{tried}"
    if certificate.strokes > certificate.tolerance:
        over = _size(certificate.strokes, length)
        return (
            f"Not reached: the nearest shape found exceeds the limits of strokes by {over}; widen "
            f"these limits ({tried})"
        )
    if (plan.mode != "exact" or solution.stopped) and not certificate.attained:
        missed = f"the nearest shape found misses {_gaps(plan)}"
        return f"Not reached: {missed}; {_reason(plan)} ({tried})"
    if certificate.too_near:
        passed = (certificate.clearances[name] for name in certificate.too_near)
        nearest = min(passed, key=attrgetter("gap"))
        return (
            f"Not clear: {nearest}; no shape around it was found; move the obstacle or lower the "
            f"clearance ({tried})"
        )
    least = certificate.stability_margin
    if 0 <= certificate.stability < least - STABILITY_TOLERANCE:
        return (
            f"Not stable enough: stability {certificate.stability:.3g}, below the margin of "
            f"{least:g}; lower stability_margin ({tried})"
        )
    failures = "; ".join(certificate.failures)
    remedy = "raise time_limit" if solution.stopped else "pass a finer accuracy"
    return f"Not certified: {failures}; {remedy} ({tried})"


def _verb(plan: Any) -> str:
    """Return the verb of success that all targets share, otherwise "Reached"."""
    verbs = {target.success for target in plan.targets}
    return verbs.pop() if len(verbs) == 1 else "Reached"


def _success(plan: Any) -> str:
    certificate = plan.certificate
    soft, tolerance = certificate.soft_residual, certificate.tolerance
    met = max([certificate.residual, *soft.values()])
    if met <= tolerance:
        return f": every target met to {met:.1e} (accuracy {tolerance:.0e})"
    length = plan.problem.arm.length
    gaps = ", ".join(f"{name} {_size(value, length)}" for name, value in soft.items())
    return f" as near as possible: {gaps} ({_reason(plan)})"


def _gaps(plan: Any) -> str:
    """Return the residuals of missed equalities and violated inequalities."""
    certificate, length = plan.certificate, plan.problem.arm.length
    gaps = []
    for name, value in certificate.equality.items():
        if value > certificate.tolerance:
            size = f"the {name} by {_size(value, length, certificate.units.get(name, ''))}"
            texts = (target.describe_miss(name, plan.shape) for target in plan.targets)
            gaps.append(next(filter(None, texts), size))
    for name, value in certificate.inequality.items():
        if value < -certificate.tolerance:
            size = f"the {name} by {-value:.3g}"
            if name.endswith(OVER_WANTED):
                required = f"{1 + value:.4g} times the required value"
                size = f"the {name.removesuffix(OVER_WANTED)} ({required})"
            texts = (target.describe_miss(name, plan.shape) for target in plan.targets)
            gaps.append(next(filter(None, texts), size))
    return ", ".join(gaps)


def _size(value: float, length: float, unit: str = "L") -> str:
    """Return a residual in mm if it is a length over the arm's, in degrees if it is an angle."""
    if unit == "L":
        return f"{1e3 * value * length:.3g} mm"
    return f"{math.degrees(value):.3g} deg" if unit == "rad" else f"{value:.3g}"


def _reason(plan: Any) -> str:
    """Return the first reason that keeps a plan from its targets, and a remedy."""
    certificate, solution = plan.certificate, plan.solution
    least, holders = certificate.stability_margin, ", ".join(plan.holding()[:3])
    how_unstable = (
        f"less stable than the margin of {least:g}" if least else "unstable under the loads"
    )
    violated = -min(certificate.inequality.values(), default=0.0)
    missed = max(certificate.residual, violated, *certificate.soft_residual.values())
    reasons = (
        (
            solution.stopped,
            "the search was not finished; raise time_limit",
        ),
        (
            missed <= RESOLVED,
            f"misses below {RESOLVED:.0e} of the length are not resolved; relax the accuracy",
        ),
        (
            solution.in_the_way,
            f"the plan without obstacles reaches the target, but {solution.in_the_way}; move the "
            "obstacle",
        ),
        (
            solution.unstable,
            f"every shape found that meets the target is {how_unstable}; lower the loads",
        ),
        (holders == CRUSHED, f"held by {CRUSHED}; move the target"),
        (holders.startswith("stability"), f"held by {holders}; lower stability_margin"),
        (holders, f"held by {holders}; widen these limits"),
    )
    no_limit = "no limit is active; move the target"
    return next((text for is_so, text in reasons if is_so), no_limit)


def _remark_on_slack(targets: TargetSet, shape: Shape) -> str:
    """Return a sentence about the tip's stiffness with slack tendons released, after a space.

    Empty without targets of stiffness at held lengths, and if no tendon is slack.
    """
    arm = targets.arm
    slack = [arm.tendon_name(int(j)) for j in np.flatnonzero(~is_taut(arm, shape.tensions))]
    if not slack or all(request.hold == "tension" for request in targets.requests):
        return ""
    asking = [target for target in targets.each if target.compliance_request()]
    both = [targets.compliances(shape, release) for release in (False, True)]
    sentences = []
    for target, request, *compliances in zip(asking, targets.requests, *both, strict=True):
        if request.hold == "length":
            locked, released = (1 / np.linalg.eigvalsh(C).max() for C in compliances)
            sentences.append(
                f"{locked:.4g} {target.stiffness_unit} locked, {released:.4g} released"
            )
    return (
        " With lengths held all tendons are counted as locked, also those without tension, "
        f"{', '.join(slack)}: the tip's stiffness is {'; '.join(sentences)}, as stiffness() has it "
        "by default."
    )
