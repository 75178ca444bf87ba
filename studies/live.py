"""How many pictures a second does the live page show while its target is dragged, and how late?

The handle of a tip target goes around a circle of 60 mm for some seconds, sixty moves a second as a
browser tells of a drag, while a real Chromium looks on: in the paper's scene, the same around a
ball, and in water. A picture counts when it was planned, drawn and handed to the browser; its delay
is the time since the newest move of the handle that it shows. Wall time: other work on the machine
counts, and a browser without a graphics card takes most of a processor.

    python -m studies.live [--seconds S] [--scene SCENE.toml] [--screenshot FILE.png] [--compile]

Needs the extra [live], playwright and chromium.
"""

from __future__ import annotations

import argparse
import shutil
import socket
import threading
import time
from pathlib import Path
from typing import Any

import numpy as np

from model.effects import Extension
from model.paths import Array
from model.scene import Scene
from planner.live.handles import Handle, handle_of
from planner.live.page import Page
from planner.live.session import Session
from planner.scenefile import load

_SCENE = Path(__file__).parent / "scenes" / "around_a_ball.toml"
# Of the page [pixels]; of the circle [m], turns and moves a second.
_SIZE, _RADIUS, _TURNS, _MOVES = (1100, 700), 0.03, 0.4, 60
_OPTIONS = ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
_WAIT = 300_000


class Timed(Page):
    """A page that keeps when its handle moved and when pictures were drawn [s]."""

    def __init__(self, session: Session, handle: Handle, host: str, port: int) -> None:
        self.moved, self.delays, self.drawn = 0.0, list[float](), list[float]()
        super().__init__(session, handle, host, port)

    def move(self) -> None:
        """See Page.move."""
        self.moved = time.perf_counter()
        super().move()

    def _follow(self, pose: Array) -> None:
        began = self.moved
        super()._follow(pose)
        now = time.perf_counter()
        self.drawn.append(now)
        self.delays.append(now - began)


def drag(page: Timed, seconds: float) -> None:
    """Move the handle around a circle, as often as a browser tells of a drag, and back."""
    start, began = page._control.position.copy(), time.perf_counter()
    pause = threading.Event()
    while (at := time.perf_counter() - began) < seconds:
        turn = 2 * np.pi * _TURNS * at
        page._control.position = start + _RADIUS * np.array([0.0, np.sin(turn), 1 - np.cos(turn)])
        page.move()
        pause.wait(1 / _MOVES)
    page._control.position = start
    page.move()


def measured(browser: Any, session: Session, seconds: float, picture: str | None) -> Timed:
    """Return the page after a drag; a screenshot is taken once it rests."""
    with socket.create_server(("localhost", 0)) as free:
        port = int(free.getsockname()[1])
    page = Timed(session, handle_of(session.arm, (session.target,)), "localhost", port)
    viewer = browser.new_page(viewport={"width": _SIZE[0], "height": _SIZE[1]})
    viewer.goto(f"http://localhost:{port}")
    viewer.get_by_text("effort").wait_for(timeout=_WAIT)
    page.drawn.clear()
    page.delays.clear()
    drag(page, seconds)
    viewer.get_by_text("effort").wait_for(timeout=_WAIT)
    if picture:
        viewer.locator("button").first.click()  # the note that there is no graphics card
        viewer.get_by_role("checkbox").last.evaluate("box => box.click()")
        viewer.wait_for_timeout(3000)
        viewer.screenshot(path=picture)
    viewer.close()
    page.end()
    return page


def main() -> None:
    """Print the pictures a second and their delays."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seconds", type=float, default=5.0)
    parser.add_argument("--scene", type=Path, default=_SCENE)
    parser.add_argument("--screenshot")
    parser.add_argument("--compile", action="store_true")
    args = parser.parse_args()
    from playwright.sync_api import sync_playwright

    asked = load(args.scene)
    options = asked.options | {"accuracy": asked.accuracy, "compile": args.compile}
    bare = {name: value for name, value in options.items() if "clear" not in name}
    cases = [
        ("the paper's scene", Scene(Extension()), bare | {"obstacles": ()}),
        ("the same around a ball", Scene(Extension()), options),
        ("the scene of the file", asked.scene, options),
    ]
    print("pictures a second; their delays in ms, median and 99 %")
    with sync_playwright() as play:
        browser = play.chromium.launch(executable_path=shutil.which("chromium"), args=_OPTIONS)
        for name, scene, own in cases:
            session = Session(asked.arm, scene, asked.targets[0], own)
            last = args.screenshot if own is options and scene != asked.scene else None
            page = measured(browser, session, args.seconds, last)
            spread = page.drawn[-1] - page.drawn[0] if len(page.drawn) > 1 else np.inf
            late = 1e3 * np.quantile(page.delays, [0.5, 0.99])
            print(
                f"{name:25s} {(len(page.drawn) - 1) / spread:6.1f}   {late[0]:.0f}  {late[1]:.0f}"
            )
        browser.close()


if __name__ == "__main__":
    main()
