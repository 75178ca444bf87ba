"""An arm has to be clear of all obstacles at rest."""

from __future__ import annotations

import numpy as np

from model.contact.passing import gaps_along
from model.contact.places import SAME
from model.errors import InputError
from model.loads import contacts
from model.paths import Array
from model.transcription.system import System


def check_outside(system: System, states: Array) -> None:
    """Raise InputError where the arm at rest, with states (n_states,), is inside of an obstacle."""
    s, gap = gaps_along(system, states)
    inside = np.flatnonzero(gap.min(axis=0) < -SAME * system.arm.length)
    if inside.size:
        own = [contact.obstacle for contact in contacts(system.scene)]
        deepest = zip(inside, gap[:, inside].argmin(axis=0), strict=True)
        told = [
            f"{-1e3 * gap[k, j]:.3g} mm inside{f' of {own[j]}' if j > inside[0] else ''}"
            f" at s = {s[k]:.4g} m"
            for j, k in deepest
        ]
        allowed = f"one that the arm at rest is clear of; it is {', and '.join(told)}"
        raise InputError("Contact.obstacle", own[inside[0]], allowed)
