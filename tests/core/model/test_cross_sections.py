"""Tubes, rectangles and given stiffness, against closed forms, series and shooting in SciPy."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from scipy.integrate import quad, solve_ivp
from scipy.optimize import brentq, root

from octoplan import (
    Anchorage,
    Arm,
    Extension,
    Friction,
    InputError,
    Linear,
    Material,
    PiecewiseLinear,
    Rectangle,
    Scene,
    SectionStiffness,
    Shear,
    TipLoad,
    TipPosition,
    Tube,
    Weight,
    plan,
    settle,
)
from octoplan.model.extensions.cross_sections import torsion_constant
from octoplan.planner.frontends.bodies.files import save_mesh
from octoplan.planner.frontends.io.scene_file import read

L, E, NU, RHO = 0.3, 3e6, 0.4, 1200.0
G = E / (2 * (1 + NU))
NO_PULL = [0.0]


def body(cross_section: Any, radius: Any = None, offset: float = 0.0) -> Arm:
    """An arm with a tendon; the default radius is the circle around a rectangle."""
    return Arm(
        L,
        radius or cross_section.circumscribed(),
        (Anchorage(L, Linear(offset, offset), (0.0,)),),
        Material(E, NU, RHO),
        cross_section=cross_section,
    )


def arc(curvature: float) -> Any:
    """Distances along and across of the end of an arc of length L."""
    angle = curvature * L
    return np.sin(angle) / curvature, (1 - np.cos(angle)) / curvature


def double_series(a: float, b: float) -> float:
    """The torsion constant of a rectangle by Fourier's series in both directions."""
    n = np.arange(1, 2000, 2.0)
    m = n[:, None]
    terms = 1 / (m**2 * n**2 * (m**2 * b**2 + n**2 * a**2))
    return float(256 * a**3 * b**3 / np.pi**6 * terms.sum())


def test_tube_without_lumen_is_the_circle() -> None:
    arm = Arm.from_paper("table-2")
    tube = replace(arm, cross_section=Tube(Linear(0.0, 0.0)))
    tensions = np.linspace(0.0, 0.3, 12)
    for scene in (Scene(Extension()), Scene.silicone(Weight(), Shear(), Friction(0.1))):
        shapes = [settle(each, tensions, scene, 1e-7) for each in (arm, tube)]
        assert np.array_equal(shapes[0].states, shapes[1].states)


@pytest.mark.parametrize("inner", [0.004, 0.009])
def test_tube_bends_and_twists_by_its_closed_form(inner: float) -> None:
    R, moment = 0.01, 8e-3
    J = np.pi * (R**4 - inner**4) / 4
    arm = body(Tube(Linear(inner, inner)), Linear(R, R))
    along, across = arc(moment / (E * J))
    bent = settle(arm, NO_PULL, Scene(TipLoad(moment=(0.0, 0.0, -moment))), 1e-10)
    assert np.abs(bent.tip - [along, -across, 0]).max() < 1e-9 * L
    twisted = settle(arm, NO_PULL, Scene(TipLoad(moment=(moment, 0.0, 0.0))), 1e-10)
    assert twisted.strain(L / 2)[0] == pytest.approx(moment / (2 * G * J), rel=1e-9)


def test_tapered_tube_weighs_as_its_wall() -> None:
    arm = body(Tube(Linear(0.006, 0.002)), Linear(0.01, 0.005))

    def area(s: float) -> float:
        R, r = 0.01 - 0.005 * s / L, 0.006 - 0.004 * s / L
        return float(np.pi * (R**2 - r**2))

    # The arm hangs along gravity, and stretches by its own weight.
    g = (9.81, 0.0, 0.0)
    hanging = settle(arm, NO_PULL, Scene(Extension(), Weight(g)), 1e-10)
    stretch = quad(lambda s: quad(area, s, L)[0] * RHO * 9.81 / (E * area(s)), 0, L)[0]
    assert hanging.tip[0] - L == pytest.approx(stretch, rel=1e-7)


def test_rubber_tube_shortens_by_its_own_area() -> None:
    R, r, T = 0.01, 0.007, 40.0
    arm = replace(
        body(Tube(Linear(r, r)), Linear(R, R)),
        sections=(Anchorage(L, Linear(0.008, 0.008)),),
        material=Material(E, 0.5),
    )
    shape = settle(arm, [T / 4] * 4, Scene.silicone(), 1e-9)
    EA = E * np.pi * (R**2 - r**2)
    stretch = brentq(lambda x: EA / 3 * (x - 1 / x**2) + T, 0.5, 1.0, xtol=1e-14)
    assert shape.tip[0] == pytest.approx(stretch * L, rel=1e-8)


@pytest.mark.parametrize(
    ("ratio", "printed"),
    [(1.0, 0.1406), (1.5, 0.196), (2.0, 0.229), (4.0, 0.281), (10.0, 0.312)],
)
def test_torsion_constant_is_that_of_the_tables(ratio: float, printed: float) -> None:
    """Timoshenko and Goodier, Theory of Elasticity, section 109, table 8."""
    b = 0.004
    sides = np.array([[ratio * b], [0.3]]), np.array([[b], [-0.2]])
    value, rate = (torsion_constant(*sides)[:, 0]).tolist()
    swapped = torsion_constant(*sides[::-1])[:, 0]
    assert value / (ratio * b**4) == pytest.approx(printed, abs=6e-4)
    assert value == pytest.approx(double_series(ratio * b, b), rel=1e-7)
    assert np.allclose(swapped, [value, rate], rtol=1e-9)
    h = 1e-7
    ends = [double_series(ratio * b + 0.3 * x, b - 0.2 * x) for x in (-h, h)]
    assert rate == pytest.approx((ends[1] - ends[0]) / (2 * h), rel=1e-5)


def test_rectangle_bends_in_both_planes_and_twists() -> None:
    w, h, moment = 0.016, 0.006, 5e-3
    arm = body(Rectangle(Linear(w, w), Linear(h, h)))
    J_n, J_b = w * h**3 / 12, h * w**3 / 12
    # n and b of the base are -y and -z.
    along, across = arc(moment / (E * J_b))
    about_b = settle(arm, NO_PULL, Scene(TipLoad(moment=(0.0, 0.0, -moment))), 1e-10)
    assert np.abs(about_b.tip - [along, -across, 0]).max() < 1e-9 * L
    along, across = arc(moment / (E * J_n))
    about_n = settle(arm, NO_PULL, Scene(TipLoad(moment=(0.0, -moment, 0.0))), 1e-10)
    assert np.abs(about_n.tip - [along, 0, across]).max() < 1e-9 * L
    for force, J in (((0, 1e-5, 0), J_b), ((0, 0, 1e-5), J_n)):
        tip = settle(arm, NO_PULL, Scene(TipLoad(force)), 1e-11).tip
        assert np.abs(tip[1:]).max() == pytest.approx(1e-5 * L**3 / (3 * E * J), rel=1e-4)
    twisted = settle(arm, NO_PULL, Scene(TipLoad(moment=(moment, 0.0, 0.0))), 1e-10)
    assert twisted.strain(L / 2)[0] == pytest.approx(moment / (G * double_series(w, h)), rel=1e-6)


def test_loaded_tapered_rectangle_agrees_with_shooting(deviation: Callable[..., float]) -> None:
    force, moment = np.array([0.02, 0.06, 0.03]), np.array([3e-3, -4e-3, 2e-3])
    width, ratio = (0.02, 0.012), 0.6
    shape_factor = double_series(1.0, ratio)
    arm = body(Rectangle(Linear(*width), Linear(*(ratio * w for w in width))))

    def run(begin: Any, share: float) -> Any:
        def rates(s: float, y: Any) -> Any:
            w = width[0] + (width[1] - width[0]) * s / L
            h = ratio * w
            R, M, F = y[:9].reshape(3, 3), y[12:15], y[15:]
            K = np.array([G * shape_factor * w**4, E * w * h**3 / 12, E * h * w**3 / 12])
            a, b, c = R.T @ M / K
            turn = R @ np.array([[0, -c, b], [c, 0, -a], [-b, a, 0]])
            weight = share * RHO * 9.81 * w * h * np.array([0, 0, 1.0])
            return np.concatenate([turn.ravel(), R[:, 0], -np.cross(R[:, 0], F), weight])

        state = np.concatenate([np.ravel(arm.base_frame), np.zeros(3), begin])
        return solve_ivp(rates, (0, L), state, "DOP853", rtol=1e-11, atol=1e-13).y[:, -1]

    begin = np.zeros(6)
    for share in (0.5, 1.0):
        wanted = share * np.append(moment, force)
        found = root(lambda x, g=share, w=wanted: 1e3 * (run(x, g)[12:] - w), begin, tol=1e-12)
        begin = found.x
    end = run(begin, 1.0)
    scene = Scene(Weight(), TipLoad(tuple(force), tuple(moment)))
    shape = settle(arm, NO_PULL, scene, 1e-10)
    assert np.linalg.norm(end[9:12] - [L, 0, 0]) > 0.05 * L
    assert deviation(shape.tip, end[9:12], L) < 1e-9


@pytest.mark.parametrize(("angle", "axis"), [(0.0, 2), (np.pi / 2, 1)])
def test_tendon_on_a_rectangle_bends_it_by_its_own_axis(angle: float, axis: int) -> None:
    w, h, y, T = 0.016, 0.01, 0.004, 6.0
    arm = body(Rectangle(Linear(w, w), Linear(h, h)))
    arm = replace(arm, sections=(Anchorage(L, Linear(y, y), (angle,)),))
    J = h * w**3 / 12 if axis == 2 else w * h**3 / 12
    strain = settle(arm, [T], Scene(), 1e-9).strain(L / 2)
    # Eq. (8) with the reference tangent.
    assert abs(strain[axis]) == pytest.approx(T * y / (E * J + T * y**2), rel=1e-9)


def test_given_stiffness_of_the_circle_is_the_circle() -> None:
    R = 0.01
    A, J = np.pi * R**2, np.pi * R**4 / 4
    same = [Linear(x, x) for x in (E * A, E * J, E * J, 2 * G * J)]
    arm = body(SectionStiffness(*same), Linear(R, R), 0.005)
    load = TipLoad((0.0, 0.01, -0.02), (1e-3, 0.0, 0.0))
    scene = Scene(Extension(), Weight(), load, Friction(0.2))
    tips = [settle(a, [3.0], scene, 1e-8).tip for a in (arm, replace(arm, cross_section=None))]
    assert np.abs(tips[0] - tips[1]).max() < 1e-12


def test_plan_files_and_mesh_of_a_strip(tmp_path: Path) -> None:
    text = b"""
    [arm]
    length_mm = 300
    E_kPa = 3000
    radius_mm = [12, 12]
    cross_section = { type = "rectangle", width_mm = [16, 12], height_mm = [10, 8] }
    sections = [{ at_mm = 300, offset_mm = [4, 4], angles_deg = [0, 90, 180, 270] }]
    [effects]
    weight = {}
    """
    arm = read(text).arm
    assert arm.cross_section == Rectangle(Linear(0.016, 0.012), Linear(0.01, 0.008))
    scene = Scene(Extension(), Weight())
    shape = settle(arm, [1.0, 0.0, 0.0, 3.0], scene)
    result = plan(arm, TipPosition(tuple(shape.tip)), scene, tension_max=20.0)
    assert result.certificate.passed
    rest = settle(arm, [0.0] * 4, Scene())
    mesh = trimesh.load(save_mesh(rest, tmp_path / "strip.stl"))
    # A prismatoid between two rectangles.
    volume = L / 6 * (16 * 10 + 4 * 14 * 9 + 12 * 8) * 1e-6
    assert mesh.volume == pytest.approx(volume, rel=1e-3)


def test_impossible_cross_sections_are_refused() -> None:
    with pytest.raises(InputError, match=r"Tube\.inner = 0\.011: must be below the arm's radius"):
        body(Tube(Linear(0.011, 0.001)), Linear(0.01, 0.01))
    with pytest.raises(InputError, match=r"Rectangle\.height = 0\.006: must be at least twice"):
        strip = Rectangle(Linear(0.02, 0.02), Linear(0.006, 0.006))
        replace(body(strip), sections=(Anchorage(L, Linear(0.004, 0.004), (np.pi / 2,)),))
    with pytest.raises(InputError, match=r"Arm\.radius = 0\.005: must be at least half the diag"):
        body(Rectangle(Linear(0.02, 0.02), Linear(0.006, 0.006)), Linear(0.005, 0.005))
    with pytest.raises(InputError, match=r"SectionStiffness\.GI = 0\.0: must be above 0"):
        body(SectionStiffness(*[Linear(1.0, 1.0)] * 3, Linear(1.0, 0.0)), Linear(0.01, 0.01))
    with pytest.raises(InputError, match=r"Tube\.inner\.s = "):
        body(Tube(PiecewiseLinear((0.0, 0.1), (1e-3, 1e-3))), Linear(0.01, 0.01))
    strip = body(Rectangle(Linear(0.02, 0.02), Linear(0.006, 0.006)))
    for scene in (Scene.silicone(), Scene.as_printed()):
        with pytest.raises(InputError, match=r"Arm\.cross_section = Rectangle"):
            settle(strip, NO_PULL, scene)
    given = body(SectionStiffness(*[Linear(1.0, 1.0)] * 4), Linear(0.01, 0.01))
    with pytest.raises(InputError, match=r"Arm\.cross_section = SectionStiffness"):
        settle(given, NO_PULL, Scene(Shear()))
