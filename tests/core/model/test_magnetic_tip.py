"""An effect that the model does not contain: a magnet on the tip in a uniform field.

The moment on the tip is (R m) x B with the dipole moment m fixed in the frame of the tip. One
effect with its rod term defines the magnet.
"""

from dataclasses import dataclass
from typing import Any, ClassVar

import casadi as ca
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import root

from octoplan import Arm, InputError, Scene, TipPosition, plan, settle
from octoplan.model.effects.base import Effect, EffectSet
from octoplan.model.loads import has_unique_equilibrium
from octoplan.model.mesh import Counts, Mesh
from octoplan.model.rod.rod_term import NodeView, RodTerm, Sizes, Values
from octoplan.model.support.value import Vector, value
from tests.core.effects.bars import Bar

DIPOLE = (0.02, 0.01, -0.005)  # A m2, in the frame of the tip
FIELD = (0.01, 0.03, 0.02)  # T


@dataclass(frozen=True)
class MagneticTipTerm(RodTerm):
    dipole: tuple[float, ...]
    field: tuple[float, ...]
    couples_sections = True
    node_parameters: ClassVar[Sizes] = {"dipole": 3, "field": 3}

    def nodes(self, mesh: Mesh) -> tuple[int, ...]:
        return (mesh.elements,)

    def node_moment(self, node: NodeView) -> ca.SX:
        return ca.cross(node.frame @ node.parameters["dipole"], node.parameters["field"])

    def node_values(self, arm: Arm, mesh: Mesh, nodes: Counts) -> Values:
        return {"dipole": np.array(self.dipole)[:, None], "field": np.array(self.field)[:, None]}


@value
class MagneticTip(Effect):
    dipole: Vector
    field: Vector

    def rod_term(self, scene: EffectSet) -> RodTerm:
        return MagneticTipTerm(self.dipole, self.field)


SCENE = Scene(MagneticTip(DIPOLE, FIELD))


def bar_end(bar: Bar, moment: Any) -> tuple[Any, Any]:
    """Return frame and position at the tip of a bar under a constant moment."""
    stiffness = np.array([bar.GI(0), bar.EJ(0), bar.EJ(0)])

    def rates(_: float, y: Any) -> Any:
        R = y[:9].reshape(3, 3)
        x, y_, z = R.T @ moment / stiffness
        return np.append(R @ np.array([[0, -z, y_], [z, 0, -x], [-y_, x, 0]]), R[:, 0])

    start = np.append(np.array(bar.arm.base_frame), bar.arm.base_position)
    end = solve_ivp(rates, (0, bar.length), start, "DOP853", rtol=1e-12, atol=1e-14).y[:, -1]
    return end[:9].reshape(3, 3), end[9:]


def test_magnet_bends_a_bar_as_shooting_does() -> None:
    bar = Bar(base=0.004, tip=0.004)

    def excess(moment: Any) -> Any:
        return moment - np.cross(bar_end(bar, moment)[0] @ DIPOLE, FIELD)

    frame, position = bar_end(bar, root(excess, np.zeros(3), tol=1e-14).x)
    shape = settle(bar.arm, [0.0], SCENE, 1e-9)
    assert np.linalg.norm(position) < 0.98 * bar.length
    assert np.abs(shape.tip - position).max() < 1e-8 * bar.length
    assert np.abs(shape.frame(bar.length) - frame).max() < 1e-7


def test_plan_with_a_magnet_meets_its_target_and_is_certified() -> None:
    arm = Arm.from_paper("table-2")
    scene = Scene.silicone(MagneticTip(DIPOLE, FIELD))
    tensions = np.linspace(0.0, 0.2, arm.n_tendons)
    target = settle(arm, tensions, scene).tip
    result = plan(arm, TipPosition(tuple(target)), scene)
    assert result.certificate.passed
    assert np.abs(result.shape.tip - target).max() < 1e-4 * arm.length


def test_load_without_bounds_may_have_several_equilibria() -> None:
    assert not has_unique_equilibrium(Arm.from_paper("table-2"), SCENE)


@dataclass(frozen=True)
class UndeclaredForceTerm(MagneticTipTerm):
    """A force in the frame of the tip, without `depends_on_shape`."""

    def node_force(self, node: NodeView) -> ca.SX:
        return node.frame @ node.parameters["dipole"]


@value
class UndeclaredForce(MagneticTip):
    def rod_term(self, scene: EffectSet) -> RodTerm:
        return UndeclaredForceTerm(self.dipole, self.field)


def test_a_force_that_the_rod_would_leave_out_is_refused() -> None:
    with pytest.raises(InputError, match=r"UndeclaredForceTerm\.depends_on_shape"):
        settle(Arm.from_paper("table-4"), [[0] * 4] * 3, Scene(UndeclaredForce(DIPOLE, FIELD)))
