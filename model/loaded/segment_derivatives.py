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

from model.integrators.runge_kutta import RungeKutta
from model.loaded.equations import LoadEquations
from model.loaded.rate_derivatives import rate_curvature, rate_slopes
from model.loaded.segment_tangents import weighted
from model.loaded.segments import LoadSegments
from model.paths import Array
from model.segment import Segment
from model.unloaded.strain_derivatives import block_diagonal


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
        n, n_T, N = e.n_x, system.arm.n_tendons, segment.nodes.size - 1
        x, T = ca.MX.sym("x", n), ca.MX.sym("T", n_T)
        steps = system.steps(segment.nodes, system.parameters(T))
        U = system.pull_slopes(segment.nodes)
        start = ca.densify(ca.horzcat(x, ca.DM.eye(n), ca.MX(n, n_T)))
        across = _step_slopes(e, scheme, n_T).mapaccum(N)
        after, Y, ZY, A = across(start, *steps, ca.DM(np.hstack(U)))
        found = ca.horzsplit(ca.horzcat(start, after), 1 + n + n_T)
        states, slopes = ca.horzcat(*(found[k][:, 0] for k in at)), [found[k][:, 1:] for k in at]
        self.first = ca.Function("first", [x, T], [states, ca.densify(ca.vertcat(*slopes))])

        covectors = ca.MX.sym("covectors", n, len(at))
        on_nodes = covectors @ ca.DM([[float(k == node) for node in range(N + 1)] for k in at])
        mu = _stage_covectors(e, scheme, on_nodes, A, np.diff(segment.nodes))
        nodes = sorted(set(scheme.nodes))
        picked = [k * len(nodes) + nodes.index(c) for k in range(N) for c in scheme.nodes]
        curvature = rate_curvature(e).map(N * len(scheme.nodes))
        curved = curvature(Y, *(v[:, picked] for v in steps[:-1]), mu)
        V = _stacked(ZY, n, U, picked, n_T)
        n_in = n + U[0].shape[0]
        hessian = V.T @ (block_diagonal(curved, n_in, n_in) @ V)
        self.second = ca.Function("second", [x, T, covectors], [ca.densify(hessian)])


def _stage_covectors(
    e: LoadEquations, scheme: RungeKutta, on_nodes: ca.MX, A: ca.MX, h: Array
) -> ca.MX:
    """Return the covectors of the rates at all stages (n_x, s N), step by step.

    `on_nodes` (n_x, N + 1) are those of the states at the nodes, A (n_x, n_x s N) the rates'
    Jacobians at the stages, and h (N,) the steps.
    """
    n, s, N = e.n_x, len(scheme.nodes), h.size
    order = list(range(N))[::-1]
    columns = [k * s * n + i for k in order for i in range(s * n)]
    back = _step_covectors(e, scheme).mapaccum(N)
    _, mu = back(on_nodes[:, -1], on_nodes[:, order], A[:, columns], ca.DM(h[order]).T)
    return mu[:, [k * s + i for k in order for i in range(s)]]


def _stacked(ZY: ca.MX, n: int, U: list[Array], picked: list[int], n_T: int) -> ca.MX:
    """Return the slopes of all stages' arguments, one below the other."""
    rows: list[ca.MX] = []
    for Z, node in zip(ca.horzsplit(ZY, n + n_T), picked, strict=True):
        rows += [Z, ca.MX(ca.horzcat(ca.DM(U[node].shape[0], n), ca.DM(U[node])))]
    return ca.densify(ca.vertcat(*rows))


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
        inner = xz + h * weighted(row, rates) if any(row) else xz
        f, A, B = slopes(inner[:, 0], *(v[:, i] for v in args))
        direct = ca.horzcat(ca.MX(n, n), B @ U[:, i * n_T : (i + 1) * n_T])
        rates.append(ca.horzcat(f, A @ inner[:, 1:] + direct))
        stages.append(inner[:, 0])
        tangents.append(inner[:, 1:])
        jacobians.append(A)
    after = xz + h * weighted(scheme.weights, rates)
    outputs = [after, *(ca.horzcat(*v) for v in (stages, tangents, jacobians))]
    return ca.Function("step_slopes", [xz, *args, h, U], [ca.densify(v) for v in outputs])


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
