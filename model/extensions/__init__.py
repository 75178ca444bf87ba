"""Effects and methods beyond the core; no module of the core imports them."""

from importlib import import_module
from importlib.util import find_spec
from types import ModuleType

# Modules whose names users import from octoplan. Any of them may be left out.
_PUBLIC = ("contact", "cross_sections", "friction", "obstacles", "printed")


def public_extensions() -> list[ModuleType]:
    """Return the modules with public effects and obstacles that are installed."""
    names = [f"{__name__}.{name}" for name in _PUBLIC]
    return [import_module(name) for name in names if find_spec(name)]
