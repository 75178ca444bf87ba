"""The targets of a question together: what they look at, and their terms stacked and weighted."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from typing import Any

import casadi as ca
import numpy as np

from model.arm import Arm
from model.machine.functions import Buffered
from model.paths import Array
from model.shape import Shape
from model.stiffness import stiffness
from planner.avoidance.rows import Avoidance
from planner.targets.base import Target, View


@dataclass(frozen=True)
class Same:
    """A value that a cache takes for equal to all others: its structure is compared instead."""

    value: Any = field(compare=False)


HIGH_PRIORITY, LOW_PRIORITY = 1e2, 2e-4
KINDS = ("equality", "soft_residual", "inequality", "objective")


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
    structure : tuple
        What programs depend on besides the numbers.
    avoidance : Avoidance or None
        The inequalities among them that keep the arm clear.
    """

    def __init__(self, arm: Arm, each: tuple[Target, ...]) -> None:
        self.arm, self.each = arm, each
        every = frozenset(range(arm.n_tendons))
        self.stations = tuple(sorted({s for target in each for s in target.stations(arm)}))
        self.requests = tuple(filter(None, (target.compliance_request() for target in each)))
        self.tendons = every.intersection(*(target.tendons(arm) for target in each))
        self.numbers = np.concatenate([np.zeros(0), *(target.parameters(arm) for target in each)])
        self.structure = tuple(target.structure(arm) for target in each)
        self.avoidance = next((target for target in each if isinstance(target, Avoidance)), None)

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
        """Their terms, built once for all targets of one structure."""
        return _built(self.arm, self.structure, Same(self))

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
        """Return equalities, soft residuals, inequalities and objectives by name.

        Of poses (K, 7) at the stations, and compliances as above.
        """
        along = np.concatenate([np.zeros(0), *(C.ravel() for C in compliances)])
        measured = list[dict[str, Array]]()
        stacks = self.terms.dense(poses.ravel(), self.numbers, along)
        for kind, stack in zip(self.terms.names, stacks, strict=True):
            flat, names = stack.ravel(), np.array(kind)
            measured.append({name: flat[names == name] for name in dict.fromkeys(kind)})
        return tuple(measured)


class TargetTerms:
    """The terms of targets of one structure, as functions of the numbers of these.

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
    shares : list of (int, int)
        Which inequalities are shares of stiffnesses that are wanted, see Terms.shares; and the
        place among compliances of that over what is wanted, which may pass through 0.
    equality_weights, inequality_weights : (n,)
        The factor of each equality, and the weight of each inequality's slack, where not all can be
        had.
    units : dict
        By name the unit of those terms that have one, see Terms.units.
    """

    def __init__(self, of: Targets) -> None:
        self.requests = of.requests
        requests = [target.compliance_request() for target in of.each]
        numbers = [ca.MX.sym("p", target.parameters(of.arm).size) for target in of.each]
        poses = ca.MX.sym("poses", 7, len(of.stations))
        seen = dict(zip(of.stations, ca.horzsplit(poses), strict=True)) if of.stations else {}
        compliances = [ca.MX.sym("compliance", r.width, r.width) if r else None for r in requests]
        parts = zip(of.each, numbers, compliances, strict=True)
        terms = [target.terms(View(of.arm, seen, C), p) for target, p, C in parts]
        flat = ca.vertcat(*(ca.vec(C) for C in compliances if C is not None))
        stacks = [
            ca.vertcat(ca.MX(0, 1), *(v for term in terms for v in getattr(term, kind).values()))
            for kind in KINDS
        ]
        arguments = [poses, ca.vertcat(*numbers), flat]
        self.function = ca.Function("terms", arguments, stacks)
        self.dense = Buffered(ca.Function("terms", arguments, list(map(ca.densify, stacks))))
        triples = zip(of.each, numbers, requests, strict=True)
        directions = [target.directions(p) for target, p, request in triples if request]
        self.directions = ca.Function("directions", [ca.vertcat(*numbers)], directions)
        self.names = tuple(
            [
                name
                for term in terms
                for name, value in getattr(term, kind).items()
                for _ in range(value.numel())
            ]
            for kind in KINDS
        )
        self.count = len(self.names[0]) + len(self.names[1])
        factors, weights = dict[str, float](), dict[str, float]()
        self.shares, row, place = list[tuple[int, int]](), 0, 0
        for term, request in zip(terms, requests, strict=True):
            factors |= {name: math.sqrt(weight) for name, weight in term.weights.items()}
            factors |= dict.fromkeys(term.high_priority, HIGH_PRIORITY)
            weights |= dict.fromkeys(term.low_priority, LOW_PRIORITY)
            for name, value in term.inequality.items():
                if name in term.shares:
                    self.shares.append((row, place))
                row += value.numel()
            place += request.width**2 if request else 0
        self.equality_weights = np.array([factors.get(name, 1.0) for name in self.names[0]])
        self.inequality_weights = np.array([weights.get(n, HIGH_PRIORITY) for n in self.names[2]])
        self.units = {name: unit for term in terms for name, unit in term.units.items()}


@lru_cache(maxsize=64)
def _built(arm: Arm, structure: tuple[object, ...], targets: Same) -> TargetTerms:
    return TargetTerms(targets.value)
