"""Plans with base joints: equal to the best plan of a fixed base elsewhere, under any loads."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.optimize import minimize_scalar

from octoplan.model import Anchorage, Arm, Linear, Material, Scene, settle
from octoplan.model.effects import Buoyancy, Extension, TipLoad, Weight
from octoplan.model.extensions.contact import Contact
from octoplan.model.extensions.obstacles import Sphere
from octoplan.model.support.errors import FileError
from octoplan.planner import BaseJoints, Plan, load_plan, plan
from octoplan.planner.frontends.c_code.export import export_plan
from octoplan.planner.frontends.io.files import read_json, to_json
from octoplan.planner.frontends.io.scene_file import load_decoded, scene_table
from octoplan.planner.frontends.sweeps.sweep import sweep
from octoplan.planner.limits import natural_tensions
from octoplan.planner.plan import plan as make_plan
from octoplan.planner.targets import BendingPlane, TipPosition
from tests.refusals import Refused, check_refusal

# Two sections whose tendons are not evenly spaced: their effort depends on the rotation.
ARM = Arm(
    0.2,
    Linear(6e-3, 4e-3),
    (
        Anchorage(0.2, Linear(4e-3, 3e-3), (0.0, 1.9, 3.9)),
        Anchorage(0.1, Linear(4e-3, 4e-3), (0.5, 2.8, 4.4)),
    ),
    Material(E=2e5, nu=0.45, density=1100.0),
)
# A catheter with one tendon.
CATHETER = Arm(
    0.1,
    Linear(1.2e-3, 1.2e-3),
    (Anchorage(0.1, Linear(0.8e-3, 0.8e-3), (0.0,)),),
    Material(E=10e6, nu=0.45, density=1100.0),
)
PAPER = Scene(Extension())
TARGET = TipPosition((0.16, 0.05, -0.06))
TURNED = BaseJoints(rotation=(-np.pi, np.pi), weight=0.3)


def moved(arm: Arm, insertion: float = 0.0, rotation: float = 0.0) -> Arm:
    """Return the arm with its base moved by hand."""
    t, n, b = np.array(arm.base_frame).T
    c, s = np.cos(rotation), np.sin(rotation)
    frame = np.column_stack([t, c * n + s * b, c * b - s * n])
    place = np.array(arm.base_position) + insertion * t
    return replace(
        arm, base_frame=tuple(map(tuple, frame.tolist())), base_position=tuple(place.tolist())
    )


def cost(effort: float, weight: float, share: float, arm: Arm = ARM) -> float:
    """Return the documented objective of the norm "2"; `share` is insertion / L or turn / pi."""
    unit = natural_tensions(arm).max()
    return 0.5 * (effort / unit) ** 2 + 0.5 * weight * share**2


def best_fixed_base(name: str, around: float, weight: float, unit: float, scene: Scene) -> Any:
    """Return the best joint value near another, by plans of arms with a fixed base."""
    known: list[Plan] = []

    def total(x: float) -> float:
        arm = moved(ARM, **{name: x})
        known.append(plan(arm, TARGET, scene, 20.0, certify=False))
        return cost(known[-1].effort, weight, x / unit)

    window = (around - 0.05 * unit, around + 0.04 * unit)
    return minimize_scalar(total, bounds=window, method="bounded", options={"xatol": 1e-4 * unit})


@pytest.mark.parametrize(
    ("joints", "name", "unit"),
    [
        (BaseJoints(insertion=(-0.1, 0.1), weight=0.3), "insertion", ARM.length),
        pytest.param(TURNED, "rotation", np.pi, marks=pytest.mark.slow),
    ],
)
def test_joint_values_are_the_best_of_fixed_bases(
    joints: BaseJoints, name: str, unit: float
) -> None:
    p = plan(ARM, TARGET, PAPER, 20.0, base=joints)
    assert p.reached and p.certificate.optimal
    value = getattr(p.base, name)
    assert abs(value) > 0.01 * unit
    best = best_fixed_base(name, value, joints.weight, unit, PAPER)
    own = cost(p.effort, joints.weight, value / unit)
    assert own == pytest.approx(best.fun, rel=1e-6)
    assert value == pytest.approx(best.x, abs=1e-3 * unit)
    assert (
        np.linalg.norm(settle(moved(ARM, *p.base), p.tensions, PAPER).tip - TARGET.position) < 1e-6
    )


@pytest.mark.slow
def test_gravity_keeps_its_direction_when_the_base_turns() -> None:
    """The arm lies across gravity: the same tensions give another shape at another rotation."""
    scene = Scene(Extension(), Weight(), Buoyancy())
    p = plan(ARM, TARGET, scene, 20.0, base=TURNED)
    assert p.reached and abs(p.base.rotation) > 0.02
    tip = settle(moved(ARM, *p.base), p.tensions, scene, 1e-8).tip
    assert np.linalg.norm(tip - TARGET.position) < 1e-6 * ARM.length
    alone = plan(moved(ARM, *p.base), TARGET, scene, 20.0)
    assert p.effort == pytest.approx(alone.effort, rel=1e-6)
    for change in (-0.05, 0.05):
        rotation = p.base.rotation + change
        other = plan(moved(ARM, rotation=rotation), TARGET, scene, 20.0, certify=False)
        own = cost(p.effort, TURNED.weight, p.base.rotation / np.pi)
        assert own < cost(other.effort, TURNED.weight, rotation / np.pi)


def test_turning_a_hanging_arm_turns_its_shape() -> None:
    hanging = replace(ARM, base_frame=((0, -1, 0), (0, 0, 1), (-1, 0, 0)))
    scene = Scene(Extension(), Weight())
    angle = 0.7
    away = np.array([0.05, 0.03])
    first = plan(hanging, TipPosition((*away, -0.17)), scene, 20.0)
    # The tangent of the base points down: n turns towards b, clockwise as seen from above.
    t = np.array(hanging.base_frame)[:, 0]
    np.testing.assert_allclose(t, [0, 0, -1])
    c, s = np.cos(-angle), np.sin(-angle)
    turned = np.array([[c, -s], [s, c]]) @ away
    joints = BaseJoints(rotation=(angle, angle))
    second = plan(hanging, TipPosition((*turned, -0.17)), scene, 20.0, base=joints)
    assert second.reached and second.base.rotation == angle
    np.testing.assert_allclose(second.tensions, first.tensions, atol=1e-6 * first.effort)


def test_a_single_tendon_reaches_places_by_its_base() -> None:
    target = TipPosition((0.1, 0.02, 0.03))
    joints = BaseJoints(insertion=(0.0, 0.05), rotation=(-np.pi, np.pi))
    p = plan(CATHETER, target, PAPER, 20.0, base=joints)
    assert p.reached and p.mode == "exact"
    assert f"inserted by {1e3 * p.base.insertion:.3f}" in p.outcome
    # In the plane of the bend: n turns towards b, the tendon pulls towards n.
    n = np.array(moved(CATHETER, *p.base).base_frame)[:, 1]
    side = np.array(target.position) - p.shape.position(0.0)
    side -= np.array(CATHETER.base_frame)[:, 0] * (side @ np.array(CATHETER.base_frame)[:, 0])
    assert abs(n @ side) == pytest.approx(np.linalg.norm(side), rel=1e-6)
    without = plan(CATHETER, target, PAPER, 20.0)
    assert not without.reached


def test_active_limits_are_named_and_equal_a_fixed_base() -> None:
    joints = BaseJoints(insertion=(-0.005, 0.1), weight=0.0)
    p = plan(ARM, TARGET, PAPER, 20.0, base=joints)
    alone = plan(moved(ARM, -0.005), TARGET, PAPER, 20.0)
    assert p.reached and p.base.insertion == pytest.approx(-0.005, abs=1e-9)
    assert p.effort == pytest.approx(alone.effort, rel=1e-6)
    assert "inserted by -5 mm (its minimum)" in p.outcome
    assert any("insertion of the base at its minimum of -5 mm" in name for name in p.holding())
    assert "rotat" not in p.outcome


def test_missed_targets_name_the_joint_that_holds() -> None:
    joints = BaseJoints(insertion=(0.0, 0.02))
    p = plan(CATHETER, TipPosition((0.15, 0.0, 0.0)), PAPER, 5.0, base=joints)
    assert not p.reached and p.base.insertion == pytest.approx(0.02, abs=1e-6)
    assert "the insertion of the base at its maximum of 20 mm" in p.outcome
    assert "30 mm" in p.outcome


@pytest.mark.slow
@pytest.mark.parametrize("norm", ["1", "inf"])
def test_other_norms_weigh_the_joints_as_documented(norm: str) -> None:
    joints = BaseJoints(insertion=(-0.1, 0.1), weight=0.3)
    p = plan(ARM, TARGET, PAPER, 20.0, base=joints, norm=norm)
    assert p.reached and p.certificate.optimal
    unit = natural_tensions(ARM).max()

    def total(effort: float, insertion: float) -> float:
        return effort / unit + 0.15 * (insertion / ARM.length) ** 2

    for change in (-0.002, 0.002):
        insertion = p.base.insertion + change
        other = plan(moved(ARM, insertion), TARGET, PAPER, 20.0, norm=norm, certify=False)
        assert total(p.effort, p.base.insertion) < total(other.effort, insertion)


def test_planes_of_targets_do_not_turn_with_the_base() -> None:
    joints = BaseJoints(rotation=(-np.pi, np.pi), weight=0.0)
    target = BendingPlane(0.4, 0.8, section=1)
    p = plan(CATHETER, target, PAPER, 20.0, base=joints)
    assert p.reached
    t, n, b = np.array(CATHETER.base_frame).T
    tip = p.shape.tip - p.shape.position(0.0)
    wanted = np.cos(0.4) * b - np.sin(0.4) * n
    across = np.cross(t, wanted)
    assert abs(tip @ across) < 1e-6 and tip @ wanted > 0


def test_a_certificate_fails_for_other_joint_values() -> None:
    p = plan(ARM, TARGET, PAPER, 20.0, base=BaseJoints(insertion=(-0.1, 0.1)))
    for insertion in (p.base.insertion + 1e-5, -0.2):
        other = replace(p, solution=replace(p.solution, base=(insertion, 0.0)))
        assert not other.reached and "Not certified" in other.outcome
    assert "insertion limit violated" in other.outcome
    free = BaseJoints(insertion=(-0.3, 0.1))
    assert not replace(p, solution=replace(p.solution, base=(0.0, 1.0))).reached
    assert replace(p, problem=plan(ARM, TARGET, PAPER, 20.0, base=free).problem).reached


def test_plans_continue_from_a_plan_nearby() -> None:
    joints = BaseJoints(insertion=(-0.1, 0.1), rotation=(-np.pi, np.pi), weight=0.3)
    p = plan(ARM, TARGET, PAPER, 20.0, base=joints)
    target = TipPosition((0.161, 0.051, -0.059))
    near = plan(ARM, target, PAPER, 20.0, base=joints, near=p)
    fresh = plan(ARM, target, PAPER, 20.0, base=joints)
    assert len(near.solution.starts) == 1 < len(fresh.solution.starts)
    np.testing.assert_allclose(near.tensions, fresh.tensions, atol=1e-5 * fresh.effort)
    np.testing.assert_allclose(near.base, fresh.base, atol=1e-5)
    stiffer = p.co_contract(0.05)
    assert stiffer.reached and stiffer.tensions.min() >= 0.05 and stiffer.base is not None


def test_a_plan_continues_from_itself_at_a_base_far_from_home() -> None:
    arm = Arm.from_paper("table-4")
    target = TipPosition((0.122, 0.031, 0.103))
    joints = BaseJoints(insertion=(-0.1, 0.1), rotation=(-np.pi, np.pi))
    p = plan(arm, target, PAPER, 20.0, base=joints, certify=False)
    assert abs(p.base.insertion) > 0.02
    again = plan(arm, target, PAPER, 20.0, base=joints, near=p, certify=False)
    assert len(again.solution.starts) == 1
    np.testing.assert_allclose(again.base, p.base, atol=1e-7)


def test_saved_plans_and_scene_files_keep_the_joints(tmp_path: Path) -> None:
    joints = BaseJoints((0.0, 0.05), (-np.pi, np.pi), 0.5, insertion_rate=0.01, rotation_rate=1.5)
    p = plan(CATHETER, TipPosition((0.1, 0.02, 0.03)), PAPER, 20.0, base=joints)
    file = p.save(tmp_path / "plan.json")
    loaded = load_plan(file)
    assert loaded == p and loaded.certificate == p.certificate and loaded.base == p.base
    assert loaded.outcome == p.outcome
    record = read_json(file, "octoplan plan 1")
    assert record["base"] == {"insertion": p.base.insertion, "rotation": p.base.rotation}
    record["answer"]["base"] = [0.01]
    file.write_bytes(to_json(record))
    with pytest.raises(FileError, match=r"answer\.base"):
        load_plan(file)
    table = scene_table(CATHETER, PAPER, p.targets, tension_max=20.0, base=joints)
    assert table["base"]["rotation_deg"] == [-180.0, 180.0]
    question = load_decoded(table, "scene.toml")
    assert question.of(make_plan)["base"] == joints
    table["base"]["insertion_mm"] = [50.0, 0.0]
    with pytest.raises(FileError, match=r"base\.insertion"):
        load_decoded(table, "scene.toml")


@pytest.mark.slow
def test_sweeps_have_the_joint_values() -> None:
    joints = BaseJoints(insertion=(0.0, 0.05), rotation=(-np.pi, np.pi))
    target = TipPosition((0.1, 0.02, 0.03))
    data = sweep(
        CATHETER,
        axes={"target.position_mm[0]": [98.0, 102.0]},
        scene=PAPER,
        target=target,
        tension_max=20.0,
        base=joints,
        progress=False,
    )
    assert data.reached.all()
    assert float(data.insertion[1] - data.insertion[0]) == pytest.approx(0.004, rel=1e-6)
    assert float(np.ptp(data.rotation.values)) < 1e-6


BALL = Sphere((0.1, 0.1, 0.1), 0.01)
REFUSED: Refused = {
    "reversed insertion": (
        lambda: BaseJoints(insertion=(0.05, 0.0)),
        "BaseJoints.insertion",
        "low <= high",
    ),
    "reversed rotation": (lambda: BaseJoints(rotation=(1, -1)), "BaseJoints.rotation", "low"),
    "no joint": (BaseJoints, "BaseJoints", "an insertion"),
    "one limit": (lambda: BaseJoints(insertion=(0.1,)), "BaseJoints.insertion", ""),
    "infinite": (lambda: BaseJoints(insertion=(0, np.inf)), "BaseJoints.insertion", ""),
    "negative weight": (
        lambda: BaseJoints(insertion=(0, 0.1), weight=-1),
        "BaseJoints.weight",
        "",
    ),
    "heavy weight": (
        lambda: BaseJoints(insertion=(0, 0.1), weight=1e8),
        "BaseJoints.weight",
        "equal limits keep",
    ),
    "rate without joint": (
        lambda: BaseJoints(insertion=(0, 0.1), rotation_rate=1.0),
        "BaseJoints.rotation_rate",
        "None without rotation",
    ),
    "no rate": (
        lambda: BaseJoints(insertion=(0, 0.1), insertion_rate=0.0),
        "BaseJoints.insertion_rate",
        "",
    ),
    "far insertion": (
        lambda: plan(ARM, TARGET, base=BaseJoints(insertion=(0, 1e4))),
        "BaseJoints.insertion",
        "of 0",
    ),
    "no joints at all": (lambda: plan(ARM, TARGET, base=(0, 0.1)), "base", "BaseJoints"),
    "clearance from itself": (
        lambda: plan(ARM, TARGET, base=TURNED, self_clearance=True),
        "base",
        "self_clearance",
    ),
    "contact": (
        lambda: plan(ARM, TARGET, Scene(Extension(), Contact(BALL)), 20.0, base=TURNED),
        "base",
        "Contact",
    ),
}


@pytest.mark.parametrize("case", REFUSED)
def test_unsuitable_base_joints_are_refused_by_name(case: str) -> None:
    check_refusal(*REFUSED[case])


def test_exports_refuse_a_moving_base(tmp_path: Path) -> None:
    p = plan(ARM, TARGET, PAPER, 20.0, base=TURNED, certify=False)
    check_refusal(lambda: export_plan(p, tmp_path), "base", "fixed base")


@pytest.mark.slow
def test_dead_loads_stay_in_space() -> None:
    scene = Scene(Extension(), TipLoad(force=(0.0, 0.0, -0.01)))
    p = plan(ARM, TARGET, scene, 20.0, base=replace(TURNED, insertion=(-0.1, 0.1)))
    assert p.reached and p.certificate.optimal
    tip = settle(moved(ARM, *p.base), p.tensions, scene, 1e-8).tip
    assert np.linalg.norm(tip - TARGET.position) < 1e-6 * ARM.length


@pytest.mark.slow
def test_arms_with_base_joints_keep_clear_of_obstacles(tmp_path: Path) -> None:
    joints = BaseJoints((-0.05, 0.05), (-np.pi, np.pi), weight=0.3)
    free = plan(ARM, TARGET, PAPER, 20.0, base=joints)
    beside = free.shape.position(0.12) + np.array([0.0, -0.006, 0.004])
    ball = Sphere(tuple(beside), 0.008)
    around: dict[str, Any] = {"obstacles": [ball], "clearance": 0.002}
    p = plan(ARM, TARGET, PAPER, 20.0, base=joints, **around)
    assert p.reached and p.certificate.clearance >= 0.002 and p.solution.avoidance is not None
    # By hand: the distance of a thousand points of the settled arm.
    shape = settle(moved(ARM, *p.base), p.tensions, PAPER, 1e-8)
    s = np.linspace(0.0, ARM.length, 1001)
    gaps = np.linalg.norm(shape.position(s) - np.array(ball.center), axis=1) - ball.radius
    assert (gaps - ARM.outer_radius(s)[0]).min() > 0.002
    assert p.base.insertion != pytest.approx(free.base.insertion, abs=1e-4)
    fixed = plan(moved(ARM, *p.base), TARGET, PAPER, 20.0, **around)
    assert p.effort == pytest.approx(fixed.effort, rel=5e-3)
    assert load_plan(p.save(tmp_path / "plan.json")) == p
    near = plan(ARM, TipPosition((0.161, 0.05, -0.06)), PAPER, 20.0, base=joints, near=p, **around)
    assert near.reached and len(near.solution.starts) == 1


@pytest.mark.slow
def test_a_full_turn_has_no_end_that_holds() -> None:
    """The best rotation is near 2 pi, the guess without weight near 0."""
    soft = replace(CATHETER, material=Material(E=6e6, nu=0.45, density=1100.0))
    scene = Scene(Extension(), Weight())
    for rotation in (0.3, 5.98):
        known = settle(moved(soft, 0.02, rotation), [0.084], scene)
        joints = BaseJoints(insertion=(0.0, 0.05), rotation=(0.0, 2 * np.pi))
        p = plan(soft, TipPosition(tuple(known.tip)), scene, 3.0, base=joints)
        assert p.reached
        assert p.base.rotation == pytest.approx(rotation, abs=1e-4)


@pytest.mark.slow
def test_nearest_shapes_under_loads_are_the_best_of_fixed_bases() -> None:
    """The arm bends far under its weight: stable shapes are found by descents in small steps."""
    arm = replace(ARM, material=Material(E=1e5, nu=0.45, density=1100.0))
    scene = Scene(Extension(), Weight())
    target = TipPosition((0.27, 0.03, -0.08))

    def distance(p: Plan) -> float:
        return float(np.linalg.norm(p.tip - target.position))

    joints = BaseJoints(insertion=(0.0, 0.05), rotation=(-1.0, 1.0))
    p = plan(arm, target, scene, 0.5, base=joints, certify=False)
    assert p.mode == "nearest" and p.base.insertion == pytest.approx(0.05, abs=1e-6)
    scan = [
        distance(plan(moved(arm, 0.05, rotation), target, scene, 0.5, certify=False))
        for rotation in (p.base.rotation, 0.5, 0.0, -0.5)
    ]
    assert distance(p) <= 1.001 * min(scan)
    assert distance(p) == pytest.approx(scan[0], rel=1e-4)


@pytest.mark.slow
def test_refined_plans_keep_their_base_on_finer_meshes() -> None:
    """A step to a finer mesh starts at the joint values of the optimum, not at 0."""
    arm = Arm.from_paper("table-4")
    scene = Scene.silicone(Weight())
    target = TipPosition((0.5, 0.1, -0.2))
    joints = BaseJoints(insertion=(0.0, 0.2), rotation=(-np.pi, np.pi))
    p = plan(arm, target, scene, 20.0, base=joints, certify=False)
    assert p.base.insertion == pytest.approx(0.2, abs=1e-6)
    fixed = plan(moved(arm, *p.base), target, scene, 20.0, certify=False)
    gaps = [float(np.linalg.norm(each.tip - target.position)) for each in (p, fixed)]
    assert gaps[0] <= 1.01 * gaps[1]
