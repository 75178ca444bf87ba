"""A plan: tensions for a target, and everything that was found out about them."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, fields
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from model.arm import Arm
from model.checks import kind, not_negative, positive
from model.errors import InputError, OctoplanError
from model.ladder import checked_accuracy
from model.loaded.loads import check_loads
from model.paths import Array
from model.scene import Scene
from model.settle import settle
from model.shape import Shape
from model.statics import is_loaded
from planner.certificate import Certificate, certify
from planner.files import to_json, write_named
from planner.outcome import Facts, sentence
from planner.program.effort import check_norm, effort
from planner.program.limits import Limits
from planner.program.problem import Problem, build, units
from planner.program.statement import Form, Mode, Statement
from planner.question import check_looks, check_targets, checked_form
from planner.records.plan import plan_record
from planner.solve.follow import Known, follow
from planner.solve.polish import optimality
from planner.solve.search import Found, Search, Start, allowed
from planner.targets.base import Target


@dataclass(frozen=True, eq=False)
class Plan:
    """Tensions for a target. Numbers only; shape, certificate and outcome are derived from them.

    A plan whose tensions are changed (dataclasses.replace) is checked afresh.

    Attributes
    ----------
    arm, scene, targets, limits
        What was asked.
    statement : Statement
        How it was stated in the end: its `mode` is "nearest" if the targets could not be met.
    tensions : (n_sections, n), or (n_tendons,) where sections differ in number
        [N].
    lam_x, lam_g : tuple of float
        Multipliers of bounds and constraints of the problem, scaled, CasADi's signs.
    accuracy : float
        What residuals and tip errors are held to, over the arm's length.
    starts : tuple of Start
        The first guesses tried, in order.
    stopped : bool
        Whether the time limit ended the search: these are the best tensions it had come to.
    """

    arm: Arm
    scene: Scene
    targets: tuple[Target, ...]
    limits: Limits
    statement: Statement
    tensions: Array
    lam_x: tuple[float, ...]
    lam_g: tuple[float, ...]
    accuracy: float
    starts: tuple[Start, ...]
    stopped: bool = False

    @cached_property
    def shape(self) -> Shape:
        """The shape under the plan's tensions, a digit more accurate than asked."""
        return settle(self.arm, self.tensions, self.scene, max(self.accuracy / 10, 1e-12))

    @cached_property
    def certificate(self) -> Certificate:
        """The check of the tensions by another integrator; see planner.certificate."""
        T = np.ravel(self.tensions)
        try:
            shape: Shape | None = self.shape
        except OctoplanError:
            shape = None
        return certify(
            self.arm, self.scene, self.targets, self.limits, shape, T, self._kkt(T), self.accuracy
        )

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
        return effort(np.ravel(self.tensions), self.statement.norm)

    @property
    def agreed(self) -> int:
        """How many starts ended at the best objective, to a thousandth."""
        best = min((start.objective for start in self.starts if start.met), default=np.inf)
        near = best + 1e-3 * abs(best) + 1e-12
        return sum(start.met and start.objective <= near for start in self.starts)

    @property
    def outcome(self) -> str:
        """What happened, what holds it, and what to try: a sentence."""
        found = (self.certificate, self.mode, self.effort, len(self.starts), self.agreed)
        said = sentence(Facts(*found, tuple(self.holding()), self.arm.length))
        return f"Stopped at the time limit, the best so far. {said}" if self.stopped else said

    def holding(self) -> list[str]:
        """Return the names of the limits that hold the tensions back, hardest first."""
        if not self.lam_x:
            return []
        T, lam = np.ravel(self.tensions), np.array(self.lam_x)
        limits = allowed(self.arm, self.targets, self.limits)
        near = 1e-6 * units(self.arm, limits)
        found = []
        for j, upper in enumerate(self.limits.upper):
            if limits.upper[j] == upper and T[j] >= upper - near[j] and lam[j] > 1e-9:
                name = f"{self.arm.tendon_name(j)} at its maximum of {upper:g} N"
                found.append((float(lam[j]), name))
        if np.ravel(self._rows("stretch")).min(initial=0.0) < -1e-9:
            found.append((np.inf, "the body, which would be crushed (1 + q at its least)"))
        total = self.limits.total
        if total is not None and T.sum() >= total * (1 - 1e-6):
            found.append((np.inf, f"the total pull at its maximum of {total:g} N"))
        return [name for _, name in sorted(found, key=lambda item: -item[0])]

    def co_contract(self, level: float) -> Plan:
        """Return the plan for the same targets with every tendon pulling at least so hard [N].

        Where the statics let tensions change without the shape (a straight arm without extension,
        tendons that run parallel to the midline), the shape is the same; otherwise the targets are
        still met, if the limits allow.
        """
        least = np.maximum(not_negative("level", level), self.limits.lower)
        return plan(
            self.arm,
            self.targets,
            self.scene,
            self.limits.upper,
            tension_min=least,
            total_pull=self.limits.total,
            norm=self.statement.norm,
            form=self.statement.form,
            accuracy=self.accuracy,
        )

    def save(self, path: str | Path) -> Path:
        """Write the plan, its certificate and all that was asked to a .json file; see load_plan.

        The file is there whole or not at all. Raises InputError for another suffix, where it cannot
        be written, and for targets, effects and paths that are not the project's own.
        """
        return write_named(path, ".json", to_json(plan_record(self)))

    def plot(self, ax: Any = None) -> Any:
        """Draw the arm in 3-D with its tendons, tensions and target; see planner.plots.plan."""
        from planner.plots.plan import plot_plan

        return plot_plan(self, ax)

    def _problem(self) -> Problem:
        return build(self.arm, self.targets, self.scene, self.statement)

    def _rows(self, name: str) -> Array:
        """Return the multipliers of the constraints of a name."""
        names = np.concatenate([[rows.name] * rows.size for rows in self._problem().rows])
        return np.asarray(np.array(self.lam_g)[names == name])

    def _kkt(self, T: Array) -> float:
        problem = self._problem()
        limits = allowed(self.arm, self.targets, self.limits)
        p = problem.parameters(self.targets, limits)
        x = problem.unknowns(T, limits, p)
        lam_x, lam_g = np.array(self.lam_x), np.array(self.lam_g)
        bounds = problem.bounds(limits)
        if lam_x.shape != x.shape or lam_g.shape != bounds[2].shape:
            return np.inf
        return optimality(problem, x, p, lam_x, lam_g, bounds).worst

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Plan):
            return NotImplemented
        return all(
            np.array_equal(getattr(self, f.name), getattr(other, f.name))
            if f.name == "tensions"
            else getattr(self, f.name) == getattr(other, f.name)
            for f in fields(self)
        )

    __hash__ = None  # type: ignore[assignment]


def plan(
    arm: Arm,
    target: Target | Iterable[Target],
    scene: Scene | None = None,
    tension_max: Any = np.inf,
    *,
    tension_min: Any = 0.0,
    total_pull: float | None = None,
    norm: Any = "2",
    form: Form | None = None,
    accuracy: float = 1e-6,
    starts: int = 14,
    near: Plan | None = None,
    time_limit: float | None = None,
) -> Plan:
    """Return the tensions of least effort that give an arm the shape that a target wants.

    Parameters
    ----------
    target : Target, or several to be met together
    scene : Scene
        The effects called for; the bare arm unless given.
    tension_max, tension_min : float, or one for each tendon
        [N].
    total_pull : float
        The most that all tendons together may pull [N]; no limit unless given.
    norm : "2", "1" or "inf"
        What effort is: root of the sum of squares, sum, or largest tension.
    form : "condensed" or "multiple-shooting"
        Unknowns of the problem: tensions alone, or with the states of each segment. Condensed
        unless given, except under loads, where the shape is not a function written out.
    accuracy : float
        What residuals and tip errors are held to, over the arm's length (angles: rad).
    starts : int
        The most first guesses that are tried; fewer are, once the best was found twice.
    near : Plan
        A plan for a target nearby, of the same kind, for the same arm and scene: its optimum is
        followed to this target, which is some ten times sooner. Where that fails all starts are
        tried.
    time_limit : float
        [s]. What is best then is returned, and `outcome` says so; what the first plan for an arm
        and a scene needs to be set up is not cut short.

    Returns
    -------
    Plan
        Also when the target cannot be met: then it is the nearest attainable shape, and
        `outcome` says how far off it is and what holds it.

    Raises
    ------
    InputError
        Naming the field, for anything that is not allowed; targets that contradict each other.
    """
    scene, targets = scene or Scene(), check_targets(arm, target)
    check_loads(arm, scene)
    form = checked_form(form, is_loaded(scene))
    if isinstance(starts, bool) or not isinstance(starts, int) or starts < 1:
        raise InputError("starts", starts, "a whole number from 1")
    accuracy = checked_accuracy(accuracy)
    seconds = None if time_limit is None else positive("time_limit", time_limit)
    limits = Limits.of(arm, tension_max, tension_min, total_pull)
    check_looks(targets, scene, limits)
    statement = Statement(form, check_norm(norm), limited=total_pull is not None)
    found = None if near is None else _followed(near, arm, scene, targets, limits, accuracy)
    if found is None:
        found = Search(arm, targets, scene, limits, statement, accuracy).run(starts, seconds)
    return Plan(
        arm,
        scene,
        targets,
        limits,
        found.statement,
        found.tensions,
        found.lam_x,
        found.lam_g,
        accuracy,
        found.starts,
        found.stopped,
    )


def _followed(
    near: Plan,
    arm: Arm,
    scene: Scene,
    targets: tuple[Target, ...],
    limits: Limits,
    accuracy: float,
) -> Found | None:
    kind("near", near, Plan, "a Plan for the same arm and scene, or None")
    if near.arm != arm or near.scene != scene:
        raise InputError("near", "a plan for another arm or scene", "one for the same")
    if near.limits != limits:
        return None
    known = Known(near.targets, near.statement, near.tensions, near.lam_x, near.lam_g)
    return follow(known, arm, scene, targets, limits, accuracy)
