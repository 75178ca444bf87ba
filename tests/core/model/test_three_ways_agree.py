"""CollocationMap, the closed form and initial value integration on the arms of the paper."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from octoplan.model import Arm, Scene, Shape, settle
from octoplan.model.effects import Extension
from tests.collocation import collocated
from tests.core.model.cases import paper_tensions
from tests.oracles import Array, Rod, balance, paper_rod, poses, strain

SCENE = Scene(Extension())
# Tolerances of curvatures, relative, in closed form and by collocation.
TOLERANCES = {"magnus6": 1e-12, "gauss6": 1e-9}
CASES = [(name, seed) for name in ("table-2", "table-4") for seed in range(100)]
EACH = [case if case[1] < 10 else pytest.param(*case, marks=pytest.mark.slow) for case in CASES]


@cache
def settled(name: str, seed: int) -> tuple[Rod, Array, dict[str, Shape]]:
    """Return a rod, random tensions, and the shape in closed form and by collocation."""
    arm, T = Arm.from_paper(name), paper_tensions(np.random.default_rng(seed), name)
    shapes = {
        "magnus6": settle(arm, T, SCENE, 1e-10),
        "gauss6": collocated(arm, T, SCENE, 3, 48),
    }
    return paper_rod(name), T, shapes


@pytest.mark.quick("table-2-0", "table-4-3", "table-4-7")
@pytest.mark.parametrize(("name", "seed"), EACH)
def test_strains_agree_all_along(name: str, seed: int) -> None:
    rod, T, shapes = settled(name, seed)
    s = np.linspace(0, rod.length, 33)[1:]
    wanted = np.array([strain(rod, T, place, True) for place in s])
    for way, shape in shapes.items():
        off = np.abs(shape.strain(s) - wanted)
        bend = np.linalg.norm(wanted[:, 1:3], axis=1)
        assert (np.linalg.norm(off[:, 1:3], axis=1) / bend).max() <= TOLERANCES[way]
        assert off[:, [0, 3]].max() <= TOLERANCES[way]


@pytest.mark.parametrize(("name", "seed"), EACH)
def test_moment_is_continuous_across_every_anchorage(name: str, seed: int) -> None:
    rod, T, shapes = settled(name, seed)
    for i, section in enumerate(rod.sections):
        D_outer, m_outer = balance(rod, T, section.at, i)
        D, m = balance(rod, T, section.at, i + 1)
        assert np.linalg.norm(m - m_outer) > 0
        sides = np.minimum(section.at * np.array([1, 1 + 1e-13]), rod.length)
        for shape in shapes.values():
            inner, outer = shape.strain(sides)[:, :3]
            jump = D @ inner - D_outer @ outer * (i > 0) - (m - m_outer)
            assert np.linalg.norm(jump) <= 1e-10 * np.linalg.norm(D @ inner)


@pytest.mark.quick("table-2-1", "table-2-5", "table-4-2", "table-4-8")
@pytest.mark.parametrize(("name", "seed"), EACH)
def test_tip_is_the_same_by_all_three(name: str, seed: int) -> None:
    rod, T, shapes = settled(name, seed)
    wanted = poses(rod, T, [rod.length], True)[0][0]
    for shape in shapes.values():
        assert np.linalg.norm(shape.tip - wanted) <= 1e-9 * rod.length
