"""An arm bent over a cylinder against PyElastica: a damped rod, its nodes pressed back by springs.

PyElastica steps a staggered chain of elements through time until damping brings the rod to rest,
see tests.core.effects.test_dynamic_relaxation. Here each node that is inside of a cylinder by d is
pressed back by k d, with k equal to the axial stiffness of an element. Elements are stiffer in
shear the shorter they are, because the arm has no shear: all refine together towards the contact by
complementarity. Only nodes touch, so that orders are from one to two. Measured with 15, 30 and 60
elements: midlines differ by 2.7e-3, 1.1e-3 and 3.1e-4 of the length for an arm that touches at a
point, by 2.2e-3, 5.2e-4 and 2.1e-4 for an arm that lies on the cylinder; forces by 1.0e-2, 2.1e-3
and 5.7e-4, and by 2.4e-3, 2.8e-4 and 1.8e-4.
"""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np
import pytest

from octoplan.model import Scene, Shape, settle
from octoplan.model.effects import ExactTendons, Extension, TipLoad
from octoplan.model.extensions.contact.effects import Contact
from octoplan.model.extensions.obstacles import Capsule
from tests.contact.cases import bar, stiffness
from tests.oracles import Array

elastica: Any = pytest.importorskip(
    "elastica", reason="the optional extra: pip install octoplan[pyelastica]"
)
from tests.core.effects.test_dynamic_relaxation import (  # noqa: E402  (skipped without PyElastica)
    Clamp,
    LinearSection,
    Simulator,
)

pytestmark = pytest.mark.slow

LENGTH, RADIUS, E, DENSITY = 0.3, 0.012, 1e6, 1000.0
ROUND, CENTRE = 0.06, np.array([0.15, 0.0, -0.076])
DAMPING, STILL = 60.0, 1e-8  # [1/s], about critical; [m/s]
ELEMENTS = (15, 30, 60)


class Cylinder(elastica.NoForces):
    """Springs that press nodes out of a cylinder across the plane of bending."""

    def __init__(self, k: float, pressed: Array) -> None:
        super().__init__()
        self.k, self.pressed = k, pressed

    def apply_forces(self, system: Any, time: float = 0.0) -> None:
        off = system.position_collection - CENTRE[:, None]
        off[1] = 0.0
        far = np.linalg.norm(off, axis=0)
        force = self.k * np.maximum(ROUND + RADIUS - far, 0.0) * off / far
        system.external_forces += force
        self.pressed[:] = force.sum(axis=1)


def relaxed(n: int, load: float) -> tuple[Array, Array]:
    """Return the midline (16, 3) at rest with n elements [m], and the contact force (3,) [N]."""
    t, d = np.array([1.0, 0.0, 0.0]), np.array([0.0, -1.0, 0.0])
    h = LENGTH / n
    rod = elastica.CosseratRod.straight_rod(
        n, np.zeros(3), t, d, LENGTH, RADIUS, DENSITY, youngs_modulus=E, shear_modulus=E / 3
    )
    EJ = stiffness(RADIUS, E)
    clamp = np.array([EJ, EJ, EJ * 2 / 3]) / (h / 2)
    stiffer = (LENGTH / h / 10) ** 2
    rod.shear_matrix[0, 0] *= stiffer
    rod.shear_matrix[1, 1] *= stiffer
    stiffnesses = rod.shear_matrix.copy(), rod.bend_matrix.copy()
    wave = np.sqrt(E / DENSITY) * max(1.0, np.sqrt(stiffer / 3))
    step, time, pressed = 0.3 * h / wave, 0.0, np.zeros(3)
    simulator = Simulator()
    simulator.append(rod)
    simulator.constrain(rod).using(elastica.FixedConstraint, constrained_position_idx=(0,))
    forcing = simulator.add_forcing_to
    forcing(rod).using(LinearSection, *stiffnesses)
    forcing(rod).using(Clamp, rod.director_collection[..., 0].copy(), clamp)
    end = np.array([0.0, 0.0, -load])
    forcing(rod).using(elastica.EndpointForces, 0 * end, end, ramp_up_time=0.2)
    forcing(rod).using(Cylinder, E * np.pi * RADIUS**2 / h, pressed)
    simulator.dampen(rod).using(
        elastica.AnalyticalLinearDamper, uniform_damping_constant=DAMPING, time_step=step
    )
    simulator.finalize()
    stepper = elastica.PositionVerlet()
    while time < 20.0:
        for _ in range(500):
            time = stepper.step(simulator, time, step)
        if time > 0.4 and np.abs(rod.velocity_collection).max() < STILL:
            return rod.position_collection[:, :: n // ELEMENTS[0]].T.copy(), pressed
    raise AssertionError(f"{n} elements do not come to rest")


def settled(load: float) -> Shape:
    across = np.array([0.0, 0.2, 0.0])
    body = Capsule(tuple(CENTRE - across), tuple(CENTRE + across), ROUND)
    effects = Extension(), ExactTendons(), TipLoad(force=(0.0, 0.0, -load))
    return settle(bar(LENGTH, RADIUS, E), np.zeros(4), Scene(*effects, Contact(body)), 1e-8)


@pytest.mark.parametrize(
    ("load", "lies"), [pytest.param(3.0, False, id="a point"), pytest.param(8.0, True, id="a part")]
)
def test_an_arm_leans_on_a_cylinder_where_a_damped_rod_comes_to_rest(
    load: float, lies: bool
) -> None:
    shape = settled(load)
    assert (len(shape.contacts) > 1) == lies
    own = shape.position(np.linspace(0.0, LENGTH, ELEMENTS[0] + 1))
    force = np.sum([touch.force for touch in shape.contacts], axis=0)
    found = [relaxed(n, load) for n in ELEMENTS]
    off = [float(np.linalg.norm(line - own, axis=1).max()) for line, _ in found]
    pressed = [float(np.linalg.norm(p - force) / np.linalg.norm(force)) for _, p in found]
    assert all(fine < coarse / 2 for coarse, fine in pairwise(off)), off
    assert off[-1] < 4e-4 * LENGTH
    assert pressed[-1] < pressed[0] / 8, pressed
    assert pressed[-1] < 1e-3
