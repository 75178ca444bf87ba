"""Figures of arms and results for notebooks, which show them without being asked."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from model.arm import Arm
from model.settle import settle
from model.shape import Shape
from model.stiffness import Stiffness
from model.text import drawn_by
from planner.plan import Plan


def force_to_show(k: Stiffness) -> float:
    """Return a power of ten [N]: the force that moves the point by no more than L / 5."""
    most = 0.2 * k.shape.arm.length / float(k.ellipsoid()[0][0])
    return float(10.0 ** math.floor(math.log10(most)))


def _arm(arm: Arm) -> bytes:
    return _shape(settle(arm, np.zeros(arm.n_tendons), accuracy=1e-2))


def _shape(shape: Shape) -> bytes:
    from planner.plots.plan import plot_shape

    return _png(plot_shape(shape))


def _plan(plan: Plan) -> bytes:
    return _png(plan.plot())


def _stiffness(k: Stiffness) -> bytes:
    from planner.plots.stiffness import plot_ellipsoids

    return _png(plot_ellipsoids([k], force_to_show(k)))


def _png(figure: Any) -> bytes:
    from planner.plots.plan import drawn

    return drawn(figure, "png")


drawn_by(Arm, _arm)
drawn_by(Shape, _shape)
drawn_by(Plan, _plan)
drawn_by(Stiffness, _stiffness)
