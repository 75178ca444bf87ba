"""What a settled shape tells of itself that no arm does, and when `settle` warns of it."""

from __future__ import annotations

import warnings

import numpy as np
import pytest

from model import Arm, Material, Scene, ShapeWarning, conical, settle
from model.effects import Extension, TipLoad

ARM = Arm.from_paper("table-2")
FETCH = np.zeros((3, 4))
FETCH[0, 2], FETCH[1, 0], FETCH[2, 1] = 0.5, 4.0, 13.0


def pulled(tension: float) -> np.ndarray:
    """Return tensions with one tendon that ends at the tip pulled [N]."""
    T = np.zeros(ARM.n_tendons)
    T[0] = tension
    return T


@pytest.mark.filterwarnings("default::model.errors.ShapeWarning")
def test_a_hundred_newtons_on_one_tendon_are_told_with_numbers() -> None:
    with pytest.warns(ShapeWarning, match="bends sharper than its own radius") as seen:
        shape = settle(ARM, pulled(100.0), Scene())
    assert seen[0].filename == __file__
    sharp, crosses = shape.remarks
    # k = T y / (E J + T y^2), where it is largest against the radius: at the tip.
    E, R, y = ARM.material.E, 6.5e-3, ARM.offset_paths[0][1].evaluate(np.array([0.31]), 0.31)[0][0]
    radius = (E * np.pi * R**4 / 4 + 100.0 * y**2) / (100.0 * y)
    assert f"by a radius of {1e3 * radius:.3g} mm at s = 0.31 m" in sharp
    assert f"{1e3 * R:.3g} mm" in sharp
    longest = 1e3 * shape.tendon_lengths.max()
    assert f"T_13 would have to be {longest:.4g} mm long, 310.1 mm at rest" in sharp
    assert "passes through itself" in crosses
    assert "beware: " + sharp in repr(shape)


@pytest.mark.filterwarnings("error::model.errors.ShapeWarning")
@pytest.mark.parametrize("scene", [Scene(), Scene(Extension()), Scene.silicone()])
def test_what_arms_do_is_told_without_a_remark(scene: Scene) -> None:
    shapes = [settle(ARM, pulled(2.0), scene), settle(Arm.from_paper("table-4"), FETCH, scene)]
    if not scene.effects:
        shapes.pop()  # without extension the fetch bends sharper than the tip's radius
    assert all(shape.remarks == () for shape in shapes)


@pytest.mark.filterwarnings("default::model.errors.ShapeWarning")
def test_loads_that_bend_the_arm_too_sharply_are_told() -> None:
    thick = conical(0.1, (0.02, 0.02), [(0.1, 0.01, 0.01)], material=Material(1e5))
    moment = thick.material.E * np.pi * 0.02**4 / 4 * 60.0
    with pytest.warns(ShapeWarning, match="radius of 16.7 mm"):
        settle(thick, np.zeros(thick.n_tendons), Scene(TipLoad(moment=(0, 0, moment))))


@pytest.mark.filterwarnings("default::model.errors.ShapeWarning")
def test_a_call_inside_of_another_does_not_warn() -> None:
    from model.stiffness import stiffness

    with warnings.catch_warnings():
        warnings.simplefilter("error")
        stiffness(ARM, pulled(100.0), Scene(), accuracy=1e-3)
