"""Does `settle` meet the accuracy it is asked for?

Questions: For random tensions, scenes and accuracies, is the tip error below the requested
accuracy, and below the error that `settle` reports? The study `accuracy` measures the cost.

Assumptions: A case consists of an arm of the paper, tensions, a scene and an accuracy. The
reference is a shape with an accuracy of 1e-11, or the finest accuracy that is reached, from
collocation in scenes without loads.

Command: python -m studies.speed knob [--cases 300]

Answer: in studies/README.md.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from octoplan.model import Arm, OctoplanError, Scene, SnapError, settle
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
from octoplan.model.effects.base import Effect
from octoplan.model.extensions.friction import Friction
from octoplan.model.paths import Array
from octoplan.model.support.errors import CollapsedError, ConvergenceError
from studies import draws
from studies.reference import reference_shape
from studies.reporting import asked

ARMS = ("table-2", "table-4")
Draw = Callable[[np.random.Generator, Arm], tuple[Effect, ...]]


def _vector(rng: np.random.Generator, most: float) -> tuple[float, ...]:
    direction = rng.normal(size=3)
    return tuple((rng.uniform() * most * direction / np.linalg.norm(direction)).tolist())


def _force(rng: np.random.Generator, arm: Arm) -> tuple[float, ...]:
    """Return a random force at the tip [N], of at most E R^4 / L^2 for the tip radius R."""
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
    """The result of a call of `settle`. Errors are tip errors relative to the arm's length.

    Attributes
    ----------
    requested : float
        The requested accuracy.
    reported, true : float
        The error that `settle` reports, NaN if an exception is raised; and the true error,
        infinite in this case.
    chosen : str
        Integrator and refinement, or the exception.
    """

    arm: str
    scene_name: str
    scene: Scene
    T: Array
    requested: float
    reported: float
    true: float
    chosen: str

    def __str__(self) -> str:
        return (
            f"{self.arm}, {self.scene_name}: requested {self.requested:.2e}, "
            f"reported {self.reported:.2e}, "
            f"true {self.true:.2e}, {self.chosen}"
        )

    def again(self) -> str:
        """Return Python code that repeats the case."""
        T = ", ".join(f"{v:.17g}" for v in self.T)
        return f'settle(Arm.from_paper("{self.arm}"), [{T}], {self.scene!r}, {self.requested!r})'


def run(count: int, rng: np.random.Generator) -> list[Case]:
    """Run `count` random cases, with the same number for each arm and scene.

    The loads of a scene change only after three cases, because new loads require new functions.
    """
    kinds = [(name, kind) for name in ARMS for kind in SCENES]
    results: list[Case] = []
    for i, (name, kind) in enumerate(kinds):
        arm = Arm.from_paper(name)
        wanted = len(range(i, count, len(kinds)))
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
                Case(name, kind, scene, T, request, *errors_of_settle(arm, T, scene, request, true))
            )
            if len(cases) % 3 == 0:
                scene = Scene(*SCENES[kind](rng, arm))
        results += cases
    return results


def errors_of_settle(
    arm: Arm, T: Array, scene: Scene, request: float, true: Array
) -> tuple[float, float, str]:
    """Return the reported and the true error of `settle`, and its integrator and refinement."""
    try:
        shape = settle(arm, T, scene, request)
    except OctoplanError as problem:
        return np.nan, np.inf, f"{type(problem).__name__}: {problem}"
    error = float(np.linalg.norm(shape.tip - true)) / arm.length
    return shape.error, error, f"{shape.scheme} {shape.refinement}"


def tightest(arm: Arm, T: Array, scene: Scene) -> Array:
    """Return the reference tip (3,) [m] with the finest accuracy that is reached."""
    for accuracy in (1e-11, 3e-11, 1e-10):
        try:
            return reference_shape(arm, T, scene, accuracy).tip
        except ConvergenceError as problem:
            last = problem
    raise last


def report(cases: list[Case], worst: int = 5) -> None:
    """Print the share of cases within the requested accuracy, and the worst cases."""
    off = np.array([case.true / case.requested for case in cases])
    reported = np.mean([case.true <= case.reported for case in cases])
    print(f"knob: {len(cases)} random cases over {len(ARMS)} arms and {len(SCENES)} scenes")
    print(
        f"  error within the requested accuracy {np.mean(off <= 1):8.1%}, "
        f"largest ratio {max(off):.2f}"
    )
    print(f"  error within the reported error     {reported:8.1%}")
    for i in np.argsort(-off)[:worst]:
        print(f"    error {off[i]:.2f} times the requested accuracy: {cases[i]}")
    for i in np.flatnonzero(off > 1):
        print(f"    fails: {cases[i].again()}  # {cases[i]}")


def main(argv: Sequence[str] | None = None) -> None:
    """Run random cases and print the results."""
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
