"""Numbers of files that are allowed but likely slips: told with the number likely meant.

A fraction of pi under a key in degrees, a density in g/cm3; what is softer than any elastomer is
refused, as no shape of such an arm under tendons settles.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from typing import Any

from model.errors import FileError
from model.units import UnitWarning, warn
from planner.io.key_paths import steps, value_at

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
        text = f"got {E_kPa:g}, softer than any elastomer; allowed is {_SOFTEST:g} kPa or more"
        raise FileError(name, "arm.E_kPa", f"{text}: {meant}")


def warn_of_slips(raw: dict[str, Any]) -> None:
    """Warn of likely slips in what a scene file holds, with UnitWarning."""
    held = [(path, value_at(raw, steps(path))) for path in _FLUIDS]
    for path, value in [*held, *_angles("", raw)]:
        warn_of_slip(path, value)


def _angles(path: str, value: Any) -> Iterator[tuple[str, Any]]:
    """Yield path and value of the keys in degrees, down to those in tables."""
    if isinstance(value, dict):
        for key, inside in value.items():
            if key.endswith("_deg"):
                yield f"{path}{key}", inside
            else:
                yield from _angles(f"{path}{key}.", inside)
    elif isinstance(value, list):
        for i, inside in enumerate(value):
            yield from _angles(f"{path.removesuffix('.')}[{i}].", inside)


def warn_of_slip(path: str, value: Any) -> None:
    """Warn of a value, or of several, at a key path, that are likely slips; with UnitWarning."""
    held = value if isinstance(value, list) else [value]
    numbers = [item for item in held if isinstance(item, int | float)]
    if not numbers:
        return
    if path in _FLUIDS and all(_WATER[0] <= item <= _WATER[1] for item in numbers):
        text = f"{path} is {_listed(numbers)} kg/m3, a thousandth of that of water"
        meant = f"if g/cm3 were meant, give {_listed([1e3 * item for item in numbers])} (kg/m3)"
        warn(f"{text}; {meant}", UnitWarning)
    key = next(item for item in reversed(steps(path)) if isinstance(item, str))
    small = all(abs(item) < 7 for item in numbers)
    if key.endswith("_deg") and small and any(map(_is_fraction_of_pi, numbers)):
        several = " of which some are fractions" if isinstance(value, list) else " a fraction"
        text = f"a key in degrees holds {_listed(numbers)},{several} of pi ({path})"
        meant = f"if radians were meant, give {_listed(map(_degrees, numbers))} (degrees)"
        warn(f"{text}; {meant}", UnitWarning)


def _listed(numbers: Iterable[float]) -> str:
    return ", ".join(f"{item:g}" for item in numbers)


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
