"""The core works without the files of an extension.

The copies of the package have no lists of public names in model/__init__.py and
planner/__init__.py, which import all extensions.
"""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[3]
LEFT_OUT = {
    "friction": ("model/extensions/friction.py",),
    "contact": ("model/extensions/contact", "planner/extensions/contact"),
}
SCRIPT = """
import numpy as np
import octoplan
from octoplan.model.arm import Arm
from octoplan.model.effects import Buoyancy, Current, Weight
from octoplan.model.scene import Scene
from octoplan.model.settle import settle
from octoplan.planner.plan import plan
from octoplan.planner.targets.tip import TipPosition

assert octoplan.__file__.startswith({folder!r})
arm = Arm.from_paper("table-2")
scene = Scene.silicone(Weight(), Buoyancy(), Current((0.02, 0.05, 0.0)))
shape = settle(arm, np.linspace(0.0, 0.2, arm.n_tendons), scene)
found = plan(arm, TipPosition(shape.tip), scene)
assert found.certificate.passed, found.certificate
assert np.abs(found.shape.tip - shape.tip).max() < 1e-4 * arm.length
"""


@pytest.mark.parametrize("extension", LEFT_OUT)
def test_loaded_arm_is_planned_without_an_extension(extension: str, tmp_path: Path) -> None:
    package = tmp_path / "octoplan"
    shutil.copytree(ROOT / "octoplan", package)
    for name in ("model", "planner"):
        shutil.copytree(ROOT / name, package / name)
        (package / name / "__init__.py").write_text("")
    for name in LEFT_OUT[extension]:
        left_out = package / name
        if left_out.is_dir():
            shutil.rmtree(left_out)
        else:
            left_out.unlink()
    result = subprocess.run(
        [sys.executable, "-c", SCRIPT.format(folder=str(tmp_path))],
        env=os.environ | {"PYTHONPATH": str(tmp_path)},
        capture_output=True,
        text=True,
        cwd=tmp_path,
    )
    assert result.returncode == 0, result.stderr
