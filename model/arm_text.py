"""An arm as people read it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from model.paths import Path
from model.text import columns, shortened_lines


def arm_text(
    length: float,
    radius: Path,
    material: str,
    sections: Sequence[tuple[float, Sequence[Path], Sequence[float]]],
) -> str:
    """Return a table of an arm, a line an anchorage section.

    Parameters
    ----------
    length : float
        [m].
    radius : Path
        Of the body.
    material : str
        In words.
    sections : sequence of (at, offsets, angles)
        Arc length [m], distances of the tendons from the midline, their angles [rad]; tip first.
    """
    cells = [["  section", "at [mm]", "offset [mm]"]]
    angles = ["tendons at [deg]"]
    for i, (at, offsets, own) in enumerate(sections):
        ends = ", ".join(_ends(offset, at) for offset in offsets)
        cells.append([f"  {i + 1}", f"{1e3 * at:g}", ends])
        angles.append(" ".join(f"{angle:.4g}" for angle in np.degrees(own)))
    rows = [f"{line}   {told}" for line, told in zip(columns(cells), angles, strict=True)]
    tendons = sum(len(own) for _, _, own in sections)
    head = f"Arm of {1e3 * length:g} mm, radius {_ends(radius, length)} mm, {tendons} tendons"
    return "\n".join([f"{head}; {material}", *shortened_lines(rows)])


def _ends(path: Path, span: float) -> str:
    """Return a function of arc length by its values at base and end [mm]."""
    base, end = 1e3 * path.evaluate(np.array([0.0, span]), span)[0]
    return f"{base:.4g}" if base == end else f"{base:.4g} to {end:.4g}"
