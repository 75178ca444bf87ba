"""Loads from a tenth to 300 times the load that bends the arm by 60 degrees, against SciPy."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_bvp

from octoplan.model import Arm, Scene, Shape, settle
from octoplan.model.effects import ExactTendons, Extension, TipLoad
from octoplan.model.effects.base import Effect
from tests.core.effects.spatial import EnergyRod, LoadedRod, Loads
from tests.oracles import Array, paper_rod

ARM, ROD = Arm.from_paper("table-2"), paper_rod("table-2")
# The load that bends the arm by 60 degrees, and its direction.
FORCE, ALONG = 0.0439, np.array([0.3, 0.5, 0.8])
STATICS: dict[str, tuple[Effect, ...]] = {
    "paper": (Extension(),),
    "exact": (Extension(), ExactTendons()),
    "silicone": Scene.silicone().effects,
}
# Solutions of an initial value problem under dead loads of some tens grow beyond all digits.
CASES = [
    (statics, follower, times)
    for statics in STATICS
    for follower in (False, True)
    for times in ((0.1, 1, 10, 100, 300) if follower else (0.1, 1, 10))
]


def tensions() -> Array:
    T = np.zeros(12)
    T[[1, 5, 8]] = 0.05, 0.2, 0.3
    return T


def settled(statics: str, force: Array, follower: bool) -> Shape:
    load = TipLoad(tuple(force.tolist()), follower=follower)
    return settle(ARM, tensions(), Scene(*STATICS[statics], load), 1e-7)


@pytest.mark.quick("paper-dead-1", "exact-dead-10")
@pytest.mark.parametrize(
    ("statics", "follower", "times"),
    CASES,
    ids=[f"{s}-{'follower' if f else 'dead'}-{k:g}" for s, f, k in CASES],
)
def test_loads_of_any_size_are_borne(statics: str, follower: bool, times: float) -> None:
    force = times * FORCE * ALONG
    shape = settled(statics, force, follower)
    loads = Loads(force=force, follower=follower)
    own: LoadedRod = LoadedRod(ROD, tensions(), loads)
    if statics != "paper":
        own = EnergyRod(ROD, tensions(), loads, rubber=statics == "silicone")
    base = own.run(shape.tip_frame)[0.0]
    assert shape.stability > 0
    assert np.linalg.norm(shape.tip + base[:3]) < 1e-6 * ARM.length
    assert np.abs(base[3:12].reshape(3, 3) - ROD.frame).max() < 5e-6


@pytest.mark.slow
@pytest.mark.parametrize("times", [10.0, 100.0, 300.0])
def test_heavy_dead_loads_agree_with_a_boundary_value_problem(times: float) -> None:
    """Each segment is stretched to [0, 1], as the rates jump at anchorages, and all are solved."""
    force, L = times * FORCE * ALONG, ARM.length
    shape = settled("paper", force, False)
    own = LoadedRod(ROD, tensions(), Loads(force=force))
    breaks = ROD.breaks()
    low, h = breaks[:-1], np.diff(breaks)
    # The tip takes up the load within a hundredth of the arm and less.
    x = np.unique([np.linspace(0, 1, 60), 1 - np.geomspace(1e-4, 1, 60)])

    def along(s: Array) -> Array:
        u = shape.position(s)
        F = np.repeat(force[:, None], s.size, 1)
        M = np.cross(shape.tip - u, force).T
        return np.concatenate([u.T, shape.frame(s).reshape(-1, 9).T, F, M])

    guess = np.concatenate([along(a + b * x) for a, b in zip(low, h, strict=True)])

    def rate(x: Array, y: Array) -> Array:
        parts = []
        for a, b, state in zip(low, h, y.reshape(low.size, 18, -1), strict=True):
            columns = zip(x.tolist(), state.T, strict=True)
            active = ROD.active(a + b)
            parts += [np.stack([b * own._rate(a + b * t, row, active, 1.0) for t, row in columns])]
        return np.concatenate(parts, axis=1).T

    def ends(first: Array, last: Array) -> Array:
        clamped = [first[:3], first[3:12] - ROD.frame.ravel()]
        joined = last[:-18] - first[18:]
        return np.concatenate([*clamped, joined, last[-6:-3] - force, last[-3:]])

    found = solve_bvp(rate, ends, x, guess, tol=1e-6, max_nodes=4000)
    assert found.success, found.message
    assert np.linalg.norm(found.y[-18:-15, -1] - shape.tip) < 1e-6 * L
