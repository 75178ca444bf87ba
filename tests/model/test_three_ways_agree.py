"""Multiple shooting, single shooting and the closed form on the arms of the paper."""

from __future__ import annotations

from functools import cache, lru_cache

import casadi as ca
import numpy as np
import pytest

from model import Arm, Scene
from model.effects import Extension
from model.forward import SCHEMES, schemes_of
from model.integrators.magnus import Magnus
from model.mesh import graded
from model.unloaded.shooting import Shooting
from model.unloaded.strain_ode import StrainOde, StrainSegments
from tests.model.cases import paper_tensions
from tests.oracles import Array, Rod, balance, paper_rod, poses, strain

SCENE = Scene(Extension())
# Each scheme on a mesh that is good to 1e-9 of strains and tips.
REFINEMENTS = {"rk6": 32, "rk8": 16, "rk4": 256, "gauss6": 16, "gauss4": 64, "erk": 32, "cvodes": 8}
ARMS = ("table-2", "table-4")
FEW = [(name, seed, "rk6") for name in ARMS for seed in range(10)]
FEW += [(name, 0, scheme) for name in ARMS for scheme in REFINEMENTS if scheme != "rk6"]
REST = [(name, seed, "rk6") for name in ARMS for seed in range(10, 100)]
EACH = [*FEW, *(pytest.param(*case, marks=pytest.mark.slow) for case in REST)]


class Ways:
    """The shooting formulations of one arm by one scheme, built once."""

    def __init__(self, name: str, scheme: str) -> None:
        self.arm, self.rod = Arm.from_paper(name), paper_rod(name)
        refinement, integrator = REFINEMENTS[scheme], SCHEMES[scheme]
        assert not isinstance(integrator, Magnus)
        self.mesh, refined = graded(self.arm, refinement), integrator.refined(refinement)
        self.shooting = Shooting(StrainSegments(self.arm, SCENE, self.mesh, refined))
        self.ode = StrainOde(self.arm, SCENE, self.mesh, refined)
        X = ca.MX.sym("X", self.shooting.n_x, self.shooting.n_segments)
        T = ca.MX.sym("T", self.arm.n_tendons)
        trajectories = self.shooting.trajectories(X, T)
        residual = self.shooting.residual(trajectories, T)
        self.trajectories = ca.Function("trajectories", [X, T], trajectories)
        self.residual = ca.Function("residual", [X, T], [residual])
        problem = {"x": ca.vec(X), "p": T, "g": residual}
        self.newton = ca.rootfinder("newton", "newton", problem, {"abstol": 1e-13})
        self.scale = self.shooting.system.scale

    def guess(self, T: Array) -> Array:
        """Return the scaled unknowns that single shooting finds."""
        return self.ode.starts(self.ode.run(T)[0]) / self.scale[:, None]

    def solve(self, T: Array, start: Array) -> Array:
        """Return the scaled unknowns that multiple shooting finds from a start."""
        return np.array(self.newton(start.T.ravel(), T)).reshape(start.T.shape).T

    def states(self, X: Array, T: Array) -> list[Array]:
        """Return the states (7 + n, N) at the nodes of each segment."""
        return [np.array(states) for states in self.trajectories(X, T)]


ways = lru_cache(Ways)


@cache
def solved(name: str, seed: int, scheme: str) -> tuple[Array, Array]:
    """Return random tensions, and the unknowns that multiple shooting finds from a bad start."""
    way, rng = ways(name, scheme), np.random.default_rng(seed)
    T = paper_tensions(rng, name)
    start = way.guess(T)
    start += 0.05 * rng.standard_normal(start.shape)
    assert np.abs(np.array(way.residual(start, T))).max() > 1e-3
    return T, way.solve(T, start)


def relative(found: Array, wanted: Array) -> float:
    """Return the largest difference of curvatures (N, 2), relative to the curvature there."""
    gap = np.linalg.norm(found - wanted, axis=1)
    return float((gap / np.linalg.norm(wanted, axis=1)).max())


def curvatures(rod: Rod, T: Array, nodes: Array, active: int) -> Array:
    return np.array([strain(rod, T, s, True, active)[1:3] for s in nodes])


@pytest.mark.parametrize(("name", "seed", "scheme"), EACH)
def test_strains_of_all_three_agree_at_every_node(name: str, seed: int, scheme: str) -> None:
    way = ways(name, scheme)
    T, X = solved(name, seed, scheme)
    single = way.ode.run(T)[0][:, 7:]
    closed = np.array([strain(way.rod, T, s, True)[1:3] for s in way.mesh.s])
    assert relative(single, closed) <= 1e-9
    segments = way.shooting.segments
    for i, (segment, states) in enumerate(zip(segments, way.states(X, T), strict=True)):
        wanted = curvatures(way.rod, T, segment.nodes, i + 1)
        assert relative(states[7:].T, wanted) <= 1e-9
        inner = [way.mesh.node(s) for s in segment.nodes[:-1]]
        assert relative(states[7:, :-1].T, single[inner]) <= 1e-9


@pytest.mark.parametrize(("name", "seed", "scheme"), EACH)
def test_moment_is_continuous_across_every_anchorage(name: str, seed: int, scheme: str) -> None:
    way = ways(name, scheme)
    T, X = solved(name, seed, scheme)
    for unknowns in (X, way.guess(T)):
        trajectories = way.states(unknowns, T)
        beyond = np.zeros(2)
        for i, (section, states) in enumerate(zip(way.rod.sections, trajectories, strict=True)):
            D_outer, m_outer = balance(way.rod, T, section.at, i)
            D, m = balance(way.rod, T, section.at, i + 1)
            inner, outer = np.append(0, states[7:, 0]), np.append(0, beyond)
            jump = D @ inner - D_outer @ outer - (m - m_outer)
            assert np.linalg.norm(m - m_outer) > 0
            assert np.linalg.norm(jump) <= 1e-10 * np.linalg.norm(D @ inner)
            beyond = states[7:, -1]


@pytest.mark.parametrize(("name", "seed", "scheme"), EACH)
def test_tip_is_the_same_by_all_three(name: str, seed: int, scheme: str) -> None:
    way = ways(name, scheme)
    T, X = solved(name, seed, scheme)
    wanted = poses(way.rod, T, [way.rod.length], True)[0][0]
    multiple = X[4:7, 0] * way.scale[4:7]
    single = way.ode.run(T)[0][-1, 4:7]
    assert np.linalg.norm(multiple - wanted) <= 1e-9 * way.rod.length
    assert np.linalg.norm(single - wanted) <= 1e-9 * way.rod.length


def test_every_scheme_that_integrates_strains_is_among_them() -> None:
    assert set(REFINEMENTS) == set(schemes_of(Scene.as_printed()))
