"""An arm that presses on itself: against a rod by SciPy, balance by NumPy, refusals."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import fsolve

from octoplan.model import Anchorage, Arm, Material, Scene, settle
from octoplan.model.extensions.contact.effects import SelfContact
from octoplan.model.paths import Linear
from octoplan.model.support.errors import UnsettledContactError

L, R, E = 0.3, 0.006, 2e5
EJ, OFF = E * np.pi * R**4 / 4, R / 2
PATH = Linear(OFF, OFF)
ENDS = (Anchorage(L, PATH), Anchorage(L / 2, PATH))
ARM = Arm(L, Linear(R, R), ENDS, Material(E=E, nu=0.5, density=1000.0))
SCENE = Scene(SelfContact())


def curled(pull: float, across: float = 0.0) -> np.ndarray:
    """Return tensions that bend the farther half alone [N]: the nearer one is held straight."""
    return np.array([[across, pull, 0.0, 0.0], [0.0, 0.0, across, pull]]) * 1.0


def rod(pull: float) -> tuple[float, float]:
    """Return the contact of the tip on the nearer half [m], and the force [N].

    A planar rod by initial values, straight along x up to the contact; beyond,
    (E J + sum of y^2 T) kappa = sum of y T + f (x_tip - x), with the force f on the tip along -z.
    """

    def end(force: float, s: float) -> np.ndarray:
        def slope(at: float, y: np.ndarray) -> list[float]:
            stiff = EJ + OFF**2 * pull * (1 if at > L / 2 else 2)
            moment = force * (s - y[0]) + OFF * pull * (at > L / 2)
            return [np.cos(y[2]), -np.sin(y[2]), moment / stiff]

        y = np.array([s, 0.0, 0.0])
        for part in ((s, L / 2 - 1e-15), (L / 2 + 1e-15, L)):
            y = solve_ivp(slope, part, y, rtol=1e-11, atol=1e-13).y[:, -1]
        return y

    def lacks(z: np.ndarray) -> list[float]:
        x, height, _ = end(1e-2 * z[0], L * z[1])
        return [x / L - z[1], (height + 2 * R) / L]

    force, s = fsolve(lacks, [0.1, 0.43], xtol=1e-13)
    return float(L * s), float(1e-2 * force)


def test_the_tip_presses_on_the_arm_as_a_rod_by_scipy_does() -> None:
    shape = settle(ARM, curled(2.71), SCENE, compile=True)
    s, force = rod(2.71)
    below, tip = shape.contacts
    assert tip.s == L
    assert below.s == pytest.approx(s, abs=1e-6 * L)
    assert np.allclose(tip.force, [0.0, 0.0, -force], atol=1e-6 * force)
    assert np.array_equal(tip.force, -below.force)
    assert max(abs(tip.gap), abs(below.gap)) < 1e-8 * L


@pytest.mark.slow
def test_what_would_slip_past_itself_sideways_is_refused() -> None:
    """In a plane the shape is an equilibrium that is unstable under transverse forces."""
    with pytest.raises(UnsettledContactError, match="slip past each other"):
        settle(ARM, curled(3.0), SCENE, compile=True)


def test_what_makes_no_progress_ends_with_a_sentence(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("octoplan.model.support.progress.PATIENCE", -1.0)
    with pytest.raises(UnsettledContactError, match="is found within"):
        settle(ARM, curled(3.0), SCENE)


def test_an_arm_that_does_not_meet_itself_is_settled_as_without() -> None:
    shape = settle(ARM, curled(1.0), SCENE)
    assert shape.contacts == ()
    assert np.allclose(shape.tip, settle(ARM, curled(1.0), Scene()).tip, atol=1e-9)
