"""An answer: tensions for a target, with the shape, certificate and outcome that follow from them.

The outcome is a sentence: what happened, what holds it, and what to try.
"""

from __future__ import annotations

import math
from contextlib import suppress
from dataclasses import dataclass, fields
from functools import cached_property
from operator import attrgetter
from typing import Any, Self, TypeVar

import numpy as np

from octoplan.model.extensions.contact.effects import contacts
from octoplan.model.paths import Array
from octoplan.model.shape import Shape
from octoplan.model.support.errors import OctoplanError, UncertifiedError
from octoplan.model.support.progress import OUT_OF_TIME, OutOfTime, report
from octoplan.planner.blocks import STABILITY, STRETCH, STROKES
from octoplan.planner.certificate import Certificate, certify
from octoplan.planner.extensions.avoidance.surroundings import NOTHING, Environment
from octoplan.planner.extensions.contact.remarks import remarks
from octoplan.planner.extensions.mirror import mirror_images
from octoplan.planner.measure import remark_on_slack, strokes
from octoplan.planner.nlp_options import Mode, effort
from octoplan.planner.nlp_solution import STABILITY_TOLERANCE, NlpSolution
from octoplan.planner.planning_problem import PlanningProblem
from octoplan.planner.problem import RESOLVED, Problem, tension_scales
from octoplan.planner.solution import Solution, n_equal_optima
from octoplan.planner.solve.refine import on_mesh
from octoplan.planner.targets.base import OVER_WANTED

A = TypeVar("A", bound="Answer")


@dataclass(frozen=True, eq=False)
class Answer(Solution, PlanningProblem):
    """Tensions for a target. Numbers only; shape, certificate and outcome are derived from them.

    `surroundings` is what the arm was to keep clear of. `complete` computes shape, certificate and
    outcome; properties return them. An answer that is not complete, such as one whose tensions are
    changed (dataclasses.replace), computes each of them when it is first read.
    """

    surroundings: Environment = NOTHING

    @classmethod
    def of(cls, task: PlanningProblem, result: Solution, **more: Any) -> Self:
        """Return the answer to a task from the result of its search; `more` are further fields."""
        parts = {f.name: getattr(of, f.name) for of in (task, result) for f in fields(of)}
        return cls(**parts | more)

    def complete(self) -> None:
        """Compute shape, certificate and outcome, as far as the time limit allows.

        If the time limit is reached before the arm is settled, `shape` raises UncertifiedError.
        """
        report("settling the shape")
        try:
            self._settled_or_reason  # noqa: B018  (cached)
        except OutOfTime:
            vars(self)["_settled_or_reason"] = UncertifiedError(OUT_OF_TIME)
        self.certificate  # noqa: B018  (cached)
        try:
            self._remarks  # noqa: B018  (cached)
        except OutOfTime:
            vars(self)["_remarks"] = ""

    @property
    def shape(self) -> Shape:
        """The shape under the tensions, to a hundredth of the accuracy.

        Raises what settle does; UncertifiedError if the time limit was reached first.
        """
        found = self._settled_or_reason
        if isinstance(found, OctoplanError):
            raise found.with_traceback(None)
        return found

    @cached_property
    def _settled_or_reason(self) -> Shape | OctoplanError:
        """The shape, or the error of settle: an arm that yields under its loads takes long."""
        try:
            return self._settle()
        except OctoplanError as reason:
            return reason

    def _settle(self) -> Shape:
        return self.settled(self.tensions)

    @property
    def tip(self) -> Array:
        """Position of the tip (3,) [m], base frame."""
        return self.shape.tip

    @property
    def lengths(self) -> Array:
        """Length of each tendon between base and anchorage [m], of the tensions' form."""
        return self.arm.by_section(self.shape.tendon_lengths)

    @property
    def strokes(self) -> Array:
        """What is taken in of each tendon from where winches are zeroed [m], likewise; see plan.

        Of a slack tendon the most that may be without its pulling.
        """
        return self.arm.by_section(strokes(self.shape, self.limits.stroke_zero))

    @cached_property
    def certificate(self) -> Certificate:
        """The check of the tensions by another integrator; see octoplan.planner.certificate."""
        T = np.ravel(self.tensions)
        return certify(self, T, lambda: self.shape, self._kkt, self.surroundings)

    @property
    def mode(self) -> Mode:
        """How the targets were read in the end: "exact", "closest" or "nearest"."""
        return self.options.mode

    @property
    def reached(self) -> bool:
        """Whether the target is met, by the certificate."""
        return self.certificate.passed

    @property
    def effort(self) -> float:
        """The norm of the tensions that was made least [N]."""
        return float(effort(np.ravel(self.tensions), self.options.norm))

    @property
    def outcome(self) -> str:
        """What happened, what holds it, and what to try: a sentence."""
        said = sentence(self)
        if self.jump:
            said = said.removesuffix(".") + "; left the branch of the plan before: "
            said += f"tensions jump by {100 * self.jump:.0f} %."
        if self.lost:
            said += f" An optimum {100 * self.lost:.0f} % cheaper on the coarse mesh was lost on "
            said += "finer ones: ask for more starts."
        said += self._remarks
        if not self.scene.effects:
            said += " Statics: bending alone, as in Scene()."
        return f"Stopped at the time limit, the best so far. {said}" if self.stopped else said

    @cached_property
    def _remarks(self) -> str:
        """Sentences about mirror images, wraps, holds and slack tendons, each after a space."""
        if self.certificate.problem:
            return ""
        said = ""
        if images := self.mirror_images():
            planes = ", ".join(f"{math.degrees(angle):.3g} deg" for angle, _ in images)
            said = f" Its mirror image across the plane at {planes} from n costs the same."
        missed = not self.certificate.attained and not self.stopped
        said += remarks(self.targets, self.shape, self.limits, missed, self.accuracy)
        return said + remark_on_slack(self.target_set, self.shape)

    def mirror_images(self) -> tuple[tuple[float, Array], ...]:
        """Return other tensions that meet the targets at the same effort.

        Angles of planes through the base's axis, from n towards b [rad], and mirrored tensions [N].
        Empty if the target is not reached, among obstacles, and in contact.
        """
        touches = self.surroundings or contacts(self.scene)
        if touches or self.mode != "exact" or not self.reached:
            return ()
        images = mirror_images(self, self.shape)
        return tuple((angle, self.arm.by_section(T)) for angle, T in images)

    def holding(self) -> list[str]:
        """Return the names of the limits that hold the tensions back, hardest first."""
        if not self.lam_x:
            return []
        T, lam, limits = np.ravel(self.tensions), np.array(self.lam_x), self.allowed
        near, lam = 1e-6 * tension_scales(self.arm, self.limits), lam[: T.size]
        upper, lower = np.array(self.limits.upper), np.array(self.limits.lower)
        most = (np.array(limits.upper) == upper) & (upper - near <= T) & (lam > 1e-9)
        # No tendon pushes: a minimum of 0 is no limit.
        least = (lower > 0) & (lower + near >= T) & (lam < -1e-9)
        active = [
            (abs(lam[j]), f"{self.arm.tendon_name(j)} at its {name} of {bounds[j]:g} N")
            for name, bounds, holds in (("maximum", upper, most), ("minimum", lower, least))
            for j in np.flatnonzero(holds).tolist()
        ]
        kinds = (
            (STRETCH, np.inf, "the body, which would be crushed (1 + q at its least)"),
            (STABILITY, np.inf, f"stability, at its margin of {self.options.stability_bound:g}"),
            ("clear", 0.0, "what the arm is to keep clear of"),
        )
        for kind, weight, name in kinds:
            if self._rows(kind).min(initial=0.0) < -1e-9:
                active.append((weight, name))
        lam, ends = self._rows(STROKES), np.array(self.limits.strokes)
        for j in np.flatnonzero(np.abs(lam) > 1e-9).tolist():
            end = 1e3 * ends[int(lam[j] < 0), j]
            active.append((abs(lam[j]), f"the stroke of {self.arm.tendon_name(j)}, at {end:g} mm"))
        total = self.limits.total
        if total is not None and T.sum() >= total * (1 - 1e-6):
            active.append((np.inf, f"the total pull at its maximum of {total:g} N"))
        return [name for _, name in sorted(active, key=lambda item: -item[0])]

    @property
    def problem(self) -> Problem:
        """The program that states it."""
        blocks = self.avoidance.blocks(self.arm) if self.avoidance else ()
        return Problem(self, self.options, blocks)

    @property
    def n_equal_optima(self) -> int:
        """How many starts ended at the best objective, to a thousandth."""
        return n_equal_optima(self.starts)

    def _rows(self, name: str) -> Array:
        """Return the multipliers of the constraints of a name, as far as there are any."""
        lam, rows = np.array(self.lam_g), self.problem.program.row_kinds
        return np.asarray(lam[rows[: lam.size] == name])

    @cached_property
    def optimum(self) -> NlpSolution | None:
        """The tensions as a point of their program, with the defect of its mesh.

        None where they do not settle, and where the multipliers are of another program.
        """
        problem = self.problem
        program = problem.program
        lam_x, lam_g = np.array(self.lam_x), np.array(self.lam_g)
        if lam_x.size < program.n_decision or lam_g.size < program.n_design_rows:
            return None
        with suppress(OctoplanError, np.linalg.LinAlgError):
            known = NlpSolution(np.zeros(0), lam_x, lam_g, 0.0, True, 0, problem=problem)
            return on_mesh(known, problem, self.shape)
        return None

    def converted(self, kind: type[A], **more: Any) -> A:
        """Return the answer as one of another class, with what is computed of it already."""
        parts = {f.name: getattr(self, f.name) for f in fields(self)}
        result = kind(**parts | more)
        computed = ("_settled_or_reason", "certificate", "_remarks", "optimum")
        vars(result).update({name: vars(self)[name] for name in computed if name in vars(self)})
        return result

    def __getstate__(self) -> dict[str, Any]:
        """Return what travels by pickle: the numbers, without the program."""
        return {name: item for name, item in vars(self).items() if name != "optimum"}

    def _kkt(self) -> float:
        return np.inf if self.optimum is None else self.optimum.residual

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Answer):
            return NotImplemented
        names = [f.name for f in fields(self) if f.compare]
        return all(
            np.array_equal(getattr(self, n), getattr(other, n))
            if n == "tensions"
            else getattr(self, n) == getattr(other, n)
            for n in names
        )

    __hash__ = None  # type: ignore[assignment]


def sentence(plan: Any) -> str:
    """Return the outcome of a plan (see Answer) as a sentence, with its certificate's warnings."""
    beware = "".join(f" Beware: {warning}." for warning in plan.certificate.warnings)
    return f"{_verdict(plan)}.{beware}"


def _verdict(plan: Any) -> str:
    certificate, count = plan.certificate, len(plan.starts)
    if certificate.problem:
        more = "; raise time_limit, or certify the plan" * (certificate.problem == OUT_OF_TIME)
        return f"Not certified: {certificate.problem}{more}"
    guesses = "initial guess" if count == 1 else "initial guesses"
    samples = f" and {plan.sampled} sampled shapes" if plan.sampled else ""
    tried = f"{count} {guesses}{samples} tried, {plan.n_equal_optima} led to the best optimum"
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
        missed = f"the nearest shape found is off in {_gaps(plan)}"
        return f"Not reached: {missed}; {_reason(plan)}; {tried}"
    if certificate.too_near:
        passed = (certificate.clearances[name] for name in certificate.too_near)
        nearest = min(passed, key=attrgetter("gap"))
        return (
            f"Not clear: {nearest}; no way around it was found: move it or the target, "
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


def _success(plan: Any) -> str:
    certificate = plan.certificate
    soft, tolerance = certificate.soft_residual, certificate.tolerance
    met = max([certificate.residual, *soft.values()])
    if met <= tolerance:
        return f": every target met to {met:.1e} (asked {tolerance:.0e})"
    gaps = ", ".join(f"{name} {_size(plan, value)}" for name, value in soft.items())
    return f", as near as found: {gaps} ({_reason(plan)})"


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
            share = f"{1 + value:.4g} times what is wanted found, "
            ratio = share if name.endswith(OVER_WANTED) else ""
            gaps.append(f"{name.removesuffix(OVER_WANTED)} ({ratio}short by {-value:.3g})")
    return ", ".join(gaps)


def _size(plan: Any, value: float, unit: str = "L") -> str:
    """Return a residual in mm where it is a length, in degrees where it is an angle."""
    if unit == "L":
        return f"{1e3 * value * plan.arm.length:.3g} mm"
    return f"{math.degrees(value):.3g} deg" if unit == "rad" else f"{value:.3g}"


def _reason(plan: Any) -> str:
    """Return what keeps a plan from its targets and what may be done: the first reason there is."""
    of = plan.certificate
    least, holders = of.stability_margin, ", ".join(plan.holding()[:3])
    how_unstable = (
        f"less stable than the margin of {least:g}" if least else "unstable under the loads"
    )
    violated = -min(of.inequality.values(), default=0.0)
    missed = max(of.residual, violated, *of.soft_residual.values())
    reasons = (
        (plan.stopped, "the search was not at its end, a longer time limit may bring it nearer"),
        (
            missed <= RESOLVED,
            f"least squares of targets tell no less than {RESOLVED:.0e} of the arm's length, so "
            "that it may be met all the same; ask for less accuracy",
        ),
        (
            plan.in_the_way,
            "not reached clear of the obstacles: the plan without them meets it, and "
            f"{plan.in_the_way}; move them or the target, ask for less clearance or more starts",
        ),
        (
            plan.unstable,
            f"what meets it is {how_unstable}; stiffen the arm, lower the loads or move the target",
        ),
        (holders, f"held by {holders}; widen these limits or move the target"),
    )
    no_limit = "no limit is active; move the target, or ask for more starts"
    return next((told for is_so, told in reasons if is_so), no_limit)
