"""The targets of a planning problem together: stations, stacked terms, and rows of the program."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from typing import Any

import casadi as ca
import numpy as np

from octoplan.model.arm import Arm
from octoplan.model.paths import Array
from octoplan.model.shape import Shape
from octoplan.model.support.checks import finite_array, positive
from octoplan.model.support.errors import Described, InputError
from octoplan.model.support.machine.functions import BatchFunction, BufferedFunction
from octoplan.planner.block import Block, Parts, ProgramView, Rows
from octoplan.planner.targets.base import ComplianceRequest, Target, Terms, View

# Kinds of rows.
EQUALITY = "equality"
INEQUALITY = "inequality"
# Weights of equalities, and of the slacks of inequalities, of high and of low priority.
HIGH_PRIORITY = 1e2
LOW_PRIORITY = 2e-4
# Priorities of the inequalities that have a slack.
_WITH_SLACK: dict[str, tuple[float, ...]] = {
    "exact": (),
    "closest": (LOW_PRIORITY,),
    "nearest": (LOW_PRIORITY, HIGH_PRIORITY),
}
# Kinds of terms, in the order of the results of `TargetTerms.function`.
KINDS = ("equality", "soft_residual", "inequality", "objective")
# Value of each kind in place of NaN, so that a term without a value is missed.
_WORST = (np.inf, np.inf, -np.inf, np.inf)
# CasADi functions whose serialised text states the whole computation. Other functions call Python
# or a library, which the text does not show.
_TRANSPARENT = {"SXFunction", "MXFunction", "Map", "LinearInterpolant", "BSplineInterpolant"}


class TargetSet:
    """The targets of a planning problem on an arm.

    Attributes
    ----------
    arm : Arm
    each : tuple of Target
    stations : tuple of float
        Arc lengths of all poses that the targets use, in ascending order [m].
    requests : tuple of ComplianceRequest
        Requests of the targets that have one, in their order.
    tendons : frozenset of int
        Tendons that every target allows to pull.
    numbers : (n,)
        Parameters of all targets.
    """

    def __init__(self, arm: Arm, each: tuple[Target, ...]) -> None:
        self.arm = arm
        self.each = each
        stations = set[float]()
        requests = list[ComplianceRequest]()
        tendons = frozenset(range(arm.n_tendons))
        numbers = [np.zeros(0)]
        for target in each:
            stations.update(target.stations(arm))
            request = target.compliance_request()
            if request is not None:
                requests.append(request)
            tendons &= target.tendons(arm)
            numbers.append(parameters_of(arm, target))
        self.stations = tuple(sorted(stations))
        self.requests = tuple(requests)
        self.tendons = tendons
        self.numbers = np.concatenate(numbers)

    def __reduce__(self) -> tuple[Any, ...]:
        """Return what pickle stores: the targets, without the functions made of them."""
        return TargetSet, (self.arm, self.each)

    @cached_property
    def terms(self) -> TargetTerms:
        """The terms; equal for target sets with equal expressions."""
        return TargetTerms(self)

    @property
    def conditions(self) -> float:
        """The number of equalities and soft residuals; infinite with inequalities."""
        return np.inf if self.terms.names[2] else self.terms.count

    @cached_property
    def directions(self) -> list[Array]:
        """The directions (3, width) of each request."""
        return [np.array(D) for D in self.terms.directions.call([self.numbers])]

    def compliances(self, shape: Shape, release: bool = False) -> list[Array]:
        """Return the compliance (width, width) of the tip for each request, see tip_compliance."""
        pairs = zip(self.requests, self.directions, strict=True)
        return [tip_compliance(shape, request, D, release) for request, D in pairs]

    def values(self, poses: Array, compliances: Sequence[Array]) -> tuple[dict[str, Array], ...]:
        """Return equalities, soft residuals, inequalities and objectives by name.

        They are evaluated from the targets themselves, not by the functions of a program.

        Parameters
        ----------
        poses : (K, 7)
            Poses at the stations.
        compliances : list of (width, width)
            See `compliances`.
        """
        numbers = [ca.MX(ca.DM(parameters_of(self.arm, target))) for target in self.each]
        stacks = _Stacks(
            self, ca.MX(ca.DM(poses.T)), numbers, [ca.MX(ca.DM(C)) for C in compliances]
        )
        results = list[dict[str, Array]]()
        kinds = stacks.with_reciprocals(lambda x: 1 / x - 1)
        for kind, worst in zip(kinds, _WORST, strict=True):
            columns = dict[str, list[ca.MX]]()
            for name, value in kind:
                columns.setdefault(name, []).append(value)
            results.append(
                {name: _without_nan(ca.vertcat(*each), worst) for name, each in columns.items()}
            )
        return tuple(results)


def _without_nan(expression: ca.MX, worst: float) -> Array:
    """Return the value of an expression without symbols (n,), with `worst` in place of NaN."""
    value = np.array(ca.evalf(expression)).ravel()
    return np.where(np.isnan(value), worst, value)


def tip_compliance(
    shape: Shape, request: ComplianceRequest, directions: Array, release: bool = False
) -> Array:
    """Return the compliance D^T C D (width, width) of the tip along directions D (3, width) [m/N].

    With constant lengths all tendons are locked, as in the program; or those without tension are
    released, as `stiffness` does by default.
    """
    from octoplan.model.stiffness import stiffness

    k = stiffness(
        shape.arm,
        shape.tensions,
        shape.scene,
        request.hold,
        accuracy=1e-8,
        tendon_EA=request.tendon_EA,
        release=release,
        compile=shape.machine_code,
    )
    return np.asarray(directions.T @ k.compliance[:3, :3] @ directions)


def parameters_of(arm: Arm, target: Target) -> Array:
    """Return the parameters of a target (n,); raise InputError unless they are finite numbers."""
    return finite_array(f"{type(target).__name__}.parameters", target.parameters(arm), (None,))


def checked_terms(target: Target, view: View, numbers: ca.MX) -> Terms:
    """Return the terms of a target; raise InputError unless all are columns of expressions."""
    terms = target.terms(view, numbers)
    name = f"{type(target).__name__}.terms"
    if not isinstance(terms, Terms):
        raise InputError(name, terms, "Terms")
    for kind in (*KINDS, "reciprocal"):
        for term, value in getattr(terms, kind).items():
            if not (isinstance(value, ca.MX) and value.is_column() and value.is_dense()):
                allowed = "a dense casadi.MX of one column"
                raise InputError(f"{name}: {kind}[{term!r}]", value, allowed)
    for term, weight in terms.weights.items():
        positive(f"{name}: weights[{term!r}]", weight)
    return terms


class _Stacks:
    """The terms of the targets of a set as expressions.

    Attributes
    ----------
    each : list of Terms
        The terms of each target.
    """

    def __init__(
        self,
        targets: TargetSet,
        poses: ca.MX,
        numbers: Sequence[ca.MX],
        compliances: Sequence[ca.MX],
    ) -> None:
        columns = ca.horzsplit(poses) if targets.stations else []
        at_stations = dict(zip(targets.stations, columns, strict=True))
        left = iter(compliances)
        self.each = list[Terms]()
        for target, p in zip(targets.each, numbers, strict=True):
            compliance = next(left) if target.compliance_request() else None
            view = View(targets.arm, at_stations, compliance)
            self.each.append(checked_terms(target, view, p))

    def with_reciprocals(
        self, inequality: Callable[[ca.MX], ca.MX]
    ) -> tuple[list[tuple[str, ca.MX]], ...]:
        """Return names and expressions of each of KINDS, target by target.

        `inequality` turns a reciprocal into a quantity that must be nonnegative.
        """
        stacks: tuple[list[tuple[str, ca.MX]], ...] = ([], [], [], [])
        for terms in self.each:
            stacks[0].extend(terms.equality.items())
            stacks[1].extend(terms.soft_residual.items())
            stacks[2].extend(terms.inequality.items())
            for name, x in terms.reciprocal.items():
                stacks[2].append((name, inequality(x)))
            stacks[3].extend(terms.objective.items())
        return stacks


class TargetTerms:
    """The terms of targets as functions of their parameters; equal if the expressions are equal.

    Attributes
    ----------
    function : casadi.Function
        (poses (7, K), target parameters, compliances) -> stacked terms of each of KINDS, target by
        target. Compliances of all requests are stacked, each column by column.
    directions : casadi.Function
        Target parameters -> the directions (3, width) of each request.
    count : int
        Number of equalities and soft residuals.
    requests : tuple of ComplianceRequest
    names : tuple of list of str
        The name of each component of the terms, for each of KINDS.
    equality_weights, inequality_weights : (n,)
        In the mode nearest, the factor of each equality, and the weight of the slack of each
        inequality.
    units : dict
        Unit by name, for terms that have one, see Terms.units.
    """

    def __init__(self, targets: TargetSet) -> None:
        arm = targets.arm
        numbers = [ca.MX.sym("p", parameters_of(arm, target).size) for target in targets.each]
        poses = ca.MX.sym("poses", 7, len(targets.stations))
        compliances = [ca.MX.sym("compliance", r.width, r.width) for r in targets.requests]
        stacks = _Stacks(targets, poses, numbers, compliances)
        names = list[list[str]]()
        expressions = list[ca.MX]()
        for kind in stacks.with_reciprocals(lambda x: 1 - x):
            names.append([])
            stacked = ca.MX(0, 1)
            for name, value in kind:
                names[-1] += [name] * value.numel()
                stacked = ca.vertcat(stacked, value)
            expressions.append(stacked)
        self.names = tuple(names)
        p = ca.vertcat(*numbers)
        flat = ca.vertcat(*map(ca.vec, compliances))
        self.function = ca.Function("terms", [poses, p, flat], expressions, {"allow_free": True})
        if self.function.has_free():
            free = Described(self.function.get_free())
            raise InputError("target", free, "terms of poses and parameters, without other symbols")
        pairs = zip(targets.each, numbers, strict=True)
        directions = [target.directions(p) for target, p in pairs if target.compliance_request()]
        self.directions = ca.Function("directions", [p], directions)
        self.requests = targets.requests
        self.count = len(self.names[0]) + len(self.names[1])
        factors = dict[str, float]()
        weights = dict[str, float]()
        self.units = dict[str, str]()
        for term in stacks.each:
            factors |= {name: math.sqrt(weight) for name, weight in term.weights.items()}
            factors |= dict.fromkeys(term.high_priority, HIGH_PRIORITY)
            weights |= dict.fromkeys(term.low_priority, LOW_PRIORITY)
            self.units |= term.units
        self.equality_weights = np.array([factors.get(name, 1.0) for name in self.names[0]])
        self.inequality_weights = np.array([weights.get(n, HIGH_PRIORITY) for n in self.names[2]])
        self._key = (
            _text(self.function),
            _text(self.directions),
            self.requests,
            tuple(map(tuple, self.names)),
            tuple(self.equality_weights.tolist()),
            tuple(self.inequality_weights.tolist()),
            tuple(self.units.items()),
        )

    @cached_property
    def dense(self) -> BufferedFunction:
        """`function` with dense results, for numbers."""
        arguments = self.function.mx_in()
        values = self.function.call(arguments, True, False)
        return BufferedFunction(ca.Function("terms", arguments, list(map(ca.densify, values))))

    def __eq__(self, other: object) -> bool:
        return isinstance(other, TargetTerms) and self._key == other._key

    def __hash__(self) -> int:
        return hash(self._key)


@dataclass(frozen=True)
class TargetRows(Block):
    """The target rows of the program; the decisions are the slacks s of the modes with misses.

    exact      equality = 0,  soft residual = 0,  inequality >= 0
    closest    equality = 0,  inequality + s >= 0 for inequalities of low priority;
               minimise |soft residual|^2 + |s|^2
    nearest    inequality + s >= 0;
               minimise |weight equality|^2 + |soft residual|^2 + |weight s|^2

    Attributes
    ----------
    terms : TargetTerms
    at : tuple of float
        Stations of the targets [m].
    mode : "exact", "closest" or "nearest"
    numbers : (n,)
        Parameters of the targets.
    """

    terms: TargetTerms
    at: tuple[float, ...]
    mode: str
    numbers: Array = field(compare=False)

    @classmethod
    def of(cls, targets: TargetSet, mode: str) -> TargetRows:
        """Return the rows of targets in a mode."""
        return cls(targets.terms, targets.stations, mode, targets.numbers)

    @property
    def with_slack(self) -> list[int]:
        """The inequalities that have a slack."""
        weights = self.terms.inequality_weights
        return np.flatnonzero(np.isin(weights, _WITH_SLACK[self.mode])).tolist()

    @property
    def n_decisions(self) -> int:
        """See Block."""
        return len(self.with_slack)

    @property
    def n_parameters(self) -> int:
        """See Block."""
        return int(self.terms.function.numel_in(1))

    def parameters(self) -> Array:
        """Return the parameters of the targets."""
        return self.numbers

    def slack_rows(self) -> tuple[str, list[int]]:
        """See Block."""
        return INEQUALITY, self.with_slack

    def stations(self) -> tuple[float, ...]:
        """See Block."""
        return self.at

    def parts(self, view: ProgramView) -> Parts:
        """Return the rows, misses and objectives of the mode."""
        poses = ca.horzcat(ca.MX(7, 0), *(view.poses[s] for s in self.at))
        expressions = self.terms.function(poses, view.parameters, view.compliances)
        equality, soft_residual, inequality, objective = expressions
        some = self.with_slack
        inequality += ca.DM.eye(inequality.numel())[:, some] @ view.decisions
        if self.mode == "exact":
            rows = [Rows(EQUALITY, ca.vertcat(equality, soft_residual), 0.0, 0.0)]
            return Parts([*rows, Rows(INEQUALITY, inequality)], objectives=[objective])
        rows = [Rows(INEQUALITY, inequality)]
        misses = [soft_residual]
        if self.mode == "closest":
            rows.insert(0, Rows(EQUALITY, equality, 0.0, 0.0))
            misses.append(view.decisions)
        else:
            misses.append(ca.DM(self.terms.equality_weights) * equality)
            misses.append(ca.DM(self.terms.inequality_weights[some]) * view.decisions)
        return Parts(rows, misses, [objective])


@lru_cache(maxsize=16)
def residual_function(terms: TargetTerms) -> BatchFunction:
    """Return the function (poses (7 K,), target parameters) -> residuals (k,), without calls.

    The residuals are equalities, soft residuals and violations of inequalities, for compliances
    that have the wanted values.
    """
    poses, numbers = (ca.MX.sym("given", *terms.function.size_in(i)) for i in range(2))
    wanted = ca.vertcat(ca.DM(0, 1), *(ca.vec(ca.DM.eye(each.width)) for each in terms.requests))
    equality, soft_residual, inequality, _ = terms.function(poses, numbers, wanted)
    gaps = ca.densify(ca.vertcat(equality, soft_residual, ca.fmin(inequality, 0)))
    function = ca.Function("gaps", [poses, numbers], [gaps])
    arguments = function.sx_in()
    return BatchFunction(ca.Function("gaps", arguments, function.call(arguments), {"cse": True}))


def _text(function: ca.Function) -> object:
    """Return a text that states the whole computation of a function.

    Return an object that equals itself alone if the function calls Python or a library.
    """
    called = [function, *function.find_functions()]
    if all(each.class_name() in _TRANSPARENT for each in called):
        return function.serialize()
    return object()
