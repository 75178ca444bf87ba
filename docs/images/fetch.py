"""Draw the animation of the README: python docs/images/fetch.py.

The animation shows the plan for `studies/scenes/fetch_3d.toml`, from rest.
"""

from __future__ import annotations

from pathlib import Path

from PIL import Image, ImageSequence

from octoplan.planner import plan
from octoplan.planner.frontends.io.scene_file import load
from octoplan.planner.frontends.plots.motion import plot_motion, save_motion

FILE = Path(__file__).with_name("fetch_3d.gif")


def main() -> None:
    """Write fetch_3d.gif beside this file."""
    asked = load(Path(__file__).parents[2] / "studies" / "scenes" / "fetch_3d.toml")
    found = plan(asked.arm, asked.targets, asked.scene, 13.0)
    path = save_motion(plot_motion([found], frames=18), FILE, dpi=80)
    with Image.open(path) as moving:
        frames = [frame.copy() for frame in ImageSequence.Iterator(moving)]
    # The last frame stays for two seconds.
    times = [80] * (len(frames) - 1) + [2000]
    frames[0].save(path, save_all=True, append_images=frames[1:], duration=times, loop=0)


if __name__ == "__main__":
    main()
