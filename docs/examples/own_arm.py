"""Describe an arm, plan for a tip position, verify the plan and compute the stiffness.

python docs/examples/own_arm.py [FOLDER]
"""

import sys
from pathlib import Path

import numpy as np

from octoplan import (
    Anchorage,
    Arm,
    Buoyancy,
    Linear,
    Material,
    Scene,
    TipPosition,
    Weight,
    plan,
    stiffness,
)

out = Path(sys.argv[1] if len(sys.argv) > 1 else ".")

thirds = np.radians([0, 120, 240])
arm = Arm(
    length=0.24,
    radius=Linear(0.014, 0.006),
    sections=(
        Anchorage(0.24, Linear(0.009, 0.004), tuple(thirds)),
        Anchorage(0.12, Linear(0.007, 0.007), tuple(thirds + np.radians(60))),
    ),
    material=Material(E=150e3, nu=0.5, density=1070.0),
    base_frame=((0, -1, 0), (0, 0, 1), (-1, 0, 0)),  # columns t, n, b of a hanging arm
)
scene = Scene.silicone(Weight(), Buoyancy(1000.0))
p = plan(arm, TipPosition((0.06, 0.02, -0.20)), scene, tension_max=10.0)
print(p)
print(p.certificate)
for hold in ("tension", "length"):
    print(stiffness(arm, p.tensions, scene, hold=hold))
p.plot().savefig(out / "own_arm.png")
p.save(out / "own_arm.json")
