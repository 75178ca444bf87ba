"""Does the planner find its way among obstacles, around itself, and what does that take?

Question: of random reachable tips of the table 4 arm (paper's scene, maxima 20 N) among random
balls and rods that some arm with that tip does not touch, how many are solved, is any solved
wrongly, and how much longer does it take than without obstacles? Of random tips, how many does the
least effort reach through the arm's own body or from behind its base plane, how many of these can
be reached otherwise, and what does that cost?

Assumptions: tips are those of settled shapes, see studies.draws. Obstacles have radii of 10
to 40 mm and are about the arm: around places of that shape or of the plan without obstacles, within
60 mm or so; a plan is wrong if it is certified and one of 20 000 places of its midline is nearer to
an obstacle than the arm's radius there. Times are of the processor, of one process, certificates
not included.

Command: python -m studies.clutter [--targets 100] [--obstacles 5 10] [--itself 100] [--seed 0]

Answer: in studies/README.md.
"""

from __future__ import annotations

import time
from collections.abc import Sequence

import numpy as np

from octoplan.model import Arm, Scene, Shape
from octoplan.model.effects import Extension
from octoplan.model.extensions.obstacles import Capsule, Obstacle, Sphere
from octoplan.model.paths import Array
from octoplan.planner import Plan, plan
from octoplan.planner.targets import TipPosition
from studies import draws
from studies.reporting import asked, keep_finished

MAXIMUM, SCENE = 20.0, Scene(Extension())
_SIZES, _SPREAD, _ROOM = (0.01, 0.04), 0.06, 1e-3


def gap(shape: Shape, obstacles: Sequence[Obstacle], count: int = 20_000) -> float:
    """Return the least distance of the arm's surface from obstacles at so many places [m]."""
    s = np.linspace(0.0, shape.arm.length, 401)
    fine = np.linspace(0.0, shape.arm.length, count)
    x = np.column_stack([np.interp(fine, s, each) for each in shape.position(s).T])
    radius = shape.arm.radius.evaluate(fine, shape.arm.length)[0]
    return min(float((obstacle.distance(x) - radius).min()) for obstacle in obstacles)


def clutter(
    arm: Arm, witness: Shape, free: Shape, count: int, rng: np.random.Generator
) -> list[Obstacle]:
    """Return random obstacles about two shapes that one of them, the witness, does not touch."""
    results: list[Obstacle] = []
    while len(results) < count:
        shape = (witness, free)[len(results) % 2]
        place = shape.position(rng.uniform(0.1, 1.0) * arm.length)
        center, radius = place + _SPREAD * rng.normal(size=3), rng.uniform(*_SIZES)
        end = center + 0.1 * rng.normal(size=3)
        other = Sphere(center, radius) if rng.random() < 0.5 else Capsule(center, end, radius)
        if gap(witness, [other], 400) > _ROOM and other.distance(np.zeros(3)) > 0.02:
            results.append(other)
    return results


def timed(arm: Arm, tip: Array, **others: object) -> tuple[Plan, float]:
    """Return the plan for a tip, and the seconds that it took."""
    begin = time.process_time()
    result = plan(arm, TipPosition(tuple(tip)), SCENE, MAXIMUM, **others)  # type: ignore[arg-type]
    return result, time.process_time() - begin


def among_obstacles(arm: Arm, results: list[Shape], count: int, rng: np.random.Generator) -> None:
    """Print how many tips are solved among so many obstacles, and at what cost."""
    solved, wrong, touched, ratios, efforts = [], 0, 0, [], []
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
    print(f"{count} obstacles, {len(solved)} tips, touched by the free plan {touched}")
    print(f"  solved {np.mean(solved):.1%}, wrongly {wrong}")
    message = f"{np.median(ratios):.2f} median, {np.quantile(ratios, 0.9):.1f} of 90 %"
    print(f"  time over that without obstacles {message}, {np.max(ratios):.0f} most")
    if efforts:
        print(f"  effort of touched ones over that without {np.median(efforts):.2f} median")


def around_itself(arm: Arm, results: list[Shape]) -> None:
    """Print how many plans pass through the arm or its base plane, and what others cost."""
    passing = {"the far side of its base plane": 0, "itself": 0}
    otherwise, efforts, ratios, unsaid, total = 0, [], [], 0, 0
    with keep_finished():
        for shape in results:
            free, before = timed(arm, shape.tip)
            total += 1
            certificate = free.certificate
            touches = [name for name, value in certificate.gaps.items() if value < 0]
            for name in touches:
                passing[name] += 1
            unsaid += bool(touches) and "Beware" not in free.outcome
            if touches:
                p, after = timed(arm, shape.tip, self_clearance=True)
                ratios.append(after / before)
                if p.certificate.passed:
                    otherwise += 1
                    efforts.append(p.effort / free.effort)
    itself, behind = passing["itself"], max(passing.values())
    print(f"{total} tips: through itself {itself}, behind the base {behind}")
    print(f"  of these without a word {unsaid}, reached otherwise {otherwise} of {len(ratios)}")
    if efforts:
        print(f"  at an effort of {np.median(efforts):.2f} times (median), {max(efforts):.1f} most")
    if ratios:
        print(f"  in {np.median(ratios):.1f} times the time (median), {max(ratios):.0f} most")


def main(argv: Sequence[str] | None = None) -> None:
    """Run the study and print its tables."""
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
    arm, rng = Arm.from_paper("table-4"), np.random.default_rng(args.seed)
    timed(arm, np.array([0.3, 0.1, 0.1]), obstacles=[Sphere((0.2, 0.05, 0.05), 0.02)])
    for count in args.obstacles:
        results = [draws.shape(arm, SCENE, rng, i % 3) for i in range(args.targets)]
        among_obstacles(arm, results, count, rng)
    if args.itself:
        around_itself(arm, [draws.shape(arm, SCENE, rng, i % 3) for i in range(args.itself)])


if __name__ == "__main__":
    main()
