"""The arms of the paper, as numbers: length, (R_max, R_min), then (l_i, a_i, b_i) tip to base [m].

Tables 2 and 4 are given in full. The arms of sections 5.1 (finite elements) and 5.2 (prototype) had
one tendon; T_11 to T_14 are the four places it may take. E = 110 kPa and nu = 0.5 throughout, which
is the default material.
"""

from __future__ import annotations

Row = tuple[float, float, float]

PAPER_ARMS: dict[str, tuple[float, tuple[float, float], list[Row]]] = {
    "table-2": (
        0.310,
        (15e-3, 6.5e-3),
        [(0.310, 7.5e-3, 1e-3), (0.217, 3.5e-3, 3.5e-3), (0.093, 6e-3, 6e-3)],
    ),
    "table-4": (
        0.450,
        (15e-3, 2e-3),
        [(0.450, 7.5e-3, 1e-3), (0.315, 3.5e-3, 3.5e-3), (0.135, 6e-3, 6e-3)],
    ),
    "section-5.1": (0.300, (10e-3, 1.5e-3), [(0.300, 0.66e-3, 1e-3)]),
    "section-5.2": (0.270, (15e-3, 7.4e-3), [(0.270, 5e-3, 2.5e-3)]),
}
