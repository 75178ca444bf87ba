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
from itertools import pairwise
from typing import TypeVar

import casadi as ca
import numpy as np

from model.arm import Arm
from model.stations import base_pose
from planner.avoidance.rows import avoidance_of
from planner.program.statement import Statement, smooth_norm
from planner.program.terms import HIGH_PRIORITY, LOW_PRIORITY, stations_of, terms_of
from planner.targets.base import Target

STRETCH, LEAST_STRETCH = "stretch", 1e-3
S = TypeVar("S", ca.SX, ca.MX)


@dataclass(frozen=True)
class Rows:
    """The rows of one kind of constraint."""

    name: str
    size: int
    lower: float
    upper: float


class Objective:
    """What targets and a statement make of a shape, whatever the mechanics behind it.

    Attributes
    ----------
    function : casadi.Function
        Tensions [N], peak, slacks, parameters, poses (7, K) at the stations that count, least
        stretches, compliances -> f, g without gaps.
    seen : list of int
        Which stations count.
    terms : TargetTerms
        The terms of the targets.
    n_numbers, n_own : int
        Number of parameters: target numbers, those of gaps, reference tension, limit of the total,
        trace; and of the first.
    rows : tuple of Rows
        What the rows of g are, in order, with those of the gaps.
    slack_rows : list of int
        The rows of inequalities with a slack.
    """

    def __init__(
        self, arm: Arm, targets: tuple[Target, ...], statement: Statement, thin: int
    ) -> None:
        self.statement = statement
        stations = stations_of(arm, targets)
        avoidance = avoidance_of(targets)
        # CasADi cannot differentiate compiled kernels.
        self._arm, self._gaps = arm, avoidance.gaps(arm, stations, False) if avoidance else None
        targets = tuple(target for target in targets if target is not avoidance)
        self.seen = [stations.index(s) for s in stations_of(arm, targets)]
        self.terms = terms_of(arm, targets)
        terms = self.terms.function
        self.n_own = terms.size1_in(1)
        n_gaps, n_gap_numbers = (self._gaps.n_g, self._gaps.n_p) if self._gaps else (0, 0)
        self.n_numbers = self.n_own + n_gap_numbers + 3
        n, K = arm.n_tendons, terms.size2_in(0)
        T, poses, least = ca.MX.sym("T", n), ca.MX.sym("poses", 7, K), ca.MX.sym("least", thin)
        p = ca.MX.sym("p", self.n_numbers)
        compliances = ca.MX.sym("compliances", terms.numel_in(2))
        soft = self._soft_rows(self.terms.inequality_weights())
        slack = ca.MX.sym("slack", len(soft))
        f, blocks, peak = self._stated(targets, soft, (T, slack, p, poses, least, compliances))
        self.rows = tuple(Rows(name, g.numel(), lo, hi) for name, g, lo, hi in blocks)
        self.rows = (*self.rows[:2], Rows("clear", n_gaps, 0.0, np.inf), *self.rows[2:])
        self.n_peak, self.n_slack = peak.numel(), slack.numel()
        self.slack_rows = [self.rows[0].size + row for row in soft]
        g = ca.vertcat(*(g for _, g, _, _ in blocks))
        arguments = [T, peak, slack, p, poses, least, compliances]
        self.function = ca.Function("objective", arguments, [f, g])

    def gaps(self, poses: ca.MX, p: ca.MX) -> ca.MX:
        """Return how much farther off than they have to be places are, over L.

        Of poses (7, K) at all stations, and of the numbers of the objective.
        """
        if self._gaps is None:
            return ca.MX(0, 1)
        arm = self._arm
        all_poses = ca.vertcat(ca.DM(base_pose(arm)), ca.vec(poses))
        return self._gaps.value.function(all_poses, p[self.n_own : -3]) / arm.length

    def with_gaps(self, rows: ca.MX, gaps: ca.MX) -> ca.MX:
        """Return rows (m,) of `function` and those of the gaps in their places."""
        k = self.rows[0].size + self.rows[1].size
        # Of a single row CasADi would read one index as that of a column.
        return ca.vertcat(rows[:k, :], gaps, rows[k:, :])

    def _stated(
        self,
        targets: tuple[Target, ...],
        soft_rows: list[int],
        symbols: tuple[ca.MX, ...],
    ) -> tuple[ca.MX, list[tuple[str, ca.MX, float, float]], ca.MX]:
        T, slack, p, poses, thin, compliances = symbols
        target, (reference, total, trace) = p[: self.n_own], ca.vertsplit(p[-3:])
        equality, soft_residual, inequality, least = self.terms.function(poses, target, compliances)
        for row, place in self.terms.shares(targets):
            inequality[row] = 1 - compliances[place]
        effort, peak, peaks = smooth_norm(T / reference, self.statement.norm)
        mode, none = self.statement.mode, ca.MX(0, 1)
        weights, slack_weights = (
            self.terms.equality_weights(),
            self.terms.inequality_weights()[soft_rows],
        )
        soft = ca.vertcat(weights * equality, slack_weights * slack) if mode == "nearest" else slack
        met = {"exact": ca.vertcat(equality, soft_residual), "closest": equality, "nearest": none}[
            mode
        ]
        gaps = ca.sumsqr(ca.vertcat(soft_residual, soft)) / 2
        blocks = [
            ("equality", met, 0.0, 0.0),
            (
                "inequality",
                inequality + ca.DM.eye(inequality.numel())[:, soft_rows] @ slack,
                0.0,
                np.inf,
            ),
            (STRETCH, thin, LEAST_STRETCH, np.inf),
            ("total pull", (total - ca.sum1(T)) / reference, 0.0, np.inf),
            ("peak", peaks, 0.0, np.inf),
        ]
        if not self.statement.limited:
            del blocks[3]
        aim = ca.sum1(least) + trace * effort if least.numel() else effort
        return aim if mode == "exact" else gaps + trace * aim, blocks, peak

    def _soft_rows(self, row_weights: ca.DM) -> list[int]:
        """Return which inequalities have a slack: none, those of low priority, or all."""
        kept = {"exact": (), "closest": (LOW_PRIORITY,), "nearest": (LOW_PRIORITY, HIGH_PRIORITY)}
        weights = np.array(row_weights).ravel()
        return [row for row, w in enumerate(weights) if w in kept[self.statement.mode]]


def split(p: S, sizes: tuple[int, ...]) -> list[S]:
    """Return the parts of parameters of given sizes."""
    ends = np.cumsum([0, *sizes]).tolist()
    return [p[a:b] for a, b in pairwise(ends)]
