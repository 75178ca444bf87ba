"""The drag of a current: small loads against beams, large loads against the elastica."""

from __future__ import annotations

import numpy as np
import pytest

from octoplan.model import Anchorage, Arm, Linear, Material, Scene, settle
from octoplan.model.effects import Current, ExactTendons, Extension, Shear
from octoplan.model.loads import growth_rate
from tests.core.effects.bars import NO_PULL, Bar, elastica
from tests.core.effects.cases import Array

RHO, C = 1000.0, 1.1
STIFF = {"uniform": Bar(E=1e10), "conical": Bar(0.012, 0.003, E=1e10)}
SOFT = {"uniform": Bar(), "conical": Bar(0.012, 0.005)}


def deflection(bar: Bar, v: float) -> float:
    """Return the deflection of the tip under the line load rho C R v2."""
    return bar.deflection(lambda s: RHO * C * bar.R(s) * v**2)


@pytest.mark.parametrize("name", STIFF)
@pytest.mark.parametrize("v", [0.1, 1.0])
def test_a_stiff_bar_across_a_stream_bends_like_a_beam(name: str, v: float) -> None:
    bar = STIFF[name]
    tip = settle(bar.arm, NO_PULL, Scene(Current((0, v, 0))), 1e-12).tip
    assert tip[1] == pytest.approx(deflection(bar, v), rel=1e-6)
    assert abs(tip[2]) < 1e-18
    if name == "uniform":
        w = RHO * C * 0.01 * v**2
        assert tip[1] == pytest.approx(w * 0.3**4 / (8 * bar.EJ(0.0)), rel=1e-6)


def test_density_and_coefficient_scale_the_drag() -> None:
    bar, v = STIFF["conical"], (0, 0, 0.5)
    plain = settle(bar.arm, NO_PULL, Scene(Current(v)), 1e-12).tip[2]
    other = settle(bar.arm, NO_PULL, Scene(Current(v, 1.2, 0.7)), 1e-12).tip[2]
    assert other / plain == pytest.approx(1.2 * 0.7 / (RHO * C), rel=1e-6)


def test_only_the_stream_across_pushes_and_by_its_own_size() -> None:
    bar, v = Bar(0.012, 0.003, E=1e13), np.array([3.0, 0.3, -0.4])
    tip = settle(bar.arm, NO_PULL, Scene(Current(tuple(v))), 1e-12).tip
    across = deflection(bar, 0.5)
    assert np.allclose(tip[1:], across * np.array([0.6, -0.8]), rtol=1e-5, atol=0)


@pytest.mark.parametrize("v", [2.0, -0.5])
@pytest.mark.parametrize("name", SOFT)
def test_a_stream_along_a_straight_arm_does_not_push(name: str, v: float) -> None:
    bar = SOFT[name]
    tip = settle(bar.arm, NO_PULL, Scene(Extension(), Current((v, 0, 0))), 1e-11).tip
    assert np.allclose(tip, [bar.length, 0, 0], rtol=0, atol=1e-15)


def pushed(bar: Bar, v: Array, extension: bool) -> Array:
    """(x, y) at nine places of a bar in the plane of the stream."""

    def drag_at(s: float, t: Array) -> Array:
        across = v - t * (t @ v)
        return RHO * C * bar.R(s) * np.linalg.norm(across) * across

    s = np.linspace(0, bar.length, 9)
    return elastica(bar, lambda s: np.zeros(2), spread=drag_at, extension=extension, shares=8)(s)[
        :2
    ]


STREAMS = {"weak": (0.0, 0.2), "strong": (0.0, 0.6), "outward": (0.3, 0.3), "back": (-0.2, 0.25)}


@pytest.mark.quick("conical-strong-extension", "conical-outward-bending")
@pytest.mark.parametrize("extension", [False, True], ids=["bending", "extension"])
@pytest.mark.parametrize("stream", STREAMS)
@pytest.mark.parametrize("name", SOFT)
def test_a_soft_bar_gives_way_as_the_elastica_does(name: str, stream: str, extension: bool) -> None:
    bar, v = SOFT[name], STREAMS[stream]
    scene = Scene(Current((*v, 0)), *([Extension()] if extension else []))
    shape = settle(bar.arm, NO_PULL, scene, 1e-10)
    found = pushed(bar, np.array(v), extension)
    s = np.linspace(0, bar.length, 9)
    assert found[1, -1] > 0.1 * bar.length
    assert np.allclose(shape.position(s)[:, :2], found.T, rtol=0, atol=2e-10 * bar.length)


@pytest.mark.parametrize(
    "more",
    [
        pytest.param((), id="paper"),
        pytest.param((ExactTendons(), Shear()), id="exact, shear", marks=pytest.mark.slow),
    ],
)
def test_the_moment_at_the_base_is_that_of_all_the_drag(more: tuple[object, ...]) -> None:
    arm, T = Arm.from_paper("table-2"), np.zeros((3, 4))
    v = np.array([0.1, -0.15, 0.3])
    shape = settle(arm, T, Scene(Extension(), Current(tuple(v)), *more), 1e-10)
    x, w = np.polynomial.legendre.leggauss(60)
    s = (1 + x) * arm.length / 2
    u, t, q = shape.position(s), shape.frame(s)[:, :, 0], shape.strain(s)[:, 3]
    across = v - t * (t @ v)[:, None]
    R = 15e-3 + (6.5e-3 - 15e-3) * s / arm.length
    f = (RHO * C * R * (1 + q) * np.linalg.norm(across, axis=1))[:, None] * across
    moment = (w * arm.length / 2) @ np.cross(u, f)
    tau, xi, k, q = shape.strain(0.0)
    stretch = 1 + q if more else 1.0
    EJ = 110e3 * np.pi * 15e-3**4 / 4
    found = stretch * EJ * np.array([tau * 2 / 3, -xi, -k])  # n and b are -y and -z at the base
    assert np.allclose(found, moment, rtol=0, atol=1e-8 * np.linalg.norm(moment))


def test_places_beyond_the_tip_by_rounding_are_no_less_loaded() -> None:
    length, inner = 0.17681184005663822, 0.051505704770953606
    own = tuple(Anchorage(at, Linear(0.003, 0.002), (0.0, 2.0)) for at in (length, inner))
    arm = Arm(length, Linear(0.005, 0.004), own, Material(1e5, 0.5))
    last = np.array([np.nextafter(length, 1.0)])
    assert growth_rate(arm, Scene(Current((0.01, 0.02, 0.0), 1000.0)), last)[0] == 0.0


@pytest.mark.quick("1e-07")
@pytest.mark.parametrize("accuracy", [1e-5, 1e-6, 1e-7, 1e-8])
def test_a_stream_along_the_arm_somewhere_does_not_hide_errors(accuracy: float) -> None:
    """The arm turns into the current in its plane: |v_n| v_n then has a kink in its derivative."""
    tensions = np.zeros((3, 4))
    tensions[0, 2], tensions[1, 0], tensions[2, 2] = 0.32312720, 0.01984517, 4.95974372
    arm, scene = Arm.from_paper("table-4"), Scene(Extension(), Current((0.0, 0.05, 0.0), RHO, C))
    shape, finest = (settle(arm, tensions, scene, each) for each in (accuracy, 1e-11))
    error = np.linalg.norm(shape.tip - finest.tip) / arm.length
    assert error <= shape.error <= accuracy
