"""How fast is it, side by side with what users have today?

Question: how many times as long does SciPy take for the same work at the same verified error; how
does the time grow with the number of sections; and does the knob of `settle` keep its word?

Assumptions: table 4, the paper's scene (loaded rows: with weight in water, or 2 mN at the tip),
random tensions that the arm bears (studies.draws). SciPy runs at the loosest tolerance from which
on its tips are verified to 1e-6 L, which a user does not know. Both sides run in turn in one
process, so that a ratio does not depend on what else the machine does; a measurement is the median
with its quartiles.

Command: python -m studies.speed [--rows settle jacobian ...] [--repeats 20] [--plans 20]
[--knob 300]

Answer: settle 29 to 48, settle_many 160 (compiled 1000), tip Jacobian 150 (compiled 750), loaded
settles 14, cold certified plans 48, plans along a path 11 times as fast as the cold ones. A settle
grows as n^0.35 with the sections, a plan as n^1.3. Of 300 random settles none misses what was
asked, the worst is at a third of it; a third cost less than twice the cheapest single map that is
as good, the median 2.4 times.
"""

from __future__ import annotations

import argparse
import math
import subprocess
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import islice

import numpy as np

from model import Arm, OctoplanError, Scene, SnapError, settle, settle_many, tip_jacobian
from model.effects import Buoyancy, Extension, TipLoad, Weight
from model.forward import explicit_map, schemes_of
from model.paths import Array
from planner import Limits, Plan, Statement, plan
from planner.program.problem import build
from planner.solve.ipopt import solve
from planner.targets import TipPosition
from studies import draws, knob
from studies.baselines import ScipyArm, ScipyLoadedArm
from studies.timing import Spread, Work, machine, ratios, repeated, seconds, timed
from studies.tip_targets import MAXIMUM, draw

PAPER = Scene(Extension())
ACCURACY = 1e-6
RTOLS = (1e-3, 3e-4, 1e-4, 3e-5, 1e-5, 3e-6, 1e-6, 3e-7, 1e-7)
G, TIP_FORCE = (0.0, 0.0, -9.81), (0.0, 0.0, -0.002)
LOADS = {
    "weight in water": (Scene(Extension(), Weight(), Buoyancy(1000.0)), (0.0, 0.0, 0.0), G, 1000.0),
    "2 mN at the tip": (Scene(Extension(), TipLoad(TIP_FORCE)), TIP_FORCE, (0.0, 0.0, 0.0), 0.0),
}


@dataclass(frozen=True)
class Row:
    """One line of the table: what is measured against what, and what is wanted of it."""

    work: str
    against: str
    wanted: str
    measured: str


def loosest(tip: Callable[[float], Array], true: Array, length: float) -> float | None:
    """Return the loosest of RTOLS from which on tips are verified to ACCURACY, None if none is.

    One that is good where a tighter one is not is so by luck, which nobody can rely on.
    """
    found = None
    for rtol in reversed(RTOLS):
        if np.linalg.norm(tip(rtol) - true) > ACCURACY * length:
            break
        found = rtol
    return found


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
        found = []
        for _ in range(repeats):
            one = np.mean([seconds(work) for work in works])
            found.append(one * batch / seconds(many))
        name = f"settle_many, an arm of {batch}" + ", compiled" * machine_code
        rows.append(Row(name, "SciPy DOP853", wanted, f"{Spread.of(found)}"))
    return [*rows, Row("  worst verified error of settle [L]", "", "1e-6", f"{max(errors):.1e}")]


def jacobian_rows(arms: int, repeats: int, rng: np.random.Generator) -> list[Row]:
    """Return the tip Jacobian against the cheapest differences over SciPy that are as good."""
    arm = Arm.from_paper("table-4")
    scale, errors = draws.most(arm), []
    found: dict[bool, list[float]] = {False: [], True: []}
    for T in draws.rows(arm, rng, arms):
        true = tip_jacobian(arm, T, PAPER, 1e-11)[:3]
        errors.append(_off(tip_jacobian(arm, T, PAPER, ACCURACY)[:3], true, scale))
        limit = max(errors[-1], ACCURACY)
        theirs = _differences(ScipyArm(arm), T, scale, true, limit)
        for machine_code, values in found.items():
            exact = partial(tip_jacobian, arm, T, PAPER, ACCURACY, compile=machine_code)
            values += ratios(exact, theirs, repeats)
    name = f"tip Jacobian, {arm.n_tendons} tensions"
    rows = [
        Row(name + ", compiled" * c, "differences of DOP853", "1000", f"{Spread.of(values)}")
        for c, values in found.items()
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
        found: list[float] = []
        while len(found) < arms * repeats:
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
            found += ratios(partial(settle, arm, T, scene, ACCURACY), theirs, repeats)
        against = "SciPy shooting or solve_bvp"
        rows.append(Row(f"settle, {name}, 1e-6 L", against, "200", f"{Spread.of(found)}"))
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


def power(counts: Sequence[int], times: Sequence[float]) -> str:
    """Return the exponent of a fit in logarithms, with the times that it is through."""
    exponent = np.polyfit(np.log(counts), np.log(times), 1)[0]
    return f"n^{exponent:.2f} ({', '.join(f'{1e3 * t:.3g}' for t in times)} ms)"


def counted(counts: Sequence[int]) -> str:
    """Return the counts in words."""
    return ", ".join(map(str, counts))


_SCIPY_STARTS = 10
_FIRST = """
import time
begin = time.perf_counter()
from model import Arm, Scene
from model.effects import Extension
from planner import plan
from planner.targets import TipPosition
p = plan(Arm.from_paper("table-4"), TipPosition((0.20, 0.15, -0.20)), Scene(Extension()), 20.0)
assert p.certificate.passed
print(time.perf_counter() - begin)
"""


def planned(
    arm: Arm, point: Array, upper: float | Array = MAXIMUM, near: Plan | None = None
) -> Plan:
    """Return the plan of a tip position, with its certificate."""
    found = plan(arm, TipPosition(tuple(point)), PAPER, upper, near=near)
    _ = found.certificate
    return found


def cold_rows(plans: int, rng: np.random.Generator) -> list[Row]:
    """Return cold, certified plans against SLSQP from random starts until one leads there."""
    arm = Arm.from_paper("table-4")
    scipy, found, ours, theirs = ScipyArm(arm), [], [], []
    points = [draw(arm, PAPER, rng, i % 3) for i in range(plans)]
    planned(arm, points[0])
    for point in points:
        starts = rng.uniform(size=(_SCIPY_STARTS, 12)) * np.repeat([0.1, 0.5, 1.5], 4)

        own, mine = timed(partial(planned, arm, point))
        other, (_, solved) = timed(partial(scipy.plan_tip_from, point, MAXIMUM, starts))
        ours.append(mine.reached)
        theirs.append(solved)
        found.append(other / own)
    shares = f"{np.mean(ours):.1%} and {np.mean(theirs):.1%}"
    return [
        Row("plan of a tip, certified", "SLSQP, differences, DOP853", "300", f"{Spread.of(found)}"),
        Row(f"  solved of {plans}, ours and SciPy's", "", "no fewer", shares),
    ]


def warm_row(points: int, rng: np.random.Generator) -> Row:
    """Return plans along a path of the tip, each near the one before, against cold ones."""
    arm = Arm.from_paper("table-4")
    path = tip_path(arm, points, rng)
    before, found = planned(arm, path[0]), []
    for point in path[1:]:
        cold = seconds(partial(planned, arm, point))
        warm, before = timed(partial(planned, arm, point, near=before))
        if not before.certificate.passed:
            raise RuntimeError(f"no plan for the tip {point.tolist()} of the path")
        found.append(cold / warm)
    return Row(f"plans along {points} points, warm", "cold plans", "5", f"{Spread.of(found)}")


def tip_path(arm: Arm, count: int, rng: np.random.Generator) -> Array:
    """Return tips (count, 3) [m] of shapes on the way between two sets of tensions."""
    while True:
        begin, end = draws.rows(arm, rng, 2)
        shares = np.linspace(0, 1, count)[:, None]
        try:
            return np.array([settle(arm, T, PAPER).tip for T in begin + shares * (end - begin)])
        except OctoplanError:
            continue


def growth_of_plan(counts: Sequence[int], plans: int, rng: np.random.Generator) -> Row:
    """Return the power of the number of sections by which the time of a plan grows."""
    times = []
    for n in counts:
        arm = draws.many_sections(n)
        points = [settle(arm, T, PAPER).tip for T in draws.rows(arm, rng, plans)]
        upper = 3 * draws.most(arm)
        planned(arm, points[0], upper)
        taken = [seconds(partial(planned, arm, point, upper)) for point in points]
        times.append(float(np.median(taken)))
    return Row(f"plan, sections {counted(counts)}", "", "n^2", power(counts, times))


def first_row(repeats: int) -> Row:
    """Return the time of the first plan in a fresh process, import and build included."""
    command = [sys.executable, "-c", _FIRST]
    found = [
        float(subprocess.run(command, capture_output=True, text=True, check=True).stdout)
        for _ in range(repeats)
    ]
    return Row("first plan in a process [s]", "", "1.5", f"{Spread.of(found)}")


def floor_rows(repeats: int, rng: np.random.Generator) -> list[Row]:
    """Return what one evaluation and one iteration of ipopt cost, below which nothing can be."""
    arm = Arm.from_paper("table-4")
    T = draws.tensions(arm, rng)
    forward = explicit_map(arm, PAPER, schemes_of(PAPER)[0], 2)
    target, limits = (TipPosition(tuple(settle(arm, T, PAPER).tip)),), Limits.of(arm, MAXIMUM)
    problem = build(arm, target, PAPER, Statement(refinement=2))
    p, bounds = problem.parameters(target, limits), problem.bounds(limits)
    x = problem.guess(T, limits, p)
    evaluations = {
        "the forward map": lambda: forward.run(T),
        "constraints and their derivatives": lambda: problem.program.first(x, p),
    }
    rows = [
        Row(f"floor: {name} [us]", "", "", f"{_micro(repeated(work, repeats))}")
        for name, work in evaluations.items()
    ]
    iterations = []
    for start in islice(draws.endless(arm, rng), repeats):
        guess = problem.guess(start, limits, p)
        found = solve(problem, guess, p, bounds)
        taken = seconds(partial(solve, problem, guess, p, bounds))
        iterations.append(taken / max(found.iterations, 1))
    return [
        *rows,
        Row("floor: an iteration of ipopt [us]", "", "", f"{_micro(Spread.of(iterations))}"),
    ]


def _micro(spread: Spread) -> Spread:
    return Spread(1e6 * spread.low, 1e6 * spread.median, 1e6 * spread.high)


def tables(args: argparse.Namespace) -> dict[str, Callable[[np.random.Generator], list[Row]]]:
    """Return the parts of the table by name; each is measured when it is called."""
    n, arms = args.repeats, args.arms
    return {
        "settle": lambda rng: settle_rows(arms, n, args.batch, rng),
        "jacobian": lambda rng: jacobian_rows(arms, n, rng),
        "loads": lambda rng: loaded_rows(arms, n, rng),
        "sections": lambda rng: [
            growth_of_settle(args.sections, n, rng),
            growth_of_plan(args.sections, arms, rng),
        ],
        "plan": lambda rng: cold_rows(args.plans, rng),
        "path": lambda rng: [warm_row(args.points, rng)],
        "first": lambda rng: [first_row(min(n, 5))],
        "floors": lambda rng: floor_rows(n, rng),
    }


def main(argv: Sequence[str] | None = None) -> None:
    """Print the table, and what the knob does."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rows", nargs="*", help="parts of the table; all unless given")
    parser.add_argument("--repeats", type=int, default=20)
    parser.add_argument("--arms", type=int, default=5, help="random sets of tensions a row")
    parser.add_argument("--batch", type=int, default=1000)
    parser.add_argument("--plans", type=int, default=20)
    parser.add_argument("--points", type=int, default=100)
    parser.add_argument("--sections", type=int, nargs="*", default=[3, 6, 12, 24])
    parser.add_argument("--knob", type=int, default=0, help="random cases for the knob")
    parser.add_argument("--seed", type=int, default=0)
    args = parser.parse_args(argv)
    print(machine())
    parts = tables(args)
    print(f"{'work':<42}{'against':<28}{'wanted':>9}  measured: median (quartiles)")
    for name in parts if args.rows is None else args.rows:
        for row in parts[name](np.random.default_rng(args.seed)):
            print(f"{row.work:<42}{row.against:<28}{row.wanted:>9}  {row.measured}", flush=True)
    if args.knob:
        knob.report(knob.run(args.knob, np.random.default_rng(args.seed)))


if __name__ == "__main__":
    main()
