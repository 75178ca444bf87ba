"""Extensions can be left out: without the files of an extension all else works."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
SCRIPT = """
import numpy as np
from octoplan import Arm, Buoyancy, Current, Scene, TipPosition, Weight, plan, settle

arm = Arm.from_paper("table-2")
scene = Scene.silicone(Weight(), Buoyancy(), Current((0.02, 0.05, 0.0)))
shape = settle(arm, np.linspace(0.0, 0.2, arm.n_tendons), scene)
found = plan(arm, TipPosition(shape.tip), scene)
assert found.certificate.passed, found.certificate
assert np.abs(found.shape.tip - shape.tip).max() < 1e-4 * arm.length
"""


@pytest.mark.parametrize("file", ["model/extensions/friction.py"])
def test_loaded_arm_is_planned_without_an_extension(file: str, tmp_path: Path) -> None:
    package = tmp_path / "octoplan"
    shutil.copytree(ROOT / "octoplan", package)
    for name in ("model", "planner"):
        shutil.copytree(ROOT / name, package / name)
    left_out = package / file
    left_out.unlink()
    environment = os.environ | {"PYTHONPATH": str(tmp_path)}
    script = f"import octoplan; assert octoplan.__file__.startswith({str(tmp_path)!r})\n{SCRIPT}"
    result = subprocess.run(
        [sys.executable, "-c", script],
        env=environment,
        capture_output=True,
        text=True,
        cwd=tmp_path,
    )
    assert result.returncode == 0, result.stderr
