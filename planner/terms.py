"""The terms of several targets put together: stacked, named and weighted."""

from __future__ import annotations

import casadi as ca

from model.arm import Arm
from planner.targets.base import Look, Target, Terms, View

FIRM, YIELDING = 1e2, 3e-4
KINDS = ("match", "approach", "margin", "least")


def stations_of(arm: Arm, targets: tuple[Target, ...]) -> tuple[float, ...]:
    """Return all arc lengths that targets look at, once each."""
    return tuple(sorted({s for target in targets for s in target.stations(arm)}))


def looks_of(arm: Arm, targets: tuple[Target, ...]) -> tuple[Look, ...]:
    """Return all compliances that targets look at, once each."""
    return tuple(sorted({look for target in targets for look in target.looks(arm)}))


def terms_function(arm: Arm, targets: tuple[Target, ...]) -> ca.Function:
    """Return (poses (7, K), target numbers, compliances (36, N)) -> stacked terms.

    They are match, approach, margin, least, each by target; a compliance is column by column.
    """
    stations = stations_of(arm, targets)
    poses = ca.MX.sym("poses", 7, len(stations))
    looks = looks_of(arm, targets)
    compliances = ca.MX.sym("compliances", 36, len(looks))
    seen = {look: ca.reshape(compliances[:, i], 6, 6) for i, look in enumerate(looks)}
    view = View(arm, {s: poses[:, i] for i, s in enumerate(stations)}, seen)
    numbers, found = [], []
    for target in targets:
        p = ca.MX.sym("p", target.parameters(arm).size)
        numbers.append(p)
        found.append(target.terms(view, p))
    stacks = [_stack(found, kind) for kind in KINDS]
    return ca.Function("terms", [poses, ca.vertcat(*numbers), compliances], stacks)


def term_names(arm: Arm, targets: tuple[Target, ...]) -> tuple[list[str], ...]:
    """Return the name of each component of match, approach, margin and least."""
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


def firmness(arm: Arm, targets: tuple[Target, ...]) -> ca.DM:
    """Return the weight of each component of match where not all can be had."""
    firm = {name for term in _symbolic_terms(arm, targets) for name in term.firm}
    return ca.DM([FIRM if name in firm else 1.0 for name in term_names(arm, targets)[0]])


def margin_firmness(arm: Arm, targets: tuple[Target, ...]) -> ca.DM:
    """Return the weight of what each component of margin lacks where not all can be had."""
    yielding = {name for term in _symbolic_terms(arm, targets) for name in term.yielding}
    names = term_names(arm, targets)[2]
    return ca.DM([YIELDING if name in yielding else FIRM for name in names])


def _symbolic_terms(arm: Arm, targets: tuple[Target, ...]) -> list[Terms]:
    seen = {look: ca.MX.sym("C", 6, 6) for look in looks_of(arm, targets)}
    view = View(arm, {s: ca.MX.sym("pose", 7) for s in stations_of(arm, targets)}, seen)
    return [t.terms(view, ca.MX.sym("p", t.parameters(arm).size)) for t in targets]


def _stack(terms: list[Terms], kind: str) -> ca.MX:
    return ca.vertcat(
        ca.MX(0, 1), *(value for term in terms for value in getattr(term, kind).values())
    )
