"""Where does the arm reach, how soft is it there, and what does it cost to go there?

Question: over the plane in which the third tendons bend the arm of table 4, where can its tip be,
how far does the softest direction at the tip give way to a force, and how hard must tendons pull to
bring the tip to a point?

Assumptions: extension, no loads. Workspace: all tensions drawn log-uniformly, up to 0.6, 5 and 15 N
in sections 1 to 3, for uniform draws pull all tendons at once and crush two arms of three.
Stiffness: third tendons of sections 1 and 3, up to the same. Plans: up to 20 N in each tendon. Each
map is a sweep: its file and its Dataset are kept beside the figure, and a study that is stopped
goes on where it was.

Command: python -m studies.maps [--draws 2000] [--pulls 12] [--points 8] [--jobs 1] [--out out]

Answer: 1996 of 2000 draws settle, with tips from 11 to 445 mm from the base. At the tip of the
straight arm the softest direction gives 52 mm/mN; 0.6 N in section 1, whose tendon stiffens the
slender tip, bring that down to 8, while 15 N near the base hardly change it. Of 64 points on a grid
(x to 450 mm, y to 350 mm) 51 are reached, all by less than 5 N; what is not lies beyond what any
tensions give. Dearest are points beside and at the base, for which the arm has to curl up.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from planner import sweep

MOST = (0.6, 5.0, 15.0)
_SCENE = """\
[scene]
tensions = [[0.0, 0.0, 0.0, 0.0], [0.0, 0.0, 0.0, 0.0], [0.0, 0.0, 0.0, 0.0]]
arm = { preset = "table-4" }
effects = { extension = true }
target = { type = "tip-position", position_mm = [200.0, 100.0, 0.0] }
limits = { tension_max = 20.0 }

"""
_SIDES = {"x": (0.0, 450.0), "y": (0.0, 350.0)}


def _axis(key: str, name: str, **others: object) -> str:
    own = {"key": key, "name": name, **others}
    lines = [f'{k} = "{v}"' if isinstance(v, str) else f"{k} = {v}" for k, v in own.items()]
    return "\n".join(["[[sweep.axes]]", *lines, ""])


def workspace(draws: int) -> str:
    """Return the sweep file of the workspace: all tensions drawn at random."""
    axes = [
        _axis(
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
    return _SCENE + head + "".join(axes)


def stiffness(pulls: int) -> str:
    """Return the sweep file of the stiffness: third tendons of the sections at tip and base."""
    axes = [
        _axis(f"tensions[{i}][2]", f"T{i + 1}3", start=0.0, stop=MOST[i], count=pulls)
        for i in (0, 2)
    ]
    return _SCENE + '[sweep]\ncompute = "stiffness"\n' + "".join(axes)


def tensions(points: int) -> str:
    """Return the sweep file of the tensions: plans for the tip at points of the plane."""
    axes = [
        _axis(f"target.position_mm[{i}]", side, start=low, stop=high, count=points)
        for i, (side, (low, high)) in enumerate(_SIDES.items())
    ]
    return _SCENE + '[sweep]\ncompute = "plan"\n' + "".join(axes)


def run(name: str, text: str, out: Path, jobs: int) -> Any:
    """Write a sweep file and return its Dataset, which is kept beside it."""
    path = out / f"maps_{name}.toml"
    path.write_text(text)
    return sweep(path, path.with_suffix(".nc"), jobs=jobs)


def softest(data: Any) -> Any:
    """Return the largest displacement per force at the tip [mm/mN], of each point."""
    return np.linalg.svd(data.compliance.values[..., :3, :3], compute_uv=False)[..., 0]


def draw(reach: Any, soft: Any, cost: Any) -> Figure:
    """Return the figure: three maps over the plane."""
    figure = Figure(figsize=(13, 4.2), layout="constrained")
    axes = figure.subplots(1, 3)
    tips = 1e3 * reach.tip.values
    seen = axes[0].scatter(tips[:, 0], tips[:, 1], c=np.abs(tips[:, 2]), s=4, cmap="viridis_r")
    figure.colorbar(seen, label="distance from the plane [mm]")
    axes[0].set_title(f"workspace: {int(reach.settled.sum())} tips")
    tips = 1e3 * soft.tip.values.reshape(-1, 3)
    seen = axes[1].scatter(tips[:, 0], tips[:, 1], c=softest(soft).ravel(), s=14, cmap="magma_r")
    figure.colorbar(seen, label="softest direction [mm/mN]")
    axes[1].set_title("stiffness: two tendons pull")
    effort = np.where(cost.reached, cost.effort, np.nan)
    seen = axes[2].pcolormesh(cost.x, cost.y, effort.T, shading="nearest", cmap="cividis_r")
    figure.colorbar(seen, label="effort [N]")
    axes[2].set_title("tensions: blank is out of reach")
    for ax in axes:
        ax.set(xlabel="x [mm]", ylabel="y [mm]", aspect="equal")
    return figure


def main(argv: Sequence[str] | None = None) -> None:
    """Run the study: print its table, save its figure."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--draws", type=int, default=2000)
    parser.add_argument("--pulls", type=int, default=12)
    parser.add_argument("--points", type=int, default=8)
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--out", type=Path, default=Path("out"))
    args = parser.parse_args(argv)
    args.out.mkdir(parents=True, exist_ok=True)
    reach = run("workspace", workspace(args.draws), args.out, args.jobs)
    soft = run("stiffness", stiffness(args.pulls), args.out, args.jobs)
    cost = run("tensions", tensions(args.points), args.out, args.jobs)
    far = 1e3 * np.linalg.norm(reach.tip.values, axis=1)
    print(f"workspace: {int(reach.settled.sum())} of {far.size} draws settle,", end=" ")
    print(f"tips from {np.nanmin(far):.0f} to {np.nanmax(far):.0f} mm from the base")
    give = softest(soft)
    print(f"stiffness: the softest direction gives {give.min():.3g} to {give.max():.3g} mm/mN")
    effort = cost.effort.values[cost.reached.values]
    print(f"tensions: {effort.size} of {cost.effort.size} points are reached,", end=" ")
    print(f"with {effort.min():.3g} to {effort.max():.3g} N" if effort.size else "none")
    draw(reach, soft, cost).savefig(args.out / "maps.png", dpi=130)


if __name__ == "__main__":
    main()
