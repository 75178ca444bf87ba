"""Many sets settle as each does alone, compiled or not; a failed set is a row with its reason."""

from __future__ import annotations

import pickle
import shutil
import time
from typing import Any

import numpy as np
import pytest

import octoplan.model.extensions.batches as many_module
from octoplan.model import Anchorage, Arm, Linear, Material, Scene, settle, settle_many
from octoplan.model.effects import (
    Buoyancy,
    Current,
    ExactTendons,
    Extension,
    PointMass,
    Shear,
    TipLoad,
    Weight,
)
from octoplan.model.effects.base import Effect
from octoplan.model.equilibrium.collocation_map import CollocationMap
from octoplan.model.equilibrium.linearised import Equilibrium
from octoplan.model.extensions.contact.effects import Contact, SelfContact
from octoplan.model.extensions.obstacles import Sphere
from octoplan.model.forward import ForwardMaps, forward_maps
from octoplan.model.paths import Array
from octoplan.model.support.errors import (
    CollapsedError,
    ConvergenceError,
    InputError,
    OctoplanError,
    SnapError,
    TimeLimitError,
    UnsettledContactError,
    UnsettledSectionError,
)
from octoplan.model.support.progress import check_time
from octoplan.model.tendons import rest_lengths

needs_compiler = pytest.mark.skipif(shutil.which("cc") is None, reason="no C compiler")

WATER = (Weight(), Buoyancy(1000.0))
OFF_AXIS = PointMass(0.12, 0.004, (0.0, 0.006, 0.002))
STREAM = Current((0.1, 0.0, 0.05), density=1000.0, coefficient=1.1)
LOADED = {
    "silicone, a mass off the axis": Scene.silicone(*WATER, OFF_AXIS),
    "the paper's tendons in a stream": Scene(Extension(), *WATER, STREAM),
}


def sets(count: int, seed: int) -> Array:
    """Return tensions (count, 12) that bend and roll up the arm of table 4."""
    rng = np.random.default_rng(seed)
    return rng.uniform(0, 0.5, (count, 12)) * np.repeat([0.3, 2.0, 6.0], 4)


@needs_compiler
@pytest.mark.quick("the paper's tendons in a stream")
@pytest.mark.parametrize("name", LOADED)
def test_many_sets_under_loads_are_those_settled_alone(name: str) -> None:
    arm, scene, T = Arm.from_paper("table-4"), LOADED[name], sets(5, 3)
    many = settle_many(arm, T, scene, compile=True)
    for i, row in enumerate(T):
        alone = settle(arm, row, scene)
        assert many.tip[i] == pytest.approx(alone.tip, abs=1e-11)
        assert many.tip_frame[i] == pytest.approx(alone.tip_frame, abs=1e-10)
        assert many.error[i] == pytest.approx(alone.error, rel=1e-2, abs=1e-11)


BALL = Contact(Sphere((0.2, -0.05, 0.0), 0.032))


@pytest.mark.parametrize("effect", [BALL, SelfContact()], ids=lambda each: type(each).__name__)
def test_sets_in_contact_are_those_settled_alone(effect: Effect) -> None:
    scene, T = Scene(Extension(), ExactTendons(), effect), np.zeros((2, 4))
    T[1, 0] = 0.3
    many = settle_many(SHORT, T, scene, 1e-4)
    alone = [settle(SHORT, row, scene, 1e-4) for row in T]
    assert np.array_equal(many.tip, [shape.tip for shape in alone])
    assert [len(shape.contacts) > 0 for shape in alone] == [False, effect is BALL]


@pytest.mark.slow
@needs_compiler
def test_what_buckles_is_refused_as_it_is_alone() -> None:
    arm, scene = Arm.from_paper("section-5.2"), Scene(TipLoad((-0.5, 0.0, 0.0)))
    T = np.zeros((3, arm.n_tendons))
    T[[0, 2], 1] = 0.3
    with pytest.raises(SnapError) as refused:
        settle(arm, T[1], scene)
    many = settle_many(arm, T, scene, compile=True, errors="nan")
    assert many.problems == ("", f"tensions[1]: {refused.value}", "")
    assert np.isnan(many.tip).all(axis=1).tolist() == [False, True, False]


ARM, SHORT = Arm.from_paper("table-4"), Arm.from_paper("section-5.2")
GOOD = np.array([[0, 0, 0.3, 0, 1.0, 0, 0, 0, 0, 2.0, 0, 0], [0.1] * 12, [0.0] * 12])
CRUSHING = np.full(12, 1e3)
WITH_ERRORS = [
    Scene(Extension()),
    Scene(Extension(), ExactTendons()),
    Scene.silicone(),
    Scene(Extension(), Weight(), Buoyancy()),
]


def check(arm: Arm, scene: Scene, sets: Any, bad: dict[int, str]) -> None:
    """Check that failed rows are NaN with a reason, and other rows as if settled alone."""
    many = settle_many(arm, sets, scene, 1e-5, errors="nan")
    good = [i for i in range(len(sets)) if i not in bad]
    alone = settle_many(arm, [sets[i] for i in good], scene, 1e-5)
    assert many.tip[good] == pytest.approx(alone.tip, abs=1e-12)
    assert many.tip_frame[good] == pytest.approx(alone.tip_frame, abs=1e-12)
    assert alone.problems == ("",) * len(good)
    assert not np.isnan(many.error[good]).any()
    for i, told in bad.items():
        assert told in many.problems[i]
        assert np.isnan(many.tip[i]).all() and np.isnan(many.tip_frame[i]).all()
        assert np.isnan(many.error[i]) and np.isnan(many.tensions[i]).all()
    assert [i for i, told in enumerate(many.problems) if told] == sorted(bad)


@pytest.mark.parametrize("scene", WITH_ERRORS, ids=lambda scene: f"{len(scene.effects)} effects")
def test_bad_rows_do_not_lose_the_others(scene: Scene) -> None:
    sets = [GOOD[0], CRUSHING, GOOD[1], [1.0, 2.0], GOOD[2], -GOOD[0]]
    bad = {3: "tensions[3] = ", 5: "tensions[5]"}
    # A neo-Hookean body is not crushed by any tension.
    crushed = {} if scene == Scene.silicone() else {1: "the arm"}
    check(ARM, scene, sets, bad | crushed)


def test_the_given_array_stays_as_it_was() -> None:
    sets = np.array([GOOD[0], CRUSHING])
    before = sets.copy()
    many = settle_many(ARM, sets, Scene(Extension()), 1e-5, errors="nan")
    assert "tensions[1]: the arm is crushed" in many.problems[1]
    assert np.array_equal(sets, before)


def test_sets_of_lengths_too() -> None:
    scene = Scene(Extension(), ExactTendons())
    rest = rest_lengths(ARM)
    sets = [rest - 1e-3, rest * np.nan, rest]
    many = settle_many(ARM, None, scene, 1e-5, lengths=sets, errors="nan")
    assert many.problems[0] == many.problems[2] == ""
    assert "lengths[1]" in many.problems[1]
    assert np.isnan(many.tip[1]).all() and np.isfinite(many.tip[[0, 2]]).all()


# An arm of three straight tendons and one of 1.5 turns.
HELICAL = Arm(
    0.2,
    Linear(3e-3, 3e-3),
    (
        Anchorage(
            0.2,
            Linear(8e-3, 8e-3),
            (1.571, -0.524, -2.618, -2.618),
            turn=(*[Linear(0.0, 0.0)] * 3, Linear(0.0, -9.425)),
        ),
    ),
    Material(E=1.1e6, nu=0.3, density=1000.0),
    base_frame=((0, 1, 0), (0, 0, 1), (1, 0, 0)),
    hull=Linear(0.015, 0.015),
)
SHEARED = Scene(Extension(), ExactTendons(), Shear())
# Tensions at which strains of the arm of table 4 jump near its tip.
JUMPING = np.array([1.97, 1.92, 0.01, 0.16, 1.36, 0.44, 1.33, 0.42, 0.79, 0.65, 0.49, 1.55])
HISTORIES = {
    "helical tendons": (
        HELICAL,
        SHEARED,
        [[0.043, 0.09, 0.003, 0.091], [0.066, 0.046, 0.093, 0.123]],
        "",
    ),
    "strains that jump": (
        ARM,
        Scene.silicone(Weight(), Buoyancy()),
        [0.95 * JUMPING, 1.2 * JUMPING],
        "tensions[0]: the arm was settled to 0.0",
    ),
}


@pytest.mark.parametrize("name", HISTORIES)
def test_each_set_has_meshes_of_its_own(name: str, caplog: pytest.LogCaptureFixture) -> None:
    arm, scene, T, refused = HISTORIES[name]
    many = settle_many(arm, T, scene, errors="nan")
    assert not caplog.records  # no batch was divided for an error
    assert many.problems[0].startswith(refused)
    for i, row in enumerate(T):
        if not many.problems[i]:
            assert many.tip[i] == pytest.approx(settle(arm, row, scene).tip, abs=1e-11)
    assert [i for i, text in enumerate(many.problems) if text] == [0] * bool(refused)


def test_guesses_may_come_from_different_meshes() -> None:
    maps = forward_maps(ARM, Scene(Extension(), Weight()), False)
    T = np.array([0.1 * JUMPING, 0.2 * JUMPING, 0.3 * JUMPING])
    near = [maps.on(1).solve(T[0]), None, maps.on(2).solve(T[2])]
    ends = maps.on(3).many(T, near)
    for row, end in zip(T, ends, strict=True):
        assert isinstance(end, Equilibrium)
        assert end.poses[-1] == pytest.approx(maps.on(3).solve(row).poses[-1], abs=1e-10)


def test_strains_that_jump_are_refused_on_a_coarse_mesh() -> None:
    scene = Scene.silicone(Weight(), Buoyancy())
    finest = []
    with pytest.MonkeyPatch.context() as patch:
        on = ForwardMaps.on
        patch.setattr(
            ForwardMaps, "on", lambda self, mesh, *at: finest.append(mesh) or on(self, mesh, *at)
        )
        with pytest.raises(ConvergenceError, match=r"its strains jump at s = 0\.44"):
            settle(ARM, 0.95 * JUMPING, scene)
    assert max(finest) <= 64


@pytest.mark.parametrize("scene", [Scene(Extension()), Scene(Extension(), Weight())])
def test_an_unforeseen_error_is_that_of_its_set(scene: Scene) -> None:
    T = np.outer([0.01, 0.02, 0.03], np.ones(12))

    def alone(arm: Arm, tensions: Array, *_: Any, **__: Any) -> Any:
        if tensions[0] == 0.02:
            raise ZeroDivisionError("float division by zero")
        return settle(arm, tensions, scene)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(many_module, "settle", alone)
        patch.setattr(many_module, "_side_by_side", lambda maps, T, accuracy: alone(maps.arm, T[1]))
        many = settle_many(ARM, T, scene, errors="nan")
        assert many.problems == ("", "ZeroDivisionError: float division by zero", "")
        assert np.isnan(many.tip).all(axis=1).tolist() == [False, True, False]
        with pytest.raises(ZeroDivisionError) as raised:
            settle_many(ARM, T, scene)
    assert raised.value.__notes__ == ["the failed set is tensions[1]"]


def test_a_slow_set_does_not_hold_up_the_others() -> None:
    slow = 1.3
    with pytest.MonkeyPatch.context() as patch:
        many_of = CollocationMap.many

        def many(self: CollocationMap, tensions: Array, *more: Any) -> Any:
            while (tensions[:, 0] == slow).any():
                time.sleep(0.01)
                check_time()
            return many_of(self, tensions, *more)

        patch.setattr(CollocationMap, "many", many)
        T = np.outer(np.linspace(0.1, 0.2, 40), JUMPING)
        T[17, 0] = slow
        found = settle_many(ARM, T, Scene(Extension(), Weight()), errors="nan", time_limit=1.0)
        lost = [i for i, text in enumerate(found.problems) if text]
        assert lost == [17]
        assert found.problems[17].startswith("tensions[17]: nothing was found within the time")
        with pytest.raises(TimeLimitError, match=r"tensions\[1\]"):
            settle_many(ARM, T[16:18], Scene(Extension(), Weight()), time_limit=1.0)


def test_a_time_limit_holds_in_contact_and_by_lengths() -> None:
    contact = Scene(Extension(), ExactTendons(), BALL)
    many = settle_many(SHORT, np.full((2, 4), 0.3), contact, errors="nan", time_limit=1e-6)
    assert all("within the time limit" in text for text in many.problems)
    rest = rest_lengths(SHORT)
    exact = Scene(Extension(), ExactTendons())
    many = settle_many(SHORT, None, exact, lengths=[rest - 1e-3], errors="nan", time_limit=1e-6)
    assert "lengths[0]: nothing was found within the time limit" in many.problems[0]
    with pytest.raises(InputError, match="time_limit"):
        settle_many(SHORT, np.zeros((2, 4)), exact, errors="nan", time_limit=0.0)


REFUSALS = [
    SnapError(0.5, "it buckles"),
    CollapsedError(0.1, -0.2),
    UnsettledSectionError(0.1),
    ConvergenceError(1e-6, 1e-3, "ask for less accuracy"),
    TimeLimitError(2.0),
    UnsettledContactError(0.5, "nothing is found"),
]


@pytest.mark.parametrize("error", REFUSALS, ids=lambda error: type(error).__name__)
def test_errors_name_their_set_and_pickle(error: OctoplanError) -> None:
    named = error.of_set("tensions[3]")
    again = pickle.loads(pickle.dumps(named))
    assert type(again) is type(error)
    assert str(again) == str(named) == f"tensions[3]: {error}"
    assert {**vars(again)} == {**vars(error), "which": "tensions[3]"}
