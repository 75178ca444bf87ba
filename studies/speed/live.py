"""How many frames per second does the live page draw while the user drags the target?

The study moves the handle of a tip target around a circle of 60 mm for some seconds, with sixty
moves per second as in a browser, while Chromium shows the page. The scenes are the paper's scene, a
ball in water, silicone in water and silicone in air. A frame counts when it is drawn and sent to
the browser. Its delay is the time since the newest move of the handle that the frame shows.

After the drag the handle is released. The arm has arrived if the tip is within a thousandth of the
arm's length of the handle, or if no further step reduces the distance: silicone in air is too heavy
for parts of the circle. The table contains the final distance. Times are wall times, so that other
processes count; a browser without a graphics card uses most of one processor.

    python -m studies.speed live [--seconds S] [--scene SCENE.toml] [--screenshots DIR] [--compile]

Requires the extra [live], playwright and chromium.
"""

from __future__ import annotations

import shutil
import socket
import threading
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from octoplan.model.effects import Buoyancy, Extension, Weight
from octoplan.model.scene import Scene
from octoplan.planner import plan
from octoplan.planner.frontends.io.scene_file import load
from octoplan.planner.frontends.live.handles import handle_of
from octoplan.planner.frontends.live.page import Page
from octoplan.planner.frontends.live.session import Session
from studies.reporting import asked

_SCENE = Path(__file__).parents[1] / "scenes" / "around_a_ball.toml"
# Size of the page [pixels].
_SIZE = (1100, 700)
# Radius of the circle [m].
_RADIUS = 0.03
# Turns around the circle per second.
_TURNS = 0.4
# Moves of the handle per second.
_MOVES = 60
_OPTIONS = ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
# Texts of the page's status if no step reduces the distance to the target.
_STOPPED = ("Stopped", "Target not reached")
# Timeout of the first plan [ms].
_WAIT = 300_000
# Timeout of the arrival of the arm [s].
_ARRIVAL_TIMEOUT = 30.0
# Least tension limit of each tendon [N].
_LEAST_LIMIT = 10.0


class Timed(Page):
    """A page that records the times of handle moves and of drawn frames [s]."""

    def __init__(self, session: Session, host: str, port: int) -> None:
        self.moved = 0.0
        self.delays = list[float]()
        self.drawn = list[float]()
        super().__init__(session, host, port)

    def move(self) -> None:
        """See Page.move."""
        self.moved = time.perf_counter()
        super().move()

    def _follow(self) -> bool:
        began = self.moved
        more = super()._follow()
        now = time.perf_counter()
        self.drawn.append(now)
        self.delays.append(now - began)
        return more


def drag(page: Timed, seconds: float) -> float:
    """Move the handle around a circle, at the event rate of a browser, and release the handle.

    Return the time from the release until the arm arrives [s].
    """
    start = page._control.position.copy()
    began = time.perf_counter()
    pause = threading.Event()
    while (at := time.perf_counter() - began) < seconds:
        turn = 2 * np.pi * _TURNS * at
        page._control.position = start + _RADIUS * np.array([0.0, np.sin(turn), 1 - np.cos(turn)])
        page.move()
        pause.wait(1 / _MOVES)
    page._status.content = ""
    released = time.perf_counter()
    while not _has_arrived(page) and time.perf_counter() - released < _ARRIVAL_TIMEOUT:
        pause.wait(1 / _MOVES)
    return time.perf_counter() - released


def _has_arrived(page: Timed) -> bool:
    """Test whether the arm has arrived, or the page reports that no step reduces the distance."""
    status = page._status.content
    return page.session.is_there or any(text in status for text in _STOPPED)


def measured(browser: Any, session: Session, seconds: float, picture: Path | None) -> str:
    """Measure a drag; return the row of the table, and take screenshots during and after."""
    with socket.create_server(("localhost", 0)) as free:
        port = int(free.getsockname()[1])
    page = Timed(session, "localhost", port)
    viewer = browser.new_page(viewport={"width": _SIZE[0], "height": _SIZE[1]})
    viewer.goto(f"http://localhost:{port}")
    viewer.get_by_text("not verified").or_(viewer.get_by_text("effort")).wait_for(timeout=_WAIT)
    if picture:
        dragging = threading.Thread(target=drag, args=(page, seconds))
        dragging.start()
        viewer.wait_for_timeout(500 * seconds)
        viewer.screenshot(path=picture.with_stem(f"{picture.stem}_dragged"))
        dragging.join()
    page.drawn.clear()
    page.delays.clear()
    late = drag(page, seconds)
    missed = 1e3 * session.missed
    if picture:
        viewer.screenshot(path=picture.with_stem(f"{picture.stem}_let_go"))
    viewer.close()
    page.end()
    spread = page.drawn[-1] - page.drawn[0] if len(page.drawn) > 1 else np.inf
    median, worst = 1e3 * np.quantile(page.delays, [0.5, 0.99])
    rate = (len(page.drawn) - 1) / spread
    return f"{rate:8.1f} {median:8.0f} {worst:8.0f} {late:8.2f} {missed:8.1f}"


def main(argv: Sequence[str] | None = None) -> None:
    """Print frames per second, delays, and times until the arm arrives."""
    args = asked(
        __doc__,
        argv,
        {
            "--seconds": 5.0,
            "--scene": _SCENE,
            "--screenshots": (None, {"metavar": "DIR", "type": Path}),
            "--compile": False,
        },
        prog="python -m studies.speed live",
    )
    from playwright.sync_api import sync_playwright

    request = load(args.scene)
    options = request.but(compile=args.compile).of(plan)
    limits = options["limits"]
    options["limits"] = replace(limits, tension_max=max(limits.tension_max, _LEAST_LIMIT))
    free = {name: value for name, value in options.items() if "clear" not in name}
    free |= {"obstacles": ()}
    cases = [
        ("paper", Scene(Extension()), free),
        ("ball", request.scene, options),
        ("silicone_in_water", Scene.silicone(Weight(), Buoyancy()), free),
        ("silicone_in_air", Scene.silicone(Weight()), free),
    ]
    print("scene                frames/s   delay [ms], 99 %     arrival [s] distance [mm]")
    with sync_playwright() as play:
        browser = play.chromium.launch(executable_path=shutil.which("chromium"), args=_OPTIONS)
        for name, scene, each in cases:
            session = Session(request.arm, scene, handle_of(request.arm, request.targets), each)
            picture = args.screenshots / f"{name}.png" if args.screenshots else None
            print(f"{name:18s} {measured(browser, session, args.seconds, picture)}", flush=True)
        browser.close()
