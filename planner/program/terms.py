"""The terms of several targets put together: stacked, named and weighted."""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Any

import casadi as ca

from model.arm import Arm
from planner.targets.base import ComplianceRequest, Target, Terms, View


class Same:
    """A value that a cache takes for equal to all others: its structure is compared instead."""

    def __init__(self, value: Any) -> None:
        self.value = value

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Same)

    def __hash__(self) -> int:
        return 0


HIGH_PRIORITY, LOW_PRIORITY = 1e2, 3e-4
# Of inequalities without a slack.
HARD = float("inf")
KINDS = ("equality", "soft_residual", "inequality", "objective")


def stations_of(arm: Arm, targets: tuple[Target, ...]) -> tuple[float, ...]:
    """Return all arc lengths that targets look at, once each."""
    return tuple(sorted({s for target in targets for s in target.stations(arm)}))


def compliance_requests(targets: tuple[Target, ...]) -> tuple[ComplianceRequest, ...]:
    """Return the looks at the tip's compliance of the targets that have one, in their order."""
    requests = (target.compliance_request() for target in targets)
    return tuple(request for request in requests if request is not None)


def directions_function(arm: Arm, targets: tuple[Target, ...]) -> ca.Function:
    """Return target numbers -> the directions (3, width) of each request."""
    numbers = _numbers(arm, targets)
    pairs = zip(targets, numbers, strict=True)
    directions = [
        target.directions(p) for target, p in pairs if target.compliance_request() is not None
    ]
    return ca.Function("directions", [ca.vertcat(*numbers)], directions)


def terms_function(arm: Arm, targets: tuple[Target, ...]) -> ca.Function:
    """Return (poses (7, K), target numbers, compliances) -> stacked terms.

    They are those of KINDS, each by target. Compliances are those of the requests, one below the
    other, each column by column.
    """
    stations = stations_of(arm, targets)
    poses = ca.MX.sym("poses", 7, len(stations))
    seen = {s: poses[:, i] for i, s in enumerate(stations)}
    numbers, compliances = _numbers(arm, targets), _compliances(targets)
    terms = [
        target.terms(View(arm, seen, compliance), p)
        for target, p, compliance in zip(targets, numbers, compliances, strict=True)
    ]
    flat = ca.vertcat(*(ca.vec(compliance) for compliance in compliances if compliance is not None))
    stacks = [_stack(terms, kind) for kind in KINDS]
    return ca.Function("terms", [poses, ca.vertcat(*numbers), flat], stacks)


def term_names(arm: Arm, targets: tuple[Target, ...]) -> tuple[list[str], ...]:
    """Return the name of each component of the terms, for each of KINDS."""
    terms = _symbolic_terms(arm, targets)
    return tuple(
        [
            name
            for term in terms
            for name, v in getattr(term, kind).items()
            for _ in range(v.numel())
        ]
        for kind in KINDS
    )


def term_units(arm: Arm, targets: tuple[Target, ...]) -> dict[str, str]:
    """Return by name the unit of those terms that have one, see Terms.units."""
    return {name: u for term in _symbolic_terms(arm, targets) for name, u in term.units.items()}


def equality_weights(arm: Arm, targets: tuple[Target, ...]) -> ca.DM:
    """Return the factor of each equality where not all can be had."""
    factors: dict[str, float] = {}
    for term in _symbolic_terms(arm, targets):
        factors |= {name: math.sqrt(weight) for name, weight in term.weights.items()}
        factors |= dict.fromkeys(term.high_priority, HIGH_PRIORITY)
    return ca.DM([factors.get(name, 1.0) for name in term_names(arm, targets)[0]])


def inequality_weights(arm: Arm, targets: tuple[Target, ...]) -> ca.DM:
    """Return the weight of each inequality's slack where not all can be met."""
    weights: dict[str, float] = {}
    for term in _symbolic_terms(arm, targets):
        weights |= dict.fromkeys(term.low_priority, LOW_PRIORITY) | dict.fromkeys(term.hard, HARD)
    return ca.DM([weights.get(name, HIGH_PRIORITY) for name in term_names(arm, targets)[2]])


def shares(arm: Arm, targets: tuple[Target, ...]) -> list[tuple[int, int]]:
    """Return which inequalities are shares of stiffnesses that are wanted; see Terms.shares.

    And the place among compliances of that over what is wanted, which may pass through 0.
    """
    names, pairs, place = iter(enumerate(term_names(arm, targets)[2])), [], 0
    for target, term in zip(targets, _symbolic_terms(arm, targets), strict=True):
        rows = [next(names) for value in term.inequality.values() for _ in range(value.numel())]
        pairs += [(row, place) for row, name in rows if name in term.shares]
        request = target.compliance_request()
        place += request.width**2 if request else 0
    return pairs


def _symbolic_terms(arm: Arm, targets: tuple[Target, ...]) -> list[Terms]:
    structure = tuple(target.structure(arm) for target in targets)
    return _terms_of(arm, structure, Same(targets))


@lru_cache(maxsize=4)
def _terms_of(arm: Arm, structure: tuple[object, ...], structured: Same) -> list[Terms]:
    targets = structured.value
    poses = {s: ca.MX.sym("pose", 7) for s in stations_of(arm, targets)}
    parts = zip(targets, _numbers(arm, targets), _compliances(targets), strict=True)
    return [target.terms(View(arm, poses, compliance), p) for target, p, compliance in parts]


def _numbers(arm: Arm, targets: tuple[Target, ...]) -> list[ca.MX]:
    """Return symbols for the numbers of each target."""
    return [ca.MX.sym("p", target.parameters(arm).size) for target in targets]


def _compliances(targets: tuple[Target, ...]) -> list[ca.MX | None]:
    """Return symbols for the compliance of each target's request, None for those without."""
    requests = [target.compliance_request() for target in targets]
    return [ca.MX.sym("compliance", r.width, r.width) if r else None for r in requests]


def _stack(terms: list[Terms], kind: str) -> ca.MX:
    return ca.vertcat(
        ca.MX(0, 1), *(value for term in terms for value in getattr(term, kind).values())
    )
