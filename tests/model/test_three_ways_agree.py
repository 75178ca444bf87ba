"""Collocation, the closed form and initial value integration on the arms of the paper."""

from __future__ import annotations

from functools import cache, lru_cache

import numpy as np
import pytest

from model import Arm, Scene
from model.effects import Extension
from model.equilibrium.integration import poses_and_strains
from model.equilibrium.linearised import Linearised
from model.equilibrium.newton import newton
from model.equilibrium.verification import verified
from model.forward import explicit_map
from model.transcription.system import system
from tests.model.cases import paper_tensions
from tests.oracles import Array, balance, paper_rod, poses, strain

SCENE = Scene(Extension())
STAGES, ELEMENTS = 3, 16
CASES = [(name, seed) for name in ("table-2", "table-4") for seed in range(100)]
EACH = [case if case[1] < 10 else pytest.param(*case, marks=pytest.mark.slow) for case in CASES]


class Ways:
    """The closed form, and collocation, of one arm."""

    def __init__(self, name: str) -> None:
        self.arm, self.rod = Arm.from_paper(name), paper_rod(name)
        self.closed = explicit_map(self.arm, SCENE, "magnus6", 16)
        # Forces and moments are among the unknowns, though all of them vanish here.
        self.system = system(self.arm, SCENE, STAGES, ELEMENTS, (), True)


ways = lru_cache(Ways)


@cache
def solved(name: str, seed: int) -> tuple[Array, Linearised]:
    """Return random tensions, and the equilibrium that collocation finds from a bad start."""
    way, rng = ways(name), np.random.default_rng(seed)
    T = paper_tensions(rng, name)
    wanted = np.array([strain(way.rod, T, s, True) for s in way.system.s])
    start = way.system.start(T, wanted * (1 + 0.05 * rng.standard_normal(wanted.shape)), 1.0)
    start += 0.01 * rng.standard_normal(start.size) * (start != 0)
    assert np.abs(way.system.residual(way.system.x(T, 1.0, start))).max() > 1e-4
    here = newton(way.system, T, 1.0, start)
    assert here is not None
    return T, here


def relative(found: Array, wanted: Array) -> float:
    """Return the largest difference of curvatures (N, 2), relative to the curvature there."""
    gap = np.linalg.norm(found - wanted, axis=1)
    return float((gap / np.linalg.norm(wanted, axis=1)).max())


@pytest.mark.quick("table-2-0", "table-4-3", "table-4-7")
@pytest.mark.parametrize(("name", "seed"), EACH)
def test_strains_agree_all_along(name: str, seed: int) -> None:
    way = ways(name)
    T, here = solved(name, seed)
    s = way.system.mesh.s[1:]
    closed = np.array([strain(way.rod, T, place, True) for place in s])
    own = way.closed.dense(T, way.closed.run(T)[0], s)[1]
    assert relative(own[:, 1:3], closed[:, 1:3]) <= 1e-12
    assert np.abs(own[:, 3] - closed[:, 3]).max() <= 1e-12
    collocated = poses_and_strains(way.system, here.x, s)[1]
    assert relative(collocated[:, 1:3], closed[:, 1:3]) <= 1e-9
    inside = way.system.strains(here.states)
    closed = np.array([strain(way.rod, T, place, True) for place in way.system.s])
    assert np.abs(inside[:, 0]).max() <= 1e-9
    assert relative(inside[:, 1:3], closed[:, 1:3]) <= 1e-9
    assert np.abs(inside[:, 3] - closed[:, 3]).max() <= 1e-9


@pytest.mark.parametrize(("name", "seed"), EACH)
def test_moment_is_continuous_across_every_anchorage(name: str, seed: int) -> None:
    way = ways(name)
    T, here = solved(name, seed)
    states = way.closed.run(T)[0]
    for i, section in enumerate(way.rod.sections):
        D_outer, m_outer = balance(way.rod, T, section.at, i)
        D, m = balance(way.rod, T, section.at, i + 1)
        assert np.linalg.norm(m - m_outer) > 0
        sides = np.minimum(section.at * np.array([1, 1 + 1e-13]), way.rod.length)
        for inner, outer in (
            poses_and_strains(way.system, here.x, sides)[1][:, :3],
            way.closed.dense(T, states, sides)[1][:, :3],
        ):
            jump = D @ inner - D_outer @ outer * (i > 0) - (m - m_outer)
            assert np.linalg.norm(jump) <= 1e-10 * np.linalg.norm(D @ inner)


@pytest.mark.quick("table-2-1", "table-2-5", "table-4-2", "table-4-8")
@pytest.mark.parametrize(("name", "seed"), EACH)
def test_tip_is_the_same_by_all_three(name: str, seed: int) -> None:
    way = ways(name)
    T, here = solved(name, seed)
    wanted = poses(way.rod, T, [way.rod.length], True)[0][0]
    integrated = verified(here, 1e-10).point.states
    tips = [way.system.poses(states)[-1, 4:7] for states in (here.states, integrated)]
    for tip in (*tips, way.closed.run(T)[0][-1, 4:7]):
        assert np.linalg.norm(tip - wanted) <= 1e-9 * way.rod.length
