"""Figure of compliances: ellipsoids of the displacements that a force causes."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.colors import LightSource
from matplotlib.figure import Figure
from mpl_toolkits.mplot3d import Axes3D  # type: ignore[import-untyped]

from octoplan.model.paths import Array
from octoplan.model.shape import Shape
from octoplan.model.stiffness import Stiffness
from octoplan.model.support.checks import positive
from octoplan.planner.frontends.plots.arm import draw_arm
from octoplan.planner.frontends.plots.plan import alone, finish
from octoplan.planner.frontends.plots.style import MM, SIZE, add_legend, make_axes, several

# Colours of ellipsoids that tensions and bodies do not have.
_COLOURS = ("#1f6fb4", "#2a8c6e", "#6a3d9a", "#8a6d3b", "#d1495b", "#30343a")
_LIGHT = LightSource(azdeg=218, altdeg=55)
# Largest half axis over the arm length, for the default force.
_LONGEST = 0.2
# Largest half axis over the arm length below which an ellipsoid is magnified.
_SHORTEST = 0.02


def plot_ellipsoids(
    result: Sequence[Stiffness], force: float | None = None, ax: Axes3D | None = None
) -> Figure | Axes3D:
    """Draw the compliance ellipsoids of points of arms: displacements by a force.

    The legend has the half axes of each ellipsoid [mm]. Ellipsoids are to scale; those below 2 % of
    the length are magnified by a power of ten, which the legend has as well.

    Parameters
    ----------
    result : sequence of Stiffness
        Stiffnesses at the points to be drawn, of one or several shapes.
    force : float
        Magnitude of the force [N]. The default is the largest of 1, 2 or 5 times a power of ten for
        which no displacement exceeds a fifth of the length.

    Returns a new Figure, or the given 3-D axes; raises InputError for an empty sequence, a force
    that is not positive, and for other axes.
    """
    result = several("result", result, Stiffness)
    force = visible_force(result) if force is None else positive("force", force)
    shown: Any
    panel: Any
    shown, panel = alone() if ax is None else make_axes(ax, form="3d")
    panel.computed_zorder = False
    points = [
        _draw(panel, k, force, _COLOURS[i % len(_COLOURS)]).reshape(3, -1).T
        for i, k in enumerate(result)
    ]
    shapes = _distinct([k.shape for k in result])
    points += [draw_arm(shape, panel) for shape in shapes]
    title = f"displacements by {_force_text(force)} in any direction"
    if shown is panel:
        panel.set_title(title, fontsize=SIZE)
        add_legend(panel)
    else:
        finish(panel, shapes[0], np.vstack(points), title=title)
    return shown


def visible_force(result: Sequence[Stiffness]) -> float:
    """Return the default force of plot_ellipsoids [N]."""
    most = min(_LONGEST * k.shape.arm.length / float(k.ellipsoid()[0][0]) for k in result)
    power = 10.0 ** math.floor(math.log10(most))
    return max(factor * power for factor in (1.0, 2.0, 5.0) if factor * power <= most)


def _draw(ax: Any, k: Stiffness, force: float, colour: str) -> Array:
    """Draw an ellipsoid with three principal ellipses; return points (3, 25, 49) [m].

    Small ellipsoids are magnified; the label has the factor.
    """
    axes, directions = k.ellipsoid()
    displacements = force * axes
    factor = magnification(float(displacements[0]) / k.shape.arm.length)
    half = factor * displacements * directions
    center = k.shape.position(k.at)
    surface = np.einsum("ij,jkl->ikl", half, _ball()) + center[:, None, None]
    ax.plot_surface(
        *(MM * surface),
        rstride=1,
        cstride=1,
        color=colour,
        lightsource=_LIGHT,
        alpha=0.25,
        lw=0,
        rasterized=True,
        zorder=6,
    )
    held = "constant tensions" if k.hold == "tension" else "constant lengths"
    place = "tip" if k.at == k.shape.arm.length else f"s = {MM * k.at:.4g} mm"
    lengths = ", ".join(f"{MM * each:.3g}" for each in displacements)
    drawn = f" (drawn {factor:g} times as large)" if factor > 1 else ""
    label = f"{place}, {held}: half axes {lengths} mm{drawn}"
    angles = np.linspace(0.0, 2 * np.pi, 73)
    for i, j in ((0, 1), (0, 2), (1, 2)):
        ring = np.outer(half[:, i], np.cos(angles)) + np.outer(half[:, j], np.sin(angles))
        points = MM * (center[:, None] + ring)
        ax.plot(*points, color=colour, lw=0.9, label=label if i + j == 1 else None, zorder=7)
    return np.asarray(surface)


def magnification(share: float) -> float:
    """Return the power of ten by which a half axis of `share` times the arm length is magnified."""
    power = math.ceil(math.log10(_SHORTEST / max(share, 1e-12)))
    return float(10 ** max(power, 0))


def _distinct(shapes: list[Shape]) -> list[Shape]:
    """Return the shapes without those of equal arm, scene and tensions."""
    kept = dict[Any, Shape]()
    for shape in shapes:
        kept.setdefault((shape.arm, shape.scene, tuple(shape.tensions.tolist())), shape)
    return list(kept.values())


def _ball() -> Array:
    """Return points (3, 25, 49) of the unit sphere."""
    down = np.linspace(0, np.pi, 25)
    around = np.linspace(0, 2 * np.pi, 49)
    polar, turn = np.meshgrid(down, around, indexing="ij")
    return np.array([np.sin(polar) * np.cos(turn), np.sin(polar) * np.sin(turn), np.cos(polar)])


def _force_text(force: float) -> str:
    return f"{force:g} N" if force >= 1 else f"{1e3 * force:g} mN"
