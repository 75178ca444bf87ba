"""Do winches or forces reproduce a planned shape better, and is a winch robot predicted well?

Questions: For the same plans, how large is the tip error if tensions are wrong by 1 %, if lengths
are wrong by 0.1 mm, and under an unplanned payload? The second part concerns a measured robot with
winches (Continuum Robotics Lab). Thirteen parameters are calibrated on rows with one taut tendon.
How large are the tip errors of rows with several taut tendons?

Assumptions: The arm of table 2 in silicone; the targets are tips under random moderate tensions.
The errors have a random sign for each taut tendon; slack tendons are long enough to stay slack. The
model of the robot has exact tendons on a steel wire, elastic tendons and a lost motion for each
segment, but no friction and no weight.

Command: python -m studies.lengths [--plans 6] [--draws 8] [--every 6] [--steps 8] [--out out]

Answer: in studies/README.md.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from octoplan.model import Anchorage, Arm, Linear, Material, OctoplanError, Scene, Shape, settle
from octoplan.model.effects import ExactTendons, Extension, TipLoad
from octoplan.model.paths import Array
from octoplan.model.tendons import rest_lengths
from octoplan.planner import plan
from octoplan.planner.targets import TipPosition
from studies.reporting import asked

ARM = Arm.from_paper("table-2")
SCENE = Scene.silicone()
# Relative error of tensions.
FORCE = 0.01
# Error of lengths [m].
LENGTH = 1e-4
# Payload at the tip [N].
PAYLOAD = (0.0, 0.0, -5e-3)
# Additional length of slack tendons [m].
_SLACK_LENGTH = 0.05


def shapes(count: int, seed: int = 0) -> list[Shape]:
    """Return the shapes of plans for random reachable tips."""
    rng = np.random.default_rng(seed)
    results = []
    for _ in range(count):
        T = rng.uniform(0, 1, 12) * np.repeat([0.5, 1.0, 2.5], 4) * (rng.uniform(0, 1, 12) < 0.4)
        goal = settle(ARM, T, SCENE).tip
        results.append(plan(ARM, TipPosition(tuple(goal)), SCENE, 20.0).shape)
    return results


def control_errors(shape: Shape, draws: int, seed: int = 1) -> Array:
    """Return four tip errors (4,) [mm].

    The errors are those of wrong forces and of wrong lengths (means over random draws), and those
    of a payload at constant tensions and at constant lengths.
    """
    rng = np.random.default_rng(seed)
    taut = shape.tensions > 1e-6
    lengths = shape.tendon_lengths + _SLACK_LENGTH * ~taut
    T = np.where(taut, shape.tensions, 0.0)
    loaded = Scene(*SCENE.effects, TipLoad(PAYLOAD))
    signs = rng.choice([-1.0, 1.0], (draws, T.size))
    forced = [settle(ARM, T * (1 + FORCE * sign), SCENE, 1e-5) for sign in signs]
    wound = [settle(ARM, scene=SCENE, accuracy=1e-5, lengths=lengths + LENGTH * s) for s in signs]
    pulled = settle(ARM, T, loaded, 1e-5)
    held = settle(ARM, scene=loaded, accuracy=1e-5, lengths=lengths)
    off = [np.mean([_off(other, shape) for other in others]) for others in (forced, wound)]
    return np.array([*off, _off(pulled, shape), _off(held, shape)])


def _off(other: Shape, shape: Shape) -> float:
    return 1e3 * float(np.linalg.norm(other.tip - shape.tip))


def robot_errors(x: Array, rows: list[Row]) -> Array:
    """Return the tip errors of rows (N,) [mm]."""
    goal = np.array([row.tip for row in rows])
    return np.asarray(1e3 * np.linalg.norm(tips(x, rows) - goal, axis=1))


def slack_names(x: Array, row: Row) -> str:
    """Return the indices of the slack tendons in a row, in the numbering of the file."""
    slack = np.ravel(solve_robot(robot(x), x, row.pull).slack).reshape(3, 3)[::-1].ravel()
    return " ".join(str(j) for j in np.flatnonzero(slack)) or "none"


def draw(table: Array, x: Array, rows: list[Row]) -> Figure:
    """Return the figure: tip errors of plans, and tips of the robot seen from above."""
    figure = Figure(figsize=(10, 4.5), layout="constrained")
    left, right = figure.subplots(1, 2)
    left.boxplot(
        table, tick_labels=["1 % force", "0.1 mm", "payload,\nforces", "payload,\nlengths"]
    )
    left.set(ylabel="tip error [mm]", yscale="log", title="plans, table 2 in silicone")
    result = 1e3 * tips(x, rows)
    goal = 1e3 * np.array([row.tip for row in rows])
    right.plot(*goal[:, :2].T, "ko", mfc="none", label="measured")
    right.plot(*result[:, :2].T, "r.", label="model, given lengths")
    right.plot(*np.stack([goal[:, :2], result[:, :2]], 1).transpose(2, 1, 0), "r-", lw=0.6)
    right.set(xlabel="x [mm]", ylabel="y [mm]", title="measured robot, mixed rows", aspect="equal")
    right.legend()
    return figure


def main(argv: Sequence[str] | None = None) -> None:
    """Print the tables and save the figure."""
    args = asked(
        __doc__,
        argv,
        {
            "--plans": 6,
            "--draws": 8,
            "--every": (6, {"help": "fit every n-th row with one tendon"}),
            "--steps": (8, {"help": "largest number of evaluations of a fit"}),
            "--several": (3, {"help": "fit also every n-th mixed row"}),
            "--mixed": (None, {"help": "number of mixed rows; default: all", "type": int}),
            "--out": Path("out"),
        },
    )
    table = np.array([control_errors(shape, args.draws) for shape in shapes(args.plans)])
    print("tip error [mm]   1 % force   0.1 mm   payload, forces   payload, lengths")
    print("mean         " + "".join(f"{value:14.3f}" for value in table.mean(axis=0)))
    single, mixed = measured()
    mixed = mixed[: args.mixed]
    x = fit_robot(single[:: args.every], steps=args.steps)
    for name, value in zip(NAMES, x, strict=True):
        print(f"{name:<34}{value:12.5g}")
    for name, rows in (("one tendon", single[:: args.every]), ("mixed", mixed)):
        off = robot_errors(x, rows)
        errors = f"mean {off.mean():.2f} mm, worst {off.max():.2f} mm"
        print(f"{name}: {errors}, resolution {1e3 * RESOLUTION} mm")
    added = mixed[:: args.several]
    others = [r for i, r in enumerate(mixed) if i % args.several]
    x = fit_robot([*single[:: args.every], *added], x, args.steps)
    off = robot_errors(x, others)
    message = f"fit to one tendon and {len(added)} mixed rows: mean {off.mean():.2f} mm"
    print(f"{message}, worst {off.max():.2f} mm for the {len(others)} other rows")
    print(f"{NAMES[1]:<34}{x[1]:12.5g}")
    for row, off in zip(mixed, robot_errors(x, mixed), strict=True):
        print(f"{row.label:<28}{off:8.2f} mm   slack: {slack_names(x, row)}")
    draw(table, x, mixed).savefig(args.out / "lengths.png", dpi=120)


DATA = Path(__file__).parents[1] / "tests" / "data" / "ftdcr_displacements.json"
ROBOT_SCENE = Scene(Extension(), ExactTendons())
# Arc lengths of the ends of the segments [m].
ENDS = (0.06, 0.1225, 0.1865)
# Resolution of the measured tips [m].
RESOLUTION = 1.8e-3
# Names of the fitted parameters.
NAMES = (
    "log10 of the tendons' E A [N]",
    "log10 of the arm's E A [N]",
    *(f"angle of segment {i} [rad]" for i in (1, 2, 3)),
    *(f"lost motion of segment {i} [m]" for i in (1, 2, 3)),
    *(f"rotation {axis} [rad]" for axis in "xy"),
    *(f"translation {axis} [m]" for axis in "xyz"),
)
# Initial guess of the fitted parameters.
FIRST = np.array([3.0, 3.0, -3.06, -2.56, -2.05, 0.0, 0.0, 0.0, 0, 0, 0, 0.012, 0])
# Scales of the fitted parameters.
UNITS = np.array([0.3, 0.3, 0.1, 0.1, 0.1, 3e-4, 3e-4, 3e-4, 0.05, 0.05, 3e-3, 3e-3, 3e-3])
# Distance of the tendons from the axis, given by the discs [m].
OFFSET = 4.5e-3
# Bending stiffness of the steel wire [N m2]: radius 0.5 mm, E = 50 GPa as in the source.
FLEXURAL = 50e9 * np.pi * 0.5e-3**4 / 4
# Tendon displacement [m] below which all tendons of a row are slack. These tips are undetermined.
_SLACK = -3e-4


@dataclass(frozen=True, eq=False)
class Row:
    """A measured pose: the displacement of each tendon, base segment first, and the tip [m]."""

    label: str
    pull: Array
    tip: Array


@lru_cache(maxsize=1)
def measured() -> tuple[list[Row], list[Row]]:
    """Return the rows with one taut tendon, and the mixed rows."""
    data = json.loads(DATA.read_text())
    return rows_of(data["single_tendon"]), rows_of(data["mixed"])


def rows_of(rows: list[dict[str, Any]]) -> list[Row]:
    """Return the rows of the file in SI units."""
    return [
        Row(r["label"], 1e-3 * np.array(r["pull_mm"]), 1e-3 * np.array(r["tip_mm"])) for r in rows
    ]


def robot(x: Array) -> Arm:
    """Return the arm with the fitted parameters, sections from tip to base.

    Radius and modulus are those of a bar with the E J of the wire and the fitted E A.
    """
    thirds = 2 * np.pi / 3 * np.arange(3)
    sections = tuple(
        Anchorage(at, Linear(OFFSET, OFFSET), tuple(x[2 + i] + thirds))
        for i, at in reversed([*enumerate(ENDS)])
    )
    frame = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
    axial = 10.0 ** x[1]
    R = 2 * np.sqrt(FLEXURAL / axial)
    bar = Material(axial / (np.pi * R**2), 0.3, 7800.0)
    return Arm(ENDS[-1], Linear(R, R), sections, bar, frame, hull=Linear(1e-2, 1e-2))


def solve_robot(arm: Arm, x: Array, pull: Array) -> Shape:
    """Return the equilibrium for tendon displacements (9,) [m], base segment first."""
    displacement = pull - np.repeat(x[5:8], 3)
    lengths = rest_lengths(arm) - displacement.reshape(3, 3)[::-1].ravel()
    return settle(arm, scene=ROBOT_SCENE, accuracy=1e-3, lengths=lengths, tendon_EA=10.0 ** x[0])


def tips(x: Array, rows: list[Row]) -> Array:
    """Return the tips of rows (N, 3) [m] in the frame of the markers."""
    pulls = tuple(tuple(row.pull.tolist()) for row in rows)
    turn = Rotation.from_rotvec([*x[8:10], 0.0])
    return turn.apply(_tips(tuple(x[:8].tolist()), pulls)) + x[10:13]


@lru_cache(maxsize=64)
def _tips(each: tuple[float, ...], pulls: tuple[tuple[float, ...], ...]) -> Array:
    """Return tips (N, 3) [m] along n, b and t of the arm's frame, the x, y and z of the markers."""
    x = np.array(each)
    results = []
    arm = robot(x)
    for pull in pulls:
        try:
            results.append(solve_robot(arm, x, np.array(pull)).tip)
        except OctoplanError:
            results.append(np.zeros(3))
    return np.array(results)[:, [1, 2, 0]]


def fit_robot(rows: list[Row], first: Array = FIRST, steps: int = 12) -> Array:
    """Return the parameters with the least robust (soft-L1) distance to the measured tips.

    Rows without a taut tendon are ignored.
    """
    rows = [row for row in rows if row.pull.max() > _SLACK]
    goal = np.array([row.tip for row in rows])

    def off(z: Array) -> Array:
        return np.ravel(tips(z * UNITS + FIRST, rows) - goal) / 5e-3

    start = (first - FIRST) / UNITS
    fit = least_squares(off, start, loss="soft_l1", diff_step=1e-3, max_nfev=steps)
    return np.asarray(fit.x * UNITS + FIRST)


if __name__ == "__main__":
    main()
