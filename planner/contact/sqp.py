"""Sequential quadratic programming in the tensions, over shapes that settle by themselves.

Least f(T) = |T|^2 / 2 + W |approach|^2 / 2, scaled, with match = 0, margin >= 0 and limits. Each
step solves a quadratic program in which what cannot be met costs in proportion (an exact penalty);
the Hessian of the Lagrangian is Powell's damped BFGS; steps stay within a region that grows and
shrinks as the penalised objective falls by what was foreseen. Source: Nocedal and Wright,
"Numerical Optimization" (2006), 18.3 to 18.5.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache

import casadi as ca
import numpy as np
from scipy.optimize import lsq_linear

from model.errors import OctoplanError
from model.paths import Array
from model.progress import tell
from model.time_limit import check_time
from planner.contact.settled_terms import SettledTerms

# What is near costs before effort, in units of the arm's length and of the scale of tensions.
_NEAREST = 1e6
_STEPS, _FIRST, _LEAST = 80, 0.25, 1e-9
_ACCEPTED, _GOOD = 0.05, 0.7
_PENALTY = 10.0
# So many steps are taken with an approximate Hessian, and longer while targets lack more than this;
# then it is found by differences of this size over the scale of tensions.
_ROUGH, _CLOSE, _STEP = 10, 1e-4, 1e-5
# Margins and limits that may hold: below this share of the arm's length, or of the scale.
_ACTIVE = 1e-7


# Of tensions, match and margin, scaled.
Multipliers = tuple[Array, Array, Array]


@dataclass(frozen=True, eq=False)
class Program:
    """The program.

    Attributes
    ----------
    evaluate : callable
        Tensions, an equilibrium near -> terms there.
    lower, upper : (n,)
        Limits [N].
    total : float
        The most that all tendons pull together [N].
    scale : float
        Of tensions [N].
    """

    evaluate: Callable[[Array, SettledTerms | None], SettledTerms]
    lower: Array
    upper: Array
    total: float
    scale: float


@dataclass(frozen=True, eq=False)
class Optimum:
    """Where the program ended.

    Attributes
    ----------
    terms : SettledTerms
    lam_bounds, lam_match, lam_margin : multipliers of tensions, match and margin
        Scaled.
    kkt : float
        Residual of the first-order conditions, scaled.
    """

    terms: SettledTerms
    lam_bounds: Array
    lam_match: Array
    lam_margin: Array
    kkt: float

    @property
    def lacks(self) -> float:
        """What match and margin lack together."""
        return _lacks(self.terms)

    @property
    def effort(self) -> float:
        """Root of the sum of squared tensions [N]."""
        return float(np.linalg.norm(self.terms.tensions))


def solve(program: Program, start: SettledTerms, accuracy: float) -> Optimum:
    """Return the optimum that steps from a start lead to."""
    here, region, n = start, _FIRST, start.tensions.size
    B, penalty = np.eye(n), _PENALTY
    for count in range(_STEPS):
        check_time()
        tell("steps of the program with contact", count, _STEPS)
        step, lam = _step(program, here, B, penalty, region)
        penalty = max(penalty, 2 * float(np.abs(lam[1]).max(initial=0.0)))
        penalty = max(penalty, 2 * float(np.abs(lam[2]).max(initial=0.0)))
        best = _optimum(program, here)
        if best.kkt < accuracy and _lacks(here) < accuracy:
            return best
        gain = _merit(program, here, penalty) - _foreseen(program, here, step, penalty)
        there = _tried(program, here, step)
        fell = 0.0 if there is None else _merit(program, here, penalty)
        fell -= 0.0 if there is None else _merit(program, there, penalty)
        if there is None or fell < _ACCEPTED * gain:
            region = 0.3 * min(region, float(np.abs(step).max()))
        else:
            if fell > _GOOD * gain:
                region = min(2 * region, 2.0)
            B, here = _updated(program, B, here, there, lam), there
            if _lacks(here) < _CLOSE and count > _ROUGH:
                B = _hessian(program, here, _optimum(program, here))
        if region < _LEAST:
            break
    return _optimum(program, here)


def _tried(program: Program, here: SettledTerms, step: Array) -> SettledTerms | None:
    T = np.clip(here.tensions + program.scale * step, program.lower, program.upper)
    try:
        return program.evaluate(T, here)
    except OctoplanError:
        return None


def _gradient(program: Program, terms: SettledTerms) -> Array:
    """Return the gradient of f by scaled tensions (n,)."""
    near, slopes = terms.values["approach"], program.scale * terms.slopes["approach"]
    return terms.tensions / program.scale + _NEAREST * slopes.T @ near


def _objective(program: Program, terms: SettledTerms) -> float:
    near = terms.values["approach"]
    own = terms.tensions / program.scale
    return float(own @ own + _NEAREST * near @ near) / 2


def _lacks(terms: SettledTerms) -> float:
    match, margin = terms.values["match"], terms.values["margin"]
    return float(np.abs(match).sum() + np.maximum(-margin, 0.0).sum())


def _merit(program: Program, terms: SettledTerms, penalty: float) -> float:
    return _objective(program, terms) + penalty * _lacks(terms)


def _foreseen(program: Program, here: SettledTerms, step: Array, penalty: float) -> float:
    """Return the penalised objective that linear terms foresee."""
    moved = {k: v + program.scale * here.slopes[k] @ step for k, v in here.values.items()}
    T = here.tensions / program.scale + step
    f = float(T @ T + _NEAREST * moved["approach"] @ moved["approach"]) / 2
    lacks = np.abs(moved["match"]).sum() + np.maximum(-moved["margin"], 0.0).sum()
    return f + penalty * float(lacks)


def _step(
    program: Program, here: SettledTerms, B: Array, penalty: float, region: float
) -> tuple[Array, Multipliers]:
    """Return a step of scaled tensions (n,), and multipliers of bounds, match and margin."""
    n, T, s = here.tensions.size, here.tensions, program.scale
    A, C = s * here.slopes["match"], s * here.slopes["margin"]
    c, d = here.values["match"], here.values["margin"]
    near = s * here.slopes["approach"]
    m, k = c.size, d.size
    size = n + 2 * m + k
    H = np.zeros((size, size))
    H[:n, :n] = B + _NEAREST * near.T @ near
    H[n:, n:] = 1e-12 * np.eye(size - n)
    g = np.concatenate([_gradient(program, here), np.full(size - n, penalty)])
    rows = np.zeros((m + k + 1, size))
    rows[:m, :n], rows[:m, n : n + m], rows[:m, n + m : n + 2 * m] = A, np.eye(m), -np.eye(m)
    rows[m : m + k, :n], rows[m : m + k, n + 2 * m :] = C, np.eye(k)
    rows[-1, :n] = 1.0
    low = np.concatenate([-c, -d, [-np.inf]])
    high = np.concatenate([-c, np.full(k, np.inf), [(program.total - T.sum()) / s]])
    lbx = np.concatenate([np.maximum((program.lower - T) / s, -region), np.zeros(size - n)])
    ubx = np.concatenate([np.minimum((program.upper - T) / s, region), np.full(size - n, np.inf)])
    found = _quadratic(size, m + k + 1)(h=H, g=g, a=rows, lba=low, uba=high, lbx=lbx, ubx=ubx)
    x, lam_x, lam_a = (np.array(found[name]).ravel() for name in ("x", "lam_x", "lam_a"))
    free = (x[:n] > -region * (1 - 1e-9)) & (x[:n] < region * (1 - 1e-9))
    return x[:n], (np.where(free, lam_x[:n], 0.0), lam_a[:m], lam_a[m : m + k])


@lru_cache(maxsize=32)
def _quadratic(n: int, m: int) -> ca.Function:
    shape = {"h": ca.Sparsity.dense(n, n), "a": ca.Sparsity.dense(m, n)}
    quiet = {"print_iter": False, "print_header": False, "error_on_fail": False}
    return ca.conic("quadratic", "qrqp", shape, quiet)


def _optimum(program: Program, here: SettledTerms) -> Optimum:
    """Return where the program is, with the multipliers that leave least of its gradient."""
    s, T = program.scale, here.tensions
    g = _gradient(program, here)
    active = np.flatnonzero(here.values["margin"] <= _ACTIVE)
    room = _ACTIVE * s
    low, high = np.flatnonzero(program.lower + room >= T), np.flatnonzero(program.upper - room <= T)
    all_ = np.ones((1, T.size))[: int(T.sum() >= program.total - room)]
    A, C = s * here.slopes["match"], s * here.slopes["margin"][active]
    unit = np.eye(T.size)
    rows = np.vstack([A, -C, -unit[low], unit[high], all_])
    least = np.concatenate([np.full(len(A), -np.inf), np.zeros(len(rows) - len(A))])
    lam = lsq_linear(rows.T, -g, (least, np.inf)).x if rows.size else np.zeros(0)
    left = float(np.abs(g + rows.T @ lam).max()) / (1 + float(np.abs(lam).max(initial=0.0)))
    match, margin, bounds = lam[: len(A)], np.zeros(here.values["margin"].size), np.zeros(T.size)
    ends = np.cumsum([len(A), active.size, low.size, high.size])
    margin[active] = -lam[ends[0] : ends[1]]
    bounds[low] -= lam[ends[1] : ends[2]]
    bounds[high] += lam[ends[2] : ends[3]]
    return Optimum(here, bounds, match, margin, left)


def kkt_residual(program: Program, here: SettledTerms) -> float:
    """Return the residual of the first-order conditions, scaled."""
    return _optimum(program, here).kkt


def _lagrangian_slope(program: Program, terms: SettledTerms, lam: tuple[Array, Array]) -> Array:
    """Return the gradient by scaled tensions of effort and of what multipliers weigh (n,)."""
    s = program.scale
    own = terms.tensions / s + s * terms.slopes["match"].T @ lam[0]
    return np.asarray(own + s * terms.slopes["margin"].T @ lam[1])


def _hessian(program: Program, here: SettledTerms, at: Optimum) -> Array:
    """Return the Hessian of the Lagrangian by differences, made definite."""
    n, lam = here.tensions.size, (at.lam_match, at.lam_margin)
    still, found = _lagrangian_slope(program, here, lam), np.eye(n)
    for j in range(n):
        sign = 1.0 if here.tensions[j] + _STEP * program.scale <= program.upper[j] else -1.0
        T = here.tensions.copy()
        T[j] += sign * _STEP * program.scale
        try:
            there = program.evaluate(T, here)
        except OctoplanError:
            continue
        found[:, j] = sign * (_lagrangian_slope(program, there, lam) - still) / _STEP
    values, vectors = np.linalg.eigh((found + found.T) / 2)
    return np.asarray(vectors * np.maximum(np.abs(values), 1e-3) @ vectors.T)


def _updated(
    program: Program,
    B: Array,
    here: SettledTerms,
    there: SettledTerms,
    lam: Multipliers,
) -> Array:
    """Return the Hessian after a step; Powell's damping keeps it definite."""
    step = (there.tensions - here.tensions) / program.scale
    y = _lagrangian_slope(program, there, lam[1:]) - _lagrangian_slope(program, here, lam[1:])
    Bs = B @ step
    curve = float(step @ Bs)
    if curve <= 1e-300:
        return B
    if step @ y < 0.2 * curve:
        share = 0.8 * curve / (curve - float(step @ y))
        y = share * y + (1 - share) * Bs
    return np.asarray(B - np.outer(Bs, Bs) / curve + np.outer(y, y) / float(step @ y))
