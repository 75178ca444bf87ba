"""Kernels that name what they compute on the way have the derivatives that they have without."""

import casadi as ca
import numpy as np
import pytest

from model import Scene
from model.effects import Current, ExactTendons, Extension, Friction, Shear, TipLoad, Weight
from model.transcription.element import clamp, element, tendon
from model.transcription.kernel import Kernel, Steps, Tangent, tangent
from model.transcription.system import form_of

LOADED = {
    "paper": Scene(Extension(), Weight()),
    "exact, sheared": Scene(Extension(), ExactTendons(), Shear(), Weight()),
    "silicone": Scene(*Scene.silicone().effects, Weight()),
    "current": Scene(*Scene.silicone().effects, Current((0.1, 0.0, 0.0))),
    "follower": Scene(Extension(), TipLoad((0.0, 0.0, 0.01), (0.0, 0.0, 0.0), follower=True)),
    "friction": Scene(Extension(), Friction(0.1), Weight()),
}


def dense(derivative, given, shape):
    function, rows, columns = derivative
    A = np.zeros(shape)
    A[rows, columns] = np.ravel(np.array(function(*given)))
    return A


@pytest.mark.quick(
    *(f"1-{curved}-{name}" for name in LOADED for curved in (False, True)),
    *(f"2-True-{name}" for name in LOADED),
    "3-False-follower",
    "3-True-silicone",
)
@pytest.mark.parametrize("scene", LOADED.values(), ids=LOADED)
@pytest.mark.parametrize("curved", [False, True])
@pytest.mark.parametrize("stages", [1, 2, 3])
def test_derivatives_by_steps_are_those_of_the_whole(
    scene: Scene, curved: bool, stages: int
) -> None:
    form = form_of(scene, curved, stages)
    for kernel in (element(form), tendon(form.law)):
        n, m = kernel.y.numel(), kernel.r.numel()
        rng = np.random.default_rng(stages)
        given = [rng.uniform(0.3, 1.0, n), rng.uniform(0.1, 1.0, kernel.c.numel())]
        lam, weights = ca.SX.sym("lam", m), rng.normal(size=m)
        y, c, r = kernel.y, kernel.c, kernel.r
        J = ca.Function("J", [y, c], [ca.densify(ca.jacobian(r, y))])
        H = ca.Function("H", [y, c, lam], [ca.densify(ca.hessian(ca.dot(lam, r), y)[0])])
        expected = np.array(J(*given))
        scale = np.abs(expected).max()
        assert np.allclose(dense(kernel.jacobian, given, (m, n)), expected, 0, 1e-12 * scale)
        expected = np.array(H(*given, weights))
        found = dense(kernel.hessian, [*given, weights], (n, n))
        assert np.allclose(found, expected, 0, 1e-11 * np.abs(expected).max())


def test_steps_within_steps_are_resolved() -> None:
    y, c = ca.SX.sym("y", 2), ca.SX.sym("c", 1)
    inner, outer = Steps(), Steps()
    square = inner.name(y**2)
    wave = outer.name(ca.sin(square[0] * square[1]) * c, inner)
    kernel = Kernel("waves", y, c, ca.vertcat(wave**3, wave * y[0]), outer)
    at = np.array([0.7, 1.1])
    w = 2.0 * np.sin((at**2).prod())
    assert np.allclose(np.array(kernel.value(at, 2.0)).ravel(), [w**3, w * at[0]], rtol=1e-14)
    slope = 2.0 * np.cos((at**2).prod()) * 2 * (at**2).prod() / at
    expected = [3 * w**2 * slope, w * np.eye(2)[0] + at[0] * slope]
    assert np.allclose(dense(kernel.jacobian, [at, 2.0], (2, 2)), expected, rtol=1e-13)


@pytest.mark.parametrize("name", ["paper", "silicone", "friction"])
@pytest.mark.parametrize("by_numbers", [False, True])
def test_derivatives_of_tangents_are_those_of_the_whole(name: str, by_numbers: bool) -> None:
    form = form_of(LOADED[name], False, 2)
    for of in (element(form), tendon(form.law), clamp()):
        rows = tuple(range(of.y.numel())) if by_numbers else (0, 3, of.y.numel() - 1)
        kernel = Tangent("along", of, rows, by_numbers)
        n, m = kernel.y.numel(), kernel.r.numel()
        rng = np.random.default_rng(m)
        given = [rng.uniform(0.3, 1.0, n), rng.uniform(0.1, 1.0, kernel.c.numel())]
        weights = rng.normal(size=m)
        J = ca.Function("J", [kernel.y, kernel.c], [ca.densify(ca.jacobian(kernel.r, kernel.y))])
        weighted = ca.hessian(ca.dot(weights, kernel.r), kernel.y)[0]
        H = ca.Function("H", [kernel.y, kernel.c], [ca.densify(weighted)])
        for found, expected in (
            (dense(kernel.jacobian, given, (m, n)), np.array(J(*given))),
            (dense(kernel.hessian, [*given, weights], (n, n)), np.array(H(*given))),
        ):
            assert np.allclose(found, expected, 0, 1e-11 * np.abs(expected).max())


def test_a_tangent_is_the_change_of_its_kernel() -> None:
    of = element(form_of(LOADED["silicone"], False, 2))
    rng = np.random.default_rng(1)
    y, c = rng.uniform(0.3, 1.0, of.y.numel()), rng.uniform(0.1, 1.0, of.c.numel())
    dy, dc, step = rng.normal(size=y.size), rng.normal(size=c.size), 1e-6
    there, back = (np.array(of.value(y + h * dy, c + h * dc)) for h in (step, -step))
    found = np.array(tangent(of).value(np.append(y, dy), np.append(c, dc)))
    assert np.allclose(found, (there - back) / (2 * step), 0, 1e-7 * np.abs(found).max())
