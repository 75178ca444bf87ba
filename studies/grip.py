"""How do force and stiffness of a hold depend on the curvatures of object and arm?

Questions: An arm is bent around a cylinder. How large are the forces on the cylinder and the
stiffness against a displacement of the cylinder, as functions of the ratio of the curvature of the
cylinder to the curvature of the free arm at the same tension? How do wraps of 90 to 360 degrees
differ, and what does friction change? According to the paper's conclusions, the relation between
the two curvatures could play the role of the displacement in impedance control.

Assumptions: A uniform arm with exact tendons up to the tip and a linear body with extension. The
base is clamped along the cylinder, with a small gap, and the arm is as long as the wrap, measured
at the midline. One tendon bends the arm around the cylinder; the tension grows in steps, and the
ratio decreases. The curvature of the cylinder is 1 / rho, with the radius rho of the midline around
the cylinder; E J is the bending stiffness. The grip is the sum of the normal forces. Friction, 0.3,
acts from the ratio 0.95 on. The stiffness of the hold is the smallest stiffness against a
displacement of the cylinder across its axis, at constant tension: an exact derivative of the
equilibrium in which contacts slide if there is no friction, and stick otherwise. A row ends before
the arm becomes unstable without friction, or if no equilibrium is found. The wrap of 360 degrees
lies beside its own base; the arm is treated as if it could pass there.

Command: python -m studies.grip [--angles 90 180 270 360] [--ratios 1 0.95 0.9] [--out out]

Answer: in studies/README.md.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib import colormaps
from matplotlib.figure import Figure
from matplotlib.patches import Circle
from scipy.optimize import brentq

from octoplan.model import Anchorage, Arm, Material, OctoplanError, Scene, Shape, settle
from octoplan.model.effects import ExactTendons, Extension
from octoplan.model.extensions.contact.effects import Contact
from octoplan.model.extensions.contact.hold_stiffness import hold_stiffness
from octoplan.model.extensions.obstacles import Capsule
from octoplan.model.paths import Array, Linear
from studies.reporting import asked, keep_finished, lettered

# Radius of the arm, distance of its tendons from the midline [m], and Young's modulus [Pa].
RADIUS = 0.004
TENDON_DISTANCE = 0.0024
MODULUS = 2e5
# Radius of the midline around the cylinder [m].
RHO = 0.04
# Gap between the cylinder and the arm at its base, over RHO.
BASE_GAP = 0.02
# Half of the length of the cylinder [m].
HALF_WIDTH = 0.1
# Distance between drawn cylinders, over RHO.
SPACING = 2.6
# Index of the tendon that bends the arm towards the cylinder.
BENDING = 1
# Friction coefficient of holds with friction, and the ratio of curvatures from which friction acts.
FRICTION = 0.3
FIRST_RUBBING = 0.95
# Ratio of curvatures of the drawn shapes.
DRAWN = 0.7
# Accuracy of shapes.
ACCURACY = 1e-5
STATICS = Scene(Extension(), ExactTendons())
EJ = MODULUS * np.pi * RADIUS**4 / 4
HEAD = (
    "wrap  friction  ratio     tension    touches at  grip/(EJ/rho^2)  /(EJ kappa^2)  "
    "stability  stiffness/(EJ/rho^3)"
)


@dataclass(frozen=True, eq=False)
class Grip:
    """A hold of the cylinder.

    Attributes
    ----------
    angle : float
        Angle of the wrap [degree].
    friction : float
        Coefficient of friction.
    ratio : float
        Curvature of the cylinder over the curvature of the free arm.
    tension : float
        Tension of the tendon [N].
    shape : Shape
    """

    angle: float
    friction: float
    ratio: float
    tension: float
    shape: Shape

    @property
    def normal_forces(self) -> Array:
        """Normal forces (k,) on the cylinder [N], from base to tip."""
        forces = [touch.force - touch.friction for touch in self.shape.contacts]
        return np.linalg.norm(np.reshape(forces, (-1, 3)), axis=1)

    @property
    def grip(self) -> float:
        """The sum of the normal forces over E J / rho^2."""
        return float(self.normal_forces.sum()) * RHO**2 / EJ

    @property
    def grip_of_arm(self) -> float:
        """The sum of the normal forces over E J kappa^2, with the curvature of the free arm."""
        return self.grip * self.ratio**2

    @property
    def may_hold(self) -> bool:
        """Whether the equilibrium is stable; not tested if contacts stick."""
        return self.friction > 0 or self.shape.stability > 0

    def stiffness(self) -> float:
        """Return the smallest stiffness across the axis of the cylinder over E J / rho^3."""
        across = np.ix_([0, 2], [0, 2])
        matrix = hold_stiffness(self.shape, self.shape.contacts[0].obstacle)[across]
        return float(np.linalg.eigvalsh((matrix + matrix.T) / 2)[0]) * RHO**3 / EJ


def arm_for(angle: float) -> Arm:
    """Return the arm that is as long as the wrap of an angle [degree]."""
    length = np.radians(angle) * RHO
    ends = (Anchorage(length, Linear(TENDON_DISTANCE, TENDON_DISTANCE)),)
    material = Material(E=MODULUS, nu=0.5, density=1000.0)
    return Arm(length, Linear(RADIUS, RADIUS), ends, material)


def tensions_for(arm: Arm, ratio: float) -> Array:
    """Return the tensions (4,) [N] that bend the free arm to the curvature 1 / (RHO ratio)."""
    bends = np.arange(4) == BENDING

    def excess(tension: float) -> float:
        strains = settle(arm, tension * bends, STATICS, 1e-8).strain(arm.length / 2)
        return float(np.hypot(strains[1], strains[2])) * RHO * ratio - 1

    linear = EJ / RHO / TENDON_DISTANCE / ratio
    return np.asarray(brentq(excess, 0.5 * linear, 1.5 * linear, rtol=1e-8) * bends)


def grips(angle: float, ratios: Sequence[float], friction: float) -> list[Grip]:
    """Return the holds by a wrap of an angle [degree] for decreasing ratios of curvatures."""
    arm = arm_for(angle)
    z = -(1 + BASE_GAP) * RHO
    cylinder = Capsule((0.0, -HALF_WIDTH, z), (0.0, HALF_WIDTH, z), RHO - RADIUS)
    smooth, scene = (STATICS + Contact(cylinder, friction=mu) for mu in (0.0, friction))
    steps = sorted(ratios, reverse=True)
    near = None
    if friction:
        steps = [ratio for ratio in steps if ratio <= FIRST_RUBBING]
        near = settle(arm, tensions_for(arm, FIRST_RUBBING), smooth, ACCURACY, compile="auto")
    results = list[Grip]()
    for ratio in steps:
        tensions = tensions_for(arm, ratio)
        try:
            near = settle(arm, tensions, scene, ACCURACY, near=near, compile="auto")
        except OctoplanError:
            break
        grip = Grip(angle, friction, ratio, float(tensions.max()), near)
        if near.snaps or not grip.may_hold:
            break
        if near.contacts:
            results.append(grip)
            print(line(grip), flush=True)
    return results


def line(grip: Grip) -> str:
    """Return a line of the table."""
    normals = [touch.normal for touch in grip.shape.contacts]
    places = [np.degrees(np.arctan2(normal[0], normal[2])) % 360 for normal in normals]
    return (
        f"{grip.angle:4.0f} {grip.friction:9.1f} {grip.ratio:6.2f} {grip.tension:11.3f} N "
        f"{min(places):5.0f} to {max(places):3.0f} {grip.grip:13.3f} {grip.grip_of_arm:16.3f} "
        f"{grip.shape.stability:10.2f} {grip.stiffness():15.2f}"
    )


def summary(rows: Sequence[Grip]) -> str:
    """Return the largest grip that an arm of given curvature attains, and the last ratio."""
    best = max(rows, key=lambda row: row.grip_of_arm)
    return (
        f"{best.angle:.0f} degrees, friction {best.friction:g}: grip {best.grip_of_arm:.2f} "
        f"E J kappa^2 at the ratio {best.ratio:g}; {len(rows)} holds down to {rows[-1].ratio:g}"
    )


def figure(table: Sequence[Sequence[Grip]]) -> Figure:
    """Draw the shapes, the grip for a given object and for a given arm, and the stiffness."""
    drawn = Figure(figsize=(10.5, 8.0), layout="constrained")
    (shapes, grip), (of_arm, stiff) = axes = drawn.subplots(2, 2)
    angles = sorted({row.angle for rows in table for row in rows})
    colours = dict(zip(angles, colormaps["viridis"](np.linspace(0, 0.9, len(angles))), strict=True))
    for rows in table:
        colour, has_friction = colours[rows[0].angle], rows[0].friction > 0
        style = "--" if has_friction else "-"
        label = f"{rows[0].angle:.0f} degrees" + f", friction {FRICTION:g}" * has_friction
        ratios = [row.ratio for row in rows]
        grip.plot(ratios, [row.grip for row in rows], style, color=colour, label=label)
        of_arm.plot(ratios, [row.grip_of_arm for row in rows], style, color=colour, label=label)
        stiff.plot(ratios, [row.stiffness() for row in rows], style, color=colour, label=label)
        if not has_friction:
            nearest = min(rows, key=lambda row: abs(row.ratio - DRAWN))
            s = np.linspace(0.0, nearest.shape.arm.length, 201)
            x, _, z = nearest.shape.position(s).T / RHO
            # Side by side: each shape has its own cylinder.
            shift = SPACING * angles.index(rows[0].angle)
            shapes.plot(x + shift, z, color=colour)
            centre, radius = (shift, -1.0 - BASE_GAP), 1 - RADIUS / RHO
            shapes.add_patch(Circle(centre, radius, color=colour, alpha=0.25))
            points = np.array([touch.point for touch in nearest.shape.contacts]) / RHO
            shapes.plot(points[:, 0] + shift, points[:, 2], ".", color=colour)
    titles = (
        f"wraps without friction, ratio {DRAWN:g}; points: contacts",
        "grip on a given object",
        "grip of an arm of given curvature",
        "smallest stiffness of the hold",
    )
    lettered(zip(axes.ravel(), titles, strict=True))
    shapes.set(xlabel="x / rho", ylabel="z / rho", aspect="equal")
    for ax, label in (
        (grip, "sum of normal forces / (E J / rho$^2$)"),
        (of_arm, r"sum of normal forces / (E J $\kappa^2$)"),
        (stiff, "stiffness / (E J / rho$^3$)"),
    ):
        ax.set(xlabel="curvature of the object / curvature of the free arm", ylabel=label)
    grip.legend(fontsize=7)
    # Grips at the first touch are nearly 0.
    grip.set(yscale="log", ylim=(0.01, None))
    stiff.set_yscale("symlog", linthresh=1.0)
    return drawn


def main(argv: Sequence[str] | None = None) -> None:
    """Print the table and save the figure."""
    args = asked(
        __doc__,
        argv,
        {
            "--angles": [90.0, 180.0, 270.0, 360.0],
            "--ratios": np.arange(1.0, 0.24, -0.05).round(2).tolist(),
            "--out": Path("out"),
        },
    )
    print(HEAD)
    table = list[list[Grip]]()
    with keep_finished():
        for angle in args.angles:
            for friction in (0.0, FRICTION):
                if rows := grips(angle, args.ratios, friction):
                    table.append(rows)
    print("\n".join(map(summary, table)))
    figure(table).savefig(args.out / "grip.png", dpi=100)


if __name__ == "__main__":
    main()
