"""The certificate: the results of a plan's check, and the verdict."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from model.clearance import Clearance
from model.text import columns, in_notebook
from planner.avoidance.surroundings import nearest_in_words

Clearances = Mapping[str, Clearance]


class OnRequest:
    """Clearances by name, and the load factor at which an arm yields; each is computed once.

    Two are equal if what they tell is. They pickle as what they tell.
    """

    def __init__(
        self,
        clearances: Callable[[], Clearances] = dict,
        load_factor: Callable[[], float | None] = lambda: None,
    ) -> None:
        self._find_clearances, self._find_load_factor = clearances, load_factor

    @cached_property
    def clearances(self) -> Clearances:
        """How clear the arm is of what it can meet, by name; see model.clearance."""
        return self._find_clearances()

    @cached_property
    def load_factor(self) -> float | None:
        """Times its loads at which it yields; see Certificate."""
        return self._find_load_factor()

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, OnRequest):
            return NotImplemented
        mine, theirs = ((request.clearances, request.load_factor) for request in (self, other))
        return mine == theirs

    __hash__ = None  # type: ignore[assignment]

    def __reduce__(self) -> tuple[Callable[..., OnRequest], tuple[Clearances, float | None]]:
        return _restored, (self.clearances, self.load_factor)


def _restored(clearances: Clearances, load_factor: float | None) -> OnRequest:
    return OnRequest(lambda: clearances, lambda: load_factor)


KKT_TOLERANCE = 1e-6
# Of the least eigenvalue, which another mesh has with other digits.
STABILITY_TOLERANCE = 1e-4
# What is less stable under its loads, or yields at so little more of them, is on the brink.
BRINK = 0.1
# As many times its loads an arm is followed.
MOST_LOADS = 3.0
# Of gaps [m], forces [N] and their products [N m].
COMPLEMENTARY = 1e-8


@dataclass(frozen=True)
class Certificate:
    """The results of a plan's check. Lengths are over the arm's length, angles in rad.

    Attributes
    ----------
    equality : largest residual of each thing that has to be met
    soft_residual : size of each thing that was to be made as small as the limits allow
    inequality : least value of each thing that has to be 0 or above
    bounds : largest violation of a tension limit [N]
    complementarity : by how much gap >= 0 [m], force >= 0 [N] and their product = 0 [N m] are
        missed with contact, None without
    strokes : largest violation of a limit of strokes
    kkt : residual of the first-order conditions, scaled; their multipliers are the plan's
    agreement : distance of the settled tip from the check's, over L
    error : estimated tip error of the check, over L
    stability : least eigenvalue of the scaled Hessian of the energy; below 0 the arm does not stand
    stability_margin : the least that is accepted
    scheme : the integrator of the check
    tolerance : what equality, inequality and agreement are held to
    problem : why the check could not be made, if so
    gaps_asked : least distance of the arm's surface from each body with a required clearance [m]
    least_gaps : the required clearances [m]
    on_request : what is no part of the verdict: other gaps, the load factor
    units : of these by name: "L" of lengths over the arm's, "rad"
    """

    equality: Mapping[str, float] = field(default_factory=dict)
    soft_residual: Mapping[str, float] = field(default_factory=dict)
    inequality: Mapping[str, float] = field(default_factory=dict)
    bounds: float = np.inf
    kkt: float = np.inf
    agreement: float = np.inf
    error: float = np.inf
    stability: float = np.inf
    stability_margin: float = 0.0
    scheme: str = ""
    tolerance: float = 1e-6
    problem: str = ""
    gaps_asked: Mapping[str, float] = field(default_factory=dict)
    least_gaps: Mapping[str, float] = field(default_factory=dict)
    on_request: OnRequest = field(default_factory=OnRequest)
    units: Mapping[str, str] = field(default_factory=dict)
    strokes: float = 0.0
    complementarity: float | None = None

    @property
    def gaps(self) -> Mapping[str, float]:
        """The least distance of the arm's surface from each thing it can meet [m].

        See model.clearance; computed on first access.
        """
        return {name: clearance.gap for name, clearance in self.on_request.clearances.items()}

    @property
    def nearest(self) -> str:
        """The nearest of what the arm can meet, in words."""
        return nearest_in_words(self.on_request.clearances) if self.on_request.clearances else ""

    @property
    def load_factor(self) -> float | None:
        """Times its loads at which the arm yields, tensions held; computed on first access.

        Infinite if that is more than MOST_LOADS, None without loads.
        """
        return self.on_request.load_factor

    @property
    def clearance(self) -> float:
        """The least distance of the arm's surface from obstacles, from behind its base, itself [m].

        A lower bound; below 0 the arm passes through, infinite where it can meet nothing.
        """
        return min(self.gaps.values(), default=np.inf)

    @property
    def too_near(self) -> Mapping[str, float]:
        """By how much gaps fall short of the clearance required, by name [m]."""
        missing = {name: least - self.gaps_asked[name] for name, least in self.least_gaps.items()}
        return {name: distance for name, distance in missing.items() if distance > 0}

    @property
    def warnings(self) -> tuple[str, ...]:
        """What was not required and yet is impossible or doubtful, a sentence each."""
        gaps = self.gaps.items()
        negative = [(name, gap) for name, gap in gaps if gap < 0 and name not in self.least_gaps]
        sentences = [
            f"the arm passes through {name} by {-1e3 * gap:.3g} mm" for name, gap in negative
        ]
        slack = self.stability < BRINK and not self.stability_margin
        soon = (self.load_factor or np.inf) < 1 + BRINK
        if self.stability >= 0 and (slack or soon):
            reasons = [] if soon else [f"its stability is {self.stability:.2g}"]
            reasons += [f"it {self.bears}"] if self.bears else []
            sentences.append(f"it stands on the brink: {', though '.join(reasons)}")
        return tuple(sentences)

    @property
    def residual(self) -> float:
        """The largest residual of what has to be met."""
        return max(self.equality.values(), default=0.0)

    @property
    def reached(self) -> bool:
        """Whether everything that has to be met is met."""
        return not self.problem and self.residual <= self.tolerance

    @property
    def attained(self) -> bool:
        """Whether the equalities and the inequalities of the targets are met."""
        return self.reached and min(self.inequality.values(), default=0.0) >= -self.tolerance

    @property
    def failures(self) -> tuple[str, ...]:
        """What did not pass, a sentence each."""
        if self.problem:
            return (self.problem,)
        checks = [
            (max(self.equality.values(), default=0.0), self.tolerance, "target residual"),
            (-min(self.inequality.values(), default=0.0), self.tolerance, "inequality below 0 by"),
            (self.bounds, 0.0, "tension limit violated by [N]"),
            (self.strokes, self.tolerance, "stroke limit violated by [L]"),
            (self.kkt, KKT_TOLERANCE, "optimality residual"),
            (self.agreement, self.tolerance, "integrators differ by"),
            (self.stability_margin - self.stability, self._stable, self._unstable),
        ]
        if self.complementarity is not None:
            checks.append((self.complementarity, COMPLEMENTARY, "complementarity missed by"))
        near = self.too_near.items()
        checks += [(1e3 * distance, 0.0, f"too near {name} by [mm]") for name, distance in near]
        failed = [check for check in checks if not check[0] <= check[1]]
        return tuple(f"{name} {value:.2g}, allowed {limit:.2g}" for value, limit, name in failed)

    @property
    def lacks_stability(self) -> bool:
        """Whether the arm is stable, but below its margin."""
        return self.stability >= 0 and self.stability_margin - self.stability > self._stable

    @property
    def _stable(self) -> float:
        """How far below its margin stability may be: digits of a mesh, 0 without a margin."""
        return STABILITY_TOLERANCE if self.stability_margin > 0 else 0.0

    @property
    def _unstable(self) -> str:
        if self.stability < 0:
            return "the arm does not stand; stability below 0 by"
        return f"stability below its margin of {self.stability_margin:g} by"

    @property
    def bears(self) -> str:
        """How many times its loads the arm bears, in words; empty without loads."""
        if self.load_factor is None:
            return ""
        if np.isinf(self.load_factor):
            return f"bears at least {MOST_LOADS:g} times its loads"
        return f"yields at {self.load_factor:.2f} times its loads"

    @property
    def passed(self) -> bool:
        """Whether target, limits and first-order optimality are verified to the tolerances."""
        return not self.failures

    def _repr_html_(self) -> str:
        return in_notebook(self)

    def __str__(self) -> str:
        head = f"certificate: {'PASSED' if self.passed else 'FAILED'} (checked by {self.scheme})"
        lines = columns([["  " + name, value, note] for name, value, note in self.rows], left=3)
        lines += [f"  beware: {warning}" for warning in self.warnings]
        return "\n".join([head, *lines, *(f"  failed: {failure}" for failure in self.failures)])

    @property
    def rows(self) -> list[tuple[str, str, str]]:
        """Return what was checked: name with unit, value, what is allowed."""
        most = f"at most {self.tolerance:.0e}"
        measured = [(name, value, most) for name, value in self.equality.items()]
        least = "as small as the limits allow"
        measured += [(name, value, least) for name, value in self.soft_residual.items()]
        measured += [(name, value, "at least 0") for name, value in self.inequality.items()]
        rows = [
            (f"{name} [{self.units.get(name, '-')}]", v, allowed) for name, v, allowed in measured
        ]
        rows += [
            ("limits violated by [N]", self.bounds, "at most 0"),
            ("optimality residual [-]", self.kkt, f"at most {KKT_TOLERANCE:.0e}"),
            ("integrators differ by [L]", self.agreement, most),
            ("estimated tip error [L]", self.error, ""),
            ("stability [-]", self.stability, f"at least {self.stability_margin:g}; 1 at rest"),
        ]
        if self.load_factor is not None:
            rows.append(("load factor [-]", min(self.load_factor, MOST_LOADS), self.bears))
        if self.complementarity is not None:
            rows.append(("complementarity missed by", self.complementarity, ""))
        nearest = self.nearest or "can meet nothing"
        rows.append(("clearance [mm]", 1e3 * self.clearance, nearest))
        return [(name, _digits(value), allowed) for name, value, allowed in rows]


def _digits(value: float) -> str:
    """Return a number with three digits: as people write it, a small one with its exponent."""
    return f"{value:.3g}" if value == 0 or 1e-2 <= abs(value) < 1e5 else f"{value:.2e}"
