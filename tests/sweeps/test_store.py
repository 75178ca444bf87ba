"""Results saved in parts: the file equals a Dataset in memory, and memory does not grow."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from octoplan import planner
from tests.sweeps.cases import DRAWN, GRID, STIFFNESS, written

ROOT = Path(__file__).parents[2]


@pytest.mark.slow
@pytest.mark.parametrize("suffix", [".nc", ".zarr"])
def test_many_parts_are_saved_as_they_are_in_memory(tmp_path: Path, suffix: str) -> None:
    # Parts of a thousand points end inside of rows: 3 x 7 x 201.
    other = GRID.replace("[0][2]", "[1][1]").replace("count = 3", "count = 7")
    path = written(tmp_path, GRID + other + DRAWN, more="draws = 201")
    found = planner.sweep(path, tmp_path / f"out{suffix}")
    assert found.sizes["draw"] == 201
    assert found.identical(planner.sweep(path))
    assert found.settled.all()


def test_whole_numbers_and_mixed_ones_are_saved_as_what_they_are(tmp_path: Path) -> None:
    axes = STIFFNESS.replace("[100.0, 120.0]", "[100, 120.5]") + (
        '[[sweep.axes]]\nkey = "tensions[0][2]"\nvalues = [0, 1]'
    )
    path = written(tmp_path, axes)
    found = planner.sweep(path, tmp_path / "out.nc")
    assert found["arm.E_kPa"].values.tolist() == [100.0, 120.5]
    assert found.identical(planner.sweep(path))


_PEAK = """
import resource, sys
from octoplan.planner.frontends.cli import main
assert main(["sweep", *sys.argv[1:]]) == 0
print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss)
"""


def _peak(folder: Path, draws: int) -> float:
    """Return the most memory that a sweep takes [MB]."""
    path = written(folder, DRAWN, more=f"draws = {draws}")
    command = [sys.executable, "-c", _PEAK, str(path)]
    alone = {**os.environ, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    told = subprocess.run(command, cwd=ROOT, env=alone, capture_output=True, text=True, check=True)
    return float(told.stdout.split()[-1]) / 1024


@pytest.mark.slow
def test_memory_does_not_grow_with_the_number_of_points(tmp_path: Path) -> None:
    few, many = (_peak(tmp_path, draws) for draws in (5_000, 100_000))
    # In memory, numbers and texts of these points take 40 MB and more.
    assert many < few + 5
