"""The arms of the paper."""

from __future__ import annotations

from model.arm import Arm, conical
from model.errors import InputError

_MM = 1e-3


def preset(name: str) -> Arm:
    """Return an arm of the paper by name; see Arm.from_paper.

    Tables 2 and 4 are given in full. The arms of sections 5.1 (finite elements) and 5.2 (prototype)
    had one tendon; T_11 to T_14 are the four places it may take. E = 110 kPa, nu = 0.5 throughout.
    """
    builders = {
        "table-2": lambda: _three_sections(0.310, 6.5 * _MM, 0.217, 0.093),
        "table-4": lambda: _three_sections(0.450, 2.0 * _MM, 0.315, 0.135),
        "section-5.1": lambda: conical(0.3, (10 * _MM, 1.5 * _MM), [(0.3, 0.66 * _MM, 1 * _MM)]),
        "section-5.2": lambda: conical(0.27, (15 * _MM, 7.4 * _MM), [(0.27, 5 * _MM, 2.5 * _MM)]),
    }
    if not isinstance(name, str) or name not in builders:
        raise InputError("arm", name, ", ".join(builders))
    return builders[name]()


def _three_sections(length: float, tip_radius: float, l2: float, l3: float) -> Arm:
    return conical(
        length,
        (15 * _MM, tip_radius),
        [(length, 7.5 * _MM, 1 * _MM), (l2, 3.5 * _MM, 3.5 * _MM), (l3, 6 * _MM, 6 * _MM)],
    )
