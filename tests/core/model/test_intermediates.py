"""Derivatives of kernels with intermediates, against CasADi's derivatives of the whole."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

from octoplan.model.rod.kernels import Intermediates, Kernel

RNG = np.random.default_rng(3)


def kernel(y: ca.SX, intermediates: Intermediates) -> Kernel:
    """Return residuals whose early and late intermediates share inner ones."""
    inner = Intermediates()
    length = inner.define_once(ca.norm_2(y))
    unit = inner.define_once(y / length)
    early = intermediates.define(unit[0] * ca.exp(y[1]), inner)
    factor = intermediates.define(ca.sin(early) * y[2])
    late = intermediates.define(ca.vertcat(unit * y, length), inner)
    return Kernel("shared", y, {}, ca.vertcat(factor * late, early), intermediates)


def assembled(kernel: Kernel, what: str, y: np.ndarray, *lam: np.ndarray) -> np.ndarray:
    function, rows, columns = kernel.derivative(what)
    values = function(y, np.zeros(0), *lam)
    height = kernel.r.numel() if what == "jacobian" else kernel.y.numel()
    result = np.zeros((height, kernel.y.numel()))
    nonzeros = values[0] if what == "jacobian" else values
    result[rows, columns] = nonzeros.full().ravel()
    return result


def test_definitions_that_share_intermediates_have_exact_derivatives():
    y = ca.SX.sym("y", 3)
    shared = kernel(y, Intermediates())
    lam = ca.SX.sym("lam", shared.r.numel())
    J = ca.Function("J", [y], [ca.jacobian(shared.r, y)])
    H = ca.Function("H", [y, lam], [ca.hessian(ca.dot(lam, shared.r), y)[0]])
    at = RNG.uniform(0.5, 1.0, 3)
    weights = RNG.normal(size=shared.r.numel())
    np.testing.assert_allclose(assembled(shared, "jacobian", at), J(at).full(), atol=1e-14)
    hessian = assembled(shared, "hessian", at, weights)
    np.testing.assert_allclose(hessian, H(at, weights).full(), atol=1e-13)


def test_equal_values_are_defined_once():
    y = ca.SX.sym("y", 2)
    intermediates = Intermediates()
    first = intermediates.define_once(ca.exp(y) * 2)
    assert ca.is_equal(first, intermediates.define_once(ca.exp(y) * 2))
    assert not ca.is_equal(first, intermediates.define_once(ca.exp(y) * 3))
    assert len(intermediates.definitions) == 2
    assert intermediates.define_once(ca.SX(1)).is_constant()


def test_values_that_share_intermediates_must_be_independent():
    y = ca.SX.sym("y", 2)
    intermediates = Intermediates()
    inner = Intermediates()
    first = intermediates.define(inner.define(ca.exp(y[0])), inner)
    with pytest.raises(ValueError, match="must not depend"):
        intermediates.define(first * y[1], inner)
