"""A stretch of the arm that one map of states crosses."""

from __future__ import annotations

from dataclasses import dataclass

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
