"""How much does antagonistic pulling stiffen the arm, and how much of that is physical?

Questions: How does the tip stiffness of a straight arm, of a bend of 90 degrees and of a fetch grow
with co-contraction? The study compares the paper's tangent, exact tendons and a neo-Hookean body,
each with constant tensions (force control) and with locked lengths. How large are the shares of the
shortening and of the thickened cross-section? Do finite elements agree? How much effort does
stiffness cost?

Assumptions: The straight arm is that of table 2 with two opposite tendons in section 1 and a
lateral force in their plane (case d of tests/data/fem_reference.json). The bend and the fetch are
planned shapes of tables 2 and 4: each tendon pulls at least with the level of co-contraction, and
the shape always meets the target. Stiffness is the force per displacement of the tip along the
softest direction. The Pareto front shows the least effort over the requested stiffness, at a
constant tip position.

Command: python -m studies.antagonistic_stiffness [--points 5] [--statics NAME ...] [--out out]

Answer: in studies/README.md.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator

from octoplan.model import Anchorage, Arm, Linear, Scene, settle
from octoplan.model.effects import ExactTendons, Extension, NeoHookean
from octoplan.model.paths import Array
from octoplan.model.stiffness import Hold
from octoplan.planner import Plan, plan, stiffness
from octoplan.planner.frontends.plots.ellipsoids import plot_ellipsoids
from octoplan.planner.limits import TendonLimits
from octoplan.planner.targets import (
    Bend,
    BendingPlane,
    Fetch,
    MinimumStiffness,
    Target,
    TipPosition,
)
from studies.reporting import INK, STATICS, asked, lettered

REFERENCE = Path(__file__).parents[1] / "tests" / "data" / "fem_reference.json"
SCENES = {
    "paper's tangent": Scene(Extension()),
    "exact tendons": Scene(Extension(), ExactTendons()),
    "neo-Hookean": Scene.silicone(),
    "anticlastic": Scene(Extension(), ExactTendons(), NeoHookean(anticlastic=True)),
}
# Tension limits of the first plan, tip section first [N]. With higher limits at the tip, the arm
# with exact tendons winds up: it meets the same bends with less effort.
UNWOUND_LIMITS = (0.25, 20.0, 20.0)
MAXIMUM = 20.0
# The quantities that the motors can keep constant.
HOLDS: tuple[Hold, ...] = ("tension", "length")
# Statics of the Pareto fronts.
FRONTS = ("paper's tangent", "exact tendons")
LINES = {"tension": "-", "length": "--"}
MARKS = {"inplane": "k^", "outplane": "kv", "centre": "ko"}
ELEMENTS = {
    "inplane": "finite elements, in the tendons' plane",
    "outplane": "finite elements, across it",
    "centre": "finite elements, tendons in the middle",
}
SHAPES: dict[str, tuple[str, Target]] = {
    "90 degree bend": (
        "table-2",
        BendingPlane(angle=float(np.radians(90)), bend=float(np.radians(90)), section=1),
    ),
    "fetch": (
        "table-4",
        Fetch(*(Bend(*np.radians(bend).tolist()) for bend in ((40, 0), (40, 180), (40, 0)))),
    ),
}


def straight_arm() -> Arm:
    """Return the arm of case d: the cone of table 2 with two opposite tendons."""
    anchorage = Anchorage(0.31, Linear(7.5e-3, 1e-3), (0.0, float(np.pi)))
    return Arm(0.31, Linear(0.015, 0.0065), (anchorage,))


def lateral(arm: Arm, pull: float, scene: Scene, hold: Hold) -> float:
    """Return the lateral stiffness of the straight arm in the tendons' plane [N/m]."""
    k = stiffness(arm, [pull, pull], scene, hold)
    return float(1 / k.compliance[1, 1])


def finite_elements() -> dict[str, float]:
    """Return the lateral compliance at 2 x 1 N relative to rest, from finite elements."""
    cases = {c["label"]: c["tip"][1] for c in json.loads(REFERENCE.read_text())["cases"]}
    kinds = ("inplane", "outplane", "centre")
    return {k: cases[f"{k} T1 F1e-3"] / cases[f"{k} T0 F1e-3"] for k in kinds}


def shortening_alone(arm: Arm, pull: float) -> float:
    """Return the lateral compliance of the shortened arm relative to rest, with the EJ at rest."""
    shape = settle(arm, [pull, pull], Scene.silicone())
    s = np.linspace(0, arm.length, 801)
    EJ = arm.material.E * np.pi * arm.radius.evaluate(s, arm.length)[0] ** 4 / 4
    x = shape.position(s)[:, 0]
    give = [np.trapezoid((lever[-1] - lever) ** 2 / EJ, s) for lever in (x, s)]
    return float(give[0] / give[1])


def softest(p: Plan, hold: Hold) -> float:
    """Return the stiffness of a plan's tip along its softest direction [N/m]."""
    k = stiffness(p.arm, p.tensions, p.scene, hold)
    return float(1 / k.ellipsoid()[0][0])


def front(arm: Arm, scene: Scene, point: Array, factors: Array) -> list[tuple[float, float]]:
    """Return (stiffness factor along z, effort [N]) of certified plans with the same tip."""
    target = TipPosition(tuple(point.tolist()))
    free = plan(arm, target, scene, 10.0)
    along = (0.0, 0.0, 1.0)
    rest = 1 / stiffness(arm, free.tensions, scene).compliance[2, 2]
    results = [(1.0, free.effort)]
    for factor in factors:
        p = plan(
            arm,
            [target, MinimumStiffness(along, factor * rest)],
            scene,
            10.0,
            starts=2,
        )
        if p.certificate.passed:
            results.append((float(factor), p.effort))
    return results


def co_contracted_plans(
    levels: Array, scenes: dict[str, Scene]
) -> dict[str, dict[str, dict[str, list[tuple[float, float]]]]]:
    """Return (total pull [N], softest stiffness [N/m]) for each shape, statics and actuation."""
    table: dict[str, dict[str, dict[str, list[tuple[float, float]]]]] = {}
    for shape, (name, target) in SHAPES.items():
        table[shape] = {}
        for statics, scene in scenes.items():
            arm = Arm.from_paper(name)
            unwound = plan(arm, target, scene, np.repeat(UNWOUND_LIMITS, 4))
            problem = replace(unwound.problem, limits=TendonLimits.of(arm, MAXIMUM))
            first = replace(unwound, problem=problem)
            plans = [p for level in levels if (p := first.co_contract(level)).certificate.passed]
            table[shape][statics] = {
                hold: [(float(np.sum(p.tensions)), softest(p, hold)) for p in plans]
                for hold in HOLDS
            }
    return table


def draw(
    levels: Array,
    straight: dict[str, dict[str, list[float]]],
    table: dict[str, dict[str, dict[str, list[tuple[float, float]]]]],
    fronts: dict[str, list[tuple[float, float]]],
) -> Figure:
    """Return the figure: stiffness over effort for each shape, and the Pareto front."""
    figure = Figure(figsize=(9.6, 7), layout="constrained")
    axes = figure.subplots(2, 2).ravel()
    titles = ("straight arm, two opposite tendons", *table, "cost of stiffness at the same tip")
    lettered(zip(axes, titles, strict=True))
    colours = dict(zip(SCENES, STATICS.values(), strict=True))
    for statics, held in straight.items():
        axes[0].plot(levels, held["tension"], color=colours[statics], label=statics)
    for hold in HOLDS:
        axes[0].plot([], [], LINES[hold], color=INK, label=f"constant {hold}")
    for kind, share in finite_elements().items():
        axes[0].plot([1.0], [1 / share], MARKS[kind], markersize=5, label=ELEMENTS[kind])
    axes[0].set(xlabel="tension of each tendon [N]", ylabel="lateral stiffness relative to rest")
    for ax, rows in zip(axes[1:3], table.values(), strict=True):
        for statics, held in rows.items():
            for hold, points in held.items():
                ax.plot(*np.array(points).T, LINES[hold], marker=".", color=colours[statics])
        ax.set(xlabel="total pull [N]", ylabel="softest stiffness [N/m]", yscale="log")
        ax.yaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
        ax.yaxis.set_major_formatter("{x:g}")
        ax.yaxis.set_minor_formatter("")
    for statics, points in fronts.items():
        axes[3].plot(*np.array(points).T, "o-", color=colours[statics], markersize=3)
    axes[3].set(xlabel="stiffness along z relative to least effort", ylabel="effort [N]")
    handles, labels = axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=3, fontsize=9, frameon=False)
    return figure


def main(argv: Sequence[str] | None = None) -> None:
    """Print the tables and save the figures."""
    args = asked(
        __doc__,
        argv,
        {
            "--points": 5,
            "--statics": (list(SCENES), {"choices": SCENES}),
            "--out": Path("out"),
        },
    )
    levels = np.linspace(0.0, 2.0, args.points)
    scenes = {name: SCENES[name] for name in args.statics}
    arm = straight_arm()
    straight: dict[str, dict[str, list[float]]] = {}
    print(
        "straight arm: lateral stiffness relative to rest, over the tension of two opposite tendons"
    )
    print(f"{'statics':<18}{'constant':<9}" + "".join(f"{level:>7.2f} N" for level in levels))
    for statics, scene in scenes.items():
        straight[statics] = {}
        for hold in HOLDS:
            rest = lateral(arm, 0.0, scene, "tension")
            row = [lateral(arm, float(level), scene, hold) / rest for level in levels]
            straight[statics][hold] = row
            print(f"{statics:<18}{hold:<9}" + "".join(f"{value:>9.3f}" for value in row))
    elements = ", ".join(f"{kind} {1 / share:.3f}" for kind, share in finite_elements().items())
    print(f"finite elements at 1 N, constant tension: {elements}")
    lever = [1 / shortening_alone(arm, float(level)) for level in levels]
    print(f"{'neo-Hookean, shortening only':<27}" + "".join(f"{value:>9.3f}" for value in lever))
    table = co_contracted_plans(np.linspace(0.0, 0.5, args.points), scenes)
    for shape, rows in table.items():
        print(f"\n{shape}: total pull [N], stiffness of the tip along its softest direction [N/m]")
        for statics, held in rows.items():
            for hold, points in held.items():
                cells = "".join(f"{pull:>8.2f} {k:<9.4f}" for pull, k in points)
                print(f"{statics:<18}{hold:<9}{cells}")
    fronts = {}
    table4 = Arm.from_paper("table-4")
    T = [[0, 0, 0.3, 0], [1, 0, 0, 0], [0, 2, 0, 0]]
    for statics in [name for name in FRONTS if name in scenes]:
        scene = scenes[statics]
        factors = np.linspace(1.1, 2.0, args.points)
        fronts[statics] = front(table4, scene, settle(table4, T, scene).tip, factors)
        cells = "  ".join(f"x{factor:.2f}: {effort:.3f}" for factor, effort in fronts[statics])
        print(f"\nsame tip, stiffer along z: least effort [N], {statics}: {cells}")
    draw(levels, straight, table, fronts).savefig(args.out / "antagonistic_stiffness.png", dpi=110)
    name, target = SHAPES["90 degree bend"]
    bent = plan(Arm.from_paper(name), target, Scene.silicone(), 20.0)
    places = np.linspace(0.25, 1.0, 4) * bent.arm.length
    results = [stiffness(bent.arm, bent.tensions, bent.scene, at=float(s)) for s in places]
    plot_ellipsoids(results, 2e-2).savefig(args.out / "compliance_ellipsoids.png", dpi=110)


if __name__ == "__main__":
    main()
