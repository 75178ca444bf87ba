"""Does the planner avoid obstacles and the arm itself, and what does that cost?

Questions: The targets are random reachable tips of the arm of table 4 (paper's scene, tensions up
to 20 N) among random balls and rods; for each target a shape is known that touches no obstacle. How
many targets are solved, is any solved wrongly, and how much longer is the planning time than
without obstacles? How many plans of least effort pass through the arm itself or through the base
plane, how many of these tips have another plan, and what does that plan cost?

Assumptions: Targets are the tips of random equilibria (studies.draws). Obstacles have radii of 10
to 40 mm and lie within about 60 mm of the known shape or of the plan without obstacles. A plan is
wrong if its certificate passes and one of 20 000 points of its midline is nearer to an obstacle
than the radius of the arm. Times are processor times of one process, without certificates.

Command: python -m studies.clutter [--targets 100] [--obstacles 5 10] [--itself 100] [--seed 0]

Answer: in studies/README.md.
"""

from __future__ import annotations

import time
from collections.abc import Sequence

import numpy as np

from octoplan.model import Arm, Scene, Shape
from octoplan.model.effects import Extension
from octoplan.model.extensions.obstacles import Capsule, Sphere
from octoplan.model.extensions.obstacles.base import Obstacle
from octoplan.model.paths import Array
from octoplan.planner import Plan, plan
from octoplan.planner.targets import TipPosition
from studies import draws
from studies.reporting import asked, keep_finished

MAXIMUM = 20.0
SCENE = Scene(Extension())
# Range of the radii of obstacles [m].
_SIZES = (0.01, 0.04)
# Standard deviation of the distance from the arm to the centres of obstacles, per axis [m].
_SPREAD = 0.06
# Least clearance of the known shape [m].
_CLEARANCE = 1e-3


def gap(shape: Shape, obstacles: Sequence[Obstacle], count: int = 20_000) -> float:
    """Return the least distance of the arm's surface from obstacles, at `count` points [m]."""
    s = np.linspace(0.0, shape.arm.length, 401)
    fine = np.linspace(0.0, shape.arm.length, count)
    x = np.column_stack([np.interp(fine, s, each) for each in shape.position(s).T])
    radius = shape.arm.radius.evaluate(fine, shape.arm.length)[0]
    return min(float((obstacle.distance(x) - radius).min()) for obstacle in obstacles)


def clutter(
    arm: Arm, witness: Shape, free: Shape, count: int, rng: np.random.Generator
) -> list[Obstacle]:
    """Return random obstacles near two shapes; the first shape, `witness`, touches none."""
    results: list[Obstacle] = []
    while len(results) < count:
        shape = (witness, free)[len(results) % 2]
        place = shape.position(rng.uniform(0.1, 1.0) * arm.length)
        center = place + _SPREAD * rng.normal(size=3)
        radius = rng.uniform(*_SIZES)
        end = center + 0.1 * rng.normal(size=3)
        other = Sphere(center, radius) if rng.random() < 0.5 else Capsule(center, end, radius)
        if gap(witness, [other], 400) > _CLEARANCE and other.distance(np.zeros(3)) > 0.02:
            results.append(other)
    return results


def timed(arm: Arm, tip: Array, **others: object) -> tuple[Plan, float]:
    """Return the plan for a tip, and the processor time [s]."""
    begin = time.process_time()
    result = plan(arm, TipPosition(tuple(tip)), SCENE, MAXIMUM, **others)  # type: ignore[arg-type]
    return result, time.process_time() - begin


def among_obstacles(arm: Arm, results: list[Shape], count: int, rng: np.random.Generator) -> None:
    """Print the number of tips that are solved among `count` obstacles, and the cost."""
    solved = []
    wrong = 0
    touched = 0
    ratios = []
    efforts = []
    with keep_finished():
        for shape in results:
            free, before = timed(arm, shape.tip)
            obstacles = clutter(arm, shape, free.shape, count, rng)
            p, after = timed(arm, shape.tip, obstacles=obstacles)
            solved.append(p.certificate.passed)
            ratios.append(after / before)
            wrong += p.certificate.passed and gap(p.shape, obstacles) < -1e-6
            if gap(free.shape, obstacles, 2000) < 0:
                touched += 1
                efforts.append(p.effort / free.effort)
    print(f"{count} obstacles, {len(solved)} tips, {touched} plans without obstacles touch one")
    print(f"  solved {np.mean(solved):.1%}, wrongly {wrong}")
    message = f"{np.median(ratios):.2f}, 90 % quantile {np.quantile(ratios, 0.9):.1f}"
    print(f"  time relative to no obstacles: median {message}, largest {np.max(ratios):.0f}")
    if efforts:
        print(f"  effort relative to no obstacles, if touched: median {np.median(efforts):.2f}")


def around_itself(arm: Arm, results: list[Shape]) -> None:
    """Print the number of plans through the arm or its base plane, and the cost of others."""
    passing = {"the far side of its base plane": 0, "itself": 0}
    otherwise = 0
    efforts = []
    ratios = []
    unreported = 0
    total = 0
    with keep_finished():
        for shape in results:
            free, before = timed(arm, shape.tip)
            total += 1
            certificate = free.certificate
            touches = [name for name, value in certificate.gaps.items() if value < 0]
            for name in touches:
                passing[name] += 1
            unreported += bool(touches) and "Beware" not in free.outcome
            if touches:
                p, after = timed(arm, shape.tip, self_clearance=True)
                ratios.append(after / before)
                if p.certificate.passed:
                    otherwise += 1
                    efforts.append(p.effort / free.effort)
    itself = passing["itself"]
    behind = max(passing.values())
    print(f"{total} tips: {itself} plans pass through the arm, {behind} through the base plane")
    print(f"  {unreported} of these not reported, {otherwise} of {len(ratios)} with another plan")
    if efforts:
        print(f"  effort of the other plan: median {np.median(efforts):.2f} times,", end=" ")
        print(f"largest {max(efforts):.1f}")
    if ratios:
        print(f"  time of the other plan: median {np.median(ratios):.1f} times,", end=" ")
        print(f"largest {max(ratios):.0f}")


def main(argv: Sequence[str] | None = None) -> None:
    """Print the tables."""
    args = asked(
        __doc__,
        argv,
        {
            "--targets": 100,
            "--obstacles": [5, 10],
            "--itself": 100,
            "--seed": 0,
        },
    )
    arm = Arm.from_paper("table-4")
    rng = np.random.default_rng(args.seed)
    timed(arm, np.array([0.3, 0.1, 0.1]), obstacles=[Sphere((0.2, 0.05, 0.05), 0.02)])
    for count in args.obstacles:
        results = [draws.shape(arm, SCENE, rng, i % 3) for i in range(args.targets)]
        among_obstacles(arm, results, count, rng)
    if args.itself:
        around_itself(arm, [draws.shape(arm, SCENE, rng, i % 3) for i in range(args.itself)])


if __name__ == "__main__":
    main()
