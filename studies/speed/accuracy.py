"""What does accuracy cost, for each integrator and mesh, and compared with SciPy?

Questions: How does the error decrease with the time, for equilibria, for the tip Jacobian and for
plans? Does `settle` select an efficient integrator and mesh?

Assumptions: The arm of table 4, random tensions (studies.draws). The scenes are the paper's scene,
weight in water, exact tendons (the model of SoRoMoX), silicone without loads, and silicone in
water. Errors are verified. Tips are compared, relative to L, with `settle` at an accuracy of 1e-11,
or with collocation in scenes without loads. Jacobians are compared with the exact one, with
tensions scaled by the largest tension of each tendon. Errors of plans are distances of the tip from
its target. Times are processor times. Points are medians over tensions and repeats, bars are
quartiles. Stars are the automatic choices of `settle`, `tip_jacobian` and `plan` for accuracies of
1e-2 to 1e-10. The time of a plan includes its certificate.

Command: python -m studies.speed accuracy [--figures NAME ...] [--cases 3] [--repeats 20]
[--out out]

Answer: in studies/README.md.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from octoplan.model import Arm, OctoplanError, Scene, settle, tip_jacobian
from octoplan.model.effects import Buoyancy, ExactTendons, Extension, Weight
from octoplan.model.equilibrium.collocation_map import CollocationMap
from octoplan.model.equilibrium.explicit import ClosedForm
from octoplan.model.forward import REFINEMENTS, ForwardMap
from octoplan.model.loads import is_coupled
from octoplan.model.paths import Array
from octoplan.model.rod.collocation import MAGNUS4, MAGNUS6
from octoplan.model.rod.discrete_rod import system
from octoplan.model.stiffness import jacobian_function
from octoplan.planner import plan
from octoplan.planner.targets import TipPosition
from studies import draws
from studies.baselines import ScipyArm, ScipyLoadedArm, ScipySiliconeArm, soromox_tip
from studies.reference import reference_shape
from studies.reporting import asked, lettered
from studies.speed.timing import calls_for, machine, seconds, timed, while_budget

ARM = Arm.from_paper("table-4")
DOWN = np.array([0.0, 0.0, -9.81])
NOTHING = np.zeros(3)
PAPER = Scene(Extension())
EXACT = Scene(Extension(), ExactTendons())
WATER = Scene(Extension(), Weight(), Buoyancy(1000.0))
SILICONE = Scene.silicone()
IN_WATER = Scene.silicone(Weight(), Buoyancy(1000.0))
KNOB = tuple(10.0**-n for n in range(2, 11))
RTOLS = tuple(10.0**-n for n in range(2, 12))
FAILURES = (OctoplanError, RuntimeError, ArithmeticError, np.linalg.LinAlgError)
# Smaller errors are dominated by the error of the reference, so that finer meshes are skipped.
_FINE = 1e-10
# Closed forms in scenes without loads, by name.
CLOSED_FORMS = {scheme.name: scheme for scheme in (MAGNUS6, MAGNUS4)}
# Stages of collocation, by name.
STAGES = {"gauss6": 3, "gauss4": 2, "gauss2": 1, "gauss8": 4}
_COLOURS = {name: f"C{i}" for i, name in enumerate((*CLOSED_FORMS, *STAGES))}
_STYLES: dict[str, dict[str, Any]] = {
    "own": {"marker": "o", "markersize": 4},
    "choice": {"marker": "*", "markersize": 9, "linestyle": ""},
    "other": {"markersize": 4, "linestyle": "--", "color": "0.5"},
}
# Computes the result of a setting for a case, given by its index.
Work = Callable[[int], Any]
# Returns the error of a result for a case.
Error = Callable[[int, Any], float]


@dataclass(frozen=True)
class Size:
    """Number of measurements.

    Attributes
    ----------
    cases : int
        Number of random sets of tensions.
    repeats : int
        Largest number of measurements of each time; fewer if `budget` is exhausted.
    finest : int
        Refinement of the finest mesh.
    settings : int
        Largest number of accuracies and tolerances.
    budget : float
        Processor time [s] for the measurements of a setting, after one measurement of each case.
    """

    cases: int
    repeats: int
    finest: int
    settings: int
    budget: float = 1.0

    @property
    def meshes(self) -> list[int]:
        """Refinements of the meshes."""
        return [refinement for refinement in REFINEMENTS if refinement <= self.finest]


@dataclass(frozen=True)
class Curve:
    """Times and errors of one method.

    Attributes
    ----------
    kind : str
        "own" for an integrator of octoplan, "choice" for automatic choices, "other" for others.
    times, errors : list of (3,)
        Quartiles for each setting, times in ms.
    failed : list of int
        Indices of settings that failed in some case.
    """

    name: str
    kind: str
    times: list[Array] = field(default_factory=list)
    errors: list[Array] = field(default_factory=list)
    failed: list[int] = field(default_factory=list)


def measured(name: str, kind: str, works: Iterable[Work], error: Error, size: Size) -> Curve:
    """Return the curve of a method, for increasingly fine settings until rounding dominates."""
    curve = Curve(name, kind)
    for number, work in enumerate(works):
        try:
            results = [timed(partial(work, i)) for i in range(size.cases)]
        except FAILURES:
            curve.failed.append(number)
            continue
        # The first call builds. The other calls are the measurement if they are long enough.
        times = [taken for taken, _ in results[1:]]
        if sum(times) < size.budget:
            many = calls_for(partial(work, 0))
            turns = while_budget(size.cases, size.repeats, size.budget)
            times = [seconds(partial(work, k % size.cases), many) for k in turns]
        errors = [error(i, value) for i, (_, value) in enumerate(results)]
        curve.times.append(1e3 * np.percentile(times, [25, 50, 75]))
        curve.errors.append(np.percentile(errors, [25, 50, 75]))
        if kind == "own" and curve.errors[-1][1] < _FINE:
            break
    return curve


def settling(scene: Scene, size: Size, rng: np.random.Generator) -> list[Curve]:
    """Return curves of all integrators, of the choices of `settle`, and of other programs."""
    T = draws.rows(ARM, rng, size.cases)
    true = [reference_shape(ARM, row, scene, 1e-11).tip for row in T]

    def off(i: int, tip: Array) -> float:
        return math.dist(tip, true[i]) / ARM.length

    curves = []
    names = [*CLOSED_FORMS] * (not is_coupled(ARM, scene)) + [*STAGES] * (scene != EXACT)
    for name in names:
        maps = (forward_map(name, scene, mesh) for mesh in size.meshes)
        curves.append(
            measured(
                name,
                "own",
                (lambda i, forward=each: forward.solve(T[i]).poses[-1, 4:] for each in maps),
                off,
                size,
            )
        )
    chosen = (lambda i, a=a: settle(ARM, T[i], scene, a).tip for a in KNOB[: size.settings])
    curves.append(measured("settle's choice", "choice", chosen, off, size))
    for name, tip, settings in others(scene):
        works = (lambda i, tip=tip, x=x: tip(T[i], x) for x in settings[: size.settings])
        curves.append(measured(name, "other", works, off, size))
    return curves


def forward_map(name: str, scene: Scene, mesh: int) -> ForwardMap:
    """Return the forward map of an integrator, given by name."""
    if name in CLOSED_FORMS:
        return ClosedForm(ARM, scene, CLOSED_FORMS[name], mesh)
    return CollocationMap(system(ARM, scene, STAGES[name], mesh, (), is_coupled(ARM, scene)))


def others(scene: Scene) -> list[tuple[str, Callable[[Array, float], Array], tuple[float, ...]]]:
    """Return (name, map (tensions, setting) -> tip, settings) of other programs for a scene."""
    if scene == PAPER:
        return [("SciPy DOP853", lambda T, r: ScipyArm(ARM).tip(T, "DOP853", r), RTOLS)]
    if scene == EXACT:
        if find_spec("soromox") is None:
            print('SoRoMoX is skipped, because it is not installed (pip install -e ".[soromox]")')
            return []
        tips = {order: soromox_tip(ARM, order) for order in (0, 2, 4, 6, 8)}
        return [("SoRoMoX, order 0 to 8", lambda T, n: tips[int(n)](T), tuple(map(float, tips)))]
    if scene == WATER:
        loaded = ScipyLoadedArm(ARM, NOTHING, DOWN, 1000.0)
        return [("SciPy shooting", loaded.shoot, RTOLS[:7])]
    silicone = ScipySiliconeArm(ARM, NOTHING, DOWN if is_coupled(ARM, scene) else NOTHING, 1000.0)
    return [("SciPy shooting", silicone.shoot, RTOLS[:8:2])]


def jacobians(size: Size, rng: np.random.Generator) -> list[Curve]:
    """Return curves of the tip Jacobian: all integrators, automatic choices, and SciPy."""
    T = draws.rows(ARM, rng, size.cases)
    scale = draws.most(ARM)
    true = [tip_jacobian(ARM, row, PAPER, 1e-11)[:3] * scale for row in T]

    def off(i: int, J: Array) -> float:
        change = np.asarray(J)[:3] * scale - true[i]
        return float(np.linalg.norm(change) / np.linalg.norm(true[i]))

    def own(name: str, refinement: int) -> Work:
        function = jacobian_function(ClosedForm(ARM, PAPER, CLOSED_FORMS[name], refinement))
        return lambda i: np.array(function(T[i]))

    def choice(accuracy: float, machine_code: bool) -> Work:
        return lambda i: tip_jacobian(ARM, T[i], PAPER, accuracy, compile=machine_code)

    def differences(rtol: float, central: bool) -> Work:
        step = max(rtol, 1e-12) ** (1 / 3) / 10 if central else rtol**0.5 / 10
        return lambda i: ScipyArm(ARM).tip_jacobian(T[i], rtol, step * scale, central)

    curves = [
        measured(name, "own", (own(name, n) for n in size.meshes), off, size)
        for name in CLOSED_FORMS
    ]
    for compiled in (False, True):
        name = "tip_jacobian's choice" + ", compiled" * compiled
        knob = KNOB[: size.settings]
        curves.append(measured(name, "choice", (choice(a, compiled) for a in knob), off, size))
    for central in (False, True):
        name = f"SciPy DOP853, {'central' if central else 'forward'}"
        rtols = RTOLS[1:]
        works = (differences(rtol, central) for rtol in rtols[: size.settings])
        curves.append(measured(name, "other", works, off, size))
    return curves


def plans(size: Size, rng: np.random.Generator) -> list[Curve]:
    """Return curves of `plan` for a tip in silicone, and in silicone in water."""
    curves = []
    T = draws.rows(ARM, rng, size.cases)
    for name, scene in (("plan, silicone", SILICONE), ("plan, silicone in water", IN_WATER)):
        points = [settle(ARM, row, scene, 1e-9).tip for row in T]

        def off(i: int, tensions: Array, scene: Scene = scene, points: Any = points) -> float:
            return math.dist(settle(ARM, tensions, scene, 1e-11).tip, points[i]) / ARM.length

        works = (partial(_planned, scene, points, a) for a in KNOB[: size.settings])
        curves.append(measured(name, "choice", works, off, size))
    return curves


def _planned(scene: Scene, points: list[Array], accuracy: float, i: int) -> Array:
    result = plan(ARM, TipPosition(tuple(points[i])), scene, draws.MAXIMUM, accuracy=accuracy)
    if not result.reached:
        raise RuntimeError(result.outcome)
    return np.ravel(result.tensions)


TIP = "verified tip error [L]"
Panel = tuple[str, str, Callable[[Size, np.random.Generator], list[Curve]]]
# The panels of each figure: title, label of the error, and measurement.
FIGURES: dict[str, tuple[Panel, ...]] = {
    "accuracy_cost": (
        ("settling", TIP, partial(settling, PAPER)),
        ("tip Jacobian by 12 tensions", "verified error of the Jacobian", jacobians),
    ),
    "accuracy_cost_scenes": (
        ("weight in water", TIP, partial(settling, WATER)),
        ("exact tendons", TIP, partial(settling, EXACT)),
    ),
    "accuracy_cost_silicone": (
        ("settling, silicone", TIP, partial(settling, SILICONE)),
        ("settling, silicone in water", TIP, partial(settling, IN_WATER)),
        ("plan of a tip", "tip off its target [L]", plans),
    ),
}


def draw(ax: Axes, curves: Sequence[Curve], error: str) -> None:
    """Draw errors over times with quartiles; each integrator has one colour in all panels."""
    choices = iter(("black", "#b3123f"))
    markers = iter("sD")
    for curve in (each for each in curves if each.times):
        x = np.array(curve.times).T
        y = np.maximum(np.array(curve.errors).T, 1e-13)
        look = {"color": next(choices) if curve.kind == "choice" else _COLOURS.get(curve.name)}
        if curve.kind == "other":
            look = {"marker": next(markers)}
        style = {"label": curve.name, "lw": 1.2, "elinewidth": 0.6} | _STYLES[curve.kind] | look
        arms = [np.maximum([z[1] - z[0], z[2] - z[1]], 0.0) for z in (x, y)]
        ax.errorbar(x[1], y[1], xerr=arms[0], yerr=arms[1], **style)
    ax.set(xscale="log", yscale="log", xlabel="time [ms]", ylabel=error)


def report(title: str, curves: Sequence[Curve]) -> None:
    """Print the median time and error of each setting, one line for each method."""
    print(f"\n{title}: time [ms] and error, medians")
    for curve in curves:
        pairs = zip(curve.times, curve.errors, strict=True)
        text = "  ".join(f"{cost[1]:.3g} {error[1]:.1e}" for cost, error in pairs)
        lost = f"  ({len(curve.failed)} failed)" if curve.failed else ""
        print(f"  {curve.name:<34}{text}{lost}", flush=True)


def main(argv: Sequence[str] | None = None) -> None:
    """Print the tables and save the figures."""
    args = asked(
        __doc__,
        argv,
        {
            "--figures": (list(FIGURES), {"choices": FIGURES}),
            "--cases": (3, {"help": "number of random sets of tensions"}),
            "--repeats": 20,
            "--finest": (256, {"help": "refinement of the finest mesh"}),
            "--settings": (20, {"help": "largest number of accuracies"}),
            "--seed": 0,
            "--out": Path("out"),
        },
        prog="python -m studies.speed accuracy",
    )
    print(machine("soromox"))
    size = Size(args.cases, args.repeats, args.finest, args.settings)
    for name in args.figures:
        rows = math.ceil(len(FIGURES[name]) / 2)
        figure = Figure(figsize=(8.4, 4.0 * rows + 0.7), layout="constrained")
        panels = [figure.add_subplot(rows, 2, 1 + k) for k in range(len(FIGURES[name]))]
        entries: dict[str, Any] = {}
        for ax, (title, error, measure) in zip(panels, FIGURES[name], strict=True):
            curves = measure(size, np.random.default_rng(args.seed))
            report(title, curves)
            draw(ax, curves, error)
            entries |= {
                label: mark for mark, label in zip(*ax.get_legend_handles_labels(), strict=True)
            }
        look: dict[str, Any] = {"ncols": 4, "fontsize": "small", "frameon": False}
        figure.legend(entries.values(), entries, loc="outside lower center", **look)
        lettered(zip(panels, (title for title, _, _ in FIGURES[name]), strict=True))
        figure.savefig(args.out / f"{name}.png", dpi=110)
