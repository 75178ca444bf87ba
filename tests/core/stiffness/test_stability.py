"""Arms and sections at no minimum of their energy are recognised, and only these."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.linalg import eigvals
from scipy.sparse.linalg import ArpackNoConvergence, eigs

from octoplan.model import Anchorage, Arm, Linear, Scene, SnapError, settle
from octoplan.model.effects import Buoyancy, Current, Extension, PointLoad, TipLoad, Weight
from octoplan.model.effects.base import Effect
from octoplan.model.equilibrium.linearised import Equilibrium
from octoplan.model.equilibrium.modes import stability, stability_slope
from octoplan.model.equilibrium.stability import is_stable, rest_stiffness
from octoplan.model.extensions.contact.effects import Contact
from octoplan.model.extensions.obstacles import Sphere
from octoplan.model.rod.discrete_rod import system
from octoplan.planner import stiffness
from tests.core.stiffness.cases import STATICS, with_effects

# Two tendons against each other, outside of the body, held by discs.
R, Y = 6e-3, 7.8e-3
ANTAGONISTS = Arm(
    0.3, Linear(R, R), (Anchorage(0.3, Linear(Y, Y), (0.0, np.pi)),), hull=Linear(9e-3, 9e-3)
)
EA = ANTAGONISTS.material.E * np.pi * R**2


@pytest.mark.parametrize("loaded", [False, True], ids=["unloaded", "loaded"])
@pytest.mark.parametrize(
    ("scene", "stretch"),
    [(name, x) for name in ("silicone", "anticlastic") for x in (0.9, 0.7, 0.65, 0.55)],
)
def test_swelling_that_takes_tendons_inwards_makes_the_straight_arm_unstable(
    scene: str, stretch: float, loaded: bool
) -> None:
    # E A / 3 (lambda - lambda^-2) = -2 T, and d(moment) / d(curvature) in the tendons' plane.
    pull = EA / 6 * (stretch**-2 - stretch)
    bending = EA * R**2 / 4 * (1 + 2 * stretch**-3) / (3 * stretch)
    bending -= (scene == "anticlastic") * pull * Y**2 / stretch**2
    effects = (TipLoad(),) if loaded else ()
    k = stiffness(ANTAGONISTS, [pull, pull], with_effects(STATICS[scene], *effects))
    assert 1 + k.shape.strain(0.1)[3] == pytest.approx(stretch, rel=1e-9)
    assert k.section(0.1)[1] == pytest.approx(bending, rel=1e-9)
    assert k.stable == (bending > 0)
    assert bending > 0 or (scene == "anticlastic" and stretch < 0.7)


@pytest.mark.parametrize(
    "effects",
    [
        (Extension(), Weight()),
        Scene.silicone(Weight()).effects,
        # The least stable modes of these arms are complex.
        pytest.param(
            Scene.silicone(
                Weight(), Buoyancy(), TipLoad((-0.02, 0.005, 0.01), follower=True)
            ).effects,
            marks=pytest.mark.slow,
        ),
        # Far bent: 24 settles of this arm take a minute.
        pytest.param(
            Scene.silicone(TipLoad((0.05, -0.2, 0.1), follower=True)).effects,
            marks=pytest.mark.slow,
        ),
    ],
)
def test_the_slope_of_stability_is_that_of_differences(effects: tuple[Effect, ...]) -> None:
    arm, scene, step = Arm.from_paper("table-4"), Scene(*effects), 1e-4
    T = np.array([0.1, 0.2, 0.01, 0.05, 0.1, 0.02, 0.3, 1.0, 0.02, 0.01, 0.5, 0.9])
    shape = settle(arm, T, scene, 1e-3)
    assert shape.collocated is not None
    value, slope = stability_slope(shape.collocated)
    assert value == pytest.approx(shape.stability, rel=1e-9)
    differences = [
        settle(arm, T + step * e, scene, 1e-3, near=shape).stability
        - settle(arm, T - step * e, scene, 1e-3, near=shape).stability
        for e in np.eye(T.size)
    ]
    np.testing.assert_allclose(slope, np.array(differences) / (2 * step), atol=1e-5)


def test_a_stability_beside_a_cluster_of_others_takes_no_eigenvalues_of_the_whole_matrix(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Nine eigenvalues were sought until all converged, eight of them in a cluster: minutes."""
    tries = list[int]()

    def counted(operator: Any, count: int, **options: Any) -> Any:
        tries.append(options["ncv"])
        values, modes = eigs(operator, count, **options)
        raise ArpackNoConvergence("two of them", values[:2], modes[:, :2])

    arm, scene = Arm.from_paper("table-4"), Scene.silicone(Current((0.0, 0.05, 0.0)))
    T = [0, 0.05, 0, 0.1, 0, 0, 0.3, 1.0, 0, 0, 0.5, 0.9]
    whole = settle(arm, T, scene, 1e-7).stability
    monkeypatch.setattr("octoplan.model.equilibrium.modes.eigs", counted)
    assert settle(arm, T, scene, 1e-7).stability == pytest.approx(whole, rel=1e-6)
    assert len(tries) == 1


def test_the_least_real_part_of_complex_eigenvalues_is_found() -> None:
    """The eigenvalue may not be among the nine nearest to 0: 0.793 was returned."""
    arm = Arm.from_paper("table-4")
    load = TipLoad((-0.02, 0.005, 0.01), follower=True)
    scene = Scene.silicone(Weight(), Buoyancy(), load)
    T = np.random.default_rng([9, 2]).uniform(size=12) * np.repeat([0.3, 2.5, 7.5], 4)
    point = settle(arm, T * (np.arange(12) % 3 == 0), scene, 1e-3).collocated
    assert point is not None
    of, (_, stiff) = point.system.layout, rest_stiffness(point.system)
    places, right = np.ravel(of.stages), np.zeros((of.n_states, stiff.size))
    right[places] = np.diag(stiff)
    values = 1 / np.linalg.eigvals(Equilibrium(point.system, point.x).solve(right)[places])
    assert stability(point) == pytest.approx(values.real.min(), rel=1e-6)


# A column, its second moment of area, Euler's load, and the critical weight per length: 7.8373 =
# (9/4) j^2 with the first zero j of the Bessel function of order -1/3.
COLUMN = Arm(0.3, Linear(R, R), (Anchorage(0.3, Linear(3e-3, 3e-3)),))
EJ, L = EA * R**2 / 4, COLUMN.length
EULER, GREENHILL = np.pi**2 * EJ / (4 * L**2), 7.837347438943 * EJ / L**3
SLACK = np.zeros(COLUMN.n_tendons)


def axial(share: float) -> TipLoad:
    """Return an axial load towards the base of the column, over Euler's load."""
    return TipLoad((-share * EULER, 0.0, 0.0))


def own_weight(share: float) -> Weight:
    """Return gravity towards the base of the column, over the critical gravity."""
    per_g = COLUMN.material.density * np.pi * R**2
    return Weight((-share * GREENHILL / per_g, 0.0, 0.0))


def straight(*effects: Effect) -> Equilibrium:
    """Return the straight column, which is in equilibrium under axial loads even if unstable."""
    here = system(COLUMN, Scene(*effects), 3, 4)
    x = here.x(SLACK, 1.0, here.initial_states(SLACK, np.zeros(here.layout.stages.shape), 1.0))
    return Equilibrium(here, x)


@pytest.mark.parametrize("load", [axial, own_weight], ids=["at the tip", "its own weight"])
@pytest.mark.parametrize("share", [0.1, 0.5, 0.9, 0.99])
def test_the_stability_of_a_column_is_what_is_left_of_its_buckling_load(
    share: float, load: Any
) -> None:
    shape = settle(COLUMN, SLACK, Scene(load(share)), 1e-8)
    assert shape.stability == pytest.approx(1 - share, abs=1e-6)
    assert stiffness(COLUMN, SLACK, Scene(load(share))).stable


@pytest.mark.quick("1.01-at the tip", "4.0-its own weight")
@pytest.mark.parametrize("load", [axial, own_weight], ids=["at the tip", "its own weight"])
@pytest.mark.parametrize("share", [1.01, 1.5, 4.0])
def test_beyond_that_the_straight_column_does_not_stand(share: float, load: Any) -> None:
    here = straight(load(share))
    assert np.abs(here.system.residual(here.x)).max() < 1e-15
    assert stability(here) == pytest.approx(1 - share, abs=1e-6)
    assert not is_stable(here)
    with pytest.raises(SnapError, match="buckles") as caught:
        settle(COLUMN, SLACK, Scene(load(share)))
    assert caught.value.load_factor == pytest.approx(1 / share, abs=1e-3)


@pytest.mark.parametrize("effects", [(), (TipLoad(),), (Extension(),)], ids=["bare", "0 N", "q"])
def test_at_rest_an_arm_is_as_stable_as_its_body(effects: tuple[Effect, ...]) -> None:
    for arm in (COLUMN, Arm.from_paper("table-4")):
        rest = settle(arm, np.zeros(arm.n_tendons), Scene(*effects))
        assert rest.stability == pytest.approx(1, abs=1e-9)


def test_pulling_at_the_tip_makes_a_column_no_less_stable_and_so_does_what_follows_it() -> None:
    assert settle(COLUMN, SLACK, Scene(axial(-0.5))).stability == pytest.approx(1, abs=1e-9)
    follower = TipLoad((-3 * EULER, 0.0, 0.0), follower=True)
    assert is_stable(straight(follower))


@pytest.mark.parametrize("follows", [0.0, 0.2, 0.4])
@pytest.mark.parametrize("share", [0.5, 0.95, 1.5])
def test_a_column_whose_load_follows_in_part_diverges_as_kordas_and_zyczkowski_have_it(
    follows: float, share: float
) -> None:
    # theta'' = -P / EJ (theta - follows theta(L)), theta(0) = theta'(L) = 0 (Archiwum Mechaniki
    # Stosowanej 15, 1963): divergence at P L^2 / EJ = arccos(-follows / (1 - follows))^2.
    critical = np.arccos(-follows / (1 - follows)) ** 2 * EJ / L**2
    dead, follower = ((-part * share * critical, 0.0, 0.0) for part in (1 - follows, follows))
    here = straight(PointLoad(L, dead), TipLoad(follower, follower=True))
    assert stability(here) == pytest.approx(1 - share, abs=1e-5)
    assert is_stable(here) == (share < 1)


@pytest.mark.quick("0.6-silicone")
@pytest.mark.parametrize("statics", ["exact", "silicone"])
@pytest.mark.parametrize("pull", [0.2, 0.6])
def test_stability_under_followers_is_the_least_real_part_of_differences(
    statics: str, pull: float
) -> None:
    # Some eigenvalues are complex; the reference uses a Jacobian by differences and all
    # eigenvalues. For the arm with linear laws eigenvalues magnify errors 1e13 times, as for a
    # Volterra operator: only one digit is significant.
    certain = {"exact": 0.2, "silicone": 1e-5}[statics]
    T = np.random.default_rng(2).uniform(0, pull, 12) * np.repeat([0.3, 1, 3], 4)
    follower = TipLoad((0.01, 0.02, -0.01), (0.0, 1e-4, 0.0), follower=True)
    scene = with_effects(STATICS[statics], follower, PointLoad(0.2, (0.0, 0.02, 0.0)))
    shape = settle(Arm.from_paper("table-4"), T, scene, 1e-4)
    here = shape.collocated
    assert here is not None
    of, steps = here.system.layout, 1e-7 * np.eye(here.x.size)[here.system.layout.n_before_states :]
    residual = here.system.residual
    J = [(residual(here.x + step) - residual(here.x - step)) / 2e-7 for step in steps]
    B = np.zeros(of.n_states)
    B[of.stages.ravel()] = rest_stiffness(here.system)[1]
    values = eigvals(np.column_stack(J), np.diag(B))
    finite = values[np.abs(values) < 1e6]
    assert shape.stability == pytest.approx(finite.real.min(), abs=certain)


def test_the_stability_of_an_arm_that_may_touch_something_is_the_least_of_several_below_0() -> None:
    # Beyond nine times Euler's load the second mode buckles too, at 1 - 12 / 9.
    far = Contact(Sphere((0.0, 1.0, 0.0), 0.1))
    for share in (0.5, 4.0, 12.0):
        assert stability(straight(axial(share), far)) == pytest.approx(1 - share, abs=1e-6)
        assert is_stable(straight(axial(share), far)) == (share < 1)
