"""Plan for a tip target behind a ball, through the ball and around the ball.

python docs/examples/around_a_ball.py [FOLDER]
"""

import sys
from pathlib import Path

from matplotlib.figure import Figure

from octoplan import Arm, Extension, Scene, Sphere, TipPosition, plan

out = Path(sys.argv[1] if len(sys.argv) > 1 else ".")

arm, scene = Arm.from_paper("table-4"), Scene(Extension())
ball = Sphere(center=(0.27, 0.06, -0.06), radius=0.03)
target = TipPosition((0.30, 0.15, -0.10))
through = plan(arm, target, scene, 20.0)
around = plan(arm, target, scene, 20.0, obstacles=[ball], clearance=0.002, near=through)
for name, p in (("through", through), ("around", around)):
    print(f"{name}: effort {p.effort:.3f} N. {p.outcome}")

figure = Figure(figsize=(6, 5))
ax = figure.add_subplot(projection="3d")
through.plot(ax)
around.plot(ax)  # in the same colours
figure.savefig(out / "around_a_ball.png")
