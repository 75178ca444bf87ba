"""How much time and memory do two processes save in a sweep?

Questions: How much faster are plans on two processes than on one? Does the memory grow with the
number of points?

Assumptions: The arm of table 4, extension, no loads. The plans are for random tips in a box of 200
by 300 by 300 mm beyond the middle of the arm; the equilibria are for random tensions of all twelve
tendons. Work is the processor time of all processes. Other programs on the same processors increase
the times and reduce the gain. Memory is the peak of the main process.

Command: python -m studies.speed sweep [--plans 2000] [--settles 10000 100000] [--out out]

Answer: in studies/README.md.
"""

from __future__ import annotations

import os
import resource
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path

import xarray

from studies.maps import SCENE, axis, workspace
from studies.reporting import asked

ROOT = Path(__file__).parents[2]
_BOX = {"x": (150.0, 350.0), "y": (-150.0, 150.0), "z": (-150.0, 150.0)}
_PEAK = (
    "import resource, sys; from octoplan.planner.frontends.cli import main; main(sys.argv[1:]); "
    "print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss)"
)


def plans(number: int) -> str:
    """Return the sweep file of plans for random tips in a box."""
    axes = [
        axis(f"target.position_mm[{i}]", side, distribution="uniform", low=low, high=high)
        for i, (side, (low, high)) in enumerate(_BOX.items())
    ]
    head = f'[sweep]\ncompute = "plan"\ndraws = {number}\nseed = 1\n'
    return SCENE + head + "".join(axes)


def _words(file: Path, out: Path, jobs: int) -> list[str]:
    return ["sweep", str(file), "--out", str(out), "--jobs", str(jobs)]


def _alone() -> dict[str, str]:
    return {**os.environ, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}


def timed(file: Path, out: Path, jobs: int) -> tuple[float, float]:
    """Run a sweep; return the wall time and the processor time [s]."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    begin = time.perf_counter()
    command = [sys.executable, "-m", "octoplan", *_words(file, out, jobs)]
    subprocess.run(command, cwd=ROOT, env=_alone(), capture_output=True, check=True)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    wall = time.perf_counter() - begin
    return wall, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def peak(file: Path, out: Path) -> float:
    """Run a sweep; return the peak memory [MB]."""
    command = [sys.executable, "-c", _PEAK, *_words(file, out, 1)]
    process = subprocess.run(command, cwd=ROOT, env=_alone(), capture_output=True, check=True)
    return float(process.stdout.split()[-1]) / 1024


def main(argv: Sequence[str] | None = None) -> None:
    """Print the table."""
    args = asked(
        __doc__,
        argv,
        {
            "--plans": 2000,
            "--settles": [10_000, 100_000],
            "--out": Path("out"),
        },
        prog="python -m studies.speed sweep",
    )
    file = args.out.resolve() / "plans.toml"
    file.write_text(plans(args.plans))
    outs = [file.with_name(f"plans_{name}.nc") for name in ("one", "two")]
    print(f"{args.plans} plans; load {os.getloadavg()[0]:.1f} on {os.cpu_count()} processors")
    (one, work), (two, both) = (timed(file, out, j) for out, j in zip(outs, (1, 2), strict=True))
    print(f"  one process   {one:8.1f} s, work {work:8.1f} s")
    print(f"  two           {two:8.1f} s, work {both:8.1f} s: {one / two:.2f} times as fast")
    same = xarray.load_dataset(outs[0]).identical(xarray.load_dataset(outs[1]))
    print(f"  identical: {same}")
    for number in args.settles:
        file = file.with_name("settles.toml")
        file.write_text(workspace(number))
        print(f"{number} settles: {peak(file, file.with_name('settles.nc')):.0f} MB")
