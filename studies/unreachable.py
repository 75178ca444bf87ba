"""Is what the planner gives for a target beyond reach the nearest attainable shape?

Question: of random targets that cannot be met, how often is the shortfall of the plan within 1 % of
the least of many random starts; and is any called reached?

Assumptions: table 4, bare or with extension. Tips and poses lie 1.02 to 1.4 lengths from the base;
other poses are at a reachable place, turned at random; planes, fetches and backbones are read off
settled shapes whose tensions are 1.5 to 4 times the maxima allowed. What is reached all the same is
left out, after a check. The shortfall is the root of twice the objective of the nearest shape, in
lengths and radians, all on the mesh of the search.

Command: python -m studies.unreachable [--targets 48] [--best-of 50] [--seed 0]

Answer: in studies/README.md.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from tqdm import tqdm

from model import Scene, settle
from model.effects import Extension
from model.paths import Array
from planner import Limits, Statement, plan
from planner.solve.search import Search
from planner.solve.task import Task
from planner.targets import Target, TipPose, TipPosition
from studies.planner_suite import ARM, MAXIMUM, draw, off

KINDS = ("tip", "pose", "turned", "plane", "fetch", "backbone")
_FAR, _STRONG = (1.02, 1.4), (1.5, 4.0)
_NEAR, _WRONG = 1e-6, 3e-6


@dataclass(frozen=True)
class Case:
    """A target; `over` is the shortfall of its plan over the least that random starts lead to.

    NaN where it is reached.
    """

    number: int
    kind: str
    over: float
    wrong: bool = False


def run(number: int, seed: int, best_of: int) -> Case:
    """Draw a target beyond reach, plan it, and hold the plan against random starts."""
    rng = np.random.default_rng([seed, number])
    kind, scene = KINDS[number % len(KINDS)], (Scene(), Scene(Extension()))[rng.integers(2)]
    target, maxima = beyond(rng, kind, scene)
    result = plan(ARM, target, scene, maxima)
    if result.reached and max(result.certificate.soft_residual.values(), default=0.0) <= _NEAR:
        wrong = off(settle(ARM, result.tensions, scene, 1e-9), target) > _WRONG
        return Case(number, kind, np.nan, wrong)
    limits = Limits.of(ARM, maxima)
    search = Search(Task(ARM, result.targets, scene, limits, Statement(), result.accuracy))
    statement = search.task.coarse(result.mode)
    scale = np.minimum(np.repeat([0.6, 5.0, 15.0], 4), limits.upper)
    tried = (
        search.solve(statement, rng.uniform() * rng.uniform(size=12) * scale)
        for _ in range(best_of)
    )
    best = min((s.f for s in tried if s.met), default=np.inf)
    values = min((s.objective for s in result.starts if s.met), default=np.inf)
    return Case(number, kind, float(np.sqrt(values / best)) if values < np.inf else np.inf)


def beyond(rng: np.random.Generator, kind: str, scene: Scene) -> tuple[Target, Array | float]:
    """Return a target, and maxima of the tensions (12,) or of all that do not reach it."""
    way = rng.normal(size=3)
    far = tuple((rng.uniform(*_FAR) * ARM.length * way / np.linalg.norm(way)).tolist())
    if kind == "tip":
        return TipPosition(far), MAXIMUM
    if kind in ("pose", "turned"):
        pose = draw(rng, "pose", scene)[1]
        assert isinstance(pose, TipPose)
        if kind == "pose":
            return TipPose(far, pose.frame), MAXIMUM
        turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
        turn[:, 0] *= np.linalg.det(turn)
        return TipPose(pose.position, tuple(tuple(row) for row in turn.tolist())), MAXIMUM
    T, target = draw(rng, kind, scene)
    most = np.repeat(T.max(axis=1), T.shape[1])
    return target, np.maximum(most / rng.uniform(*_STRONG), 1e-3)


def report(cases: Sequence[Case]) -> None:
    """Print a line for each kind and for all."""
    print(f"{'':<12}{'targets':>8}{'reached':>9}{'wrong':>7}{'within 1 %':>12}{'worst':>9}")
    groups = {kind: [c for c in cases if c.kind == kind] for kind in KINDS} | {"all": list(cases)}
    for name, group in groups.items():
        over = np.array([c.over for c in group if not np.isnan(c.over)])
        good, worst = (np.mean(over <= 1.01), over.max()) if over.size else (np.nan, np.nan)
        reached, wrong = len(group) - over.size, sum(c.wrong for c in group)
        print(f"{name:<12}{len(group):>8}{reached:>9}{wrong:>7}{good:>12.1%}{worst:>9.3f}")


def main(argv: Sequence[str] | None = None) -> None:
    """Run the study and print its table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--targets", type=int, default=48)
    parser.add_argument("--best-of", type=int, default=50)
    parser.add_argument("--seed", type=int, default=0)
    args = parser.parse_args(argv)
    cases = [
        run(number, args.seed, args.best_of) for number in tqdm(range(args.targets), disable=None)
    ]
    report(cases)


if __name__ == "__main__":
    main()
