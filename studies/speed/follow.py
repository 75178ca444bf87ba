"""Does a plan follow a moving target in real time, certified at each step, without drift?

Questions: How long do a new plan and its certificate take after the target moves by 2 mm, along
random smooth reachable paths, with compiled functions? Is each step certified or refused with a
reason? Do the tensions drift?

Assumptions: The arm of table 4, tensions up to 20 N, accuracy 1e-6. The targets are the tips of
shapes with slowly oscillating tensions, so that all targets are reachable. The second half of the
steps follows the path back to its beginning, so that drift is visible as a difference of the
tensions. Times are processor times. Other processes still lengthen them; therefore the table
contains the 10 % quantile, too.

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

# Distance between two targets [m].
_STEP = 2e-3
# Accuracy of the shapes whose tips are the targets.
_ACCURACY = 1e-7
# Range of the angular rates of the oscillating tensions.
_RATES = (0.2, 1.0)
# Largest amplitudes of the tensions [N], tip section first.
_AMPLITUDES = (0.3, 2.0, 5.0)
# Relative difference below which tensions at the same target are on one branch of optima.
_BRANCH = 1e-2


def path(arm: Arm, scene: Scene, rng: np.random.Generator) -> Iterator[Array]:
    """Yield tips (3,) [m] at distances of one step, of shapes under oscillating tensions."""
    rates = rng.uniform(*_RATES, 12)
    phases = rng.uniform(0, 2 * np.pi, 12)
    amplitudes = rng.uniform(size=12) * np.repeat(_AMPLITUDES, 4)
    t = 0.0
    dt = 1e-2
    here = np.full(3, np.inf)
    while True:
        T = amplitudes * np.maximum(np.sin(rates * t + phases), 0.0) ** 2
        tip = settle(arm, T, scene, _ACCURACY, compile=True).tip
        gone = float(np.linalg.norm(tip - here))
        if np.isfinite(gone) and gone > 1.5 * _STEP:
            t = t - dt / 2
            dt = dt / 2
            continue
        if np.isfinite(gone):
            dt *= min(1.3, _STEP / max(gone, 1e-9))
        here = tip
        t = t + dt
        yield tip


def timed_plan(arm: Arm, scene: Scene, tip: Array, near: Plan | None) -> tuple[Plan, float, float]:
    """Return a plan, its planning time and the time of its certificate [s]."""
    began = time.process_time()
    p = plan(
        arm,
        TipPosition(tip),
        scene,
        MAXIMUM,
        near=near,
        compile=True,
        certify=False,
    )
    planned = time.process_time()
    p.certificate  # noqa: B018  (computed at the first access)
    return p, planned - began, time.process_time() - planned


def table_row(name: str, seconds: Sequence[float]) -> str:
    """Return a row of the table: percentiles of times [ms]."""
    low, middle, high = 1e3 * np.percentile(seconds, [10, 50, 99])
    return f"{name:<44}{low:8.2f}{middle:8.2f}{high:8.2f}"


def walk(name: str, steps: int, rng: np.random.Generator) -> None:
    """Follow a path and return along it; print times, certificates and drift."""
    arm = Arm.from_paper("table-4")
    scene = SCENES[name]
    ahead = list(islice(path(arm, scene, rng), max(steps // 2, 2)))
    first, _, _ = timed_plan(arm, scene, ahead[0], None)
    p = first
    plans = list[float]()
    checks = list[float]()
    jumps = 0
    refused = list[str]()
    worst = 0.0
    failed = 0
    kept = [first.tensions]
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
    print(table_row(f"{name}: new plan, warm-started", plans))
    print(table_row(f"{name}: certificate", checks))
    print(table_row(f"{name}: plan and certificate", np.add(plans, checks).tolist()))
    passed = len(plans) - len(refused) - failed
    print(f"  {len(plans)} steps: {passed} certified, worst residual {worst:.1e};", end="")
    print(f" {len(refused)} refused with a reason, {failed} without; {jumps} left their branch")
    pairs = zip(kept, kept[::-1], strict=True)
    off = [np.abs(a - b).max() / max(float(np.linalg.norm(a)), 1e-9) for a, b in pairs]
    same = [change for change in off if change < _BRANCH]
    print(
        f"  drift: on the way back tensions differ by at most {max(same):.1e} of their norm",
        end="",
    )
    print(f" in the {len(same) / len(off):.0%} of the steps on the same branch")
    for why in sorted(set(refused))[:3]:
        print(f"  refused: {why}")


def main(argv: Sequence[str] | None = None) -> None:
    """Print the table."""
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
    print(f"{'processor time [ms]':<44}{'10 %':>8}{'median':>8}{'99 %':>8}")
    for name in args.scenes:
        walk(name, args.steps, np.random.default_rng(args.seed))
