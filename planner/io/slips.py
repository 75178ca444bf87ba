"""Numbers of files that are allowed but likely slips: told with the number likely meant.

A fraction of pi under a key in degrees, a density in g/cm3; what is softer than any elastomer is
refused, as no shape of such an arm under tendons settles.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Iterator
from functools import cache
from typing import Any, get_type_hints

from model.errors import FileError
from model.units import UnitWarning
from planner.io.codec import Table, unit_of_type

# Of fractions of pi that people round to 3.14, over pi / 12.
_ROUNDED = 7e-3
# Young's modulus of the softest gels [kPa]; about the density of water in g/cm3.
_SOFTEST, _WATER = 0.3, (0.9, 1.1)
_FLUIDS = ("effects.buoyancy.density", "effects.current.density")


def check_modulus(E_kPa: float, name: str) -> None:
    """Raise FileError for Young's modulus of an arm in MPa or GPa in place of kPa."""
    if E_kPa < _SOFTEST:
        unit, factor = ("megapascals", 1e3) if 1e3 * E_kPa >= _SOFTEST else ("gigapascals", 1e6)
        meant = f"give {factor * E_kPa:g} if {unit} were meant (kPa)"
        told = f"got {E_kPa:g}, softer than any elastomer; allowed is {_SOFTEST:g} kPa or more"
        raise FileError(name, "arm.E_kPa", f"{told}: {meant}")


def warn_of_slips(table: Table) -> None:
    """Warn of likely slips in a table, with UnitWarning."""
    for path, unit, value in _quantities(table, ""):
        if unit == "deg":
            _warn_of_radians(path, value)
        elif path in _FLUIDS and _WATER[0] <= value <= _WATER[1]:
            told = f"{path} is {value:g} kg/m3, a thousandth of that of water"
            meant = f"if g/cm3 were meant, give {1e3 * value:g} (kg/m3)"
            warnings.warn(f"{told}; {meant}", UnitWarning, stacklevel=2)


def _quantities(table: Table, path: str) -> Iterator[tuple[str, str, Any]]:
    """Yield the paths of a table's keys that have a unit, with unit and value."""
    for key, unit in _units(type(table)):
        value, here = getattr(table, key), f"{path}.{key}" if path else key
        several = value if isinstance(value, tuple | list) else (value,)
        inside = [(i, own) for i, own in enumerate(several) if isinstance(own, Table)]
        for i, own in inside:
            yield from _quantities(own, here if own is value else f"{here}[{i}]")
        if unit and value is not None and not inside:
            yield here, unit, value


@cache
def _units(kind: type[Table]) -> tuple[tuple[str, str], ...]:
    """Return the keys of a table, each with its unit, empty without one."""
    hints = get_type_hints(kind, include_extras=True)
    return tuple((key, unit_of_type(hints[key])) for key in kind.__struct_fields__)


def _warn_of_radians(path: str, value: Any) -> None:
    """Warn of a key in degrees that holds a fraction of pi, or of which a list holds one."""
    if isinstance(value, int | float):
        if _is_fraction_of_pi(value):
            told = f"a key in degrees holds {value:g}, a fraction of pi ({path})"
            meant = f"if radians were meant, give {_degrees(value):g} (degrees)"
            warnings.warn(f"{told}; {meant}", UnitWarning, stacklevel=2)
        return
    numbers = [own for own in value if isinstance(own, int | float)]
    for own in value:
        if isinstance(own, list | tuple):
            _warn_of_radians(path, own)
    if any(map(_is_fraction_of_pi, numbers)) and all(abs(own) < 7 for own in numbers):
        told = f"a key in degrees holds {', '.join(f'{own:g}' for own in numbers)}"
        meant = ", ".join(f"{_degrees(own):g}" for own in numbers)
        told = f"{told}, of which some are fractions of pi ({path})"
        meant = f"if radians were meant, give {meant} (degrees)"
        warnings.warn(f"{told}; {meant}", UnitWarning, stacklevel=2)


def _is_fraction_of_pi(degrees: float) -> bool:
    """Return whether a number is a multiple of pi / 12, rounded, and no plain half degree."""
    if not abs(degrees) < 7:
        return False
    twelfths = degrees / (math.pi / 12)
    near = abs(twelfths) > 0.5 and abs(twelfths - round(twelfths)) < _ROUNDED
    return near and abs(2 * degrees - round(2 * degrees)) > 1e-9


def _degrees(radians: float) -> float:
    """Return an angle in degrees: a multiple of 15 where it is about one."""
    twelfths = radians / (math.pi / 12)
    near = abs(twelfths - round(twelfths)) < _ROUNDED
    return 15.0 * round(twelfths) if near else math.degrees(radians)
