"""The target rows of the program, with slacks in its relaxed modes.

exact      equality = 0,  soft residual = 0,  inequality >= 0
closest    equality = 0,  inequality + s >= 0 for inequalities of low priority;
minimise |soft residual|^2 + |weight s|^2
nearest    inequality + s >= 0;
minimise |weight equality|^2 + |soft residual|^2 + |weight s|^2
"""

from __future__ import annotations

from dataclasses import dataclass, field

import casadi as ca
import numpy as np

from octoplan.model.paths import Array
from octoplan.planner.block import Block, Parts, ProgramView, Rows
from octoplan.planner.targets.target_set import HIGH_PRIORITY, LOW_PRIORITY, TargetSet, TargetTerms

EQUALITY = "equality"
INEQUALITY = "inequality"
# Priorities of the inequalities that have a slack.
_WITH_SLACK: dict[str, tuple[float, ...]] = {
    "exact": (),
    "closest": (LOW_PRIORITY,),
    "nearest": (LOW_PRIORITY, HIGH_PRIORITY),
}


@dataclass(frozen=True)
class TargetRows(Block):
    """The target rows; the decisions are the slacks.

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
