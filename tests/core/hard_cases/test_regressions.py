"""Hard cases that failed once."""

from __future__ import annotations

import pickle

import numpy as np
import pytest

from octoplan.model import Anchorage, Arm, Linear, Scene, settle, settle_many
from octoplan.model.effects import Buoyancy, ExactTendons, Extension, Weight
from octoplan.model.extensions.friction import Friction
from octoplan.model.rod.discrete_rod import system
from octoplan.model.support.errors import CollapsedError, UnsettledSectionError
from tests.collocation import collocated
from tests.core.effects.bars import capstan, one_tendon
from tests.core.hard_cases.loads import check_rubbed

ARM = Arm.from_paper("table-4")
FETCH = np.zeros((3, 4))
FETCH[0, 2], FETCH[1, 0], FETCH[2, 1] = 0.5, 4.0, 13.0


@pytest.mark.parametrize("times", [1, 20, 1000])
@pytest.mark.parametrize("extension", [True, False], ids=["extension", "bending"])
def test_exact_tendons_settle_at_any_tension(times: float, extension: bool) -> None:
    scene = Scene(*[Extension()] * extension, ExactTendons())
    shape = settle(ARM, times * FETCH, scene, 1e-5)
    assert np.isfinite(shape.tip).all()
    assert shape.error <= 1e-5


@pytest.mark.slow
def test_a_shape_says_where_a_tendon_has_no_length_left() -> None:
    # 15, 120, 390 N settle, 5, 40, 130 N are refused: both are impossible, only one raised an
    # error.
    T = np.zeros((3, 4))
    T[0, 2], T[1, 0], T[2, 1] = 15, 120, 390
    # No mesh settles this arm to 1e-4: strains jump.
    shape = settle(ARM, T, Scene.silicone(), 1e-3)
    assert shape.folded is not None
    assert "no arm bends so far: at s = " in repr(shape)
    ordinary = settle(ARM, FETCH, Scene.silicone(), 1e-4)
    assert ordinary.folded is None
    assert "no length left" not in repr(ordinary)


ROLLED = [
    [[0.306, 0.335, 0.66, 0.343], [0.015, 4.82, 5.377, 0.075], [2.965, 0, 0, 2.958]],
    [[0.086, 0.237, 0.801, 0.582], [0.753, 3.466, 1.033, 3.309], [1.03, 8.818, 2.583, 15.02]],
    (5 * FETCH).tolist(),
]


@pytest.mark.quick("0.0001-one", "0.0001-another", "1e-06-a fetch", "0.0001-a fetch")
@pytest.mark.parametrize("T", ROLLED, ids=["one", "another", "a fetch"])
@pytest.mark.parametrize("accuracy", [1e-4, 1e-6])
def test_errors_of_arms_that_are_folded_are_true(T: list[list[float]], accuracy: float) -> None:
    """Strains have a kink at a tendon without length, but estimates assumed order six."""
    scene = Scene(Extension(), ExactTendons())
    shape, finest = settle(ARM, T, scene, accuracy), collocated(ARM, T, scene, 3, 192)
    assert shape.folded is not None
    assert np.linalg.norm(shape.tip - finest.tip) / ARM.length <= shape.error <= accuracy
    assert settle_many(ARM, [T, 0 * FETCH], scene, accuracy).tip[0] == pytest.approx(shape.tip)


def test_a_thousand_times_the_tension_of_silicone_is_settled_carefully() -> None:
    radius, anchorage = Linear(0.015, 0.008), Anchorage(0.3, Linear(0.01, 0.006), (0.3,))
    arm = Arm(0.3, radius, (anchorage,))
    shape = settle(arm, [3e3], Scene.silicone(), 1e-8)
    s = np.linspace(0, 0.3, 5)
    assert np.all(np.linalg.norm(shape.strain(s)[:, 1:3], axis=1) * (0.01 - 0.004 / 0.3 * s) < 2)
    many = settle_many(arm, [[0.1], [3e3]], Scene.silicone(), 1e-8)
    assert np.array_equal(many.tip[1], shape.tip)


def test_a_section_without_equilibrium_says_where() -> None:
    with pytest.raises(UnsettledSectionError, match=r"at s = 0\.\d+ m was found; lower") as caught:
        settle(ARM, 100 * FETCH, Scene.silicone())
    assert 0 < caught.value.s < ARM.length
    with pytest.raises(UnsettledSectionError, match=r"tensions\[1\]: no equilibrium"):
        settle_many(ARM, [0 * FETCH, 100 * FETCH], Scene.silicone())
    again = pickle.loads(pickle.dumps(caught.value))
    assert (str(again), again.s) == (str(caught.value), caught.value.s)


@pytest.mark.parametrize("place", [(1, 1), (1, 2)])
def test_loads_on_sections_without_a_tendons_length_are_not_followed_for_minutes(
    place: tuple[int, int], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Used to take thousands of load steps, each as long as a tendon is that has no length left."""
    steps, T = [], np.zeros((3, 4))
    T[place], T[2, 2] = 16.0, 20.0
    monkeypatch.setattr(
        "octoplan.model.equilibrium.continuation.report", lambda *said: steps.append(said)
    )
    with pytest.raises(UnsettledSectionError, match="lower the tensions that cross it"):
        settle(ARM, T, Scene.silicone(Weight(), Buoyancy(1000.0)))
    assert 0 < len(steps) < 100


def test_exact_tendons_that_leave_no_length_crush_the_arm() -> None:
    arm = Arm(0.3, Linear(0.01, 0.01), (Anchorage(0.3, Linear(5e-3, 5e-3)),))
    with pytest.raises(CollapsedError):
        settle(arm, np.full(4, 12.0), Scene(Extension(), ExactTendons()))


def test_a_tendon_that_crosses_the_midline_has_a_kink_in_its_tension_there() -> None:
    # The estimate ignored this place: an error of 1e-6 of the length at an accuracy of 1e-7.
    assert check_rubbed((0.012, 0.0119), (4.3e-3, -5.9e-3), 0.265, 1.42, 0.78, 1) < 1e-7


def test_a_mesh_before_one_that_failed_says_nothing_about_one_after_it() -> None:
    # Settled to 7 % of the length, with an estimate of 3e-6, as if the meshes 1 and 8 were near.
    member = ((0.012, 0.0067), (2.65e-3, 3.42e-3), 0.327, 0.43, 1.8, -1)
    shape = settle(one_tendon(*member[:3]), [0.43], Scene(Extension(), Friction(*member[4:])), 1e-5)
    x, y, *_ = capstan(*member)
    assert np.linalg.norm(shape.tip - [x, -y, 0]) < 1e-5 * 0.327


@pytest.mark.slow
def test_sections_where_the_energy_hardly_curves_are_settled() -> None:
    # Steps assumed at least a tenth of the stiffness at rest and were too short, for 5 % of these
    # sets.
    T = np.array([3.169, 0.369, 0, 1.748, 0, 0, 4.912, 0, 0, 4.127, 0.292, 0])
    rng = np.random.default_rng(0)
    sets = T + rng.uniform(-5e-4, 5e-4, (300, 12)) * (T > 0)
    at = system(ARM, Scene.silicone(), 3, 1, (0.43125, 0.440625), False).sections
    for pulls in sets:
        v = at.strains(pulls)
        wrench = at.balance(v, pulls[at.tendon]).wrench
        straight = at.balance([0.0, 0.0, 1.0] + 0 * v, pulls[at.tendon])
        assert np.all(np.abs(wrench) < 1e-6 * np.abs(straight.wrench).max(axis=0))
