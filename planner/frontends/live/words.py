"""What the page says, as HTML: where the arm is, and what is known of its tensions.

Not as Markdown, which browsers make in the background: while the arm moved it was never shown.
"""

from __future__ import annotations

import html

import numpy as np

from octoplan.planner.frontends.live.drawing import tension_colour
from octoplan.planner.frontends.live.session import Session

# The page's title: browsers run what is said of an image that is not there.
TITLE = """<img src="data:," hidden onerror="document.title = 'octoplan'">"""
_SMALL = "font-size:11px;padding:0 1em;font-variant-numeric:tabular-nums"


def following(session: Session, more: bool) -> str:
    """Return what is said while the arm moves."""
    if session.is_there:
        return _said(f"<b>There</b> ({_distance(session)}); not verified yet.")
    if more:
        return _said(f"<b>Catching up</b>, {_distance(session)} to go.")
    why = ": nearer it would not stand under its loads" * session.is_held
    nearest = f"<b>No nearer from here</b>, {_distance(session)} to go{why}"
    return _said(f"{nearest}; a plan will be searched for.")


def looking(session: Session) -> str:
    """Return what is said while a plan is searched for."""
    return _said(f"{_place(session)}. Looking for the tensions of least effort ...")


def planned(session: Session) -> str:
    """Return what is said of the arm once its plan was searched for."""
    p = session.last
    if p is None:
        return ""
    message = html.escape(p.outcome)
    if session.is_planned:
        return _said(message)
    how = "by tensions that are not verified: shown is the arm as it was dragged"
    return _said(f"{_place(session)}, {how}. The planner says: {message}")


def refused(reason: Exception) -> str:
    """Return what is said where the arm is not settled or planned."""
    return _said(f"<b>{html.escape(str(reason))}</b>")


def places(session: Session) -> str:
    """Return where target and tip are [mm]."""
    shape = session.shape
    if shape is None:
        return ""
    cells = "".join(f"<td align=right>{1e3 * x:.1f}</td>" for x in shape.tip)
    missed = f"<tr><td>missed</td><td align=right colspan=3>{_distance(session)}</td></tr>"
    head = "<tr><th align=left>[mm]</th><th>x</th><th>y</th><th>z</th></tr>"
    return f"<table style='width:100%;{_SMALL}'>{head}<tr><td>tip</td>{cells}</tr>{missed}</table>"


def tendons(session: Session) -> str:
    """Return tensions as bars against their limits, strokes beside them."""
    shape = session.shape
    if shape is None:
        return ""
    rows, slack = [], np.ravel(shape.slack)
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


def _said(text: str) -> str:
    return f"<div style='font-size:14px;padding:0.3em 1em'>{text}</div>"


def _place(session: Session) -> str:
    where = "There" if session.is_there else "Not there"
    return f"<b>{where}</b> ({_distance(session)} off)"


def _distance(session: Session) -> str:
    """Return how far the arm is from the target, in mm or degrees."""
    if session.goal.position is None:
        return f"{np.degrees(session.missed):.1f} deg"
    missed = 1e3 * session.missed
    return f"{missed:.0f} mm" if missed >= 10 else f"{missed:.1f} mm"
