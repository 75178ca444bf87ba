"""Properties of every stiffness: symmetry, order, invariance, limits, refusals."""

from __future__ import annotations

import json
from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from octoplan.model import Anchorage, Arm, Linear, Material, Scene
from octoplan.model.arm import PAPER_FRAME
from octoplan.model.effects import TipLoad, Weight
from octoplan.model.support.errors import SingularError
from octoplan.planner import stiffness
from tests.core.effects.cases import DATA, RODS
from tests.core.stiffness.cases import IN_WATER, STATICS, Array, gap, pulling, scaled, with_effects

ARM, T = Arm.from_paper("table-4"), pulling("table-4", 21)
FORCE = TipLoad((3e-4, -2e-4, 4e-4), (1e-6, 2e-6, -1e-6))
DEAD = TipLoad((3e-4, -2e-4, 4e-4))
# Three tendons a section: any change of their lengths requires a strain.
THREE = replace(ARM, sections=tuple(replace(s, angles=(0.0, 2.0, 4.0)) for s in ARM.sections))
PULLS = np.delete(T, [3, 7, 11])
CONSERVATIVE = {
    "exact": STATICS["exact"],
    "silicone": STATICS["silicone"],
    "exact, in water, with a tip force": with_effects(STATICS["exact"], *IN_WATER, DEAD),
}
RARER = {
    "anticlastic": STATICS["anticlastic"],
    "silicone in water": with_effects(STATICS["silicone"], *IN_WATER),
}
EACH = pytest.mark.parametrize(
    "scene",
    [
        *CONSERVATIVE.values(),
        *(pytest.param(scene, marks=pytest.mark.slow) for scene in RARER.values()),
    ],
    ids=[*CONSERVATIVE, *RARER],
)


def sizes(arm: Arm) -> Array:
    """Return the units of displacements and rotations."""
    return np.repeat([arm.length, 1.0], 3)


@pytest.mark.quick("tension-silicone", "length-exact", "tension-exact, in water, with a tip force")
@EACH
@pytest.mark.parametrize("hold", ["tension", "length"])
def test_energies_make_the_compliance_symmetric_and_positive(scene: Scene, hold: Any) -> None:
    EA = 5.0 if hold == "length" else None
    k = stiffness(ARM, T, scene, hold, accuracy=1e-9, tendon_EA=EA)
    C = scaled(ARM, k.compliance)
    assert k.stable
    assert np.abs(C - C.T).max() < 1e-8 * np.abs(C).max()
    assert np.linalg.eigvalsh((C + C.T) / 2)[0] > 0


@pytest.mark.quick("silicone", "exact, in water, with a tip force")
@EACH
def test_locked_lengths_are_never_softer_than_held_tensions(scene: Scene) -> None:
    free = scaled(ARM, stiffness(ARM, T, scene, accuracy=1e-9).compliance)
    order = [free]
    for EA in (0.01, 0.3, 10.0, 300.0, None):
        k = stiffness(ARM, T, scene, "length", accuracy=1e-9, tendon_EA=EA)
        order.append(scaled(ARM, k.compliance))
    for softer, stiffer in pairwise(order):
        values = np.linalg.eigvalsh((softer - stiffer + (softer - stiffer).T) / 2)
        assert values[0] > -1e-9 * np.abs(free).max()
        assert values[-1] > 1e-6 * np.abs(free).max()


@pytest.mark.quick("exact")
@pytest.mark.parametrize("scene", ["paper", "exact", "silicone"])
def test_stiff_tendons_hold_their_lengths(scene: str) -> None:
    free = stiffness(THREE, PULLS, STATICS[scene], accuracy=1e-9).compliance
    stiff, stiffer, locked = (
        stiffness(THREE, PULLS, STATICS[scene], "length", accuracy=1e-9, tendon_EA=EA).compliance
        for EA in (1e6, 1e8, None)
    )
    size = np.abs(scaled(THREE, free)).max()
    assert np.abs(scaled(THREE, locked - free)).max() > 0.1 * size
    gaps = [np.abs(scaled(THREE, value - locked)).max() / size for value in (stiff, stiffer)]
    assert gaps[1] < 1e-5
    # To first order in the compliance of the tendons.
    assert gaps[1] == pytest.approx(gaps[0] / 100, rel=0.02, abs=1e-9)


@pytest.mark.quick("5.0-exact")
@pytest.mark.parametrize("scene", ["paper", "exact", "silicone"])
@pytest.mark.parametrize("EA", [5.0, 100.0])
def test_locked_tendons_yield_as_those_that_winches_leave(scene: str, EA: float) -> None:
    locked = stiffness(ARM, T, STATICS[scene], "length", accuracy=1e-9, tendon_EA=EA)
    unstretched = locked.shape.tendon_lengths / (1 + locked.shape.tensions / EA)
    options = {"scene": STATICS[scene], "lengths": unstretched, "tendon_EA": EA}
    left = stiffness(ARM, accuracy=1e-9, near=locked.shape, **options)
    assert left.locked == locked.locked
    assert np.allclose(left.shape.tensions, locked.shape.tensions, rtol=0, atol=1e-6)
    assert np.allclose(left.compliance, locked.compliance, rtol=1e-5, atol=1e-7)


def test_nothing_is_locked_where_tensions_hold_or_all_are_slack() -> None:
    free = stiffness(ARM, T, STATICS["exact"])
    assert free.hold == "tension"
    assert free.locked == free.slack == ()
    assert not free.tension_response.any()
    slack = stiffness(ARM, np.zeros(12), STATICS["exact"], "length", release=True)
    rest = stiffness(ARM, np.zeros(12), STATICS["exact"])
    assert slack.locked == ()
    assert np.array_equal(slack.compliance, rest.compliance)


@EACH
def test_a_wrench_lengthens_tendons_as_their_tensions_move_the_tip(scene: Scene) -> None:
    # Maxwell: d length / d wrench = -(d pose / d tension)^T; the response shows the former.
    k = stiffness(ARM, T, scene, "length", accuracy=1e-9, tendon_EA=5.0)
    give = np.diag(k.shape.tendon_lengths / (5.0 + k.shape.tensions))
    lengthened = -(k.length_tension - give) @ k.tension_response
    found, wanted = lengthened / sizes(ARM), -(k.pose_tension.T) / sizes(ARM)
    assert np.abs(found - wanted).max() < 1e-8 * np.abs(wanted).max()
    assert gap(k.length_tension, k.length_tension.T) < 1e-8


@pytest.mark.parametrize("scene", ["paper", "exact", "silicone"])
def test_poses_per_length_are_poses_per_tension_over_lengths_per_tension(scene: str) -> None:
    k = stiffness(THREE, PULLS, STATICS[scene], "length", accuracy=1e-9)
    size = sizes(ARM)[:, None]
    assert gap(k.pose_length @ k.length_tension / size, k.pose_tension / size) < 1e-10


@pytest.mark.parametrize("hold", ["tension", "length"])
@pytest.mark.parametrize("heavy", [False, True], ids=["unloaded", "loaded"])
def test_a_turned_base_turns_the_compliance(heavy: bool, hold: Any) -> None:
    turn = Rotation.from_euler("xyz", [0.4, -1.1, 2.0]).as_matrix()
    frame = tuple(map(tuple, (turn @ np.array(PAPER_FRAME)).tolist()))
    g = np.array([0.3, -0.4, -0.5])

    def scene(turn: Array) -> Scene:
        loads = (
            Weight(tuple(turn @ g)),
            TipLoad(tuple(turn @ FORCE.force), tuple(turn @ FORCE.moment)),
        )
        return with_effects(STATICS["paper"], *(loads if heavy else ()))

    plain = stiffness(ARM, T, scene(np.eye(3)), hold, accuracy=1e-9, tendon_EA=5.0)
    there = replace(ARM, base_frame=frame, base_position=(0.1, -0.2, 0.3))
    moved = stiffness(there, T, scene(turn), hold, accuracy=1e-9, tendon_EA=5.0)
    both = np.kron(np.eye(2), turn)
    assert gap(scaled(ARM, moved.compliance), scaled(ARM, both @ plain.compliance @ both.T)) < 1e-8
    size = sizes(ARM)[:, None]
    assert gap(moved.pose_tension / size, both @ plain.pose_tension / size) < 1e-8


@pytest.mark.parametrize("hold", ["tension", "length"])
@pytest.mark.parametrize("scene", ["paper", "silicone"])
def test_compliance_scales_with_length_and_modulus(scene: str, hold: Any) -> None:
    longer, stiffer = 3.0, 7.0
    sections = tuple(
        Anchorage(longer * s.at, Linear(longer * s.offset.base, longer * s.offset.end), s.angles)
        for s in ARM.sections
    )
    radius = Linear(longer * ARM.radius.base, longer * ARM.radius.end)
    big = Arm(longer * ARM.length, radius, sections, Material(stiffer * 110e3))
    forces = stiffer * longer**2
    one = stiffness(ARM, T, STATICS[scene], hold, tendon_EA=5.0)
    other = stiffness(big, forces * T, STATICS[scene], hold, tendon_EA=forces * 5.0)
    wanted = scaled(ARM, one.compliance) / (forces * longer)
    assert gap(scaled(big, other.compliance), wanted) < 1e-9


def test_the_axes_of_the_ellipsoid_are_the_most_that_a_newton_moves() -> None:
    k = stiffness(ARM, T, STATICS["silicone"])
    axes, directions = k.ellipsoid()
    force_part = k.compliance[:3, :3]
    assert np.allclose(axes, np.linalg.svd(force_part)[1], rtol=1e-12, atol=0)
    assert np.all(np.diff(axes) <= 0)
    assert np.allclose(directions.T @ directions, np.eye(3), rtol=0, atol=1e-13)
    assert np.allclose(force_part @ directions, directions * axes, rtol=0, atol=1e-8 * axes[0])
    drawn = np.random.default_rng(0).normal(size=(3, 500))
    moved = np.linalg.norm(force_part @ (drawn / np.linalg.norm(drawn, axis=0)), axis=0)
    assert axes[2] * (1 - 1e-12) < moved.min() < moved.max() < axes[0] * (1 + 1e-12)


def test_an_arm_that_cannot_stretch_has_no_stiffness_and_says_along_what() -> None:
    k = stiffness(ARM, np.zeros(12), Scene())
    with pytest.raises(SingularError, match=r"\(force, moment\) along \[-?1\.0, ") as caught:
        _ = k.stiffness
    along = np.array(json.loads(str(caught.value).split("along ")[1]))
    assert np.allclose(np.abs(along), [1, 0, 0, 0, 0, 0], rtol=0, atol=1e-3)


def fem_deflections() -> dict[str, tuple[float, dict[str, float]]]:
    """Lateral tip displacement per newton [m/N] of case d at 2 x 1 N: finite elements, rods."""
    cases = json.loads((DATA / "fem_reference.json").read_text())["cases"]
    found = {}
    for case in cases:
        if case["case"] == "d" and case["label"].endswith("T1 F1e-3"):
            rods = {name: rod["tip"][1] / 1e-3 for name, rod in case["rods"].items()}
            found[case["label"].split()[0]] = (case["tip"][1] / 1e-3, rods)
    return found


def lateral(rod: str, plane: str) -> float:
    """The lateral compliance of case d at 2 x 1 N [m/N]."""
    turn = np.pi / 2 if plane == "outplane" else 0.0
    offset = Linear(0.0, 0.0) if plane == "centre" else Linear(7.5e-3, 1e-3)
    arm = Arm(0.31, Linear(0.015, 0.0065), (Anchorage(0.31, offset, (turn, turn + np.pi)),))
    return float(stiffness(arm, [1.0, 1.0], RODS[rod]).compliance[1, 1])


@pytest.mark.parametrize("plane", ["inplane", "outplane", "centre"])
def test_pulled_silicone_gives_way_as_finite_elements_do(plane: str) -> None:
    solid, rods = fem_deflections()[plane]
    for rod, deflection in rods.items():
        # 1 mN deflects by 1.3 % of L: nonlinear parts are of the order of the square.
        assert lateral(rod, plane) == pytest.approx(deflection, rel=5e-4)
    gaps = {rod: abs(lateral(rod, plane) / solid - 1) for rod in rods}
    assert gaps["nh"] < 0.03
    assert gaps["nha"] < 0.01
    assert gaps["exact"] > 0.1
    if plane != "inplane":
        assert gaps["paper"] > 0.05
    else:
        assert gaps["paper"] > gaps["nh"]


def test_slack_tendons_are_named_and_can_be_released() -> None:
    some = T * (np.arange(12) % 3 > 0)
    scene = STATICS["exact"]
    held, released = (stiffness(ARM, some, scene, "length", release=r) for r in (False, True))
    names = tuple(ARM.tendon_name(j) for j in range(0, 12, 3))
    assert held.slack == released.slack == names == ("T_11", "T_14", "T_23", "T_32")
    assert held.locked == tuple(range(12))
    assert "left slack (release=False locks them): T_11, T_14, T_23, T_32" in repr(released)
    assert "locked, though they could only pull: T_11, T_14, T_23, T_32" in repr(held)
    assert stiffness(ARM, some, scene, "length").locked == released.locked
    assert released.locked == tuple(np.flatnonzero(some).tolist())
    assert not released.tension_response[::3].any()
    assert held.tension_response[::3].any()
    softer = scaled(ARM, released.compliance - held.compliance)
    size = np.abs(scaled(ARM, held.compliance)).max()
    assert np.linalg.eigvalsh((softer + softer.T) / 2)[0] > -1e-9 * size
    assert softer.trace() > 0


def test_stiffness_is_the_inverse_of_compliance() -> None:
    k = stiffness(ARM, T, STATICS["paper"])
    size = sizes(ARM)
    product = (k.stiffness @ k.compliance) / size[:, None] * size
    assert np.allclose(product.T, np.eye(6), rtol=0, atol=1e-6)
