"""Take the screenshot of the live page: python docs/images/live.py [--dark] [FILE.png].

The page shows studies/scenes/around_a_ball.toml after planning. This requires the extra [live],
Chromium and playwright (python -m pip install playwright).
"""

from __future__ import annotations

import argparse
import io
import shutil
import socket
from pathlib import Path

import numpy as np
from PIL import Image
from playwright.sync_api import Page as Viewer
from playwright.sync_api import sync_playwright

from octoplan.planner import plan
from octoplan.planner.frontends.io.scene_file import load
from octoplan.planner.frontends.live.drawing import DARK, LIGHT, Colour
from octoplan.planner.frontends.live.handles import handle_of
from octoplan.planner.frontends.live.page import Page
from octoplan.planner.frontends.live.session import Session

SCENE = Path(__file__).parents[2] / "studies" / "scenes" / "around_a_ball.toml"
OPTIONS = ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
SIZE = {"width": 1280, "height": 800}
WAIT = 300_000


def main() -> None:
    """Write live.png beside this file, or the given file."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("file", nargs="?", type=Path, default=Path(__file__).with_suffix(".png"))
    parser.add_argument("--scene", type=Path, default=SCENE)
    parser.add_argument("--dark", action="store_true")
    args = parser.parse_args()
    asked = load(args.scene)
    with socket.create_server(("localhost", 0)) as free:
        port = int(free.getsockname()[1])
    session = Session(asked.arm, asked.scene, handle_of(asked.arm, asked.targets), asked.of(plan))
    page = Page(session, "localhost", port)
    with sync_playwright() as play:
        browser = play.chromium.launch(executable_path=shutil.which("chromium"), args=OPTIONS)
        viewer = browser.new_page(viewport=SIZE)
        viewer.goto(f"http://localhost:{port}")
        viewer.get_by_text("effort").wait_for(timeout=WAIT)
        # Close the notification about a missing graphics card.
        close = viewer.locator(".mantine-Notification-closeButton")
        if close.count():
            close.first.click()
        if args.dark:
            viewer.get_by_role("checkbox", name="Dark", exact=True).evaluate("box => box.click()")
        viewer.wait_for_timeout(3000)
        args.file.write_bytes(screenshot(viewer, (DARK if args.dark else LIGHT).top))
        browser.close()
    page.end()


def screenshot(viewer: Viewer, top: Colour) -> bytes:
    """Return a screenshot (PNG) whose background begins with a colour.

    Without a window Chromium may return the frame before the last change; the next one is newer.
    Raises TimeoutError if no frame has the colour.
    """
    for _ in range(60):
        seen = viewer.screenshot()
        pixel = np.array(Image.open(io.BytesIO(seen)).convert("RGB").getpixel((2, 2)))
        if np.abs(pixel - top).max() <= 8:
            return seen
        viewer.wait_for_timeout(500)
    raise TimeoutError(f"the background is {pixel}, not {top}")


if __name__ == "__main__":
    main()
