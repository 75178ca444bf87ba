"""Does a plan follow a moving target in real time, certified at each step, without drifting?

Question: how long do a re-plan and its certificate take after a step of the target of 2 mm, along
random smooth paths inside of the reach, by machine code; is every step certified or honestly
refused; and do the tensions drift?

Assumptions: table 4, maxima 20 N, accuracy 1e-6. Paths are tips of shapes whose tensions swing, so
that all of them are in reach; half of the steps go ahead, half the same way back, so that what
drifts does not come back to where it began. A step is refused honestly if its outcome says why it
is not certified. Times are the processor's; other work on the machine still lengthens them, so that
the fastest tenth is told too.

Command: python -m studies.speed follow [--steps 10000] [--scenes paper silicone-in-water]
[--seed 0]

Answer: in studies/README.md.
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from itertools import islice

import numpy as np

from octoplan.model import Arm, Scene, settle
from octoplan.model.paths import Array
from octoplan.planner import plan
from octoplan.planner.plan_result import Plan
from octoplan.planner.targets import TipPosition
from studies.draws import MAXIMUM, SCENES
from studies.reporting import asked

_STEP, _ROUGH = 2e-3, 1e-7
# How fast tensions swing, and how far at most [N], tip section first.
_SWINGS, _SIZES = (0.2, 1.0), (0.3, 2.0, 5.0)
# Tensions at one target that differ by less, over their norm, are on one branch of optima.
_BRANCH = 1e-2


def path(arm: Arm, scene: Scene, rng: np.random.Generator) -> Iterator[Array]:
    """Yield tips (3,) [m] a step apart, of shapes under tensions that swing."""
    rates, phases = rng.uniform(*_SWINGS, 12), rng.uniform(0, 2 * np.pi, 12)
    sizes, t, dt = rng.uniform(size=12) * np.repeat(_SIZES, 4), 0.0, 1e-2
    here = np.full(3, np.inf)
    while True:
        pulls = sizes * np.maximum(np.sin(rates * t + phases), 0.0) ** 2
        tip = settle(arm, pulls, scene, _ROUGH, compile=True).tip
        gone = float(np.linalg.norm(tip - here))
        if np.isfinite(gone) and gone > 1.5 * _STEP:
            t, dt = t - dt / 2, dt / 2
            continue
        if np.isfinite(gone):
            dt *= min(1.3, _STEP / max(gone, 1e-9))
        here, t = tip, t + dt
        yield tip


def timed_plan(arm: Arm, scene: Scene, tip: Array, near: Plan | None) -> tuple[Plan, float, float]:
    """Return a plan, and the time of it and of its certificate [s]."""
    began = time.process_time()
    p = plan(arm, TipPosition(tip), scene, MAXIMUM, near=near, compile=True)
    planned = time.process_time()
    p.certificate  # noqa: B018  (found when it is asked for)
    return p, planned - began, time.process_time() - planned


def told(name: str, seconds: Sequence[float]) -> str:
    """Return percentiles of times as a row of a table, in ms."""
    low, middle, high = 1e3 * np.percentile(seconds, [10, 50, 99])
    return f"{name:<44}{low:8.2f}{middle:8.2f}{high:8.2f}"


def walk(name: str, steps: int, rng: np.random.Generator) -> None:
    """Follow a path there and back, and print what became of the steps."""
    arm, scene = Arm.from_paper("table-4"), SCENES[name]
    ahead = list(islice(path(arm, scene, rng), max(steps // 2, 2)))
    first, _, _ = timed_plan(arm, scene, ahead[0], None)
    p, plans, checks, jumps, refused = first, list[float](), list[float](), 0, list[str]()
    worst, failed, kept = 0.0, 0, [first.tensions]
    for tip in [*ahead[1:], *ahead[-2::-1]]:
        p, planned, checked = timed_plan(arm, scene, tip, p)
        plans.append(planned)
        checks.append(checked)
        jumps += p.solution.jump > 0
        kept.append(p.tensions)
        if p.reached:
            worst = max(worst, p.certificate.residual)
        elif p.certificate.failures or p.mode != "exact":
            refused.append(p.outcome)
        else:
            failed += 1
    print(told(f"{name}: warm re-plan", plans))
    print(told(f"{name}: its certificate", checks))
    print(told(f"{name}: both", np.add(plans, checks).tolist()))
    passed = len(plans) - len(refused) - failed
    print(f"  {len(plans)} steps: {passed} certified, worst residual {worst:.1e};", end="")
    print(f" {len(refused)} refused, {failed} neither; {jumps} left their branch")
    pairs = zip(kept, kept[::-1], strict=True)
    off = [np.abs(a - b).max() / max(float(np.linalg.norm(a)), 1e-9) for a, b in pairs]
    same = [change for change in off if change < _BRANCH]
    print(
        f"  drift: on the way back tensions are off by {max(same):.1e} of their norm at most",
        end="",
    )
    print(f" on the same branch, on which {len(same) / len(off):.0%} of the steps are")
    for why in sorted(set(refused))[:3]:
        print(f"  refused: {why}")


def main(argv: Sequence[str] | None = None) -> None:
    """Run the study and print its table."""
    args = asked(
        __doc__,
        argv,
        {
            "--steps": 200,
            "--scenes": (["paper"], {"choices": SCENES}),
            "--seed": 0,
        },
        prog="python -m studies.speed follow",
    )
    print(f"{'ms of the processor':<44}{'10 %':>8}{'median':>8}{'99 %':>8}")
    for name in args.scenes:
        walk(name, args.steps, np.random.default_rng(args.seed))
