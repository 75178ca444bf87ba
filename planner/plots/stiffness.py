"""Compliance ellipsoids on the arm."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure
from mpl_toolkits.mplot3d import Axes3D  # type: ignore[import-untyped]

from model.errors import InputError
from model.paths import Array
from model.stiffness import Stiffness
from planner.plots.arm import draw_arm, look
from planner.plots.style import MM, SIZE, axes_of

_SKIN, _LINE = "#b3123f", "#7a0c2b"


def plot_ellipsoids(
    found: Sequence[Stiffness], force: float = 1e-3, ax: Axes3D | None = None
) -> Figure | Axes3D:
    """Draw where a force of any direction would move points of the arm, on the arm, in mm.

    Parameters
    ----------
    found : sequence of Stiffness
        Of one shape, at the points to be shown.
    force : float
        The force [N]; half axes are its displacements, to scale.

    Returns a new Figure, or the axes if given; raises InputError for none.
    """
    if not found:
        raise InputError("found", (), "at least one Stiffness")
    shown, ax = axes_of(ax, (6.4, 4.8), "3d")
    shape = found[0].shape
    points = [draw_arm(shape, ax)]
    for k in found:
        surface = _surface(k, force)
        ax.plot_surface(*(MM * surface), color=_SKIN, alpha=0.25, linewidth=0)
        points.append(surface.reshape(3, -1).T)
    held = "held tensions" if found[0].hold == "tension" else "locked lengths"
    ax.set_title(f"where {1e3 * force:g} mN push it, with {held}", fontsize=SIZE)
    look(ax, shape, np.vstack(points))
    return shown


def _surface(k: Stiffness, force: float) -> Array:
    """Return the ellipsoid's points (3, 25, 49) [m]."""
    axes, directions = k.ellipsoid()
    down, around = np.linspace(0, np.pi, 25), np.linspace(0, 2 * np.pi, 49)
    polar, turn = np.meshgrid(down, around, indexing="ij")
    ball = np.array([np.sin(polar) * np.cos(turn), np.sin(polar) * np.sin(turn), np.cos(polar)])
    moved = np.einsum("ij,j,jkl->ikl", directions, force * axes, ball)
    return np.asarray(moved + k.shape.position(k.at)[:, None, None])
