"""The mechanics inside a program: from tensions to the poses that targets look at."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import casadi as ca
import numpy as np

from model.arm import Arm
from model.effects import Extension
from model.errors import SnapError
from model.forward import SCHEMES, explicit_map, forward_map
from model.integrators.magnus import Magnus
from model.integrators.runge_kutta import RungeKutta
from model.loaded.forward import Loaded
from model.loaded.loads import places
from model.loaded.segments import LoadSegments
from model.mesh import graded
from model.paths import Array
from model.scene import Scene
from model.statics import is_loaded
from model.stations import Counts
from model.unloaded.pose_derivatives import PoseDerivatives
from model.unloaded.shooting import Shooting
from model.unloaded.strain_derivatives import StretchDerivatives
from model.unloaded.strain_ode import StrainSegments
from planner.program.segment_chain import SegmentChain
from planner.program.statement import Statement


@dataclass(frozen=True, eq=False)
class Mechanics:
    """Expressions of the tensions.

    Attributes
    ----------
    states : (n,)
        Further unknowns, scaled; none in the condensed form.
    poses : (7, K)
        At the stations.
    stretch : (m,)
        1 + q where it is least in each segment; none without extension.
    closure : (n,)
        Constraints that settle the states.
    chain : PoseDerivatives or None
        The derivatives of the poses, where they are a chain of steps.
    least : StretchDerivatives or None
        Those of the stretches, where sections settle by themselves.
    nodes : (n_x, K) symbol or None
        States at nodes, which everything else is an expression of, where they have derivatives of
        their own.
    segments : SegmentChain or None
        What finds these states, and their derivatives.
    """

    states: ca.MX
    poses: ca.MX
    stretch: ca.MX
    closure: ca.MX
    chain: PoseDerivatives | None = None
    least: StretchDerivatives | None = None
    nodes: ca.MX | None = None
    segments: SegmentChain | None = None


def mechanics(
    arm: Arm, scene: Scene, statement: Statement, stations: tuple[float, ...], T: ca.MX
) -> Mechanics:
    """Return the mechanics of a statement as expressions of the tensions T."""
    if statement.form == "condensed":
        return _condensed(arm, scene, statement, stations, T)
    state = _loaded if is_loaded(scene) else _multiple_shooting
    return state(arm, scene, statement, stations, T)


def _condensed(
    arm: Arm, scene: Scene, statement: Statement, stations: tuple[float, ...], T: ca.MX
) -> Mechanics:
    forward = explicit_map(arm, scene, statement.scheme, statement.refinement, stations)
    poses, stretch = forward.function(T)[:2]
    poses = poses[:, [forward.mesh.node(s) for s in stations]]
    rows = slimmest(arm, forward.stretch_at, forward.stretch_active) if scene.has(Extension) else []
    scheme, none = SCHEMES[statement.scheme], ca.MX(0, 1)
    if not isinstance(scheme, Magnus):
        return Mechanics(none, poses, stretch[rows].T if rows else none, none)
    chain = PoseDerivatives(arm, scene, forward.mesh, scheme, stations)
    s, active = forward.stretch_at[rows], forward.stretch_active[rows]
    least = StretchDerivatives(arm, scene, s, active) if rows else None
    return Mechanics(none, poses, least.first(T)[0] if least else none, none, chain, least)


def _multiple_shooting(
    arm: Arm, scene: Scene, statement: Statement, stations: tuple[float, ...], T: ca.MX
) -> Mechanics:
    system = shooting_system(arm, scene, statement.scheme, statement.refinement, stations)
    X = ca.MX.sym("X", system.n_x, system.n_segments)
    p = system.system.parameters(T)
    paths = system.trajectories(X, p)
    poses, stretch = {}, []
    for path, segment in zip(paths, system.segments, strict=True):
        radius = arm.radius.evaluate(segment.nodes, arm.length)[0]
        stretch.append(segment.stretch(path, p)[0, int(np.argmin(radius))])
        for s in stations:
            near = int(np.argmin(np.abs(segment.nodes - s)))
            if abs(segment.nodes[near] - s) <= 1e-9 * arm.length:
                poses[s] = path[:7, near]
    columns = ca.horzcat(*(poses[s] for s in stations))
    thin = ca.vertcat(*stretch) if scene.has(Extension) else ca.MX(0, 1)
    closure = system.residual(paths, p)
    return Mechanics(ca.vec(X), columns, thin, closure)


def _loaded(
    arm: Arm, scene: Scene, statement: Statement, stations: tuple[float, ...], T: ca.MX
) -> Mechanics:
    shooting = shooting_system(arm, scene, statement.scheme, statement.refinement, stations)
    system = shooting.system
    assert isinstance(system, LoadSegments)
    chain, p = SegmentChain(system, stations), system.parameters(T)
    X = ca.MX.sym("X", shooting.n_x, shooting.n_segments)
    nodes = ca.MX.sym("nodes", shooting.n_x, len(chain.looks))
    starts, ends, stretch = [], [], []
    for i, segment in enumerate(system.segments):
        starts.append(ca.DM(system.scale) * X[:, i])
        ends.append(nodes[:, chain.end(i)])
        slim = chain.slimmest(i)
        read = system.stretch(
            segment.nodes[[slim]], system.active(segment.nodes[:2].mean()), segment.nodes[0]
        )
        stretch.append(read(nodes[:, chain.looks.index((i, slim))], p))
    closure = shooting.joined(starts, ends, p)
    poses = ca.horzcat(*(nodes[:7, chain.station(s)] for s in stations))
    thin = ca.vertcat(*stretch) if scene.has(Extension) else ca.MX(0, 1)
    return Mechanics(ca.vec(X), poses, thin, closure, nodes=nodes, segments=chain)


@lru_cache(maxsize=64)
def shooting_system(
    arm: Arm, scene: Scene, scheme: str, refinement: int, stations: tuple[float, ...]
) -> Shooting:
    """Return the shooting constraints on a mesh with the stations, by a Runge-Kutta scheme."""
    method = SCHEMES[scheme]
    assert isinstance(method, RungeKutta)
    if is_loaded(scene):
        mesh = graded(arm, refinement, (*stations, *places(arm, scene)))
        return Shooting(LoadSegments(arm, scene, mesh, method))
    return Shooting(StrainSegments(arm, scene, graded(arm, refinement, stations), method))


def starts_of(
    arm: Arm, scene: Scene, statement: Statement, stations: tuple[float, ...], tensions: Array
) -> Array:
    """Return the scaled states (n_x, segments) that settle the arm under tensions.

    Where it does not bear its loads, they are those without loads.
    """
    mesh = (statement.scheme, statement.refinement, stations)
    forward = forward_map(arm, scene, *mesh)
    try:
        found = forward.starts(forward.run(tensions)[0])
    except SnapError:
        assert isinstance(forward, Loaded)
        found = forward.without_loads(tensions)
    assert found is not None
    scale = shooting_system(arm, scene, *mesh).system.scale
    return np.asarray(found / scale[:, None])


def slimmest(arm: Arm, s: Array, active: Counts) -> list[int]:
    """Return, for each segment with tendons, where its body is slimmest and 1 + q least."""
    radius = arm.radius.evaluate(s, arm.length)[0]
    rows = []
    for count in np.unique(active[active > 0]):
        inside = np.flatnonzero(active == count)
        rows.append(int(inside[np.argmin(radius[inside])]))
    return rows
