"""Does the planner get lost?

Question: of random reachable targets of every kind, in every scene, how many are reached and
certified, how near is the effort to the best known, how long does it take; and is anything called
reached that is not?

Assumptions: table 4, maxima of 20 N; targets are read off settled shapes (`draw`), so
that one set of tensions is known that reaches each. A plan is reached where its certificate passes
and, for a backbone, no point is further off than 1e-6 L. It is wrong where that is so and its
tensions, settled to 1e-9 L by another integrator and held against the target by code of this study,
are off by more than 3e-6. The best known effort is the least of the plan's, that of the tensions
drawn, and in the paper's scenes that of the best of `--best-of` starts from random tensions.
Times are the processor's, as shifted geometric means (shift 0.1 s), as benchmarks of optimisers
have it.

Command: python -m studies.planner_suite [--targets 1000] [--best-of 10] [--jobs 2] [--seed 0]
[--kinds NAME ...] [--case NUMBER] [--out out]

Answer: in studies/README.md.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
from tqdm import tqdm

from model import (
    Arm,
    CollapsedError,
    ConvergenceError,
    OctoplanError,
    Scene,
    Shape,
    SnapError,
    settle,
)
from model.effects import (
    Buoyancy,
    Current,
    ExactTendons,
    Extension,
    Friction,
    PointLoad,
    Shear,
    TipLoad,
    Weight,
)
from model.forward import schemes_of
from model.loads import is_loaded
from model.paths import Array
from planner import Limits, Plan, Statement, plan
from planner.solve.search import Search
from planner.solve.task import Task
from planner.targets import Backbone, Bend, BendingPlane, Fetch, Target, TipPose, TipPosition
from planner.targets.fetch import stretches
from studies.reporting import keep_finished

_NEAR, _WRONG, _SHIFT = 1e-6, 3e-6, 0.1


@dataclass(frozen=True, eq=False)
class Case:
    """A target and what became of its plan.

    `error` is how far its tensions are from the target by the check of this study, `cost` its
    effort over the best known.
    """

    number: int
    kind: str
    scene: str
    target: Target
    drawn: Array
    reached: bool = False
    error: float = np.inf
    cost: float = np.inf
    seconds: float = np.nan
    starts: int = 0
    outcome: str = ""

    @property
    def wrong(self) -> bool:
        """Whether it is called reached, and is not."""
        return self.reached and not self.error <= _WRONG

    def again(self) -> str:
        """Return a script that plans the case again."""
        scene = SCENES[self.scene][1]
        lines = [
            "from model import Arm, Scene",
            "from model.effects import *",
            "from planner import plan",
            "from planner.targets import *",
            f"# {self.outcome}",
            f"# reached from tensions {self.drawn.tolist()}",
            f"target = {self.target!r}",
            f"found = plan(Arm.from_paper('table-4'), target, {written(scene)}, {MAXIMUM})",
            "print(found.outcome)",
        ]
        return "\n".join(lines) + "\n"


def written(scene: Scene) -> str:
    """Return a scene as Python."""
    return f"Scene({', '.join(repr(effect) for effect in scene.effects)})"


def run(job: tuple[int, int, int, Sequence[str]]) -> Case:
    """Draw a target and plan it.

    A job is a number, the seed, how many starts to hold against, and the kinds of targets. The seed
    of a case is its number, so that it is the same wherever it is run.
    """
    number, seed, best_of, kinds = job
    rng = np.random.default_rng([seed, number])
    kind = kinds[number % len(kinds)]
    weights = np.array([weight for weight, _ in SCENES.values()], dtype=float)
    name = str(rng.choice(list(SCENES), p=weights / weights.sum()))
    scene = SCENES[name][1]
    T, target = draw(rng, kind, scene)
    case = {"number": number, "kind": kind, "scene": name, "target": target, "drawn": T}
    begin = time.process_time()
    try:
        result = plan(ARM, target, scene, MAXIMUM)
        passed, outcome = result.reached, result.outcome
    except OctoplanError as problem:
        return Case(**case, outcome=f"{type(problem).__name__}: {problem}")
    seconds = time.process_time() - begin
    try:
        scheme = None if is_loaded(scene) else schemes_of(scene)[1]
        error = off(settle(ARM, result.tensions, scene, 1e-9, scheme), target)
    except OctoplanError:
        error = np.inf
    near = max(result.certificate.soft_residual.values(), default=0.0) <= _NEAR
    cost = max(float(result.effort / np.linalg.norm(T)), _over_best(result, scene, best_of, rng))
    done = (passed and near, error, cost, seconds, len(result.starts), outcome)
    return Case(**case, **dict(zip(_RESULTS, done, strict=True)))


_RESULTS = ("reached", "error", "cost", "seconds", "starts", "outcome")


def _over_best(result: Plan, scene: Scene, count: int, rng: np.random.Generator) -> float:
    """Return a plan's effort over the least that random starts lead to, on the coarse mesh."""
    heavy = is_loaded(scene) or scene.has(ExactTendons)
    if heavy or not count or result.mode != "exact":
        return 0.0
    limits, statement = Limits.of(ARM, MAXIMUM), Statement(norm=result.statement.norm)
    search = Search(Task(ARM, result.targets, scene, limits, statement, result.accuracy))
    coarse, scale = search.task.coarse("exact"), np.repeat([0.6, 5.0, 15.0], 4)
    tried = (
        search.solve(coarse, rng.uniform() * rng.uniform(size=12) * scale) for _ in range(count)
    )
    best = min((np.linalg.norm(search.task.tensions(s)) for s in tried if s.met), default=np.inf)
    return float(result.effort / best) if 0 < best < np.inf else 0.0


def report(cases: Sequence[Case]) -> None:
    """Print a line for each kind, for each scene, and for all."""
    print(f"{'':<12}{'targets':>8}{'reached':>9}{'wrong':>7}{'within 1 %':>12}", end="")
    print(f"{'time [s]':>10}{'starts':>8}")
    groups = {kind: [c for c in cases if c.kind == kind] for kind in READ}
    groups |= {name: [c for c in cases if c.scene == name] for name in SCENES}
    for name, group in (groups | {"all": list(cases)}).items():
        if not group:
            continue
        reached = [c for c in group if c.reached]
        share = len(reached) / len(group)
        good = np.mean([c.cost <= 1.01 for c in reached]) if reached else 0.0
        times = np.array([c.seconds for c in reached])
        mean = np.exp(np.mean(np.log(times + _SHIFT))) - _SHIFT if reached else np.nan
        starts = np.mean([c.starts for c in reached]) if reached else np.nan
        wrong = sum(c.wrong for c in group)
        print(
            f"{name:<12}{len(group):>8}{share:>9.1%}{wrong:>7}{good:>12.1%}{mean:>10.3f}{starts:>8.1f}"
        )


def keep(cases: Sequence[Case], out: Path) -> None:
    """Write a script for each case that failed, or took 1 % above the best effort known."""
    for case in cases:
        if case.wrong or not case.reached or case.cost > 1.01:
            why = "wrong" if case.wrong else "dear" if case.reached else "none"
            out.mkdir(parents=True, exist_ok=True)
            (out / f"{why}_{case.number}_{case.kind}.py").write_text(case.again(), encoding="utf-8")


def main(argv: Sequence[str] | None = None) -> None:
    """Run the suite, print its table, and keep what failed."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--targets", type=int, default=1000)
    parser.add_argument("--best-of", type=int, default=10)
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--kinds", nargs="*", choices=READ, default=list(READ))
    parser.add_argument("--case", type=int, help="print this one as a script, and no table")
    parser.add_argument("--out", type=Path, default=Path("out"))
    args = parser.parse_args(argv)
    if args.case is not None:
        print(run((args.case, args.seed, args.best_of, args.kinds)).again(), end="")
        return
    jobs = [(i, args.seed, args.best_of, args.kinds) for i in range(args.targets)]
    cases: list[Case] = []
    pool = ProcessPoolExecutor(args.jobs)
    with keep_finished():
        for case in tqdm(pool.map(run, jobs), total=len(jobs), disable=None):
            cases.append(case)
    pool.shutdown(cancel_futures=True)
    report(cases)
    keep(cases, args.out / "planner_suite")


ARM = Arm.from_paper("table-4")
MAXIMUM = 20.0
# How often each scene is drawn: those that take a planner seconds seldom.
SCENES: dict[str, tuple[int, Scene]] = {
    "bare": (20, Scene()),
    "extension": (40, Scene(Extension())),
    "exact": (12, Scene(Extension(), ExactTendons())),
    "silicone": (6, Scene.silicone()),
    "water": (5, Scene(Extension(), Weight(), Buoyancy(1000.0))),
    "payload": (4, Scene(Extension(), TipLoad((0.0, 0.0, -0.002)))),
    "follower": (3, Scene(Extension(), TipLoad((0.0, 0.002, 0.0), follower=True))),
    "point load": (2, Scene(Extension(), PointLoad(0.2, (0.0, 0.0, -0.02)))),
    "current": (1, Scene(Extension(), Current((0.0, 0.05, 0.0)))),
    "shear": (1, Scene(Extension(), Shear())),
    "friction": (1, Scene(Extension(), Friction(0.05))),
}
_MOST = np.array([0.6, 5.0, 15.0])


def tensions(rng: np.random.Generator, kind: str) -> Array:
    """Return tensions (3, 4) [N]: those of a section for a plane, few or all for other kinds."""
    T = rng.uniform(size=(3, 4)) * _MOST[:, None]
    if kind == "plane":
        section = rng.integers(3)
        T[np.arange(3) != section] = 0.0
        first = rng.integers(4)
        T[:, [first, (first + 1) % 4]] = 0.0
        return T * rng.uniform()
    way = rng.integers(3)
    if way == 0:
        T *= rng.uniform(size=(3, 4)) < 0.5
    elif way == 1:
        T *= np.arange(4) == rng.integers(4, size=3)[:, None]
    return T * rng.uniform(0.3, 1.0)


def draw(rng: np.random.Generator, kind: str, scene: Scene) -> tuple[Array, Target]:
    """Return tensions that the arm bears, and the target that they reach."""
    while True:
        T = tensions(rng, kind)
        try:
            target = READ[kind](settle(ARM, T, scene, 1e-10), T)
        except (CollapsedError, SnapError, ConvergenceError):
            continue
        if target is not None:
            return T, target


def _components(frame: Array, v: Array) -> tuple[float, float, float]:
    """Return v along t, b and -n of a frame: the axes that bends and planes are counted from."""
    return float(v @ frame[:, 0]), float(v @ frame[:, 2]), float(-v @ frame[:, 1])


def _plane(shape: Shape, T: Array) -> Target | None:
    base = np.array(ARM.base_frame)
    _, b, n = _components(base, shape.tip - np.array(ARM.base_position))
    angle = float(np.arctan2(n, b))
    bend = _bend_in(shape, angle)
    section = 1 + int(np.argmax(T.sum(axis=1)))
    return BendingPlane(angle, bend, section) if 0.01 < bend < np.pi else None


def _bend_in(shape: Shape, angle: float) -> float:
    t, b, n = _components(np.array(ARM.base_frame), shape.tip_frame[:, 0])
    return float(np.arctan2(np.cos(angle) * b + np.sin(angle) * n, t))


def _fetch(shape: Shape, _: Array) -> Target | None:
    bends = []
    for start, end in pairwise(stretches(ARM)):
        t, b, n = _components(shape.frame(start), shape.frame(end)[:, 0])
        bends.append(Bend(float(np.arccos(np.clip(t, -1, 1))), float(np.arctan2(n, b))))
    return Fetch(*bends) if min(bend.angle for bend in bends) > 0.01 else None


def _frame(shape: Shape) -> tuple[tuple[float, ...], ...]:
    return tuple(tuple(row) for row in shape.tip_frame.tolist())


_PLACES = tuple((ARM.length * np.arange(1, 7) / 6).tolist())
READ: dict[str, Callable[[Shape, Array], Target | None]] = {
    "tip": lambda shape, _: TipPosition(tuple(shape.tip.tolist())),
    "pose": lambda shape, _: TipPose(tuple(shape.tip.tolist()), _frame(shape)),
    "plane": _plane,
    "fetch": _fetch,
    "backbone": lambda shape, _: Backbone(
        tuple(tuple(shape.position(s).tolist()) for s in _PLACES), _PLACES
    ),
}


def off(shape: Shape, target: Target) -> float:
    """Return how far a shape is from a target: lengths over the arm's, angles in rad."""
    if isinstance(target, TipPosition):
        return _apart(shape.tip, target.position)
    if isinstance(target, TipPose):
        turned = float(np.abs(shape.tip_frame - np.array(target.frame)).max())
        return max(_apart(shape.tip, target.position), turned)
    if isinstance(target, BendingPlane):
        _, b, n = _components(np.array(ARM.base_frame), shape.tip - np.array(ARM.base_position))
        leaves = abs(np.cos(target.angle) * n - np.sin(target.angle) * b) / ARM.length
        return max(float(leaves), abs(_bend_in(shape, target.angle) - target.bend))
    if isinstance(target, Fetch):
        wanted = (target.proximal, target.medial, target.distal)
        return max(
            _off_bend(shape, start, end, bend)
            for (start, end), bend in zip(pairwise(stretches(ARM)), wanted, strict=True)
        )
    assert isinstance(target, Backbone) and target.s is not None
    places = zip(target.s, target.points, strict=True)
    return max(_apart(shape.position(s), point) for s, point in places)


def _apart(a: Array, b: object) -> float:
    return float(np.linalg.norm(a - np.array(b))) / ARM.length


def _off_bend(shape: Shape, start: float, end: float, bend: Bend) -> float:
    values = np.array(_components(shape.frame(start), shape.frame(end)[:, 0]))
    across = np.sin(bend.angle)
    wanted = [np.cos(bend.angle), across * np.cos(bend.plane), across * np.sin(bend.plane)]
    return float(np.linalg.norm(values - np.array(wanted)))


if __name__ == "__main__":
    main()
