"""An arm by SoRoMoX, piecewise polynomial strains in JAX: what a user of that library writes.

`pip install -e ".[soromox]"`. Tendons there have their unit tangent and the section is linear, so
that its statics are those of `Scene(Extension(), ExactTendons())`. Source: A. T. Mathew et al.,
"Reduced order modeling of hybrid soft-rigid robots", Int. J. Robotics Research 44 (2025).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from model import Arm

Array = NDArray[np.float64]
_STRAINS = ("kappa_x", "kappa_y", "kappa_z", "sigma_x")
_NEWTON = 30


def settler(arm: Arm, order: int) -> Callable[[Array], Array]:
    """Return (tensions (n,)) -> tip (3,) [m] for a conical arm, by strains of a polynomial order.

    Newton's method on the generalized forces, compiled; raises ImportError without SoRoMoX.
    """
    import jax
    import jax.numpy as jnp

    jax.config.update("jax_enable_x64", True)
    robot = _robot(arm, order)

    def residual(q: Any, T: Any) -> Any:
        return robot.elastic_force(q) - robot.actuation_force(q, T)

    @jax.jit
    def settle(T: Any) -> Any:
        def step(state: Any) -> Any:
            q, _, count = state
            change = jnp.linalg.solve(jax.jacfwd(residual)(q, T), residual(q, T))
            return q - change, jnp.abs(change).max(), count + 1

        def going(state: Any) -> Any:
            return (state[1] > 1e-11) & (state[2] < _NEWTON)

        start = (jnp.zeros(robot.num_internal_dofs), jnp.inf, 0)
        q, _, _ = jax.lax.while_loop(going, step, start)
        return robot.forward_kinematics_tips(q)[-1][:3, 3]

    frame, origin = np.array(arm.base_frame), np.array(arm.base_position)
    return lambda T: origin + frame @ np.asarray(settle(T))


def _robot(arm: Arm, order: int) -> Any:
    """Return the arm in its own base frame, a segment between anchorages."""
    from soromox.actuation import ThreadlikeActuator, ThreadlikeRouting
    from soromox.systems.components import JointSpec, LinearProfile, LinkSpec
    from soromox.systems.gvs import GVS, GVSSegment, StrainBasisSpec

    ends = np.array([0.0, *(section.at for section in arm.sections[::-1])])
    radii = arm.radius.evaluate(ends, arm.length)[0]
    segments = []
    for i in range(len(ends) - 1):
        link = LinkSpec.circular(
            length=float(ends[i + 1] - ends[i]),
            radius=LinearProfile(float(radii[i]), float(radii[i + 1])),
            density=arm.material.density,
            reference_strain=[0.0, 0.0, 0.0, 1.0, 0.0, 0.0],
            young_modulus=arm.material.E,
            shear_modulus=arm.material.G,
        )
        basis = StrainBasisSpec("legendre", _STRAINS, order)
        segments.append(GVSSegment(link, JointSpec.fixed(), basis, max(5, 2 * order + 2)))
    routing = ThreadlikeRouting.linear(**_routing(arm))
    return GVS.from_segments(
        segments,
        gravity=np.zeros(3),
        base_pose=np.array([0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0]),
        actuators=ThreadlikeActuator.tendons(routing),
    )


def _routing(arm: Arm) -> dict[str, Any]:
    intercepts, jacobian, last = [], [], []
    for i, angle in arm.tendons:
        section = arm.sections[i]
        y = section.offset.evaluate(np.array([0.0, section.at]), section.at)[0]
        side = np.array([0.0, np.cos(angle), np.sin(angle)])
        intercepts.append(y[0] * side)
        jacobian.append((y[1] - y[0]) / section.at * side)
        last.append(len(arm.sections) - 1 - i)
    return {
        "intercept": np.array(intercepts),
        "slope": np.array(jacobian),
        "start_segment_index": (0,) * len(last),
        "end_segment_index": tuple(last),
    }
