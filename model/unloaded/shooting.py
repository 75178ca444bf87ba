"""Multiple shooting: a state at the tip side of each segment, joined by jumps, closed at the base.

The unknowns are x_1 .. x_m, one for each segment from tip to base: the state where the tip-to-base
integration of that segment starts. The constraints are as many: what holds at the tip, jumps and
continuity between segments, and the clamped pose at the base.
"""

from __future__ import annotations

import casadi as ca

from model.segment import Segments


class Shooting:
    """The shooting constraints of a system of segments.

    Unknowns and residuals are divided by the system's scale.

    Attributes
    ----------
    n_x, n_segments : int
        Size of a state and number of segments.
    """

    def __init__(self, system: Segments) -> None:
        self.system, self.segments = system, system.segments
        self.n_x, self.n_segments = system.scale.size, len(system.segments)

    def trajectories(self, X: ca.MX, p: ca.MX) -> list[ca.MX]:
        """Return the states at each segment's nodes, tip side first, from scaled unknowns X."""
        scale = ca.DM(self.system.scale)
        starts = [scale * X[:, i] for i in range(self.n_segments)]
        return [
            ca.horzcat(x, segment.map(x, p))
            for x, segment in zip(starts, self.segments, strict=True)
        ]

    def residual(self, trajectories: list[ca.MX], p: ca.MX) -> ca.MX:
        """Return the scaled constraints (n_x n_segments,), zero at equilibrium."""
        starts, ends = ([path[:, k] for path in trajectories] for k in (0, -1))
        return self.joined(starts, ends, p)

    def joined(self, starts: list[ca.MX], ends: list[ca.MX], p: ca.MX) -> ca.MX:
        """Return the scaled constraints from the states at both ends of each segment."""
        scale, rows = ca.DM(self.system.scale), []
        for i, segment in enumerate(self.segments):
            found = segment.entry(starts[i], ends[i - 1], p)
            rows.append(found / (scale[7 : 7 + found.numel()] if i == 0 else scale))
        return ca.vertcat(*rows, self.system.closure(ends[-1], p))
