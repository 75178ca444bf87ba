"""What targets and a statement make of a shape: an objective, and rows of constraints.

    minimise    what the mode says
    subject to  inequalities >= 0             1 + q >= least stretch
                total pull <= limit

Targets have equalities and soft residuals, which are to be 0 as well as the limits allow. The modes
are three readings of them, tried in this order:

    exact      equalities = 0 and soft residuals = 0; effort is made least
    closest    equalities = 0; soft residuals, and slacks of inequalities of low priority, are made
               least, with a regularisation weight on effort
    nearest    equalities, soft residuals and slacks of all inequalities are made least, those of
               high priority first
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import casadi as ca
import numpy as np

from planner.program.statement import Mode, Statement
from planner.program.terms import HIGH_PRIORITY, LOW_PRIORITY, TargetTerms
from planner.targets.base import Target

STRETCH, LEAST_STRETCH = "stretch", 1e-3


@dataclass(frozen=True)
class Rows:
    """The rows of one kind of constraint."""

    name: str
    size: int
    lower: float = 0.0
    upper: float = np.inf


class Seen(NamedTuple):
    """What objective and rows are made of, in CasADi's symbols.

    Attributes
    ----------
    tensions, peak, slacks
        [N], over the reference tension, and of the inequalities of `soft_rows`.
    numbers
        Of the targets.
    reference, total, trace
        The reference tension [N], the limit of the total pull [N], the weight of effort.
    poses : (7, K)
        At the stations of the targets.
    stretches, compliances
        Least stretches 1 + q, and compliances as the targets' terms take them.
    gaps
        How much farther off than they have to be places are, over L.
    """

    tensions: ca.MX
    peak: ca.MX
    slacks: ca.MX
    numbers: ca.MX
    reference: ca.MX
    total: ca.MX
    trace: ca.MX
    poses: ca.MX
    stretches: ca.MX
    compliances: ca.MX
    gaps: ca.MX


def soft_rows(terms: TargetTerms, mode: Mode) -> list[int]:
    """Return which inequalities have a slack: none, those of low priority, or all."""
    kept = {"exact": (), "closest": (LOW_PRIORITY,), "nearest": (LOW_PRIORITY, HIGH_PRIORITY)}[mode]
    weights = np.array(terms.inequality_weights()).ravel()
    return [row for row, weight in enumerate(weights) if weight in kept]


def stated(
    statement: Statement, targets: tuple[Target, ...], terms: TargetTerms, seen: Seen
) -> tuple[ca.MX, ca.MX, tuple[Rows, ...]]:
    """Return the objective, the constraints, and what their rows are, in order."""
    mode, none, pull = statement.mode, ca.MX(0, 1), seen.tensions / seen.reference
    met, missed, inequality, least = terms.function(seen.poses, seen.numbers, seen.compliances)
    for row, place in terms.shares(targets):
        inequality[row] = 1 - seen.compliances[place]
    soft, weights = soft_rows(terms, mode), terms.inequality_weights()
    inequality += ca.DM.eye(inequality.numel())[:, soft] @ seen.slacks
    slacks = seen.slacks
    if mode == "nearest":
        slacks = ca.vertcat(terms.equality_weights() * met, weights[soft] * slacks)
    equality = {"exact": ca.vertcat(met, missed), "closest": met, "nearest": none}[mode]
    effort = {"2": ca.sumsqr(pull) / 2, "1": ca.sum1(pull), "inf": seen.peak}[statement.norm]
    aim = ca.sum1(least) + seen.trace * effort if least.numel() else effort
    f = aim if mode == "exact" else ca.sumsqr(ca.vertcat(missed, slacks)) / 2 + seen.trace * aim
    left = (seen.total - ca.sum1(seen.tensions)) / seen.reference
    parts: dict[str, ca.MX] = {
        "equality": equality,
        "inequality": inequality,
        "clear": seen.gaps,
        STRETCH: seen.stretches,
        "total pull": left if statement.limited else none,
        "peak": seen.peak - pull if seen.peak.numel() else none,
    }
    bounds = {"equality": (0.0, 0.0), STRETCH: (LEAST_STRETCH, np.inf)}
    rows = tuple(Rows(name, g.numel(), *bounds.get(name, ())) for name, g in parts.items())
    return f, ca.MX(ca.vertcat(*parts.values())), rows
