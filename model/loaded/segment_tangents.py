"""How changes of state cross a segment: its Runge-Kutta steps, linearised with them."""

from __future__ import annotations

from functools import lru_cache

import casadi as ca
import numpy as np

from model.integrators.runge_kutta import RungeKutta
from model.loaded.equations import LoadEquations
from model.loaded.rate_derivatives import driven_slopes, state_slopes
from model.loaded.segments import LoadSegments
from model.segment import Segment


def tangents(
    system: LoadSegments, segment: Segment, columns: int, directions: ca.DM | None = None
) -> ca.Function:
    """Return (x, change of x (n_x, columns), p) -> both at each further node, side by side.

    The last columns are changes of the parameters too, along the directions (n_p, m) if any.
    """
    e = system.equations
    x, change = ca.MX.sym("x", e.n_x), ca.MX.sym("change", e.n_x, columns)
    p = ca.MX.sym("p", system.n_p)
    step = _tangent_step(e, system.scheme, columns, directions is not None)
    moved = _moved(system, segment, columns, directions)
    across = step.mapaccum(segment.nodes.size - 1)
    along = across(ca.horzcat(x, change), *system.steps(segment.nodes, p), moved)
    return ca.Function("tangents", [x, change, p], [along])


def _moved(system: LoadSegments, segment: Segment, columns: int, directions: ca.DM | None) -> ca.DM:
    """Return the change of pull and force at each node of each step (n_v, columns) side by side."""
    if directions is None:
        return ca.DM(0, 0)
    D, n_T = np.array(directions), system.arm.n_tendons
    force = D[-6:-3] * system.reaches(segment.nodes[0])
    none = columns - D.shape[1]
    blocks = [np.vstack([u @ D[:n_T], force]) for u in system.pull_slopes(segment.nodes)]
    return ca.DM(np.hstack([np.pad(block, ((0, 0), (none, 0))) for block in blocks]))


@lru_cache(maxsize=64)
def _tangent_step(e: LoadEquations, scheme: RungeKutta, columns: int, driven: bool) -> ca.Function:
    """Return (x and its change, cross-sections, h, change of pull and force) -> after a step."""
    nodes = sorted(set(scheme.nodes))
    xz, h = ca.MX.sym("xz", e.n_x, 1 + columns), ca.MX.sym("h")
    args = [ca.MX.sym("data", *v.shape) for v in e.symbols(len(nodes))]
    slopes = driven_slopes(e) if driven else state_slopes(e)
    size = (slopes.size2_out(2), columns * len(nodes)) if driven else (0, 0)
    moved = ca.MX.sym("moved", *size)
    rates: list[ca.MX] = []
    for c, row in zip(scheme.nodes, scheme.rows, strict=True):
        i = nodes.index(c)
        inner = xz + h * weighted(row, rates) if any(row) else xz
        f, A, *B = slopes(inner[:, 0], *(v[:, i] for v in args))
        change = A @ inner[:, 1:]
        if driven:
            change = change + B[0] @ moved[:, i * columns : (i + 1) * columns]
        rates.append(ca.horzcat(f, change))
    after = xz + h * weighted(scheme.weights, rates)
    return ca.Function("tangent_step", [xz, *args, h, moved], [after])


def weighted(weights: tuple[float, ...], rates: list[ca.MX]) -> ca.MX:
    """Return the sum of rates by their weights, without those that weigh nothing."""
    terms = [w * rate for w, rate in zip(weights, rates, strict=True) if w]
    return sum(terms[1:], terms[0])
