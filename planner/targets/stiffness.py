"""Targets: stiffness of the tip, to combine with any shape."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import field
from typing import Annotated, Any

import casadi as ca
import numpy as np

from octoplan.model.arm import Arm
from octoplan.model.paths import Array
from octoplan.model.stiffness import Hold
from octoplan.model.support.checks import finite_array, numbers, unit_vector
from octoplan.model.support.errors import InputError
from octoplan.model.support.machine.functions import cached
from octoplan.model.support.value import Direction, Rule, Stiffness, Tension, value
from octoplan.planner.targets.base import OVER_WANTED, ComplianceRequest, Target, Terms, View

SHARE = f"stiffness{OVER_WANTED}"


@value
class _Directed(Target):
    """A requirement on the stiffness of the tip along a direction.

    The stiffness is the force per displacement along the direction, with a tip that is free to move
    perpendicularly and to turn: 1 / (d . C d) with the compliance C of octoplan.model.stiffness.
    """

    direction: Direction
    hold: Hold = field(default="tension", kw_only=True)
    tendon_EA: Tension | None = field(default=None, kw_only=True)

    def __post_init__(self) -> None:
        _check_hold(type(self).__name__, self.hold, self.tendon_EA)

    def compliance_request(self) -> ComplianceRequest:
        """See Target.compliance_request: along one direction."""
        return ComplianceRequest(self.hold, 1, self.tendon_EA)

    def directions(self, p: ca.MX) -> ca.MX:
        """See Target.directions."""
        return p[:3]

    def prescribed(self, arm: Arm) -> Mapping[str, Array]:
        """See Target.prescribed: the direction, up to its sign."""
        d = np.array(self.direction)
        along = np.round(d * np.sign(d[np.flatnonzero(d)[0]]), 9) + 0.0
        return {f"extreme of the stiffness along {along}, held by {self.hold}": along}

    def parameters(self, arm: Arm) -> Array:
        """See Target.parameters: the direction, and the compliance of the arm at rest."""
        return np.append(self.direction, rest_compliance(arm))


@value
class Stiffest(_Directed):
    """The stiffest tip along a direction within the limits, whatever the effort.

    Attributes
    ----------
    direction : (3,)
        In the base frame.
    hold : "tension" or "length"
        Quantity of the tendons that is held constant. With lengths, all tendons count as locked,
        including tendons without tension, as in stiffness with release=False; the outcome reports
        the stiffness with slack tendons released.
    tendon_EA : float or None
        Axial stiffness E A of the tendons, if lengths are held [N]; see stiffness.
    """

    def terms(self, view: View, p: ca.MX) -> Terms:
        """See Target.terms."""
        return Terms(objective={"compliance": _log_compliance(view, p)})


@value
class Softest(_Directed):
    """The softest tip along a direction within the limits; see Stiffest.

    Attributes
    ----------
    direction : (3,)
        In the base frame.
    hold : "tension" or "length"
        Quantity of the tendons that is held constant.
    tendon_EA : float or None
        Axial stiffness E A of the tendons, if lengths are held [N].
    """

    def terms(self, view: View, p: ca.MX) -> Terms:
        """See Target.terms."""
        return Terms(objective={"stiffness": -_log_compliance(view, p)})


def _direction_or_matrix(name: str, argument: Any) -> tuple[Any, ...]:
    """Return a direction (3,), or a symmetric positive definite matrix (3, 3), row by row."""
    allowed = "a direction, or a symmetric positive definite matrix"
    if numbers(name, argument, allowed).ndim != 2:
        return unit_vector(name, argument)
    matrix = finite_array(name, argument, (3, 3))
    if not np.allclose(matrix, matrix.T) or np.linalg.eigvalsh(matrix)[0] <= 0:
        raise InputError(name, argument, allowed)
    return tuple(map(tuple, matrix.tolist()))


@value
class MinimumStiffness(Target):
    """Smallest stiffness of the tip, against forces along a direction or in all directions.

    Attributes
    ----------
    direction : (3,) or (3, 3)
        A direction in the base frame; or a symmetric positive definite matrix M, if the stiffness
        (C_ff)^-1 against forces must be at least value times M as a matrix.
    value : float
        Stiffness along the direction [N/m]; or factor of the matrix.
    hold : "tension" or "length"
        Quantity of the tendons that is held constant. With lengths, all tendons count as locked,
        including tendons without tension, as in stiffness with release=False; the outcome reports
        the stiffness with slack tendons released.
    tendon_EA : float or None
        Axial stiffness E A of the tendons, if lengths are held [N]; see stiffness.
    """

    direction: Annotated[Any, Rule(_direction_or_matrix)]
    value: Stiffness
    hold: Hold = "tension"
    tendon_EA: Tension | None = None

    stiffness_unit = "times the required value"

    def __post_init__(self) -> None:
        _check_hold("MinimumStiffness", self.hold, self.tendon_EA)

    def compliance_request(self) -> ComplianceRequest:
        """See Target.compliance_request: one direction, or all three."""
        return ComplianceRequest(
            self.hold, 3 if np.ndim(self.direction) == 2 else 1, self.tendon_EA
        )

    def directions(self, p: ca.MX) -> ca.MX:
        """See Target.directions: scaled so that the largest allowed compliance is 1."""
        return ca.reshape(p, 3, self.compliance_request().width)

    def parameters(self, arm: Arm) -> Array:
        """See Target.parameters: the direction or the root of M, times the root of the value."""
        argument = np.array(self.direction)
        if argument.ndim == 2:
            values, vectors = np.linalg.eigh(argument)
            argument = vectors @ np.diag(np.sqrt(values)) @ vectors.T
        return np.ravel(argument * np.sqrt(self.value))

    def terms(self, view: View, p: ca.MX) -> Terms:
        """See Target.terms: relative stiffness minus 1, or principal minors for a matrix."""
        if np.ndim(self.direction) == 1:
            return Terms(reciprocal={SHARE: view.compliance}, low_priority=frozenset({SHARE}))
        name = "stiffness above that wanted"
        return Terms(
            inequality={name: cached(_minors)(view.compliance)}, low_priority=frozenset({name})
        )


def _minors() -> ca.Function:
    """Return the function G (3, 3) -> principal minors of 1 - G, nonnegative for G <= 1."""
    G = ca.SX.sym("G", 3, 3)
    difference = ca.SX.eye(3) - G
    pairs = ([0, 1], [0, 2], [1, 2])
    minors = [
        ca.diag(difference),
        *(ca.det(difference[pair, pair]) for pair in pairs),
        ca.det(difference),
    ]
    return ca.Function("minors", [G], [ca.vertcat(*minors)])


def _log_compliance(view: View, p: ca.MX) -> ca.MX:
    """Return the logarithm of the compliance over that of the straight arm at rest."""
    return ca.log(view.compliance / p[3])


def rest_compliance(arm: Arm) -> float:
    """Return an estimate of the lateral compliance of the straight arm at rest [m/N]."""
    s = np.linspace(0.0, arm.length, 201)
    EJ = arm.section_stiffness(s)[0, 1:3].min(axis=0)
    return float(np.trapezoid((arm.length - s) ** 2 / EJ, s))


def _check_hold(name: str, hold: Hold, tendon_EA: float | None) -> None:
    if tendon_EA is not None and hold == "tension":
        raise InputError(f"{name}.tendon_EA", tendon_EA, 'None, unless hold is "length"')
