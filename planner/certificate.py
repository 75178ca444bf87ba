"""Certificates: the results of the check of a plan, and the verdict."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from octoplan.model.support.text import HtmlRepr, to_text
from octoplan.planner.nlp_solution import KKT_TOLERANCE, STABILITY_TOLERANCE

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
