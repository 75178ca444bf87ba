"""What targets and a statement make of a shape: an objective, and rows of constraints.

    minimise    what the mode says
    subject to  inequalities >= 0             1 + q >= least stretch
                total pull <= limit

Targets have equalities and soft residuals, which are to be 0 as well as the limits allow. The modes
are three readings of them, tried in this order:

    exact      equalities = 0 and soft residuals = 0; effort is made least
    closest    equalities = 0; soft residuals, and what inequalities of low priority lack, are made
               least, with a regularisation weight on effort
    nearest    equalities, soft residuals and what all inequalities lack are made least, those of
               high priority first
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise
from typing import TypeVar

import casadi as ca
import numpy as np

from model.arm import Arm
from model.stations import base_pose
from model.transcription.layout import POSE
from model.transcription.terms import Equations
from planner.avoidance.rows import Avoidance
from planner.program.statement import Statement, smooth_norm
from planner.program.terms import (
    HIGH_PRIORITY,
    LOW_PRIORITY,
    Same,
    compliance_requests,
    directions_function,
    equality_weights,
    inequality_weights,
    shares,
    stations_of,
    terms_function,
)
from planner.targets.base import Target


@dataclass(frozen=True, eq=False)
class Gaps:
    """How much farther off than they have to be places are, over L, of poses (7, K) at stations.

    Attributes
    ----------
    equations : Equations or None
        See Avoidance.gaps; None where nothing is to be kept clear of.
    base : (7,)
        The pose that the arm is clamped at.
    """

    equations: Equations | None
    base: ca.DM
    length: float

    @classmethod
    def of(
        cls, arm: Arm, avoidance: Avoidance | None, stations: tuple[float, ...], machine_code: bool
    ) -> Gaps:
        """Return the gaps of inequalities; CasADi cannot differentiate compiled ones."""
        found = avoidance.gaps(arm, stations, machine_code) if avoidance else None
        return cls(found, ca.DM(base_pose(arm)), arm.length)

    @property
    def size(self) -> int:
        """How many there are."""
        return self.equations.n_g if self.equations else 0

    @property
    def n_numbers(self) -> int:
        """How many numbers they take."""
        return self.equations.n_p if self.equations else 0

    def value(self, poses: ca.MX, p: ca.MX) -> ca.MX:
        """Return the gaps (m,)."""
        if self.equations is None:
            return ca.MX(0, 1)
        return self.equations.value(self._all(poses), p) / self.length

    def jacobian(self, poses: ca.MX, p: ca.MX) -> ca.MX:
        """Return their derivatives by the poses, column by column (m, 7 K)."""
        if self.equations is None:
            return ca.MX(0, poses.numel())
        function, places = self.equations.jacobian
        return ca.MX(places, function(self._all(poses), p))[:, POSE:] / self.length

    def second(self, poses: ca.MX, p: ca.MX, weights: ca.MX) -> ca.MX:
        """Return the Hessian (7 K, 7 K) of weights (m,) . gaps."""
        if self.equations is None:
            return ca.MX(poses.numel(), poses.numel())
        function, places = self.equations.hessian
        nonzeros = function(self._all(poses), p, weights)
        return ca.MX(places, nonzeros)[POSE:, POSE:] / self.length

    def _all(self, poses: ca.MX) -> ca.MX:
        return ca.vertcat(self.base, ca.vec(poses))


STRETCH, LEAST_STRETCH = "stretch", 1e-3
S = TypeVar("S", ca.SX, ca.MX)


@dataclass(frozen=True)
class Rows:
    """The rows of one kind of constraint."""

    name: str
    size: int
    lower: float
    upper: float


def objective_of(
    arm: Arm, targets: tuple[Target, ...], statement: Statement, thin: int
) -> Objective:
    """Return what targets and a statement make of a shape with so many slim places.

    Built once for all targets of one structure, and for all meshes.
    """
    structure = tuple(target.structure(arm) for target in targets)
    told = Statement(norm=statement.norm, mode=statement.mode, limited=statement.limited)
    return _built(arm, structure, Same(targets), told, thin)


@lru_cache(maxsize=24)
def _built(
    arm: Arm, structure: tuple[object, ...], targets: Same, statement: Statement, thin: int
) -> Objective:
    return Objective(arm, targets.value, statement, thin)


class Objective:
    """What targets and a statement make of a shape, whatever the mechanics behind it.

    Attributes
    ----------
    function : casadi.Function
        Tensions [N], peak, lack, parameters, poses (7, K) at the stations that count, least
        stretches, compliances -> f, g without gaps.
    seen : list of int
        Which stations count.
    terms : casadi.Function
        Station poses (7, K), target numbers, compliances -> the targets' terms, one vector for each
        of planner.program.terms.KINDS.
    directions : casadi.Function
        Target numbers -> the directions (3, width) of each request.
    n_numbers, n_own : int
        Number of parameters: target numbers, those of gaps, reference tension, limit of the total,
        trace; and of the first.
    rows : tuple of Rows
        What the rows of g are, in order, with those of the gaps.
    lack_rows : list of int
        The rows of inequalities that may lack something.
    """

    def __init__(
        self, arm: Arm, targets: tuple[Target, ...], statement: Statement, thin: int
    ) -> None:
        self.statement, self.requests = statement, compliance_requests(targets)
        stations = stations_of(arm, targets)
        self._clear = arm, targets, stations
        # What keeps clear changes its structure often, and is a part of its own: see gaps.
        targets = tuple(target for target in targets if not isinstance(target, Avoidance))
        self.seen = [stations.index(s) for s in stations_of(arm, targets)]
        self.terms = terms_function(arm, targets)
        self.directions, gaps = directions_function(arm, targets), self.gaps()
        self.n_own = self.terms.size1_in(1)
        self.n_numbers = self.n_own + gaps.n_numbers + 3
        n, K = arm.n_tendons, self.terms.size2_in(0)
        T, poses, least = ca.MX.sym("T", n), ca.MX.sym("poses", 7, K), ca.MX.sym("least", thin)
        p = ca.MX.sym("p", self.n_numbers)
        compliances = ca.MX.sym("compliances", self.terms.numel_in(2))
        soft = self._soft_rows(inequality_weights(arm, targets))
        lack = ca.MX.sym("lack", len(soft))
        f, blocks, peak = self._stated(arm, targets, soft, (T, lack, p, poses, least, compliances))
        self.rows = tuple(Rows(name, g.numel(), lo, hi) for name, g, lo, hi in blocks)
        self.before_gaps = self.rows[0].size + self.rows[1].size
        self.rows = (*self.rows[:2], Rows("clear", gaps.size, 0.0, np.inf), *self.rows[2:])
        self.n_peak, self.n_lack = peak.numel(), lack.numel()
        self.lack_rows = [self.rows[0].size + row for row in soft]
        g = ca.vertcat(*(g for _, g, _, _ in blocks))
        given = [T, peak, lack, p, poses, least, compliances]
        self.function = ca.Function("objective", given, [f, g])

    def gaps(self, machine_code: bool = False) -> Gaps:
        """Return the inequalities that keep clear, whose rows come after `before_gaps` others."""
        arm, targets, stations = self._clear
        kept = [target for target in targets if isinstance(target, Avoidance)]
        return Gaps.of(arm, kept[0] if kept else None, stations, machine_code)

    def with_gaps(self, rows: S, gaps: S) -> S:
        """Return rows (m, ...) of `function` and those of the gaps in their places."""
        k = self.before_gaps
        return ca.vertcat(rows[:k, :], gaps, rows[k:, :])

    def without_gaps(self, rows: ca.MX, count: int) -> tuple[ca.MX, ca.MX]:
        """Return rows (m,) without so many gaps, and the gaps; undoes with_gaps."""
        k = self.before_gaps
        # Of a single row CasADi would read one index as that of a column.
        return ca.vertcat(rows[:k, :], rows[k + count :, :]), rows[k : k + count, :]

    def _stated(
        self, arm: Arm, targets: tuple[Target, ...], soft_rows: list[int], given: tuple[ca.MX, ...]
    ) -> tuple[ca.MX, list[tuple[str, ca.MX, float, float]], ca.MX]:
        T, lack, p, poses, thin, compliances = given
        target, (reference, total, trace) = p[: self.n_own], ca.vertsplit(p[-3:])
        equality, soft_residual, inequality, least = self.terms(poses, target, compliances)
        for row, place in shares(arm, targets):
            inequality[row] = 1 - compliances[place]
        effort, peak, peaks = smooth_norm(T / reference, self.statement.norm)
        mode, none = self.statement.mode, ca.MX(0, 1)
        weights, lacking = (
            equality_weights(arm, targets),
            inequality_weights(arm, targets)[soft_rows],
        )
        soft = ca.vertcat(weights * equality, lacking * lack) if mode == "nearest" else lack
        met = {"exact": ca.vertcat(equality, soft_residual), "closest": equality, "nearest": none}[
            mode
        ]
        gaps = ca.sumsqr(ca.vertcat(soft_residual, soft)) / 2
        blocks = [
            ("equality", met, 0.0, 0.0),
            (
                "inequality",
                inequality + ca.DM.eye(inequality.numel())[:, soft_rows] @ lack,
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

    def _soft_rows(self, lacking: ca.DM) -> list[int]:
        """Return which inequalities may lack something: none, those that yield, or all."""
        kept = {"exact": (), "closest": (LOW_PRIORITY,), "nearest": (LOW_PRIORITY, HIGH_PRIORITY)}
        weights = np.array(lacking).ravel()
        return [row for row, w in enumerate(weights) if w in kept[self.statement.mode]]


def split(p: S, sizes: tuple[int, ...]) -> list[S]:
    """Return the parts of parameters of given sizes."""
    ends = np.cumsum([0, *sizes]).tolist()
    return [p[a:b] for a, b in pairwise(ends)]
