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
equilibrium in which contacts slide if there is no friction, and stick otherwise. A wrap ends before
the arm becomes unstable without friction, or if no equilibrium is found; the summary reports the
cause. The wrap of 360 degrees lies beside its own base; the arm is treated as if it could pass
there. Each finished wrap is saved beside the figure, so that a stopped study resumes.

Command: python -m studies.grip [--angles 90 180 270 360] [--ratios 1 0.95 0.9] [--out out]
A reduced study: --angles 90 180 --ratios 1 0.85 0.7 0.55

Answer: in studies/README.md.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

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
from octoplan.planner.frontends.io.files import atomic_write
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
# Ratio of curvatures, and number of points of the midline, of the drawn shapes.
DRAWN = 0.7
MIDLINE_POINTS = 201
# Accuracy of shapes.
ACCURACY = 1e-5
STATICS = Scene(Extension(), ExactTendons())
EJ = MODULUS * np.pi * RADIUS**4 / 4
HEAD = (
    "wrap  friction  ratio     tension    touches at  grip/(EJ/rho^2)  /(EJ kappa^2)  "
    "stability  stiffness/(EJ/rho^3)"
)


@dataclass(frozen=True)
class Grip:
    """A hold of the cylinder.

    Attributes
    ----------
    ratio : float
        Curvature of the cylinder over the curvature of the free arm.
    tension : float
        Tension of the tendon [N].
    grip : float
        The sum of the normal forces over E J / rho^2.
    stability : float
        Smallest eigenvalue of the scaled Hessian of the energy.
    stiffness : float
        Smallest stiffness across the axis of the cylinder over E J / rho^3.
    midline, points : list of [x, z]
        Midline of the arm and contact points, over rho.
    """

    ratio: float
    tension: float
    grip: float
    stability: float
    stiffness: float
    midline: list[list[float]]
    points: list[list[float]]

    @classmethod
    def of(cls, ratio: float, tension: float, shape: Shape) -> Grip:
        """Return the hold of a settled arm that touches the cylinder."""
        normals = [touch.force - touch.friction for touch in shape.contacts]
        across = np.ix_([0, 2], [0, 2])
        matrix = hold_stiffness(shape, shape.contacts[0].obstacle)[across]
        stiffness = float(np.linalg.eigvalsh((matrix + matrix.T) / 2)[0])
        midline = shape.position(np.linspace(0.0, shape.arm.length, MIDLINE_POINTS))
        points = np.array([touch.point for touch in shape.contacts])
        return cls(
            ratio,
            tension,
            float(np.linalg.norm(normals, axis=1).sum()) * RHO**2 / EJ,
            float(shape.stability),
            stiffness * RHO**3 / EJ,
            (midline[:, ::2] / RHO).tolist(),
            (points[:, ::2] / RHO).tolist(),
        )

    @property
    def grip_of_arm(self) -> float:
        """The sum of the normal forces over E J kappa^2, with the curvature of the free arm."""
        return self.grip * self.ratio**2

    @property
    def contact_angles(self) -> Array:
        """The angles (k,) of the contact points around the cylinder [degree]."""
        x, z = np.array(self.points).T
        return np.asarray(np.degrees(np.arctan2(x, z + 1 + BASE_GAP)) % 360)


@dataclass(frozen=True)
class Wrapped:
    """The holds by a wrap, for decreasing ratios of curvatures.

    Attributes
    ----------
    angle : float
        Angle of the wrap [degree].
    friction : float
        Coefficient of friction.
    ratios : list of float
        The ratios that were asked for.
    holds : list of Grip
    end : str
        Cause of the end after the last hold; empty if no ratio is left.
    arm : list of float
        Constants of the study, see `constants`.
    """

    angle: float
    friction: float
    ratios: list[float]
    holds: list[Grip]
    end: str
    arm: list[float]

    @classmethod
    def load(cls, entry: dict[str, Any]) -> Wrapped:
        """Return the wrap of an entry of the saved file."""
        return cls(**{**entry, "holds": [Grip(**hold) for hold in entry["holds"]]})

    def is_same(self, other: Wrapped) -> bool:
        """Whether both wraps answer the same question."""
        return replace(self, holds=[], end="") == replace(other, holds=[], end="")


def constants() -> list[float]:
    """Return the constants on which the holds depend."""
    return [RADIUS, TENDON_DISTANCE, MODULUS, RHO, BASE_GAP, FIRST_RUBBING, ACCURACY]


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


def grips(asked_for: Wrapped) -> Wrapped:
    """Return a wrap with its holds."""
    angle, friction = asked_for.angle, asked_for.friction
    arm = arm_for(angle)
    z = -(1 + BASE_GAP) * RHO
    cylinder = Capsule((0.0, -HALF_WIDTH, z), (0.0, HALF_WIDTH, z), RHO - RADIUS)
    smooth, scene = (STATICS + Contact(cylinder, friction=mu) for mu in (0.0, friction))
    steps = sorted(asked_for.ratios, reverse=True)
    near = None
    if friction:
        steps = [ratio for ratio in steps if ratio <= FIRST_RUBBING]
        near = settle(arm, tensions_for(arm, FIRST_RUBBING), smooth, ACCURACY, compile="auto")
    holds = list[Grip]()
    for ratio in steps:
        tensions = tensions_for(arm, ratio)
        end = ""
        try:
            near = settle(arm, tensions, scene, ACCURACY, near=near, compile="auto")
        except OctoplanError as reason:
            end = f"no equilibrium at the ratio {ratio:g}: {reason}"
        else:
            # Stability is not tested if contacts stick.
            if near.snaps or not (friction or near.stability > 0):
                end = f"unstable at the ratio {ratio:g}"
        if end or near is None:
            return replace(asked_for, holds=holds, end=end)
        if near.contacts:
            holds.append(Grip.of(ratio, float(tensions.max()), near))
            print(line(asked_for, holds[-1]), flush=True)
    return replace(asked_for, holds=holds)


def line(wrapped: Wrapped, grip: Grip) -> str:
    """Return a line of the table."""
    places = grip.contact_angles
    return (
        f"{wrapped.angle:4.0f} {wrapped.friction:9.1f} {grip.ratio:6.2f} {grip.tension:11.3f} N "
        f"{min(places):5.0f} to {max(places):3.0f} {grip.grip:13.3f} {grip.grip_of_arm:16.3f} "
        f"{grip.stability:10.2f} {grip.stiffness:15.2f}"
    )


def summary(wrapped: Wrapped) -> str:
    """Return the largest grip that an arm of given curvature attains, and the last ratio."""
    name = f"{wrapped.angle:.0f} degrees, friction {wrapped.friction:g}"
    end = f"; then {wrapped.end}" if wrapped.end else ""
    if not wrapped.holds:
        return f"{name}: no hold{end}"
    best = max(wrapped.holds, key=lambda hold: hold.grip_of_arm)
    return (
        f"{name}: grip {best.grip_of_arm:.2f} E J kappa^2 at the ratio {best.ratio:g}; "
        f"{len(wrapped.holds)} holds down to {wrapped.holds[-1].ratio:g}{end}"
    )


def results(wanted: Sequence[Wrapped], path: Path) -> Iterator[Wrapped]:
    """Yield wraps with their holds; finished wraps are in the file at `path`, which grows."""
    entries = json.loads(path.read_text()) if path.exists() else []
    finished = [Wrapped.load(entry) for entry in entries]
    for i, each in enumerate(wanted, 1):
        print(f"wrap {i} of {len(wanted)}", flush=True)
        known = next((other for other in finished if other.is_same(each)), None)
        if known is None:
            known = grips(each)
            finished.append(known)
            with atomic_write(path, ".json") as part:
                part.write_text(json.dumps([asdict(other) for other in finished]))
        else:
            print("\n".join(line(known, hold) for hold in known.holds))
        yield known


def figure(table: Sequence[Wrapped]) -> Figure:
    """Draw the shapes, the grip for a given object and for a given arm, and the stiffness."""
    drawn = Figure(figsize=(10.5, 8.0), layout="constrained")
    (shapes, grip), (of_arm, stiff) = axes = drawn.subplots(2, 2)
    angles = sorted({wrapped.angle for wrapped in table})
    colours = dict(zip(angles, colormaps["viridis"](np.linspace(0, 0.9, len(angles))), strict=True))
    for wrapped in table:
        holds, colour, has_friction = wrapped.holds, colours[wrapped.angle], wrapped.friction > 0
        style = "--" if has_friction else "-"
        label = f"{wrapped.angle:.0f} degrees" + f", friction {FRICTION:g}" * has_friction
        ratios = [hold.ratio for hold in holds]
        for ax, name in ((grip, "grip"), (of_arm, "grip_of_arm"), (stiff, "stiffness")):
            values = [getattr(hold, name) for hold in holds]
            ax.plot(ratios, values, style, color=colour, label=label)
        if not has_friction:
            nearest = min(holds, key=lambda hold: abs(hold.ratio - DRAWN))
            # Side by side: each shape has its own cylinder.
            shift = SPACING * angles.index(wrapped.angle)
            x, z = np.array(nearest.midline).T
            shapes.plot(x + shift, z, color=colour)
            centre, radius = (shift, -1.0 - BASE_GAP), 1 - RADIUS / RHO
            shapes.add_patch(Circle(centre, radius, color=colour, alpha=0.25))
            x, z = np.array(nearest.points).T
            shapes.plot(x + shift, z, ".", color=colour)
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
    ratios = sorted(args.ratios, reverse=True)
    wanted = [
        Wrapped(angle, friction, ratios, [], "", constants())
        for angle in args.angles
        for friction in (0.0, FRICTION)
    ]
    table = list[Wrapped]()
    with keep_finished():
        for wrapped in results(wanted, args.out / "grip.json"):
            table.append(wrapped)
    print("\n".join(map(summary, table)))
    held = [wrapped for wrapped in table if wrapped.holds]
    figure(held).savefig(args.out / "grip.png", dpi=100)


if __name__ == "__main__":
    main()
