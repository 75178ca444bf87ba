"""Which statics are accurate, up to which bend?

Question: How large are the tip errors of the paper's statics, of exact tendons on a linear body,
and of exact tendons on a neo-Hookean body, compared with three-dimensional finite elements, over
the bend?

Assumptions: The cases are those without loads in tests/data/fem_reference.json with one taut tendon
or two neighbouring ones: incompressible neo-Hookean cones with frictionless tendons, each with its
uncertainty. Errors are relative to the arm's length.

Command: python -m studies.which_statics [--out out]

Answer: in studies/README.md.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from octoplan.model import Anchorage, Arm, Linear, Scene, settle
from octoplan.model.effects import ExactTendons, Extension, NeoHookean
from studies.reporting import GRID, STATICS, asked

REFERENCE = Path(__file__).parents[1] / "tests" / "data" / "fem_reference.json"
SCENES = {
    "paper": Scene(Extension()),
    "exact, linear body": Scene(Extension(), ExactTendons()),
    "exact, neo-Hookean": Scene.silicone(),
    "the same, anticlastic": Scene(Extension(), ExactTendons(), NeoHookean(anticlastic=True)),
}


def cases() -> list[dict[str, Any]]:
    """Return the cases with taut tendons on one side, sorted by bend."""
    result = json.loads(REFERENCE.read_text())["cases"]
    return sorted(
        (case for case in result if "tendons" in case["params"]), key=lambda case: case["theta"]
    )


def arm_of(case: dict[str, Any]) -> tuple[Arm, list[float]]:
    """Return the arm of a case in the paper's base frame (n = -y, b = -z), and tensions [N]."""
    p = case["params"]
    tendons = p["tendons"]
    angles = tuple(float(np.arctan2(-t["dir"][2], -t["dir"][1])) for t in tendons)
    anchorage = Anchorage(p["L"], Linear(tendons[0]["a"], tendons[0]["b"]), angles)
    arm = Arm(p["L"], Linear(p["Rmax"], p["Rmin"]), (anchorage,))
    return arm, [float(case["label"])] * len(angles)


def errors(case: dict[str, Any]) -> dict[str, float]:
    """Return the distance of the tip from the finite elements, for each statics, in % of L."""
    arm, T = arm_of(case)
    wanted = np.array([*case["tip"], 0.0])
    return {
        name: float(100 * np.linalg.norm(settle(arm, T, scene).tip - wanted) / arm.length)
        for name, scene in SCENES.items()
    }


def uncertainty(case: dict[str, Any]) -> float:
    """Return the uncertainty of the tip of the finite elements, in % of L."""
    total = case["mesh_uncertainty"] + (case["bundle_uncertainty"] or 0.0)
    return float(100 * total / case["params"]["L"])


def draw(table: list[tuple[dict[str, Any], dict[str, float]]]) -> Figure:
    """Return the figure: error of each statics for each case, in the order of the bend."""
    figure = Figure(figsize=(8.4, 4), layout="constrained")
    ax = figure.subplots()
    places = np.arange(len(table))
    floor = [uncertainty(case) for case, _ in table]
    ax.bar(places, floor, width=0.8, color="#dfe3e8", label="finite elements' uncertainty")
    looks = zip(SCENES, "os^v", STATICS.values(), strict=True)
    for name, marker, colour in looks:
        values = [row[name] for _, row in table]
        ax.plot(places, values, marker, ms=7, color=colour, label=name)
    bends = [f"{np.degrees(case['theta']):.0f} deg" for case, _ in table]
    names = [f"{case['case']} {case['label']} N" for case, _ in table]
    labels = [f"{name}\n{bend}" for name, bend in zip(names, bends, strict=True)]
    ax.set_xticks(places, labels)
    ax.set(
        yscale="log",
        xlabel="arm (a: section 5.1, b: section 5.2, c: table 2), tension, bend of the tip",
        ylabel="tip error [% of L]",
        ylim=(1e-3, 10),
    )
    ax.grid(color=GRID, linewidth=0.6, axis="y")
    ax.set_axisbelow(True)
    ax.spines[["top", "right"]].set_visible(False)
    figure.legend(loc="outside upper center", ncols=5, fontsize="small", frameon=False)
    return figure


def main(argv: Sequence[str] | None = None) -> None:
    """Print the table and save the figure."""
    args = asked(
        __doc__,
        argv,
        {
            "--out": Path("out"),
        },
    )
    table = [(case, errors(case)) for case in cases()]
    print(f"{'case':<10}{'bend [deg]':>11}", *(f"{name:>22}" for name in SCENES), "   FEM +-")
    for case, row in table:
        name = f"{case['case']} {case['label']} N"
        print(f"{name:<10}{np.degrees(case['theta']):11.1f}", end=" ")
        print(*(f"{value:20.3f} %" for value in row.values()), f"{uncertainty(case):8.3f} %")
    draw(table).savefig(args.out / "which_statics.png", dpi=130)


if __name__ == "__main__":
    main()
