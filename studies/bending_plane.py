"""How accurate is the bending-plane law of section 6.1, in theory and on a measured arm?

Question: According to the law, tensions with T_i3 - T_i1 : T_i2 - T_i4 = sin : cos of an angle bend
the arm in the plane of that angle. How far does the plane of the equilibrium deviate, over angle
and tension, for each statics? Which tensions bend the arm exactly in the plane? How far does a
measured arm deviate?

Assumptions: Section 1 of the arm of table 2. The plane is the direction in which the tip moves
(figure 10). The measured arm is that of tests/data/measured_tentacle.json, in the shapes with two
taut tendons. For tendons at any angles the law predicts a bend towards the sum of the tendons'
directions times tensions. The measured plane is the direction of the tip marker, seen from the base
along the arm at rest. A rotation of the base about this axis is the same in all shapes.

Command: python -m studies.bending_plane [--angles 24] [--out out]

Answer: in studies/README.md.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from octoplan.model import Arm, Scene, settle
from octoplan.model.effects import Extension
from octoplan.model.paths import Array
from octoplan.model.support.errors import CollapsedError
from octoplan.planner import Measured, Plan, calibrate, plan
from octoplan.planner.targets import BendingPlane
from studies.calibration import BODY, LINEAR, POSE, shapes
from studies.reporting import asked

STATICS = {
    "bare": Scene(),
    "paper, consistent": Scene(Extension()),
    "as printed": Scene.as_printed(),
}
TENSIONS = (0.05, 0.5, 1.0, 2.0, 4.0)
# Index of the marker at the tip.
TIP = 3


def pull(arm: Arm, angle: float, tension: float, section: int = 1) -> Array:
    """Return the tensions of the law [N]: T_i2 = T cos and T_i3 = T sin.

    Negative values become tensions of the opposite tendons, T_i4 and T_i1.
    """
    T = np.zeros((len(arm.sections), 4))
    cos = tension * np.cos(angle)
    sin = tension * np.sin(angle)
    T[section - 1] = [max(-sin, 0), max(cos, 0), max(sin, 0), max(-cos, 0)]
    return T


def plane_of(arm: Arm, tip: Array) -> float:
    """Return the angle of the plane in which the tip has moved, as in figure 10 [rad]."""
    _, n, b = np.array(arm.base_frame).T @ (tip - np.array(arm.base_position))
    return float(np.arctan2(-n, b))


def deviation(arm: Arm, angle: float, tension: float, scene: Scene) -> float:
    """Return the plane of the equilibrium minus the plane of the law [deg]."""
    tip = settle(arm, pull(arm, angle, tension), scene, 1e-9).tip
    gap = plane_of(arm, tip) - angle
    return float(np.degrees(np.angle(np.exp(1j * gap))))


def sweep(angles: Array) -> dict[str, Array]:
    """Return deviations [deg] (tensions, angles) for each statics; NaN if the arm is crushed."""
    arm = Arm.from_paper("table-2")
    table = {}
    for name, scene in STATICS.items():
        rows = np.full((len(TENSIONS), len(angles)), np.nan)
        for i, tension in enumerate(TENSIONS):
            for j, angle in enumerate(angles):
                try:
                    rows[i, j] = deviation(arm, angle, tension, scene)
                except CollapsedError:
                    continue
        table[name] = rows
    return table


def planned(angles: Array, bends: Sequence[float], scene: Scene) -> list[tuple[int, Plan]]:
    """Return (starting section, plan) for each plane, bend and starting section."""
    arm = Arm.from_paper("table-2")
    return [
        (section, plan(arm, BendingPlane(float(angle), bend, section), scene))
        for section in (1, 2, 3)
        for bend in bends
        for angle in angles
    ]


def neighbours(tensions: Array) -> bool:
    """Test whether at most two tendons pull, and no two opposite ones."""
    pulls = tensions > 0
    return bool(pulls.sum() <= 2 and not (pulls[0] and pulls[2]) and not (pulls[1] and pulls[3]))


def report_plans(results: list[tuple[int, Plan]]) -> None:
    """Print the errors of the plans for each section and bend."""
    for section in (1, 2, 3):
        plans = [p for i, p in results if i == section]
        for bend in sorted({p.targets[0].bend for p in plans}):
            group = [p for p in plans if p.targets[0].bend == bend]
            good = [p for p in group if p.certificate.passed]
            tip = [plane_of(p.arm, p.shape.tip) - p.targets[0].angle for p in good]
            # A bend of 180 degrees may move the tip to the other side of the base.
            plane = np.degrees(np.abs(np.angle(np.exp(2j * np.array(tip))))) / 2
            residual = np.degrees([p.certificate.equality["bend"] for p in good])
            tangent = np.array([p.shape.tip_frame[:, 0] @ p.arm.base_frame for p in good])
            unsigned = [np.degrees(np.arccos(np.clip(t[0], -1, 1)) - bend) for t in tangent]
            sides = sum(neighbours(p.tensions[section - 1]) for p in good)
            print(f"section {section} bend {np.degrees(bend):4.0f}:", end=" ")
            print(f"{len(good):2d} of {len(group)} reached,", end=" ")
            print(f"plane off by {plane.max(initial=0):.1e} deg,", end=" ")
            print(f"bend off by {residual.max(initial=0):.1e} deg", end=" ")
            print(f"(unsigned angle {np.abs(unsigned).max(initial=0):.1e}),", end=" ")
            print(f"{sides} of {len(good)} with neighbouring tendons only")


def law(arm: Arm, tensions: Array) -> float:
    """Return the angle, from n towards b, of the sum of tendon directions times tensions [deg]."""
    angles = np.array([phi for _, phi in arm.tendons])
    pull = tensions @ np.stack([np.cos(angles), np.sin(angles)], axis=1)
    return float(np.degrees(np.arctan2(pull[1], pull[0])))


def seen_from_base(arm: Arm, place: Array) -> float:
    """Return the angle, from n towards b, of the direction from the base to a point [deg]."""
    _, n, b = np.array(arm.base_frame).T @ (place - np.array(arm.base_position))
    return float(np.degrees(np.arctan2(b, n)))


def differences() -> tuple[list[Measured], Array]:
    """Return the shapes with two taut tendons and the deviations from the law (N, 2) [deg].

    The columns are the measured plane and the plane of the calibrated arm, both minus the law.
    """
    arm, measured = shapes()
    fitted = calibrate(arm, LINEAR, measured, [*BODY, *POSE])
    both = [shape for shape in measured if min(shape.tensions) > 0]
    rows = []
    for shape in both:
        T = np.array(shape.tensions)
        point = shape.points[TIP]
        there = fitted.predict(T, [(point.s, point.offset)], shape.session).places[0]
        seen = seen_from_base(arm, np.array(point.place)), seen_from_base(arm, there)
        rows.append([(angle - law(arm, T) + 180) % 360 - 180 for angle in seen])
    return both, np.array(rows)


def draw(angles: Array, table: dict[str, Array]) -> Figure:
    """Return the figure: deviation over angle, one line for each tension."""
    figure = Figure(figsize=(10, 3.6), layout="constrained")
    axes = figure.subplots(1, len(table), sharey=True)
    for ax, (name, rows) in zip(axes, table.items(), strict=True):
        for tension, row in zip(TENSIONS, rows, strict=True):
            ax.plot(np.degrees(angles), row, ".-", ms=4, lw=1, label=f"{tension:g} N")
        ax.set(title=name, xlabel="angle of the law [deg]", xticks=range(-180, 181, 90))
        ax.grid(alpha=0.3)
    axes[0].set_ylabel("plane of the equilibrium minus law [deg]")
    lines, labels = axes[0].get_legend_handles_labels()
    figure.legend(lines, labels, title="tension", loc="outside right center")
    return figure


def main(argv: Sequence[str] | None = None) -> None:
    """Print the tables and save the figure."""
    args = asked(
        __doc__,
        argv,
        {
            "--angles": 24,
            "--out": Path("out"),
        },
    )
    angles = np.linspace(-np.pi, np.pi, args.angles, endpoint=False)
    fine = np.linspace(-np.pi, np.pi, 2 * args.angles + 1)
    table = sweep(fine)
    for name, rows in table.items():
        worst = np.nanmax(np.abs(rows), axis=1)
        print(
            f"{name:<18}", *(f"{T:g} N: {w:.4f} deg" for T, w in zip(TENSIONS, worst, strict=True))
        )
    for name in ("paper, consistent", "bare"):
        print(f"planned, {name}")
        report_plans(planned(angles, np.radians([30, 90, 180]).tolist(), STATICS[name]))
    both, off = differences()
    print("bending plane minus law [deg]        measured   calibrated")
    for shape, row in zip(both, off, strict=True):
        print(f"{shape.name:<36}" + "".join(f"{x:10.2f}" for x in row))
    for name, values in (("mean", off.mean(axis=0)), ("standard deviation", off.std(axis=0))):
        print(f"{name:<36}" + "".join(f"{x:10.2f}" for x in values))
    draw(fine, table).savefig(args.out / "bending_plane.png", dpi=150)


if __name__ == "__main__":
    main()
