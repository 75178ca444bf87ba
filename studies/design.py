"""How far is the paper's arm off the one that its tasks would ask for?

Question: which taper, offsets and anchorages of the table 4 arm make ten random tip targets
cheapest together, at equal tension limits, and how much effort does that save?

Assumptions: the paper's scene; tips that the paper's arm reaches with moderate random tensions;
effort is the root of the sum of all squared tensions; a wall of 0.8 mm is left around each tendon.

Command: python -m studies.design [--tips 10] [--begins 2] [--out out]

Answer: for four tips (--tips 4 --begins 1) an arm 10 mm thick at its base in place of 15, with all
tendons as far out as the wall allows and the inner anchorages at 183 and 326 mm in place of 135 and
315, takes 0.38 N in place of 2.65: 86 % less; all plans are certified. The thickness is at its
bound: what the tasks ask for is a softer arm, until loads or stiffness are asked of it as well.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from model import Arm, Scene, settle
from model.effects import Extension
from planner import Design, Making, Unknown, design
from planner.targets import TipPosition

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
MAKING = Making(wall=0.0008, spacing=0.05)


def tips(count: int, seed: int = 0) -> list[TipPosition]:
    """Return random tips that the paper's arm reaches."""
    rng, arm = np.random.default_rng(seed), Arm.from_paper("table-4")
    pulls = [rng.uniform(0, 1, (3, 4)) ** 3 * PULLS for _ in range(count)]
    return [TipPosition(tuple(settle(arm, T, SCENE).tip.tolist())) for T in pulls]


def figure(found: Design) -> Figure:
    """Draw the effort of each task, before and after."""
    whole = Figure(figsize=(5.6, 3.2), layout="constrained")
    ax = whole.add_subplot()
    at = np.arange(len(found.plans))
    ax.bar(at - 0.2, [own.effort for own in found.before], 0.4, label="the paper's arm")
    ax.bar(at + 0.2, [own.effort for own in found.plans], 0.4, label="designed")
    ax.set_xlabel("task")
    ax.set_ylabel("effort [N]")
    ax.legend()
    return whole


def main(argv: Sequence[str] | None = None) -> None:
    """Print the design and save the figure."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--tips", type=int, default=10)
    parser.add_argument("--begins", type=int, default=2, help="arms that the search begins with")
    parser.add_argument("--unknowns", type=int, default=len(UNKNOWNS), help="of those listed")
    parser.add_argument("--out", type=Path, default=Path("out"))
    args = parser.parse_args(argv)
    arm, unknowns = Arm.from_paper("table-4"), UNKNOWNS[: args.unknowns]
    targets = tips(args.tips)
    found = design(arm, targets, unknowns, SCENE, MOST, making=MAKING, begins=args.begins, starts=4)
    print(found.outcome)
    for own, value, before in zip(unknowns, found.values, found.parameters.start, strict=True):
        print(f"  {own.name:<32}{before:>9.3g} -> {value:.4g} {found.parameters.unit(own)}")
    certified = sum(own.certificate.passed for own in found.plans)
    print(f"  {certified} of {len(found.plans)} plans certified")
    args.out.mkdir(parents=True, exist_ok=True)
    path = args.out / "design.png"
    figure(found).savefig(path, dpi=110)
    print(f"figure: {path}")


if __name__ == "__main__":
    main()
