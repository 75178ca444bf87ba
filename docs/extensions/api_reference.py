"""Add inherited attributes to the reference pages, and omit members for the planner."""

from __future__ import annotations

from inspect import getdoc, isclass
from typing import Any

from sphinx.application import Sphinx

_HEADING = ["Attributes", "----------"]


def inherit_attributes(
    app: Sphinx, what: str, name: str, shown: Any, options: Any, lines: list[str]
) -> None:
    """Add the attributes of the nearest documented base to a class without such a section."""
    if not isclass(shown) or _HEADING[0] in lines:
        return
    for base in shown.__mro__[1:-1]:
        documentation = (getdoc(base) or "").splitlines()
        if _HEADING[0] in documentation:
            lines += ["", *documentation[documentation.index(_HEADING[0]) :]]
            return


def skip(app: Sphinx, what: str, name: str, shown: Any, skipped: bool, options: Any) -> bool | None:
    """Omit the members of targets that Target documents for all of them."""
    return True if (getdoc(shown) or "").startswith("See Target") else None


def setup(app: Sphinx) -> dict[str, bool]:
    """Run before numpydoc, which reads the sections of a docstring."""
    app.connect("autodoc-process-docstring", inherit_attributes, priority=400)
    app.connect("autodoc-skip-member", skip)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
