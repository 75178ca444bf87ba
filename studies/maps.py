"""Which points does the table 4 arm reach, with which stiffness and effort?

Questions: The maps cover the plane in which the third tendons bend the arm of table 4. Which points
does the tip reach, how compliant is the softest direction at the tip, and how large is the least
effort for each point?

Assumptions: Extension, no loads. Workspace: all tensions are random and log-uniform, up to 0.6, 5
and 15 N in sections 1 to 3 (uniform tensions pull all tendons at once and crush two of three arms).
Stiffness: third tendons of sections 1 and 3, with the same limits. Plans: up to 20 N in each
tendon. Each map is a sweep. Its file and its Dataset are saved beside the figure, so that a stopped
study resumes.

Command: python -m studies.maps [--draws 2000] [--pulls 12] [--points 16] [--jobs 1] [--out out]

Answer: in studies/README.md.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from octoplan.planner import sweep
from studies.reporting import asked, lettered

# Largest tensions of sections 1 to 3 [N].
MOST = (0.6, 5.0, 15.0)
SCENE = """\
[scene]
tensions = [[0.0, 0.0, 0.0, 0.0], [0.0, 0.0, 0.0, 0.0], [0.0, 0.0, 0.0, 0.0]]
arm = { preset = "table-4" }
effects = { extension = true }
target = { type = "tip-position", position_mm = [200.0, 100.0, 0.0] }
limits = { tension_max = 20.0 }

"""
_SIDES = {"x": (-150.0, 450.0), "y": (0.0, 400.0)}


def axis(key: str, name: str, **others: object) -> str:
    """Return the text of an axis of a sweep file."""
    entries = {"key": key, "name": name, **others}
    lines = [f'{k} = "{v}"' if isinstance(v, str) else f"{k} = {v}" for k, v in entries.items()]
    return "\n".join(["[[sweep.axes]]", *lines, ""])


def workspace(draws: int) -> str:
    """Return the sweep file of the workspace: all tensions are random."""
    axes = [
        axis(
            f"tensions[{i}][{j}]",
            f"T{i + 1}{j + 1}",
            distribution="log-uniform",
            low=1e-3 * most,
            high=most,
        )
        for i, most in enumerate(MOST)
        for j in range(4)
    ]
    head = f'[sweep]\ncompute = "settle"\ndraws = {draws}\nseed = 1\n'
    return SCENE + head + "".join(axes)


def stiffness(pulls: int) -> str:
    """Return the sweep file of the stiffness: third tendons of the sections at tip and base."""
    axes = [
        axis(f"tensions[{i}][2]", f"T{i + 1}3", start=0.0, stop=MOST[i], count=pulls)
        for i in (0, 2)
    ]
    return SCENE + '[sweep]\ncompute = "stiffness"\n' + "".join(axes)


def tensions(points: int) -> str:
    """Return the sweep file of the tensions: plans for the tip at points of the plane."""
    axes = [
        axis(f"target.position_mm[{i}]", side, start=low, stop=high, count=points)
        for i, (side, (low, high)) in enumerate(_SIDES.items())
    ]
    return SCENE + '[sweep]\ncompute = "plan"\n' + "".join(axes)


def run(name: str, text: str, out: Path, jobs: int) -> Any:
    """Write and run a sweep file; return its Dataset, which is saved beside the file."""
    path = out / f"maps_{name}.toml"
    path.write_text(text)
    return sweep(path, path.with_suffix(".nc"), jobs=jobs)


def softest(data: Any) -> Any:
    """Return the largest displacement per force at the tip [mm/mN] for each point."""
    return np.linalg.svd(data.compliance.values[..., :3, :3], compute_uv=False)[..., 0]


def draw(reach: Any, soft: Any, cost: Any) -> Figure:
    """Return the figure: three maps with one scale, x along the straight arm."""
    figure = Figure(figsize=(11.5, 4.0), layout="constrained")
    axes = figure.subplots(1, 3, sharex=True, sharey=True)
    tips = 1e3 * reach.tip.values
    pull = reach.tensions.values.sum(axis=1)
    off = np.hypot(tips[:, 1], tips[:, 2])
    seen = axes[0].scatter(tips[:, 0], off, c=pull, s=5, cmap="viridis_r")
    _bar(figure, seen, axes[0], "sum of all tensions [N]")
    axes[0].set_ylabel("distance from the x axis [mm]")
    tips = 1e3 * soft.tip.values.reshape(-1, 3)
    seen = axes[1].scatter(tips[:, 0], tips[:, 1], c=softest(soft).ravel(), s=18, cmap="magma_r")
    _bar(figure, seen, axes[1], "tip displacement in its softest direction [mm/mN]")
    effort = np.where(cost.reached, cost.effort, np.nan)
    seen = axes[2].pcolormesh(cost.x, cost.y, effort.T, shading="nearest", cmap="cividis_r")
    _bar(figure, seen, axes[2], "least effort, root of squares [N]")
    missed = np.argwhere(~cost.reached.values)
    axes[2].scatter(cost.x.values[missed[:, 0]], cost.y.values[missed[:, 1]], 8, "0.6", marker="x")
    titles = (
        f"workspace, {int(reach.settled.sum())} random tensions",
        "compliance of the tip, two taut tendons",
        "least effort; x: not reached",
    )
    lettered(zip(axes, titles, strict=True))
    for ax in axes:
        ax.plot([0, 450], [0, 0], color="0.3", lw=2, zorder=0)
        ax.set(xlabel="x [mm]", aspect="equal", xlim=(-330, 480), ylim=(-100, 420))
    for ax in axes[1:]:
        ax.set_ylabel("y [mm]")
    return figure


def _bar(figure: Figure, seen: Any, ax: Any, label: str) -> None:
    figure.colorbar(seen, ax=ax, label=label, location="bottom", shrink=0.8)


def main(argv: Sequence[str] | None = None) -> None:
    """Print the table and save the figure."""
    args = asked(
        __doc__,
        argv,
        {
            "--draws": 2000,
            "--pulls": 12,
            "--points": 16,
            "--jobs": 1,
            "--out": Path("out"),
        },
    )
    reach = run("workspace", workspace(args.draws), args.out, args.jobs)
    soft = run("stiffness", stiffness(args.pulls), args.out, args.jobs)
    cost = run("tensions", tensions(args.points), args.out, args.jobs)
    far = 1e3 * np.linalg.norm(reach.tip.values, axis=1)
    print(f"workspace: {int(reach.settled.sum())} of {far.size} tension sets settle,", end=" ")
    print(f"tips from {np.nanmin(far):.0f} to {np.nanmax(far):.0f} mm from the base")
    give = softest(soft)
    print(f"compliance: the softest direction gives {give.min():.3g} to {give.max():.3g} mm/mN")
    effort = cost.effort.values[cost.reached.values]
    print(f"tensions: {effort.size} of {cost.effort.size} points are reached,", end=" ")
    print(f"with {effort.min():.3g} to {effort.max():.3g} N" if effort.size else "none")
    draw(reach, soft, cost).savefig(args.out / "maps.png", dpi=100)


if __name__ == "__main__":
    main()
