"""The package works without the files of an extension."""

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
from octoplan import Arm, Buoyancy, Current, Scene, TipPosition, Weight, load_plan, plan, settle

assert octoplan.__file__.startswith({folder!r})
assert "Box" in dir(octoplan) and {absent!r} not in dir(octoplan)
arm = Arm.from_paper("table-2")
scene = Scene.silicone(Weight(), Buoyancy(), Current((0.02, 0.05, 0.0)))
shape = settle(arm, np.linspace(0.0, 0.2, arm.n_tendons), scene)
found = plan(arm, TipPosition(shape.tip), scene, starts=1)
assert found.certificate.passed, found.certificate
assert np.abs(found.shape.tip - shape.tip).max() < 1e-4 * arm.length
found.save("plan.json")
assert np.array_equal(load_plan("plan.json").tensions, found.tensions)
again = settle(arm, lengths=shape.tendon_lengths, scene=scene)
assert np.abs(again.tip - shape.tip).max() < 1e-4 * arm.length
many = octoplan.settle_many(arm, [shape.tensions], scene)
assert np.abs(many.tip[0] - shape.tip).max() < 1e-4 * arm.length
motion = octoplan.trajectory(arm, [TipPosition(shape.tip)], scene, rate_max=1.0, waypoints=4)
assert motion.certificate
assert shape.remarks == () and shape.plot() is not None
"""
ABSENT = {"friction": "Friction", "contact": "SelfContact"}


@pytest.mark.parametrize("extension", LEFT_OUT)
def test_package_works_without_an_extension(extension: str, tmp_path: Path) -> None:
    package = tmp_path / "octoplan"
    shutil.copytree(ROOT / "octoplan", package)
    for name in ("model", "planner"):
        shutil.copytree(ROOT / name, package / name)
    for name in LEFT_OUT[extension]:
        left_out = package / name
        if left_out.is_dir():
            shutil.rmtree(left_out)
        else:
            left_out.unlink()
    result = subprocess.run(
        [sys.executable, "-c", SCRIPT.format(folder=str(tmp_path), absent=ABSENT[extension])],
        env=os.environ | {"PYTHONPATH": str(tmp_path)},
        capture_output=True,
        text=True,
        cwd=tmp_path,
    )
    assert result.returncode == 0, result.stderr
