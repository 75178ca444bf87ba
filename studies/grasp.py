"""How does the curvature of an object relate to the curvature of the arm that grasps it?

Questions: How much of the arm of table 4 can lie along cylinders of radius 5 to 60 mm, with which
effort and which tendons? How large are the contact forces and the holding forces at higher
tensions? According to the paper's conclusions, the relation between the curvatures of object and
arm could play the role of the displacement in impedance control. How closely do the two agree, and
which effects limit the agreement?

Assumptions: Neo-Hookean body and exact tendons (with extension alone, tendons could compress a
slender tip to a few percent of its length, which is impossible in silicone). The arm is straight at
rest and moves in a plane; tendons above and below pull up to 20 N. A part of the arm ends at the
tip or at another anchorage. The part lies on the cylinder if the gap is at most a quarter of the
arm's radius. The cylinder is below the arm, near the beginning of the part. The length of the part
grows in steps until no plan exists. Then the cylinder becomes a contact and all tensions are scaled
up, until the arm snaps or no equilibrium is found. The holding force along the axis of the cylinder
is the friction coefficient, 0.5, times the sum of normal forces.

Command: python -m studies.grasp [--radii 60 40 20 10 5] [--shares 0.05 0.1 0.15] [--out out]

Answer: in studies/README.md.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle
from matplotlib.ticker import LogLocator, NullFormatter, ScalarFormatter

from octoplan.model import Arm, OctoplanError, Scene, settle
from octoplan.model.extensions.contact.effects import Contact
from octoplan.model.extensions.obstacles import Capsule
from octoplan.model.paths import Array
from octoplan.planner import Plan, plan
from octoplan.planner.extensions.contact import Wrap
from octoplan.planner.extensions.contact.remarks import curvature_along
from studies.reporting import asked, lettered

ARM = Arm.from_paper("table-4")
STATICS = Scene.silicone()
L = ARM.length
# Indices of the tendons above and below the arm in each section (at 90 and 270 degrees).
ABOVE = 1
BELOW = 3
# Largest tensions [N]: only the tendons above and below pull.
MOST = np.tile([0.0, 20.0, 0.0, 20.0], 3)
# Distance along x from the cylinder's axis to the beginning of the part [m].
BEFORE = 0.03
# Distance from the surface of the cylinder to the straight arm above [m].
BELOW_ARM = 0.01
# Half of the length of the cylinder [m].
HALF_WIDTH = 0.15
# Friction coefficient of the holding force.
FRICTION = 0.5
# Factors of the tensions of the plan, for the contact forces.
TENSION_FACTORS = (1.0, 1.1, 1.25, 1.5, 1.75, 2.0, 2.5, 3.0)
HEAD = (
    "radius  part [mm]     effort  above, below: tip, middle, base [N]"
    "         curvature of object, of arm [1/m]"
)


@dataclass(frozen=True)
class Row:
    """A cylinder, a part of the arm, and the plan for this part along the cylinder."""

    rod: Capsule
    wrap: Wrap
    plan: Plan

    @property
    def part(self) -> Array:
        """Arc lengths of the samples of the part [m]."""
        return np.linspace(*self.wrap.part(ARM), 101)

    @property
    def arm_curvature(self) -> Array:
        """Curvature of the arm along the part [1/m]."""
        strains = self.plan.shape.strain(self.part)
        return np.asarray(np.hypot(strains[:, 1], strains[:, 2]))

    @property
    def object_curvature(self) -> Array:
        """Curvature of the object along the part, at the arm's midline [1/m]."""
        return curvature_along(self.wrap, self.plan.shape, self.part)

    @property
    def verdict(self) -> str:
        """Result of the plan: certified, too tight, too slack, or missed."""
        if self.plan.reached:
            return "certified"
        causes = [cause for cause in ("too tight", "too slack") if cause in self.plan.outcome]
        return causes[0] if causes else "missed"


def plan_along(radius: float, end: float, share: float) -> Row:
    """Return the plan for a part along a cylinder.

    The part is `share` of the arm's length and ends at arc length `end` [m].
    """
    start = end - share * L
    x = start - BEFORE
    z = -radius - BELOW_ARM - float(ARM.outer_radius(np.array([start]))[0][0])
    rod = Capsule((x, -HALF_WIDTH, z), (x, HALF_WIDTH, z), radius)
    wrap = Wrap(rod, length=share * L, start=start)
    return Row(rod, wrap, plan(ARM, wrap, STATICS, MOST, starts=2, compile="auto"))


def up_to_longest(radius: float, end: float, shares: Sequence[float]) -> list[Row]:
    """Return plans of increasingly long parts on a cylinder, up to the first failure."""
    results = list[Row]()
    for share in sorted(shares):
        results.append(plan_along(radius, end, share))
        print(line(results[-1]), flush=True)
        if not results[-1].plan.reached:
            break
    return results


def line(row: Row) -> str:
    """Return a line of the table: the result for a cylinder and a part."""
    start, end = (1e3 * s for s in row.wrap.part(ARM))
    pulls = row.plan.tensions[:, [ABOVE, BELOW]].ravel()
    curved = [
        each for c in (row.object_curvature, row.arm_curvature) for each in (c.min(), c.max())
    ]
    return (
        f"{1e3 * row.rod.radius:4.0f} mm  {start:3.0f} to {end:3.0f} {row.plan.effort:8.3f} N  "
        + " ".join(f"{pull:6.3f}" for pull in pulls)
        + "  {:5.1f} to {:5.1f} {:7.1f} to {:5.1f}  ".format(*curved)
        + row.verdict
    )


def contact_forces(row: Row) -> Array:
    """Return (effort, sum of normal forces, largest normal force) [N] (k, 3) for rising tensions.

    The table ends before the arm snaps or no equilibrium is found.
    """
    scene = STATICS + Contact(row.rod)
    results = list[tuple[float, float, float]]()
    near = None
    for factor in TENSION_FACTORS:
        try:
            near = settle(ARM, factor * row.plan.tensions, scene, 1e-5, compile="auto", near=near)
        except OctoplanError:
            break
        if near.snaps:
            break
        forces = [float(np.linalg.norm(touch.force)) for touch in near.contacts]
        results.append((factor * row.plan.effort, sum(forces), max(forces, default=0.0)))
    return np.array(results).reshape(-1, 3)


def grip_lines(row: Row, grips: Array) -> Iterable[str]:
    """Return lines of the table: the contact forces and holding forces."""
    length = np.diff(row.wrap.part(ARM))[0]
    for effort, total, most in grips:
        yield (
            f"          effort {effort:.3g} N: contact {1e3 * total:.3g} mN, "
            f"{total / length:.3g} N/m, largest {1e3 * most:.3g} mN at one point; "
            f"holds {1e3 * FRICTION * total:.3g} mN"
        )


def figure(longest: Sequence[tuple[Row, Array]], rows: Sequence[Row]) -> Figure:
    """Draw arms, effort over radius, curvatures along the arm, and holding forces over effort."""
    drawn = Figure(figsize=(10.5, 8.0), layout="constrained")
    (arms, effort), (bends, holds) = axes = drawn.subplots(2, 2)
    colours = colormaps["viridis"](np.linspace(0, 0.9, max(len(longest), 1)))
    for (row, grips), colour in zip(longest, colours, strict=True):
        _draw_arm(arms, row, colour)
        label = f"{1e3 * row.rod.radius:g} mm, " + "{:.0f} to {:.0f} mm".format(
            *(1e3 * s for s in row.wrap.part(ARM))
        )
        bends.plot(1e3 * row.part, row.arm_curvature, color=colour, label=label)
        bends.plot(1e3 * row.part, row.object_curvature, "--", color=colour)
        if grips[:, 1].any():
            holds.plot(grips[:, 0], 1e3 * FRICTION * grips[:, 1], ".-", color=colour, label=label)
    passed = [row for row in rows if row.plan.reached]
    for end in sorted({row.wrap.part(ARM)[1] for row in passed}):
        for share in sorted({_share(row) for row in passed}):
            parts = [
                (1e3 * row.rod.radius, row.plan.effort)
                for row in passed
                if row.wrap.part(ARM)[1] == end and _share(row) == share
            ]
            if parts:
                label = f"{share:g} L up to {1e3 * end:.0f} mm"
                effort.plot(*np.transpose(sorted(parts)), "o-" if end == L else "s--", label=label)
    titles = (
        "longest part on each cylinder",
        "least effort",
        "curvature of the arm; dashed: of the object",
        f"holding force along the axis, friction {FRICTION:g}",
    )
    lettered(zip(axes.ravel(), titles, strict=True))
    arms.set(xlabel="x [mm]", ylabel="z [mm]", aspect="equal")
    effort.set(xlabel="radius of the cylinder [mm]", ylabel="effort [N]", yscale="log")
    bends.set(xlabel="arc length at rest [mm]", ylabel="curvature [1/m]", yscale="log")
    bends.yaxis.set(
        major_locator=LogLocator(subs=(1.0, 2.0, 5.0)),
        major_formatter=ScalarFormatter(),
        minor_formatter=NullFormatter(),
    )
    holds.set(xlabel="effort [N]", ylabel="holding force [mN]")
    for ax in (effort, bends, holds):
        if ax.get_legend_handles_labels()[0]:
            ax.legend(fontsize=7)
    return drawn


def _share(row: Row) -> float:
    start, end = row.wrap.part(ARM)
    return round((end - start) / L, 6)


def _draw_arm(ax: Axes, row: Row, colour: Array) -> None:
    points = row.plan.shape.position(np.linspace(0.0, L, 301))
    part = row.plan.shape.position(row.part)
    ax.plot(1e3 * points[:, 0], 1e3 * points[:, 2], color=colour, linewidth=1)
    ax.plot(1e3 * part[:, 0], 1e3 * part[:, 2], color=colour, linewidth=3)
    x, _, z = row.rod.start
    ax.add_patch(Circle((1e3 * x, 1e3 * z), 1e3 * row.rod.radius, color=colour, alpha=0.25))


def main(argv: Sequence[str] | None = None) -> None:
    """Print the tables and save the figure."""
    args = asked(
        __doc__,
        argv,
        {
            "--radii": ([60.0, 40.0, 20.0, 10.0, 5.0], {"help": "[mm]"}),
            "--ends": ([0, 1], {"help": "indices of anchorages; 0 is the tip"}),
            "--shares": [0.05, 0.1, 0.15],
            "--out": Path("out"),
        },
    )
    print(HEAD)
    rows = list[Row]()
    longest = list[tuple[Row, Array]]()
    for end in (ARM.anchorages[k] for k in args.ends):
        for radius in args.radii:
            values = up_to_longest(1e-3 * radius, end, args.shares)
            rows += values
            if passed := [row for row in values if row.plan.reached]:
                grips = contact_forces(passed[-1])
                longest.append((passed[-1], grips))
                print("\n".join(grip_lines(passed[-1], grips)), flush=True)
    print(f"{sum(row.plan.reached for row in rows)} of {len(rows)} wraps planned and certified")
    figure(longest, rows).savefig(args.out / "grasp.png", dpi=100)


if __name__ == "__main__":
    main()
