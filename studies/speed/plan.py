"""How fast are certified plans compared with SciPy?

Questions: How much longer does SciPy take for a cold plan (SLSQP with finite differences of DOP853,
from random starts until one succeeds)? How long does a plan take in each scene? How much faster is
a plan that is warm-started from the previous one? How does the time grow with the number of
sections, and how long does the first plan of a process take?

Assumptions: The arm of table 4, the paper's scene unless another is named, reachable tips
(studies.draws). The times of octoplan include certificates. Both programs run in turn in one
process, measured in processor time. Results are medians with quartiles.

Command: python -m studies.speed plan [--rows cold scenes path sections first] [--plans 20]

Answer: in studies/README.md.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
from collections.abc import Sequence
from functools import partial

import numpy as np

from octoplan.model import Arm, OctoplanError, Scene, settle
from octoplan.model.paths import Array
from octoplan.planner import Plan, plan
from octoplan.planner.targets import TipPosition
from studies import draws
from studies.baselines import ScipyArm
from studies.reporting import asked
from studies.speed.timing import Parts, Row, Spread, counted, power, print_rows, seconds, timed

PAPER = draws.SCENES["paper"]
_SCIPY_STARTS = 10
_FIRST = """
import time
begin = time.perf_counter()
from octoplan.model import Arm, Scene
from octoplan.model.effects import Extension
from octoplan.planner import plan
from octoplan.planner.targets import TipPosition
p = plan(Arm.from_paper("table-4"), TipPosition((0.20, 0.15, -0.20)), Scene(Extension()), 20.0)
assert p.certificate.passed
print(time.perf_counter() - begin)
"""


def planned(
    arm: Arm,
    point: Array,
    upper: float | Array = draws.MAXIMUM,
    near: Plan | None = None,
    scene: Scene = PAPER,
) -> Plan:
    """Return the plan of a tip position, with its certificate evaluated."""
    result = plan(arm, TipPosition(tuple(point)), scene, upper, near=near)
    _ = result.certificate
    return result


def cold_rows(plans: int, rng: np.random.Generator) -> list[Row]:
    """Compare cold, certified plans with SLSQP from random starts until one succeeds."""
    arm = Arm.from_paper("table-4")
    scipy = ScipyArm(arm)
    results = []
    ours = []
    theirs = []
    points = [draws.shape(arm, PAPER, rng, i % 3).tip for i in range(plans)]
    planned(arm, points[0])
    for point in points:
        starts = rng.uniform(size=(_SCIPY_STARTS, 12)) * np.repeat([0.1, 0.5, 1.5], 4)

        values, mine = timed(partial(planned, arm, point))
        other, (_, solved) = timed(partial(scipy.plan_tip_from, point, draws.MAXIMUM, starts))
        ours.append(mine.reached)
        theirs.append(solved)
        results.append(other / values)
    shares = f"{np.mean(ours):.1%} and {np.mean(theirs):.1%}"
    return [
        Row(
            "plan of a tip, certified", "SLSQP, differences, DOP853", "300", f"{Spread.of(results)}"
        ),
        Row(f"  solved of {plans}, ours and SciPy's", "", "no fewer", shares),
    ]


def scene_rows(plans: int, rng: np.random.Generator) -> list[Row]:
    """Return the times of cold, certified plans in each scene, and the number certified."""
    arm = Arm.from_paper("table-4")
    rows = []
    for name, scene in draws.SCENES.items():
        points = [draws.shape(arm, scene, rng, i % 3).tip for i in range(plans)]
        planned(arm, points[0], scene=scene)
        results = [timed(partial(planned, arm, point, scene=scene)) for point in points]
        good = sum(each.reached for _, each in results)
        took = Spread.of([seconds for seconds, _ in results])
        rows.append(Row(f"{name}: a certified plan [s]", "", "", f"{took}; {good} of {plans}"))
    return rows


def warm_row(points: int, rng: np.random.Generator) -> Row:
    """Compare plans along a path, each warm-started from the previous one, with cold plans."""
    arm = Arm.from_paper("table-4")
    path = tip_path(arm, points, rng)
    before = planned(arm, path[0])
    results = []
    for point in path[1:]:
        cold = seconds(partial(planned, arm, point))
        warm, before = timed(partial(planned, arm, point, near=before))
        if not before.certificate.passed:
            raise RuntimeError(f"no plan for the tip {point.tolist()} of the path")
        results.append(cold / warm)
    return Row(f"plans along {points} points, warm", "cold plans", "5", f"{Spread.of(results)}")


def tip_path(arm: Arm, count: int, rng: np.random.Generator) -> Array:
    """Return tips (count, 3) [m] of shapes between two random sets of tensions."""
    while True:
        begin, end = draws.rows(arm, rng, 2)
        shares = np.linspace(0, 1, count)[:, None]
        try:
            return np.array([settle(arm, T, PAPER).tip for T in begin + shares * (end - begin)])
        except OctoplanError:
            continue


def growth_of_plan(counts: Sequence[int], plans: int, rng: np.random.Generator) -> Row:
    """Return the exponent of the growth of the planning time with the number of sections."""
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
    """Return the time of the first plan in a new process, including import and build."""
    command = [sys.executable, "-c", _FIRST]
    results = [
        float(subprocess.run(command, capture_output=True, text=True, check=True).stdout)
        for _ in range(repeats)
    ]
    return Row("first plan in a process [s]", "", "1.5", f"{Spread.of(results)}")


def tables(args: argparse.Namespace) -> Parts:
    """Return the parts of the table by name; each call measures a part."""
    return {
        "cold": lambda rng: cold_rows(args.plans, rng),
        "scenes": lambda rng: scene_rows(args.plans, rng),
        "path": lambda rng: [warm_row(args.points, rng)],
        "sections": lambda rng: [growth_of_plan(args.sections, args.arms, rng)],
        "first": lambda rng: [first_row(args.processes)],
    }


def main(argv: Sequence[str] | None = None) -> None:
    """Print the table."""
    args = asked(
        __doc__,
        argv,
        {
            "--rows": (None, {"help": "parts of the table; default: all", "nargs": "*"}),
            "--plans": 20,
            "--points": 100,
            "--arms": (5, {"help": "number of tips for each number of sections"}),
            "--processes": (5, {"help": "number of processes for the first plan"}),
            "--sections": [3, 6, 12, 24],
            "--seed": 0,
        },
        prog="python -m studies.speed plan",
    )
    parts = tables(args)
    print_rows(parts, parts if args.rows is None else args.rows, args.seed)
