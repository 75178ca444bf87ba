"""The targets of a question together: what they look at, and their terms stacked and weighted."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np

from octoplan.model.arm import Arm
from octoplan.model.paths import Array
from octoplan.model.shape import Shape
from octoplan.model.stiffness import stiffness
from octoplan.model.support.errors import InputError
from octoplan.model.support.machine.functions import BufferedFunction
from octoplan.planner.extensions.avoidance.rows import AvoidanceStructure, ClearanceConstraints
from octoplan.planner.targets.base import Target, Terms, View

HIGH_PRIORITY, LOW_PRIORITY = 1e2, 2e-4
KINDS = ("equality", "soft_residual", "inequality", "objective")
# Functions whose serialised text states all that they compute. Others call back into Python or
# into a library, which the text does not show.
_TRANSPARENT = {"SXFunction", "MXFunction", "Map", "LinearInterpolant", "BSplineInterpolant"}


@dataclass(frozen=True)
class TargetStructure:
    """What a program depends on of its targets, besides their numbers.

    Attributes
    ----------
    stations : tuple of float
        All arc lengths at which targets see the arm [m].
    seen : tuple of int
        Which of them the targets see that do not keep the arm clear.
    terms : TargetTerms
        The terms of the latter.
    avoidance : AvoidanceStructure or None
        Inequalities that keep the arm clear, if there are any.
    """

    stations: tuple[float, ...]
    seen: tuple[int, ...]
    terms: TargetTerms
    avoidance: AvoidanceStructure | None


class Targets:
    """The targets of a question, seen as one on an arm.

    Attributes
    ----------
    arm : Arm
    each : tuple of Target
    stations : tuple of float
        All arc lengths that they look at, once each [m].
    requests : tuple of ComplianceRequest
        Of those that have one, in their order.
    tendons : frozenset of int
        That every one of them lets pull.
    numbers : (n,)
        Their parameters, one after the other.
    avoidance : ClearanceConstraints or None
        The inequalities among them that keep the arm clear.
    """

    def __init__(self, arm: Arm, each: tuple[Target, ...]) -> None:
        self.arm, self.each = arm, each
        every = frozenset(range(arm.n_tendons))
        self.stations = tuple(sorted({s for target in each for s in target.stations(arm)}))
        self.requests = tuple(filter(None, (target.compliance_request() for target in each)))
        self.tendons = every.intersection(*(target.tendons(arm) for target in each))
        self.numbers = np.concatenate([np.zeros(0), *(target.parameters(arm) for target in each)])
        self.avoidance = next(
            (target for target in each if isinstance(target, ClearanceConstraints)), None
        )

    def __reduce__(self) -> tuple[Any, ...]:
        """Return what travels by pickle: the targets, without the functions made of them."""
        return Targets, (self.arm, self.each)

    @cached_property
    def own(self) -> Targets:
        """Those that ask for a shape, without what keeps the arm clear."""
        if self.avoidance is None:
            return self
        return Targets(self.arm, tuple(t for t in self.each if t is not self.avoidance))

    @cached_property
    def terms(self) -> TargetTerms:
        """Their terms, which are equal for targets whose expressions are."""
        return TargetTerms(self.arm, self.each, self.stations)

    @cached_property
    def structure(self) -> TargetStructure:
        """What programs depend on besides the numbers."""
        seen = tuple(self.stations.index(s) for s in self.own.stations)
        clear = None if self.avoidance is None else self.avoidance.structure(self.arm)
        return TargetStructure(self.stations, seen, self.own.terms, clear)

    @property
    def conditions(self) -> float:
        """How many numbers are to be met; infinite where others are to be kept above 0."""
        return np.inf if self.terms.names[2] else self.terms.count

    @cached_property
    def directions(self) -> list[Array]:
        """The directions (3, width) of each request."""
        return [np.array(D) for D in self.terms.directions.call([self.numbers])]

    def compliances(self, shape: Shape, release: bool = False) -> list[Array]:
        """Return the tip's compliance (width, width) along the directions of each request.

        With lengths held all tendons are locked, as the program's responses have them; or those
        without tension `release`d, as stiffness has it by default.
        """
        compliances = list[Array]()
        for request, D in zip(self.requests, self.directions, strict=True):
            k = stiffness(
                self.arm,
                shape.tensions,
                shape.scene,
                request.hold,
                accuracy=1e-8,
                tendon_EA=request.tendon_EA,
                release=release,
                compile=shape.machine_code,
            )
            compliances.append(D.T @ k.compliance[:3, :3] @ D)
        return compliances

    def values(self, poses: Array, compliances: Sequence[Array]) -> tuple[dict[str, Array], ...]:
        """Return the equalities, soft residuals, inequalities and objectives by name.

        They are evaluated from the targets themselves, not by the functions of a program, at poses
        (K, 7) at the stations and at compliances as above.
        """
        seen = dict(zip(self.stations, ca.horzsplit(ca.MX(ca.DM(poses.T))), strict=True))
        matrices = iter(compliances)
        stacks = [dict[str, list[ca.MX]]() for _ in KINDS]
        for target in self.each:
            request = target.compliance_request()
            compliance = ca.MX(ca.DM(next(matrices))) if request else None
            numbers = ca.MX(ca.DM(target.parameters(self.arm)))
            terms = checked_terms(target, View(self.arm, seen, compliance), numbers)
            kinds = _by_kind(terms, {name: 1 / x - 1 for name, x in terms.reciprocal.items()})
            for stack, values in zip(stacks, kinds, strict=True):
                for name, value in values.items():
                    stack.setdefault(name, []).append(value)
        return tuple(
            {name: np.array(ca.evalf(ca.vertcat(*v))).ravel() for name, v in stack.items()}
            for stack in stacks
        )


def checked_terms(target: Target, view: View, numbers: ca.MX) -> Terms:
    """Return the terms of a target; raises InputError unless all are columns of expressions."""
    terms, name = target.terms(view, numbers), f"{type(target).__name__}.terms"
    if not isinstance(terms, Terms):
        raise InputError(name, terms, "Terms")
    for kind in (*KINDS, "reciprocal"):
        for term, value in getattr(terms, kind).items():
            if not (isinstance(value, ca.MX) and value.is_column() and value.is_dense()):
                allowed = "a dense casadi.MX of one column"
                raise InputError(f"{name}: {kind}[{term!r}]", value, allowed)
    return terms


def _by_kind(terms: Terms, reciprocal: Mapping[str, ca.MX]) -> tuple[Mapping[str, ca.MX], ...]:
    """Return the terms of each of KINDS by name, inequalities with those of reciprocals last."""
    inequality = {**terms.inequality, **reciprocal}
    return terms.equality, terms.soft_residual, inequality, terms.objective


class TargetTerms:
    """The terms of targets as functions of their numbers; equal if the expressions are.

    Attributes
    ----------
    function : casadi.Function
        (poses (7, K), target numbers, compliances) -> stacked terms, those of KINDS, each by
        target. Compliances are those of the requests, one below the other, each column by column.
    directions : casadi.Function
        Target numbers -> the directions (3, width) of each request.
    count : int
        Number of equalities and soft residuals.
    requests : tuple of ComplianceRequest
    names : tuple of list of str
        The name of each component of the terms, for each of KINDS.
    equality_weights, inequality_weights : (n,)
        The factor of each equality, and the weight of each inequality's slack, if not all of them
        can be met.
    units : dict
        By name the unit of those terms that have one, see Terms.units.
    """

    def __init__(self, arm: Arm, each: Sequence[Target], stations: Sequence[float]) -> None:
        requests = [target.compliance_request() for target in each]
        numbers = [ca.MX.sym("p", target.parameters(arm).size) for target in each]
        poses = ca.MX.sym("poses", 7, len(stations))
        seen = dict(zip(stations, ca.horzsplit(poses), strict=True)) if stations else {}
        compliances = [ca.MX.sym("compliance", r.width, r.width) if r else None for r in requests]
        parts = zip(each, numbers, compliances, strict=True)
        terms = [checked_terms(target, View(arm, seen, C), p) for target, p, C in parts]
        by_kind = [
            _by_kind(term, {name: 1 - x for name, x in term.reciprocal.items()}) for term in terms
        ]
        # Without targets, a kind has no terms.
        kinds = [[values[k] for values in by_kind] for k in range(len(KINDS))]
        stacks = [
            ca.vertcat(ca.MX(0, 1), *(value for values in kind for value in values.values()))
            for kind in kinds
        ]
        flat = ca.vertcat(*(ca.vec(C) for C in compliances if C is not None))
        p = ca.vertcat(*numbers)
        self.function = ca.Function("terms", [poses, p, flat], stacks)
        triples = zip(each, numbers, requests, strict=True)
        directions = [target.directions(p) for target, p, request in triples if request]
        self.directions = ca.Function("directions", [p], directions)
        self.requests = tuple(filter(None, requests))
        self.names = tuple(
            [
                name
                for values in kind
                for name, value in values.items()
                for _ in range(value.numel())
            ]
            for kind in kinds
        )
        self.count = len(self.names[0]) + len(self.names[1])
        factors = dict[str, float]()
        weights = dict[str, float]()
        for term in terms:
            factors |= {name: math.sqrt(weight) for name, weight in term.weights.items()}
            factors |= dict.fromkeys(term.high_priority, HIGH_PRIORITY)
            weights |= dict.fromkeys(term.low_priority, LOW_PRIORITY)
        self.equality_weights = np.array([factors.get(name, 1.0) for name in self.names[0]])
        self.inequality_weights = np.array([weights.get(n, HIGH_PRIORITY) for n in self.names[2]])
        self.units = {name: unit for term in terms for name, unit in term.units.items()}
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
        """`function` of numbers, with its zeros."""
        arguments = self.function.mx_in()
        values = self.function.call(arguments, True, False)
        return BufferedFunction(ca.Function("terms", arguments, list(map(ca.densify, values))))

    def __eq__(self, other: object) -> bool:
        return isinstance(other, TargetTerms) and self._key == other._key

    def __hash__(self) -> int:
        return hash(self._key)


def _text(function: ca.Function) -> object:
    """Return a text that states all that a function computes.

    Return an object that equals itself alone if the function calls Python or a library.
    """
    called = [function, *function.find_functions()]
    if all(each.class_name() in _TRANSPARENT for each in called):
        return function.serialize()
    return object()
