"""The page, by viser: a handle to drag, the arm that follows, tensions, and a status text.

Events of browsers only set flags; one thread moves the arm to the newest target. When the handle
rests, this thread plans the tensions and verifies the plan.
"""

from __future__ import annotations

import io
import logging
import socket
import threading
import time
from contextlib import redirect_stdout
from typing import Any

import numpy as np

from octoplan.model.support.errors import InputError, OctoplanError, needed
from octoplan.model.support.progress import OutOfTime, cancel_when
from octoplan.planner.frontends.io.files import to_json
from octoplan.planner.frontends.io.saved_records import plan_record
from octoplan.planner.frontends.live import words
from octoplan.planner.frontends.live.drawing import (
    DARK,
    LIGHT,
    ArmOnPage,
    add_obstacle,
    backdrop,
    draw_ellipsoid,
    draw_surroundings,
    set_camera,
)
from octoplan.planner.frontends.live.handles import Numbers
from octoplan.planner.frontends.live.session import Session

LOG = logging.getLogger(__name__)
# Time without an event after which the arm is planned, and polling interval of wait [s].
_REST = 0.2


class Page:
    """A page that shows a session, the same for any number of browsers.

    Raises InputError for a port that is in use, and MissingExtraError without viser.
    """

    def __init__(self, session: Session, host: str, port: int) -> None:
        viser = needed("viser", "live")
        _check_port(host, port)
        # Connections that close early are not errors.
        logging.getLogger("websockets").addHandler(logging.NullHandler())
        self.session = session
        self._arm: ArmOnPage | None = None
        with redirect_stdout(io.StringIO()):
            self._server = viser.ViserServer(host=host, port=port, verbose=False)
        self._seen = threading.Event()
        self._changed = threading.Event()
        self._ended = False
        self._server.on_client_connect(lambda _: self._seen.set())
        self._server.gui.set_panel_label("octoplan")
        set_camera(self._server, session.arm)
        self._control = self._server.scene.add_transform_controls(
            "/target",
            scale=0.25 * session.arm.length,
            disable_rotations=not session.handle.turns,
            depth_test=False,
            wxyz=session.handle.start[:4],
            position=session.handle.start[4:],
        )
        self._control.on_update(lambda _: self.move())
        self._add_panel()
        self._show_colours(False)
        self._worker = threading.Thread(target=self._run, daemon=True)
        self._worker.start()
        self.move()

    def move(self) -> None:
        """Set the target to the pose of the handle."""
        self.session.pose = np.concatenate([self._control.wxyz, self._control.position])
        self._changed.set()

    def wait(self, grace: float = 3.0) -> None:
        """Return when no browser has shown the page for `grace` seconds, after the first one."""
        self._seen.wait()
        last = time.monotonic()
        while time.monotonic() < last + grace:
            time.sleep(_REST)
            last = time.monotonic() if self._server.get_clients() else last

    def end(self) -> None:
        """Cancel the computation and stop the server."""
        self._ended = True
        self._changed.set()
        self._worker.join()
        with redirect_stdout(io.StringIO()):
            self._server.stop()

    def _add_panel(self) -> None:
        """Add the status text, numbers, tensions and switches."""
        gui = self._server.gui
        session = self.session
        gui.add_html(words.TITLE)
        self._backdrop = gui.add_html("")
        self._status = gui.add_html("Settling the arm ...")
        self._places = gui.add_html("")
        self._boxes = [self._add_numbers(number) for number in session.handle.numbers]
        self._bars = gui.add_html("")
        gui.add_button("Save the plan").on_click(lambda event: self._save(event.client))
        with gui.add_folder("Effects and loads"):
            for effect in session.effects:
                self._add_switch(type(effect).__name__, session.enabled, effect)
        if session.obstacles:
            with gui.add_folder("Obstacles"):
                for i, obstacle in enumerate(session.obstacles):
                    drawn = add_obstacle(self._server, f"/obstacles/{i}", obstacle)
                    self._add_switch(f"{i}: {type(obstacle).__name__}", session.present, i, drawn)
        with gui.add_folder("Display"):
            self._labels = gui.add_checkbox("Names of tendons", initial_value=True)
            self._labels.on_update(lambda _: self._changed.set())
            dark = gui.add_checkbox("Dark", initial_value=False)
            dark.on_update(lambda event: self._show_colours(event.target.value))
            self._shows = gui.add_checkbox("Compliance ellipsoid", initial_value=False)
            self._shows.on_update(lambda _: self._changed.set())

    def _add_numbers(self, each: Numbers) -> Any:
        """Add input boxes for numbers of the target."""
        gui = self._server.gui
        start = each.read(self.session.handle.start)
        add = gui.add_vector3 if start.size == 3 else gui.add_vector2
        box = add(each.label, tuple(start.tolist()), step=1.0)

        def typed(event: Any) -> None:
            if event.client is None:
                return  # written by _draw, not by a user
            pose = each.write(self.session.pose, np.array(event.target.value))
            self._control.wxyz = pose[:4]
            self._control.position = pose[4:]
            self.move()

        box.on_update(typed)
        return box

    def _add_switch(self, label: str, states: Any, key: Any, drawn: Any = None) -> None:
        """Add a checkbox for an effect, or for an obstacle and the mesh."""

        def switched(event: Any) -> None:
            states[key] = event.target.value
            if drawn is not None:
                drawn.visible = event.target.value
            self.move()

        self._server.gui.add_checkbox(label, initial_value=True).on_update(switched)

    def _show_colours(self, dark: bool) -> None:
        style = DARK if dark else LIGHT
        self._server.gui.configure_theme(
            dark_mode=dark, show_logo=False, show_share_button=False, brand_color=(31, 111, 180)
        )
        self._backdrop.content = backdrop(style)
        draw_surroundings(self._server, self.session.arm, style)

    def _save(self, client: Any) -> None:
        """Send the plan of the displayed arm, if there is one."""
        p = self.session.last
        if client is None:
            return
        if p is None or not self.session.is_planned:
            client.add_notification("Nothing to save yet", "The arm is not planned yet.")
            return
        client.send_file_download("plan.json", to_json(plan_record(p)), save_immediately=True)

    def _run(self) -> None:
        """Follow the newest target, then plan; a new target cancels the plan."""
        while self._changed.wait() and not self._ended:
            self._changed.clear()
            try:
                with cancel_when(lambda: self._ended):
                    more = self._follow()
                if more:
                    self._changed.set()
                elif not self._changed.wait(_REST):
                    with cancel_when(self._changed.is_set):
                        self._plan()
            except OutOfTime:
                LOG.debug("cancelled by a new target")
            except Exception as reason:  # an error must not stop the thread
                if not isinstance(reason, OctoplanError):
                    LOG.exception("the step or the plan failed")
                self._status.content = words.refused(reason)

    def _follow(self) -> bool:
        """Move the arm closer to the target and update the drawing; return whether to continue."""
        more = self.session.step()
        self._draw()
        # If the target has changed meanwhile, the arm is not at the new target yet.
        self._status.content = words.following(self.session, more or self._changed.is_set())
        return more

    def _plan(self) -> None:
        """Plan for the target and report the outcome."""
        session = self.session
        if not session.is_planned:
            self._status.content = words.looking(session)
        p = session.settled()
        self._draw()
        self._status.content = words.planned(session)
        if self._shows.value and p is not None and p.mode == "exact":
            draw_ellipsoid(self._server, p, *session.ellipsoid(p))
        else:
            self._server.scene.remove_by_name("/ellipsoid")

    def _draw(self) -> None:
        """Draw the current arm, tensions and the numbers of the target."""
        session = self.session
        if session.shape is None:
            return
        if self._arm is None:
            self._arm = ArmOnPage(self._server, session.shape, session.most)
        self._arm.move(session.shape, session.most, self._labels.value)
        self._bars.content = words.tendons(session)
        self._places.content = words.places(session)
        for number, box in zip(session.handle.numbers, self._boxes, strict=True):
            box.value = tuple(number.read(session.pose).tolist())


def _check_port(host: str, port: int) -> None:
    """Raise InputError if a port is not available."""
    try:
        with socket.create_server((host, port)):
            pass
    except (OSError, OverflowError) as reason:
        raise InputError("port", port, f"a free port ({reason})") from None
