"""Work-precision of the one statement in silicone, by stages and meshes."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np

from model import Arm, Scene, settle
from model.effects import Buoyancy, Weight
from model.forward import by_collocation
from model.mesh_refinement import REFINEMENTS
from model.paths import Array
from planner import plan
from planner.program.limits import Limits
from planner.program.problem import build
from planner.program.statement import STAGES as PLANNED
from planner.program.statement import Statement
from planner.solve.ipopt import solve
from planner.targets import TipPosition
from studies import draws
from studies.baselines import ScipySiliconeArm
from studies.speed.work_precision.curves import Measured, Size
from studies.speed.work_precision.settling import KNOB, chosen, tip_by
from studies.tip_targets import MAXIMUM

STAGES = (1, 2, 3, 4)
SCENES = {
    "silicone": (Scene.silicone(), 0.0, 0.0),
    "silicone in water": (Scene.silicone(Weight(), Buoyancy(1000.0)), -9.81, 1000.0),
}
# Of SciPy, each of whose settles takes seconds.
_TOLERANCES = (1e-2, 1e-4, 1e-6, 1e-8)
# A plan begins where its tensions are so much of those that are wanted; finer meshes cost minutes.
_BEGINS, _FINEST, _ROUNDING = 0.8, 32, 3e-10


def name(stages: int) -> str:
    """Return what a curve of so many stages is called."""
    return f"collocation, m = {stages}"


def settling(which: str, size: Size, rng: np.random.Generator) -> list[Measured]:
    """Return every number of stages on every mesh, the knob's choices, and SciPy."""
    (scene, gravity, fluid), arm = SCENES[which], Arm.from_paper("table-4")
    T = draws.rows(arm, rng, size.cases)
    true = [settle(arm, row, scene, 1e-11).tip for row in T]

    def off(i: int, tip: Array) -> float:
        return math.dist(tip, true[i]) / arm.length

    curves = []
    for m in STAGES:

        def work_on(refinement: int, m: int = m) -> Callable[[int], Array]:
            return partial(tip_by, by_collocation(arm, scene, m, refinement, loaded=True), T)

        curves.append(Measured.over_meshes(name(m), work_on, off, size))
    scipy, few = ScipySiliconeArm(arm, np.zeros(3), np.array([0, 0, gravity]), fluid), []
    for way, method in (("SciPy shooting", scipy.shoot), ("SciPy solve_bvp", scipy.collocate)):
        curve = Measured(way, "other")
        for rtol in _TOLERANCES[: size.settings]:
            curve.add(lambda i, w=method, r=rtol: w(T[i], r), off, size)
        few.append(curve)
    return [*curves, chosen(arm, scene, T, off, size), *few]


def planning(which: str, size: Size, rng: np.random.Generator) -> list[Measured]:
    """Return solves of a tip's plan from one start by stages and mesh, and what `plan` chooses."""
    scene, arm = SCENES[which][0], Arm.from_paper("table-4")
    T = draws.rows(arm, rng, size.cases)
    points = [settle(arm, row, scene, 1e-9).tip for row in T]

    def off(i: int, tensions: Array) -> float:
        return math.dist(settle(arm, tensions, scene, 1e-11).tip, points[i]) / arm.length

    coarser = replace(size, finest=min(size.finest, _FINEST))

    def work_on(refinement: int) -> Callable[[int], Array]:
        return partial(_solved, arm, scene, refinement, T, points)

    curve = Measured.over_meshes(name(PLANNED), work_on, off, coarser)
    choice = Measured("plan's choice, certified", "choice")
    for accuracy in KNOB[1 : size.settings]:
        choice.add(lambda i, a=accuracy: _planned(arm, scene, points[i], a), off, size)
    return [curve, choice]


def _solved(
    arm: Arm, scene: Scene, refinement: int, T: Array, points: list[Array], i: int
) -> Array:
    """Return the tensions of least effort on one mesh near those that the target was drawn with."""
    targets, limits = (TipPosition(tuple(points[i])),), Limits.of(arm, MAXIMUM)
    problem = build(arm, targets, scene, Statement(refinement=refinement))
    p = problem.parameters(targets, limits)
    x = problem.guess(_BEGINS * np.ravel(T[i]), limits, p)
    found = solve(problem, x, p, problem.bounds(limits))
    if not found.met:
        raise RuntimeError("no optimum near this start")
    return problem.tensions(found.x, limits)


def _planned(arm: Arm, scene: Scene, point: Array, accuracy: float) -> Array:
    found = plan(arm, TipPosition(tuple(point)), scene, MAXIMUM, accuracy=accuracy)
    if not found.reached:
        raise RuntimeError(found.outcome)
    return np.ravel(found.tensions)


def orders(curves: list[Measured]) -> list[str]:
    """Return the order of each number of stages, measured between meshes that tell, as text."""
    told = []
    for curve in (curve for curve in curves if curve.name.startswith("collocation")):
        errors = np.array([row[1] for row in curve.errors])
        pairs = zip(errors[:-1], errors[1:], REFINEMENTS, REFINEMENTS[1:], strict=False)
        found = [
            np.log(a / b) / np.log(fine / coarse)
            for a, b, coarse, fine in pairs
            if 1e-2 > a > b > _ROUNDING
        ]
        if found:
            told.append(f"{curve.name}: order {np.median(found):.1f}")
    return told
