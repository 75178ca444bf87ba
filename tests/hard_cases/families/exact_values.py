"""Where values are exact: no tension, equal antagonists; derivatives there, from one side."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from model import Arm, Scene, conical, settle, tip_jacobian
from model.effects import ExactTendons, Extension, TipLoad
from planner import stiffness
from tests.hard_cases.family import Array, Family

SCENES = {
    "bare": Scene(),
    "paper": Scene(Extension()),
    "exact": Scene(Extension(), ExactTendons()),
    "silicone": Scene.silicone(),
}


@dataclass(frozen=True, eq=False)
class Member:
    """An arm with four tendons a section, its statics, and the pull of all of each section."""

    arm: Arm
    statics: str
    pull: Array


def draw(rng: np.random.Generator) -> Member:
    """A third of the members pull nowhere, the others alike on all sides of some sections."""
    L, n = rng.uniform(0.2, 0.5), int(rng.integers(1, 4))
    ends = L * (1 - np.arange(n) / n)
    anchorages = [(at, *rng.uniform(1e-3, 4e-3, 2)) for at in ends]
    pull = rng.uniform(0, 0.5, n) * (rng.uniform(size=n) < 0.7) * (rng.uniform() < 2 / 3)
    arm = conical(float(L), (0.015, 0.005), anchorages)
    return Member(arm, str(rng.choice(list(SCENES))), pull)


def check(member: Member) -> float:
    """Return the worst error of a derivative, or 1e7 times how far the arm is from straight."""
    arm, scene, T = member.arm, SCENES[member.statics], np.repeat(member.pull, 4)
    shape = settle(arm, T, scene, 1e-12)
    s = np.linspace(0, arm.length, 23)
    # An unloaded arm's mesh adds up to its length but for rounding.
    length = arm.length if not T.any() or member.statics == "bare" else shape.tip[0]
    apart = np.linalg.norm(shape.tip - [length, 0, 0]) / arm.length
    apart = max(apart, np.abs(shape.strain(s)[:, :3]).max() * arm.length)
    apart = max(apart, np.abs(shape.tip_frame - np.diag([1, -1, -1])).max())
    return max(1e7 * float(apart), slope_error(arm, T, scene), compliance_error(member))


def slope_error(arm: Arm, T: Array, scene: Scene) -> float:
    """Return the relative error of the tip's Jacobian against one-sided differences."""
    found = tip_jacobian(arm, T, scene, 1e-10)
    wanted, h = np.zeros((3, T.size)), 1e-3
    steps = np.array([0, 1, 2, 3]) * h
    weight = np.array([-11, 18, -9, 2]) / (6 * h)
    for j in range(T.size):
        tips = [settle(arm, T + d * np.eye(T.size)[j], scene, 1e-12).tip for d in steps]
        wanted[:, j] = weight @ np.array(tips)
    gap = np.abs(found[:3] - wanted).max() / np.abs(wanted).max()
    return float(gap) if np.isfinite(found).all() else np.inf


def compliance_error(member: Member) -> float:
    """Return the relative error of the lateral compliance against a difference."""
    if member.statics not in ("bare", "paper"):
        return 0.0
    arm, scene, T = member.arm, SCENES[member.statics], np.repeat(member.pull, 4)
    found = stiffness(arm, T, scene, accuracy=1e-9).compliance
    force = 1e-4 * arm.length / found[1, 1]
    tips = []
    for share in (0.0, 0.5, 1.0):
        load = TipLoad((0.0, share * force, 0.0))
        tips.append(settle(arm, T, Scene(*scene.effects, load), 1e-11).tip)
    wanted = (4 * tips[1] - 3 * tips[0] - tips[2]) / force
    gap = np.abs(found[:3, 1] - wanted).max() / np.abs(wanted).max()
    return float(gap) if np.isfinite(found).all() else np.inf


FAMILY = Family("exact values", 1e-6, draw, check)
