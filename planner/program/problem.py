"""The nonlinear program: built from arm, scene and targets, to be looked at, exported and solved.

    minimise    what the mode says
    subject to  margins >= 0                  1 + q >= least stretch
                lower <= tensions <= upper    total pull <= limit

Targets have things to match and things to approach. The modes are three readings of them, tried in
this order:

    exact      match = 0 and approach = 0; effort is made least
    closest    match = 0; the approach and what yielding margins lack are made least, with a trace
               of effort
    nearest    match, approach and what all margins lack are made least, firm ones first

The unknowns are the tensions alone (form "condensed"), or tensions and the states at the tip side
of each segment with the jump and continuity constraints of model.unloaded.shooting
("multiple-shooting").
"""

from __future__ import annotations

from collections.abc import Hashable
from dataclasses import dataclass

import casadi as ca
import numpy as np

from model.arm import Arm
from model.paths import Array
from model.scene import Scene
from planner.program.derivatives import plain, through_poses
from planner.program.effort import smooth_norm
from planner.program.gives import tip_give
from planner.program.inner import Inner, through
from planner.program.limits import Limits, natural_tensions
from planner.program.loaded_give import loaded_give
from planner.program.mechanics import mechanics, starts_of
from planner.program.segment_chain import SegmentChain
from planner.program.statement import Statement
from planner.program.terms import (
    FIRM,
    YIELDING,
    firmness,
    looks_of,
    margin_firmness,
    stations_of,
    terms_function,
    ways_function,
)
from planner.targets.base import Target

LEAST_STRETCH = 1e-3
TRACES = (1e-6, 1e-11)
# Over what bends the arm by some rad: maxima below this share do nothing, those above are none.
_NOTHING, _NO_LIMIT = 1e-7, 1e12


@dataclass(frozen=True)
class Rows:
    """The rows of one kind of constraint."""

    name: str
    size: int
    lower: float
    upper: float


class Problem:
    """A nonlinear program in scaled unknowns.

    Attributes
    ----------
    nlp : dict of casadi.MX
        x the unknowns, p the parameters (target numbers, tension units, reference tension, total
        pull, trace of effort), f, g.
    rows : tuple of Rows
        What the rows of g are, in order.
    derivatives : Derivatives
        Exact first and second derivatives of nlp.
    terms : casadi.Function
        Station poses (7, K) and target numbers -> the targets' match, approach and margin.
    """

    def __init__(
        self, arm: Arm, scene: Scene, targets: tuple[Target, ...], statement: Statement
    ) -> None:
        self.arm, self.statement = arm, statement
        self.scene = scene.careful() if statement.careful else scene
        self.stations, self.looks = stations_of(arm, targets), looks_of(targets)
        self.terms, self.ways = terms_function(arm, targets), ways_function(arm, targets)
        self._build(firmness(arm, targets), margin_firmness(arm, targets))

    def _build(self, weights: ca.DM, lacking: ca.DM) -> None:
        n = self.arm.n_tendons
        z, unit = ca.MX.sym("z", n), ca.MX.sym("unit", n)
        target = ca.MX.sym("target", self.terms.size1_in(1))
        reference, total, trace = (ca.MX.sym(name) for name in ("reference", "total", "trace"))
        T, none = z * unit, ca.MX(0, 1)
        arm = mechanics(self.arm, self.scene, self.statement, self.stations, T)
        poses, thin = arm.poses, arm.stretch
        if arm.nodes is None:
            poses = ca.MX.sym("poses", 7, len(self.stations))
            thin = ca.MX.sym("thin", arm.stretch.numel())
        gives = self._gives(T, target) if arm.nodes is None else ca.MX.sym("gives", self.n_gives)
        match, approach, margin, least = self.terms(poses, target, gives)
        effort, peak, peaks = smooth_norm(T / reference, self.statement.norm)
        mode = self.statement.mode
        soft_rows = self._soft_rows(lacking)
        lack = ca.MX.sym("lack", len(soft_rows))
        soft = ca.vertcat(weights * match, lacking * lack) if mode == "nearest" else lack
        met = {"exact": ca.vertcat(match, approach), "closest": match, "nearest": none}[mode]
        gaps = ca.sumsqr(ca.vertcat(approach, soft)) / 2
        blocks = [
            ("match", met, 0.0, 0.0),
            ("margin", margin + ca.DM.eye(margin.numel())[:, soft_rows] @ lack, 0.0, np.inf),
            ("stretch", thin, LEAST_STRETCH, np.inf),
            ("total pull", (total - ca.sum1(T)) / reference, 0.0, np.inf),
            ("peak", peaks, 0.0, np.inf),
            ("shooting", arm.closure, 0.0, 0.0),
        ]
        if not self.statement.limited:
            del blocks[3]
        self.rows = tuple(Rows(name, g.numel(), lo, hi) for name, g, lo, hi in blocks)
        self.n_states, self.n_peak, self.n_lack = (v.numel() for v in (arm.states, peak, lack))
        self.lack_rows = [met.numel() + row for row in soft_rows]
        x = ca.vertcat(z, peak, lack, arm.states)
        p = ca.vertcat(target, unit, reference, total, trace)
        aim = ca.sum1(least) + trace * effort if least.numel() else effort
        f = aim if mode == "exact" else gaps + trace * aim
        g = ca.vertcat(*(g for _, g, _, _ in blocks))
        counted = slice(target.numel(), target.numel() + n)
        if arm.segments is not None and arm.nodes is not None:
            outer = ca.Function("outer", [x, p, arm.nodes, gives], [f, g])
            self._through_segments(outer, arm.segments, counted)
            return
        outer = ca.Function("outer", [x, p, poses, thin], [f, g])
        inner = ca.Function("inner", [x, p], [arm.poses, arm.stretch])
        x, p = ca.MX.sym("x", x.numel()), ca.MX.sym("p", p.numel())
        f, g = outer(x, p, *inner(x, p))
        self.nlp = {"x": x, "p": p, "f": f, "g": g}
        self.derivatives = (
            plain(x, p, f, g)
            if arm.chain is None
            else through_poses(x, p, p[counted], outer, arm.chain, arm.least)
        )

    def _soft_rows(self, lacking: ca.DM) -> list[int]:
        """Return which margins may lack something: none, those that yield, or all."""
        kept = {"exact": (), "closest": (YIELDING,), "nearest": (YIELDING, FIRM)}
        weights = np.array(lacking).ravel()
        return [row for row, w in enumerate(weights) if w in kept[self.statement.mode]]

    def _through_segments(self, outer: ca.Function, chain: SegmentChain, counted: slice) -> None:
        """Set the program from outer: x, p, states at nodes, gives -> f, g."""
        x, p = ca.MX.sym("x", outer.numel_in(0)), ca.MX.sym("p", outer.numel_in(1))
        unit, states = p[counted], x.numel() - self.n_states
        functions = (chain.states, chain.first, chain.second)
        inner = [Inner.of_tensions(x, p, unit, states, functions)]
        mesh = (self.statement.scheme, self.statement.refinement, self.stations)
        ways = self.ways.call([p[: counted.start]])
        for look, D in zip(self.looks, ways, strict=True):
            give = loaded_give(self.arm, self.scene, *mesh, look)
            functions = (give.values, give.first, give.second)
            inner.append(Inner.of_tensions(x, p, unit, states, functions, D))
        w, size = ca.MX.sym("w", outer.numel_in(2) + self.n_gives), outer.numel_in(2)
        f, g = outer(x, p, ca.reshape(w[:size], *outer.size_in(2)), w[size:])
        outer = ca.Function("outer", [x, p, w], [f, g])
        f, g = outer(x, p, ca.vertcat(*(part.values(x, p) for part in inner)))
        self.nlp = {"x": x, "p": p, "f": f, "g": g}
        self.derivatives = through(x, p, outer, inner)

    @property
    def n_gives(self) -> int:
        """Size of what the looks give."""
        return sum(look.width**2 for look in self.looks)

    def _gives(self, T: ca.MX, target: ca.MX) -> ca.MX:
        """Return what the looks give (n_gives,) without loads as an expression of T."""
        mesh = (self.statement.scheme, self.statement.refinement)
        pairs = zip(self.looks, self.ways.call([target]), strict=True)
        found = [tip_give(self.arm, self.scene, *mesh, look)(T, D) for look, D in pairs]
        return ca.vertcat(ca.MX(0, 1), *(ca.vec(G) for G in found))

    def parameters(
        self, targets: tuple[Target, ...], limits: Limits, trace: float = TRACES[-1]
    ) -> Array:
        """Return the values of p for targets of this structure, limits and trace of effort."""
        unit = units(self.arm, limits)
        numbers = [target.parameters(self.arm) for target in targets]
        return np.concatenate([*numbers, unit, [unit.max(), limits.total or 0.0, trace]])

    def magnified(self, trace: float) -> float:
        """Return what the objective is multiplied by for a solver to see effort in it.

        In the least squares of the modes besides "exact" effort is a trace, far below tolerances.
        """
        return 1.0 if self.statement.mode == "exact" else 1e-2 / trace

    def bounds(self, limits: Limits) -> tuple[Array, Array, Array, Array]:
        """Return lower and upper bounds of x and of g."""
        unit = units(self.arm, limits)
        free = np.full(self.n_peak + self.n_lack + self.n_states, np.inf)
        lower, upper = np.array(limits.lower), np.array(limits.upper)
        lbx = np.concatenate([lower / unit, -free])
        upper = np.where(_does_nothing(self.arm, upper), lower, upper)
        upper = np.where(upper < _NO_LIMIT * unit, upper, np.inf)
        ubx = np.concatenate([upper / unit, free])
        lbg = np.concatenate([np.full(r.size, r.lower) for r in self.rows])
        ubg = np.concatenate([np.full(r.size, r.upper) for r in self.rows])
        return lbx, ubx, lbg, ubg

    def unknowns(self, tensions: Array, limits: Limits, p: Array) -> Array:
        """Return x for tensions: states that settle them, what margins lack by the margins."""
        unit = units(self.arm, limits)
        peak = np.full(self.n_peak, tensions.max() / unit.max())
        parts = [tensions / unit, peak, np.zeros(self.n_lack)]
        if self.n_states:
            found = starts_of(self.arm, self.scene, self.statement, self.stations, tensions)
            parts.append(found.T.ravel())
        x = np.concatenate(parts)
        if self.n_lack:
            margin = np.array(self.derivatives.slopes(x, p)[1]).ravel()[self.lack_rows]
            x[tensions.size + self.n_peak :][: self.n_lack] = np.maximum(-margin, 0.0)
        return x

    def tensions(self, x: Array, limits: Limits) -> Array:
        """Return the tensions in unknowns x, within the limits to the last digit [N]."""
        T = x[: self.arm.n_tendons] * units(self.arm, limits)
        return np.clip(T, limits.lower, limits.upper)


def units(arm: Arm, limits: Limits) -> Array:
    """Return the tension that each unknown is counted in [N]: what bends the arm by some rad."""
    most, upper = 5 * natural_tensions(arm), np.array(limits.upper)
    return np.where(_does_nothing(arm, upper), most, np.minimum(upper, most))


def _does_nothing(arm: Arm, upper: Array) -> Array:
    """Return which maxima are so low that what they allow is lost in what is met."""
    return np.asarray(upper <= _NOTHING * 5 * natural_tensions(arm))


_CACHE: dict[Hashable, Problem] = {}


def build(
    arm: Arm, targets: tuple[Target, ...], scene: Scene, statement: Statement | None = None
) -> Problem:
    """Return the problem, built once for all targets of one structure."""
    statement = statement or Statement()
    structure = tuple(target.structure(arm) for target in targets)
    key = (arm, scene, structure, statement)
    if key not in _CACHE:
        while len(_CACHE) > 128:
            _CACHE.pop(next(iter(_CACHE)))
        _CACHE[key] = Problem(arm, scene, targets, statement)
    return _CACHE[key]
