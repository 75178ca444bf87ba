"""The terms of several targets put together: stacked, named and weighted."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any

import casadi as ca
import numpy as np

from model.arm import Arm
from model.machine.functions import Buffered
from model.paths import Array
from planner.targets.base import ComplianceRequest, Target, View


@dataclass(frozen=True)
class Same:
    """A value that a cache takes for equal to all others: its structure is compared instead."""

    value: Any = field(compare=False)


HIGH_PRIORITY, LOW_PRIORITY = 1e2, 3e-4
# Of inequalities without a slack.
HARD = float("inf")
KINDS = ("equality", "soft_residual", "inequality", "objective")


def stations_of(arm: Arm, targets: tuple[Target, ...]) -> tuple[float, ...]:
    """Return all arc lengths that targets look at, once each."""
    return tuple(sorted({s for target in targets for s in target.stations(arm)}))


def compliance_requests(targets: tuple[Target, ...]) -> tuple[ComplianceRequest, ...]:
    """Return the looks at the tip's compliance of the targets that have one, in their order."""
    return tuple(filter(None, (target.compliance_request() for target in targets)))


def target_numbers(arm: Arm, targets: tuple[Target, ...]) -> Array:
    """Return the numbers of targets, one after the other."""
    return np.concatenate([target.parameters(arm) for target in targets])


def structure_of(arm: Arm, targets: tuple[Target, ...]) -> tuple[object, ...]:
    """Return what programs for targets depend on besides their numbers."""
    return tuple(target.structure(arm) for target in targets)


def pulling_tendons(arm: Arm, targets: tuple[Target, ...]) -> frozenset[int]:
    """Return the tendons that every one of the targets lets pull."""
    return frozenset.intersection(*(target.tendons(arm) for target in targets))


class TargetTerms:
    """The terms of targets of one structure, as functions of the numbers of these; see terms_of.

    Attributes
    ----------
    function : casadi.Function
        (poses (7, K), target numbers, compliances) -> stacked terms, those of KINDS, each by
        target. Compliances are those of the requests, one below the other, each column by column.
    directions : casadi.Function
        Target numbers -> the directions (3, width) of each request.
    dense : Buffered
        `function` of numbers, with its zeros.
    count : int
        How many equalities and soft residuals there are.
    requests : tuple of ComplianceRequest
    names : tuple of list of str
        The name of each component of the terms, for each of KINDS.
    equality_weights, inequality_weights : (n,)
        The factor of each equality, and the weight of each inequality's slack, where not all can be
        had.
    units : dict
        By name the unit of those terms that have one, see Terms.units.
    """

    def __init__(self, arm: Arm, targets: tuple[Target, ...]) -> None:
        self.requests, stations = compliance_requests(targets), stations_of(arm, targets)
        requests = [target.compliance_request() for target in targets]
        numbers = [ca.MX.sym("p", target.parameters(arm).size) for target in targets]
        poses = ca.MX.sym("poses", 7, len(stations))
        seen = dict(zip(stations, ca.horzsplit(poses), strict=True)) if stations else {}
        compliances = [ca.MX.sym("compliance", r.width, r.width) if r else None for r in requests]
        parts = zip(targets, numbers, compliances, strict=True)
        self._terms = [target.terms(View(arm, seen, C), p) for target, p, C in parts]
        flat = ca.vertcat(*(ca.vec(C) for C in compliances if C is not None))
        stacks = [
            ca.vertcat(
                ca.MX(0, 1), *(v for term in self._terms for v in getattr(term, kind).values())
            )
            for kind in KINDS
        ]
        arguments = [poses, ca.vertcat(*numbers), flat]
        self.function = ca.Function("terms", arguments, stacks)
        self.dense = Buffered(ca.Function("terms", arguments, list(map(ca.densify, stacks))))
        triples = zip(targets, numbers, requests, strict=True)
        directions = [target.directions(p) for target, p, request in triples if request]
        self.directions = ca.Function("directions", [ca.vertcat(*numbers)], directions)
        self.names = tuple(
            [
                name
                for term in self._terms
                for name, value in getattr(term, kind).items()
                for _ in range(value.numel())
            ]
            for kind in KINDS
        )
        self.count = len(self.names[0]) + len(self.names[1])
        factors, weights = dict[str, float](), dict[str, float]()
        for term in self._terms:
            factors |= {name: math.sqrt(weight) for name, weight in term.weights.items()}
            factors |= dict.fromkeys(term.high_priority, HIGH_PRIORITY)
            weights |= dict.fromkeys(term.low_priority, LOW_PRIORITY)
            weights |= dict.fromkeys(term.hard, HARD)
        self.equality_weights = np.array([factors.get(name, 1.0) for name in self.names[0]])
        self.inequality_weights = np.array([weights.get(n, HIGH_PRIORITY) for n in self.names[2]])
        self.units = {name: unit for term in self._terms for name, unit in term.units.items()}

    def shares(self, targets: tuple[Target, ...]) -> list[tuple[int, int]]:
        """Return which inequalities are shares of stiffnesses that are wanted; see Terms.shares.

        And the place among compliances of that over what is wanted, which may pass through 0.
        """
        names, pairs, place = iter(enumerate(self.names[2])), list[tuple[int, int]](), 0
        for target, term in zip(targets, self._terms, strict=True):
            rows = [next(names) for value in term.inequality.values() for _ in range(value.numel())]
            pairs += [(row, place) for row, name in rows if name in term.shares]
            request = target.compliance_request()
            place += request.width**2 if request else 0
        return pairs


def terms_of(arm: Arm, targets: tuple[Target, ...]) -> TargetTerms:
    """Return the terms of targets, built once for all targets of one structure."""
    return _built(arm, structure_of(arm, targets), Same(targets))


@lru_cache(maxsize=64)
def _built(arm: Arm, structure: tuple[object, ...], targets: Same) -> TargetTerms:
    return TargetTerms(arm, targets.value)
