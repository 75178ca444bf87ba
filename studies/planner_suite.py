"""Does the planner find the best plan, and the nearest shape for unreachable targets?

Questions: How many random reachable targets of each kind, in each scene, are reached and certified?
How near is the effort to the best known effort, how long does a plan take, and is any plan reported
as reached although the target is missed? For random unreachable targets (`--beyond`), how often is
the shortfall of the plan within 1 % of the least shortfall of many random starts, or of a grid of
equilibria?

Assumptions: The arm of table 4, tensions up to 20 N. Targets are computed from random equilibria
(studies.draws), so that tensions are known that reach each target. A plan is reached if its
certificate passes and, for a backbone, no point is farther than 1e-6 L from its target. A reached
plan is wrong if its error exceeds 3e-6: for this check another integrator solves the equilibrium to
1e-9 L, and separate code of this study evaluates the target. The best known effort is the least of
the plan's effort, the effort of the random tensions, and in the paper's scenes the effort of the
best of `--best-of` random starts.

Unreachable targets, without effects or with extension: tips and poses are 1.02 to 1.4 L from the
base; other poses have a reachable position and a random rotation; planes, fetches and backbones are
computed from shapes with tensions of 1.5 to 4 times the limits. Targets that turn out to be
reachable are checked and left out. The shortfall is the root of twice the objective of the nearest
shape, in lengths and radians, on the mesh of the search.

Three further arms have active tension limits: an arm with a helical tendon, a long thin arm, and an
arm of six sections. Tips at 0.1 to 1.1 L are compared with the best of a grid of equilibria (random
equilibria for six sections), refined from the three best points with L-BFGS-B and `settle`. Times
are processor times, as shifted geometric means (shift 0.1 s), the convention of optimiser
benchmarks.

Command: python -m studies.planner_suite [--targets 1000] [--best-of 10] [--jobs 2] [--seed 0]
[--kinds NAME ...] [--beyond] [--case NUMBER] [--out out]

Answer: in studies/README.md.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import product
from pathlib import Path

import numpy as np
from scipy.optimize import minimize
from tqdm import tqdm

from octoplan.model import (
    Anchorage,
    Arm,
    Linear,
    Material,
    OctoplanError,
    Scene,
    settle,
)
from octoplan.model.effects import (
    Buoyancy,
    Current,
    ExactTendons,
    Extension,
    PointLoad,
    Shear,
    TipLoad,
    Weight,
)
from octoplan.model.extensions.friction import Friction
from octoplan.model.loads import is_coupled
from octoplan.model.paths import Array
from octoplan.planner import Plan, plan
from octoplan.planner.planning_problem import NlpOptions, PlanningProblem
from octoplan.planner.program_instance import ProgramInstance
from octoplan.planner.solution import NlpSolution
from octoplan.planner.solve.multistart import solve_from_guess
from octoplan.planner.targets import Target, TipPose, TipPosition
from studies import draws
from studies.draws import ARM, MAXIMUM, TARGET_OF, target_error
from studies.reference import reference_shape
from studies.reporting import asked, keep_finished

# Largest distance of a reached backbone point from its target, in lengths.
_NEAR = 1e-6
# Error above which a reached plan is wrong, in lengths or radians.
_WRONG = 3e-6
# Shift of the geometric mean of times [s].
_SHIFT = 0.1
# Kinds of unreachable targets.
BEYOND = ("tip", "pose", "turned", "plane", "fetch", "backbone", "helical", "thin", "sections")
# Range of the distances of unreachable tips from the base, in lengths.
_FAR = (1.02, 1.4)
# Range of the tensions of unreachable shapes, relative to the limits.
_STRONG = (1.5, 4.0)
# Range of the distances of tips for arms with active limits, in lengths.
_WITHIN = (0.1, 1.1)
# Number of equilibria in the grid of an arm with active limits.
_GRID = 1296
# Number of points of the grid that are refined.
_BEST = 3
# Largest distance that rounding and the accuracy of `settle` explain, in lengths.
_ROUNDED = 1e-5


@dataclass(frozen=True, eq=False)
class Case:
    """A target and the result of its plan.

    `error` is the distance from the target, checked independently. `cost` is the effort relative to
    the best known effort.
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
        """True if the plan is reported as reached but misses the target."""
        return self.reached and not self.error <= _WRONG

    def again(self) -> str:
        """Return a Python script that plans the case."""
        scene = SCENES[self.scene][1]
        lines = [
            "from octoplan.model import Arm, Scene",
            "from octoplan.model.effects import *",
            "from octoplan.model.extensions.contact import *",
            "from octoplan.planner import plan",
            "from octoplan.planner.targets import *",
            f"# {self.outcome}",
            f"# reached from tensions {self.drawn.tolist()}",
            f"target = {self.target!r}",
            f"result = plan(Arm.from_paper('table-4'), target, {to_code(scene)}, {MAXIMUM})",
            "print(result.outcome)",
        ]
        return "\n".join(lines) + "\n"


def to_code(scene: Scene) -> str:
    """Return the Python code of a scene."""
    return f"Scene({', '.join(repr(effect) for effect in scene.effects)})"


def run(job: tuple[int, int, int, Sequence[str]]) -> Case:
    """Return the case of a random target.

    A job contains the number of the case, the seed, the number of random starts to compare with,
    and the kinds of targets. The random generator depends only on seed and number, so that a case
    does not depend on the process that runs it.
    """
    number, seed, best_of, kinds = job
    rng = np.random.default_rng([seed, number])
    kind = kinds[number % len(kinds)]
    weights = np.array([weight for weight, _ in SCENES.values()], dtype=float)
    name = str(rng.choice(list(SCENES), p=weights / weights.sum()))
    scene = SCENES[name][1]
    T, target = draws.target(rng, kind, scene)
    case = {"number": number, "kind": kind, "scene": name, "target": target, "drawn": T}
    begin = time.process_time()
    try:
        result = plan(ARM, target, scene, MAXIMUM)
        passed = result.reached
        outcome = result.outcome
    except OctoplanError as problem:
        return Case(**case, outcome=f"{type(problem).__name__}: {problem}")
    seconds = time.process_time() - begin
    try:
        error = target_error(reference_shape(ARM, result.tensions, scene, 1e-9), target)
    except OctoplanError:
        error = np.inf
    near = max(result.certificate.soft_residual.values(), default=0.0) <= _NEAR
    cost = max(float(result.effort / np.linalg.norm(T)), _over_best(result, scene, best_of, rng))
    done = (passed and near, error, cost, seconds, len(result.solution.starts), outcome)
    return Case(**case, **dict(zip(_RESULTS, done, strict=True)))


_RESULTS = ("reached", "error", "cost", "seconds", "starts", "outcome")


def _solve_from_random(
    result: Plan, scene: Scene, options: NlpOptions, count: int, rng: np.random.Generator
) -> list[NlpSolution]:
    """Return the solutions from random starts of a plan's problem, on the mesh of the search."""
    limits = result.problem.limits
    problem = PlanningProblem(ARM, result.targets, scene, limits, options, result.problem.accuracy)
    coarse = ProgramInstance(problem, problem.coarse(result.mode))
    scale = np.minimum(np.repeat([0.6, 5.0, 15.0], 4), limits.upper)
    guesses = (rng.uniform() * rng.uniform(size=12) * scale for _ in range(count))
    tried = (solve_from_guess(coarse, T) for T in guesses)
    return [candidate for candidate in tried if candidate.converged]


def _over_best(result: Plan, scene: Scene, count: int, rng: np.random.Generator) -> float:
    """Return a plan's effort relative to the least effort of random starts, on the coarse mesh."""
    heavy = is_coupled(result.arm, scene) or scene.has(ExactTendons)
    if heavy or not count or result.mode != "exact":
        return 0.0
    options = NlpOptions(norm=result.problem.options.norm)
    solutions = _solve_from_random(result, scene, options, count, rng)
    best = min((np.linalg.norm(each.tensions) for each in solutions), default=np.inf)
    return float(result.effort / best) if 0 < best < np.inf else 0.0


def report(cases: Sequence[Case], beyond: bool) -> None:
    """Print one line for each kind, for each scene, and for all cases."""
    print(f"{'':<12}{'targets':>8}{'reached':>9}{'wrong':>7}{'within 1 %':>12}{'worst':>9}", end="")
    print(f"{'time [s]':>10}{'starts':>8}")
    groups = {
        kind: [c for c in cases if c.kind == kind] for kind in dict.fromkeys((*TARGET_OF, *BEYOND))
    }
    groups |= {name: [c for c in cases if c.scene == name] for name in SCENES}
    for name, group in (groups | {"all": list(cases)}).items():
        if not group:
            continue
        # Costs compare efforts of reached targets, or shortfalls of unreachable ones.
        counted = [c for c in group if c.reached is not beyond]
        costs = np.array([c.cost for c in counted])
        good, worst = (np.mean(costs <= 1.01), costs.max()) if counted else (np.nan, np.nan)
        times = np.array([c.seconds for c in counted])
        mean = np.exp(np.mean(np.log(times + _SHIFT))) - _SHIFT if counted else np.nan
        starts = np.mean([c.starts for c in counted]) if counted else np.nan
        share = np.mean([c.reached for c in group])
        wrong = sum(c.wrong for c in group)
        print(f"{name:<12}{len(group):>8}{share:>9.1%}{wrong:>7}{good:>12.1%}", end="")
        print(f"{worst:>9.3f}{mean:>10.3f}{starts:>8.1f}")


def write_failures(cases: Sequence[Case], out: Path) -> None:
    """Write scripts of the cases that failed or exceed the best effort by more than 1 %."""
    for case in cases:
        if case.wrong or not case.reached or case.cost > 1.01:
            why = "wrong" if case.wrong else "costly" if case.reached else "failed"
            out.mkdir(parents=True, exist_ok=True)
            (out / f"{why}_{case.number}_{case.kind}.py").write_text(case.again(), encoding="utf-8")


# Relative frequency of each scene. Scenes with plans that take seconds are rare.
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


@dataclass(frozen=True)
class Limited:
    """An arm in a scene, with tension limits that are active [N]."""

    arm: Arm
    scene: Scene
    maxima: tuple[float, ...]


def _section(at: float, base: float, end: float, count: int, first_angle: float) -> Anchorage:
    """Return a section of equally spaced tendons, the first one at `first_angle`."""
    angles = tuple((first_angle + 2 * np.pi * np.arange(count) / count).tolist())
    return Anchorage(at, Linear(base, end), angles)


_STRAIGHT = Linear(0.0, 0.0)
_HELICAL = Linear(0.0, 7.5)
LIMITED = {
    "helical": Limited(
        Arm(
            0.24,
            Linear(4e-3, 3e-3),
            (
                Anchorage(
                    0.24,
                    Linear(9e-3, 7e-3),
                    (0.0, 2.1, 4.2, 1.0),
                    turn=(_STRAIGHT, _STRAIGHT, _STRAIGHT, _HELICAL),
                ),
            ),
            Material(E=0.9e6, nu=0.35, density=1000.0),
            hull=Linear(0.016, 0.014),
        ),
        Scene(Extension(), ExactTendons(), Shear()),
        (0.15, 0.15, 0.15, 0.25),
    ),
    "thin": Limited(
        Arm(
            0.7,
            Linear(5e-3, 3e-3),
            (_section(0.7, 4e-3, 2.5e-3, 3, 0.3),),
            Material(E=300e3, nu=0.45, density=1100.0),
        ),
        Scene(Extension(), ExactTendons()),
        (0.35, 0.35, 0.35),
    ),
    "sections": Limited(
        Arm(
            0.6,
            Linear(12e-3, 5e-3),
            tuple(
                _section(0.1 * k, 0.8 * 12e-3, 0.8 * (12e-3 - 7e-3 * k / 6), 3, 0.4 * k)
                for k in range(6, 0, -1)
            ),
            Material(E=150e3, nu=0.5, density=1080.0),
        ),
        Scene(Extension()),
        tuple(np.repeat([0.03, 0.08, 0.16, 0.25, 0.4, 0.6], 3).tolist()),
    ),
}


def tip_of(limited: Limited, T: Array, accuracy: float = 1e-4) -> Array:
    """Return the tip (3,) under tensions [m], NaN if no equilibrium is found."""
    try:
        return settle(limited.arm, np.asarray(T, dtype=float), limited.scene, accuracy).tip
    except OctoplanError:
        return np.full(3, np.nan)


@lru_cache(maxsize=3)
def grid_of(limited: Limited) -> tuple[Array, Array]:
    """Return tensions (m, n_tendons) [N] within the limits, and the tips (m, 3) [m].

    The tensions form a regular grid if the arm has few tendons; otherwise they are random, with
    half of the tendons slack.
    """
    n = limited.arm.n_tendons
    levels = round(_GRID ** (1 / n))
    if levels > 2:
        shares = np.array(list(product(np.linspace(0.0, 1.0, levels), repeat=n)))
    else:
        rng = np.random.default_rng(0)
        shares = rng.uniform(size=(_GRID, n)) * (rng.uniform(size=(_GRID, n)) < 0.5)
    tensions = shares * np.array(limited.maxima)
    return tensions, np.array([tip_of(limited, T, 1e-3) for T in tensions])


def nearest_of_grid(limited: Limited, place: Array) -> float:
    """Return the least distance of a tip from a point [m], found without the planner."""
    tensions, tips = grid_of(limited)
    distance = np.linalg.norm(tips - place, axis=1)
    most = np.array(limited.maxima)
    L = limited.arm.length

    def squared(share: Array) -> float:
        miss = float(np.linalg.norm(tip_of(limited, share * most, 1e-8) - place)) / L
        return miss**2 if np.isfinite(miss) else 10.0

    best = np.inf
    for i in np.argsort(distance)[:_BEST]:
        bounds = [(0.0, 1.0)] * most.size
        end = minimize(
            squared,
            tensions[i] / most,
            method="L-BFGS-B",
            bounds=bounds,
            options={"eps": 1e-5, "maxiter": 60},
        )
        best = min(best, float(np.sqrt(end.fun)) * L)
    return best


def run_limited(number: int, seed: int, kind: str) -> Case:
    """Return the case of a random tip for an arm with active limits, compared with a grid."""
    rng = np.random.default_rng([seed, number])
    limited = LIMITED[kind]
    way = rng.normal(size=3)
    L = limited.arm.length
    place = rng.uniform(*_WITHIN) * L * way / np.linalg.norm(way)
    target = TipPosition(tuple(place.tolist()))
    begin = time.process_time()
    result = plan(limited.arm, target, limited.scene, np.array(limited.maxima))
    seconds = time.process_time() - begin
    case = Case(number, kind, kind, target, np.array(limited.maxima), seconds=seconds)
    case = replace(case, starts=len(result.solution.starts), outcome=result.outcome)
    miss = float(np.linalg.norm(tip_of(limited, np.ravel(result.tensions), 1e-8) - place))
    if result.reached:
        return replace(case, reached=True, error=miss / L)
    best = nearest_of_grid(limited, place)
    return replace(case, error=miss / L, cost=miss / max(best, _ROUNDED * L))


def run_beyond(job: tuple[int, int, int, Sequence[str]]) -> Case:
    """Return the case of a random unreachable target, compared with random starts.

    The cost is the shortfall of the plan relative to the least shortfall of the random starts.
    """
    number, seed, best_of, kinds = job
    if kinds[number % len(kinds)] in LIMITED:
        return run_limited(number, seed, kinds[number % len(kinds)])
    rng = np.random.default_rng([seed, number])
    kind = kinds[number % len(kinds)]
    name = ("bare", "extension")[rng.integers(2)]
    scene = SCENES[name][1]
    target, maxima = beyond(rng, kind, scene)
    case = Case(number, kind, name, target, np.array(maxima))
    begin = time.process_time()
    result = plan(ARM, target, scene, maxima)
    case = replace(case, seconds=time.process_time() - begin, starts=len(result.solution.starts))
    case = replace(case, outcome=result.outcome)
    if result.reached and max(result.certificate.soft_residual.values(), default=0.0) <= _NEAR:
        error = target_error(settle(ARM, result.tensions, scene, 1e-9), target)
        return replace(case, reached=True, error=error)
    solutions = _solve_from_random(result, scene, NlpOptions(), best_of, rng)
    best = min((s.f for s in solutions), default=np.inf)
    values = min((s.objective for s in result.solution.starts if s.met), default=np.inf)
    return replace(case, cost=float(np.sqrt(values / best)) if values < np.inf else np.inf)


def beyond(rng: np.random.Generator, kind: str, scene: Scene) -> tuple[Target, Array | float]:
    """Return a target and tension limits, (12,) or scalar [N], that are too low to reach it."""
    way = rng.normal(size=3)
    far = tuple((rng.uniform(*_FAR) * ARM.length * way / np.linalg.norm(way)).tolist())
    if kind == "tip":
        return TipPosition(far), MAXIMUM
    if kind in ("pose", "turned"):
        pose = draws.target(rng, "pose", scene)[1]
        assert isinstance(pose, TipPose)
        if kind == "pose":
            return TipPose(far, pose.frame), MAXIMUM
        turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
        turn[:, 0] *= np.linalg.det(turn)
        return TipPose(pose.position, tuple(tuple(row) for row in turn.tolist())), MAXIMUM
    T, target = draws.target(rng, kind, scene)
    most = np.repeat(T.max(axis=1), T.shape[1])
    return target, np.maximum(most / rng.uniform(*_STRONG), 1e-3)


def main(argv: Sequence[str] | None = None) -> None:
    """Print the table and write scripts of failed cases."""
    args = asked(
        __doc__,
        argv,
        {
            "--targets": 1000,
            "--best-of": 10,
            "--jobs": 2,
            "--seed": 0,
            "--kinds": (
                None,
                {"choices": list(dict.fromkeys((*TARGET_OF, *BEYOND))), "nargs": "*"},
            ),
            "--beyond": (False, {"help": "plan unreachable targets"}),
            "--case": (None, {"help": "print a script of this case, and no table", "type": int}),
            "--out": Path("out"),
        },
    )
    work, kinds = (run_beyond, BEYOND) if args.beyond else (run, tuple(TARGET_OF))
    kinds = tuple(args.kinds or kinds)
    if args.case is not None:
        print(work((args.case, args.seed, args.best_of, kinds)).again(), end="")
        return
    jobs = [(i, args.seed, args.best_of, kinds) for i in range(args.targets)]
    cases: list[Case] = []
    pool = ProcessPoolExecutor(args.jobs)
    with keep_finished():
        for case in tqdm(pool.map(work, jobs), total=len(jobs), disable=None):
            cases.append(case)
    pool.shutdown(cancel_futures=True)
    report(cases, args.beyond)
    if not args.beyond:
        write_failures(cases, args.out / "planner_suite")


if __name__ == "__main__":
    main()
