"""The outcome of a plan as a sentence: what happened, what holds it, what to try."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from planner.plan import Plan


def sentence(plan: Plan) -> str:
    """Return what happened to a plan in words."""
    certificate = plan.certificate
    if certificate.problem:
        return f"Not certified: {certificate.problem}."
    count = len(plan.starts)
    tried = f"{count} start{'s' * (count > 1)} tried, {plan.agreed} at the best optimum"
    if certificate.passed:
        return f"{_success(plan)}; effort {plan.effort:.4g} N; {tried}."
    if plan.mode == "nearest" and not certificate.attained:
        gaps = _gaps(plan)
        return f"Not reached: the nearest attainable shape is {gaps}; {_holders(plan)}; {tried}."
    failures = "; ".join(certificate.failures)
    return f"Not certified: {failures}; try a finer accuracy or more starts ({tried})."


def _success(plan: Plan) -> str:
    certificate = plan.certificate
    met = max([certificate.residual, *(v for v in certificate.approach.values())])
    if met <= certificate.tolerance:
        return f"Reached: every target met to {met:.1e} (asked {certificate.tolerance:.0e})"
    gaps = [f"{name} {_length(plan, value)}" for name, value in certificate.approach.items()]
    return f"Reached, as near as the limits allow: {', '.join(gaps)} ({_holders(plan)})"


def _gaps(plan: Plan) -> str:
    certificate = plan.certificate
    off = [item for item in certificate.match.items() if item[1] > certificate.tolerance]
    lacks = [item for item in certificate.margin.items() if item[1] < -certificate.tolerance]
    gaps = [f"{name} by {_amount(plan, name, value)}" for name, value in off]
    gaps += [f"{name} (short by {-value:.3g})" for name, value in lacks]
    return "off in " + ", ".join(gaps)


def _amount(plan: Plan, name: str, value: float) -> str:
    """Return a residual in mm where it is a length, in degrees where it is an angle."""
    is_length = any(word in name for word in ("position", "distance"))
    return _length(plan, value) if is_length else f"{math.degrees(value):.3g} deg"


def _length(plan: Plan, value: float) -> str:
    return f"{1e3 * value * plan.arm.length:.3g} mm"


def _holders(plan: Plan) -> str:
    holders = plan.holding()
    if not holders:
        return "no maximum holds it: it lies beyond what any tensions of these tendons give"
    return f"held by {', '.join(holders[:3])}; raise these limits or move the target"
