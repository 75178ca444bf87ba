"""The tendons of an arm: lengths without loads, strokes, compliance, and which tendons are taut."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, lru_cache, partial
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from octoplan.model.arm import Arm
from octoplan.model.cross_section.law import cross_section_of
from octoplan.model.cross_section.sections import Sections
from octoplan.model.effects.sections import Extension
from octoplan.model.mesh import graded
from octoplan.model.paths import SAME, Array, Mask
from octoplan.model.scene import Scene
from octoplan.model.support.checks import LARGEST, SMALLEST
from octoplan.model.support.errors import CollapsedError, InputError
from octoplan.model.support.units import length_text

if TYPE_CHECKING:
    from octoplan.model.shape import Shape

# Gauss points per element of the coarsest mesh in tendon lengths. Strains are analytic between
# nodes, so that only rounding remains, also at three times the tensions of the paper's arms.
LENGTH_POINTS = 8
# Smallest compliance of tendons with given lengths, over that of the arm. Regularises combinations
# of lengths that no strain changes.
_LEAST_COMPLIANCE = 1e-10
# Largest ratio of total pull and Euler load between discs at which the shape is that of continuous
# guides: at a ratio of 0.04 the tip differs by 0.4 % of the length at a bend of 23 degrees.
_FEW_DISCS = 0.05
# Number of arc lengths at which the smallest radius is sought.
_RADIUS_SAMPLES = 33
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


def guide_remark(arm: Arm, tensions: Array) -> str:
    """Return a remark if the arm states too few discs for continuous guides, otherwise "".

    The tendons in a hull are guided by discs, and the anchorages are the only discs that an arm
    without guides states. Between discs the arm is a column under the total pull P of the tendons
    that cross. Its Euler load is pi^2 EJ / l^2, with the least EJ of the segment of length l. The
    shape differs from that of continuous guides in proportion to the ratio.
    """
    is_unknown = any(section.guides is None for section in arm.sections)
    if arm.hull is None or not is_unknown:
        return ""
    discs = np.array([0.0, *sorted(arm.anchorages)])
    ends = np.array([arm.sections[i].at for i, _ in arm.tendons])
    worst = (0.0, 0.0, 0.0)
    for a, b in pairwise(discs.tolist()):
        pull = float(tensions[ends >= b * (1 - SAME)].sum())
        EJ = arm.section_stiffness(np.linspace(a, b, _RADIUS_SAMPLES))[0, 1:3].min()
        euler = float(np.pi**2 * EJ / (b - a) ** 2)
        worst = max(worst, (pull / euler, a, b))
    ratio, a, b = worst
    if ratio <= _FEW_DISCS:
        return ""
    return (
        "tendons in the hull count as guided continuously; with discs at the anchorages alone, "
        f"the total pull is {ratio:.2g} times the Euler load of the segment from {length_text(a)} "
        f"to {length_text(b)}; state the discs as Anchorage.guides"
    )


def least_compliance(arm: Arm) -> float:
    """Return the smallest compliance of tendons with given lengths [m/N].

    The compliance regularises undetermined tensions. It is a negligible fraction of the arm's.
    """
    return _LEAST_COMPLIANCE * arm_compliance(arm)


def checked_EA(value: Any) -> float:
    """Return the stiffness E A of tendons [N]; raise InputError unless it is positive."""
    is_number = isinstance(value, int | float | np.number) and not isinstance(value, bool)
    if not (is_number and SMALLEST <= value <= LARGEST):
        raise InputError("tendon_EA", value, "a number above 0 [N], or None")
    return float(value)
