"""Is a fetch in space more efficient than a fetch in a plane?

Question: The paper shows two fetches of equal pull (figures 14 and 15). The fetch in space brings
the tip closer to the mouth, which is the base. Is this also true for the best fetch of each kind?

Assumptions: The arm of table 4 in the paper's scene. The mouth is the centre of the base. Each of
the three stretches bends by at least 30 degrees. Each tendon pulls up to 13 N, the largest tension
in the paper. The plane is that of figure 14. A fetch in space may also be plane, so that its
optimum is never worse. For three equal bends the limits of the sections are the largest tensions in
the paper (0.5, 4, 13 N): with higher limits at the tip the arm winds up, twice at 60 degrees, and
meets the same bends with 12 % less pull.

Command: python -m studies.fetch [--budgets 3 4 5 6 7 8 10 17.5] [--out out]

Answer: in studies/README.md.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from octoplan.model import Arm, Scene, Shape, settle
from octoplan.model.effects import Extension
from octoplan.planner import Plan, plan
from octoplan.planner.frontends.plots.plan import plot_shape
from octoplan.planner.limits import Limits
from octoplan.planner.targets import Bend, Fetch
from octoplan.planner.targets.fetch import FetchReach
from studies.reporting import asked

SCENE = Scene(Extension())
FIGURES = {
    "figure 14": {(0, 2): 0.5, (1, 0): 4.0, (2, 2): 13.0},
    "figure 15": {(0, 2): 0.5, (1, 0): 4.0, (2, 1): 13.0},
}
MOUTH = (0.0, 0.0, 0.0)
BEND = np.radians(30)
PLANE = np.radians(90)
MAXIMUM = 13.0
PAPER_LIMITS = np.repeat([0.5, 4.0, 13.0], 4)
KINDS: dict[str, FetchReach] = {
    "in a plane": Fetch.reach(MOUTH, BEND, PLANE),
    "in space": Fetch.reach(MOUTH, BEND),
}


def paper_shape(name: str, scene: Scene) -> Shape:
    """Return the equilibrium of a figure of the paper."""
    T = np.zeros((3, 4))
    for place, tension in FIGURES[name].items():
        T[place] = tension
    return settle(Arm.from_paper("table-4"), T, scene)


def distance(result: Plan) -> float:
    """Return the distance from the tip to the mouth [mm]."""
    return float(1e3 * np.linalg.norm(result.shape.tip - np.array(MOUTH)))


def least_pull(kind: str) -> Plan:
    """Return the fetch that brings the tip to the mouth with the least total pull."""
    arm = Arm.from_paper("table-4")
    return plan(arm, KINDS[kind], SCENE, MAXIMUM, norm="1")


def equal_bends(bend: float, planes: Sequence[float]) -> float:
    """Return the least total pull [N] for three equal bends in planes [deg], base to tip."""
    bends = [Bend(float(np.radians(bend)), float(np.radians(plane))) for plane in planes]
    result = plan(
        Arm.from_paper("table-4"),
        Fetch(*bends),
        SCENE,
        PAPER_LIMITS,
        norm="1",
    )
    return result.effort if result.reached else float("nan")


def nearest(kind: str, budget: float) -> Plan:
    """Return the fetch with the tip nearest to the mouth, for a total pull up to `budget` [N]."""
    arm = Arm.from_paper("table-4")
    return plan(arm, KINDS[kind], SCENE, MAXIMUM, limits=Limits(total_pull=budget))


def draw(curves: dict[str, list[float]], budgets: Sequence[float]) -> Figure:
    """Return the figure: the two fetches of the paper, and distance over the allowed pull."""
    figure = Figure(figsize=(13, 4.2))
    figure.subplots_adjust(left=0.0, right=0.98, bottom=0.13, top=0.9, wspace=0.25)
    for i, name in enumerate(FIGURES):
        ax = figure.add_subplot(1, 3, i + 1, projection="3d")
        shape = paper_shape(name, SCENE)
        plot_shape(shape, ax)
        gap = 1e3 * np.linalg.norm(shape.tip)
        ax.set_title(f"{name}: tip {gap:.0f} mm from the base")
    ax = figure.add_subplot(1, 3, 3)
    for (kind, gaps), style in zip(curves.items(), ("o-", "x--"), strict=True):
        ax.plot(budgets, gaps, style, label=f"best {kind}")
    for name, marker in zip(FIGURES, "^v", strict=True):
        gap = 1e3 * np.linalg.norm(paper_shape(name, SCENE).tip)
        ax.plot(17.5, gap, marker, color="k", label=name)
    ax.set(xlabel="total pull allowed [N]", ylabel="tip to mouth [mm]", title="Best fetches")
    ax.set_ylim(bottom=0)
    ax.grid(alpha=0.3)
    ax.legend()
    return figure


def main(argv: Sequence[str] | None = None) -> None:
    """Print the table and save the figure."""
    args = asked(
        __doc__,
        argv,
        {
            "--budgets": [3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 10.0, 17.5],
            "--bends": [20.0, 40.0, 60.0, 80.0],
            "--out": Path("out"),
        },
    )
    for name in FIGURES:
        for statics, scene in (("as printed", Scene.as_printed()), ("consistent", SCENE)):
            tip = paper_shape(name, scene).tip
            gap = np.linalg.norm(tip)
            print(f"{name} {statics:<11} tip [mm]", *(f"{1e3 * x:9.4f}" for x in tip), end="")
            print(f"   {1e3 * gap:6.1f} mm from the mouth")
    for kind in KINDS:
        result = least_pull(kind)
        print(f"least total pull {kind:<10} {result.effort:7.3f} N: {result.outcome}")
    for bend in args.bends:
        pulls = [equal_bends(bend, planes) for planes in ((90, -90, 90), (0, -90, 90))]
        print(f"three bends of {bend:3.0f} degrees: in a plane {pulls[0]:6.3f} N", end="")
        print(f", as in figure 15 {pulls[1]:6.3f} N")
    curves = {kind: [distance(nearest(kind, b)) for b in args.budgets] for kind in KINDS}
    print("total pull allowed [N] ", *(f"{b:8.1f}" for b in args.budgets))
    for kind, gaps in curves.items():
        print(f"nearest {kind:<10} [mm]", *(f"{gap:8.2f}" for gap in gaps))
    draw(curves, args.budgets).savefig(args.out / "fetch.png", dpi=150)


if __name__ == "__main__":
    main()
