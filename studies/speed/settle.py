"""How fast are equilibria and tip Jacobians compared with SciPy?

Questions: How much longer does SciPy take at the same verified error, for one equilibrium, for a
batch, for the tip Jacobian and under loads? How does the time grow with the number of sections?

Assumptions: The arm of table 4, the paper's scene (rows with loads: weight in water, or 2 mN at the
tip), random tensions (studies.draws). SciPy uses the loosest tolerance for which its tips are
verified to 1e-6 L; a user would have to find this tolerance first. Both programs run in turn in one
process, measured in processor time, so that ratios hardly depend on other processes. Results are
medians with quartiles.

Command: python -m studies.speed settle [--rows settle jacobian loads sections] [--repeats 20]

Answer: in studies/README.md.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from octoplan.model import Arm, Scene, SnapError, settle, settle_many, tip_jacobian
from octoplan.model.effects import (
    Buoyancy,
    Current,
    ExactTendons,
    Extension,
    NeoHookean,
    PointLoad,
    Shear,
    TipLoad,
    Weight,
)
from octoplan.model.effects.base import Effect
from octoplan.model.extensions.friction import Friction
from octoplan.model.paths import Array
from octoplan.planner.frontends.effect_ablation import Switch, switch_effect
from studies import draws
from studies.baselines import ScipyArm, ScipyLoadedArm
from studies.reporting import asked, lettered
from studies.speed.timing import (
    Parts,
    Row,
    Spread,
    Work,
    counted,
    power,
    print_rows,
    ratios,
    repeated,
    seconds,
)

PAPER = Scene(Extension())
ACCURACY = 1e-6
RTOLS = (1e-3, 3e-4, 1e-4, 3e-5, 1e-5, 3e-6, 1e-6, 3e-7, 1e-7)
G = (0.0, 0.0, -9.81)
TIP_FORCE = (0.0, 0.0, -0.002)
LOADS = {
    "weight in water": (Scene(Extension(), Weight(), Buoyancy(1000.0)), (0.0, 0.0, 0.0), G, 1000.0),
    "2 mN at the tip": (Scene(Extension(), TipLoad(TIP_FORCE)), TIP_FORCE, (0.0, 0.0, 0.0), 0.0),
}


def loosest(tip: Callable[[float], Array], true: Array, length: float) -> float | None:
    """Return the loosest of RTOLS for which tips are verified to ACCURACY, or None.

    All tighter tolerances must be sufficient, too, so that no tolerance passes by chance.
    """
    result = None
    for rtol in reversed(RTOLS):
        if np.linalg.norm(tip(rtol) - true) > ACCURACY * length:
            break
        result = rtol
    return result


def settle_rows(arms: int, repeats: int, batch: int, rng: np.random.Generator) -> list[Row]:
    """Compare one equilibrium and a batch with DOP853 at the loosest sufficient tolerance."""
    arm = Arm.from_paper("table-4")
    scipy = ScipyArm(arm)
    single = []
    works = []
    errors = []
    for T in draws.rows(arm, rng, arms):
        true = settle(arm, T, PAPER, 1e-11).tip
        errors.append(math.dist(settle(arm, T, PAPER, ACCURACY).tip, true) / arm.length)
        rtol = loosest(partial(scipy.tip, T, "DOP853"), true, arm.length)
        assert rtol is not None
        works.append(partial(scipy.tip, T, "DOP853", rtol))
        single += ratios(partial(settle, arm, T, PAPER, ACCURACY), works[-1], repeats)
    rows = [Row("settle, 1e-6 L", "SciPy DOP853", "60", f"{Spread.of(single)}")]
    sets = draws.rows(arm, rng, batch)
    for machine_code, wanted in ((False, "300"), (True, "1500")):
        many = partial(settle_many, arm, sets, PAPER, ACCURACY, compile=machine_code)
        many()
        results = []
        for _ in range(repeats):
            one = np.mean([seconds(work) for work in works])
            results.append(one * batch / seconds(many))
        name = f"settle_many, an arm of {batch}" + ", compiled" * machine_code
        rows.append(Row(name, "SciPy DOP853", wanted, f"{Spread.of(results)}"))
    return [*rows, Row("  worst verified error of settle [L]", "", "1e-6", f"{max(errors):.1e}")]


def jacobian_rows(arms: int, repeats: int, rng: np.random.Generator) -> list[Row]:
    """Compare the tip Jacobian with the cheapest sufficient finite differences over SciPy."""
    arm = Arm.from_paper("table-4")
    scale = draws.most(arm)
    errors = []
    entries: dict[bool, list[float]] = {False: [], True: []}
    for T in draws.rows(arm, rng, arms):
        true = tip_jacobian(arm, T, PAPER, 1e-11)[:3]
        errors.append(_off(tip_jacobian(arm, T, PAPER, ACCURACY)[:3], true, scale))
        limit = max(errors[-1], ACCURACY)
        theirs = _differences(ScipyArm(arm), T, scale, true, limit)
        for machine_code, values in entries.items():
            exact = partial(tip_jacobian, arm, T, PAPER, ACCURACY, compile=machine_code)
            values += ratios(exact, theirs, repeats)
    name = f"tip Jacobian, {arm.n_tendons} tensions"
    rows = [
        Row(name + ", compiled" * c, "differences of DOP853", "1000", f"{Spread.of(values)}")
        for c, values in entries.items()
    ]
    return [*rows, Row("  its worst error, relative", "", "", f"{max(errors):.1e}")]


def _off(J: Array, true: Array, scale: Array) -> float:
    return float(np.linalg.norm((J - true) * scale) / np.linalg.norm(true * scale))


def _differences(scipy: ScipyArm, T: Array, scale: Array, true: Array, limit: float) -> Work:
    """Return the finite differences with the fewest right-hand sides and an error below `limit`."""
    works = {}
    for rtol in (1e-4, 1e-5, 1e-6, 1e-7):
        for share, central in ((1e-6, False), (1e-4, True)):
            work = partial(scipy.tip_jacobian, T, rtol, share * scale, central)
            scipy.rhs = 0
            if _off(work(), true, scale) <= limit:
                works[scipy.rhs] = work
    return works[min(works)]


def loaded_rows(arms: int, repeats: int, rng: np.random.Generator) -> list[Row]:
    """Compare equilibria under loads with SciPy's shooting at the loosest sufficient tolerance."""
    arm = Arm.from_paper("table-4")
    rows = []
    for name, (scene, force, gravity, fluid) in LOADS.items():
        results: list[float] = []
        while len(results) < arms * repeats:
            T = draws.tensions(arm, rng)
            try:
                true = settle(arm, T, scene, 1e-10).tip
            except SnapError:
                continue
            shoot = ScipyLoadedArm(arm, np.array(force), np.array(gravity), fluid).shoot
            rtol = loosest(partial(shoot, T), true, arm.length)
            if rtol is None:
                print(f"  {name}: SciPy did not converge for {np.round(T, 3).tolist()}")
                continue
            theirs = partial(shoot, T, rtol)
            results += ratios(partial(settle, arm, T, scene, ACCURACY), theirs, repeats)
        rows.append(
            Row(f"settle, {name}, 1e-6 L", "SciPy shooting", "200", f"{Spread.of(results)}")
        )
    return rows


def growth_of_settle(counts: Sequence[int], repeats: int, rng: np.random.Generator) -> Row:
    """Return the exponent of the growth of the time of `settle` with the number of sections."""
    times = []
    for n in counts:
        arm = draws.many_sections(n)
        sets = draws.rows(arm, rng, 5)
        spreads = [repeated(partial(settle, arm, T, PAPER, ACCURACY), repeats) for T in sets]
        times.append(float(np.median([spread.median for spread in spreads])))
    return Row(f"settle, sections {counted(counts)}", "", "n^1.2", power(counts, times))


def tables(args: argparse.Namespace) -> Parts:
    """Return the parts of the table by name; each call measures a part."""
    n = args.repeats
    arms = args.arms
    return {
        "settle": lambda rng: settle_rows(arms, n, args.batch, rng),
        "jacobian": lambda rng: jacobian_rows(arms, n, rng),
        "loads": lambda rng: loaded_rows(arms, n, rng),
        "sections": lambda rng: [growth_of_settle(args.sections, n, rng)],
    }


def main(argv: Sequence[str] | None = None) -> None:
    """Print the table."""
    args = asked(
        __doc__,
        argv,
        {
            "--rows": (None, {"help": "parts of the table; default: all", "nargs": "*"}),
            "--repeats": 20,
            "--arms": (5, {"help": "number of random sets of tensions for each row"}),
            "--batch": 1000,
            "--sections": [3, 6, 12, 24],
            "--seed": 0,
        },
        prog="python -m studies.speed settle",
    )
    parts = tables(args)
    print_rows(parts, parts if args.rows is None else args.rows, args.seed)


_COLOURS = ("#1f6fb4", "#e8912c")
FIGURES = {
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


def switch_effects(case: str, labels: Sequence[str], repeats: int) -> dict[str, Switch]:
    """Return the change of the shape and the cost for each effect, in one case."""
    name, T = FIGURES[case]
    arm = Arm.from_paper(name)
    scenes = {label: Scene(*PAPER.effects, *EFFECTS[label]) for label in labels}
    return {
        label: switch_effect(arm, T, PAPER, scene, EFFECTS[label][0], repeats=repeats)
        for label, scene in scenes.items()
    }


def draw(tables: dict[str, dict[str, Switch]]) -> Figure:
    """Return the figure: one row for each effect, one colour for each case."""
    figure = Figure(figsize=(9, 4.0), layout="constrained")
    left, right = figure.subplots(1, 2, sharey=True)
    titles = ("change of the tip", "time of settle")
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
    left.set(xscale="log", xlabel="distance of the tips [L]")
    right.set(xscale="log", xlabel="time relative to the paper's scene")
    right.legend(frameon=False, loc="upper right")
    return figure


def effects(argv: Sequence[str] | None = None) -> None:
    """How much does each effect change the paper's shapes, and what does it cost?

    Questions: How far do the effects, each alone and all together, move the tips of the bend of
    figure 11(b) and of the fetch of figure 15? By which factor does the time of `settle` grow?

    Assumptions: The tensions of tables 3 and 5. Each effect is added to the paper's scene
    (extension only) with the values of EFFECTS, which are typical of a laboratory tank. The
    accuracy is 1e-6. Times are medians of ratios, measured in turn with and without the effect.

    Command: python -m studies.speed effects [--effects NAME ...] [--repeats 5] [--out out]

    Answer: in studies/README.md.
    """
    args = asked(
        effects.__doc__,
        argv,
        {
            "--effects": (list(EFFECTS), {"choices": EFFECTS}),
            "--repeats": 5,
            "--out": Path("out"),
        },
        prog="python -m studies.speed effects",
    )
    tables = {case: switch_effects(case, args.effects, args.repeats) for case in FIGURES}
    for case, table in tables.items():
        print(f"\n{case}: effects added to the paper's scene")
        print(f"{'effect':<28}{'tip [L]':>10}{'states':>8}{'unknowns':>10}{'instr.':>9}{'time':>8}")
        for label, switch in table.items():
            more = switch.sizes.instructions / switch.sizes_without.instructions
            print(
                f"{label:<28}{switch.tip_change:>10.1e}{switch.states_added:>+8}"
                f"{switch.sizes.unknowns:>+10}{more:>8.3g}x{switch.time_factor:>7.3g}x"
                f"{'  ' + switch.problem if switch.problem else ''}"
            )
    draw(tables).savefig(args.out / "effects_cost.png", dpi=110)
