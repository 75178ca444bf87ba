"""Work-precision of settling and of the tip Jacobian; see studies.speed.accuracy."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from importlib.util import find_spec
from typing import Any

import numpy as np

from model import Arm, Scene, settle, tip_jacobian
from model.effects import ExactTendons, Extension
from model.forward import CLOSED_FORMS, ForwardMap, equilibrium_on, forward_map, schemes_of
from model.loads import is_loaded
from model.paths import Array
from planner.c_code.tip_jacobian import tip_jacobian_function
from studies import draws
from studies.baselines import ScipyArm, ScipyLoadedArm
from studies.speed.settle import LOADS
from studies.speed.work_precision.curves import Measured, Size
from studies.speed.work_precision.gvs import settler

PAPER = Scene(Extension())
EXACT = Scene(Extension(), ExactTendons())
WEIGHT = LOADS["weight in water"]
Error = Callable[[int, Any], float]
KNOB = (1e-2, 1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8, 1e-9, 1e-10)
RTOLS = (1e-2, 1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8, 1e-9, 1e-10, 1e-11)
# Others are built for minutes where Jacobians are wanted, or sections have to settle by themselves.
EXPLICIT = tuple(CLOSED_FORMS)


def cases(arm: Arm, scene: Scene, count: int, rng: np.random.Generator) -> tuple[Array, Array]:
    """Return tensions (count, n_tendons) [N], and the tips (count, 3) [m] that they lead to."""
    T = draws.rows(arm, rng, count)
    scheme = None if is_loaded(scene) else schemes_of(scene)[1]
    return T, np.array([settle(arm, row, scene, 1e-11, scheme).tip for row in T])


def settling(
    scene: Scene, size: Size, rng: np.random.Generator, schemes: tuple[str, ...] | None = None
) -> list[Measured]:
    """Return every scheme on every mesh, the knob's choices, and SciPy, for a scene."""
    arm = Arm.from_paper("table-4")
    T, true = cases(arm, scene, size.cases, rng)

    def off(i: int, tip: Array) -> float:
        return float(np.linalg.norm(tip - true[i])) / arm.length

    curves = []
    for name in schemes or schemes_of(scene):

        def work_on(refinement: int, name: str = name) -> Callable[[int], Array]:
            return partial(tip_by, forward_map(arm, scene, name, refinement), T)

        curves.append(Measured.over_meshes(name, work_on, off, size))
    return [*curves, chosen(arm, scene, T, off, size), *_others(scene)(arm, T, off, size)]


def chosen(arm: Arm, scene: Scene, T: Array, off: Error, size: Size) -> Measured:
    """Return the knob's choices."""
    choice = Measured("settle's choice", "choice")
    for accuracy in KNOB[: size.settings]:
        choice.add(lambda i, a=accuracy: settle(arm, T[i], scene, a).tip, off, size)
    return choice


def _others(scene: Scene) -> Callable[[Arm, Array, Error, Size], list[Measured]]:
    """Return what measures those that others offer for the statics of a scene."""
    if is_loaded(scene):
        return _scipy_loads
    return _soromox if scene.has(ExactTendons) else _scipy


def tip_by(forward: ForwardMap, T: Array, i: int) -> Array:
    """Return the tip (3,) under a set of many tensions."""
    return equilibrium_on(forward, T[i]).poses[-1, 4:]


def _scipy(arm: Arm, T: Array, off: Error, size: Size) -> list[Measured]:
    scipy, curves = ScipyArm(arm), []
    for method in ("DOP853", "RK45", "LSODA"):
        curve = Measured(f"SciPy {method}", "other")
        for rtol in RTOLS[: size.settings]:
            curve.add(lambda i, m=method, r=rtol: scipy.tip(T[i], m, r), off, size)
        curves.append(curve)
    return curves


def _soromox(arm: Arm, T: Array, off: Error, size: Size) -> list[Measured]:
    """Return polynomial strains of several orders by SoRoMoX, compiled beforehand."""
    if find_spec("soromox") is None:
        print('SoRoMoX is not installed (pip install -e ".[soromox]"): left out')
        return []
    curve = Measured("SoRoMoX, order 0 to 8", "other")
    for order in (0, 2, 4, 6, 8)[: size.settings]:
        tip = settler(arm, order)
        curve.add(lambda i, tip=tip: tip(T[i]), off, size)
    return [curve]


def _scipy_loads(arm: Arm, T: Array, off: Error, size: Size) -> list[Measured]:
    _, force, gravity, fluid = WEIGHT
    scipy, curves = ScipyLoadedArm(arm, np.array(force), np.array(gravity), fluid), []
    for name, way in (("shooting", scipy.shoot), ("solve_bvp", scipy.collocate)):
        curve = Measured(f"SciPy {name}", "other")
        for rtol in RTOLS[: min(7, size.settings)]:
            curve.add(lambda i, w=way, r=rtol: w(T[i], r), off, size)
        curves.append(curve)
    return curves


def jacobians(size: Size, rng: np.random.Generator) -> list[Measured]:
    """Return the tip Jacobian by scheme and mesh, the knob's choices, and differences by SciPy."""
    arm = Arm.from_paper("table-4")
    T, scale = draws.rows(arm, rng, size.cases), draws.most(arm)
    true = [tip_jacobian(arm, row, PAPER, 1e-11)[:3] * scale for row in T]

    def off(i: int, J: Array) -> float:
        change = np.asarray(J)[:3] * scale - true[i]
        return float(np.linalg.norm(change) / np.linalg.norm(true[i]))

    curves = []
    for name in EXPLICIT:

        def work_on(refinement: int, name: str = name) -> Callable[[int], Array]:
            return partial(_called, tip_jacobian_function(arm, PAPER, name, refinement), T)

        curves.append(Measured.over_meshes(name, work_on, off, size))
    for machine_code in (False, True):
        choice = Measured("tip_jacobian's choice" + ", compiled" * machine_code, "choice")
        for accuracy in KNOB[: size.settings]:

            def chosen(i: int, a: float = accuracy, c: bool = machine_code) -> Array:
                return tip_jacobian(arm, T[i], PAPER, a, compile=c)

            choice.add(chosen, off, size)
        curves.append(choice)
    return [*curves, *_differences(ScipyArm(arm), T, scale, off, size)]


def _called(function: object, T: Array, i: int) -> Array:
    return np.array(function(T[i]))


def _differences(scipy: ScipyArm, T: Array, scale: Array, off: Error, size: Size) -> list[Measured]:
    """Return forward and central differences, by the step that suits the tolerance."""
    curves = []
    for central in (False, True):
        curve = Measured(f"SciPy DOP853, {'central' if central else 'forward'}", "other")
        for rtol in RTOLS[1 : 1 + size.settings]:
            steps = scale * (max(rtol, 1e-12) ** (1 / 3) / 10 if central else rtol**0.5 / 10)
            work = partial(_difference, scipy, T, rtol, steps, central)
            curve.add(work, off, size)
        curves.append(curve)
    return curves


def _difference(
    scipy: ScipyArm, T: Array, rtol: float, steps: Array, central: bool, i: int
) -> Array:
    return scipy.tip_jacobian(T[i], rtol, steps, central)
