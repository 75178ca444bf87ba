"""What do a warm re-plan and its certificate consist of: what is left if Python cost nothing?

Question: of the processor's time of a re-plan after a step of the target of 2 mm, and of its
certificate, how much goes into evaluating kernels, linear algebra and solvers (ipopt, DAQP), and
how much is left for Python and NumPy's small calls?

Assumptions: as the study follow. Calls are timed where they enter compiled code, each without what
it calls in turn; evaluations are those of CasADi's functions and compiled kernels but for the ones
that solvers ask for, which count for these; linear algebra is that of LAPACK's band matrices
and dense ones. Timing itself counts as Python.

Command: python -m studies.speed floors [--steps 100] [--scenes paper silicone-in-water] [--seed 0]

Answer (40 steps, a slow machine with other work): in the paper's scene a re-plan takes 16 ms, of
which ipopt are 12 and Python 3.5, and its certificate 5, of which Python is 3 and kernels 1.4. In
silicone in water a re-plan takes 42 ms, of which ipopt are 25, Python 11, linear algebra 5 and
kernels 1.4, and its certificate 10, of which Python is 6.5.
"""

from __future__ import annotations

import argparse
import time
from collections import defaultdict
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from itertools import islice
from typing import Any
from unittest.mock import patch

import numpy as np

from model import Arm
from model.equilibrium.linearised import Linearised
from model.machine.buffered import Buffered, Mapped
from planner.solve import refine, search
from studies.speed.follow import path, timed_plan
from studies.tip_targets import SCENES

_PARTS = ("evaluation", "linear algebra", "solver", "Python")


class Clock:
    """Adds up the processor's time by part; what a part calls of another does not count for it."""

    def __init__(self) -> None:
        self.spent: dict[str, float] = defaultdict(float)
        self._parts, self._since = ["Python"], time.process_time()

    def enter(self, part: str) -> None:
        """Go on with another part; what a solver calls counts for the solver."""
        self._tick()
        self._parts.append("solver" if self._parts[-1] == "solver" else part)

    def leave(self) -> None:
        """Go back to the part before."""
        self._tick()
        self._parts.pop()

    def taken(self) -> dict[str, float]:
        """Return what was spent since this was asked last [s]."""
        self._tick()
        found, self.spent = dict(self.spent), defaultdict(float)
        return found

    def _tick(self) -> None:
        now = time.process_time()
        self.spent[self._parts[-1]] += now - self._since
        self._since = now


@contextmanager
def timed(clock: Clock) -> Iterator[None]:
    """Let a clock see where the work enters compiled code."""

    def counted(owner: Any, name: str, part: str) -> Any:
        call: Callable[..., Any] = getattr(owner, name)

        def within(*args: Any, **kwargs: Any) -> Any:
            clock.enter(part)
            try:
                return call(*args, **kwargs)
            finally:
                clock.leave()

        return patch.object(owner, name, within)

    with ExitStack() as stack:
        for own in (Buffered, Mapped):
            stack.enter_context(counted(own, "__call__", "evaluation"))
        for module in (search, refine):
            stack.enter_context(counted(module, "solve", "solver"))
        stack.enter_context(counted(Linearised, "solve", "linear algebra"))
        stack.enter_context(counted(Linearised.factor, "func", "linear algebra"))
        for name in ("solve", "inv", "eigvals", "eigvalsh", "cholesky"):
            stack.enter_context(counted(np.linalg, name, "linear algebra"))
        yield


def floors(name: str, steps: int, rng: np.random.Generator) -> None:
    """Print what re-plans along a path, and their certificates, consist of."""
    arm, scene = Arm.from_paper("table-4"), SCENES[name]
    tips = list(islice(path(arm, scene, rng), steps + 4))
    p, _, _ = timed_plan(arm, scene, tips[0], None)
    for tip in tips[1:4]:
        p, _, _ = timed_plan(arm, scene, tip, p)
    clock, plans, checks = Clock(), list[dict[str, float]](), list[dict[str, float]]()
    with timed(clock):
        for tip in tips[4:]:
            clock.taken()
            p, _, _ = timed_plan(arm, scene, tip, p, check=False)
            plans.append(clock.taken())
            p.certificate  # noqa: B018  (found when it is asked for)
            checks.append(clock.taken())
    for what, found in (("re-plan", plans), ("certificate", checks)):
        row = "".join(
            f"{1e3 * np.median([one.get(part, 0.0) for one in found]):16.2f}" for part in _PARTS
        )
        print(f"{name + ': ' + what:<32}{row}")


def main(argv: Sequence[str] | None = None) -> None:
    """Run the study and print its table."""
    parser = argparse.ArgumentParser(
        prog="python -m studies.speed floors", description=__doc__.splitlines()[0]
    )
    parser.add_argument("--steps", type=int, default=20)
    parser.add_argument("--scenes", nargs="*", choices=SCENES, default=["paper"])
    parser.add_argument("--seed", type=int, default=0)
    args = parser.parse_args(argv)
    print(f"{'ms of the processor, medians':<32}{''.join(f'{part:>16}' for part in _PARTS)}")
    for name in args.scenes:
        floors(name, args.steps, np.random.default_rng(args.seed))
