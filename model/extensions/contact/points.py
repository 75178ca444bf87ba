"""The contact points of a shape, and the remark about its load steps."""

from __future__ import annotations

from octoplan.model.equilibrium.linearised import Equilibrium
from octoplan.model.extensions.contact.effects import contacts
from octoplan.model.extensions.contact.path import ContactEquilibrium
from octoplan.model.extensions.contact.touches import ContactPoint, equilibrium_contacts
from octoplan.model.shape import Shape


def contact_points(shape: Shape) -> tuple[ContactPoint, ...]:
    """Return the contact points of a shape from base to tip."""
    point = shape.equilibrium
    if isinstance(point, Equilibrium) and contacts(shape.scene):
        before = point.before if isinstance(point, ContactEquilibrium) else None
        return equilibrium_contacts(point, before)
    return shape.self_contacts


def step_remark(shape: Shape) -> str:
    """Return a remark about load steps if contacts with friction hold the arm, otherwise ""."""
    point = shape.equilibrium
    if not isinstance(point, ContactEquilibrium) or point.before is None or not shape.contacts:
        return ""
    return (
        "friction of contacts acts against load steps: more of them may move the tip by some "
        "thousandths of the length, which is no part of its error; settle shapes in between, "
        "each near the one before"
    )
