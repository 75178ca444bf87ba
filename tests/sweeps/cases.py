"""Sweeps that run in a moment."""

from pathlib import Path

import numpy as np

TENSIONS = "[[0.0, 0.0, 0.5, 0.0], [4.0, 0.0, 0.0, 0.0], [0.0, 6.0, 0.0, 0.0]]"
SCENE = f"""
tensions = {TENSIONS}
[arm]
preset = "table-4"
[effects]
extension = true
[target]
type = "tip-position"
position_mm = [200.0, 150.0, -200.0]
[limits]
tension_max = 20.0
"""
GRID = """
[[sweep.axes]]
key = "tensions[0][2]"
start = 0.0
stop = 0.5
count = 3
"""
STIFFNESS = """
[[sweep.axes]]
key = "arm.E_kPa"
values = [100.0, 120.0]
"""
DRAWN = """
[[sweep.axes]]
key = "tensions[1][0]"
distribution = "uniform"
low = 1.0
high = 4.0
"""


def written(folder: Path, axes: str, compute: str = "settle", more: str = "") -> Path:
    """Write a scene and a sweep of the scene; return the sweep file."""
    (folder / "scene.toml").write_text(SCENE)
    path = folder / "sweep.toml"
    path.write_text(f'scene = "scene.toml"\n[sweep]\ncompute = "{compute}"\n{more}\n{axes}')
    return path


def tensions() -> np.ndarray:
    """Return the scene's tensions (3, 4) [N]."""
    return np.array([[0.0, 0.0, 0.5, 0.0], [4.0, 0.0, 0.0, 0.0], [0.0, 6.0, 0.0, 0.0]])
