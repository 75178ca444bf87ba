"""Work-precision of settling and of the tip Jacobian, and how its curves are measured.

See studies.speed.accuracy.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from importlib.util import find_spec
from typing import Any

import numpy as np

from model import Arm, OctoplanError, Scene, settle, tip_jacobian
from model.effects import ExactTendons, Extension
from model.forward import CLOSED_FORMS, ForwardMap, equilibrium_on, forward_map, schemes_of
from model.loads import is_loaded
from model.mesh import REFINEMENTS
from model.paths import Array
from model.stiffness import tip_jacobian_function
from planner.plots.work import Curve
from studies import draws
from studies.baselines import ScipyArm, ScipyLoadedArm
from studies.speed.settle import LOADS
from studies.speed.timing import calls_for, seconds, timed, while_budget

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


FAILURES = (OctoplanError, RuntimeError, ArithmeticError, np.linalg.LinAlgError)


@dataclass(frozen=True)
class Size:
    """How much is measured.

    Attributes
    ----------
    cases : int
        Random sets of tensions, or targets.
    repeats : int
        Measurements of each time, at most: fewer where they take longer than `budget`.
    finest : int
        The finest mesh.
    settings : int
        Of accuracies, tolerances and starts, how many at most.
    budget : float
        Processor time [s] after which a setting is measured no more, once each case was.
    """

    cases: int
    repeats: int
    finest: int
    settings: int
    budget: float = 1.0


# Errors below are those of what they are held against.
_FINE = 1e-10


@dataclass
class Measured:
    """A curve by time, as settings are added to it."""

    name: str
    kind: str = "own"
    errors: list[Array] = field(default_factory=list)
    times: list[Array] = field(default_factory=list)
    lost: list[float] = field(default_factory=list)

    def add(
        self,
        work: Callable[[int], Any],
        error: Callable[[int, Any], float],
        size: Size,
    ) -> None:
        """Do a work of all cases, and time it; a failure is kept as such.

        `work` and `error` take the number of the case.
        """
        try:
            found = [timed(partial(work, i), time.process_time) for i in range(size.cases)]
        except FAILURES:
            self.lost.append(failing_time(work, size.cases))
            return
        errors = [error(i, value) for i, (_, value) in enumerate(found)]
        # The first call builds; where the others are long enough they are the measurement.
        times = [taken for taken, _ in found[1:]]
        if sum(times) < size.budget:
            many, times = calls_for(lambda: work(0)), []
            for k in while_budget(size.cases, size.repeats, size.budget):
                times.append(seconds(lambda i=k % size.cases: work(i), many, time.process_time))
        self.errors.append(np.percentile(errors, [25, 50, 75]))
        self.times.append(1e3 * np.percentile(times, [25, 50, 75]))

    @classmethod
    def over_meshes(
        cls,
        name: str,
        work_on: Callable[[int], Callable[[int], Any]],
        error: Callable[[int, Any], float],
        size: Size,
    ) -> Measured:
        """Return the curve of the works (refinement -> work) on finer and finer meshes."""
        curve = cls(name)
        for refinement in (r for r in REFINEMENTS if r <= size.finest):
            curve.add(work_on(refinement), error, size)
            if curve.errors and curve.errors[-1][1] < _FINE:
                break
        return curve

    def by_time(self) -> Curve:
        """Return errors over milliseconds."""
        rows = np.array(self.times).reshape(-1, 3), np.array(self.errors).reshape(-1, 3)
        return Curve(self.name, *rows, 1e3 * np.array(self.lost), self.kind)


def failing_time(work: Callable[[int], Any], cases: int) -> float:
    """Return how long a work takes, on the mean of its cases, though some of them fail [s]."""

    def attempt(i: int) -> None:
        try:
            work(i)
        except FAILURES:
            return

    times = [seconds(lambda i=i: attempt(i), 1, time.process_time) for i in range(cases)]
    return float(np.mean(times))


_STRAINS = ("kappa_x", "kappa_y", "kappa_z", "sigma_x")
_NEWTON = 30


def settler(arm: Arm, order: int) -> Callable[[Array], Array]:
    """Return (tensions (n,)) -> tip (3,) [m] for a conical arm, by strains of a polynomial order.

    By SoRoMoX, piecewise polynomial strains in JAX: what a user of that library writes,
    `pip install -e ".[soromox]"`. Tendons there have their unit tangent and the section is linear,
    so that its statics are those of `Scene(Extension(), ExactTendons())`. Source: A. T. Mathew et
    al., "Reduced order modeling of hybrid soft-rigid robots", Int. J. Robotics Research 44 (2025).
    Newton's method on the generalized forces, compiled; raises ImportError without SoRoMoX.
    """
    import jax
    import jax.numpy as jnp

    jax.config.update("jax_enable_x64", True)
    robot = _robot(arm, order)

    def residual(q: Any, T: Any) -> Any:
        return robot.elastic_force(q) - robot.actuation_force(q, T)

    @jax.jit
    def settle(T: Any) -> Any:
        def step(state: Any) -> Any:
            q, _, count = state
            change = jnp.linalg.solve(jax.jacfwd(residual)(q, T), residual(q, T))
            return q - change, jnp.abs(change).max(), count + 1

        def going(state: Any) -> Any:
            return (state[1] > 1e-11) & (state[2] < _NEWTON)

        start = (jnp.zeros(robot.num_internal_dofs), jnp.inf, 0)
        q, _, _ = jax.lax.while_loop(going, step, start)
        return robot.forward_kinematics_tips(q)[-1][:3, 3]

    frame, origin = np.array(arm.base_frame), np.array(arm.base_position)
    return lambda T: origin + frame @ np.asarray(settle(T))


def _robot(arm: Arm, order: int) -> Any:
    """Return the arm in its own base frame, a segment between anchorages."""
    from soromox.actuation import ThreadlikeActuator, ThreadlikeRouting
    from soromox.systems.components import JointSpec, LinearProfile, LinkSpec
    from soromox.systems.gvs import GVS, GVSSegment, StrainBasisSpec

    ends = np.array([0.0, *(section.at for section in arm.sections[::-1])])
    radii = arm.radius.evaluate(ends, arm.length)[0]
    segments = []
    for i in range(len(ends) - 1):
        link = LinkSpec.circular(
            length=float(ends[i + 1] - ends[i]),
            radius=LinearProfile(float(radii[i]), float(radii[i + 1])),
            density=arm.material.density,
            reference_strain=[0.0, 0.0, 0.0, 1.0, 0.0, 0.0],
            young_modulus=arm.material.E,
            shear_modulus=arm.material.G,
        )
        basis = StrainBasisSpec("legendre", _STRAINS, order)
        segments.append(GVSSegment(link, JointSpec.fixed(), basis, max(5, 2 * order + 2)))
    routing = ThreadlikeRouting.linear(**_routing(arm))
    return GVS.from_segments(
        segments,
        gravity=np.zeros(3),
        base_pose=np.array([0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0]),
        actuators=ThreadlikeActuator.tendons(routing),
    )


def _routing(arm: Arm) -> dict[str, Any]:
    intercepts, jacobian, last = [], [], []
    for i, angle in arm.tendons:
        section = arm.sections[i]
        y = section.offset.evaluate(np.array([0.0, section.at]), section.at)[0]
        side = np.array([0.0, np.cos(angle), np.sin(angle)])
        intercepts.append(y[0] * side)
        jacobian.append((y[1] - y[0]) / section.at * side)
        last.append(len(arm.sections) - 1 - i)
    return {
        "intercept": np.array(intercepts),
        "slope": np.array(jacobian),
        "start_segment_index": (0,) * len(last),
        "end_segment_index": tuple(last),
    }
