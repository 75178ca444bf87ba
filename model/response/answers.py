"""Slopes of a settled shape, on a mesh that is fine enough for them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from model.errors import NotSettledError
from model.ladder import FINEST, REFINEMENTS, estimate, next_refinement
from model.paths import Array
from model.response.compliance import closed_compliance
from model.response.give import give_function
from model.response.sensitivity import Answers, Sensitivity, sensitivity
from model.shape import Shape
from model.statics import is_loaded

_ORDER = 6
# The estimate for a compliance over that for the tip: 4 for table 2, 80 for table 4, whose tip is
# slender. Too little costs a third mesh, too much a finer one.
_HARDER = 80.0


@dataclass(frozen=True, eq=False)
class Found:
    """A compliance (6, 6), what else was found with it, and how well.

    Attributes
    ----------
    compliance : (6, 6)
        Displacement [m] and turn [rad] per force [N] and moment [N m], in the base frame.
    stable : bool
        Whether the equilibrium has kept its stability, tensions held.
    refinement : int
        Of the mesh.
    error : float
        Estimated relative error.
    slopes : Answers or None
        Of that mesh, where they came along.
    """

    compliance: Array
    stable: bool
    refinement: int
    error: float
    slopes: Answers | None


def compliance_of(shape: Shape, at: float, accuracy: float, lengths: bool) -> Found:
    """Return the compliance at arc length `at`, tensions held, to a relative accuracy.

    `lengths` says that slopes of tendon lengths will be asked for. Raises NotSettledError.
    """
    T, size = shape.tensions, np.repeat([shape.arm.length, 1.0], 3)
    scale = np.outer(size, size)
    coarse, fine = _first_pair(shape, accuracy)
    before: tuple[int, Array] | None = None
    refinement, error = coarse, np.inf
    while refinement:
        slopes = None
        if is_loaded(shape.scene):
            slopes = _loaded(shape, at, refinement, lengths and refinement >= fine)
            C, stable = slopes.pose_wrench, slopes.stable
        else:
            C, stable = give_function(shape.arm, shape.scene, refinement, at)(T)[0].T, True
        scaled = C / scale
        if before is not None:
            gap = np.abs(scaled - before[1]).max() / np.abs(scaled).max()
            error = estimate(gap, before[0], refinement, _ORDER)
            if error <= accuracy:
                return Found(C, stable, refinement, error, slopes)
        before = refinement, scaled
        if refinement < fine:
            refinement = fine
        else:
            refinement = next_refinement(refinement, error, accuracy, _ORDER)
    raise NotSettledError(accuracy, error, "ask for less accuracy or a smoother arm")


def slopes_of(shape: Shape, at: float, refinement: int, lengths: bool) -> Answers:
    """Return all slopes on the mesh of a refinement; those of tendon lengths if asked for."""
    if is_loaded(shape.scene):
        return _loaded(shape, at, refinement, lengths)
    function = closed_compliance(shape.arm, shape.scene, refinement, at, lengths).call
    C, pose_tension, *rest = (value.T for value in function(shape.tensions))
    length, drawn, spread = rest or (np.zeros(0), np.zeros((0, 6)), np.zeros((0, 0)))
    return Answers(C, pose_tension, drawn, spread, length.ravel(), True)


def _first_pair(shape: Shape, accuracy: float) -> tuple[int, int]:
    """Return the two refinements to begin with, by the error that settling was left with."""
    harder = (_HARDER * shape.error / accuracy) ** (1 / _ORDER)
    wanted = min(max(shape.refinement * harder, 2), FINEST / 2)
    fine = next(r for r in REFINEMENTS if r >= wanted)
    return max(r for r in REFINEMENTS if r <= fine / 2), fine


def _loaded(shape: Shape, at: float, refinement: int, lengths: bool) -> Answers:
    slopes = sensitivity(shape.arm, shape.scene, "rk6", refinement, at, lengths)
    return slopes.at(shape.tensions, _states(slopes, shape))


def _states(slopes: Sensitivity, shape: Shape) -> Array:
    """Return the states of a shape on the mesh of its slopes."""
    return slopes.loaded.run(shape.tensions, slopes.starts_at(shape))[0]
