"""Derivatives by the implicit function theorem against differences of settled shapes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import product

import numpy as np
import pytest

from octoplan.model import Arm, Scene, Shape, settle
from octoplan.model.compliance import compliance_of, sensitivities
from octoplan.model.effects import Current, Extension, PointLoad, Shear, TipLoad, Weight
from octoplan.planner import stiffness
from tests.core.stiffness.cases import (
    IN_WATER,
    STATICS,
    Array,
    gap,
    moved,
    pulling,
    pushed,
    with_effects,
)
from tests.differences import fourth_order

# Steps move the tip by some 2e-3 L; four points leave (2e-3)^4 of truncation and the settled
# accuracy over the step, 1e-8, of rounding.
STEP, SETTLED, WANTED = 2e-3, 1e-11, 1e-7
TENDON_EA = 5.0


@dataclass(frozen=True)
class Case:
    """A settled shape and the quantity that its tendons hold."""

    arm: str
    statics: str
    hold: str
    heavy: bool
    seed: int = 0

    @property
    def scene(self) -> Scene:
        return with_effects(STATICS[self.statics], *(IN_WATER if self.heavy else ()))

    def __str__(self) -> str:
        weight = " in water" if self.heavy else ""
        return f"{self.arm} {self.statics}{weight} {self.hold} {self.seed}"


ALL = [
    Case(arm, statics, hold, heavy)
    for hold, heavy, statics, arm in product(
        ("tension", "length"), (False, True), STATICS, ("table-2", "table-4")
    )
]
MORE = [Case(c.arm, c.statics, c.hold, c.heavy, 1) for c in ALL[::4]]
FEW = [
    Case("table-2", "bare", "tension", False),
    Case("table-4", "paper", "tension", False),
    Case("table-2", "exact", "tension", False),
    Case("table-4", "silicone", "tension", False),
    Case("table-2", "paper", "tension", True),
    Case("table-4", "paper", "length", False),
    Case("table-2", "exact", "length", False),
    Case("table-2", "bare", "length", True),
]


def wrenches(arm: Arm, compliance: Array, count: int, seed: int) -> list[Array]:
    """Random forces and moments, each of which moves the tip by STEP."""
    size = np.repeat([arm.length, 1.0], 3)
    found = []
    for raw in np.random.default_rng(seed).normal(size=(count, 6)):
        wrench = raw * size / arm.length
        found.append(wrench * STEP / np.linalg.norm((compliance @ wrench) / size))
    return found


def with_lengths_held(
    start: Shape, scene: Scene, length_tension: Array, hint: Array
) -> tuple[Shape, Array]:
    """The shape in a scene whose tendons, as stretchy as TENDON_EA, run from locked motors."""
    unstretched = start.tendon_lengths / (1 + start.tensions / TENDON_EA)
    give = unstretched / TENDON_EA
    matrix = length_tension - np.diag(give)
    T = start.tensions + hint
    for _ in range(12):
        shape = settle(start.arm, T, scene, SETTLED)
        left = shape.tendon_lengths - start.tendon_lengths - give * (T - start.tensions)
        if np.abs(left).max() < 1e-11 * start.arm.length:
            return shape, T
        T = T - np.linalg.solve(matrix, left)
    raise AssertionError(f"lengths are off by {np.abs(left).max():.1e} m")


def check(case: Case, count: int, deviation: Callable[..., float]) -> None:
    """Assert that random wrenches move the tip according to the compliance."""
    arm, T = Arm.from_paper(case.arm), pulling(case.arm, case.seed)
    EA = TENDON_EA if case.hold == "length" else None
    k = stiffness(arm, T, case.scene, case.hold, accuracy=1e-8, tendon_EA=EA)
    start = settle(arm, T, case.scene, SETTLED)
    size = np.repeat([arm.length, 1.0], 3)
    for wrench in wrenches(arm, k.compliance, count, case.seed):

        def at(share: float, wrench: Array = wrench) -> Array:
            scene = pushed(case.scene, share * wrench)
            if case.hold == "tension":
                return moved(start, settle(arm, T, scene, SETTLED), arm.length)
            hint = share * k.tension_response @ wrench
            shape, pulls = with_lengths_held(start, scene, k.length_tension, hint)
            return np.concatenate([moved(start, shape, arm.length), pulls - T])

        found = fourth_order(at, 1.0)
        assert deviation(gap(found[:6], k.compliance @ wrench / size), 0.0) < WANTED
        if case.hold == "length":
            assert deviation(gap(found[6:], k.tension_response @ wrench), 0.0) < WANTED


@pytest.mark.quick(
    "table-4 silicone tension 0", "table-2 paper in water tension 0", "table-2 exact length 0"
)
@pytest.mark.parametrize("case", FEW, ids=str)
def test_the_compliance_is_the_slope_of_settled_shapes(
    case: Case, deviation: Callable[..., float]
) -> None:
    check(case, 1, deviation)


@pytest.mark.slow
@pytest.mark.parametrize("case", [*ALL, *MORE], ids=str)
def test_the_compliance_is_the_slope_of_fifty_settled_shapes(
    case: Case, deviation: Callable[..., float]
) -> None:
    check(case, 2, deviation)


LOADED = {
    "tip load": (TipLoad((4e-4, 2e-4, -3e-4), (1e-5, -2e-5, 1e-5)),),
    "point load": (PointLoad(0.2, (1e-3, -1e-3, 2e-3)),),
    "current": (Current((0.0, 0.03, 0.05)),),
    "shear": (Shear(),),
}


@pytest.mark.quick("tip load", "current")
@pytest.mark.parametrize("effects", LOADED.values(), ids=LOADED)
def test_further_loads_are_in_the_slope(effects: tuple[object, ...]) -> None:
    arm, T = Arm.from_paper("table-2"), pulling("table-2", 3)
    scene = with_effects(STATICS["paper"], *effects)
    k = stiffness(arm, T, scene, accuracy=1e-8)
    start = settle(arm, T, scene, SETTLED)
    (wrench,) = wrenches(arm, k.compliance, 1, 3)
    found = fourth_order(
        lambda share: moved(
            start, settle(arm, T, pushed(scene, share * wrench), SETTLED), arm.length
        ),
        1.0,
    )
    assert gap(found, k.compliance @ wrench / np.repeat([arm.length, 1.0], 3)) < WANTED


SOON = [*((statics, False) for statics in STATICS), ("paper", True)]
LATER = [(statics, True) for statics in STATICS if statics != "paper"]


@pytest.mark.quick("bare", "exact", "paper in water")
@pytest.mark.parametrize(
    ("statics", "heavy"),
    [*SOON, *(pytest.param(*case, marks=pytest.mark.slow) for case in LATER)],
    ids=[f"{statics}{' in water' if heavy else ''}" for statics, heavy in SOON + LATER],
)
def test_poses_and_lengths_per_tension_are_jacobian_of_settled_shapes(
    statics: str, heavy: bool
) -> None:
    arm, T = Arm.from_paper("table-4"), pulling("table-4", 5)
    scene = with_effects(STATICS[statics], *(IN_WATER if heavy else ()))
    k = stiffness(arm, T, scene, "length", accuracy=1e-8)
    start = settle(arm, T, scene, SETTLED)
    size = np.repeat([arm.length, 1.0], 3)
    change = np.random.default_rng(5).normal(size=12) * T
    change *= STEP / np.linalg.norm(k.pose_tension @ change / size)

    def at(share: float) -> Array:
        shape = settle(arm, T + share * change, scene, SETTLED)
        return np.concatenate([moved(start, shape, arm.length), shape.tendon_lengths])

    found = fourth_order(at, 1.0)
    assert gap(found[:6], k.pose_tension @ change / size) < WANTED
    assert gap(found[6:], k.length_tension @ change) < WANTED


@pytest.mark.quick("near the tip")
@pytest.mark.parametrize(
    ("share", "heavy"),
    [(0.2, False), (0.55, True), (0.9, False)],
    ids=["near the base", "in the middle, in water", "near the tip"],
)
def test_a_force_on_the_way_moves_and_turns_the_midline_there(share: float, heavy: bool) -> None:
    arm, T = Arm.from_paper("table-4"), pulling("table-4", 7)
    scene, at = with_effects(STATICS["paper"], *(IN_WATER if heavy else ())), share * arm.length
    k = stiffness(arm, T, scene, at=at, accuracy=1e-8)
    start = settle(arm, T, scene, SETTLED)
    size = np.repeat([arm.length, 1.0], 3)
    force = np.random.default_rng(7).normal(size=3)
    force *= STEP / np.linalg.norm(k.compliance[:, :3] @ force / size)

    def there(part: float) -> Array:
        load = PointLoad(at, tuple((part * force).tolist()))
        return moved(start, settle(arm, T, with_effects(scene, load), SETTLED), at)

    assert gap(fourth_order(there, 1.0), k.compliance[:, :3] @ force / size) < WANTED


@pytest.mark.parametrize("accuracy", [1e-5, 1e-6])
def test_a_stream_along_the_arm_somewhere_does_not_hide_errors(accuracy: float) -> None:
    """Derivatives of |v_n| v_n have a kink: errors fell by 4, but estimates assumed 64."""
    arm, T = Arm.from_paper("table-2"), np.zeros(12)
    T[5] = 0.6
    flow = settle(arm, T, Scene(Extension())).frame(0.5 * arm.length)[:, 0]
    scene = Scene(Extension(), Current(tuple((0.2 * flow).tolist())))
    shape = settle(arm, T, scene, 1e-9)
    assert_error_is_told(shape, accuracy)


def test_an_accurate_equilibrium_does_not_hide_errors_of_its_derivatives() -> None:
    """Derivatives at the initial guess of Newton's method had larger errors than stated."""
    arm, scene = Arm.from_paper("table-2"), Scene.silicone(Weight())
    T = [[0.09, 0, 0, 0], [0, 0, 1.81, 0.15], [0, 0.49, 0, 0]]
    assert_error_is_told(settle(arm, T, scene, 1e-9), 1e-9)


def assert_error_is_told(shape: Shape, accuracy: float) -> None:
    size = np.repeat([shape.arm.length, 1.0], 3)
    result, _, error = compliance_of(shape, shape.arm.length, accuracy)
    finest = sensitivities(shape, shape.arm.length, 128)
    found, wanted = (each.pose_wrench / np.outer(size, size) for each in (result, finest))
    largest = np.abs(wanted).max()
    assert np.abs(found - wanted).max() <= error * largest <= accuracy * largest
