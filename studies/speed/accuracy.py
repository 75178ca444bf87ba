"""What does accuracy cost: by which integrator, on which mesh, and against what users have today?

Question: how does the error fall with the time and with the number of cross-sections looked at,
for settling, for the tip Jacobian and for a whole plan; does `settle` choose well; and what does
the accuracy of a plan buy, and that of the statics?

Assumptions: the arm of table 4, random tensions that it bears (studies.draws), the paper's scene,
one with weight in water, and one with exact tendons, which are those of SoRoMoX; and silicone, in
air without loads and in water, by the one statement of a loaded arm with 1 to 4 stages. Errors are
verified: tips against a settle of 1e-11 by another scheme, over L; Jacobians relative to the exact
one, tensions scaled by what each tendon is to pull; plans by the distance of the tip from its
target, and by effort above the best that was found by any way. Times are the processor's. Points
are medians over tensions and repeats, bars their quartiles, crosses failures; stars are what
`settle`, `tip_jacobian` and `plan` choose by themselves, for accuracies of 1e-2 to 1e-10. A plan
includes its certificate, SLSQP nothing of the kind; it starts once, from moderate tensions.

Command: python -m studies.speed accuracy [--cases 3] [--repeats 20] [--targets 5] [--out out]

Answer: of the paper's statics the sixth-order Magnus way is the cheapest for every error below
1e-6, the fourth-order one as cheap above, and both some 40 to 60 times cheaper than SciPy's DOP853;
`settle` pays two to three single maps of it, as it verifies and wraps. Each digit costs 1.3 times
the time. Collocation with m stages is of order 2 m, and three stages are the cheapest below 1e-5,
without loads four below 1e-6: settles of silicone in water take 11 ms to 2e-8, SciPy's shooting or
collocation about a second to 1e-6. A plan takes as long for 1e-2 as for 1e-9, as its search is on a
coarse mesh and most of its time, and in silicone at most two and a half times as long; SLSQP from
one start pays four times that for 1e-4 and thirteen times for 1e-9, at two percent more effort in
the median. What the statics leave out matters more than any mesh: a tenth of L here.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from model.forward import SCHEMES
from planner.plots.work import Curve, legend_below, plot_work
from studies.reporting import lettered
from studies.speed.planning_curves import (
    SCENES,
    STAGES,
    orders,
    planning_in_silicone,
    plans,
    reachable,
    settling_in_silicone,
    stages_name,
    statics,
)
from studies.speed.settling_curves import (
    EXACT,
    EXPLICIT,
    PAPER,
    WEIGHT,
    Measured,
    Size,
    jacobians,
    settling,
)
from studies.speed.timing import machine

NAMES = SCHEMES
TIP = "verified tip error [L]"
# Of the two ways of SciPy to settle silicone, printed only.
_SLOWER = "SciPy solve_bvp"
# Of all that is measured, and printed, the figures show what is best, chosen, or what users have.
SHOWN = (
    *("magnus6", "magnus4", "gauss6", "gauss4", "settle's choice"),
    *("tip_jacobian's choice", "tip_jacobian's choice, compiled"),
    *("SciPy DOP853", "SciPy shooting", "SciPy solve_bvp"),
    *("SciPy DOP853, forward", "SciPy DOP853, central", "SoRoMoX, order 0 to 8"),
)


def shown(curves: Sequence[Measured]) -> list[Curve]:
    """Return the curves over time that a panel shows."""
    return [curve.by_time() for curve in curves if curve.name in SHOWN]


def draw_times(panels: dict[str, tuple[list[Measured], str]]) -> Figure:
    """Return a figure of errors over time, a panel for each (curves, label of the error)."""
    figure = Figure(figsize=(9.6, 4.8), layout="constrained")
    axes = figure.subplots(1, len(panels))
    for ax, (curves, error) in zip(axes, panels.values(), strict=True):
        plot_work(shown(curves), "time [ms]", error, ax, NAMES)
    lettered(zip(axes, panels, strict=True))
    legend_below(figure, axes.tolist(), 4)
    return figure


def draw_planning(gaps: list[Curve], efforts: list[Curve], by_statics: list[Curve]) -> Figure:
    """Return the figure of plans, and of statics, over time."""
    figure = Figure(figsize=(9.6, 4.2), layout="constrained")
    panels = figure.subplots(1, 3)
    curves = (
        (by_statics, "time [ms]", "tip off the neo-Hookean one [L]"),
        (gaps, "time [s]", "tip off its target [L]"),
        (efforts, "time [s]", "effort above the best found"),
    )
    for ax, (lines, cost, error) in zip(panels, curves, strict=True):
        plot_work(lines, cost, error, ax)
    lettered(zip(panels, ("statics", "plan of a tip", "plan of a tip"), strict=True))
    legend_below(figure, panels.tolist(), 4)
    return figure


def draw_silicone(panels: dict[str, list[Measured]]) -> Figure:
    """Return the figure of settling, above, and of planning in silicone over time."""
    figure = Figure(figsize=(9.6, 8.0), layout="constrained")
    axes = figure.subplots(2, 2).ravel()
    own = [stages_name(m) for m in STAGES]
    for ax, (title, curves) in zip(axes, panels.items(), strict=True):
        error = "tip off its target [L]" if "plan" in title else TIP
        drawn = [curve.by_time() for curve in curves if curve.name != _SLOWER]
        plot_work(drawn, "time [ms]", error, ax, own)
    lettered(zip(axes, panels, strict=True))
    legend_below(figure, axes.tolist(), 4)
    return figure


def table(title: str, curves: Sequence[Curve], unit: str) -> None:
    """Print medians: for each way its settings as (cost, error)."""
    print(f"\n{title}: cost [{unit}] and error, medians")
    for curve in curves:
        pairs = zip(curve.cost[:, 1], curve.error[:, 1], strict=True)
        text = "  ".join(f"{cost:.3g} {error:.1e}" for cost, error in pairs)
        lost = f"  ({curve.failed.size} failed)" if curve.failed.size else ""
        print(f"  {curve.name:<34}{text}{lost}", flush=True)


def settled(size: Size, rng: np.random.Generator, out: Path) -> None:
    """Print and draw settling, and the tip Jacobian."""
    panels = {
        "settling": settling(PAPER, size, rng),
        "settling with weight in water": settling(WEIGHT[0], size, rng),
        "settling with exact tendons": settling(EXACT, size, rng, EXPLICIT),
        "tip Jacobian": jacobians(size, rng),
    }
    for title, curves in panels.items():
        table(title, [curve.by_time() for curve in curves], "ms")
    paper, loaded, exact, jacobian = panels.values()
    figures = {
        "accuracy_cost": {
            "settling": (paper, TIP),
            "tip Jacobian by 12 tensions": (jacobian, "verified error of the Jacobian"),
        },
        "accuracy_cost_scenes": {
            "weight in water": (loaded, TIP),
            "exact tendons": (exact, TIP),
        },
    }
    for name, shared in figures.items():
        draw_times(shared).savefig(out / f"{name}.png", dpi=110)


def planned(size: Size, rng: np.random.Generator, out: Path, targets: int) -> None:
    """Print and draw plans, and what the statics leave out."""
    by_statics = statics(size, rng)
    table("statics, tip off the neo-Hookean one", by_statics, "ms")
    gaps, efforts = plans(reachable(targets, rng), size, rng)
    table("plans, tip off its target", gaps, "s")
    table("plans, effort above the best found", efforts, "s")
    figure = draw_planning(gaps, efforts, by_statics)
    figure.savefig(out / "accuracy_cost_plans.png", dpi=110)


def in_silicone(size: Size, rng: np.random.Generator, out: Path) -> None:
    """Print and draw settling and planning in silicone."""
    panels = {}
    for which in SCENES:
        for title, measure in (
            ("settling", settling_in_silicone),
            ("plan of a tip", planning_in_silicone),
        ):
            curves = measure(which, size, rng)
            panels[f"{title}, {which}"] = curves
            table(f"{title}, {which}", [curve.by_time() for curve in curves], "ms")
            print("  " + "; ".join(orders(curves)))
    draw_silicone(panels).savefig(out / "accuracy_cost_silicone.png", dpi=110)


def main(argv: Sequence[str] | None = None) -> None:
    """Print the tables and save the figures."""
    parser = argparse.ArgumentParser(
        prog="python -m studies.speed accuracy", description=__doc__.splitlines()[0]
    )
    parser.add_argument("--cases", type=int, default=3, help="random sets of tensions")
    parser.add_argument("--repeats", type=int, default=20)
    parser.add_argument("--targets", type=int, default=5)
    parser.add_argument("--finest", type=int, default=256, help="the finest mesh")
    parser.add_argument("--settings", type=int, default=20, help="accuracies, at most")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--out", type=Path, default=Path("out"))
    args = parser.parse_args(argv)
    print(machine("soromox"))
    size = Size(args.cases, args.repeats, args.finest, args.settings)
    args.out.mkdir(parents=True, exist_ok=True)
    settled(size, np.random.default_rng(args.seed), args.out)
    planned(size, np.random.default_rng(args.seed), args.out, args.targets)
    in_silicone(size, np.random.default_rng(args.seed), args.out)
