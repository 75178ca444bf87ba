"""An answer: tensions for a target, with shape, certificate and outcome derived from them."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from functools import cached_property
from typing import Any, NamedTuple, Self

import numpy as np

from model.errors import OctoplanError
from model.loads import contacts
from model.paths import Array
from model.shape import Shape
from planner.avoidance.surroundings import NOTHING, Surroundings
from planner.certificate import Certificate
from planner.certify import certify
from planner.contact.remarks import remarks
from planner.measure import remark_on_slack, strokes
from planner.mirror import mirror_images
from planner.outcome import sentence
from planner.program.problem import Point, units
from planner.program.program import STABILITY, STRETCH, STROKES
from planner.question import Mode, effort
from planner.solve.refine import defect, settled
from planner.solve.task import SearchResult, Task, agreed
from planner.targets.base import Target


class Optimum(NamedTuple):
    """Tensions in equilibrium as a point of their program: unknowns and multipliers of all.

    With the defect of the program's mesh there, and the residual of the first-order conditions.
    Numbers only, as plans travel by pickle.
    """

    x: Array
    lam_x: Array
    lam_g: Array
    defect: Array
    residual: float


@dataclass(frozen=True, eq=False)
class Answer(SearchResult, Task):
    """Tensions for a target. Numbers only; shape, certificate and outcome are derived from them.

    Task has the question, SearchResult the solution, and `surroundings` is what the arm was to keep
    clear of. An answer whose tensions are changed (dataclasses.replace) is checked afresh.
    """

    surroundings: Surroundings = NOTHING

    @classmethod
    def of(cls, task: Task, result: SearchResult, **more: Any) -> Self:
        """Return the answer to a task from the result of its search; `more` are further fields."""
        return cls(**vars(task) | vars(result) | more)

    @cached_property
    def shape(self) -> Shape:
        """The shape under the tensions, to a hundredth of the accuracy."""
        return settled(self.arm, self.tensions, self.scene, self.accuracy, self.machine_code)

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
        """The check of the tensions by another integrator; see planner.certificate."""
        T = np.ravel(self.tensions)
        return certify(self, T, lambda: self.shape, self._kkt(), self.surroundings)

    @property
    def mode(self) -> Mode:
        """How the targets were read in the end: "exact", "closest" or "nearest"."""
        return self.statement.mode

    @property
    def reached(self) -> bool:
        """Whether the target is met, by the certificate."""
        return self.certificate.passed

    @property
    def effort(self) -> float:
        """The norm of the tensions that was made least [N]."""
        return float(effort(np.ravel(self.tensions), self.statement.norm))

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
        if self.mirror_images:
            planes = ", ".join(f"{math.degrees(angle):.3g} deg" for angle, _ in self.mirror_images)
            said = f"{said} Its mirror image across the plane at {planes} from n costs the same."
        if not self.certificate.problem:
            missed = not self.certificate.attained and not self.stopped
            said += remarks(self.targets, self.shape, self.limits, missed, self.accuracy)
            said += remark_on_slack(self.arm, self.targets, self.shape)
        if not self.scene.effects:
            said += " Statics: bending alone, as in Scene()."
        return f"Stopped at the time limit, the best so far. {said}" if self.stopped else said

    @cached_property
    def mirror_images(self) -> tuple[tuple[float, Array], ...]:
        """Other tensions that reach the targets at the same effort; none where it was not reached.

        Nor among obstacles or in contact. Angles of planes through the base's axis, from n towards
        b [rad], and mirrored tensions [N].
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
        near, upper = 1e-6 * units(self.arm, limits), np.array(self.limits.upper)
        holds = (np.array(limits.upper) == upper) & (upper - near <= T) & (lam[: T.size] > 1e-9)
        active = [
            (lam[j], f"{self.arm.tendon_name(j)} at its maximum of {upper[j]:g} N")
            for j in np.flatnonzero(holds).tolist()
        ]
        kinds = (
            (STRETCH, np.inf, "the body, which would be crushed (1 + q at its least)"),
            (STABILITY, np.inf, f"stability, at its margin of {self.statement.least:g}"),
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
    def stated(self) -> tuple[Target, ...]:
        """The targets of the program."""
        return self.targets if self.avoidance is None else (*self.targets, self.avoidance)

    @property
    def agreed(self) -> int:
        """How many starts ended at the best objective, to a thousandth."""
        return agreed(self.starts)

    def _rows(self, name: str) -> Array:
        """Return the multipliers of the constraints of a name."""
        problem, lam_g = self.problem(), np.array(self.lam_g)
        # Files of earlier versions have the multipliers of equilibrium last.
        if lam_g.size < problem.n_outer:
            return np.zeros(0)
        at = np.flatnonzero(problem.program.rows[: problem.n_outer] == name)
        return np.asarray(lam_g[at])

    @cached_property
    def optimum(self) -> Optimum | None:
        """The tensions as a point of their program.

        None where they do not settle, and where the multipliers are of another program.
        """
        problem = self.problem()
        n, m = problem.n_free, problem.n_outer
        lam_x, lam_g = np.array(self.lam_x)[:n], np.array(self.lam_g)[:m]
        if lam_x.size != n or lam_g.size != m:
            return None
        try:
            x = problem.settled(np.ravel(self.tensions), self.shape.known)
            error = defect(problem, x, self.shape)
            point = Point(problem, x, problem.parameters(defect=error))
        except (OctoplanError, np.linalg.LinAlgError):
            return None
        residual = point.residual(lam_x, lam_g)
        return Optimum(x, *point.extended(lam_x, lam_g), error, residual)

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
