"""How far is the paper's arm off the one that its tasks would ask for?

Question: which taper, offsets and anchorages of the table 4 arm make a fetch and ten random tip
targets cheapest together, at equal tension limits; how much effort does that save, what is it
sensitive to, and does a global search of three of the numbers find better?

Assumptions: the paper's scene; a fetch whose three stretches bend by 60 degrees in planes turned
against each other; tips that the paper's arm reaches with moderate random tensions; effort is the
root of the sum of all squared tensions; a wall of 0.8 mm is left around each tendon.

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
from octoplan.planner import Design, ManufacturingLimits, Unknown, design, plan
from octoplan.planner.targets import Bend, Fetch, TipPosition
from studies.reporting import asked

SCENE, MOST = Scene(Extension()), 20.0
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
MAKING = ManufacturingLimits(wall=0.0008, spacing=0.05)
FETCH = Fetch(*(Bend(*np.radians(bend).tolist()) for bend in ((60, 0), (60, 180), (60, 90))))
# What a global search looks through: taper and places of the inner anchorages.
SEARCHED = (1, 5, 6)
# Of differential evolution; what stands for an arm that does not meet its tasks [N].
_GENERATIONS, _LOST = 8, 1e3
# Room over the arm's length that a limit which is kept to the last digit may lack.
_ROUNDING = 1e-6


def tips(count: int, seed: int = 0) -> list[TipPosition]:
    """Return random tips that the paper's arm reaches."""
    rng, arm = np.random.default_rng(seed), Arm.from_paper("table-4")
    pulls = [rng.uniform(0, 1, (3, 4)) ** 3 * PULLS for _ in range(count)]
    return [TipPosition(tuple(settle(arm, T, SCENE).tip.tolist())) for T in pulls]


def effort_of(result: Design, values: Array, starts: int) -> float:
    """Return the effort of the tasks by plans of an arm [N]; infinite unless it meets them all."""
    try:
        arm = result.parameters.setting(values).arm
        if MAKING.room(arm).min() < -_ROUNDING:
            return float("inf")
        plans = [plan(arm, p.targets, SCENE, MOST, starts=starts) for p in result.plans]
    except OctoplanError:
        return float("inf")
    met = all(p.certificate.passed for p in plans)
    return float(np.linalg.norm([p.effort for p in plans])) if met else float("inf")


def searched(outcome: Design, count: int, starts: int = 1) -> tuple[float, Array, int]:
    """Return the least effort [N] that differential evolution finds over three numbers, and these.

    Others are as designed; `count` arms are tried, of which the number that meet all tasks is told.
    """
    parameters, efforts = outcome.parameters, list[float]()
    kept = [k for k in SEARCHED if k < len(outcome.values)]

    def effort(share: Array) -> float:
        values = outcome.array
        values[kept] = parameters.lower[kept] + share * parameters.range[kept]
        efforts.append(effort_of(outcome, values, starts))
        return min(efforts[-1], _LOST)

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
            "--begins": (2, {"help": "arms that the search begins with"}),
            "--search": (72, {"help": "arms of the global search; 0: none"}),
            "--unknowns": (len(UNKNOWNS), {"help": "of those listed"}),
            "--out": Path("out"),
        },
    )
    arm, unknowns = Arm.from_paper("table-4"), UNKNOWNS[: args.unknowns]
    targets = [FETCH, *tips(args.tips)]
    result = design(
        arm, targets, unknowns, SCENE, MOST, manufacturing=MAKING, n_starts=args.begins, starts=4
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
        best, values, met = searched(result, args.search)
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
