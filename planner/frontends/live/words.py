"""Texts of the page, as HTML: the position of the arm, and the state of the plan.

HTML, because browsers render Markdown with a delay, so that texts did not appear during motion.
"""

from __future__ import annotations

import html

import numpy as np

from octoplan.planner.frontends.live.drawing import tension_colour
from octoplan.planner.frontends.live.session import Session

# The title of the page: browsers run the error handler of the missing image.
TITLE = """<img src="data:," hidden onerror="document.title = 'octoplan'">"""
_SMALL = "font-size:11px;padding:0 1em;font-variant-numeric:tabular-nums"


def following(session: Session, more: bool) -> str:
    """Return the status while the arm follows the target."""
    if session.is_there:
        return _status(f"<b>Target reached</b> ({_distance(session)} away); not verified yet.")
    if more:
        return _status(f"<b>Moving</b>, {_distance(session)} to go.")
    why = ": the arm becomes unstable if it moves closer" * session.is_held
    nearest = f"<b>Stopped</b>, {_distance(session)} to go{why}"
    return _status(f"{nearest}; searching for a plan next.")


def looking(session: Session) -> str:
    """Return the status during the search for a plan."""
    return _status(f"{_place(session)}. Searching for the tensions of least effort ...")


def planned(session: Session) -> str:
    """Return the status after the search for a plan."""
    p = session.last
    if p is None:
        return ""
    message = html.escape(p.outcome)
    if session.is_planned:
        return _status(message)
    how = "the arm is shown as dragged, with tensions that are not verified"
    return _status(f"{_place(session)}; {how}. Outcome of the plan: {message}")


def refused(reason: Exception) -> str:
    """Return the status after an error."""
    return _status(f"<b>{html.escape(str(reason))}</b>")


def places(session: Session) -> str:
    """Return a table of the tip position and the distance to the target [mm]."""
    shape = session.shape
    if shape is None:
        return ""
    cells = "".join(f"<td align=right>{1e3 * x:.1f}</td>" for x in shape.tip)
    missed = f"<tr><td>miss</td><td align=right colspan=3>{_distance(session)}</td></tr>"
    head = "<tr><th align=left>[mm]</th><th>x</th><th>y</th><th>z</th></tr>"
    return f"<table style='width:100%;{_SMALL}'>{head}<tr><td>tip</td>{cells}</tr>{missed}</table>"


def tendons(session: Session) -> str:
    """Return a table of tensions, as bars relative to the limits, and strokes."""
    shape = session.shape
    if shape is None:
        return ""
    rows = []
    slack = np.ravel(shape.slack)
    tendons = zip(shape.tensions, session.most, 1e3 * session.strokes, strict=True)
    for j, (T, limit, stroke) in enumerate(tendons):
        colour = "rgb" + str(tension_colour(float(T), float(limit)))
        width = 100 * min(float(T / limit), 1.0)
        bar = f"<div style='background:{colour};height:7px;width:{width:.1f}%'></div>"
        rows.append(
            f"<tr><td>{html.escape(shape.arm.tendon_name(j))}</td>"
            f"<td style='width:40%'><div style='background:#8884'>{bar}</div></td>"
            f"<td align=right>{T:.3f} N</td>"
            f"<td align=right>{'at most ' * bool(slack[j])}{stroke:.2f} mm</td></tr>"
        )
    head = "<tr><th></th><th></th><th align=right>tension</th><th align=right>stroke</th></tr>"
    return f"<table style='width:100%;{_SMALL}'>{head}{''.join(rows)}</table>"


def _status(text: str) -> str:
    return f"<div style='font-size:14px;padding:0.3em 1em'>{text}</div>"


def _place(session: Session) -> str:
    state = "Target reached" if session.is_there else "Target not reached"
    return f"<b>{state}</b> ({_distance(session)} away)"


def _distance(session: Session) -> str:
    """Return the distance from the arm to the target, in mm or degrees."""
    if session.goal.position is None:
        return f"{np.degrees(session.missed):.1f} deg"
    missed = 1e3 * session.missed
    return f"{missed:.0f} mm" if missed >= 10 else f"{missed:.1f} mm"
