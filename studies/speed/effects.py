"""What does each effect do to the paper's shapes, and what does it cost?

Question: by how much does each effect, alone and all together, move the tip of the bending of
figure 11(b) and of the fetch of figure 15, and by what factor does a settle take longer?

Assumptions: the tensions of tables 3 and 5; each effect is added to the paper's scene (extension
alone) with the values listed in EFFECTS, which are those of a laboratory tank; accuracy 1e-6;
times are medians of ratios, with and without the effect in turn.

Command: python -m studies.speed effects [--effects NAME ...] [--repeats 5] [--out out]

Answer: in studies/README.md.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from model import Arm, Scene
from model.effects import (
    Buoyancy,
    Current,
    Effect,
    ExactTendons,
    Extension,
    Friction,
    NeoHookean,
    PointLoad,
    Shear,
    TipLoad,
    Weight,
)
from planner.effect_ablation import Switch, switch_on
from studies.reporting import asked, lettered

PAPER = Scene(Extension())
_COLOURS = ("#1f6fb4", "#e8912c")
CASES = {
    "figure 11(b)": ("table-2", [[1, np.sqrt(3), 0, 0], [0] * 4, [0] * 4]),
    "figure 15": ("table-4", [[0, 0, 0.5, 0], [4, 0, 0, 0], [0, 13, 0, 0]]),
}
EFFECTS: dict[str, tuple[Effect, ...]] = {
    "exact tendons": (ExactTendons(),),
    "neo-Hookean, exact tendons": (NeoHookean(), ExactTendons()),
    "shear": (Shear(),),
    "weight in air": (Weight(),),
    "weight in water": (Weight(), Buoyancy(1000.0)),
    "2 mN at the tip": (TipLoad((0.0, 0.0, -0.002)),),
    "2 mN following the tip": (TipLoad((0.0, 0.002, 0.0), follower=True),),
    "5 mN at half length": (PointLoad(0.225, (0.0, 0.0, -0.005)),),
    "current of 0.1 m/s": (Current((0.0, 0.0, -0.1)),),
    "friction of 0.1": (Friction(0.1),),
    "all together": (
        ExactTendons(),
        NeoHookean(),
        Shear(),
        Weight(),
        Buoyancy(1000.0),
        TipLoad((0.0, 0.0, -0.002)),
        PointLoad(0.225, (0.0, 0.0, -0.005)),
        Current((0.0, 0.0, -0.1)),
        Friction(0.1),
    ),
}


def measure(case: str, labels: Sequence[str], repeats: int) -> dict[str, Switch]:
    """Return what effects do to a case and cost, each row by itself."""
    name, T = CASES[case]
    arm = Arm.from_paper(name)
    return {label: switch_on(arm, T, PAPER, EFFECTS[label], repeats=repeats) for label in labels}


def draw(tables: dict[str, dict[str, Switch]]) -> Figure:
    """Return the figure: a row for each effect, a colour for each case."""
    figure = Figure(figsize=(9, 4.0), layout="constrained")
    left, right = figure.subplots(1, 2, sharey=True)
    titles = ("how far it moves the tip", "how much longer a settle takes")
    lettered(zip((left, right), titles, strict=True))
    names = list(next(iter(tables.values())))
    for (case, table), colour in zip(tables.items(), _COLOURS, strict=True):
        rows = range(len(names))
        for ax, values in (
            (left, [table[name].tip_change for name in names]),
            (right, [table[name].time_factor for name in names]),
        ):
            ax.plot(values, rows, "o", color=colour, markersize=6, alpha=0.85, label=case)
    left.set_yticks(range(len(names)), names)
    left.invert_yaxis()
    left.set(xscale="log", xlabel="tip moves by [L]")
    right.set(xscale="log", xlabel="time over that of the paper's scene")
    right.legend(frameon=False, loc="upper right")
    return figure


def main(argv: Sequence[str] | None = None) -> None:
    """Print the table and save the figure."""
    args = asked(
        __doc__,
        argv,
        {
            "--effects": (list(EFFECTS), {"choices": EFFECTS}),
            "--repeats": 5,
            "--out": Path("out"),
        },
        prog="python -m studies.speed effects",
    )
    tables = {case: measure(case, args.effects, args.repeats) for case in CASES}
    for case, table in tables.items():
        print(f"\n{case}: what is added to the paper's scene")
        print(f"{'effect':<28}{'tip [L]':>10}{'states':>8}{'unknowns':>10}{'instr.':>9}{'time':>8}")
        for label, switch in table.items():
            more = switch.sizes.instructions / switch.sizes_without.instructions
            print(
                f"{label:<28}{switch.tip_change:>10.1e}{switch.states_added:>+8}"
                f"{switch.sizes.unknowns:>+10}{more:>8.3g}x{switch.time_factor:>7.3g}x"
                f"{'  ' + switch.problem if switch.problem else ''}"
            )
    draw(tables).savefig(args.out / "effects_cost.png", dpi=110)
