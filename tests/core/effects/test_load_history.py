"""The order of loads and tensions: an arm is loaded first and pulled afterwards."""

from __future__ import annotations

import pickle
from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import brentq
from scipy.special import jv

from octoplan import (
    Anchorage,
    Arm,
    BendingPlane,
    Buoyancy,
    ExactTendons,
    Extension,
    InputError,
    Linear,
    Material,
    Scene,
    SnapError,
    TipLoad,
    TipPosition,
    Weight,
    plan,
    settle,
)
from octoplan.model.loads import SPATIAL, has_unique_equilibrium
from tests.core.effects.cases import Array
from tests.core.effects.chain import Chain

DOWN = ((0, -1, 0), (0, 0, 1), (-1, 0, 0))
UP = ((0, 1, 0), (0, 0, 1), (1, 0, 0))
HANGING = replace(Arm.from_paper("table-4"), base_frame=DOWN)
UPRIGHT = replace(Arm.from_paper("table-2"), base_frame=UP)
EXACT = Scene(Extension(), ExactTendons(), Weight())
SILICONE = Scene.silicone(Weight())
G, LINKS = 9.81, 60
# Two stable shapes of the arm of table 4 in air; the order of the loads selects the shape.
BISTABLE = [0, 0.01, 0, 0, 0.09, 0, 0, 0, 11.42, 0, 11.31, 6.86]


def sideways(tension: float) -> Array:
    """Return tensions of one tendon of the second section [N]."""
    tensions = np.zeros((3, 4))
    tensions[1, 1] = tension
    return tensions


@pytest.mark.parametrize("tension", [1.0, 2.0])
def test_hanging_arm_is_loaded_before_it_is_pulled(tension: float) -> None:
    arm, section = HANGING, HANGING.sections[1]
    s = (np.arange(LINKS) + 0.5) / LINKS * arm.length
    crossed = s < section.at
    y, slope = section.offset.evaluate(np.minimum(s, section.at), section.at)[:2]
    radius = arm.radius.evaluate(s, arm.length)[0]
    density = arm.material.density
    chain = Chain(radius, y * crossed, slope * crossed, arm.length, arm.material.E, density * G)
    side, down = chain.pulled(np.linspace(0, tension, 9)[1:])
    shape = settle(arm, sideways(tension), EXACT)
    assert shape.history == "loads first"
    assert shape.stability > 0.2
    assert shape.tip == pytest.approx([0, side, -down], abs=1e-3 * arm.length)


def test_hanging_arm_settles_as_on_its_branch() -> None:
    shape = settle(HANGING, sideways(2.5), SILICONE)
    near = settle(HANGING, sideways(2.5), SILICONE, near=settle(HANGING, sideways(2.25), SILICONE))
    assert shape.tip == pytest.approx(near.tip, abs=1e-6 * HANGING.length)
    assert shape.stability == pytest.approx(0.281, abs=1e-3)
    assert (shape.history, near.history) == ("loads first", "near")


def test_snap_names_the_history_that_failed() -> None:
    with pytest.raises(SnapError, match=r"under its loads, at 74.* % of the tensions") as error:
        settle(HANGING, sideways(4.0), SILICONE)
    assert error.value.history == "loads first"
    assert error.value.load_factor == 1
    copy = pickle.loads(pickle.dumps(error.value))
    assert str(copy) == str(error.value)
    assert copy.tension_factor == error.value.tension_factor


@pytest.mark.parametrize("limit", [4.0, 40.0])
def test_plan_of_a_hanging_arm_is_certified(limit: float) -> None:
    target = BendingPlane(0.0, np.radians(10.6557), section=2)
    p = plan(HANGING, target, SILICONE, tension_max=limit)
    assert p.reached, p.outcome
    assert p.shape.history == "loads first"
    # The drawn tensions, 2.5 N, meet the target; the plan is no dearer.
    assert p.effort <= 2.5 * (1 + 1e-4)


def test_upright_arm_needs_its_tendons_before_its_loads() -> None:
    heavy = Scene.silicone(Weight(g=(0, 0, -3.0)))
    with pytest.raises(SnapError, match="of them it buckles"):
        settle(UPRIGHT, np.zeros((3, 4)), heavy)
    shape = settle(UPRIGHT, np.full((3, 4), 1.0), heavy)
    assert shape.history == "tensions first"
    assert shape.stability > 0
    assert shape.tip[:2] == pytest.approx([0, 0], abs=1e-9)


def test_unstiffened_upright_arm_is_refused_in_both_orders() -> None:
    heavy = Scene.silicone(Weight(g=(0, 0, -30.0)))
    with pytest.raises(SnapError, match=r"without tension it buckles at .*, pulled first at") as e:
        settle(UPRIGHT, np.full((3, 4), 1e-3), heavy)
    assert e.value.history == "tensions first"


def test_loads_may_come_after_the_tensions() -> None:
    arm = Arm.from_paper("table-4")
    first = settle(arm, BISTABLE, EXACT)
    unloaded = settle(arm, BISTABLE, Scene(Extension(), ExactTendons()))
    later = settle(arm, BISTABLE, EXACT, near=unloaded)
    assert (first.history, later.history) == ("loads first", "near")
    assert min(first.stability, later.stability) > 0.1
    assert np.linalg.norm(first.tip - later.tip) > 0.3 * arm.length


def test_payload_is_picked_up_in_the_bent_shape() -> None:
    arm = Arm.from_paper("table-4")
    tensions = np.zeros((3, 4))
    tensions[0, 2], tensions[1, 0], tensions[2, 1] = 0.3, 2, 6
    water = Scene.silicone(Weight(), Buoyancy())

    def loaded(force: float) -> Scene:
        return water + TipLoad((0, 0, -force))

    bent = settle(arm, tensions, water)
    at_once = settle(arm, tensions, loaded(0.05), near=bent)
    slowly = bent
    for force in np.linspace(0, 0.05, 11)[1:]:
        slowly = settle(arm, tensions, loaded(float(force)), near=slowly)
    assert at_once.history == "near"
    assert at_once.tip == pytest.approx(slowly.tip, abs=2e-6 * arm.length)
    with pytest.raises(InputError, match="near"):
        settle(arm, tensions, water, near=at_once)


def test_far_tensions_are_reached_on_the_branch_of_near() -> None:
    begin = settle(HANGING, sideways(0.5), SILICONE)
    far = settle(HANGING, sideways(2.5), SILICONE, near=begin)
    assert far.history == "near"
    assert far.tip == pytest.approx(settle(HANGING, sideways(2.5), SILICONE).tip, abs=1e-6)


@pytest.mark.parametrize("tapered", [False, True])
def test_unique_equilibrium_below_the_load_of_a_column(tapered: bool) -> None:
    """The limit is the critical weight of a column (Greenhill 1881), and of a cone."""
    L, R, E = 0.3, 0.01, 1e5
    tip = 1e-3 * R if tapered else R
    # (x^4 v')' + q x^3 v = 0 for a cone, v'' + q x v = 0 for a cylinder, x from the tip.
    root = brentq(lambda z: jv(3, z), 5, 7.5) if tapered else brentq(lambda z: jv(-1 / 3, z), 1, 3)
    greatest = 3 / 4 * root**2 if tapered else 9 / 4 * root**2
    critical = greatest * E * R**2 / 4 / L**3
    section = Anchorage(L, Linear(0.5 * R, 0.5 * tip), (0.0,))
    for factor, is_unique in ((0.98, True), (1.01, False)):
        density = factor * critical / G / SPATIAL
        material = Material(E, 0.0, density)
        arm = Arm(L, Linear(R, tip), (section,), material)
        assert has_unique_equilibrium(arm, Scene(ExactTendons(), Weight())) is is_unique


def test_plan_takes_a_shape_that_the_arm_reaches_from_rest() -> None:
    """The cheapest shapes at this tip are stable, but the arm does not reach them from rest."""
    t = np.array([0.3347, -0.0268, -0.942]) / np.linalg.norm([0.3347, -0.0268, -0.942])
    across = np.cross(np.cross(t, [-0.8559, 0.4096, -0.3158]), t)
    n = across / np.linalg.norm(across)
    frame = np.column_stack([t, n, np.cross(t, n)]).tolist()
    arm = replace(Arm.from_paper("table-4"), base_frame=frame)
    scene = Scene.silicone(Weight(), Buoyancy(), TipLoad((0, 0, -0.03)))
    tensions = [0, 0.177, 0, 0, 0, 0, 1.12, 0, 3.689, 2.65, 2.781, 0]
    shape = settle(arm, tensions, scene)
    p = plan(arm, TipPosition(tuple(shape.tip)), scene, tension_max=5.5)
    assert p.reached, p.outcome
    assert p.effort < np.linalg.norm(tensions)
    assert settle(arm, p.tensions, scene).tip == pytest.approx(shape.tip, abs=2e-6 * arm.length)
