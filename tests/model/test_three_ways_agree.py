"""Collocation, single shooting and the closed form on the arms of the paper."""

from __future__ import annotations

from functools import cache, lru_cache

import numpy as np
import pytest

from model import Arm, Scene
from model.effects import Extension
from model.equilibrium.dense import poses_and_strains
from model.equilibrium.newton import newton
from model.forward import SCHEMES, schemes_of
from model.integrators.magnus import Magnus
from model.mesh import graded
from model.transcription.system import system
from model.unloaded.strain_ode import StrainOde
from tests.model.cases import paper_tensions
from tests.oracles import Array, Rod, balance, paper_rod, poses, strain

SCENE = Scene(Extension())
# Each scheme on a mesh that is good to 1e-9 of strains and tips.
REFINEMENTS = {"rk6": 32, "rk8": 16, "rk4": 256, "gauss6": 16, "gauss4": 64, "erk": 32, "cvodes": 8}
STAGES, ELEMENTS = 3, 16
ARMS = ("table-2", "table-4")
FEW = [(name, seed, "rk6") for name in ARMS for seed in range(10)]
FEW += [(name, 0, scheme) for name in ARMS for scheme in REFINEMENTS if scheme != "rk6"]
REST = [(name, seed, "rk6") for name in ARMS for seed in range(10, 100)]
EACH = [*FEW, *(pytest.param(*case, marks=pytest.mark.slow) for case in REST)]


class Ways:
    """Single shooting by one scheme, and collocation, of one arm."""

    def __init__(self, name: str, scheme: str) -> None:
        self.arm, self.rod = Arm.from_paper(name), paper_rod(name)
        refinement, integrator = REFINEMENTS[scheme], SCHEMES[scheme]
        assert not isinstance(integrator, Magnus)
        self.mesh, refined = graded(self.arm, refinement), integrator.refined(refinement)
        self.ode = StrainOde(self.arm, SCENE, self.mesh, refined)
        # Forces and moments are among the unknowns, though all of them vanish here.
        self.system = system(self.arm, SCENE, STAGES, ELEMENTS, (), True)

    def trajectories(self, T: Array) -> list[Array]:
        """Return the curvatures (2, N) of single shooting along each segment, tip side first."""
        states, found = self.ode.run(T)[0], []
        for segment in self.ode.system.segments:
            first = states[self.mesh.node(segment.nodes[0])]
            found.append(np.column_stack([first, np.array(segment.map(first, T))])[7:])
        return found


ways = lru_cache(Ways)


@cache
def solved(name: str, seed: int, scheme: str) -> tuple[Array, Array]:
    """Return random tensions, and the unknowns that collocation finds from a bad start."""
    way, rng = ways(name, scheme), np.random.default_rng(seed)
    T = paper_tensions(rng, name)
    wanted = np.array([strain(way.rod, T, s, True) for s in way.system.s])
    start = way.system.start(T, wanted * (1 + 0.05 * rng.standard_normal(wanted.shape)), 1.0)
    start += 0.01 * rng.standard_normal(start.size) * (start != 0)
    assert np.abs(way.system.residual(way.system.x(T, 1.0, start))).max() > 1e-4
    here = newton(way.system, T, 1.0, start)
    assert here is not None
    return T, here.x


def relative(found: Array, wanted: Array) -> float:
    """Return the largest difference of curvatures (N, 2), relative to the curvature there."""
    gap = np.linalg.norm(found - wanted, axis=1)
    return float((gap / np.linalg.norm(wanted, axis=1)).max())


def curvatures(rod: Rod, T: Array, nodes: Array, active: int) -> Array:
    return np.array([strain(rod, T, s, True, active)[1:3] for s in nodes])


@pytest.mark.parametrize(("name", "seed", "scheme"), EACH)
def test_strains_of_all_three_agree_all_along(name: str, seed: int, scheme: str) -> None:
    way = ways(name, scheme)
    T, x = solved(name, seed, scheme)
    single = way.ode.run(T)[0][:, 7:]
    closed = np.array([strain(way.rod, T, s, True)[1:3] for s in way.mesh.s])
    assert relative(single, closed) <= 1e-9
    inside, wanted = way.system.strains(x[way.system.of.first :]), way.system.s
    assert np.abs(inside[:, 0]).max() <= 1e-9
    closed = np.array([strain(way.rod, T, s, True) for s in wanted])
    assert relative(inside[:, 1:3], closed[:, 1:3]) <= 1e-9
    assert np.abs(inside[:, 3] - closed[:, 3]).max() <= 1e-9
    for i, states in enumerate(way.trajectories(T)):
        nodes = way.ode.system.segments[i].nodes
        assert relative(states.T, curvatures(way.rod, T, nodes, i + 1)) <= 1e-9
    collocated = poses_and_strains(way.system, x, way.mesh.s[1:])[1]
    assert relative(collocated[:, 1:3], single[1:]) <= 1e-9


@pytest.mark.parametrize(("name", "seed", "scheme"), EACH)
def test_moment_is_continuous_across_every_anchorage(name: str, seed: int, scheme: str) -> None:
    way = ways(name, scheme)
    T, x = solved(name, seed, scheme)
    shot = [np.zeros((2, 1)), *way.trajectories(T)]
    for i, section in enumerate(way.rod.sections):
        D_outer, m_outer = balance(way.rod, T, section.at, i)
        D, m = balance(way.rod, T, section.at, i + 1)
        assert np.linalg.norm(m - m_outer) > 0
        sides = section.at * np.array([1, 1 + 1e-13])
        inner, outer = poses_and_strains(way.system, x, np.minimum(sides, way.rod.length))[1][:, :3]
        pairs = [(inner, outer * (i > 0))]
        pairs.append((np.append(0, shot[i + 1][:, 0]), np.append(0, shot[i][:, -1])))
        for inner, outer in pairs:
            jump = D @ inner - D_outer @ outer - (m - m_outer)
            assert np.linalg.norm(jump) <= 1e-10 * np.linalg.norm(D @ inner)


@pytest.mark.parametrize(("name", "seed", "scheme"), EACH)
def test_tip_is_the_same_by_all_three(name: str, seed: int, scheme: str) -> None:
    way = ways(name, scheme)
    T, x = solved(name, seed, scheme)
    wanted = poses(way.rod, T, [way.rod.length], True)[0][0]
    collocated = way.system.poses(x[way.system.of.first :])[-1, 4:7]
    single = way.ode.run(T)[0][-1, 4:7]
    assert np.linalg.norm(collocated - wanted) <= 1e-9 * way.rod.length
    assert np.linalg.norm(single - wanted) <= 1e-9 * way.rod.length


def test_every_scheme_that_integrates_strains_is_among_them() -> None:
    assert set(REFINEMENTS) == set(schemes_of(Scene.as_printed()))
