"""Draw frames, angles and the numbering of sections: python docs/images/frames.py.

The arm is that of table 4, bent in the plane of t and b by the tendons T_22 and T_32.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib import rcParams
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from octoplan.model import Arm, Scene, Shape, settle
from octoplan.model.effects import Extension

ARM = Arm.from_paper("table-4")
INK, BODY, SHADE = "#222222", "#dfe6ec", "#8d9baa"
FRAME = {"t": "#b3123f", "n": "#1f6fb4", "b": "#2a8c6e"}
SECTION = {1: "#7a4fb5", 2: "#e8912c", 3: "#4d4d4d"}


def arrow(ax: Axes, start: object, end: object, text: str, colour: str, off: float = 1.16) -> None:
    """Draw an arrow with a name at its end."""
    a, b = np.array(start, float), np.array(end, float)
    style = {"arrowstyle": "-|>", "color": colour, "lw": 1.8, "shrinkA": 0, "shrinkB": 0}
    ax.annotate("", b, a, arrowprops=style, zorder=6)
    at = a + off * (b - a)
    ax.text(*at, text, color=colour, fontsize=12, ha="center", va="center", weight="bold", zorder=7)


def draw_side(ax: Axes) -> None:
    """Draw the bent arm in the plane of t (right) and b (up), with anchorages and frames."""
    shape = settle(ARM, [[0] * 4, [0, 0.3, 0, 0], [0, 1.2, 0, 0]], Scene(Extension()))
    s = np.linspace(0, ARM.length, 200)
    u, d = plane(shape, s), across(shape, s)
    R = 1e3 * ARM.radius.evaluate(s, ARM.length)[0][:, None]
    ax.fill(*np.vstack([u + R * d, (u - R * d)[::-1]]).T, color=BODY, ec=SHADE, lw=1, zorder=1)
    ax.plot(*u.T, color=SHADE, lw=1, ls="-.", zorder=2)
    for number, section in enumerate(ARM.sections, 1):
        inside = np.linspace(0, section.at, 100)
        y = 1e3 * section.offset.evaluate(inside, section.at)[0][:, None]
        for side in (1, -1):
            path = plane(shape, inside) + side * y * across(shape, inside)
            ax.plot(*path.T, color=SECTION[number], lw=1.1, zorder=3)
        at, way = plane(shape, section.at), across(shape, section.at)
        r = 1e3 * ARM.radius.evaluate(np.array([section.at]), ARM.length)[0][0]
        ax.plot(*np.array([at - r * way, at + r * way]).T, color=INK, lw=2, zorder=4)
        label = f"section {number}\n$s = l_{number}$" + (" = L" if number == 1 else "")
        place = at - (r + (28 if number > 1 else 40)) * way + np.array([16, -8])
        ax.text(*place, label, color=SECTION[number], fontsize=10, ha="center", va="center")
    ax.plot([0, 0], [-40, 40], color=INK, lw=3)
    for k in np.arange(-36, 40, 9):
        ax.plot([-9, 0], [k - 6, k], color=INK, lw=0.8)
    ax.text(-14, -60, "base, $s = 0$", fontsize=10, ha="left", color=INK)
    arrow(ax, (0, 0), (62, 0), "t", FRAME["t"])
    arrow(ax, (0, 0), (0, 62), "b", FRAME["b"])
    ax.plot(0, 0, "o", ms=11, mfc="white", mec=FRAME["n"], mew=1.6, zorder=7)
    ax.plot(0, 0, "x", ms=6, color=FRAME["n"], mew=1.6, zorder=8)
    ax.text(-11, 14, "n", color=FRAME["n"], fontsize=12, weight="bold", ha="right", zorder=8)
    tip = plane(shape, ARM.length)
    t = shape.frame(ARM.length)[:, 0]
    way = np.array([t[0], -t[2]])
    arrow(ax, tip, tip + 55 * way, "t", FRAME["t"])
    arrow(ax, tip, tip + 55 * across(shape, ARM.length), "b", FRAME["b"])
    ax.set(aspect="equal", xlim=(-40, 450), ylim=(-70, 340))
    ax.set_axis_off()


def plane(shape: Shape, s: object) -> np.ndarray:
    """Return positions (N, 2) in mm along t and b of the base."""
    u = 1e3 * np.asarray(shape.position(s))
    return np.stack([u[..., 0], -u[..., 2]], axis=-1)


def across(shape: Shape, s: object) -> np.ndarray:
    """Return the direction b (N, 2) of the cross-sections."""
    b = np.asarray(shape.frame(s))[..., 2]
    return np.stack([b[..., 0], -b[..., 2]], axis=-1)


def circle(ax: Axes) -> None:
    """Draw a cross-section seen from the tip: t comes out of the page."""
    phi = np.linspace(0, 2 * np.pi, 200)
    ax.fill(np.cos(phi), np.sin(phi), color=BODY, ec=SHADE, lw=1)
    ax.plot(0, 0, "o", ms=10, mfc="white", mec=FRAME["t"], mew=1.6, zorder=7)
    ax.plot(0, 0, "o", ms=3, color=FRAME["t"], zorder=8)
    ax.text(0.15, -0.17, "t", color=FRAME["t"], fontsize=12, weight="bold", ha="center")
    ax.set(xlim=(-1.62, 1.62), ylim=(-1.55, 1.55), aspect="equal")
    ax.set_axis_off()


def arc(ax: Axes, radius: float, start: float, end: float, text: str) -> None:
    """Draw an angle [deg], anticlockwise, with its name."""
    phi = np.radians(np.linspace(start, end, 60))
    x, y = radius * np.cos(phi), radius * np.sin(phi)
    ax.plot(x[:-3], y[:-3], color=INK, lw=1.2, zorder=6)
    style = {"arrowstyle": "-|>", "color": INK, "lw": 1.2, "shrinkA": 0, "shrinkB": 0}
    ax.annotate("", (x[-1], y[-1]), (x[-5], y[-5]), arrowprops=style, zorder=6)
    middle = np.radians((start + end) / 2)
    at = (radius + 0.15) * np.array([np.cos(middle), np.sin(middle)])
    ax.text(*at, text, fontsize=12, color=INK, ha="center", va="center", zorder=9)


def draw_tendons(ax: Axes) -> None:
    """Draw tendons by number, and the angle phi of another one."""
    circle(ax)
    arrow(ax, (0, 0), (1.3, 0), "n", FRAME["n"], 1.09)
    arrow(ax, (0, 0), (0, 1.3), "b", FRAME["b"], 1.09)
    for j, angle in enumerate((0, 90, 180, 270), 1):
        x, y = 0.62 * np.cos(np.radians(angle)), 0.62 * np.sin(np.radians(angle))
        ax.plot(x, y, "o", ms=9, color=SECTION[2], zorder=7)
        away = np.array([0.0, -0.19]) if angle in (0, 180) else np.array([-0.30, -0.08])
        ax.text(*(np.array([x, y]) + away), f"T_i{j}", fontsize=11, ha="center", va="center")
    x, y = 0.62 * np.cos(np.radians(38)), 0.62 * np.sin(np.radians(38))
    ax.plot([0, x], [0, y], color=INK, lw=0.9, ls="--", zorder=4)
    ax.plot(x, y, "o", ms=9, mfc="white", mec=SECTION[2], mew=1.6, zorder=7)
    arc(ax, 0.36, 0, 38, r"$\varphi$")
    ax.annotate("$y_i(s)$", (0.42, 0.33), (-0.98, 1.12), fontsize=11, ha="center",
                arrowprops={"arrowstyle": "-", "color": INK, "lw": 0.6})  # fmt: skip


def draw_plane(ax: Axes) -> None:
    """Draw the angle of a bending plane, from b towards -n."""
    circle(ax)
    arrow(ax, (0, 0), (0, 1.3), "b", FRAME["b"], 1.09)
    way = np.radians(90 + 135)
    arrow(ax, (0, 0), 1.3 * np.array([np.cos(way), np.sin(way)]), "", INK)
    arc(ax, 0.5, 90, 225, r"$\theta$")
    for angle, text in (
        (90, "T_i2:  0°"),
        (180, "T_i3:\n90°"),
        (270, "T_i4:  180°"),
        (0, "T_i1:\n−90°"),
    ):
        at = 1.27 * np.array([np.cos(np.radians(angle)), np.sin(np.radians(angle))])
        if angle == 90:
            at = np.array([0.58, 1.16])
        ax.text(*at, text, fontsize=10, ha="center", va="center", color=INK)
    ax.text(-1.0, -1.16, "bends\nthis way", fontsize=10, ha="center", va="center", color=INK)


def main() -> None:
    """Write frames.svg beside this file."""
    # Letters as paths, so that every browser draws them as wide.
    rcParams["svg.fonttype"], rcParams["svg.hashsalt"] = "path", "frames"
    figure = Figure(figsize=(10.4, 3.6), layout="constrained")
    axes = figure.subplots(1, 3, width_ratios=(1.45, 1.05, 1.05))
    titles = (
        "a  Arm in the plane of t and b",
        "b  Tendons, seen from the tip",
        "c  Bending plane",
    )
    for ax, draw, title in zip(axes, (draw_side, draw_tendons, draw_plane), titles, strict=True):
        draw(ax)
        ax.set_title(title, fontsize=11, loc="left", color=INK)
    figure.savefig(Path(__file__).with_suffix(".svg"), metadata={"Date": None})


if __name__ == "__main__":
    main()
