"""How stiff the arm has to be, or may be: targets that combine with any shape."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import field
from typing import Annotated, Any

import casadi as ca
import numpy as np

from octoplan.model.arm import Arm
from octoplan.model.paths import Array
from octoplan.model.stiffness import Hold
from octoplan.model.support.checks import finite_array, unit_vector
from octoplan.model.support.errors import InputError
from octoplan.model.support.machine.functions import cached
from octoplan.model.support.quantities import Direction, Stiffness, Tension
from octoplan.model.support.value import Rule, value
from octoplan.planner.targets.base import OVER_WANTED, ComplianceRequest, Target, Terms, View

SHARE = f"stiffness{OVER_WANTED}"


@value
class _Directed(Target):
    """What is said of the tip's stiffness along a direction.

    The stiffness is the force per displacement along the direction, with the tip free to move
    across it and to turn: 1 / (d . C d) with the compliance C of octoplan.model.stiffness.
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
        """See Target.prescribed: an extreme of the stiffness along a direction, there or back."""
        d = np.array(self.direction)
        along = np.round(d * np.sign(d[np.flatnonzero(d)[0]]), 9) + 0.0
        return {f"extreme of the stiffness along {along}, held by {self.hold}": along}

    def parameters(self, arm: Arm) -> Array:
        """See Target.parameters: the direction, the compliance of the arm at rest."""
        return np.append(self.direction, rest_compliance(arm))


@value
class Stiffest(_Directed):
    """The tip as stiff along a direction as the limits allow; effort no longer matters.

    Attributes
    ----------
    direction : (3,)
        In the base frame.
    hold : "tension" or "length"
        What holds the tendons. With lengths all tendons are counted as locked, also those without
        tension, as stiffness does with release=False; the outcome tells how stiff the tip is with
        these released.
    tendon_EA : float or None
        Stiffness E A of the tendons themselves, with their lengths held [N]; see stiffness.
    """

    def terms(self, view: View, p: ca.MX) -> Terms:
        """See Target.terms."""
        return Terms(objective={"compliance": _log_compliance(view, p)})


@value
class Softest(_Directed):
    """The tip as soft along a direction as the limits allow; see Stiffest.

    Attributes
    ----------
    direction : (3,)
        In the base frame.
    hold : "tension" or "length"
        What holds the tendons.
    tendon_EA : float or None
        Stiffness E A of the tendons themselves, with their lengths held [N].
    """

    def terms(self, view: View, p: ca.MX) -> Terms:
        """See Target.terms."""
        return Terms(objective={"stiffness": -_log_compliance(view, p)})


def _direction_or_matrix(name: str, argument: Any) -> tuple[Any, ...]:
    """Return a direction (3,), or a symmetric positive definite matrix (3, 3), row by row."""
    if np.ndim(argument) != 2:
        return unit_vector(name, argument)
    matrix = finite_array(name, argument, (3, 3))
    if not np.allclose(matrix, matrix.T) or np.linalg.eigvalsh(matrix)[0] <= 0:
        raise InputError(name, argument, "a direction, or a symmetric positive definite matrix")
    return tuple(map(tuple, matrix.tolist()))


@value
class MinimumStiffness(Target):
    """The tip at least so stiff: against forces along a direction, or against all of them.

    Attributes
    ----------
    direction : (3,) or (3, 3)
        A direction in the base frame; or a symmetric positive definite matrix M, and the
        stiffness against forces, (C_ff)^-1, has to be at least value M as a matrix.
    value : float
        Along a direction [N/m]; or the factor of the matrix.
    hold : "tension" or "length"
        What holds the tendons. With lengths all tendons are counted as locked, also those without
        tension, as stiffness does with release=False; the outcome tells how stiff the tip is with
        these released.
    tendon_EA : float or None
        Stiffness E A of the tendons themselves, with their lengths held [N]; see stiffness.
    """

    direction: Annotated[Any, Rule(_direction_or_matrix)]
    value: Stiffness
    hold: Hold = "tension"
    tendon_EA: Tension | None = None

    def __post_init__(self) -> None:
        _check_hold("MinimumStiffness", self.hold, self.tendon_EA)

    def compliance_request(self) -> ComplianceRequest:
        """See Target.compliance_request: along one direction, or all three."""
        return ComplianceRequest(
            self.hold, 3 if np.ndim(self.direction) == 2 else 1, self.tendon_EA
        )

    def directions(self, p: ca.MX) -> ca.MX:
        """See Target.directions: scaled so that what is wanted is a compliance of 1 at most."""
        return ca.reshape(p, 3, self.compliance_request().width)

    def parameters(self, arm: Arm) -> Array:
        """See Target.parameters: the direction, or the matrix's root; times the value's root."""
        argument = np.array(self.direction)
        if argument.ndim == 2:
            values, vectors = np.linalg.eigh(argument)
            argument = vectors @ np.diag(np.sqrt(values)) @ vectors.T
        return np.ravel(argument * np.sqrt(self.value))

    def terms(self, view: View, p: ca.MX) -> Terms:
        """See Target.terms: the stiffness over that wanted, less 1; or minors of a matrix."""
        if np.ndim(self.direction) == 1:
            return Terms(reciprocal={SHARE: view.compliance}, low_priority=frozenset({SHARE}))
        name = "stiffness above that wanted"
        return Terms(
            inequality={name: cached(_minors)(view.compliance)}, low_priority=frozenset({name})
        )


def _minors() -> ca.Function:
    """Return compliance G (3, 3) -> principal minors of 1 - G, 0 or above where G is at most 1."""
    G = ca.SX.sym("G", 3, 3)
    spare = ca.SX.eye(3) - G
    pairs = ([0, 1], [0, 2], [1, 2])
    minors = [ca.diag(spare), *(ca.det(spare[pair, pair]) for pair in pairs), ca.det(spare)]
    return ca.Function("minors", [G], [ca.vertcat(*minors)])


def _log_compliance(view: View, p: ca.MX) -> ca.MX:
    """Return the logarithm of the compliance over that of the straight arm at rest."""
    return ca.log(view.compliance / p[3])


def rest_compliance(arm: Arm) -> float:
    """Return about the lateral compliance of the straight arm at rest [m/N]."""
    s = np.linspace(0.0, arm.length, 201)
    EJ = arm.material.E * np.pi * arm.radius.evaluate(s, arm.length)[0] ** 4 / 4
    return float(np.trapezoid((arm.length - s) ** 2 / EJ, s))


def _check_hold(name: str, hold: Hold, tendon_EA: float | None) -> None:
    if tendon_EA is not None and hold == "tension":
        raise InputError(f"{name}.tendon_EA", tendon_EA, 'None, unless hold is "length"')
