"""A moment at the tip of a bar: arcs and helices in closed form, however far it bends."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import brentq
from scipy.spatial.transform import Rotation

from model import Anchorage, Arm, Linear, Scene, settle
from model.arm import PAPER_FRAME
from model.effects import ExactTendons, Extension, NeoHookean, TipLoad
from tests.effects.bars import NO_PULL, Bar
from tests.effects.cases import Array

BAR = Bar()
L, EJ, GI = BAR.length, float(BAR.EJ(0.0)), float(BAR.GI(0.0))


def under_moment(moment: Array, s: float) -> tuple[Array, Array]:
    """Position and frame of a uniform bar under a constant moment: a helix about it."""
    base = np.array(PAPER_FRAME)
    twist = float(moment @ base[:, 0])
    rate = moment / EJ
    own = np.array([twist * (1 / GI - 1 / EJ), 0, 0])
    frame = Rotation.from_rotvec(rate * s).as_matrix() @ base
    size = np.linalg.norm(rate)
    axis = rate / size
    t = base[:, 0]
    along = axis * (axis @ t)
    across = (t - along) * np.sin(size * s) / size
    position = along * s + across + np.cross(axis, t) * (1 - np.cos(size * s)) / size
    return position, frame @ Rotation.from_rotvec(own * s).as_matrix()


MOMENTS = {
    "about b": (0, 0, 2.0),
    "about n": (0, -3.0, 0),
    "twist": (4.0, 0, 0),
    "helix": (1.0, -2.0, 1.5),
    "three turns": (0, 0, 19.0),
}


@pytest.mark.parametrize("name", MOMENTS)
def test_a_moment_at_the_tip_winds_a_bar_into_arc_or_helix(name: str) -> None:
    moment = np.array(MOMENTS[name]) * EJ / L
    shape = settle(BAR.arm, NO_PULL, Scene(TipLoad(moment=tuple(moment))), 1e-11)
    for s in (0.4 * L, L):
        position, frame = under_moment(moment, s)
        assert np.allclose(shape.position(s), position, rtol=0, atol=2e-11 * L)
        assert np.allclose(shape.frame(s), frame, rtol=0, atol=1e-9)
    assert shape.strain(0.1)[0] == pytest.approx(moment[0] / GI, rel=1e-11, abs=1e-15)


@pytest.mark.parametrize("name", MOMENTS)
def test_a_moment_that_follows_the_tip_winds_the_bar_from_there(name: str) -> None:
    moment = np.array(MOMENTS[name]) * EJ / L
    shape = settle(BAR.arm, NO_PULL, Scene(TipLoad(moment=tuple(moment), follower=True)), 1e-11)
    # Seen from the tip the base is where the same bar would end at s = -L; n, b are -y, -z here.
    base = np.array(PAPER_FRAME)
    position, frame = under_moment(base @ moment, -L)
    turn = base @ frame.T
    assert np.allclose(shape.tip, -turn @ position, rtol=0, atol=2e-11 * L)
    assert np.allclose(shape.tip_frame, turn @ base, rtol=0, atol=1e-9)


def co_contracted(y: float) -> Arm:
    """The bar with four tendons at a constant distance from its axis."""
    return Arm(L, Linear(0.01, 0.01), (Anchorage(L, Linear(y, y)),))


@pytest.mark.parametrize("pull", [0.0, 0.5, 3.0])
def test_with_the_papers_tangent_tendons_stiffen_a_twist_by_T_y2(pull: float) -> None:
    y, moment = 6e-3, 2.0 * GI / L
    shape = settle(co_contracted(y), [pull] * 4, Scene(TipLoad(moment=(moment, 0, 0))), 1e-9)
    tau = moment / (GI + 4 * pull * y**2)
    assert np.allclose(shape.strain(0.1), [tau, 0, 0, 0], rtol=1e-12, atol=1e-12)
    # n starts out along -y.
    turn = np.arctan2(-shape.tip_frame[2, 1], -shape.tip_frame[1, 1])
    assert turn == pytest.approx(tau * L, abs=1e-9)


@pytest.mark.parametrize("pull", [0.5, 3.0])
@pytest.mark.parametrize("rubber", [False, True], ids=["linear", "rubber"])
def test_exact_tendons_that_are_twisted_into_helices(pull: float, rubber: bool) -> None:
    y, moment, EA = 6e-3, 2.0 * GI / L, 110e3 * np.pi * 0.01**2
    more = (NeoHookean(),) if rubber else ()
    scene = Scene(Extension(), ExactTendons(), TipLoad(moment=(moment, 0, 0)), *more)
    shape = settle(co_contracted(y), [pull] * 4, scene, 1e-9)

    def twist(stretch: float) -> float:
        """Of kappa (GI + 4 T y2 / |c|) = M, with offsets that shrink in rubber."""
        lever, stiff = (y**2 / stretch, GI / stretch) if rubber else (y**2, GI)

        def gap(kappa: float) -> float:
            pulled = 4 * pull * lever * kappa / np.hypot(stretch, np.sqrt(lever) * kappa)
            return float(stiff * kappa + pulled - moment)

        return float(brentq(gap, 0, 100, xtol=1e-14))

    def axial(stretch: float) -> float:
        kappa = twist(stretch)
        lever = y**2 / stretch if rubber else y**2
        size = np.hypot(stretch, np.sqrt(lever) * kappa)
        if not rubber:
            return float(EA * (stretch - 1) + 4 * pull * stretch / size)
        body = EA / 3 * (stretch - stretch**-2) - GI * kappa**2 / (2 * stretch**2)
        tendons = 4 * pull * (stretch - y**2 * kappa**2 / (2 * stretch**2)) / size
        return float(body + tendons)

    stretch = brentq(axial, 0.3, 1.0, xtol=1e-14)
    wanted = [twist(stretch) / stretch, 0, 0, stretch - 1]
    assert np.allclose(shape.strain(0.1), wanted, rtol=1e-10, atol=1e-12)
    assert np.allclose(shape.tip, [stretch * L, 0, 0], rtol=0, atol=1e-11)
