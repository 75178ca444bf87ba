"""A stretch of the arm that one shooting map crosses, and what a set of them has to offer."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import casadi as ca

from model.paths import Array


@dataclass(frozen=True, eq=False)
class Segment:
    """A stretch between two places where the state jumps, with the functions to cross it.

    A state x begins with the pose (7,); p are parameters, the tensions first.

    Attributes
    ----------
    nodes : (N + 1,)
        Mesh nodes from the tip side to the base side [m].
    entry : casadi.Function
        (x at the first node, x at the last node of the segment before, p) -> what vanishes between
        them. At the tip there is none before, the second argument does not matter, and the pose
        is free.
    map : casadi.Function
        (x at the first node, p) -> x at all further nodes (n_x, N).
    stretch : casadi.Function
        (x at the nodes (n_x, N + 1), p) -> 1 + q there (1, N + 1).
    """

    nodes: Array
    entry: ca.Function
    map: ca.Function
    stretch: ca.Function


class Segments(Protocol):
    """The segments of an arm from tip to base.

    Attributes
    ----------
    segments : list of Segment
    scale : (n_x,)
        What one unit of each state's component is worth.
    """

    segments: list[Segment]
    scale: Array

    def parameters(self, T: ca.MX) -> ca.MX:
        """Return p for tensions T (n_tendons,), everything else as the scene has it."""

    def closure(self, x: ca.MX, p: ca.MX) -> ca.MX:
        """Return what vanishes at the base for the state x there, in scaled quantities."""
