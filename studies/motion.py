"""How long does the paper's fetch take as a motion, and what does it cost?

Questions: The arm of table 4 reaches for an object, bends, and moves the object to the mouth. How
long does this take at a given rate of tension, compared with a lower bound? How much effort does a
slower motion need, is any limit exceeded at any time, and how long does the planner take for each
waypoint?

Assumptions: The paper's scene. The object is 300 mm ahead and 120 mm to the side. The mouth is the
centre of the base, which the tip reaches as in figure 14, with three bends of at least 30 degrees
in a plane. Each tendon pulls up to 13 N, with up to 5 N/s. A motion through several targets takes
at least as long as the slowest motion from rest to one of the targets; this is the lower bound.

The planning time of a waypoint is measured along a path among three obstacles, in processor time of
one process, compiled, in the second run, with the certificate.

Command: python -m studies.motion [--rate 5] [--longer 2 4] [--waypoints 10 50] [--out out]

Answer: in studies/README.md.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from octoplan.model import Arm, Scene
from octoplan.model.effects import Extension
from octoplan.model.extensions.obstacles import Box, Capsule, Sphere
from octoplan.planner import Trajectory, trajectory
from octoplan.planner.frontends.plots.motion import plot_trajectory
from octoplan.planner.frontends.plots.plan import save
from octoplan.planner.targets import Fetch, Target, TipPosition
from studies.reporting import asked

SCENE = Scene(Extension())
MAXIMUM = 13.0
OBJECT = (0.3, 0.12, 0.0)
BENT = (0.15, 0.15, 0.0)
MOUTH = Fetch.reach((0.0, 0.0, 0.0), float(np.radians(30)), float(np.radians(-90)))
STAGES: dict[str, Target] = {
    "reach": TipPosition(OBJECT),
    "bend": TipPosition(BENT),
    "bring": MOUTH,
}
_INSTANTS = 10_001
OBSTACLES = [
    Sphere((0.2, 0.12, -0.12), 0.03),
    Capsule((0.15, -0.06, -0.06), (0.25, -0.09, -0.06), 0.02),
    Box((0.36, 0.22, -0.1), (0.05, 0.05, 0.05)),
]


def motion(rate: float, names: Sequence[str] = tuple(STAGES), times: object = None) -> Trajectory:
    """Return the motion through the named stages."""
    arm = Arm.from_paper("table-4")
    targets = [STAGES[name] for name in names]
    return trajectory(arm, targets, SCENE, MAXIMUM, rate_max=rate, times=times)


def effort(result: Trajectory) -> float:
    """Return the root mean square over time of the tensions' norm [N]."""
    T = result.at(np.linspace(0.0, result.duration, 1001))
    return float(np.sqrt((T**2).sum(axis=1).mean()))


def excess(result: Trajectory, rate: float) -> float:
    """Return the largest tension or rate relative to its limit, over many instants."""
    t = np.linspace(0.0, result.duration, _INSTANTS)
    T = result.at(t)
    speed = np.abs(np.diff(T, axis=0)).max() / (t[1] - t[0])
    return float(max(T.max() / MAXIMUM, speed / rate))


def path(share: float) -> tuple[float, float, float]:
    """Return the tip position [m] on one turn of a helix, for a share of the path in [0, 1]."""
    turn = 2 * np.pi * share
    return 0.3 + 0.03 * np.cos(turn), 0.1 + 0.05 * np.sin(turn), -0.1 - 0.03 * share


def cost(count: int) -> tuple[float, bool]:
    """Return the time of a waypoint with certificate [s], and whether the certificate passes."""
    arm = Arm.from_paper("table-4")
    options = {"obstacles": OBSTACLES, "clearance": 0.002}
    for _ in range(2):
        begin = time.process_time()
        result = trajectory(
            arm, path, SCENE, MAXIMUM, rate_max=5.0, waypoints=count, compile="auto", **options
        )
        passed = result.certificate.passed
        end = time.process_time()
    return (end - begin) / count, passed


def main(argv: Sequence[str] | None = None) -> None:
    """Print the table and save the figure."""
    args = asked(
        __doc__,
        argv,
        {
            "--rate": 5.0,
            "--longer": [2.0, 4.0],
            "--waypoints": [10, 50],
            "--out": Path("out"),
        },
    )
    best = motion(args.rate)
    print(f"{'motion':<26} {'time [s]':>9} {'effort [N]':>10} {'limit used':>16}  passed")
    alone = [motion(args.rate, [name]) for name in STAGES]
    shown = dict(zip((f"{name} alone, from rest" for name in STAGES), alone, strict=True))
    shown["reach, bend, bring"] = best
    for more in args.longer:
        times = (more * best.times[list(best.stops)]).tolist()
        shown[f"in {more:g} times the time"] = motion(args.rate, times=times)
    for name, value in shown.items():
        numbers = f"{value.duration:9.3f} {effort(value):10.3f} {excess(value, args.rate):16.6f}"
        print(f"{name:<26} {numbers}  {value.certificate.passed}")
    bound = max(result.duration for result in alone)
    print(f"least time over the lower bound {best.duration / bound:.3f}")
    print(best.outcome)
    for count in args.waypoints:
        seconds, passed = cost(count)
        message = f"{1e3 * seconds:.1f} ms each with certificate, passed {passed}"
        print(f"{count} waypoints among {len(OBSTACLES)} obstacles: {message}")
    save(plot_trajectory(best), args.out / "motion.png")


if __name__ == "__main__":
    main()
