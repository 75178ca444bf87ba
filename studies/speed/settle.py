"""How fast are settles and tip Jacobians, side by side with what users have today?

Question: how many times as long does SciPy take for the same work at the same verified error, for
one settle, for many, for the tip Jacobian and under loads; and how does the time grow with the
number of sections?

Assumptions: table 4, the paper's scene (loaded rows: with weight in water, or 2 mN at the tip),
random tensions that the arm bears (studies.draws). SciPy runs at the loosest tolerance from which
on its tips are verified to 1e-6 L, which a user does not know. Both sides run in turn in one
process, by processor time, so that a ratio depends little on what else the machine does; a
measurement is the median with its quartiles.

Command: python -m studies.speed settle [--rows settle jacobian loads sections] [--repeats 20]

Answer: in studies/README.md.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable, Sequence
from functools import partial

import numpy as np

from model import Arm, Scene, SnapError, settle, settle_many, tip_jacobian
from model.effects import Buoyancy, Extension, TipLoad, Weight
from model.paths import Array
from studies import draws
from studies.baselines import ScipyArm, ScipyLoadedArm
from studies.reporting import asked
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
G, TIP_FORCE = (0.0, 0.0, -9.81), (0.0, 0.0, -0.002)
LOADS = {
    "weight in water": (Scene(Extension(), Weight(), Buoyancy(1000.0)), (0.0, 0.0, 0.0), G, 1000.0),
    "2 mN at the tip": (Scene(Extension(), TipLoad(TIP_FORCE)), TIP_FORCE, (0.0, 0.0, 0.0), 0.0),
}


def loosest(tip: Callable[[float], Array], true: Array, length: float) -> float | None:
    """Return the loosest of RTOLS from which on tips are verified to ACCURACY, None if none is.

    One that is good where a tighter one is not is so by luck, which nobody can rely on.
    """
    result = None
    for rtol in reversed(RTOLS):
        if np.linalg.norm(tip(rtol) - true) > ACCURACY * length:
            break
        result = rtol
    return result


def settle_rows(arms: int, repeats: int, batch: int, rng: np.random.Generator) -> list[Row]:
    """Return one settle, and one of many, against DOP853 at the loosest rtol that is as good."""
    arm = Arm.from_paper("table-4")
    scipy, single, works, errors = ScipyArm(arm), [], [], []
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
    """Return the tip Jacobian against the cheapest differences over SciPy that are as good."""
    arm = Arm.from_paper("table-4")
    scale, errors = draws.most(arm), []
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
    """Return the finite differences with the fewest right-hand sides of those within a limit."""
    works = {}
    for rtol in (1e-4, 1e-5, 1e-6, 1e-7):
        for share, central in ((1e-6, False), (1e-4, True)):
            work = partial(scipy.tip_jacobian, T, rtol, share * scale, central)
            scipy.rhs = 0
            if _off(work(), true, scale) <= limit:
                works[scipy.rhs] = work
    return works[min(works)]


def loaded_rows(arms: int, repeats: int, rng: np.random.Generator) -> list[Row]:
    """Return loaded settles against shooting and collocation by SciPy, whichever is faster."""
    arm, rows = Arm.from_paper("table-4"), []
    for name, (scene, force, gravity, fluid) in LOADS.items():
        results: list[float] = []
        while len(results) < arms * repeats:
            T = draws.tensions(arm, rng)
            try:
                true = settle(arm, T, scene, 1e-10).tip
            except SnapError:
                continue
            scipy = ScipyLoadedArm(arm, np.array(force), np.array(gravity), fluid)
            works = _loaded_works(scipy, T, true)
            if not works:
                print(f"  {name}: SciPy did not settle {np.round(T, 3).tolist()}")
                continue
            theirs = min(works, key=seconds)
            results += ratios(partial(settle, arm, T, scene, ACCURACY), theirs, repeats)
        against = "SciPy shooting or solve_bvp"
        rows.append(Row(f"settle, {name}, 1e-6 L", against, "200", f"{Spread.of(results)}"))
    return rows


def _loaded_works(scipy: ScipyLoadedArm, T: Array, true: Array) -> list[Work]:
    """Return shooting and collocation at the loosest tolerances that are verified to ACCURACY."""
    works = []
    for way in (scipy.shoot, scipy.collocate):
        rtol = loosest(partial(way, T), true, scipy.arm.length)
        if rtol is not None:
            works.append(partial(way, T, rtol))
    return works


def growth_of_settle(counts: Sequence[int], repeats: int, rng: np.random.Generator) -> Row:
    """Return the power of the number of sections by which the time of a settle grows."""
    times = []
    for n in counts:
        arm = draws.many_sections(n)
        sets = draws.rows(arm, rng, 5)
        spreads = [repeated(partial(settle, arm, T, PAPER, ACCURACY), repeats) for T in sets]
        times.append(float(np.median([spread.median for spread in spreads])))
    return Row(f"settle, sections {counted(counts)}", "", "n^1.2", power(counts, times))


def tables(args: argparse.Namespace) -> Parts:
    """Return the parts of the table by name; each is measured when it is called."""
    n, arms = args.repeats, args.arms
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
            "--rows": (None, {"help": "parts of the table; all unless given", "nargs": "*"}),
            "--repeats": 20,
            "--arms": (5, {"help": "random sets of tensions a row"}),
            "--batch": 1000,
            "--sections": [3, 6, 12, 24],
            "--seed": 0,
        },
        prog="python -m studies.speed settle",
    )
    parts = tables(args)
    print_rows(parts, parts if args.rows is None else args.rows, args.seed)
