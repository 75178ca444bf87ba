"""Does `settle` keep its word?

Question: over random arms, scenes and accuracies, is the tip within the accuracy that was asked and
within the error that is stated? What that costs is the question of the study accuracy.

Assumptions: a case is an arm of the paper, tensions, a scene and an accuracy. Verified against a
shape of 1e-11, or the finest that is reached, by collocation in scenes without loads.

Command: python -m studies.speed knob [--cases 300]

Answer: in studies/README.md.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from octoplan.model import (
    Arm,
    CollapsedError,
    ConvergenceError,
    OctoplanError,
    Scene,
    SnapError,
    settle,
)
from octoplan.model.effects import (
    Buoyancy,
    Current,
    Effect,
    ExactTendons,
    Extension,
    PointLoad,
    Shear,
    TipLoad,
    Weight,
)
from octoplan.model.extensions.friction import Friction
from octoplan.model.paths import Array
from studies import draws
from studies.reference import reference_shape
from studies.reporting import asked

ARMS = ("table-2", "table-4")
Draw = Callable[[np.random.Generator, Arm], tuple[Effect, ...]]


def _vector(rng: np.random.Generator, most: float) -> tuple[float, ...]:
    direction = rng.normal(size=3)
    return tuple((rng.uniform() * most * direction / np.linalg.norm(direction)).tolist())


def _force(rng: np.random.Generator, arm: Arm) -> tuple[float, ...]:
    """Return a force at the tip [N], small against what bends the tip's section to its length."""
    R = float(arm.radius.evaluate(np.array([arm.length]), arm.length)[0][0])
    return _vector(rng, 1.0 * arm.material.E * R**4 / arm.length**2)


def _point(rng: np.random.Generator, arm: Arm) -> tuple[Effect, ...]:
    return (PointLoad(rng.uniform(0.3, 0.7) * arm.length, _vector(rng, 5e-3)),)


SCENES: dict[str, Draw] = {
    "bare": lambda rng, arm: (),
    "extension": lambda rng, arm: (Extension(),),
    "as printed": lambda rng, arm: Scene.as_printed().effects,
    "exact": lambda rng, arm: (Extension(), ExactTendons()),
    "silicone": lambda rng, arm: Scene.silicone().effects,
    "weight": lambda rng, arm: (Extension(), Weight(_vector(rng, 1.0))),
    "weight, buoyancy": lambda rng, arm: (Extension(), Weight(), Buoyancy(rng.uniform(900, 1100))),
    "tip load": lambda rng, arm: (Extension(), TipLoad(_force(rng, arm))),
    "follower": lambda rng, arm: (Extension(), TipLoad(_force(rng, arm), follower=True)),
    "point load": lambda rng, arm: (Extension(), *_point(rng, arm)),
    "current": lambda rng, arm: (Extension(), Current(_vector(rng, 0.1))),
    "friction": lambda rng, arm: (Extension(), Friction(rng.uniform(0.01, 0.15))),
    "shear": lambda rng, arm: (Extension(), Shear(rng.uniform(0.8, 1.0))),
}


@dataclass(frozen=True, eq=False)
class Case:
    """A settle and what became of it; errors are tip errors over the arm's length.

    Attributes
    ----------
    stated, true : float
        What settle says of its error, and what it is; infinite where it ends in an error.
    """

    arm: str
    scene_name: str
    scene: Scene
    T: Array
    asked: float
    stated: float
    true: float
    chosen: str

    def __str__(self) -> str:
        return (
            f"{self.arm}, {self.scene_name}: asked {self.asked:.2e}, stated {self.stated:.2e}, "
            f"true {self.true:.2e}, {self.chosen}"
        )

    def again(self) -> str:
        """Return Python that settles the case again."""
        T = ", ".join(f"{v:.17g}" for v in self.T)
        return f'settle(Arm.from_paper("{self.arm}"), [{T}], {self.scene!r}, {self.asked!r})'


def run(count: int, rng: np.random.Generator) -> list[Case]:
    """Settle `count` random cases, as many of each arm and scene.

    Loads are drawn anew for every third case of a scene only, as each builds its own functions.
    """
    kinds = [(name, kind) for name in ARMS for kind in SCENES]
    results: list[Case] = []
    for i, (name, kind) in enumerate(kinds):
        arm, wanted = Arm.from_paper(name), len(range(i, count, len(kinds)))
        cases: list[Case] = []
        scene = Scene(*SCENES[kind](rng, arm))
        while len(cases) < wanted:
            T = draws.tensions(arm, rng, rng.uniform(0.2, 1.5), slack=rng.choice([0.0, 0.5]))
            request = float(10 ** rng.uniform(-9, -3))
            try:
                true = tightest(arm, T, scene)
            except (SnapError, CollapsedError):
                scene = Scene(*SCENES[kind](rng, arm))
                continue
            cases.append(
                Case(name, kind, scene, T, request, *settled(arm, T, scene, request, true))
            )
            if len(cases) % 3 == 0:
                scene = Scene(*SCENES[kind](rng, arm))
        results += cases
    return results


def settled(
    arm: Arm, T: Array, scene: Scene, request: float, true: Array
) -> tuple[float, float, str]:
    """Return the stated error of a settle, the true one, and its integrator and refinement."""
    try:
        shape = settle(arm, T, scene, request)
    except OctoplanError as problem:
        return np.nan, np.inf, f"{type(problem).__name__}: {problem}"
    error = float(np.linalg.norm(shape.tip - true)) / arm.length
    return shape.error, error, f"{shape.scheme} {shape.refinement}"


def tightest(arm: Arm, T: Array, scene: Scene) -> Array:
    """Return the reference tip at the finest accuracy that is reached."""
    for accuracy in (1e-11, 3e-11, 1e-10):
        try:
            return reference_shape(arm, T, scene, accuracy).tip
        except ConvergenceError as problem:
            last = problem
    raise last


def report(cases: list[Case], worst: int = 5) -> None:
    """Print how many cases keep to what was asked, and the worst of them."""
    off = np.array([case.true / case.asked for case in cases])
    stated = np.mean([case.true <= case.stated for case in cases])
    print(f"knob: {len(cases)} random cases over {len(ARMS)} arms and {len(SCENES)} scenes")
    print(
        f"  error within what was asked      {np.mean(off <= 1):8.1%}, at most {max(off):.2f} times"
    )
    print(f"  error within what was stated     {stated:8.1%}")
    for i in np.argsort(-off)[:worst]:
        print(f"    error {off[i]:.2f} of what was asked: {cases[i]}")
    for i in np.flatnonzero(off > 1):
        print(f"    fails: {cases[i].again()}  # {cases[i]}")


def main(argv: Sequence[str] | None = None) -> None:
    """Settle random cases and print what became of them."""
    args = asked(
        __doc__,
        argv,
        {
            "--cases": 300,
            "--seed": 0,
        },
        prog="python -m studies.speed knob",
    )
    report(run(args.cases, np.random.default_rng(args.seed)))
