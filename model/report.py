"""Settled shapes and their stiffness as people read them, made of plain numbers."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from model.paths import Array
from model.text import columns, tendon_lines

# Arc length of each anchorage [m] and the names of its tendons, see Arm.tendons_by_section.
BySection = Sequence[tuple[float, Sequence[str]]]


def tendon_table(title: str, by_section: BySection, values: Array) -> str:
    """Return a table of a number for each tendon, a line a section."""
    return "\n".join([title, *tendon_lines(by_section, np.ravel(values).tolist())])


def shape_text(
    tables: Sequence[str], tip: Array, frame: Array, error: float, remarks: Sequence[str] = ()
) -> str:
    """Return tables of the tendons, then where the tip is [m], its frame, the estimated error.

    Last come remarks, a sentence each.
    """
    place = "  ".join(f"{1e3 * x:.4f}" for x in tip)
    rows = "\n".join("  " + " ".join(f"{x:9.5f}" for x in row) for row in frame)
    return "\n\n".join(
        [
            *tables,
            f"tip [mm]  {place}",
            f"tip frame (columns t, n, b)\n{rows}",
            f"estimated tip error [L]  {error:.1e}",
            *(f"beware: {remark}" for remark in remarks),
        ]
    )


def compliance_text(place: str, held: str, C: Array, axes: Array, directions: Array) -> str:
    """Return a compliance against forces as people read it.

    Parameters
    ----------
    place, held : str
        Which point it is, and what holds the tendons, in words.
    C : (3, 3)
        Displacement per force [m/N].
    axes, directions : (3,), (3, 3)
        Its half axes [m/N], largest first, and their directions as columns.
    """
    rows = [["[mm/N]", "force x", "force y", "force z"]]
    rows += [
        [f"  {axis} moves by", *(f"{1e3 * value:.4g}" for value in row)]
        for axis, row in zip("xyz", C, strict=True)
    ]
    names = ["  softest", "  between", "  stiffest"]
    along = [
        [name, f"{1e3 * axis:.4g}", "along [" + ", ".join(f"{x + 0.0:.3f}" for x in way) + "]"]
        for name, axis, way in zip(names, axes, np.round(directions, 3).T, strict=True)
    ]
    table = columns([["principal axes", "[mm/N]"], *along])
    return "\n".join([f"compliance of {place}, {held}", *columns(rows), "", *table])
