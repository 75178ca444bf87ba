"""A loaded arm against PyElastica, a Cosserat rod that swings until its damping brings it to rest.

Nothing is shared with our two-point boundary value problem: PyElastica steps positions and
directors of a staggered chain of elements in time. Here it gets the cone of table 2, its weight in
water, and a tendon that runs straight from hole to hole, one hole in the middle of each element:
T (e_next - e) on a hole at p = u + y d, and the couple y d x T (e_next - e). That is the gradient
of T times the length of a polygon, which is the tendon of `ExactTendons` as elements are added.

Two things of PyElastica have to be turned into ours:

- its section thins at constant volume: with S and B the stiffnesses of the unstrained section, the
  force is S/e and the moment B/e^3 times the strains per unit reference length. A linear section
  has S and B; left as it is, the tip is off by 7 mm here.
- it holds the first director, half an element from the base. Taken for the director of the base,
  it is 1.5 elements from the next one. Otherwise the error is of first order.

Source: PyElastica 1.0, https://github.com/GazzolaLab/PyElastica, doi:10.5281/zenodo.7658871; its
equations are those of M. Gazzola, L. H. Dudte, A. G. McCormick, L. Mahadevan, "Forward and inverse
problems in the mechanics of soft filaments", Royal Society Open Science 5 (2018) 171628.
"""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from model import Arm, Scene, Shape, settle
from model.effects import Buoyancy, ExactTendons, Extension, Shear, Weight
from tests.effects.cases import Array

elastica: Any = pytest.importorskip(
    "elastica", reason="the optional extra: pip install octoplan[pyelastica]"
)
pytestmark = pytest.mark.slow

LENGTH, E, DENSITY, WATER = 0.310, 110e3, 1080.0, 1000.0
TENSION = 0.5  # bends the arm by 42 degrees, out of the vertical plane in which it sags
ELEMENTS = (20, 40, 80)
STATIONS = np.linspace(0.0, LENGTH, ELEMENTS[0] + 1)  # nodes of every mesh
STILL = 1e-9  # [m/s]; what is left to go is a third of this times 1 s
K_S = 27 / 28  # of every rod of PyElastica


def radius(s: Array) -> Array:
    return 15e-3 + (6.5e-3 - 15e-3) * s / LENGTH


def offset(s: Array) -> Array:
    return 7.5e-3 + (1e-3 - 7.5e-3) * s / LENGTH


class Simulator(
    elastica.BaseSystemCollection, elastica.Constraints, elastica.Forcing, elastica.Damping
):
    """One rod that is held, pulled and damped."""


class LinearSection(elastica.NoForces):
    """No force: takes the thinning of the section out of the rod's stiffnesses."""

    def __init__(self, shear: Array, bend: Array) -> None:
        super().__init__()
        self.shear, self.bend = shear, bend

    def apply_forces(self, system: Any, time: float = 0.0) -> None:
        system.shear_matrix[:] = self.shear * system.dilatation
        system.bend_matrix[:] = self.bend * system.voronoi_dilatation**3


class Clamp(elastica.NoForces):
    """The half element from the base to the middle of the first element bends and twists."""

    def __init__(self, base: Array, stiffness: Array) -> None:
        super().__init__()
        self.base, self.stiffness = base, stiffness

    def apply_forces(self, system: Any, time: float = 0.0) -> None:
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


def relaxed(n: int) -> Array:
    """The midline (21, 3) at STATIONS on which n elements come to rest [m]."""
    h = LENGTH / n
    middle = (np.arange(n) + 0.5) * h
    t, d = np.array([1.0, 0.0, 0.0]), np.array([0.0, -1.0, 0.0])
    rod = elastica.CosseratRod.straight_rod(
        n, np.zeros(3), t, d, LENGTH, radius(middle), DENSITY, youngs_modulus=E, shear_modulus=E / 3
    )
    simulator = Simulator()
    simulator.append(rod)
    simulator.constrain(rod).using(
        elastica.FixedConstraint, constrained_position_idx=(0,)
    )
    weight = np.array([0.0, 0.0, -9.81 * (1 - WATER / DENSITY)])
    simulator.add_forcing_to(rod).using(elastica.GravityForces, acc_gravity=weight)
    stiffnesses = rod.shear_matrix.copy(), rod.bend_matrix.copy()
    EJ = E * np.pi / 4 * radius(middle[0]) ** 4
    clamp = np.array([EJ, EJ, EJ * 2 / 3]) / (h / 2)
    simulator.add_forcing_to(rod).using(Clamp, rod.director_collection[..., 0].copy(), clamp)
    simulator.add_forcing_to(rod).using(LinearSection, *stiffnesses)
    holes = offset(np.append(middle, LENGTH))
    simulator.add_forcing_to(rod).using(Tendon, TENSION, offset(np.zeros(1)) * d, holes)
    # Stable up to 0.06 to 0.09 s/m; the slowest swing, about 3 rad/s, is damped critically.
    time, step = 0.0, 0.04 * h
    simulator.dampen(rod).using(
        elastica.AnalyticalLinearDamper, uniform_damping_constant=6.0, time_step=step
    )
    simulator.finalize()
    stepper = elastica.PositionVerlet()
    while time < 20.0:
        for _ in range(500):
            time = stepper.step(simulator, time, step)
        if np.abs(rod.velocity_collection).max() < STILL:
            return rod.position_collection[:, :: n // ELEMENTS[0]].T.copy()
    raise AssertionError(f"{n} elements do not come to rest")


@pytest.fixture(scope="module")
def midlines() -> list[Array]:
    return [relaxed(n) for n in ELEMENTS]


def settled(*effects: Any) -> Shape:
    T = np.zeros((3, 4))
    T[0, 0] = TENSION
    return settle(Arm.from_paper("table-2"), T, Scene(*effects), accuracy=1e-8)


def gap(a: Array, b: Array) -> float:
    return float(np.linalg.norm(a - b, axis=1).max())


def extrapolated(coarse: Array, fine: Array) -> Array:
    return fine + (fine - coarse) / 3


EFFECTS = (Extension(), ExactTendons(), Shear(K_S), Weight(), Buoyancy(WATER))


def test_an_arm_settles_where_a_damped_rod_comes_to_rest(midlines: list[Array]) -> None:
    shape = settled(*EFFECTS)
    assert np.degrees(np.arccos(shape.tip_frame[0, 0])) == pytest.approx(42.5, abs=0.1)
    ours = shape.position(STATIONS)
    gaps = [gap(line, ours) for line in midlines]
    orders = [np.log2(a / b) for a, b in pairwise(gaps)]
    assert orders == pytest.approx([2.0, 2.0], abs=0.1), gaps
    assert gaps[-1] < gap(midlines[-1], midlines[-2])
    coarse, fine = (extrapolated(*pair) for pair in pairwise(midlines))
    assert gap(fine, ours) < gap(fine, coarse) / 4
    assert gap(fine, ours) < 1e-5 * LENGTH


@pytest.mark.parametrize("left_out", EFFECTS, ids=lambda effect: type(effect).__name__)
def test_each_effect_is_needed(left_out: Any, midlines: list[Array]) -> None:
    rest = [
        e
        for e in EFFECTS
        if e is not left_out and not (left_out == Weight() and e == Buoyancy(WATER))
    ]
    assert gap(extrapolated(*midlines[-2:]), settled(*rest).position(STATIONS)) > 1e-3 * LENGTH
