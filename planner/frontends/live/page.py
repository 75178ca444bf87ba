"""The page: a handle that is dragged, the arm that follows, tensions, and what happened; by viser.

What browsers ask is noted, and one thread follows the newest wish; once the handle rests, the arm's
tensions are planned and verified. What the page says is what is so at that moment.
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
# After how long without a wish the arm is planned, and how often a page that nobody looks at is
# looked after [s].
_REST = 0.2


class Page:
    """A page that shows a session; any number of browsers may look at it, and see the same.

    Raises InputError for a port that is in use, and MissingExtraError without viser.
    """

    def __init__(self, session: Session, host: str, port: int) -> None:
        viser = needed("viser", "live")
        _check_port(host, port)
        # What goes away while it connects is no error that anyone has to see.
        logging.getLogger("websockets").addHandler(logging.NullHandler())
        self.session = session
        self._arm: ArmOnPage | None = None
        with redirect_stdout(io.StringIO()):
            self._server = viser.ViserServer(host=host, port=port, verbose=False)
        self._seen, self._changed, self._ended = threading.Event(), threading.Event(), False
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
        """Ask for the target that the handle's pose means."""
        self.session.pose = np.concatenate([self._control.wxyz, self._control.position])
        self._changed.set()

    def wait(self, grace: float = 3.0) -> None:
        """Return once all browsers that looked at the page are gone for so many seconds."""
        self._seen.wait()
        last = time.monotonic()
        while time.monotonic() < last + grace:
            time.sleep(_REST)
            last = time.monotonic() if self._server.get_clients() else last

    def end(self) -> None:
        """End the work, which is cut short, and the server."""
        self._ended = True
        self._changed.set()
        self._worker.join()
        with redirect_stdout(io.StringIO()):
            self._server.stop()

    def _add_panel(self) -> None:
        """Add what is said, the numbers, the tensions, and what is switched."""
        gui, session = self._server.gui, self.session
        gui.add_html(words.TITLE)
        self._backdrop = gui.add_html("")
        self._said = gui.add_html("Settling the arm ...")
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
        with gui.add_folder("HtmlRepr"):
            self._labels = gui.add_checkbox("Names of tendons", initial_value=True)
            self._labels.on_update(lambda _: self._changed.set())
            dark = gui.add_checkbox("Dark", initial_value=False)
            dark.on_update(lambda event: self._show_colours(event.target.value))
            self._shows = gui.add_checkbox("Compliance ellipsoid", initial_value=False)
            self._shows.on_update(lambda _: self._changed.set())

    def _add_numbers(self, each: Numbers) -> Any:
        """Add boxes in which numbers of the target are typed."""
        gui, start = self._server.gui, each.read(self.session.handle.start)
        add = gui.add_vector3 if start.size == 3 else gui.add_vector2
        box = add(each.label, tuple(start.tolist()), step=1.0)

        def typed(event: Any) -> None:
            if event.client is None:
                return  # written as the handle was dragged
            pose = each.write(self.session.pose, np.array(event.target.value))
            self._control.wxyz, self._control.position = pose[:4], pose[4:]
            self.move()

        box.on_update(typed)
        return box

    def _add_switch(self, label: str, states: Any, key: Any, drawn: Any = None) -> None:
        """Add a box that switches an effect, or an obstacle and its drawing."""

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
        """Send the plan, where there is one of the arm as it is shown."""
        p = self.session.last
        if client is None:
            return
        if p is None or not self.session.is_planned:
            client.add_notification("Nothing to save yet", "The arm is not planned yet.")
            return
        client.send_file_download("plan.json", to_json(plan_record(p)), save_immediately=True)

    def _run(self) -> None:
        """Follow the newest wish, and plan once there is none; a new one cuts that short."""
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
                LOG.debug("cut short")
            except Exception as reason:  # what goes wrong once does not end the page
                if not isinstance(reason, OctoplanError):
                    LOG.exception("the arm was not brought nearer, or not planned")
                self._said.content = words.refused(reason)

    def _follow(self) -> bool:
        """Bring the arm nearer to the target, and draw it; return whether more would do more."""
        more = self.session.step()
        self._draw()
        # What is wanted by now may be elsewhere: of that it is not known yet.
        self._said.content = words.following(self.session, more or self._changed.is_set())
        return more

    def _plan(self) -> None:
        """Plan for the target, and say what that is."""
        session = self.session
        if not session.is_planned:
            self._said.content = words.looking(session)
        p = session.settled()
        self._draw()
        self._said.content = words.planned(session)
        if self._shows.value and p is not None and p.mode == "exact":
            draw_ellipsoid(self._server, p, *session.ellipsoid(p))
        else:
            self._server.scene.remove_by_name("/ellipsoid")

    def _draw(self) -> None:
        """Draw the arm as it is, with its numbers and the target's."""
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
    """Raise InputError where a port cannot be had."""
    try:
        with socket.create_server((host, port)):
            pass
    except (OSError, OverflowError) as reason:
        raise InputError("port", port, f"one that is free ({reason})") from None
