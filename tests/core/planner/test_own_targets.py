"""Targets of users are planned by value, for any form of their classes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import pytest

from octoplan.model import Arm, InputError, settle
from octoplan.planner import Plan, plan, plan_many, program
from octoplan.planner.block import Block
from octoplan.planner.blocks import TotalPull
from octoplan.planner.frontends.c_code.export import export_plan
from octoplan.planner.limits import Limits
from octoplan.planner.plan import Strategy
from octoplan.planner.planning_problem import PlanningProblem
from octoplan.planner.program_instance import ProgramInstance
from octoplan.planner.targets import Target, TipPosition, target_set
from octoplan.planner.targets.base import Terms, View
from octoplan.planner.targets.target_set import TargetSet
from tests.core.planner.cases import PAPER, Array, moderate

ARM = Arm.from_paper("table-4")
SHAPE = settle(ARM, moderate(), PAPER)
HEIGHTS = SHAPE.tip[2] + np.array([0.0, 0.01, -0.015])


@dataclass(frozen=True)
class Frozen(Target):
    """The height of the tip, by a field that only `terms` uses."""

    z: float

    def terms(self, view: View, p: ca.MX) -> Terms:
        return Terms(equality={"height": (view.tip[2] - self.z) / view.arm.length})


@dataclass
class Unhashable(Target):
    """The same by numbers in an array, which may be changed later."""

    numbers: Array

    def terms(self, view: View, p: ca.MX) -> Terms:
        return Terms(equality={"height": (view.tip[2] - self.numbers[0]) / view.arm.length})


class Plain(Target):
    """The same by a function that is no part of any field's value."""

    def __init__(self, height: Callable[[View], ca.MX]) -> None:
        self.height = height

    def terms(self, view: View, p: ca.MX) -> Terms:
        return Terms(equality={"height": self.height(view) / view.arm.length})


def closure(z: float) -> Target:
    return Plain(lambda view: view.tip[2] - z)


def redefined(z: float) -> Target:
    """Return a target of a class that is defined anew, as a cell of a notebook does."""

    @dataclass(frozen=True)
    class Height(Target):
        def terms(self, view: View, p: ca.MX) -> Terms:
            return Terms(equality={"height": (view.tip[2] - z) / view.arm.length})

    return Height()


def namesake(z: float) -> Target:
    """Return a target of a class with the name and the numbers of a built-in one."""

    def height(self: Target, view: View, p: ca.MX) -> Terms:
        return Terms(equality={"tip position": (view.tip[2] - p[2]) / view.arm.length})

    own = {"terms": height, "parameters": lambda self, arm: np.array([9.0, 9.0, z])}
    made: Target = type("TipPosition", (Target,), own)()
    return made


@dataclass(frozen=True)
class Overriding(TipPosition):
    """A built-in target with other terms and the same numbers."""

    z: float = 0.0

    def terms(self, view: View, p: ca.MX) -> Terms:
        return Terms(equality={"height": (view.tip[2] - self.z) / view.arm.length})


KINDS: dict[str, Callable[[float], Target]] = {
    "frozen": Frozen,
    "unhashable": lambda z: Unhashable(np.array([z])),
    "closure": closure,
    "redefined": redefined,
    "namesake": namesake,
    "overriding": lambda z: Overriding((9.0, 9.0, 9.0), z),
}


def height(p: Any) -> float:
    """Return the height of the settled tip [m], of the tensions alone."""
    return float(settle(ARM, p.tensions, PAPER, 1e-8).tip[2])


@pytest.mark.parametrize("kind", KINDS)
def test_each_value_of_an_own_target_is_planned(kind: str) -> None:
    plan(ARM, TipPosition(tuple(SHAPE.tip)), PAPER)
    near = None
    for z in HEIGHTS:
        p = plan(ARM, KINDS[kind](z), PAPER)
        near = plan(ARM, KINDS[kind](z), PAPER, near=near)
        for each in (p, near):
            assert each.reached, each.outcome
            assert height(each) == pytest.approx(z, abs=2e-6 * ARM.length)
            (missed,) = each.certificate.equality.values()
            off = abs(height(each) - z) / ARM.length
            assert missed == pytest.approx(off, abs=1e-7)


@pytest.mark.parametrize("kind", ["frozen", "unhashable"])
def test_many_plans_meet_each_own_target(kind: str) -> None:
    plans = plan_many(ARM, [KINDS[kind](z) for z in HEIGHTS], PAPER)
    assert [height(p) for p in plans] == pytest.approx(HEIGHTS, abs=2e-6 * ARM.length)


def test_changes_of_a_target_leave_its_plan_as_it_was() -> None:
    target = Unhashable(HEIGHTS[:1].copy())
    plans = []
    for z in HEIGHTS:
        target.numbers[0] = z
        plans.append(plan(ARM, target, PAPER))
    for p, z in zip(plans, HEIGHTS, strict=True):
        assert p.reached
        assert p.targets[0].numbers[0] == z  # type: ignore[attr-defined]
        assert height(p) == pytest.approx(z, abs=2e-6 * ARM.length)


def test_a_program_of_another_target_is_not_certified(monkeypatch: pytest.MonkeyPatch) -> None:
    """Swap programs on purpose: the certificate evaluates the target itself."""
    monkeypatch.setattr(target_set.TargetTerms, "__eq__", lambda self, other: True)
    monkeypatch.setattr(target_set.TargetTerms, "__hash__", lambda self: 0)
    program.program_of.cache_clear()
    try:
        first, second = (plan(ARM, Frozen(z), PAPER) for z in HEIGHTS[:2])
        assert first.reached
        assert not second.reached
        off = abs(height(second) - HEIGHTS[1]) / ARM.length
        assert second.certificate.equality["height"] == pytest.approx(off, abs=1e-7)
    finally:
        program.program_of.cache_clear()


def test_targets_of_equal_expressions_share_a_program() -> None:
    p = plan(ARM, TipPosition(tuple(SHAPE.tip)), PAPER)
    q = plan(ARM, TipPosition(tuple(SHAPE.tip + 0.01)), PAPER)
    same = p.problem.options
    assert ProgramInstance(p.problem, same).program is ProgramInstance(q.problem, same).program
    one, two = (TargetSet(ARM, (Frozen(z),)) for z in (0.1, 0.1))
    assert one.terms == two.terms
    assert one.terms != TargetSet(ARM, (Frozen(0.2),)).terms


class Scaled(ca.Callback):  # type: ignore[misc]
    """Return twice or three times a number, in Python, which CasADi cannot inspect."""

    def __init__(self, factor: float) -> None:
        ca.Callback.__init__(self)
        self.factor = factor
        self.construct("scaled", {})

    def eval(self, arg: list[ca.DM]) -> list[ca.DM]:
        """Return the product."""
        return [self.factor * arg[0]]


def test_functions_in_python_are_never_taken_for_equal() -> None:
    functions = [Scaled(2.0), Scaled(3.0)]
    one, two = (TargetSet(ARM, (Plain(lambda view, f=f: f(view.tip[2])),)).terms for f in functions)
    assert one == one
    assert one != two


@dataclass(frozen=True)
class Follower(Target):
    """Soft residuals and an inequality of one's own, at another station than the tip."""

    place: tuple[float, ...]
    s: float
    least: float = field(default=-1.0, kw_only=True)

    def stations(self, arm: Arm) -> tuple[float, ...]:
        return (self.s, arm.length)

    def terms(self, view: View, p: ca.MX) -> Terms:
        gap = (view.position(self.s) - ca.DM(self.place)) / view.arm.length
        above = (view.tip[0] - self.least) / view.arm.length
        return Terms(soft_residual={"gap": gap}, inequality={"above": above}, units={"gap": "L"})


@pytest.mark.parametrize("s", [0.2, 0.3])
def test_own_stations_and_inequalities_are_met(s: float) -> None:
    least = float(SHAPE.tip[0]) - 0.01
    p = plan(ARM, Follower(tuple(SHAPE.position(s)), s, least=least), PAPER)
    shape = settle(ARM, p.tensions, PAPER, 1e-8)
    assert p.reached, p.outcome
    assert shape.position(s) == pytest.approx(SHAPE.position(s), abs=2e-6 * ARM.length)
    assert shape.tip[0] >= least - 2e-6 * ARM.length


def test_plans_of_own_targets_are_not_saved_as_others(tmp_path: Path) -> None:
    for kind in ("frozen", "namesake", "overriding"):
        with pytest.raises(InputError, match="to save"):
            plan(ARM, KINDS[kind](HEIGHTS[0]), PAPER).save(tmp_path / "plan.json")


def test_an_overriding_target_is_not_exported_as_its_base(tmp_path: Path) -> None:
    p = plan(ARM, Overriding((9.0, 9.0, 9.0), HEIGHTS[0]), PAPER)
    with pytest.raises(InputError, match="one TipPosition"):
        export_plan(p, tmp_path)


class Uncopyable(Frozen):
    """A target that cannot be copied."""

    def __deepcopy__(self, memo: Any) -> Target:
        raise TypeError("it holds a lock")


@dataclass(frozen=True)
class Wrong(Target):
    """Terms that are no columns of expressions."""

    value: Any

    def terms(self, view: View, p: ca.MX) -> Terms:
        return Terms(equality={"wrong": self.value})


@dataclass(frozen=True)
class Given(Target):
    """The height of the tip, by given parameters, with given terms of the view."""

    given: Any
    wanted: Callable[[View], Terms] | None = None

    def parameters(self, arm: Arm) -> Array:
        numbers: Array = self.given
        return numbers

    def terms(self, view: View, p: ca.MX) -> Terms:
        if self.wanted:
            return self.wanted(view)
        return Terms(equality={"height": (view.tip[2] - p[0]) / view.arm.length})


def stated(wanted: Callable[[View], ca.MX], **others: Any) -> Target:
    """Return a target with one equality."""
    return Given([], lambda view: Terms(equality={"own": wanted(view)}, **others))


@pytest.mark.parametrize(
    ("target", "words"),
    [
        (Uncopyable(0.1), "copy.deepcopy"),
        (Wrong(0.0), "casadi.MX"),
        (Wrong(ca.MX(2, 2)), "one column"),
        (Wrong(np.zeros(3)), "casadi.MX"),
        (Given(None), "Given.parameters = None: must be a list of numbers"),
        (Given(0.1), "Given.parameters = 0.1: must be a list of numbers"),
        (Given([np.nan]), "Given.parameters = .*: must be finite numbers"),
        (stated(lambda view: view.tip[2] - ca.MX.sym("height")), r"\['height'\]: must be terms of"),
        (stated(lambda view: view.position(0.1)[2]), "s = 0.1: must be one of the stations"),
        (stated(lambda view: view.compliance[0, 0]), "compliance_request"),
        (stated(lambda view: view.tip[2], weights={"own": -1.0}), r"weights\['own'\] = -1.0"),
    ],
)
def test_wrong_own_targets_are_refused_in_words(target: Target, words: str) -> None:
    with pytest.raises(InputError, match=words):
        plan(ARM, target, PAPER)


def test_parameters_may_be_a_list() -> None:
    assert plan(ARM, Given([HEIGHTS[0]]), PAPER).reached


@pytest.mark.parametrize("kind", ["equality", "soft_residual", "inequality"])
def test_terms_without_a_value_are_missed(kind: str) -> None:
    """A target with the soft residual NaN counted as met."""
    undefined = Given([], lambda view: Terms(**{kind: {"own": ca.sqrt(-1 - view.tip[2] ** 2)}}))
    found = plan(ARM, undefined, PAPER, 20.0, starts=2)
    assert not found.reached
    assert "inf" in found.outcome


@dataclass(frozen=True)
class LimitedPull:
    """Constraints of a project: the limit of the total pull as a block."""

    limit: float

    def blocks(self, arm: Arm) -> tuple[Block, ...]:
        return (TotalPull(self.limit),)


class LimitedStrategy(Strategy):
    """A strategy with these constraints."""

    def constraints(self, problem: PlanningProblem) -> LimitedPull:
        return LimitedPull(LIMIT)


FREE = plan(ARM, TipPosition(tuple(SHAPE.tip)), PAPER, 20.0)
LIMIT = 0.98 * float(FREE.tensions.sum())


def test_constraints_of_a_strategy_enter_every_program() -> None:
    limited = plan(ARM, FREE.targets, PAPER, 20.0, limits=Limits(total_pull=LIMIT))
    strategy = LimitedStrategy()
    found = strategy.plan(FREE.problem, None)
    assert found.tensions.sum() == pytest.approx(limited.tensions.sum(), rel=1e-6)
    assert found.effort == pytest.approx(limited.effort, rel=1e-4)
    assert found.solution.avoidance == LimitedPull(LIMIT)
    assert found.reached
    assert isinstance(strategy.plan(FREE.problem, found), Plan)
