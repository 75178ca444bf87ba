"""Bars, columns and cross-sections whose stiffness has a closed form or a quadrature."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.optimize import brentq

from octoplan.model import Anchorage, Arm, Linear, Scene, settle
from octoplan.model.effects import ExactTendons, Extension, NeoHookean, TipLoad
from octoplan.model.extensions.critical_load import critical_load_factor
from octoplan.planner import stiffness
from tests.core.effects.bars import NO_PULL, Bar, euler
from tests.core.stiffness.cases import STATICS, Array, pulling, scaled

UNIFORM, CONICAL = Bar(), Bar(0.012, 0.004)
BARS = pytest.mark.parametrize("bar", [UNIFORM, CONICAL], ids=["uniform", "conical"])
STRETCHING = [name for name in STATICS if name != "bare"]
L, EJ = UNIFORM.length, float(UNIFORM.EJ(0.0))
EA, GI = float(UNIFORM.E * UNIFORM.A(0.0)), float(UNIFORM.GI(0.0))
Y = 6e-3
EULER = np.pi**2 * EJ / (4 * L**2)


def antagonists(bar: Bar = UNIFORM, angles: tuple[float, ...] = (0.0, np.pi)) -> Arm:
    """Return the bar with parallel tendons on its axis, two opposite each other along n = -y."""
    return replace(bar.arm, sections=(Anchorage(bar.length, Linear(Y, Y), angles),))


def textbook(extends: float, by_force: float, mixed: float, turns: float, twists: float) -> Array:
    """The compliance of a bar along x."""
    return np.array(
        [
            [extends, 0, 0, 0, 0, 0],
            [0, by_force, 0, 0, 0, mixed],
            [0, 0, by_force, 0, -mixed, 0],
            [0, 0, 0, twists, 0, 0],
            [0, 0, -mixed, 0, turns, 0],
            [0, mixed, 0, 0, 0, turns],
        ]
    )


@pytest.mark.parametrize("scene", STATICS)
def test_a_uniform_bar_at_rest_has_the_textbook_matrix(scene: str) -> None:
    k = stiffness(UNIFORM.arm, NO_PULL, STATICS[scene], accuracy=1e-11)
    extends = 0.0 if scene == "bare" else L / EA
    wanted = textbook(extends, L**3 / (3 * EJ), L**2 / (2 * EJ), L / EJ, L / GI)
    size = np.abs(scaled(k.shape.arm, wanted)).max()
    assert np.allclose(
        scaled(k.shape.arm, k.compliance),
        scaled(k.shape.arm, wanted),
        rtol=1e-10,
        atol=1e-13 * size,
    )


@pytest.mark.parametrize("at", [0.1, 0.3])
@pytest.mark.parametrize("scene", STRETCHING)
def test_a_conical_bar_has_the_matrix_of_the_unit_load_theorem(scene: str, at: float) -> None:
    k = stiffness(CONICAL.arm, NO_PULL, STATICS[scene], at=at, accuracy=1e-9)

    def over(f: object, power: int) -> float:
        return quad(lambda s: (at - s) ** power / f(s), 0, at, epsrel=1e-12)[0]  # type: ignore[operator]

    EJ, GI = CONICAL.EJ, CONICAL.GI
    extends = over(lambda s: CONICAL.E * CONICAL.A(s), 0)
    wanted = textbook(extends, over(EJ, 2), over(EJ, 1), over(EJ, 0), over(GI, 0))
    size = np.abs(scaled(k.shape.arm, wanted)).max()
    assert np.allclose(
        scaled(k.shape.arm, k.compliance), scaled(k.shape.arm, wanted), rtol=1e-8, atol=1e-13 * size
    )


def sums(arm: Arm, T: Array, s: float, weigh: object) -> Array:
    """Sums of T y^2, times a weight, over the tendons that cross s: all, about n, about b."""
    total = np.zeros(3)
    for (i, phi), pull in zip(arm.tendons, T, strict=True):
        section = arm.sections[i]
        if section.at >= s:
            y, rate = (v[0] for v in section.offset.evaluate(np.array([s]), section.at)[:2])
            part = pull * y**2 * weigh(y, rate, phi)  # type: ignore[operator]
            total += part * np.array([1.0, np.sin(phi) ** 2, np.cos(phi) ** 2])
    return total


def own(arm: Arm, s: float) -> tuple[float, float, float]:
    """E J, G I and E A of the body at s."""
    R = float(arm.radius.evaluate(np.array([s]), arm.length)[0][0])
    bending = arm.material.E * np.pi * R**4 / 4
    return bending, 2 * arm.material.G / arm.material.E * bending, arm.material.E * np.pi * R**2


PLACES = [0.0, 0.05, 0.135, 0.2, 0.315, 0.44]


@pytest.mark.parametrize("scene", ["bare", "paper"])
def test_sections_with_the_papers_tangent_gain_y2_T(scene: str) -> None:
    arm, T = Arm.from_paper("table-4"), pulling("table-4", 11)
    k = stiffness(arm, T, STATICS[scene])
    for s in PLACES:
        bending, twisting, axial = own(arm, s)
        gain = sums(arm, T, s, lambda y, rate, phi: 1.0)
        assert np.allclose(k.section(s), bending + gain[1:], rtol=1e-13, atol=0)
        assert k.torsional(s) == pytest.approx(twisting + gain[0], rel=1e-13)
        assert k.axial(s) == (np.inf if scene == "bare" else pytest.approx(axial, rel=1e-13))


@pytest.mark.parametrize("extension", [False, True], ids=["inextensible", "extensible"])
def test_sections_with_exact_tendons_gain_what_their_slant_gives(extension: bool) -> None:
    # The second derivatives of T |c| with c_t = lambda + y (kappa_n sin - kappa_b cos), c_d = y'.
    arm, T = Arm.from_paper("table-4"), pulling("table-4", 12)
    k = stiffness(arm, T, Scene(ExactTendons(), *([Extension()] * extension)))
    for s in PLACES:
        _, xi, curve, q = k.shape.strain(s)

        def along(
            y: float, phi: float, xi: float = xi, curve: float = curve, q: float = q
        ) -> float:
            return (1 + q) * (1 + y * (xi * np.sin(phi) - curve * np.cos(phi)))

        bending, twisting, axial = own(arm, s)
        slant = sums(arm, T, s, lambda y, r, phi: r**2 / np.hypot(along(y, phi), r) ** 3)
        whole = sums(arm, T, s, lambda y, r, phi: 1 / np.hypot(along(y, phi), r))
        pull = sums(arm, T, s, lambda y, r, phi: (r / y) ** 2 / np.hypot(along(y, phi), r) ** 3)
        assert np.allclose(k.section(s), bending + slant[1:], rtol=1e-12, atol=0)
        assert k.torsional(s) == pytest.approx(twisting + whole[0], rel=1e-12)
        wanted = pytest.approx(axial + pull[0], rel=1e-12) if extension else np.inf
        assert k.axial(s) == wanted


@pytest.mark.parametrize("scene", STATICS)
def test_sections_at_rest_are_the_bodys_own(scene: str) -> None:
    arm = Arm.from_paper("table-2")
    k = stiffness(arm, np.zeros(12), STATICS[scene])
    s = np.linspace(0, arm.length, 7)
    bodies = np.array([own(arm, place) for place in s])
    assert np.allclose(k.section(s), bodies[:, [0, 0]], rtol=1e-13, atol=0)
    assert np.allclose(k.torsional(s), bodies[:, 1], rtol=1e-13, atol=0)
    assert np.allclose(k.axial(s), np.inf if scene == "bare" else bodies[:, 2], rtol=1e-13, atol=0)


@pytest.mark.parametrize("pull", [0.5, 3.0])
@pytest.mark.parametrize("anticlastic", [False, True], ids=["plain", "anticlastic"])
def test_sections_of_pulled_rubber_thicken(anticlastic: bool, pull: float) -> None:
    scene = Scene(Extension(), ExactTendons(), NeoHookean(anticlastic))
    k = stiffness(antagonists(), [pull, pull], scene, accuracy=1e-10)
    stretch = brentq(lambda x: EA / 3 * (x - x**-2) + 2 * pull, 0.3, 1, xtol=1e-15)
    assert 1 + k.shape.strain(0.1)[3] == pytest.approx(stretch, rel=1e-12)
    bending = EJ * (1 + 2 * stretch**-3) / (3 * stretch)
    shift = anticlastic * pull * Y**2 / stretch**2
    assert np.allclose(k.section(0.1), [bending + shift, bending - shift], rtol=1e-11, atol=0)
    twisting = GI / stretch + 2 * pull * Y**2 / stretch**2
    assert k.torsional(0.1) == pytest.approx(twisting, rel=1e-11)


@pytest.mark.parametrize("pull", [0.2, 5.0])
def test_antagonists_stiffen_by_the_papers_tangent_without_extension(pull: float) -> None:
    k = stiffness(antagonists(), [pull, pull], Scene(), accuracy=1e-10)
    stiff = EJ + 2 * Y**2 * pull
    assert k.compliance[1, 1] == pytest.approx(L**3 / (3 * stiff), rel=1e-10)
    assert k.compliance[2, 2] == pytest.approx(L**3 / (3 * EJ), rel=1e-10)
    assert k.compliance[3, 3] == pytest.approx(L / (GI + 2 * Y**2 * pull), rel=1e-10)


@pytest.mark.parametrize("pull", [0.2, 5.0])
def test_exact_antagonists_do_not_stiffen_an_arm_that_keeps_its_length(pull: float) -> None:
    k = stiffness(antagonists(), [pull, pull], Scene(ExactTendons()), accuracy=1e-10)
    assert np.allclose(np.diag(k.compliance)[1:3], L**3 / (3 * EJ), rtol=1e-10, atol=0)
    assert np.allclose(np.diag(k.compliance)[4:], L / EJ, rtol=1e-10, atol=0)


@pytest.mark.parametrize("exact", [False, True], ids=["paper", "exact"])
@pytest.mark.parametrize("tendon_EA", [None, 0.1, 30.0])
def test_locked_antagonists_hold_the_turn_of_the_tip(exact: bool, tendon_EA: float | None) -> None:
    pull = 2.0
    scene = Scene(ExactTendons()) if exact else Scene()
    k = stiffness(antagonists(), [pull, pull], scene, "length", accuracy=1e-10, tendon_EA=tendon_EA)
    stiff = EJ if exact else EJ + 2 * Y**2 * pull
    # Stretch is a spring against the rotation of the tip: unstretched tendons have L / (1 + T /
    # EA).
    hinge = np.inf if tendon_EA is None else 2 * Y**2 * (tendon_EA + pull) / L
    held = 1.0 if tendon_EA is None else hinge * L / stiff / (1 + hinge * L / stiff)
    wanted = L**3 / (3 * stiff) - held * L**3 / (4 * stiff)
    assert k.compliance[1, 1] == pytest.approx(wanted, rel=1e-9)
    response, moment = k.tension_response[:, 1] * Y, held * L / 2
    assert response[0] - response[1] == pytest.approx(moment, rel=1e-9)
    # Only the stretch of the tendons yields to their common tension.
    if tendon_EA is not None:
        assert response.sum() == pytest.approx(0, abs=1e-9 * moment)
    assert k.compliance[2, 2] == pytest.approx(L**3 / (3 * EJ), rel=1e-9)


@BARS
@pytest.mark.parametrize("share", [0.5, 4.0])
def test_a_column_buckles_at_eulers_load(bar: Bar, share: float) -> None:
    critical = euler(bar)
    if bar is UNIFORM:
        assert critical == pytest.approx(EULER, rel=1e-8)
    found = critical_load_factor(bar.arm, NO_PULL, Scene(TipLoad((-critical / share, 0, 0))))
    assert found.load_factor == pytest.approx(share, rel=1e-3)
    assert found.why


@pytest.mark.parametrize("exact", [False, True], ids=["paper", "exact"])
def test_antagonists_raise_eulers_load_by_the_papers_tangent_alone(exact: bool) -> None:
    pull = 3.0
    effects = (TipLoad((-EULER, 0, 0)), *([ExactTendons()] * exact))
    # Pulled along z as well, so that no plane is softer.
    arm = antagonists(angles=(0.0, np.pi / 2, np.pi, 1.5 * np.pi))
    found = critical_load_factor(arm, [pull] * 4, Scene(*effects))
    gain = 0.0 if exact else 2 * Y**2 * pull / EJ
    assert found.load_factor == pytest.approx(1 + gain, rel=1e-3)


@pytest.mark.parametrize("share", [-2.0, 0.1, 0.5, 0.95])
def test_a_column_gives_way_across_as_a_beam_column(share: float) -> None:
    P = share * EULER
    k = stiffness(UNIFORM.arm, NO_PULL, Scene(TipLoad((-P, 0, 0))), accuracy=1e-9)
    rate = np.sqrt(abs(P) / EJ)
    bends = np.tan(rate * L) if P > 0 else np.tanh(rate * L)
    wanted = bends / (P * rate) - L / P
    assert np.allclose(np.diag(k.compliance)[1:3], wanted, rtol=1e-8, atol=0)
    assert k.compliance[3, 3] == pytest.approx(L / GI, rel=1e-8)
    assert k.stable


def test_a_pulled_arm_that_shortens_has_a_shorter_lever() -> None:
    # With extension, EJ per unit deformed length is constant, and the lever arm shortens.
    pull = 1.0
    k = stiffness(antagonists(), [pull, pull], Scene(Extension()), accuracy=1e-10)
    q = settle(antagonists(), [pull, pull], Scene(Extension())).strain(0.1)[3]
    assert q == pytest.approx(-2 * pull / EA, rel=1e-12)
    stiff = EJ + 2 * Y**2 * pull
    assert k.compliance[1, 1] == pytest.approx(((1 + q) * L) ** 3 / (3 * stiff), rel=1e-9)
