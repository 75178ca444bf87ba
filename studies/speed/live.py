"""How many pictures a second does the live page show while its target is dragged, and how late?

The handle of a tip target goes around a circle of 60 mm for some seconds, sixty moves a second as a
browser tells of a drag, while a real Chromium looks on: in the paper's scene, around a ball in
water, and of silicone in water and in air. A picture counts when it was drawn and handed to the
browser; its delay is the time since the newest move of the handle that it shows. At last the handle
is let go, and the arm is there once it misses it by less than a thousandth of its length, or as
near as steps lead: silicone in air is too heavy for parts of the circle. What it misses then is
told. Wall time: other work on the machine counts, and a browser without a graphics card takes most
of a processor.

    python -m studies.speed live [--seconds S] [--scene SCENE.toml] [--screenshots DIR] [--compile]

Needs the extra [live], playwright and chromium.
"""

from __future__ import annotations

import shutil
import socket
import threading
import time
from collections.abc import Sequence
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
# Of the page [pixels]; of the circle [m], turns and moves a second.
_SIZE, _RADIUS, _TURNS, _MOVES = (1100, 700), 0.03, 0.4, 60
_OPTIONS = ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
_WAIT = 300_000
# Longer is not waited for the arm [s]; the tension that each tendon may have at least [N].
_LOST, _PULL = 30.0, 10.0


class Timed(Page):
    """A page that keeps when its handle moved and when pictures were drawn [s]."""

    def __init__(self, session: Session, host: str, port: int) -> None:
        self.moved, self.delays, self.drawn = 0.0, list[float](), list[float]()
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
    """Move the handle around a circle, as often as a browser tells of a drag, and let go.

    Returns how long the arm takes to be there then [s].
    """
    start, began = page._control.position.copy(), time.perf_counter()
    pause = threading.Event()
    while (at := time.perf_counter() - began) < seconds:
        turn = 2 * np.pi * _TURNS * at
        page._control.position = start + _RADIUS * np.array([0.0, np.sin(turn), 1 - np.cos(turn)])
        page.move()
        pause.wait(1 / _MOVES)
    page._said.content, gone = "", time.perf_counter()
    while not _is_still(page) and time.perf_counter() - gone < _LOST:
        pause.wait(1 / _MOVES)
    return time.perf_counter() - gone


def _is_still(page: Timed) -> bool:
    """Return whether the arm is there, or says that it comes no nearer."""
    return page.session.is_there or "No nearer" in page._said.content


def measured(browser: Any, session: Session, seconds: float, picture: Path | None) -> str:
    """Return what a drag is like, in words; screenshots are taken in the midst of it and after."""
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
    late, missed = drag(page, seconds), 1e3 * session.missed
    if picture:
        viewer.screenshot(path=picture.with_stem(f"{picture.stem}_let_go"))
    viewer.close()
    page.end()
    spread = page.drawn[-1] - page.drawn[0] if len(page.drawn) > 1 else np.inf
    median, worst = 1e3 * np.quantile(page.delays, [0.5, 0.99])
    rate = (len(page.drawn) - 1) / spread
    return f"{rate:8.1f} {median:8.0f} {worst:8.0f} {late:8.2f} {missed:8.1f}"


def main(argv: Sequence[str] | None = None) -> None:
    """Print pictures a second, their delays, and when the arm is there."""
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
    options["tension_max"] = np.maximum(options["tension_max"], _PULL)
    bare = {name: value for name, value in options.items() if "clear" not in name}
    free = bare | {"obstacles": ()}
    cases = [
        ("paper", Scene(Extension()), free),
        ("ball", request.scene, options),
        ("silicone_in_water", Scene.silicone(Weight(), Buoyancy()), free),
        ("silicone_in_air", Scene.silicone(Weight()), free),
    ]
    print("scene              pictures/s   delay [ms], 99 %   there after [s]  off by [mm]")
    with sync_playwright() as play:
        browser = play.chromium.launch(executable_path=shutil.which("chromium"), args=_OPTIONS)
        for name, scene, each in cases:
            session = Session(request.arm, scene, handle_of(request.arm, request.targets), each)
            picture = args.screenshots / f"{name}.png" if args.screenshots else None
            print(f"{name:18s} {measured(browser, session, args.seconds, picture)}", flush=True)
        browser.close()
