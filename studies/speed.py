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
from collections.abc import Callable, Sequence

import numpy as np

from studies import knob, speed_plan, speed_settle
from studies.speed_settle import Row
from studies.timing import machine


def tables(args: argparse.Namespace) -> dict[str, Callable[[np.random.Generator], list[Row]]]:
    """Return the parts of the table by name; each is measured when it is called."""
    n, arms = args.repeats, args.arms
    return {
        "settle": lambda rng: speed_settle.settle_rows(arms, n, args.batch, rng),
        "jacobian": lambda rng: speed_settle.jacobian_rows(arms, n, rng),
        "loads": lambda rng: speed_settle.loaded_rows(arms, n, rng),
        "sections": lambda rng: [
            speed_settle.growth_of_settle(args.sections, n, rng),
            speed_plan.growth_of_plan(args.sections, arms, rng),
        ],
        "plan": lambda rng: speed_plan.cold_rows(args.plans, rng),
        "path": lambda rng: [speed_plan.warm_row(args.points, rng)],
        "first": lambda rng: [speed_plan.first_row(min(n, 5))],
        "floors": lambda rng: speed_plan.floor_rows(n, rng),
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
