"""A loaded arm against PyElastica, a damped Cosserat rod that comes to rest.

Nothing is shared with our two-point boundary value problem: PyElastica steps the nodes and the
frames of a staggered chain of elements through time. The model is the cone of table 2, the weight
in water, and a tendon that runs straight from hole to hole, one in the middle of each element: f =
T (e_next - e) on the hole at p = u + y d, and the couple y d x f. The force is minus the gradient
of T times the length of the polygon, which becomes the tendon of `ExactTendons` as elements are
added.

PyElastica needs two changes:

- the section thins at constant volume: with S and B the stiffnesses of the unstrained section, the
  force is S/e and the moment B/e^3 times the strains per unit reference length. The stiffnesses of
  a linear section are S and B; without this change the tip is off by 3 mm.
- frames belong to elements, so that a fixed first frame clamps the arm half an
  element from the base. Half an element of the arm connects the frame to the base instead.

Measured: the midlines differ by 2.50, 0.611, 0.152 and 0.0379 mm with 20, 40, 80 and 160 elements
(orders 2.04, 2.01, 2.00), and Richardson's extrapolations of two meshes by 25, 1.4 and 0.084 um,
the last 3e-7 of the length.

Source: PyElastica 1.0, https://github.com/GazzolaLab/PyElastica, doi:10.5281/zenodo.7658871; for
the equations, see M. Gazzola, L. H. Dudte, A. G. McCormick and L. Mahadevan, "Forward and inverse
problems in the mechanics of soft filaments", Royal Society Open Science 5 (2018) 171628.
"""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from octoplan.model import Arm, Scene, Shape, settle
from octoplan.model.effects import Buoyancy, ExactTendons, Extension, Shear, Weight
from octoplan.model.effects.base import Effect
from tests.core.effects.cases import Array

elastica: Any = pytest.importorskip(
    "elastica", reason="the optional extra: pip install octoplan[pyelastica]"
)
pytestmark = pytest.mark.slow

LENGTH, E, DENSITY, WATER = 0.310, 110e3, 1080.0, 1000.0
TENSION = 0.5  # [N]; the tip turns by 42 degrees, out of the plane in which the arm sags
K_S = 27 / 28  # PyElastica's shear correction factor
LINEAR = (Extension(), ExactTendons())
ELEMENTS = (20, 40, 80, 160)
STATIONS = np.linspace(0.0, LENGTH, ELEMENTS[0] + 1)  # nodes of every mesh
DAMPING = 8.0  # [1/s]; critical for the slowest swing, of about 4 rad/s
STILL = 1e-9  # [m/s]; leaves the arm less than 1e-9 m to go


def radius(s: Any) -> Any:
    return 15e-3 + (6.5e-3 - 15e-3) * s / LENGTH


def offset(s: Any) -> Any:
    return 7.5e-3 + (1e-3 - 7.5e-3) * s / LENGTH


class Simulator(
    elastica.BaseSystemCollection, elastica.Constraints, elastica.Forcing, elastica.Damping
):
    """Rods that are held, pulled and damped."""


class LinearSection(elastica.NoForces):
    """No force: takes the thinning of the section out of the rod's stiffnesses."""

    def __init__(self, shear: Array, bend: Array) -> None:
        super().__init__()
        self.shear, self.bend = shear, bend

    def apply_forces(self, system: Any, time: float = 0.0) -> None:
        system.shear_matrix[:] = self.shear * system.dilatation
        system.bend_matrix[:] = self.bend * system.voronoi_dilatation**3


class Clamp(elastica.NoForces):
    """The half element from the base to the middle of the first element, which bends and twists."""

    def __init__(self, base: Array, stiffness: Array) -> None:
        super().__init__()
        self.base, self.stiffness = base, stiffness

    def apply_torques(self, system: Any, time: float = 0.0) -> None:
        turn = Rotation.from_matrix(system.director_collection[..., 0] @ self.base.T).as_rotvec()
        system.external_torques[:, 0] += self.stiffness * turn


class Tendon(elastica.NoForces):
    """A tension along straight pieces, from the base through each element's hole to the tip's."""

    def __init__(self, tension: float, base: Array, offsets: Array) -> None:
        super().__init__()
        self.tension, self.base, self.offsets = tension, base, offsets

    def apply_forces(self, system: Any, time: float = 0.0) -> None:
        u, side = system.position_collection, system.director_collection[0]
        lever = self.offsets * np.column_stack([side, side[:, -1]])
        holes = np.column_stack([(u[:, 1:] + u[:, :-1]) / 2, u[:, -1]]) + lever
        pieces = np.diff(np.column_stack([self.base, holes]))
        pull = self.tension * pieces / np.linalg.norm(pieces, axis=0)
        force = np.diff(pull, append=0.0)
        system.external_forces[:, :-1] += force[:, :-1] / 2
        system.external_forces[:, 1:] += force[:, :-1] / 2
        system.external_forces[:, -1] += force[:, -1]
        couple = np.cross(lever, force, axis=0)
        couple[:, -2] += couple[:, -1]
        local = np.einsum("ijk,jk->ik", system.director_collection, couple[:, :-1])
        system.external_torques[:] += local


def hung(n: int, step: float) -> tuple[Any, Any]:
    """Return the straight rod of n elements under its loads, and a simulator of a step [s]."""
    h = LENGTH / n
    middle = (np.arange(n) + 0.5) * h
    t, d = np.array([1.0, 0.0, 0.0]), np.array([0.0, -1.0, 0.0])
    rod = elastica.CosseratRod.straight_rod(
        n, np.zeros(3), t, d, LENGTH, radius(middle), DENSITY, youngs_modulus=E, shear_modulus=E / 3
    )
    EJ = E * np.pi / 4 * radius(middle[0]) ** 4
    clamp = np.array([EJ, EJ, EJ * 2 / 3]) / (h / 2)
    weight = np.array([0.0, 0.0, -9.81 * (1 - WATER / DENSITY)])
    holes = offset(np.append(middle, LENGTH))
    stiffnesses = rod.shear_matrix.copy(), rod.bend_matrix.copy()
    simulator = Simulator()
    simulator.append(rod)
    simulator.constrain(rod).using(elastica.FixedConstraint, constrained_position_idx=(0,))
    forcing = simulator.add_forcing_to
    forcing(rod).using(LinearSection, *stiffnesses)
    forcing(rod).using(Clamp, rod.director_collection[..., 0].copy(), clamp)
    forcing(rod).using(elastica.GravityForces, acc_gravity=weight)
    forcing(rod).using(Tendon, TENSION, offset(0.0) * d, holes)
    simulator.dampen(rod).using(
        elastica.AnalyticalLinearDamper, uniform_damping_constant=DAMPING, time_step=step
    )
    simulator.finalize()
    return rod, simulator


def relaxed(n: int) -> Array:
    """Return the midline (21, 3) at STATIONS on which n elements come to rest [m]."""
    time, step = 0.0, 0.04 * LENGTH / n  # 0.4 of the time that a wave takes through an element
    rod, simulator = hung(n, step)
    stepper = elastica.PositionVerlet()
    while time < 20.0:
        for _ in range(500):
            time = stepper.step(simulator, time, step)
        if np.abs(rod.velocity_collection).max() < STILL:
            return rod.position_collection[:, :: n // ELEMENTS[0]].T.copy()
    raise AssertionError(f"{n} elements do not come to rest")


def settled(*effects: Effect) -> Shape:
    T = np.zeros((3, 4))
    T[0, 0] = TENSION
    return settle(Arm.from_paper("table-2"), T, Scene(*effects), accuracy=1e-8)


def gap(a: Array, b: Array) -> float:
    return float(np.linalg.norm(a - b, axis=1).max())


def orders(gaps: list[float]) -> list[float]:
    return [float(np.log2(a / b)) for a, b in pairwise(gaps)]


@pytest.fixture(scope="module")
def midlines() -> list[Array]:
    return [relaxed(n) for n in ELEMENTS]


@pytest.fixture(scope="module")
def limits(midlines: list[Array]) -> list[Array]:
    """Richardson's extrapolation of each mesh and the next, for errors of second order."""
    return [fine + (fine - coarse) / 3 for coarse, fine in pairwise(midlines)]


def test_an_arm_settles_where_a_damped_rod_comes_to_rest(
    midlines: list[Array], limits: list[Array]
) -> None:
    shape = settled(*LINEAR, Shear(K_S), Weight(), Buoyancy(WATER))
    assert np.degrees(np.arccos(shape.tip_frame[0, 0])) == pytest.approx(42.5, abs=0.1)
    ours = shape.position(STATIONS)
    assert orders([gap(line, ours) for line in midlines]) == pytest.approx([2.0] * 3, abs=0.1)
    assert orders([gap(limit, ours) for limit in limits]) == pytest.approx([4.0] * 2, abs=0.4)
    for coarse, fine in pairwise(limits):
        assert gap(fine, ours) < gap(fine, coarse) / 10
    assert gap(limits[-1], ours) < 1e-6 * LENGTH


@pytest.mark.parametrize(
    ("effects", "moved"),
    [
        ((Extension(), Shear(K_S), Weight(), Buoyancy(WATER)), 1.43e-3),
        ((ExactTendons(), Shear(K_S), Weight(), Buoyancy(WATER)), 4.55e-3),
        ((*LINEAR, Weight(), Buoyancy(WATER)), 0.596e-3),
        ((*LINEAR, Shear(1.0), Weight(), Buoyancy(WATER)), 0.0205e-3),
        ((*LINEAR, Shear(K_S), Weight()), 260e-3),
        ((*LINEAR, Shear(K_S)), 83.5e-3),
    ],
    ids=["paper's tendons", "no extension", "no shear", "other k_s", "in air", "no weight"],
)
def test_the_rod_tells_each_effect(
    effects: tuple[Effect, ...], moved: float, limits: list[Array]
) -> None:
    assert gap(limits[-1], settled(*effects).position(STATIONS)) == pytest.approx(moved, rel=0.02)
