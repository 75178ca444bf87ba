"""Poses of closed forms and their derivatives, condensed step by step, are those of the whole."""

import ctypes

import casadi as ca
import numpy as np
import pytest

from model import Anchorage, Arm, Linear, Material, RestCurvature, Scene
from model.effects import ExactTendons, Extension
from model.forward import explicit_map
from model.unloaded.condensed_steps import CondensedSteps
from model.unloaded.steps_in_c import StepsInC
from tests.oracles import Array

BENT = Arm(
    0.3,
    Linear(0.01, 0.004),
    (
        Anchorage(0.3, Linear(0.004, 0.002), (0.3, 2.0, 4.0)),
        Anchorage(0.12, Linear(0.006, 0.003), (1.0, 3.0)),
    ),
    Material(2e5, 0.4),
    rest_curvature=RestCurvature(Linear(1.0, 3.0), Linear(-2.0, 0.5)),
)
EXACT = Scene(Extension(), ExactTendons())
ARMS = {
    "table 4": Arm.from_paper("table-4"),
    "one section": Arm.from_paper("section-5.2"),
    "bent": BENT,
}


def by_c(
    steps: CondensedSteps, tensions: Array, weights: Array, thinner: Array
) -> tuple[Array, ...]:
    """Return poses that are seen, their Jacobian and a weighted Hessian; the same of stretch."""
    of = StepsInC(steps)
    along, slim = of.rooms()
    poses_of, jacobian_of, strains_of, hessian_of, bent_of = (
        ctypes.CFUNCTYPE(None, *[ctypes.c_void_p] * 4, ctypes.c_long)(code.value)
        for code in of.functions
    )
    rooms = along, slim
    for room in rooms:
        room.T[:] = tensions
    poses_of(along.arm, along.found, along.T.ctypes.data, None, 0)
    before = along.poses.copy()
    jacobian_of(along.arm, along.found, along.T.ctypes.data, None, 0)
    strains_of(slim.arm, slim.found, slim.T.ctypes.data, 0, len(slim.strains))
    assert np.array_equal(along.poses, before)
    along.weights[of.seen], slim.weights[:, 2] = weights, thinner
    for run, room in zip((hessian_of, bent_of), rooms, strict=True):
        numbers = (values.ctypes.data for values in (room.weights, room.hessian))
        run(room.arm, room.found, *numbers, 0)
    jacobian = along.jacobian[of.seen].reshape(-1, of.n)
    stretch = 1 + slim.strains[:, 2, None]
    seen = along.poses[of.seen].T, jacobian, along.hessian
    return *seen, stretch, slim.by_tensions[:, 2], slim.hessian


@pytest.mark.quick(
    "table 4-bare-magnus2",
    "table 4-extension-magnus6",
    "one section-exact-magnus2",
    "bent-extension-magnus2",
    "bent-exact-magnus6",
)
@pytest.mark.parametrize("scheme", ["magnus2", "magnus6"])
@pytest.mark.parametrize(
    "scene", [Scene(), Scene(Extension()), EXACT], ids=["bare", "extension", "exact"]
)
@pytest.mark.parametrize("name", ARMS)
def test_poses_jacobian_and_hessian_are_those_that_casadi_finds(
    name: str, scene: Scene, scheme: str
) -> None:
    arm = ARMS[name]
    forward = explicit_map(arm, scene, scheme, 1, (0.4 * arm.length,))
    nodes = [0, forward.mesh.node(0.4 * arm.length), forward.mesh.steps]
    rng = np.random.default_rng(3)
    tensions, weights = rng.uniform(0, 0.2, arm.n_tendons), rng.normal(size=(7, 3))
    T, slim = ca.SX.sym("T", arm.n_tendons), [1, forward.stretch_at.size - 1]
    poses, stretch = forward.function.expand()(T)[:2]
    seen, thin = poses[:, nodes], stretch[slim].T
    weighted = ca.dot(seen, weights), ca.dot(thin, weights[0, :2])
    hessians = [ca.densify(ca.hessian(own, T)[0]) for own in weighted]
    jacobian = [ca.densify(ca.jacobian(ca.vec(own), T)) for own in (seen, thin)]
    whole = ca.Function(
        "whole", [T], [seen, jacobian[0], hessians[0], thin, jacobian[1], hessians[1]]
    )
    wanted = [np.array(value) for value in whole(tensions)]
    assert np.abs(wanted[2]).max() > 0
    for machine_code in (False, True):
        steps, x = CondensedSteps(forward, nodes, slim, machine_code), ca.MX.sym("x", arm.n_tendons)
        own = steps.second(x, ca.DM(weights)), steps.stretch_second(x, ca.DM(weights[0, :2]))
        results = [*steps.first(x), own[0], *steps.stretch(x), own[1], steps.poses(x)]
        results = [ca.densify(value) for value in results]
        found = [np.array(value) for value in ca.Function("found", [x], results)(tensions)]
        # In the Hessian of the stretch, which is small, terms cancel.
        rounding = [1e-12] * 5 + [1e-11, 1e-12]
        exact = [*wanted, wanted[0]]
        if StepsInC.can(steps):
            exact, rounding = [*exact, *wanted], [*rounding, *rounding[:6]]
            found += by_c(steps, tensions, weights.T, weights[0, :2])
        assert StepsInC.can(steps) == machine_code
        for value, own, share in zip(found, exact, rounding, strict=True):
            assert np.abs(value - own).max() <= share * np.abs(own).max()


@pytest.mark.parametrize("node", [0, 1])
def test_a_base_and_a_first_node_alone_have_derivatives_too(node: int) -> None:
    arm = ARMS["one section"]
    forward = explicit_map(arm, Scene(Extension()), "magnus6", 1)
    x = ca.MX.sym("x", arm.n_tendons)
    steps = CondensedSteps(forward, [node], [], False)
    results = [*steps.first(x), steps.second(x, ca.DM.ones(7, 1))]
    pose, jacobian, hessian = (
        np.array(value) for value in ca.Function("found", [x], results)([0.1, 0.0, 0.2, 0.0])
    )
    assert np.allclose(
        pose.ravel(), forward.run(np.array([0.1, 0.0, 0.2, 0.0]))[0][node], atol=1e-14
    )
    assert bool(jacobian.any()) == bool(hessian.any()) == bool(node)
