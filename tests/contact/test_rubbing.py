"""Coulomb friction between the settled arm and obstacles: closed forms, the cone, its history."""

from dataclasses import replace

import numpy as np
import pytest

from model import Arm, Scene, Shape, settle
from model.contact.forward import TouchingMap
from model.contact.touches import Touches, frictions, resultants
from model.contact.touches import second as second_unknowns
from model.effects import Contact, Effect, ExactTendons, Extension, TipLoad
from model.errors import InputError
from model.obstacles import Capsule, HalfSpace
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


def test_a_tip_that_sticks_holds_all_that_tendons_would_move() -> None:
    """Q = T along the bar, that keeps its length, and 3 m / 2 L across, m the tendon's moment."""
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


def cone(shape: Shape, mu: float) -> float:
    """Return by how much Coulomb's law fails: forces over the largest, lengths over the arm's.

    By NumPy: how far each place has slipped is told by the shape before the last step.
    """
    assert shape.before is not None
    was = replace(shape, tensions=shape.before[0], states=shape.before[1], before=None)
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


@pytest.mark.quick("0.3")
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


def test_friction_without_a_motion_before_is_refused_and_only_there() -> None:
    with pytest.raises(InputError, match="history"):
        leaning(0.3, None)
    assert not leaning(0.3, None, 0.1 * TENSIONS).contacts


def strip(refinement: int) -> tuple[float, float]:
    """Return log (N_a / N_b) of a strip dragged over a cylinder, and what the capstan says.

    N is the force along the strip just inside of the ends a, b of the part that lies. There the
    curvature is 1 / rho, so that with the strain N / EA the moment grows by b N', b = EJ / (EA
    rho), the shear force is -b N', p = N / rho + b N'', and N' = mu p - shear / rho. Of N =
    exp(lam s): mu b lam^2 + (1 + b / rho) lam - mu / rho = 0; without bending it is T exp(mu
    theta). That holds for the angle, however much the strip is stretched.
    """
    radius, modulus, round_, force = 0.002, 1e9, 0.06, 12.0
    arm, z = bar(0.3, radius, modulus), -round_ - 0.004
    cylinder = Capsule((0.12, -0.1, z), (0.12, 0.1, z), round_)
    own: tuple[Effect, ...] = (Extension(), ExactTendons(), TipLoad(force=(0, 0, -force)))
    smooth, rough = (
        TouchingMap(arm, Scene(*own, Contact(cylinder, friction=mu)), 3, refinement)
        for mu in (0.0, MU)
    )
    rest = smooth.rows(smooth.come_to(NONE, NONE, None)[0])[0]
    here = rough.led(np.full(4, 20.0), NONE, smooth.known(rest)).settled.held.here
    system, states = here.system, here.states
    touches = Touches.of(system)
    k = np.flatnonzero((touches.held | touches.inside)[:, 0])
    N, Q = resultants(system, states, touches)[k, 0], frictions(system, states)[k, 0]
    assert np.linalg.norm(Q, axis=1) == pytest.approx(MU * N, rel=1e-9)
    off = system.poses(states)[k, 4:] - [0.12, 0, z]
    n = off / np.linalg.norm(off, axis=1)[:, None]
    t = np.column_stack([n[:, 2], n[:, 1], -n[:, 0]])
    s, p = system.mesh.s[k], second_unknowns(system, states)[k, 0]
    h = np.diff(s)
    ends = [N[0] - h[0] * (2 * p[0] + p[1]) / 6, N[-1] - h[-1] * (2 * p[-1] + p[-2]) / 6]
    presses = N[:, None] * n + Q
    at_tip = np.array([0, 0, -force])
    F_b = at_tip + ends[1] * (n[-1] + MU * t[-1])
    F_a = at_tip + presses.sum(axis=0) - ends[0] * (n[0] + MU * t[0])
    rho, theta = round_ + radius, float(np.arccos(n[0] @ n[-1]))
    b = stiffness(radius, modulus) / (modulus * np.pi * radius**2 * rho)
    lam = max(np.roots([MU * b, 1 + b / rho, -MU / rho]).real)
    return float(np.log((F_a @ t[0]) / (F_b @ t[-1]))), lam * rho * theta


def test_a_strip_dragged_over_a_cylinder_is_a_capstan() -> None:
    found, wanted = strip(1)
    assert found == pytest.approx(wanted, rel=1e-2)


@pytest.mark.slow
def test_a_finer_strip_is_nearer_to_the_capstan() -> None:
    found, wanted = strip(1)
    finer, exact = strip(2)
    assert finer == pytest.approx(exact, rel=2e-3)
    assert abs(finer - exact) < abs(found - wanted) / 1.5
