"""How far is the paper's arm from the best arm for its tasks?

Question: Which taper, offsets and anchorages of the arm of table 4 minimise the total effort of a
fetch and ten random tip targets, at the same tension limits? How much effort does the best arm
save, which parameters matter most, and does a global search over three parameters find a better
arm?

Assumptions: The paper's scene. The three stretches of the fetch bend by 60 degrees in different
planes. The paper's arm reaches the tips with moderate random tensions. Effort is the root of the
sum of all squared tensions. A wall of 0.8 mm remains around each tendon.

Command: python -m studies.design [--tips 10] [--begins 2] [--search 72] [--out out]

Answer: in studies/README.md.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from scipy.optimize import differential_evolution
from scipy.stats import qmc

from octoplan.model import Arm, OctoplanError, Scene, settle
from octoplan.model.effects import Extension
from octoplan.model.paths import Array
from octoplan.planner import ManufacturingLimits, Unknown, design, plan
from octoplan.planner.extensions.fit.designed import Design
from octoplan.planner.targets import Bend, Fetch, TipPosition
from studies.reporting import asked

SCENE = Scene(Extension())
MOST = 20.0
PULLS = np.array([[0.4], [3.0], [8.0]])
UNKNOWNS = [
    Unknown("arm.radius_mm[0]", 10, 20),
    Unknown("arm.radius_mm[1]", 1.9, 6),
    Unknown("arm.sections[0].offset_mm[0]", 3, 12),
    Unknown("arm.sections[1].offset_mm[0]", 2, 10),
    Unknown("arm.sections[2].offset_mm[0]", 3, 12),
    Unknown("arm.sections[1].at_mm", 220, 380),
    Unknown("arm.sections[2].at_mm", 90, 200),
]
MANUFACTURING = ManufacturingLimits(wall=0.0008, spacing=0.05)
FETCH = Fetch(*(Bend(*np.radians(bend).tolist()) for bend in ((60, 0), (60, 180), (60, 90))))
# Indices of the unknowns of the global search: tip radius and positions of the inner anchorages.
SEARCHED = (1, 5, 6)
# Number of generations of differential evolution.
_GENERATIONS = 8
# Effort that the search assigns to an arm that does not meet all tasks [N].
_PENALTY = 1e3
# Violation of a manufacturing limit that rounding explains, relative to the arm's length.
_ROUNDING = 1e-6


def tips(count: int, seed: int = 0) -> list[TipPosition]:
    """Return random tips that the paper's arm reaches."""
    rng = np.random.default_rng(seed)
    arm = Arm.from_paper("table-4")
    pulls = [rng.uniform(0, 1, (3, 4)) ** 3 * PULLS for _ in range(count)]
    return [TipPosition(tuple(settle(arm, T, SCENE).tip.tolist())) for T in pulls]


def effort_of(result: Design, values: Array, starts: int) -> float:
    """Return the total effort of an arm's plans [N]; infinite unless all tasks are met."""
    try:
        arm = result.parameters.setting(values).arm
        if MANUFACTURING.margins(arm).min() < -_ROUNDING:
            return float("inf")
        plans = [plan(arm, p.targets, SCENE, MOST, starts=starts) for p in result.plans]
    except OctoplanError:
        return float("inf")
    met = all(p.certificate.passed for p in plans)
    return float(np.linalg.norm([p.effort for p in plans])) if met else float("inf")


def search_globally(outcome: Design, count: int, starts: int = 1) -> tuple[float, Array, int]:
    """Return (least effort [N], parameters, number of arms that meet all tasks).

    Differential evolution tries `count` arms with different values of the SEARCHED parameters. The
    other parameters keep the values of the design.
    """
    parameters = outcome.parameters
    efforts = list[float]()
    kept = [k for k in SEARCHED if k < len(outcome.values)]

    def effort(share: Array) -> float:
        values = outcome.array
        values[kept] = parameters.lower[kept] + share * parameters.range[kept]
        efforts.append(effort_of(outcome, values, starts))
        return min(efforts[-1], _PENALTY)

    population = max(5, count // _GENERATIONS)
    result = differential_evolution(
        effort,
        [(0.0, 1.0)] * len(kept),
        maxiter=max(count // population - 1, 0),
        init=qmc.Halton(len(kept), seed=0).random(population),
        seed=0,
        polish=False,
    )
    values = parameters.lower[kept] + result.x * parameters.range[kept]
    return min(efforts), values, int(np.isfinite(efforts).sum())


def figure(result: Design) -> Figure:
    """Draw the effort of each task, before and after."""
    whole = Figure(figsize=(5.6, 3.2), layout="constrained")
    ax = whole.add_subplot()
    at = np.arange(len(result.plans))
    ax.bar(at - 0.2, [each.effort for each in result.before], 0.4, label="the paper's arm")
    ax.bar(at + 0.2, [each.effort for each in result.plans], 0.4, label="designed")
    ax.set_xlabel("task (0: the fetch)")
    ax.set_yscale("log")
    ax.set_ylabel("effort [N]")
    whole.legend(loc="outside upper center", ncols=2)
    return whole


def main(argv: Sequence[str] | None = None) -> None:
    """Print the design and save the figure."""
    args = asked(
        __doc__,
        argv,
        {
            "--tips": 10,
            "--begins": (2, {"help": "number of arms from which the search starts"}),
            "--search": (72, {"help": "number of arms of the global search; 0 skips the search"}),
            "--unknowns": (len(UNKNOWNS), {"help": "number of unknowns, in the order listed"}),
            "--out": Path("out"),
        },
    )
    arm = Arm.from_paper("table-4")
    unknowns = UNKNOWNS[: args.unknowns]
    targets = [FETCH, *tips(args.tips)]
    result = design(
        arm,
        targets,
        unknowns,
        SCENE,
        MOST,
        manufacturing=MANUFACTURING,
        n_starts=args.begins,
        starts=4,
    )
    print(result.outcome)
    jacobian = result.sensitivity if result.feasible else np.full(len(unknowns), np.nan)
    rows = zip(unknowns, result.values, result.parameters.start, jacobian, strict=True)
    for each, value, before, slope in rows:
        unit = result.parameters.unit(each)
        message = f"{before:>9.3g} -> {value:.4g} {unit}, effort {slope:+.2g} N per {unit} more"
        print(f"  {each.name:<32}{message}")
    certified = sum(each.certificate.passed for each in result.plans)
    print(f"  {certified} of {len(result.plans)} plans certified")
    if args.search:
        best, values, met = search_globally(result, args.search)
        names = [unknown.name for k, unknown in enumerate(unknowns) if k in SEARCHED]
        at = ", ".join(f"{name} {x:.4g}" for name, x in zip(names, values, strict=True))
        print(
            f"  differential evolution: {met} arms meet all tasks, least effort {best:.4g} N: {at}"
        )
    path = args.out / "design.png"
    figure(result).savefig(path, dpi=110)
    print(f"figure: {path}")


if __name__ == "__main__":
    main()
