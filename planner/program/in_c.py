"""What the C of programs shares: functions of CasADi by pointers."""

from __future__ import annotations

import ctypes
from typing import Any

from model.paths import Array

# What the C of a program finds.
FOUND = ("f", "g", "gradient", "jacobian", "hessian", "more", "off")


class Function(ctypes.Structure):
    """A function that CasADi evaluates: what runs it, and the numbers it is given and finds."""

    _fields_ = tuple((name, ctypes.c_void_p) for name in ("run", "given", "found"))

    @classmethod
    def of(cls, run: Any, given: Any, found: Any) -> Function:
        """Return a prepared function, see Buffered.prepared, with `pointers` to its numbers."""
        return cls(id(run), ctypes.addressof(given), ctypes.addressof(found))


def pointers(values: list[Array]) -> Any:
    """Return where arrays begin."""
    return (ctypes.c_void_p * len(values))(*(own.ctypes.data for own in values))
