"""A part of the arm that lies on a cylinder with friction: derivatives, and a growing grip."""

import casadi as ca
import numpy as np
import pytest

from octoplan.model import Scene, settle
from octoplan.model.effects import ExactTendons, Extension
from octoplan.model.extensions.contact.effects import Contact
from octoplan.model.extensions.contact.forward import TouchingMap
from octoplan.model.extensions.contact.kernels import touch
from octoplan.model.extensions.obstacles import Capsule, HalfSpace
from octoplan.model.extensions.obstacles.base import SIZE
from tests.contact.cases import bar
from tests.contact.test_rubbing import cone

RHO, RADIUS, E, MU = 0.04, 0.004, 2e5, 0.3
STATICS = Extension(), ExactTendons()


def test_friction_at_the_end_of_a_part_without_pressure_is_bounded() -> None:
    """Derivatives of 1e30 ended Newton's method if a neighbour of the end was without pressure."""
    arm, floor = bar(0.1, RADIUS, E), HalfSpace((0, 0, -0.1), (0, 0, 1))
    system = TouchingMap(arm, Scene(*STATICS, Contact(floor, friction=MU)), 1).system
    kernel = touch(system.layout.structure.law, 3, True, True)
    y, c = np.zeros(kernel.y.numel()), np.zeros(kernel.c.numel())
    # From the end: traction, friction, pressure and traction of two neighbours, p, P, u, q.
    y[-3:], y[-16:-14], y[-23] = 0.1, 1.0, 1.0
    y[[-13, -9]] = 0.1
    c[:SIZE] = floor.parameters
    c[SIZE : SIZE + 3] = RADIUS, 0.0, 0.01
    # Flags of the first node of a part; friction and its slip stiffness.
    c[SIZE + 3 : SIZE + 9] = 1.0, 1.0, 0.0, 1.0, MU, 10.0
    jacobian = ca.Function("J", [kernel.y, kernel.c], [ca.jacobian(kernel.r, kernel.y)])
    assert np.abs(jacobian(y, c).full()).max() < 1e3


@pytest.mark.slow
def test_an_arm_around_a_cylinder_grips_harder_with_friction() -> None:
    """No equilibrium was found: steps cycled between sticking and slipping nodes."""
    length = np.radians(270) * RHO
    arm = bar(length, RADIUS, E)
    z = -1.02 * RHO
    cylinder = Capsule((0, -0.1, z), (0, 0.1, z), RHO - RADIUS)
    smooth, rough = (Scene(*STATICS, Contact(cylinder, friction=mu)) for mu in (0.0, MU))
    begin, end = [0.0, 0.507, 0.0, 0.0], [0.0, 0.534, 0.0, 0.0]
    near = settle(arm, begin, smooth, 1e-5)
    free = settle(arm, end, smooth, 1e-5)
    held = settle(arm, end, rough, 1e-5, near=near)
    assert not held.snaps
    assert cone(held, MU) < 1e-6
    without, grip = (
        sum(np.linalg.norm(touch.force - touch.friction) for touch in shape.contacts)
        for shape in (free, held)
    )
    assert grip > 1.5 * without
