"""The tendons of an arm: lengths without loads, strokes, compliance, and which tendons are taut."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property, lru_cache, partial
from typing import TYPE_CHECKING, Any

import numpy as np

from octoplan.model.arm import Arm
from octoplan.model.cross_section.law import cross_section_of
from octoplan.model.cross_section.sections import Sections
from octoplan.model.effects.sections import Extension
from octoplan.model.mesh import graded
from octoplan.model.paths import Array, Mask
from octoplan.model.scene import Scene
from octoplan.model.support.checks import positive
from octoplan.model.support.errors import CollapsedError, InputError

if TYPE_CHECKING:
    from octoplan.model.shape import Shape

# Gauss points per element of the coarsest mesh in tendon lengths. Strains are analytic between
# nodes, so that only rounding remains, also at three times the tensions of the paper's arms.
LENGTH_POINTS = 8
# Smallest compliance of tendons with given lengths, over that of the arm. Regularises combinations
# of lengths that no strain changes.
_LEAST_COMPLIANCE = 1e-10
# Smallest shortening by a taut tendon of the straight arm, over the arm's length. Smaller tensions
# are rounding of solvers.
_TAUT_STROKE = 1e-8


@dataclass(frozen=True, eq=False)
class Lengths:
    """Tendon lengths under tensions.

    Attributes
    ----------
    at : Sections
        The cross-sections at the points of the quadrature.
    tensions : (n_tendons,)
        [N].
    strains : (N, n)
        Strains of the cross-sections.
    lengths : (n_tendons,)
        [m].
    jacobian : (n_tendons, N, n)
        Derivatives of the lengths by the strains.
    """

    at: Sections
    tensions: Array
    strains: Array
    lengths: Array
    jacobian: Array

    @classmethod
    def under(cls, at: Sections, weights: Array, tensions: Array) -> Lengths:
        """Return the lengths under tensions (n_tendons,), with weights (N,) of cross-sections."""
        v = at.strains(tensions)
        return cls(at, tensions, v, *at.lengths(v, weights))

    @property
    def crushed(self) -> CollapsedError | None:
        """The error of the first cross-section in which a tendon has no length, if any."""
        return self.at.crushed(self.strains)

    @cached_property
    def length_tension(self) -> Array:
        """The derivatives of the lengths by the tensions (n_tendons, n_tendons) [m/N]."""
        at = self.at
        balance = at.balance(self.strains, self.tensions[at.tendon])
        return np.tensordot(self.jacobian, at.by_tensions(balance), 2)


@lru_cache(maxsize=48)
def tendon_lengths(
    arm: Arm, scene: Scene, machine_code: bool = False
) -> Callable[[Array], Lengths]:
    """Return the function tensions (n_tendons,) -> Lengths, by Gauss quadrature, without loads.

    The function raises UnsettledSectionError.
    """
    law = cross_section_of(scene, arm.is_curved, twisted=False)
    s, weights, active = graded(arm, 1).points(LENGTH_POINTS)
    return partial(Lengths.under, Sections(arm, scene, law, s, active, machine_code), weights)


@lru_cache(maxsize=64)
def _at_rest(arm: Arm) -> Lengths:
    """Return the tendons of the arm without tensions and loads."""
    arm = arm.with_continuous_guides
    result = tendon_lengths(arm, Scene(Extension()))(np.zeros(arm.n_tendons))
    result.lengths.setflags(write=False)
    return result


def rest_lengths(arm: Arm) -> Array:
    """Return the length of each tendon in the arm at rest (n_tendons,) [m].

    The length is the integral of |t + Y' + kappa_0 x Y| with Y = y d and the curvature at rest
    kappa_0; the length of a tendon with guides is the sum of its spans. Strokes are measured from
    rest lengths.
    """
    return _rest_lengths(arm)


@lru_cache(maxsize=64)
def _rest_lengths(arm: Arm) -> Array:
    """Return the rest lengths (n_tendons,) as a read-only array [m]."""
    result = _at_rest(arm).lengths.copy()
    if arm.is_guided:
        from octoplan.model.extensions.guides import rest_lengths_of_spans

        result = rest_lengths_of_spans(arm, result)
    result.setflags(write=False)
    return result


def strokes(shape: Shape, zero: Any = None) -> Array:
    """Return the strokes of the winches (n_tendons,) [m]: lengths at zero minus lengths.

    `zero` are the lengths (n_tendons,) at which winches are zeroed [m]; those of the straight arm
    at rest unless given. The stroke of a slack tendon is its maximum without tension.
    """
    left = shape.tendon_lengths
    if shape.winches is not None:
        left = np.where(shape.winches.held, shape.winches.lengths, left)
    return taken_in(shape.arm, left, zero)


def taken_in(arm: Arm, lengths: Array, zero: Any = None) -> Array:
    """Return the strokes for tendon lengths (..., n_tendons) [m]; see strokes."""
    return np.asarray((rest_lengths(arm) if zero is None else np.array(zero)) - lengths)


def is_taut(arm: Arm, tensions: Array) -> Mask:
    """Return whether each tendon is taut under tensions (..., n_tendons) [N].

    A tendon is slack below 1e-8 L / C with the compliance C of all tendons, see arm_compliance.
    """
    return np.asarray(tensions > _TAUT_STROKE * arm.length / arm_compliance(arm))


def arm_compliance(arm: Arm) -> float:
    """Return the sum of the shortenings of all tendons by 1 N in each, of the arm at rest [m/N].

    Each tendon counts under its own tension alone, as if it was guided continuously. In a straight
    arm without slopes the terms are the integrals of y^2 / EJ + 1 / EA.
    """
    return -float(np.trace(_at_rest(arm).length_tension))


def least_compliance(arm: Arm) -> float:
    """Return the smallest compliance of tendons with given lengths [m/N].

    The compliance regularises undetermined tensions. It is a negligible fraction of the arm's.
    """
    return _LEAST_COMPLIANCE * arm_compliance(arm)


def checked_EA(value: Any) -> float:
    """Return the stiffness E A of tendons [N]; raise InputError unless it is positive."""
    with suppress(InputError):
        return positive("tendon_EA", value)
    raise InputError("tendon_EA", value, "a number above 0 [N], or None")
