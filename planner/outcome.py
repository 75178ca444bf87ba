"""The outcome of a plan as a sentence: what happened, what holds it, what to try."""

from __future__ import annotations

import math
from typing import Any

from planner.certificate import STABILITY_TOLERANCE
from planner.targets.base import OVER_WANTED


def sentence(plan: Any) -> str:
    """Return the outcome of a plan (see Answer) as a sentence, with its certificate's warnings."""
    beware = "".join(f" Beware: {warning}." for warning in plan.certificate.warnings)
    return f"{_happened(plan)}.{beware}"


def _happened(plan: Any) -> str:
    certificate, count = plan.certificate, len(plan.starts)
    if certificate.problem:
        return f"Not certified: {certificate.problem}"
    guesses = "initial guesses" if count > 1 else "initial guess"
    tried = f"{count} {guesses} tried, {plan.agreed} led to the best optimum"
    if certificate.passed:
        bears = f"stability {certificate.stability:.3g}, {certificate.bears}; "
        cost = f"effort {plan.effort:.4g} N; {bears if certificate.bears else ''}"
        return f"Reached{_success(plan)}; {cost}{tried}"
    if certificate.strokes > certificate.tolerance:
        over = _size(plan, certificate.strokes)
        return (
            "Not reached: no shape within the limits of strokes is found; the nearest one found "
            f"passes them by {over}; {tried}"
        )
    if plan.mode != "exact" and not certificate.attained:
        nearest = "attainable shape" if _is_nearest(plan) else "shape found"
        return f"Not reached: the nearest {nearest} is off in {_gaps(plan)}; {_held(plan)}; {tried}"
    if certificate.too_near:
        return (
            f"Not clear: {certificate.nearest}; no way around it was found: move it or the target, "
            f"raise the limits or ask for less clearance ({tried})"
        )
    least = certificate.stability_margin
    if 0 <= certificate.stability < least - STABILITY_TOLERANCE:
        return (
            f"Not stable enough: stability {certificate.stability:.3g}, asked {least:g}; "
            f"raise the limits or ask for a lower margin ({tried})"
        )
    failures = "; ".join(certificate.failures)
    return f"Not certified: {failures}; ask for a finer accuracy or more starts ({tried})"


def _is_nearest(plan: Any) -> bool:
    """Return whether what misses the targets is an optimum of how near it comes, and no worse one.

    At least two initial guesses have to lead to it. Searches in contact do not tell, nor those that
    were stopped, or met the targets by unstable shapes.
    """
    is_told = plan.certificate.complementarity is None and not plan.stopped and not plan.unstable
    return bool(is_told and plan.agreed > 1)


def _success(plan: Any) -> str:
    certificate = plan.certificate
    soft, tolerance = certificate.soft_residual, certificate.tolerance
    met = max([certificate.residual, *soft.values()])
    if met <= tolerance:
        return f": every target met to {met:.1e} (asked {tolerance:.0e})"
    gaps = ", ".join(f"{name} {_size(plan, value)}" for name, value in soft.items())
    return f", as near as the limits allow: {gaps} ({_held(plan)})"


def _gaps(plan: Any) -> str:
    """Return by how much equalities are missed and inequalities violated."""
    of = plan.certificate
    gaps = [
        f"{name} by {_size(plan, value, of.units.get(name, ''))}"
        for name, value in of.equality.items()
        if value > of.tolerance
    ]
    for name, value in of.inequality.items():
        if value < -of.tolerance:
            most = f"at most {1 + value:.4g} times what is wanted can be had, "
            ratio = most if name.endswith(OVER_WANTED) else ""
            gaps.append(f"{name.removesuffix(OVER_WANTED)} ({ratio}short by {-value:.3g})")
    return ", ".join(gaps)


def _size(plan: Any, value: float, unit: str = "L") -> str:
    """Return a residual in mm where it is a length, in degrees where it is an angle."""
    if unit == "L":
        return f"{1e3 * value * plan.arm.length:.3g} mm"
    return f"{math.degrees(value):.3g} deg" if unit == "rad" else f"{value:.3g}"


def _held(plan: Any) -> str:
    """Return what keeps a plan from its targets and what may be done: the first reason there is."""
    least, holders = plan.certificate.stability_margin, ", ".join(plan.holding()[:3])
    how_unstable = (
        f"less stable than the margin of {least:g}" if least else "unstable under the loads"
    )
    reasons = (
        (plan.stopped, "the search was not at its end, a longer time limit may bring it nearer"),
        (
            plan.in_the_way,
            f"obstacles are in the way: without them it is met, and {plan.in_the_way}; move them "
            "or the target, or ask for less clearance",
        ),
        (
            plan.unstable,
            f"what meets it is {how_unstable}; stiffen the arm, lower the loads or move the target",
        ),
        (holders, f"held by {holders}; raise these limits or move the target"),
        (not _is_nearest(plan), "no limit is active, more starts may find a nearer one"),
    )
    unreachable = (
        "no limit is active and no initial guess leads nearer: the target is likely out of "
        "reach of these tendons; move it, or try more starts"
    )
    return next((told for is_so, told in reasons if is_so), unreachable)
