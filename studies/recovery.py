"""Does `calibrate` recover the parameters of an arm from noisy markers, with honest intervals?

Questions: For random hanging arms in random scenes with noisy markers, how often do the 68 and 95 %
confidence intervals contain the true parameters, and how often do the joint regions contain all of
them? Does `calibrate` report parameters that cannot be distinguished, and outliers?

Assumptions: Cones of 0.1 to 0.4 m with one or two sections of two to four tendons; exact tendons or
the paper's, linear or neo-Hookean body; no loads, weight or weight in water, with or without a
payload. Each shape has three markers. The noise is 0.1 to 2 mm, the same for all markers, and not
given to the fit. The initial guess is wrong by up to 15 %, with one to eight unknowns. Trade-offs:
modulus, density under weight, and a common factor of all tensions, without a payload. Outliers: one
marker in one of eight shapes is wrong by 30 standard deviations; the loss is soft-L1.

Command: python -m studies.recovery [--arms 200] [--seed 0] [--cases 40]

Answer: in studies/README.md.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import f as fisher

from octoplan.model import Anchorage, Arm, Linear, Material, OctoplanError, Scene, settle
from octoplan.model.effects import Buoyancy, ExactTendons, Extension, NeoHookean, PointMass, Weight
from octoplan.model.effects.base import Effect
from octoplan.planner import Measured, Unknown, calibrate
from studies.reporting import asked

DOWN = ((0.0, 0.0, 1.0), (0.0, 1.0, 0.0), (-1.0, 0.0, 0.0))
LAWS: tuple[tuple[Effect, ...], ...] = (
    (Extension(),),
    (Extension(), ExactTendons()),
    (Extension(), ExactTendons(), NeoHookean()),
)
LOADS: tuple[tuple[Effect, ...], ...] = ((), (Weight(),), (Weight(), Buoyancy(1000.0)))
# Confidence levels of the intervals and regions.
LEVELS = (0.68, 0.95)
# Number of measured shapes.
SHAPES = 5
# Arc lengths of the markers, relative to the arm's length.
MARKERS = (0.35, 0.7, 1.0)
# Error of an outlier, in standard deviations.
OUTLIER = 30.0
MM = 1e3


@dataclass(frozen=True)
class Recovered:
    """Success of the intervals (K,) and of the region of a random arm, for each level.

    True means that the interval or region contains the true parameters.
    """

    intervals: tuple[tuple[bool, ...], ...]
    regions: tuple[bool, ...]


@dataclass(frozen=True, eq=False)
class RandomArm:
    """A random arm, its scene, the noise of its markers [m], and the true parameters."""

    arm: Arm
    scene: Scene
    noise: float
    truth: dict[str, float]

    def unknowns(self, keys: Sequence[str]) -> list[Unknown]:
        """Return unknowns whose bounds contain the true values and the initial guesses."""
        turns = {key: 40.0 if "deg" in key else 20.0 for key in keys if key not in _SCALED}
        rows = [(key, self.truth[key]) for key in keys]
        reach = [turns.get(key, 0.6 * abs(x)) for key, x in rows]
        return [Unknown(key, x - r, x + r) for (key, x), r in zip(rows, reach, strict=True)]

    def guess(self, keys: Sequence[str], rng: np.random.Generator) -> tuple[Arm, Scene]:
        """Return arm and scene with errors of modulus, density and payload of up to 15 %."""
        off = 1 + rng.uniform(-0.15, 0.15, 3)
        values = self.arm.material
        E = values.E * (off[0] if "arm.E_kPa" in keys else 1.0)
        density = values.density * (off[1] if "arm.density" in keys else 1.0)
        lighter = off[2] if MASS in keys else 1.0
        effects = [
            replace(effect, mass=lighter * effect.mass) if isinstance(effect, PointMass) else effect
            for effect in self.scene.effects
        ]
        material = replace(values, E=E, density=density)
        return replace(self.arm, material=material), Scene(*effects)


MASS = "effects.point_masses[0].mass_g"
# Unknowns with bounds of +-60 % around the truth. Others have fixed widths in degrees or mm.
_SCALED = (
    "arm.E_kPa",
    "arm.density",
    "arm.sections[0].offset_mm[0]",
    "points[1].offset_mm[2]",
    "points[0].s_mm",
    "tension_scale[0]",
    MASS,
)


def arm_of(rng: np.random.Generator) -> Arm:
    """Return a random hanging arm."""
    L = rng.uniform(0.1, 0.4)
    R = rng.uniform(0.03, 0.06)
    ends = [1.0, rng.uniform(0.4, 0.7)][: int(rng.integers(1, 3))]
    sections = []
    for end in ends:
        count = int(rng.integers(2, 5))
        angles = rng.uniform(0, 1) + 2 * np.pi / count * np.arange(count)
        y = R * L * np.array([rng.uniform(0.4, 0.7), rng.uniform(0.15, 0.3)])
        sections.append(Anchorage(end * L, Linear(*y.tolist()), tuple(angles.tolist())))
    radius = Linear(R * L, R * L * rng.uniform(0.4, 0.9))
    material = Material(10 ** rng.uniform(4.8, 5.6), rng.uniform(0.3, 0.5), 1100.0)
    return Arm(L, radius, tuple(sections), material, DOWN)


def shapes_of(
    arm: Arm, scene: Scene, noise: float, rng: np.random.Generator, count: int = SHAPES
) -> list[Measured]:
    """Return measured shapes of an arm under random tensions that bend it by about 1 rad."""
    results = list[Measured]()
    R = arm.radius.evaluate(np.zeros(1), arm.length)[0][0]
    usual = arm.material.E * np.pi * R**3 / (2 * arm.length)
    while len(results) < count:
        T = usual * rng.uniform(0, 1, arm.n_tendons) ** 3
        try:
            shape = settle(arm, T, scene, accuracy=1e-7)
        except OctoplanError:
            continue
        points = []
        for share in MARKERS:
            s = share * arm.length
            offset = (0.0, 0.5 * R, R)
            place = shape.position(s) + shape.frame(s) @ np.array(offset)
            points.append((s, offset, place + noise * rng.normal(size=3)))
        results.append(Measured(T, points, name=f"shape {len(results)}"))
    return results


def random_arm(rng: np.random.Generator, payload: bool = True) -> RandomArm:
    """Return a random arm with the true values of all possible unknowns."""
    arm = arm_of(rng)
    law = LAWS[int(rng.integers(len(LAWS)))]
    loads = LOADS[int(rng.integers(len(LOADS)))]
    R = arm.radius.evaluate(np.zeros(1), arm.length)[0][0]
    if loads and payload and rng.integers(2):
        body = np.pi * R**2 * arm.length * arm.material.density
        loads = (*loads, PointMass(0.6 * arm.length, 0.1 * body))
    scene = Scene(*law, *loads)
    tip = arm.sections[0]
    base = float(tip.offset.evaluate(np.zeros(1), tip.at)[0][0])  # type: ignore[union-attr]
    truth = {
        "arm.E_kPa": arm.material.E / 1e3,
        "arm.sections[0].offset_mm[0]": MM * base,
        "arm.sections[0].angles_deg[0]": float(np.degrees(tip.angles[0])),
        "points[1].offset_mm[2]": MM * R,
        "points[0].s_mm": MM * MARKERS[0] * arm.length,
        "arm.base_rotation_deg[1]": 0.0,
        "arm.base_position_mm[2]": 0.0,
        "tension_scale[0]": 1.0,
    }
    if loads:
        truth["arm.density"] = arm.material.density
    if scene.has(PointMass):
        truth[MASS] = MM * next(load.mass for load in loads if isinstance(load, PointMass))
    return RandomArm(arm, scene, 10 ** rng.uniform(-4, -2.7), truth)


def recovered(seed: int) -> Recovered:
    """Return the result of a calibration of a random arm."""
    rng = np.random.default_rng(seed)
    case = random_arm(rng)
    count = int(rng.integers(1, 9))
    keys = rng.permutation(list(case.truth))[:count].tolist()
    measured = shapes_of(case.arm, case.scene, case.noise, rng)
    result = calibrate(*case.guess(keys, rng), measured, case.unknowns(keys))
    off = (result.array - [case.truth[key] for key in keys]) / result.std
    correlation = result.covariance / np.outer(result.std, result.std)
    distance = off @ np.linalg.solve(correlation, off) / off.size
    freedom = result.degrees_of_freedom
    return Recovered(
        tuple(tuple((np.abs(off) <= result.quantile(p)).tolist()) for p in LEVELS),
        tuple(bool(distance <= fisher.ppf(p, off.size, freedom)) for p in LEVELS),
    )


def reports_trade_off(seed: int) -> bool:
    """Calibrate a random arm; return whether the trade-off with the tension scale is reported."""
    rng = np.random.default_rng(seed)
    case = random_arm(rng, payload=False)
    wanted = {"arm.E_kPa", *{"arm.density"} & set(case.truth)}
    keys = [*wanted, "arm.sections[0].offset_mm[0]", "points[1].offset_mm[2]"]
    scale = Unknown(tuple(f"tension_scale[{j}]" for j in range(case.arm.n_tendons)), 0.5, 2.0)
    measured = shapes_of(case.arm, case.scene, case.noise, rng)
    result = calibrate(case.arm, case.scene, measured, [*case.unknowns(keys), scale])
    names = {name for each in result.unidentified if np.isinf(each.std) for name in each.names}
    return wanted <= names and scale.name in names


def reports_outlier(seed: int) -> bool:
    """Calibrate a random arm with an outlier; return whether the shape is reported."""
    rng = np.random.default_rng(seed)
    case = random_arm(rng)
    keys = [key for key in ("arm.E_kPa", "arm.density") if key in case.truth]
    measured = shapes_of(case.arm, case.scene, case.noise, rng, 8)
    which = int(rng.integers(8))
    away = rng.normal(size=3)
    wrong = measured[which]
    far = OUTLIER * case.noise * away / np.linalg.norm(away)
    (s, offset, place), *points = wrong.points
    measured[which] = replace(wrong, points=[(s, offset, np.array(place) + far), *points])
    result = calibrate(*case.guess(keys, rng), measured, case.unknowns(keys), loss="soft_l1")
    return wrong.name in result.outcome


def main(argv: Sequence[str] | None = None) -> None:
    """Print the shares of intervals and regions that contain the truth, and of reports."""
    args = asked(
        __doc__,
        argv,
        {
            "--arms": 200,
            "--cases": (40, {"help": "number of trade-offs, and of outliers"}),
            "--seed": 0,
        },
    )
    first = 1000 * args.seed
    results = [recovered(first + i) for i in range(args.arms)]
    for k, level in enumerate(LEVELS):
        held = [interval for row in results for interval in row.intervals[k]]
        regions = np.mean([row.regions[k] for row in results])
        print(
            f"{100 * level:.0f} %: {100 * np.mean(held):.1f} % of {len(held)} intervals contain "
            f"the truth, {100 * regions:.1f} % of {len(results)} regions"
        )
    for name, is_reported in (
        ("trade-offs with the tension scale", reports_trade_off),
        ("outliers", reports_outlier),
    ):
        count = sum(is_reported(first + i) for i in range(args.cases))
        print(f"{name} reported: {count} of {args.cases}")


if __name__ == "__main__":
    main()
