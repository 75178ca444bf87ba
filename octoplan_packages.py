"""Whether Python finds this project's packages, or files of a user's with the same names.

A script's own folder comes first on Python's path, so that a `model.py` there hides the package
`model`. This module has a name that nothing hides.
"""

from __future__ import annotations

import sys
import warnings
from importlib.util import find_spec
from pathlib import Path

_ROOT = Path(__file__).resolve().parent


def check_own(*names: str) -> None:
    """Raise ImportError, naming the file, where something else is found by a package's name."""
    for name in names:
        other = hiding(name)
        if other:
            raise ImportError(hidden(name, other), name=name, path=other)


def warn_of_hidden(name: str) -> None:
    """Warn, naming the file, where something else is found by a package's name."""
    other = hiding(name)
    if other:
        warnings.warn(hidden(name, other), RuntimeWarning, stacklevel=3)


def hidden(name: str, other: str) -> str:
    """Return the sentence that says which file hides a package."""
    return (
        f"{other} hides octoplan's package `{name}`, because Python finds it first: "
        "rename it, or move it out of that folder"
    )


def hiding(name: str) -> str:
    """Return the file that hides a package of this project; empty where none does."""
    loaded = sys.modules.get(name)
    try:
        spec = find_spec(name) if loaded is None else loaded.__spec__
    except ValueError:  # a module that was made by hand, and has no spec
        spec = None
    origin = getattr(loaded, "__file__", None) if spec is None else spec.origin
    if not origin or Path(origin).resolve().parent == _ROOT / name:
        return ""
    return str(origin)
