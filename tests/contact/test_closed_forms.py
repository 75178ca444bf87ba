"""Contact against beams in closed form, and against Euler's elastica by SciPy."""

from collections.abc import Callable

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import root

from octoplan.model import Scene, settle
from octoplan.model.effects import ExactTendons, TipLoad, Weight
from octoplan.model.extensions.contact.effects import Contact
from octoplan.model.extensions.obstacles import Capsule, HalfSpace
from tests.contact.cases import bar, stiffness

NONE = np.zeros(4)


@pytest.mark.slow
def test_a_heavy_cantilever_lies_on_a_floor_from_where_beam_theory_says() -> None:
    """M = w (a - x)^2 / 2 - P (a - x); y'(a) = 0 gives P = w a / 3, y(a) = w a^4 / (72 EJ)."""
    length, radius, E, above = 0.3, 0.003, 1e8, 1e-5
    w, EJ = 1000.0 * np.pi * radius**2 * 9.81, stiffness(radius, E)
    a = (72 * EJ * above / w) ** 0.25
    floor = HalfSpace((0, 0, -radius - above), (0, 0, 1))
    shape = settle(bar(length, radius, E), NONE, Scene(Weight(), Contact(floor)))
    touches = shape.contacts
    assert touches[0].s == pytest.approx(a, rel=1e-6)
    assert touches[-1].s == length
    assert sum(touch.force for touch in touches) == pytest.approx(
        [0, 0, w * (length - a) + w * a / 3], rel=1e-6, abs=1e-12
    )
    assert [touch.pressure for touch in touches] == pytest.approx([w] * len(touches), rel=1e-5)
    own = touches[0].pressure * (touches[1].s - touches[0].s) / 2
    assert touches[0].force[2] - own == pytest.approx(w * a / 3, rel=1e-5)


@pytest.mark.parametrize("force", [0.05, 3.0])
def test_a_tip_pressed_on_a_floor_is_carried_but_for_what_bends_the_bar(force: float) -> None:
    length, radius, E, above = 0.3, 0.003, 1e8, 1e-5
    floor = HalfSpace((0, 0, -radius - above), (0, 0, 1))
    scene = Scene(TipLoad(force=(0, 0, -force)), Contact(floor))
    (touch,) = settle(bar(length, radius, E), NONE, scene).contacts
    assert touch.s == length
    bends = 3 * stiffness(radius, E) * above / length**3
    assert touch.force[2] == pytest.approx(force - bends, rel=1e-6)


@pytest.mark.slow
def test_a_tip_bent_against_a_wall_presses_as_the_elastica_does(
    deviation: Callable[..., float],
) -> None:
    """theta' = (m - P (x(L) - x)) / EJ against a wall across y, with m the tendon's moment."""
    length, radius, E, tension, wall = 0.3, 0.003, 1e9, 40.0, 0.03
    EJ, m = stiffness(radius, E), tension * radius / 2

    def tip(P: float, reach: float) -> np.ndarray:
        def rate(_: float, y: np.ndarray) -> list[float]:
            return [(m - P * (reach - y[1])) / EJ, np.cos(y[0]), np.sin(y[0])]

        found = solve_ivp(rate, (0, length), [0, 0, 0], rtol=1e-12, atol=1e-14, method="DOP853")
        return np.array(found.y[:, -1])

    def missed(unknown: np.ndarray) -> list[float]:
        end = tip(unknown[0], unknown[1])
        return [end[2] - wall, end[1] - unknown[1]]

    P, reach = _root(missed, [0.1, 0.29])
    obstacle = HalfSpace((0, 0, -wall - radius), (0, 0, 1))
    shape = settle(
        bar(length, radius, E), [0, tension, 0, 0], Scene(ExactTendons(), Contact(obstacle)), 1e-9
    )
    (touch,) = shape.contacts
    assert deviation(touch.force, [0, 0, P], P) < 1e-6
    assert deviation(shape.tip, [reach, 0, -wall], length) < 3e-9


def _root(missed: Callable[[np.ndarray], list[float]], guess: list[float]) -> np.ndarray:
    found = root(missed, guess, tol=1e-13)
    assert np.abs(found.fun).max() < 1e-9
    return np.array(found.x)


def _strip(length: float, EJ: float, force: float, center: np.ndarray, wide: float) -> np.ndarray:
    """Return lift-off points a, b and end forces of a strip bent round a cylinder by its tip.

    Inextensible, clamped along x at the origin, a dead force down at the tip. In contact the
    curvature is 1 / wide; M is continuous at both ends of the free parts.
    """

    def left(Q: float, N: float, a: float) -> tuple[float, ...]:
        """Integrate back from a with M = EJ / wide, shear Q and axial force N there."""
        angle = state[0]
        start = [angle, *(center + wide * np.array([np.sin(angle), np.cos(angle)]))]
        direction = np.array([np.cos(angle), -np.sin(angle)])
        across = np.array([-direction[1], direction[0]])
        F = N * direction + Q * across

        def rate(_: float, y: np.ndarray) -> list[float]:
            arm = np.array(start[1:]) - y[1:3]
            M = EJ / wide - (arm[0] * F[1] - arm[1] * F[0])
            return [M / EJ, np.cos(y[0]), -np.sin(y[0])]

        found = solve_ivp(rate, (a, 0), start, rtol=1e-12, atol=1e-14, method="DOP853")
        return tuple(found.y[:, -1])

    def right(angle: float, b: float) -> np.ndarray:
        """Return tip angle and moment there of the part beyond b."""

        def rate(_: float, y: np.ndarray) -> list[float]:
            return [y[1] / EJ, -force * np.cos(y[0])]

        found = solve_ivp(
            rate, (b, length), [angle, EJ / wide], rtol=1e-12, atol=1e-14, method="DOP853"
        )
        return np.array(found.y[:, -1])

    state = [0.0]

    def missed(unknown: np.ndarray) -> list[float]:
        angle_a, a, b, Q = unknown
        state[0] = angle_a
        angle_b = angle_a + (b - a) / wide
        N = force * np.sin(angle_b)
        end = left(Q, N, a)
        return [end[0], end[1], end[2], right(angle_b, b)[1] / EJ]

    guess = [0.35, 0.149, 0.185, 6.0]
    angle_a, a, b, Q = _root(missed, guess)
    angle_b = angle_a + (b - a) / wide
    return np.array([a, b, abs(Q), force * np.cos(angle_b), force * np.sin(angle_b) / wide])


@pytest.mark.slow
def test_a_strip_bent_round_a_cylinder_lies_on_its_arc_and_presses_at_its_ends(
    deviation: Callable[..., float],
) -> None:
    length, radius, E, force, round_ = 0.3, 0.002, 1e9, 12.0, 0.06
    center = np.array([0.12, -round_ - 0.004])
    cylinder = Capsule((0.12, -0.1, center[1]), (0.12, 0.1, center[1]), round_)
    scene = Scene(TipLoad(force=(0, 0, -force)), Contact(cylinder))
    shape = settle(bar(length, radius, E), NONE, scene, 1e-9)
    wanted = _strip(length, stiffness(radius, E), force, center, round_ + radius)
    touches = shape.contacts
    h = touches[1].s - touches[0].s
    p = [touch.pressure for touch in touches]
    ends = [
        np.linalg.norm(touches[i].force) - h * (2 * p[i] + p[j]) / 6 for i, j in ((0, 1), (-1, -2))
    ]
    found = [touches[0].s, touches[-1].s, *ends, float(np.mean(p))]
    assert deviation(found / wanted, 1.0) < 1e-6
