"""Forces and moments at the tip and on the way, against references, elastica, arcs and helices."""

from __future__ import annotations

import json

import numpy as np
import pytest
from scipy.optimize import brentq
from scipy.spatial.transform import Rotation

from octoplan.model import Anchorage, Arm, Linear, Scene, settle
from octoplan.model.arm import PAPER_FRAME
from octoplan.model.effects import (
    Buoyancy,
    ExactTendons,
    Extension,
    NeoHookean,
    PointLoad,
    TipLoad,
    Weight,
)
from tests.core.effects.bars import NO_PULL, Bar, dead_elastica, elastica, follower_elastica, helix
from tests.core.effects.cases import DATA, Array

PAPER_CASES = json.loads((DATA / "reference_cases.json").read_text())["cases"]
BAR = Bar()
L, EJ, GI = BAR.length, float(BAR.EJ(0.0)), float(BAR.GI(0.0))
PAPER_LOADS = {
    "paper + tip force (0,0,-0.002) N": (TipLoad((0, 0, -0.002)),),
    "paper + weight (0,0,-9.81) m/s2, body 1080, fluid 1000 kg/m3": (Weight(), Buoyancy(1000.0)),
}


@pytest.mark.parametrize("load", PAPER_LOADS, ids=["tip force", "weight in water"])
@pytest.mark.parametrize("name", ["Figure 11(b)", "Figure 15"])
def test_the_paper_loaded_settles_to_the_references(name: str, load: str) -> None:
    case = next(case for case in PAPER_CASES if case["name"] == name)
    scene = Scene(Extension(), *PAPER_LOADS[load])
    tip = settle(Arm.from_paper(case["arm"]), case["tensions"], scene, 1e-9).tip
    assert np.linalg.norm(tip - case["tip"][load]) < 1e-9


@pytest.mark.parametrize("alpha", [0.1, 1.0, 3.0, 10.0])
def test_a_dead_force_across_the_tip_makes_an_elastica(alpha: float) -> None:
    shape = settle(BAR.arm, NO_PULL, Scene(TipLoad((0, alpha * EJ / L**2, 0))), 1e-11)
    s = np.linspace(0, L, 9)
    wanted = dead_elastica(alpha, s, L)
    assert np.allclose(shape.position(s)[:, :2], wanted.T, rtol=0, atol=2e-11 * L)
    assert np.abs(shape.position(s)[:, 2]).max() < 1e-15


@pytest.mark.quick("uniform-0.5", "uniform-15.0", "conical-4.0")
@pytest.mark.parametrize("alpha", [0.5, 4.0, 10.0, 15.0])
@pytest.mark.parametrize("bar", [BAR, Bar(0.012, 0.004)], ids=["uniform", "conical"])
def test_a_follower_force_is_an_initial_value_problem_from_the_tip(bar: Bar, alpha: float) -> None:
    force = alpha * bar.EJ(0.5 * L) / L**2
    # n of the paper's frame is -y if t is x.
    shape = settle(bar.arm, NO_PULL, Scene(TipLoad((0, -force, 0), follower=True)), 1e-10)
    wanted = follower_elastica(bar, force, np.linspace(0, L, 9))
    assert np.allclose(shape.position(np.linspace(0, L, 9))[:, :2], wanted, atol=1e-10 * L, rtol=0)


PULLED = Arm.from_paper("table-4")
PULLS = [[0, 0, 0.2, 0], [1.0, 0, 0, 0], [0, 3.0, 0, 0]]


def test_a_point_load_at_the_tip_is_a_tip_load() -> None:
    force = (0.001, -0.002, 0.003)
    at_tip, point = (
        settle(PULLED, PULLS, Scene(Extension(), load), 1e-9)
        for load in (TipLoad(force), PointLoad(PULLED.length, force))
    )
    assert np.allclose(point.states, at_tip.states, rtol=0, atol=1e-12)


def test_beyond_a_point_load_a_bar_is_straight_and_before_it_the_elastica() -> None:
    at, alpha = 0.17, 4.0
    shape = settle(BAR.arm, NO_PULL, Scene(PointLoad(at, (0, alpha * EJ / at**2, 0))), 1e-11)
    s = np.linspace(0, at, 6)
    wanted = dead_elastica(alpha, s, at).T
    assert np.allclose(shape.position(s)[:, :2], wanted, rtol=0, atol=2e-11 * L)
    beyond = np.linspace(at + 1e-9, L, 5)
    assert np.abs(shape.strain(beyond)).max() < 1e-9
    t = shape.tip_frame[:, 0]
    assert np.allclose(shape.position(at) + (L - at) * t, shape.tip, rtol=0, atol=1e-12)


def test_point_loads_far_from_small_bend_the_elastica_of_all_of_them() -> None:
    loads = {0.08: (0.3, 1.0), 0.2: (-0.1, -1.2), 0.3: (0.2, 0.9)}
    unit = 4 * EJ / L**2
    points = [PointLoad(s, (unit * f[0], unit * f[1], 0)) for s, f in loads.items()]
    shape = settle(BAR.arm, NO_PULL, Scene(*points), 1e-11)
    found = elastica(
        BAR,
        lambda s: unit * sum(np.array(f) for at, f in loads.items() if at >= s),
        breaks=(0.08, 0.2),
    )
    s = np.linspace(0, L, 7)
    assert np.allclose(shape.position(s)[:, :2], found(s)[:2].T, rtol=0, atol=1e-9 * L)


def test_small_point_loads_superpose() -> None:
    size = 1e-6 * EJ / L**2
    one, two = PointLoad(0.1, (0, size, size)), PointLoad(0.25, (0, -size, 2 * size))
    bends = [settle(BAR.arm, NO_PULL, Scene(*s), 1e-12).tip[1:] for s in ((one,), (two,))]
    both = settle(BAR.arm, NO_PULL, Scene(one, two), 1e-12).tip[1:]
    assert np.allclose(both, sum(bends), rtol=1e-8, atol=0)
    wanted = sum(np.array(p.force[1:]) * p.s**2 * (3 * L - p.s) / (6 * EJ) for p in (one, two))
    assert np.allclose(both, wanted, rtol=1e-8, atol=0)


@pytest.mark.parametrize("follower", [False, True], ids=["dead", "follower"])
def test_a_turned_base_with_turned_loads_gives_the_turned_shape(follower: bool) -> None:
    turn = Rotation.from_euler("xyz", [0.4, -1.1, 2.0]).as_matrix()
    at = np.array([0.1, -0.2, 0.3])
    force, moment, point, g = np.array(
        [[1e-3, -2e-3, 3e-3], [1e-5, 2e-5, -3e-5], [0, 4e-3, 0], [0.5, 0.2, -0.3]]
    )
    there = np.eye(3) if follower else turn  # a follower's load is in the frame of the tip

    def scene(turn: Array, tip_turn: Array) -> Scene:
        tip = TipLoad(tuple(tip_turn @ force), tuple(tip_turn @ moment), follower)
        return Scene(Extension(), tip, PointLoad(0.2, tuple(turn @ point)), Weight(tuple(turn @ g)))

    frame = tuple(map(tuple, turn @ np.array(PAPER_FRAME)))
    sections, material = PULLED.sections, PULLED.material
    moved = Arm(PULLED.length, PULLED.radius, sections, material, frame, tuple(at))
    plain = settle(PULLED, PULLS, scene(np.eye(3), np.eye(3)), 1e-9)
    turned = settle(moved, PULLS, scene(turn, there), 1e-9)
    assert np.allclose(turned.tip, at + turn @ plain.tip, rtol=0, atol=1e-11)
    assert np.allclose(turned.tip_frame, turn @ plain.tip_frame, rtol=0, atol=1e-10)


def test_a_point_load_on_the_base_does_nothing() -> None:
    shape = settle(BAR.arm, NO_PULL, Scene(PointLoad(0.0, (1.0, 2.0, 3.0))))
    assert np.allclose(shape.tip, [L, 0, 0], rtol=0, atol=1e-15)


def under_moment(moment: Array, s: float) -> tuple[Array, Array]:
    """Return position and frame of a uniform bar under a constant moment: a helix."""
    base = np.array(PAPER_FRAME)
    twist = float(moment @ base[:, 0])
    rate = moment / EJ
    own = np.array([twist * (1 / GI - 1 / EJ), 0, 0])
    frame = Rotation.from_rotvec(rate * s).as_matrix() @ base
    return helix(rate, base[:, 0], s), frame @ Rotation.from_rotvec(own * s).as_matrix()


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
    # Seen from the tip, the base is at the end of the same bar at s = -L; n, b are -y, -z here.
    base = np.array(PAPER_FRAME)
    position, frame = under_moment(base @ moment, -L)
    turn = base @ frame.T
    assert np.allclose(shape.tip, -turn @ position, rtol=0, atol=2e-11 * L)
    assert np.allclose(shape.tip_frame, turn @ base, rtol=0, atol=1e-9)


def co_contracted(y: float) -> Arm:
    """Return the bar with four tendons at a constant distance from its axis."""
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
        """Return kappa of kappa (GI + 4 T y2 / |c|) = M, with offsets that shrink in rubber."""
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
