"""The live page: responses to the handle, drawing, and the page in a real browser."""

from __future__ import annotations

import socket
import threading
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from octoplan.model import Arm, InputError, Linear, Scene, settle
from octoplan.model.compliance import at_node
from octoplan.model.effects import Buoyancy, Extension, TipLoad, Weight
from octoplan.model.extensions.obstacles import Sphere
from octoplan.model.support.progress import OutOfTime, check_time
from octoplan.planner.frontends.cli import main
from octoplan.planner.frontends.live.handles import goal_of, handle_of
from octoplan.planner.frontends.live.page import Page
from octoplan.planner.frontends.live.session import Session
from octoplan.planner.frontends.live.words import following, places, planned, tendons
from octoplan.planner.targets import BendingPlane, TipPose, TipPosition
from octoplan.planner.targets.base import Target
from tests.oracles import Array

ARM = Arm.from_paper("table-4")
PAPER = Scene(Extension())
T = np.array([0, 0, 0.2, 0, 0, 0.4, 0, 0, 0, 0, 1.0, 0])
TIP = settle(ARM, T, PAPER).tip


def session(scene: Scene = PAPER, target: Target | None = None, **options: Any) -> Session:
    wanted = TipPosition(TIP) if target is None else target
    given = {"tension_max": 20.0, "starts": 4, **options}
    return Session(ARM, scene, handle_of(ARM, (wanted,)), given)


def moved(hand: Session, *by: float) -> Array:
    """Return the pose of a session's target moved by a vector [m]."""
    return hand.pose + np.array([0, 0, 0, 0, *by])


def brought(hand: Session) -> Session:
    """Return a session after a number of steps towards its target."""
    while hand.step():
        pass
    return hand


def test_the_arm_follows_before_there_is_a_plan_and_is_planned_once_it_rests() -> None:
    hand = brought(session(Scene.silicone(Weight(), Buoyancy())))
    assert hand.last is None
    assert hand.is_there
    shape = hand.shape
    assert shape is not None
    assert np.linalg.norm(shape.tip - TIP) <= 1e-3 * ARM.length
    found = hand.settled()
    assert found is not None
    assert found.certificate.passed
    assert hand.is_planned
    assert hand.shape is found.shape
    assert hand.settled() is found


@pytest.mark.quick("scene0")
@pytest.mark.parametrize("scene", [PAPER, Scene.silicone(Weight(), Buoyancy())])
def test_the_arm_is_dragged_to_where_the_plan_of_least_effort_is_as_well(scene: Scene) -> None:
    """The session ended in other shapes, of more effort, and leapt to the plan."""
    hand = brought(session(scene))
    hand.settled()
    hand.pose = moved(hand, -0.02, 0.04, 0.02)
    brought(hand)
    s = np.linspace(0.0, ARM.length, 20)
    before = hand.shape.position(s)  # type: ignore[union-attr]
    found = hand.settled()
    assert found is not None
    assert found.certificate.passed
    assert np.linalg.norm(found.shape.position(s) - before, axis=1).max() < 5e-3 * ARM.length


def test_the_arm_moves_on_while_it_catches_up_and_says_how_far_it_is() -> None:
    hand = brought(session())
    hand.pose = moved(hand, -0.05, 0.1, 0.0)
    assert hand.missed > 0.1
    assert "<b>Moving</b>, 112 mm to go." in following(hand, more=True)
    brought(hand)
    assert hand.missed <= 1e-3 * ARM.length
    assert "Target reached" in following(hand, more=False)


def test_out_of_reach_the_arm_goes_as_near_as_it_can_and_the_page_says_so() -> None:
    hand = brought(session(tension_max=0.5, starts=1))
    hand.pose = np.array([1.0, 0, 0, 0, 0.0, 0.35, 0.0])
    assert "Stopped" in following(brought(hand), more=False)
    found = hand.settled()
    assert found is not None
    assert found.mode != "exact"
    assert "at its maximum of 0.5 N" in planned(hand)


@pytest.mark.slow
def test_a_heavy_arm_goes_no_nearer_than_it_stands_and_the_page_says_so() -> None:
    """In air the session followed unstable shapes, and took half a minute."""
    heavy = session(Scene.silicone(Weight()), TipPosition((0.3, 0.15, -0.1)), tension_max=10.0)
    more, steps = True, 0
    while more and steps < 100:
        more, steps = heavy.step(), steps + 1
        assert heavy.shape is not None
        assert heavy.shape.stability > 0
    assert not more
    assert heavy.missed < 0.1 * ARM.length
    assert "becomes unstable if it moves closer" in following(heavy, more=False)


def test_effects_are_switched_and_contradictions_refused() -> None:
    hand = session(Scene(Extension(), TipLoad((0.0, 0.0, 1e-4))))
    hand.enabled[TipLoad((0.0, 0.0, 1e-4))] = False
    assert hand.scene == PAPER
    silicone = session(Scene.silicone())
    silicone.enabled[Extension()] = False
    with pytest.raises(InputError, match="NeoHookean"):
        silicone.step()


@pytest.mark.slow
def test_obstacles_are_switched_and_kept_clear_of() -> None:
    free = brought(session())
    through = free.settled()
    assert through is not None
    middle = through.shape.position(0.6 * ARM.length)
    ball = Sphere(tuple(middle + np.array([0.0, 0.01, 0.01])), 0.015)
    hand = brought(session(obstacles=[ball], clearance=0.001))
    for present in (True, False, True):
        hand.present[0] = present
        found = brought(hand).settled()
        assert found is not None
        assert found.certificate.passed
        if present:
            assert found.certificate.clearance >= 0.001
        else:
            assert found.effort == pytest.approx(through.effort, rel=1e-3)


def test_an_arm_with_discs_is_kept_clear_as_wide_as_these_are() -> None:
    """Only the body of the arm was drawn."""
    arm, s = replace(ARM, hull=Linear(0.03, 0.01)), np.linspace(0.0, ARM.length, 301)
    shape, at = settle(ARM, T, PAPER), 0.6 * ARM.length
    off = 0.015 + 0.003 + float(ARM.outer_radius(np.array([at]))[0][0])
    ball = Sphere(tuple(shape.position(at) + off * shape.frame(at)[:, 1]), 0.015)
    options = {"tension_max": 20.0, "obstacles": [ball], "clearance": 0.001}
    hand = brought(Session(arm, PAPER, handle_of(arm, (TipPosition(TIP),)), options))
    assert hand.shape is not None
    gap = (ball.distance(hand.shape.position(s)) - arm.outer_radius(s)[0]).min()
    assert gap > -0.003
    assert hand.is_there


@pytest.mark.quick("scene0-pose", "scene1-plane")
@pytest.mark.parametrize("kind", ["pose", "plane"])
@pytest.mark.parametrize("scene", [PAPER, Scene.silicone(Weight(), Buoyancy())])
def test_poses_and_planes_are_followed_too(kind: str, scene: Scene) -> None:
    there = settle(ARM, 0.5 * T, scene)
    frame = tuple(map(tuple, there.tip_frame.tolist()))
    target = TipPose(tuple(there.tip.tolist()), frame) if kind == "pose" else BendingPlane(2.4, 1.0)
    hand = session(scene, target)
    before = hand.goal.missed(settle(ARM, np.zeros(12), scene))
    brought(hand)
    assert hand.missed < 0.1 * before


@pytest.mark.parametrize("section", [1, 2, 3])
def test_a_bend_is_followed_by_the_tendons_that_its_target_lets_pull(section: int) -> None:
    """Tendons of all sections pulled, and the plan then released them."""
    hand = brought(session(PAPER, BendingPlane(2.0, 1.2, section)))
    assert hand.is_there
    assert hand.shape is not None
    others = np.delete(hand.shape.tensions, ARM.tendons_of(section))
    assert not others.any()
    result = hand.settled()
    assert result is not None
    assert result.reached
    assert np.linalg.norm(hand.shape.tensions - np.ravel(result.tensions)) < 1e-2 * result.effort


def test_derivatives_of_what_is_missed_are_those_of_differences() -> None:
    pose = TipPose((0.3, 0.1, -0.05), ((0.8, -0.6, 0.0), (0.6, 0.8, 0.0), (0.0, 0.0, 1.0)))
    for target in (pose, BendingPlane(2.0, 1.0, 2), TipPosition(TIP)):
        goal, shape = goal_of(ARM, target), settle(ARM, T + 0.1, PAPER, 1e-9)
        node = int(np.abs(shape.s - goal.s).argmin())
        found = goal.jacobian(shape, at_node(shape.equilibrium, node).pose_tension)
        for j in (0, 5, 11):
            off = np.zeros(12)
            off[j] = 1e-5
            ends = [goal.residual(settle(ARM, T + 0.1 + s * off, PAPER, 1e-9)) for s in (1, -1)]
            np.testing.assert_allclose(found[:, j], (ends[1] - ends[0]) / 2e-5, atol=1e-5)


def test_what_is_typed_is_what_is_read() -> None:
    pose = TipPose((0.3, 0.1, -0.05), ((0.8, -0.6, 0.0), (0.6, 0.8, 0.0), (0.0, 0.0, 1.0)))
    for target in (pose, BendingPlane(2.0, 1.0, 2), TipPosition(TIP)):
        handle = handle_of(ARM, (target,))
        for own in handle.numbers:
            shown = own.read(handle.start)
            again = own.write(handle.start, shown)
            assert own.read(again) == pytest.approx(shown)
            turned = handle.target(again).parameters(ARM)
            assert turned == pytest.approx(target.parameters(ARM), abs=1e-9)
            assert own.read(own.write(handle.start, shown + 1.0)) == pytest.approx(shown + 1.0)


def test_tendons_are_told_with_tension_and_stroke() -> None:
    hand = brought(session())
    shown = tendons(hand)
    assert shown.count(" N</td>") == shown.count(" mm</td>") == 12
    assert shown.count("at most") == int(hand.shape.slack.sum())  # type: ignore[union-attr]
    assert f"{1e3 * hand.shape.tip[1]:.1f}" in places(hand)  # type: ignore[union-attr]


def test_what_goes_wrong_once_ends_no_page_and_a_plan_is_cut_short_by_the_next_wish() -> None:
    pytest.importorskip("viser")
    hand, port = session(), free_port()
    steps, planned, cut = threading.Event(), threading.Event(), threading.Event()

    def step() -> bool:
        if steps.is_set():
            return False
        steps.set()
        raise RuntimeError("a step that fails")

    def settled() -> None:
        planned.set()
        try:
            while True:
                check_time()
        except OutOfTime:
            cut.set()
            raise

    hand.step, hand.settled = step, settled  # type: ignore[method-assign, assignment]
    page = Page(hand, "localhost", port)
    assert steps.wait(10)
    for told in (planned, cut):
        page.move()
        assert told.wait(10)
    page.end()
    assert not page._worker.is_alive()


def free_port() -> int:
    with socket.create_server(("localhost", 0)) as held:
        return int(held.getsockname()[1])


def test_a_port_in_use_and_a_scene_without_a_target_are_bad_input(
    tmp_path: Path, capsys: pytest.CaptureFixture
) -> None:
    pytest.importorskip("viser")
    scene = tmp_path / "scene.toml"
    text = "arm = { preset = 'table-4' }\n"
    scene.write_text(text)
    assert main(["live", str(scene)]) == 2
    assert "target" in capsys.readouterr().err
    scene.write_text(
        text + "[target]\ntype='tip-position'\nposition_mm=[250,0,-90]\n[limits]\ntension_max=9"
    )
    with socket.create_server(("localhost", 0)) as held:
        assert main(["live", str(scene), "--port", str(held.getsockname()[1])]) == 2
    assert "port" in capsys.readouterr().err
