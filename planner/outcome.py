"""The outcome of a plan as a sentence: what happened, what holds it, what to try."""

from __future__ import annotations

import math
from dataclasses import dataclass

from planner.certificate import Certificate
from planner.program.statement import Mode
from planner.targets.base import OVER_WANTED


@dataclass(frozen=True)
class Facts:
    """What a sentence about a plan is made of.

    Attributes
    ----------
    certificate, mode
        The plan's.
    effort : float
        [N].
    tried, agreed : int
        Starts, and how many of them ended at the best optimum.
    holders : tuple of str
        The limits that hold the tensions back, hardest first.
    length : float
        Of the arm [m].
    stopped : bool
        Whether the time limit ended the search.
    in_the_way : str
        What the plan without obstacles comes nearest to, where only obstacles hold it back.
    unstable : bool
        Whether only shapes below the stability margin meet the targets.
    """

    certificate: Certificate
    mode: Mode
    effort: float
    tried: int
    agreed: int
    holders: tuple[str, ...]
    length: float
    stopped: bool = False
    in_the_way: str = ""
    unstable: bool = False

    @property
    def is_nearest(self) -> bool:
        """Whether what misses the targets is an optimum of how near it comes, and no worse one.

        At least two initial guesses have to lead to it. Searches in contact do not tell, nor those
        that were stopped, or met the targets by unstable shapes.
        """
        looked_for = not self.stopped and self.certificate.complementarity is None
        return looked_for and not self.unstable and self.agreed > 1


def sentence(facts: Facts) -> str:
    """Return the outcome of a plan as a sentence, with the warnings of its certificate."""
    beware = "".join(f" Beware: {warning}." for warning in facts.certificate.warnings)
    return _happened(facts) + beware


def _happened(facts: Facts) -> str:
    certificate = facts.certificate
    if certificate.problem:
        return f"Not certified: {certificate.problem}."
    plural = "es" * (facts.tried > 1)
    tried = f"{facts.tried} initial guess{plural} tried, {facts.agreed} led to the best optimum"
    if certificate.passed:
        parts = [_success(facts), f"effort {facts.effort:.4g} N", *_bears(certificate), tried]
        return f"{'; '.join(parts)}."
    if certificate.strokes > certificate.tolerance:
        nearest_one = f"the nearest one found passes them by {_length(facts, certificate.strokes)}"
        return (
            f"Not reached: no shape within the limits of strokes is found; {nearest_one}; {tried}."
        )
    if facts.mode != "exact" and not certificate.attained:
        gaps = _gaps(facts)
        nearest = "attainable shape" if facts.is_nearest else "shape found"
        return f"Not reached: the nearest {nearest} is {gaps}; {_holders(facts)}; {tried}."
    if certificate.too_near:
        advice = "move it or the target, raise the limits or ask for less clearance"
        return f"Not clear: {certificate.nearest}; no way around it was found: {advice} ({tried})."
    if certificate.lacks_stability:
        stability = f"stability {certificate.stability:.3g}, asked {certificate.stability_margin:g}"
        return (
            f"Not stable enough: {stability}; raise the limits or ask for a lower margin ({tried})."
        )
    failures = "; ".join(certificate.failures)
    return f"Not certified: {failures}; ask for a finer accuracy or more starts ({tried})."


def _bears(certificate: Certificate) -> list[str]:
    """Return how well an arm stands under its loads, if it has any."""
    if not certificate.bears:
        return []
    return [f"stability {certificate.stability:.3g}, {certificate.bears}"]


def _success(facts: Facts) -> str:
    certificate = facts.certificate
    met = max([certificate.residual, *certificate.soft_residual.values()])
    if met <= certificate.tolerance:
        return f"Reached: every target met to {met:.1e} (asked {certificate.tolerance:.0e})"
    gaps = [f"{name} {_length(facts, value)}" for name, value in certificate.soft_residual.items()]
    return f"Reached, as near as the limits allow: {', '.join(gaps)} ({_holders(facts)})"


def _gaps(facts: Facts) -> str:
    certificate = facts.certificate
    missed = [item for item in certificate.equality.items() if item[1] > certificate.tolerance]
    short = [item for item in certificate.inequality.items() if item[1] < -certificate.tolerance]
    gaps = [
        f"{name} by {_amount(facts, certificate.units.get(name, ''), value)}"
        for name, value in missed
    ]
    gaps += [_lack(name, value) for name, value in short]
    return "off in " + ", ".join(gaps)


def _lack(name: str, value: float) -> str:
    """Return by how much an inequality is violated; of a ratio to what is wanted, its maximum."""
    if not name.endswith(OVER_WANTED):
        return f"{name} (short by {-value:.3g})"
    most = f"at most {1 + value:.4g} times what is wanted can be had"
    return f"{name.removesuffix(OVER_WANTED)} ({most}, short by {-value:.3g})"


def _amount(facts: Facts, unit: str, value: float) -> str:
    """Return a residual in mm where it is a length, in degrees where it is an angle."""
    if unit == "L":
        return _length(facts, value)
    return f"{math.degrees(value):.3g} deg" if unit == "rad" else f"{value:.3g}"


def _length(facts: Facts, value: float) -> str:
    return f"{1e3 * value * facts.length:.3g} mm"


def _holders(facts: Facts) -> str:
    if facts.stopped:
        return "the search was not at its end, a longer time limit may bring it nearer"
    if facts.in_the_way:
        reason = f"obstacles are in the way: without them it is met, and {facts.in_the_way}"
        return f"{reason}; move them or the target, or ask for less clearance"
    if facts.unstable:
        least = facts.certificate.stability_margin
        reason = (
            f"less stable than the margin of {least:g}" if least else "unstable under the loads"
        )
        return f"what meets it is {reason}; stiffen the arm, lower the loads or move the target"
    if not facts.holders and not facts.is_nearest:
        return "no limit is active, more starts may find a nearer one"
    if not facts.holders:
        return (
            "no limit is active and no initial guess leads nearer: the target is likely out of "
            "reach of these tendons; move it, or try more starts"
        )
    return f"held by {', '.join(facts.holders[:3])}; raise these limits or move the target"
