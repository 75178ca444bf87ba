"""Nearly singular allocations: tendons that nearly coincide share the pull of one.

A cylinder with three tendons reaches a tip by one set of tensions only: bending and shortening
are three conditions. With each tendon replaced by several at nearly the same angle, the least sum
of squares splits each tension evenly, to first order in the spread of the angles.
"""

from __future__ import annotations

import numpy as np

from octoplan.model import Anchorage, Arm, Linear, Scene
from octoplan.model.effects import Extension
from octoplan.planner import plan
from octoplan.planner.targets import TipPosition
from tests.core.hard_cases.family import Array, Family, RefusedError, WrongAnswerError
from tests.oracles import Rod, RodSection, linear, poses
from tests.random_arms import log_uniform

L, R, Y = 0.2, 0.01, 0.007
EJ = 110e3 * np.pi * R**4 / 4
THIRDS = 2 * np.pi / 3 * np.arange(3)


def doubled(rng: np.random.Generator) -> tuple[Array, int, float]:
    """Draw three tensions [N], the number of tendons at each place, and their spread [rad].

    The bend is 0.05 to 1.5 rad, and the spread 0 or 1e-12 to 1e-3.
    """
    T = rng.uniform(0, 1, 3) * (rng.uniform(size=3) < 0.7)
    T += (T == 0) * rng.uniform(0.02, 0.05, 3)
    bend = np.linalg.norm([T @ np.cos(THIRDS), T @ np.sin(THIRDS)]) * Y * L / EJ
    spread = 0.0 if rng.uniform() < 0.3 else log_uniform(rng, 1e-12, 1e-3)
    return T * rng.uniform(0.05, 1.5) / max(bend, 1e-3), int(rng.integers(2, 6)), spread


def check_doubled(T: Array, times: int, spread: float) -> float:
    """Return the larger error of the tip, over L, and of the effort beyond the spread."""
    single = Rod(L, linear(R, R, L), (RodSection(L, linear(Y, Y, L), tuple(THIRDS)),))
    tip = poses(single, T, [L], True)[0][0]
    angles = np.ravel(THIRDS[:, None] + spread * np.linspace(-1, 1, times))
    section = Anchorage(L, Linear(Y, Y), tuple(angles.tolist()))
    arm = Arm(L, Linear(R, R), (section,))
    found = plan(arm, TipPosition(tuple(tip.tolist())), Scene(Extension()), 50 * T.max())
    if not found.certificate.passed:
        raise RefusedError(found.outcome)
    many = Rod(L, linear(R, R, L), (RodSection(L, linear(Y, Y, L), tuple(angles.tolist())),))
    reached = poses(many, np.ravel(found.tensions), [L], True)[0][0]
    gap = float(np.linalg.norm(reached - tip)) / L
    effort = found.effort * np.sqrt(times) / float(np.linalg.norm(T)) - 1
    if abs(effort) > 1e-3 + 2 * spread:
        raise WrongAnswerError(f"the effort is off by {effort:.1e}")
    return gap


DOUBLED = Family("nearly singular allocations", 2e-6, doubled, check_doubled)
