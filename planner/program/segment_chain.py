"""The states that a loaded program looks at, and their derivatives against its unknowns."""

from __future__ import annotations

import casadi as ca
import numpy as np

from model.loaded.segment_derivatives import SegmentDerivatives
from model.loaded.segments import LoadSegments


class SegmentChain:
    """States at the ends of the segments, at stations, and where the body is slimmest.

    Attributes
    ----------
    looks : tuple of (segment, node)
        Where, segment by segment, each segment's last node among them.
    states : casadi.Function
        (T, scaled starts (n_x segments,)) -> states (n_x, K) in SI units.
    first : casadi.Function
        (T, scaled starts) -> states, slopes (n_x K, n_tendons + n_x segments).
    second : casadi.Function
        (T, scaled starts, covectors (n_x, K)) -> Hessian of covectors . states.
    """

    def __init__(self, system: LoadSegments, stations: tuple[float, ...]) -> None:
        self.system, self.stations = system, stations
        self.looks = tuple(
            (i, node)
            for i, segment in enumerate(system.segments)
            for node in sorted({len(segment.nodes) - 1, self.slimmest(i), *self._stations(i)})
        )
        self._build()

    def slimmest(self, i: int) -> int:
        """Return the node of a segment where the body is slimmest."""
        radius = self.system.arm.radius.evaluate(
            self.system.segments[i].nodes, self.system.arm.length
        )[0]
        return int(np.argmin(radius))

    def end(self, i: int) -> int:
        """Return the column of a segment's last node."""
        return self.looks.index((i, len(self.system.segments[i].nodes) - 1))

    def station(self, s: float) -> int:
        """Return the column of a station."""
        for i in range(len(self.system.segments)):
            for node in self._stations(i, s):
                return self.looks.index((i, node))
        raise LookupError(s)

    def _stations(self, i: int, only: float | None = None) -> list[int]:
        nodes, near = self.system.segments[i].nodes, 1e-9 * self.system.arm.length
        wanted = self.stations if only is None else (only,)
        return [int(k) for s in wanted for k in np.flatnonzero(np.abs(nodes - s) <= near)]

    def _build(self) -> None:
        system, n_T = self.system, self.system.arm.n_tendons
        n, m = system.scale.size, len(system.segments)
        T, X = ca.MX.sym("T", n_T), ca.MX.sym("X", n * m)
        covectors = ca.MX.sym("covectors", n, len(self.looks))
        scale = ca.DM(system.scale)
        values, states, slopes = [], [], []
        hessian = ca.MX(n_T + n * m, n_T + n * m)
        for i, segment in enumerate(system.segments):
            columns = [c for c, (j, _) in enumerate(self.looks) if j == i]
            nodes = tuple(self.looks[c][1] for c in columns)
            own = SegmentDerivatives(system, segment, nodes)
            x = scale * X[i * n : (i + 1) * n]
            found, slope = own.first(x, T)
            path = ca.horzcat(x, segment.map(x, system.parameters(T)))
            values.append(path[:, list(nodes)])
            place = _place(n, n_T, i, m, scale)
            states.append(found)
            slopes.append(slope @ place)
            hessian += place.T @ own.second(x, T, covectors[:, columns]) @ place
        outputs = [ca.horzcat(*states), ca.densify(ca.vertcat(*slopes))]
        self.states = ca.Function("states", [T, X], [ca.horzcat(*values)])
        self.first = ca.Function("first", [T, X], outputs)
        self.second = ca.Function("second", [T, X, covectors], [ca.densify(hessian)])


def _place(n: int, n_T: int, i: int, m: int, scale: ca.DM) -> ca.DM:
    """Return the slopes of (x of segment i, T) against (T, scaled starts)."""
    place = ca.DM(n + n_T, n_T + n * m)
    place[n:, :n_T] = ca.DM.eye(n_T)
    place[:n, n_T + i * n : n_T + (i + 1) * n] = ca.diag(scale)
    return place
