"""The page: a handle that is dragged, the arm that follows, tensions, and what happened; by viser.

What browsers ask is handed to one worker, which follows the newest wish; once the handle rests, the
plan is checked.
"""

from __future__ import annotations

import html
import io
import logging
import socket
import threading
from collections.abc import Callable
from contextlib import redirect_stdout
from typing import Any

import numpy as np

from model.effects import Effect
from model.errors import InputError, OctoplanError
from model.extras import needed
from model.obstacles import Obstacle
from model.paths import Array
from planner.files import to_json
from planner.live.drawing import add_obstacle, bars, draw_arm, draw_ellipsoid, set_camera
from planner.live.handles import Handle, on_the_way
from planner.live.latest import Latest
from planner.live.session import Session
from planner.plan import Plan
from planner.records.plan import plan_record

_LEFT = "The branch of optima could not be followed: this plan is on another."
# The farthest that a target moves from picture to picture, over the arm's length.
_SHORT = 0.02
# How often a page that nobody looks at is looked after [s].
_GLANCE = 0.1


class Page:
    """A page that shows a session; any number of browsers may look at it, and see the same.

    Raises InputError for a port that is in use, and MissingExtraError without viser.
    """

    def __init__(self, session: Session, handle: Handle, host: str, port: int) -> None:
        viser = needed("viser", "live")
        _check_port(host, port)
        # What goes away while it connects is no error that anyone has to see.
        logging.getLogger("websockets").addHandler(logging.NullHandler())
        self.session, self._handle, self._left = session, handle, False
        self._pose = handle.start
        with redirect_stdout(io.StringIO()):
            self._server = viser.ViserServer(host=host, port=port, verbose=False)
        self._seen, self._work = threading.Event(), Latest(self._rest)
        self._server.on_client_connect(lambda _: self._seen.set())
        set_camera(self._server, session.arm)
        self._said, self._bars, self._shows = self._panel()
        self._control = self._add_handle()
        self.move()

    def move(self) -> None:
        """Ask for the target that the handle's pose means."""
        pose = np.concatenate([self._control.wxyz, self._control.position])
        self._work.put(lambda: self._follow(pose))

    def wait(self, grace: float = 3.0) -> None:
        """Return once all browsers that looked at the page are gone for so many seconds."""
        self._seen.wait()
        pause, empty = threading.Event(), 0.0
        while empty < grace:
            pause.wait(_GLANCE)
            empty = 0.0 if self._server.get_clients() else empty + _GLANCE

    def end(self) -> None:
        """End the work, and the server."""
        self._work.end()
        with redirect_stdout(io.StringIO()):
            self._server.stop()

    def _add_handle(self) -> Any:
        start = self._handle.start
        control = self._server.scene.add_transform_controls(
            "/target",
            scale=0.25 * self.session.arm.length,
            disable_rotations=not self._handle.turns,
            depth_test=False,
            wxyz=start[:4],
            position=start[4:],
        )
        control.on_update(lambda _: self.move())
        return control

    def _panel(self) -> tuple[Any, Any, Any]:
        """Return what is said, the bars, and the box that shows the ellipsoid."""
        gui = self._server.gui
        said, shown = gui.add_markdown("Looking for a first plan ..."), gui.add_html("")
        with gui.add_folder("Effects and loads"):
            for effect in self.session.effects:
                box = gui.add_checkbox(type(effect).__name__, initial_value=True)
                box.on_update(self._switch(effect))
        if self.session.obstacles:
            with gui.add_folder("Obstacles"):
                for i, obstacle in enumerate(self.session.obstacles):
                    box = gui.add_checkbox(f"{i}: {type(obstacle).__name__}", initial_value=True)
                    box.on_update(self._place(i, obstacle))
        shows = gui.add_checkbox("Compliance ellipsoid", initial_value=False)
        shows.on_update(lambda _: self._work.put(lambda: None))
        gui.add_button("Save the plan").on_click(lambda event: self._save(event.client))
        return said, shown, shows

    def _switch(self, effect: Effect) -> Callable[[Any], None]:
        def switched(event: Any) -> None:
            self.session.enabled[effect] = event.target.value
            self.move()

        return switched

    def _place(self, i: int, obstacle: Obstacle) -> Callable[[Any], None]:
        drawn = add_obstacle(self._server, f"/obstacles/{i}", obstacle)

        def switched(event: Any) -> None:
            self.session.present[i] = drawn.visible = event.target.value
            self.move()

        return switched

    def _save(self, client: Any) -> None:
        p = self.session.last
        if client is not None and p is not None:
            found = to_json(plan_record(p))
            client.send_file_download("plan.json", found, save_immediately=True)

    def _follow(self, pose: Array) -> None:
        """Plan for a target that moves, and draw it; in the worker's thread.

        A plan follows its branch by short steps, sooner than a far one is searched for: a pose far
        away is come to by others on the way, each of them drawn.
        """
        session, most = self.session, _SHORT * self.session.arm.length
        try:
            here = on_the_way(self._pose, pose, most) if session.follows else pose
            session.target = self._handle.target(here)
            step = session.step()
            self._pose = here
            if here is not pose:
                self._work.go_on(lambda: self._follow(pose))
            draw_arm(self._server, step.plan.shape, session.most)
        except OctoplanError as reason:
            self._tell(reason)
            return
        self._bars.content = bars(step.plan, session.most)
        self._left = self._left or step.left
        self._said.content = f"{_following(step.plan)} {_LEFT * self._left}"

    def _rest(self) -> None:
        """Check the last plan and say what it is; in the worker's thread."""
        session = self.session
        try:
            p = session.settled()
            if p is None:
                return
            draw_arm(self._server, p.shape, session.most)
            self._bars.content = bars(p, session.most)
            self._said.content = f"{html.escape(p.outcome)} {_LEFT * self._left}"
            self._left = False
            if self._shows.value:
                draw_ellipsoid(self._server, p, *session.ellipsoid(p))
            else:
                self._server.scene.remove_by_name("/ellipsoid")
        except OctoplanError as reason:
            self._tell(reason)

    def _tell(self, reason: OctoplanError) -> None:
        self._said.content = f"**{html.escape(str(reason))}**"


def _following(p: Plan) -> str:
    """Return what is said of a plan that is not checked yet."""
    if p.mode == "exact":
        return "Following: reached; not checked yet."
    held = ", ".join(map(html.escape, p.holding()))
    by = f", held by {held}" if held else ""
    return f"Out of reach: this is the nearest shape{by}; not checked yet."


def _check_port(host: str, port: int) -> None:
    """Raise InputError where a port cannot be had."""
    try:
        with socket.create_server((host, port)):
            pass
    except (OSError, OverflowError) as reason:
        raise InputError("port", port, f"one that is free ({reason})") from None
