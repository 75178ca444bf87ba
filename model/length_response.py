"""How a settled shape answers to the lengths of its tendons: what a winch does, or does wrong."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from model.compliance import sensitivities
from model.paths import Array
from model.shape import Shape
from model.winches import least_compliance, pulls


@dataclass(frozen=True, eq=False)
class LengthResponse:
    """The derivatives of a shape by what winches leave of its tendons, the others held as they are.

    Attributes
    ----------
    taut : (n_tendons,)
        Whether a winch holds the tendon, and it pulls: the others have columns of zeros.
    tension : (n_tendons, n_tendons)
        Tensions per metre of each tendon that is paid out [N/m].
    tip : (3, n_tendons)
        Displacement of the tip [-].
    rotation : (3, n_tendons)
        Rotation of the tip [rad/m], base frame.
    """

    taut: NDArray[np.bool_]
    tension: Array
    tip: Array
    rotation: Array


def length_response(shape: Shape) -> LengthResponse:
    """Return how a shape changes with the lengths of its taut tendons.

    By the implicit function theorem: with l(T) the lengths at equilibrium, taut tendons keep
    length + stretch T - l(T) = 0. Of a shape by tensions all tendons that pull are taken as held.
    Slack tendons stay slack and taut ones taut: it holds for changes that are small enough.
    """
    found, T = sensitivities(shape, shape.arm.length, shape.refinement), shape.tensions
    pulling = pulls(shape.arm, T)
    winches = shape.winches
    held = np.ones(T.size, dtype=bool) if winches is None else winches.held
    stretch = np.zeros(T.size) if winches is None else winches.stretch
    longer = 1 + T / (np.inf if winches is None else winches.tendon_EA)
    taut = np.flatnonzero(held & pulling)
    own = stretch[taut] + least_compliance(shape.arm)
    M = np.diag(own) - found.length_tension[np.ix_(taut, taut)]
    tension = np.zeros((T.size, T.size))
    tension[np.ix_(taut, taut)] = -np.linalg.solve(M, np.diag(longer[taut]))
    pose = found.pose_tension @ tension
    return LengthResponse(held & pulling, tension, pose[:3], pose[3:])
