"""The nonlinear program: built from arm, scene and targets, to be looked at, exported and solved.

    minimise    what the mode says
    subject to  margins >= 0                  1 + q >= least stretch
                lower <= tensions <= upper    total pull <= limit

Targets have things to match and things to approach. The modes are three readings of them, tried in
this order:

    exact      match = 0 and approach = 0; effort is made least
    closest    match = 0; the approach is made least, with a trace of effort
    nearest    match, approach and what margins lack are made least, firm ones first

The unknowns are the tensions alone (form "condensed"), or tensions and the states at the tip side
of each segment with the jump and continuity constraints of model.shooting ("multiple-shooting").
"""

from __future__ import annotations

from collections.abc import Hashable
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Literal

import casadi as ca
import numpy as np

from model.arm import Arm
from model.effects import Extension
from model.forward import SCHEMES, forward_map, schemes_of
from model.mesh import graded
from model.paths import Array
from model.runge_kutta import RungeKutta
from model.scene import Scene
from model.shooting import Shooting
from model.stations import Counts
from planner.effort import Norm, smooth_norm
from planner.limits import Limits, natural_tensions
from planner.targets.base import Target
from planner.terms import FIRM, firmness, stations_of, terms_function

Form = Literal["condensed", "multiple-shooting"]
FORMS = ("condensed", "multiple-shooting")
Mode = Literal["exact", "closest", "nearest"]
LEAST_STRETCH = 1e-3
TRACES = (1e-6, 1e-10)


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
    terms : casadi.Function
        Station poses (7, K) and target numbers -> the targets' match, approach and margin.
    """

    def __init__(
        self,
        arm: Arm,
        scene: Scene,
        targets: tuple[Target, ...],
        form: Form,
        norm: Norm,
        refinement: int,
        mode: Mode,
        limited: bool,
    ) -> None:
        self.limited = limited
        self.arm, self.scene, self.form, self.norm = arm, scene, form, norm
        self.mode, self.refinement = mode, refinement
        self.stations = stations_of(arm, targets)
        self.terms = terms_function(arm, targets)
        self.firmness = firmness(arm, targets)
        self._build()

    def _build(self) -> None:
        n = self.arm.n_tendons
        z, unit = ca.MX.sym("z", n), ca.MX.sym("unit", n)
        target = ca.MX.sym("target", self.terms.size1_in(1))
        reference, total, trace = (ca.MX.sym(name) for name in ("reference", "total", "trace"))
        T = z * unit
        states, poses, stretch, closure = self._mechanics(T)
        match, approach, margin = self.terms(poses, target)
        effort, peak, peaks = smooth_norm(T / reference, self.norm)
        none, nearest = ca.MX(0, 1), self.mode == "nearest"
        lack = ca.MX.sym("lack", margin.numel() if nearest else 0)
        soft = ca.vertcat(self.firmness * match, FIRM * lack) if nearest else none
        wanted = none if self.mode == "exact" else ca.vertcat(approach, soft)
        met = {"exact": ca.vertcat(match, approach), "closest": match, "nearest": none}[self.mode]
        objective = effort if self.mode == "exact" else ca.sumsqr(wanted) / 2 + trace * effort
        spare = (total - ca.sum1(T)) / reference if self.limited else none
        blocks = [
            ("match", met, 0.0, 0.0),
            ("margin", margin + lack if nearest else margin, 0.0, np.inf),
            ("stretch", stretch, LEAST_STRETCH, np.inf),
            ("total pull", spare, 0.0, np.inf),
            ("peak", peaks, 0.0, np.inf),
            ("shooting", closure, 0.0, 0.0),
        ]
        self.rows = tuple(Rows(name, g.numel(), lo, hi) for name, g, lo, hi in blocks)
        self.n_states, self.has_peak, self.n_lack = states.numel(), peak.numel() > 0, lack.numel()
        self.nlp = {
            "x": ca.vertcat(z, peak, lack, states),
            "p": ca.vertcat(target, unit, reference, total, trace),
            "f": objective,
            "g": ca.vertcat(*(g for _, g, _, _ in blocks)),
        }

    def _mechanics(self, T: ca.MX) -> tuple[ca.MX, ca.MX, ca.MX, ca.MX]:
        """Return further unknowns, station poses (7, K), stretches and closing constraints."""
        scheme = schemes_of(self.scene)[0]
        if self.form == "condensed":
            forward = forward_map(self.arm, self.scene, scheme, self.refinement, self.stations)
            poses, stretch = forward.function(T)[:2]
            columns = [forward.mesh.node(s) for s in self.stations]
            rows = slimmest(self.arm, forward.stretch_at, forward.stretch_active)
            empty = ca.MX(0, 1)
            kept = stretch[rows].T if self.scene.has(Extension) else empty
            return empty, poses[:, columns], kept, empty
        return self._shooting(T)

    @cached_property
    def derivatives(self) -> ca.Function:
        """Return x, p, multipliers of g -> gradient of f, g, Jacobian of g, Hessian of both."""
        x, p, g = self.nlp["x"], self.nlp["p"], self.nlp["g"]
        lam = ca.MX.sym("lam", g.numel())
        lagrangian = self.nlp["f"] + ca.dot(lam, g)
        outputs = [
            ca.gradient(self.nlp["f"], x),
            g,
            ca.jacobian(g, x),
            ca.hessian(lagrangian, x)[0],
        ]
        return ca.Function("derivatives", [x, p, lam], outputs)

    def shooting(self) -> Shooting:
        """Return the shooting system of the form "multiple-shooting"."""
        return shooting_system(self.arm, self.scene, self.refinement, self.stations)

    def _shooting(self, T: ca.MX) -> tuple[ca.MX, ca.MX, ca.MX, ca.MX]:
        system = self.shooting()
        X = ca.MX.sym("X", system.n_x, system.n_segments)
        paths = system.trajectories(X, T)
        poses, stretches, least = {}, [], []
        for path, segment in zip(paths, system.segments, strict=True):
            stretches.append(segment.stretch(path[7:, :], T))
            least.append(
                int(np.argmin(self.arm.radius.evaluate(segment.nodes, self.arm.length)[0]))
            )
            for s in self.stations:
                near = int(np.argmin(np.abs(segment.nodes - s)))
                if abs(segment.nodes[near] - s) <= 1e-9 * self.arm.length:
                    poses[s] = path[:7, near]
        columns = ca.horzcat(*(poses[s] for s in self.stations))
        rows = [s[0, i] for s, i in zip(stretches, least, strict=True)]
        kept = ca.vertcat(*rows) if self.scene.has(Extension) else ca.MX(0, 1)
        return ca.vec(X), columns, kept, system.residual(X, T, paths)

    def parameters(
        self, targets: tuple[Target, ...], limits: Limits, trace: float = TRACES[-1]
    ) -> Array:
        """Return the values of p for targets of this structure, limits and trace of effort."""
        unit = units(self.arm, limits)
        numbers = [target.parameters(self.arm) for target in targets]
        return np.concatenate([*numbers, unit, [unit.max(), limits.total or 0.0, trace]])

    def bounds(self, limits: Limits) -> tuple[Array, Array, Array, Array]:
        """Return lower and upper bounds of x and of g."""
        unit = units(self.arm, limits)
        free = self.n_states + self.has_peak + self.n_lack
        lbx = np.concatenate([np.array(limits.lower) / unit, np.full(free, -np.inf)])
        ubx = np.concatenate([np.array(limits.upper) / unit, np.full(free, np.inf)])
        lbg = np.concatenate([np.full(r.size, r.lower) for r in self.rows])
        ubg = np.concatenate([np.full(r.size, r.upper) for r in self.rows])
        return lbx, ubx, lbg, ubg

    def unknowns(self, tensions: Array, limits: Limits) -> Array:
        """Return x for tensions, the states of multiple shooting by single shooting."""
        unit = units(self.arm, limits)
        peak = [tensions.max() / unit.max()] if self.has_peak else []
        parts = [tensions / unit, np.array(peak), np.zeros(self.n_lack)]
        if self.n_states:
            parts.append(self.shooting().guess(tensions).T.ravel())
        return np.concatenate(parts)

    def tensions(self, x: Array, limits: Limits) -> Array:
        """Return the tensions in unknowns x, within the limits to the last digit [N]."""
        T = x[: self.arm.n_tendons] * units(self.arm, limits)
        return np.clip(T, limits.lower, limits.upper)


def units(arm: Arm, limits: Limits) -> Array:
    """Return the tension that each unknown is counted in [N]: what bends the arm by some rad."""
    upper = np.array(limits.upper)
    return np.where(upper > 0, np.minimum(5 * natural_tensions(arm), upper), 1.0)


@lru_cache(maxsize=64)
def shooting_system(
    arm: Arm, scene: Scene, refinement: int, stations: tuple[float, ...]
) -> Shooting:
    """Return the shooting constraints on a mesh with the stations, by the scene's own scheme."""
    names = [name for name in schemes_of(scene) if SCHEMES[name] is not None]
    scheme = SCHEMES[names[0]]
    assert isinstance(scheme, RungeKutta)
    return Shooting(arm, scene, graded(arm, refinement, stations), scheme)


def slimmest(arm: Arm, s: Array, active: Counts) -> list[int]:
    """Return, for each segment with tendons, where its body is slimmest and 1 + q least."""
    radius = arm.radius.evaluate(s, arm.length)[0]
    rows = []
    for count in np.unique(active[active > 0]):
        inside = np.flatnonzero(active == count)
        rows.append(int(inside[np.argmin(radius[inside])]))
    return rows


_CACHE: dict[Hashable, Problem] = {}


def build(
    arm: Arm,
    targets: tuple[Target, ...],
    scene: Scene,
    form: Form = "condensed",
    norm: Norm = "2",
    refinement: int = 4,
    mode: Mode = "exact",
    limited: bool = False,
) -> Problem:
    """Return the problem, built once for all targets of one structure."""
    structure = tuple(target.structure(arm) for target in targets)
    key = (arm, scene, structure, form, norm, refinement, mode, limited)
    if key not in _CACHE:
        while len(_CACHE) > 128:
            _CACHE.pop(next(iter(_CACHE)))
        _CACHE[key] = Problem(arm, scene, targets, form, norm, refinement, mode, limited)
    return _CACHE[key]
