"""Coulomb friction between the settled arm and obstacles: closed forms, cone, history."""

from dataclasses import replace
from typing import NamedTuple

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import root

from octoplan.model import Arm, Scene, Shape, settle
from octoplan.model.effects import ExactTendons, Extension, NeoHookean, TipLoad
from octoplan.model.effects.base import Effect
from octoplan.model.equilibrium.linearised import Equilibrium
from octoplan.model.extensions.contact.effects import Contact, without_friction
from octoplan.model.extensions.contact.forward import TouchingMap
from octoplan.model.extensions.contact.path import ContactEquilibrium
from octoplan.model.extensions.contact.touches import ContactFlags, forces, frictions, resultants
from octoplan.model.extensions.obstacles import Capsule, HalfSpace, Sphere
from octoplan.planner.extensions.contact.load_path import path_sensitivities
from tests.contact.cases import bar, stiffness

NONE = np.zeros(4)
LENGTH, RADIUS, E, ABOVE, PRESSED, MU = 0.3, 0.003, 9e11, 1e-10, 0.5, 0.3
FLOOR = HalfSpace((0, 0, -RADIUS - ABOVE), (0, 0, 1))
STEM = (Extension(), ExactTendons(), TipLoad(force=(0, 0, -PRESSED)))
SMOOTH, ROUGH = (Scene(*STEM, Contact(FLOOR, friction=mu)) for mu in (0.0, MU))


def on_floor(tensions: list[float]) -> Shape:
    """Return a bar whose tip a dead force presses on a floor, then dragged by tendons."""
    arm = bar(LENGTH, RADIUS, E)
    return settle(arm, tensions, ROUGH, 1e-6, near=settle(arm, NONE, SMOOTH))


@pytest.mark.slow
def test_a_tip_that_sticks_holds_all_that_tendons_would_move() -> None:
    """Return Q = T along an inextensible bar, and 3 m / 2 L across, with the tendon's moment m."""
    tension = 0.02
    (touch,) = on_floor([tension, 0, 0, 0]).contacts
    m = tension * RADIUS / 2
    assert touch.friction == pytest.approx([tension, 1.5 * m / LENGTH, 0], rel=1e-6, abs=1e-12)
    assert np.linalg.norm(touch.slip) < 1e-12 * LENGTH


def test_a_tip_that_slips_is_held_back_by_mu_times_what_presses() -> None:
    """Two tendons against each other shorten the bar by (2 T - mu P) L / EA."""
    tension = 40.0
    shape = on_floor([tension, 0, tension, 0])
    (touch,) = shape.contacts
    P = PRESSED - 3 * stiffness(RADIUS, E) * ABOVE / LENGTH**3
    assert touch.friction == pytest.approx([MU * P, 0, 0], rel=1e-5, abs=1e-9)
    EA = E * np.pi * RADIUS**2
    assert LENGTH - shape.tip[0] == pytest.approx(
        (2 * tension - float(touch.friction[0])) * LENGTH / EA, rel=1e-6
    )
    assert touch.slip[0] < 0


@pytest.mark.slow
def test_a_shape_that_rubs_says_that_load_steps_are_no_part_of_its_error() -> None:
    assert "no part of its error" in " ".join(on_floor([0.02, 0, 0, 0]).remarks)
    assert settle(bar(LENGTH, RADIUS, E), NONE, SMOOTH).remarks == ()


def cone(shape: Shape, mu: float) -> float:
    """Return the violation of Coulomb's law: forces over the largest, lengths over the arm's.

    By NumPy: the shape before the last step gives the slip of each place.
    """
    here = shape.equilibrium
    assert isinstance(here, ContactEquilibrium) and here.before is not None
    was = replace(shape, equilibrium=ContactEquilibrium(here.before.system, here.before.x))
    touches, L, off = shape.contacts, shape.arm.length, [0.0]
    most = max(float(np.linalg.norm(touch.force)) for touch in touches)
    for touch in touches:
        n = shape.position(touch.s) - touch.point
        n /= np.linalg.norm(n)
        N = float(touch.force @ n)
        Q = touch.force - N * n
        slip = shape.position(touch.s) - was.position(touch.s)
        slip -= n * float(n @ slip)
        size = float(np.linalg.norm(Q))
        off += [(size - mu * N) / most, -N / most, abs(touch.gap) / L]
        if size < mu * N - 1e-8 * most:
            off.append(float(np.linalg.norm(slip)) / L)
        else:
            off.append(float(np.linalg.norm(np.linalg.norm(slip) * Q / size + slip)) / L)
    return max(off)


ARM = Arm.from_paper("table-4")
ROD = Capsule((0.1, -0.05, -0.06), (0.1, 0.05, -0.06), 0.02)
TENSIONS = np.array([[0, 0, 0.5, 0], [4, 0, 0, 0], [0, 3, 0, 0]])


def leaning(mu: float, near: Shape | None, tensions: np.ndarray = TENSIONS) -> Shape:
    scene = Scene(Extension(), ExactTendons(), Contact(ROD, friction=mu))
    return settle(ARM, tensions, scene, 1e-4, near=near)


@pytest.mark.slow
@pytest.mark.parametrize("mu", [0.05, 0.3, 1.0])
def test_an_arm_that_comes_to_lean_on_a_rod_keeps_coulombs_law(mu: float) -> None:
    free = leaning(mu, None, 0.2 * TENSIONS)
    assert not free.contacts
    shape = leaning(mu, free)
    assert shape.contacts
    assert cone(shape, mu) < 1e-8
    again = leaning(mu, shape)
    assert again.tip == pytest.approx(shape.tip, abs=1e-9)
    assert shape.stability > 0


RUBBING = {
    "a sphere, sticking": (
        [[0, 0.2092, 0, 0.2927], [0, 0, 0, 0], [0, 0, 0, 4.9366]],
        Contact(Sphere((0.11934, 0.0163, 0.24664), 0.03234), friction=1.0),
    ),
    "a sphere, slipping": (
        [[0, 0, 0.2901, 0], [0, 1.7155, 0, 0.3585], [0, 4.7579, 0, 0]],
        Contact(Sphere((-0.013288, 0.087038, -0.133263), 0.026467), friction=0.6),
    ),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", RUBBING)
def test_meshes_of_an_arm_that_rubs_differ_by_their_own_errors_alone(name: str) -> None:
    """Finer meshes chose other steps, which changed more: the arm was refused after 20 s."""
    tensions, contact = RUBBING[name]
    scene = Scene(Extension(), contact)
    free = settle(ARM, np.zeros((3, 4)), scene)
    coarse, fine = (settle(ARM, tensions, scene, error, near=free) for error in (1e-6, 1e-7))
    assert coarse.contacts
    assert np.linalg.norm(coarse.tip - fine.tip) < coarse.error * ARM.length
    assert cone(fine, contact.friction) < 1e-8


LEANING = {
    "a bar": (
        bar(0.3, 0.006, 2e5),
        Capsule((0.2, -0.1, -0.04), (0.2, 0.1, -0.04), 0.02),
        np.array([0.1, 0.8, 0.0, 0.0]),
    ),
    "three sections": (ARM, ROD, TENSIONS),
}


@pytest.mark.quick("a bar")
@pytest.mark.parametrize(("arm", "rod", "T"), LEANING.values(), ids=LEANING)
def test_silicone_that_slips_passes_through_nothing_on_either_side_of_a_touch(
    arm: Arm, rod: Capsule, T: np.ndarray
) -> None:
    """Friction lets stretch and radius jump there: the wider side was inside by 10 um."""
    scene = Scene(Extension(), ExactTendons(), NeoHookean(), Contact(rod, friction=0.567))
    free = settle(arm, 0.02 * T, scene, 1e-4)
    shape = settle(arm, T, scene, 1e-4, near=free)
    (touch,) = shape.contacts
    assert np.linalg.norm(touch.friction) > 0
    assert 0 < touch.s < arm.length
    sides = touch.s + 1e-9 * arm.length * np.array([-1, 1])
    radius = arm.outer_radius(sides)[0] / np.sqrt(1 + shape.strain(sides)[:, 3])
    assert np.ptp(radius) > 1e-9 * arm.length
    gaps = rod.distance(shape.position(sides)) - radius
    assert gaps.min() > -1e-8 * arm.length
    assert gaps.min() < 1e-8 * arm.length


LONG, WIDE, SOFT, ROUND, DOWN, PULL = 0.3, 0.002, 1e9, 0.06, 12.0, 20.0
CENTRE = np.array([0.12, -ROUND - 0.004])


class Capstan(NamedTuple):
    """A strip dragged over a cylinder, bent down by a dead force: results.

    Start of the contact zone [m], the angles of its ends on the cylinder [rad], the normal force at
    its start and the axial force before the start [N], the tip [m].
    """

    start: float
    angles: np.ndarray
    end_force: float
    tension: float
    tip: np.ndarray

    @property
    def rubbed(self) -> float:
        """Axial force of the strip just inside of the contact zone [N]."""
        return self.tension - MU * self.end_force


def strip(refinement: int) -> Capstan:
    """Return the results of the equations, by the steps of the coarsest mesh."""
    arm, z = bar(LONG, WIDE, SOFT), CENTRE[1]
    cylinder = Capsule((CENTRE[0], -0.1, z), (CENTRE[0], 0.1, z), ROUND)
    own: tuple[Effect, ...] = (Extension(), ExactTendons(), TipLoad(force=(0, 0, -DOWN)))
    smooth, rough = (Scene(*own, Contact(cylinder, friction=mu)) for mu in (0.0, MU))
    rest, T = TouchingMap(arm, smooth, 1).solve(NONE), np.full(4, PULL)
    coarse = TouchingMap(arm, rough, 1).solve(T, rest)
    here = TouchingMap(arm, rough, refinement).solve(T, coarse)
    system, states = here.system, here.states
    touches = ContactFlags.of(system)
    k = np.flatnonzero(touches.touching[:, 0])
    N, Q = resultants(system, states)[k, 0], frictions(system, states)[k, 0]
    assert np.linalg.norm(Q, axis=1) == pytest.approx(MU * N, rel=1e-9)
    places = system.poses(states)[:, 4::2]
    angles = np.arctan2(*(places[k] - CENTRE).T)
    along = np.array([np.cos(angles[0]), -np.sin(angles[0])])
    before = system.wrenches_beyond(system.x(np.full(4, PULL), 1.0, states))[k[0] - 1, 3::2]
    tension = float((before - np.array([0, DOWN])) @ along)
    P = float(forces(system, states)[k[0], 0])
    return Capstan(float(system.mesh.s[k[0]]), angles[[0, -1]], P, tension, places[-1])


def capstan() -> Capstan:
    """Return the results by SciPy: elasticas before and beyond, a closed form in the contact zone.

    In the zone the curvature per reference length is lambda / rho, lambda = 1 + (N - 4 T) / EA; so
    the moment grows by the angle phi as EJ N_phi / (EA rho), the shear force is S = beta N_phi,
    beta = EJ / (EA rho^2), the pressure is N - S_phi per angle, and all points slip:

        N_phi + S + mu (N - S_phi) = 0, N = c1 exp(l1 (phi - a)) + c2 exp(l2 (phi - b)).

    Without bending l1 = -mu, as for a capstan. The other part is a layer of angle 1 / l2, some
    micrometres. At the start of the zone a force P presses with friction mu P, and the strip leaves
    the cylinder with less curvature. At the end this is impossible, because the strip would bend
    into the cylinder: N, S, M are continuous, and the layer is the force at the end, which acts at
    the angle 1 / l2 before b.
    """
    EA, EJ, rho = SOFT * np.pi * WIDE**2, stiffness(WIDE, SOFT), ROUND + WIDE
    beta = EJ / (EA * rho**2)
    l1, l2 = np.sort(np.roots([-MU * beta, 1 + beta, MU]).real)

    def stretch(N: float) -> float:
        return 1 + (N - 4 * PULL) / EA

    def elastica(s: float, to: float, phi: float, M: float, F: np.ndarray) -> np.ndarray:
        """Return angle, moment and place (2,) of a free part led from the cylinder."""

        def rate(_: float, y: np.ndarray) -> list[float]:
            t, n = np.array([[np.cos(y[0]), -np.sin(y[0])], [np.sin(y[0]), np.cos(y[0])]])
            wide = stretch(float(F @ t))
            return [y[1] / EJ, wide * float(F @ n), wide * t[0], wide * t[1]]

        start = [phi, M, *(CENTRE + rho * np.array([np.sin(phi), np.cos(phi)]))]
        found = solve_ivp(rate, (s, to), start, rtol=1e-13, atol=1e-15, method="DOP853")
        return np.array(found.y[:, -1])

    told: list[Capstan] = []

    def missed(unknown: np.ndarray) -> list[float]:
        a, b, s, P, c1 = unknown
        c2 = DOWN * np.sin(b) - c1 * np.exp(l1 * (b - a))
        c, l, of = np.array([c1, c2]), np.array([l1, l2]), np.array([a, b])  # noqa: E741

        def tension(phi: float) -> float:
            return float(c @ np.exp(l * (phi - of)))

        def shear(phi: float) -> float:
            return beta * float((l * c) @ np.exp(l * (phi - of)))

        t, n = np.array([[np.cos(a), -np.sin(a)], [np.sin(a), np.cos(a)]])
        before = (tension(a) + MU * P) * t + (shear(a) + P) * n
        base = elastica(s, 0.0, a, EJ * stretch(tension(a)) / rho, before)
        length, x = s, np.polynomial.legendre.leggauss(40)
        for low, high in ((a, b - 40 / l2), (b - 40 / l2, b)):
            at = low + (high - low) * (x[0] + 1) / 2
            length += (
                (high - low)
                / 2
                * float(x[1] @ [rho / stretch(tension(phi)) for phi in at.tolist()])
            )
        moment = EJ * stretch(tension(b)) / rho
        tip = elastica(length, LONG, b, moment, np.array([0, -DOWN]))
        told.append(Capstan(s, np.array([a, b - 1 / l2]), P, float(before @ t), tip[2:]))
        return [base[0], *base[2:], tip[1] / EJ, (shear(b) + DOWN * np.cos(b)) / 10]

    found = root(missed, [0.384, 1.043, 0.1448, 7.65, 14.8], tol=1e-13)
    assert np.abs(missed(found.x)).max() < 1e-10
    return told[-1]


def off_capstan(refinement: int) -> tuple[float, float]:
    """Return the relative difference of a strip from the capstan: its end force, and the rest."""
    found, exact = strip(refinement), capstan()
    ratios = [
        found.start / exact.start,
        *found.angles / exact.angles,
        found.tension / exact.tension,
        found.rubbed / exact.rubbed,
    ]
    tip = np.linalg.norm(found.tip - exact.tip) / LONG
    end = abs(found.end_force / exact.end_force - 1)
    return float(end), float(max(np.abs(np.array(ratios) - 1).max(), tip))


def test_a_strip_dragged_over_a_cylinder_is_a_capstan() -> None:
    end, others = off_capstan(1)
    assert others < 1e-5
    assert end < 1e-4


@pytest.mark.slow
def test_ends_and_forces_of_a_capstan_converge_to_1e_6_with_order_four_then_two() -> None:
    """Order two is left on fine meshes: friction is linear between nodes, pressure by angle.

    Measured on meshes 1, 2, 3, 4, 6, 8: end force 6.0e-5, 2.0e-6, 8.6e-7, 4.5e-7, 1.0e-7, 3.0e-8,
    all else 9.2e-6, 3.2e-7, 1.4e-7, 7.3e-8, 2.0e-8, 8.6e-9.
    """
    coarse, middle, fine = (np.array(off_capstan(refinement)) for refinement in (1, 2, 4))
    assert (middle < coarse / 16).all()
    assert (fine < middle / 4).all()
    assert fine.max() < 1e-6


@pytest.mark.slow
def test_a_place_that_slips_moves_with_tensions_as_all_of_its_way_does() -> None:
    """Stiffness agrees with differences; the last step alone was off by 60 %."""
    rod = Capsule((0.2, -0.1, -0.04), (0.2, 0.1, -0.04), 0.02)
    scene = Scene(Extension(), ExactTendons(), Contact(rod, friction=MU))
    arm, T = bar(0.3, 0.006, 2e5), np.array([0.1, 0.8, 0.0, 0.0])
    rough, smooth = (TouchingMap(arm, own, 1) for own in (scene, without_friction(scene)))
    rest = smooth.solve(NONE)

    def way(tensions: np.ndarray) -> ContactEquilibrium:
        return rough.solve(tensions, rest, jumps=False)

    def tip(here: Equilibrium) -> np.ndarray:
        return here.states[here.system.layout.nodes[-1, 4:7]]

    here, h = way(T), 1e-5
    by_tensions = path_sensitivities(way(T).path)
    ends = [tip(way(T + sign * h * np.eye(4)[1])) for sign in (1, -1)]
    slope = (ends[0] - ends[1]) / (2 * h)
    off = by_tensions[here.system.layout.nodes[-1, 4:7], 1] - slope
    assert np.abs(off).max() < 1e-3 * np.abs(slope).max()
