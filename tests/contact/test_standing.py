"""Plans in contact have the requested stability, and keep away from snaps at edges."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.sparse.linalg import ArpackNoConvergence

from octoplan.model import Anchorage, Arm, Linear, Material, Scene, settle
from octoplan.model.effects import ExactTendons, Extension, TipLoad
from octoplan.model.extensions.contact.effects import Contact
from octoplan.model.extensions.obstacles import Sphere
from octoplan.planner import Plan, load_plan, plan
from octoplan.planner.extensions.contact import Hold
from octoplan.planner.targets import TipPosition
from tests.core.planner.cases import changed

ANGLES = (0.0, 2 * np.pi / 3, 4 * np.pi / 3)
ARM = Arm(
    0.3,
    Linear(0.012, 0.007),
    (
        Anchorage(0.3, Linear(0.0084, 0.0044), ANGLES),
        Anchorage(0.17, Linear(0.0084, 0.0084 - 0.004 * 0.17 / 0.3), ANGLES),
    ),
    Material(3e5, 0.45, 1080.0),
)
# A column under two thirds of its critical load, leaning on a ball.
SCENE = Scene(ExactTendons(), TipLoad((-0.05, 0, 0)), Contact(Sphere((0.2, -0.0365, 0), 0.025)))
T = np.array([0.0, 0.1, 0.0, 0.24, 0.0, 0.0])
ASKED = 0.305


@pytest.fixture(scope="module")
def plans() -> tuple[Plan, Plan]:
    """Return plans for a tip without and with a margin, with the arm on the ball."""
    target = TipPosition(tuple(settle(ARM, T, SCENE).tip.tolist()))
    clear = plan(ARM, target, SCENE, 20.0, starts=1, time_limit=1e-9)
    leaning = changed(clear, tensions=ARM.by_section(T))
    free, held = (
        plan(ARM, target, SCENE, 20.0, near=leaning, stability_margin=margin)
        for margin in (0.0, ASKED)
    )
    return free, held


@pytest.mark.slow
def test_a_margin_is_held_in_contact_and_costs_effort(plans: tuple[Plan, Plan]) -> None:
    free, held = plans
    assert free.reached
    assert free.certificate.stability < ASKED - 0.01
    assert held.reached, held.outcome
    assert held.shape.contacts
    assert held.certificate.stability == pytest.approx(ASKED, abs=1e-4)
    assert held.effort > free.effort * (1 + 1e-4)
    assert "stability, at its margin of 0.305" in "; ".join(held.holding())


@pytest.mark.slow
def test_no_tensions_nearby_cost_less_and_stand_as_well(plans: tuple[Plan, Plan]) -> None:
    """By differences of settled shapes: the gradient of effort is one of tip and stability."""
    held = plans[1]
    T, h = np.ravel(held.tensions), 1e-5
    pulls = np.flatnonzero(T > 1e-6)
    rows = []
    for j in pulls:
        ends = [
            settle(ARM, T + side * h * np.eye(T.size)[j], SCENE, 1e-10, near=held.shape)
            for side in (1, -1)
        ]
        moved = (ends[0].tip - ends[1].tip) / ARM.length / (2 * h)
        rows.append([*moved, (ends[0].stability - ends[1].stability) / (2 * h)])
    J = np.array(rows)
    lam, *_ = np.linalg.lstsq(J, T[pulls])
    assert J @ lam == pytest.approx(T[pulls], abs=1e-3 * np.abs(T).max())
    assert lam[3] > 0


def test_a_plan_with_a_margin_is_loaded_as_it_was_saved(
    plans: tuple[Plan, Plan], tmp_path: Path
) -> None:
    loaded = load_plan(plans[1].save(tmp_path / "plan.json"))
    assert loaded == plans[1]
    assert loaded.certificate == plans[1].certificate


@pytest.mark.slow
def test_a_hold_stays_off_the_edge_where_a_place_lets_go_and_the_arm_snaps() -> None:
    """The least effort was at zero force, but on a finer mesh the arm was unstable there."""
    arm, ball = Arm.from_paper("table-4"), Sphere((0.4075027, -0.0904322, 0.0460548), 0.0757196)
    wrench = (4.186256638e-05, 0.0014555021011, -0.0021133827302)
    scene = Scene(Contact(ball), ExactTendons(), Extension())
    found = plan(arm, Hold(ball, wrench, 0.42398548), scene, 2.7589)
    assert found.reached, found.outcome
    assert found.certificate.stability > 0.01
    assert found.effort < 0.101


@pytest.mark.parametrize("factor", [0.9, 0.98, 1.05])
def test_stability_of_an_arm_that_leans_is_the_same_by_the_whole_matrix(
    factor: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Reciprocals of contacts, 0 except for rounding, were reported as eigenvalues of -1e16."""

    def no_convergence(*_: object, **__: object) -> None:
        raise ArpackNoConvergence("", np.zeros(0), np.zeros(0))

    wanted = settle(ARM, factor * T, SCENE).stability
    monkeypatch.setattr("octoplan.model.equilibrium.modes.eigs", no_convergence)
    shape = settle(ARM, factor * T, SCENE)
    assert shape.contacts
    assert shape.stability == pytest.approx(wanted, rel=1e-6)
