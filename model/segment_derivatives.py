"""First and second derivatives of a segment's states, stage by stage of its Runge-Kutta steps.

A Runge-Kutta step is linear but for its rates f(Y, u) at the stages Y, so that the states' slopes Z
follow from the rates' Jacobians, their covectors lambda from the transposes, and the Hessian of
lambda . x is the sum over all stages of (Z, U)^T f''[mu] (Z, U), with mu the covector of the stage
and U the slopes of the tendons' pull u. Only f is differentiated symbol by symbol.
"""

from __future__ import annotations

from functools import lru_cache

import casadi as ca
import numpy as np

from model.load_equations import LoadEquations
from model.load_segments import LoadSegments
from model.paths import Array
from model.rate_derivatives import driven_slopes, rate_curvature, rate_slopes, state_slopes
from model.runge_kutta import RungeKutta
from model.segment import Segment
from model.stations import stations
from model.strain_derivatives import block_diagonal


class SegmentDerivatives:
    """Derivatives of the states at some nodes of a segment, under the full loads.

    Columns of slopes are the state x at the segment's first node, then the tensions T.

    Attributes
    ----------
    first : casadi.Function
        (x (n_x,), T) -> states (n_x, K) at the nodes, slopes (n_x K, n_x + n_tendons).
    second : casadi.Function
        (x, T, covectors (n_x, K)) -> Hessian (n_x + n_tendons, the same) of covectors . states.
    """

    def __init__(self, system: LoadSegments, segment: Segment, at: tuple[int, ...]) -> None:
        e, scheme = system.equations, system.scheme
        n, n_T, h = e.n_x, system.arm.n_tendons, np.diff(segment.nodes)
        x, T = ca.MX.sym("x", n), ca.MX.sym("T", n_T)
        p = system.parameters(T)
        active = system.active((segment.nodes[0] + segment.nodes[1]) / 2)
        nodes = sorted(set(scheme.nodes))
        counts = np.full(h.size, active)
        data = system.step_data(segment.nodes[:-1], h, counts, segment.nodes[0], p)
        U = _pull_slopes(system, segment.nodes[:-1], h, active, np.array(nodes))
        start = ca.horzcat(x, ca.DM.eye(n), ca.MX(n, n_T))
        across = _step_slopes(e, scheme, n_T).mapaccum(h.size)
        xz, Y, ZY, A = across(ca.densify(start), *data, ca.DM(h).T, ca.DM(np.hstack(U)))
        xz = ca.horzcat(start, xz)
        width = 1 + n + n_T
        states = [xz[:, k * width] for k in at]
        slopes = [xz[:, k * width + 1 : (k + 1) * width] for k in at]
        self.first = ca.Function(
            "first", [x, T], [ca.horzcat(*states), ca.densify(ca.vertcat(*slopes))]
        )

        covectors = ca.MX.sym("covectors", n, len(at))
        on_nodes = covectors @ ca.DM([[float(k == node) for node in range(h.size + 1)] for k in at])
        order = list(range(h.size))[::-1]
        back = _step_covectors(e, scheme).mapaccum(h.size)
        s = len(scheme.nodes)
        columns = [k * s * n + i for k in order for i in range(s * n)]
        last = on_nodes[:, -1]
        _, mu = back(last, on_nodes[:, order], A[:, columns], ca.DM(h[::-1]).T)
        mu = mu[:, [k * s + i for k in order for i in range(s)]]
        picked = [k * len(nodes) + nodes.index(c) for k in range(h.size) for c in scheme.nodes]
        curved = rate_curvature(e).map(h.size * s)(Y, *(v[:, picked] for v in data), mu)
        V = _stacked(ZY, n, U, picked, n_T)
        n_in = n + U[0].shape[0]
        hessian = V.T @ (block_diagonal(curved, n_in, n_in) @ V)
        self.second = ca.Function("second", [x, T, covectors], [ca.densify(hessian)])


def _pull_slopes(
    system: LoadSegments, start: Array, h: Array, active: int, nodes: Array
) -> list[Array]:
    """Return the slopes of what varies with the tensions, at each node of each step (n_u, n_T)."""
    e = system.equations
    s = (start[:, None] + h[:, None] * nodes).ravel()
    if e.n_tension:
        return [np.zeros((0, system.arm.n_tendons))] * s.size
    maps, rates = e.statics.pulls(system.arm, stations(system.arm, s, np.full(s.size, active)))
    varied = [
        np.concatenate([m, r]) if e.pull_varies else m for m, r in zip(maps, rates, strict=True)
    ]
    return list(varied)


def _stacked(ZY: ca.MX, n: int, U: list[Array], picked: list[int], n_T: int) -> ca.MX:
    """Return the slopes of all stages' arguments, one below the other."""
    rows: list[ca.MX] = []
    for Z, node in zip(ca.horzsplit(ZY, n + n_T), picked, strict=True):
        rows += [Z, ca.MX(ca.horzcat(ca.DM(U[node].shape[0], n), ca.DM(U[node])))]
    return ca.densify(ca.vertcat(*rows))


def tangents(
    system: LoadSegments, segment: Segment, columns: int, directions: ca.DM | None = None
) -> ca.Function:
    """Return (x, change of x (n_x, columns), p) -> state at the segment's end, its change.

    The last columns are changes of the parameters too, along the directions (n_p, m) if any.
    """
    e, n, h = system.equations, system.equations.n_x, np.diff(segment.nodes)
    x, change = ca.MX.sym("x", n), ca.MX.sym("change", n, columns)
    p = ca.MX.sym("p", system.n_p)
    active = system.active((segment.nodes[0] + segment.nodes[1]) / 2)
    counts = np.full(h.size, active)
    data = system.step_data(segment.nodes[:-1], h, counts, segment.nodes[0], p)
    moved = _moved(system, segment, active, columns, directions)
    across = _tangent_step(e, system.scheme, columns, directions is not None).fold(h.size)
    end = across(ca.horzcat(x, change), *data, ca.DM(h).T, moved)
    return ca.Function("tangents", [x, change, p], [end[:, 0], end[:, 1:]])


def trail(system: LoadSegments, segment: Segment, columns: int) -> ca.Function:
    """Return (x, change of x (n_x, columns), p) -> both at each further node, side by side."""
    e, n, h = system.equations, system.equations.n_x, np.diff(segment.nodes)
    x, change = ca.MX.sym("x", n), ca.MX.sym("change", n, columns)
    p = ca.MX.sym("p", system.n_p)
    active = system.active((segment.nodes[0] + segment.nodes[1]) / 2)
    counts = np.full(h.size, active)
    data = system.step_data(segment.nodes[:-1], h, counts, segment.nodes[0], p)
    across = _tangent_step(e, system.scheme, columns, False).mapaccum(h.size)
    along = across(ca.horzcat(x, change), *data, ca.DM(h).T, ca.DM(0, 0))
    return ca.Function("trail", [x, change, p], [along])


def _moved(
    system: LoadSegments, segment: Segment, active: int, columns: int, directions: ca.DM | None
) -> ca.DM:
    """Return the change of pull and force at each node of each step (n_v, columns) side by side."""
    if directions is None:
        return ca.DM(0, 0)
    h, nodes = np.diff(segment.nodes), np.array(sorted(set(system.scheme.nodes)))
    n_T, D = system.arm.n_tendons, np.array(directions)
    force = D[-6:-3] * system.reaches(segment.nodes[0])
    U = _pull_slopes(system, segment.nodes[:-1], h, active, nodes)
    none = columns - D.shape[1]
    blocks = [np.vstack([u @ D[:n_T], force]) for u in U]
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
        inner = xz + h * _weighted(row, rates) if any(row) else xz
        f, A, *B = slopes(inner[:, 0], *(v[:, i] for v in args))
        change = A @ inner[:, 1:]
        if driven:
            change = change + B[0] @ moved[:, i * columns : (i + 1) * columns]
        rates.append(ca.horzcat(f, change))
    after = xz + h * _weighted(scheme.weights, rates)
    return ca.Function("tangent_step", [xz, *args, h, moved], [after])


@lru_cache(maxsize=64)
def _step_slopes(e: LoadEquations, scheme: RungeKutta, n_T: int) -> ca.Function:
    """Return (x and slopes, cross-sections, h, U) -> the same after a step, stages, slopes, A."""
    n, nodes = e.n_x, sorted(set(scheme.nodes))
    xz, h = ca.MX.sym("xz", n, 1 + n + n_T), ca.MX.sym("h")
    args = [ca.MX.sym("data", *v.shape) for v in e.symbols(len(nodes))]
    slopes = rate_slopes(e)
    n_u = slopes.size2_out(2)
    U = ca.MX.sym("U", n_u, n_T * len(nodes))
    rates: list[ca.MX] = []
    stages, tangents, jacobians = [], [], []
    for c, row in zip(scheme.nodes, scheme.rows, strict=True):
        i = nodes.index(c)
        inner = xz + h * _weighted(row, rates) if any(row) else xz
        f, A, B = slopes(inner[:, 0], *(v[:, i] for v in args))
        direct = ca.horzcat(ca.MX(n, n), B @ U[:, i * n_T : (i + 1) * n_T])
        rates.append(ca.horzcat(f, A @ inner[:, 1:] + direct))
        stages.append(inner[:, 0])
        tangents.append(inner[:, 1:])
        jacobians.append(A)
    after = xz + h * _weighted(scheme.weights, rates)
    outputs = [after, *(ca.horzcat(*v) for v in (stages, tangents, jacobians))]
    return ca.Function("step_slopes", [xz, *args, h, U], [ca.densify(v) for v in outputs])


def _weighted(weights: tuple[float, ...], rates: list[ca.MX]) -> ca.MX:
    terms = [w * rate for w, rate in zip(weights, rates, strict=True) if w]
    return sum(terms[1:], terms[0])


@lru_cache(maxsize=64)
def _step_covectors(e: LoadEquations, scheme: RungeKutta) -> ca.Function:
    """Return (covector after a step, that of its node, A, h) -> covector before, of the rates."""
    n, s = e.n_x, len(scheme.nodes)
    after, node = ca.MX.sym("after", n), ca.MX.sym("node", n)
    A, h = ca.MX.sym("A", n, n * s), ca.MX.sym("h")
    mu = [ca.MX(n, 1)] * s
    sigma = [ca.MX(n, 1)] * s
    for i in reversed(range(s)):
        mu[i] = h * scheme.weights[i] * after
        for j in range(i + 1, s):
            if scheme.rows[j][i]:
                mu[i] = mu[i] + h * scheme.rows[j][i] * sigma[j]
        sigma[i] = A[:, i * n : (i + 1) * n].T @ mu[i]
    before = after + node
    for part in sigma:
        before = before + part
    outputs = [before, ca.horzcat(*mu)]
    return ca.Function("covectors", [after, node, A, h], [ca.densify(v) for v in outputs])
