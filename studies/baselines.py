"""Reference solvers that a user could write without this project: shooting with SciPy.

The module uses only NumPy and SciPy. From `octoplan` only the parameters of the arm are used.

Without loads the strains have a closed form. With loads the model is the paper's consistent statics
with extension, weight in a fluid and a dead force at the tip. The internal force F(s) does not
depend on the shape, because the loads are dead: F(s) is a polynomial. The moment follows from
M' = -u' x F, with M = 0 at the tip.

In silicone the model has exact tendons, a neo-Hookean body, weight in a fluid and a dead force at
the tip. Newton's method solves each cross-section for the stretch l and b = l^(-1/2) kappa, which
minimise

    EA (l^2 + 2/l) / 6 + EJ (1 + 2/l^3) b_bend^2 / 6 + GI b_t^2 / 2
        + sum T |c| - l^(1/2) m . b - F_t l

Here c is the tangent of a tendon, and m and F_t are the moment and the axial force of the loads
between the cross-section and the tip.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from scipy.optimize import minimize, root
from scipy.spatial.transform import Rotation

from octoplan.model import Arm

Array = NDArray[np.float64]


class ScipyCone:
    """A conical arm with linear offsets and precomputed parameters.

    `rhs` counts the evaluations of the right-hand side.
    """

    def __init__(self, arm: Arm) -> None:
        self.arm = arm
        self.rhs = 0
        self.base = np.array(arm.base_frame)
        at = np.array([section.at for section in arm.sections])
        section_of = np.array([i for i, _ in arm.tendons])
        phi = np.array([angle for _, angle in arm.tendons])
        self.cos = np.cos(phi)
        self.sin = np.sin(phi)
        self.ends = at[section_of]
        offsets = np.array(
            [sec.offset.evaluate(np.array([0, sec.at]), sec.at)[0] for sec in arm.sections]
        )
        self.y0 = offsets[section_of, 0]
        self.slope = (np.diff(offsets)[:, 0] / at)[section_of]
        self.R0, self.R1 = arm.radius.evaluate(np.array([0, arm.length]), arm.length)[0].tolist()
        self.breaks = np.array(sorted({0.0, arm.length, *at.tolist()}))

    def radius(self, s: Any) -> tuple[Array, float]:
        """Return the radius at arc lengths s [m] and the slope of the taper."""
        slope = (self.R1 - self.R0) / self.arm.length
        return self.R0 + slope * np.asarray(s), slope

    def _crossing(self, T: Array, end: float) -> Array:
        return T * (self.ends >= end)


class ScipyArm(ScipyCone):
    """The paper's consistent statics in closed form, and eq. (1) integrated by solve_ivp."""

    def strains(self, s: float, T: Array) -> tuple[float, float, float]:
        """Return xi, k, q of the cross-section at s under the tensions that cross it."""
        area = float(np.pi * self.radius(s)[0] ** 2)
        E = self.arm.material.E
        EJ = E * area**2 / (4 * np.pi)
        EA = E * area
        y = self.y0 + self.slope * s
        pull = y * T
        c = pull @ self.cos
        d = pull @ self.sin
        lever = pull * y
        A = EJ + lever @ self.sin**2
        B = EJ + lever @ self.cos**2
        C = -lever @ (self.sin * self.cos)
        det = A * B - C * C
        xi = (-B * d - C * c) / det
        k = (A * c + C * d) / det
        return xi, k, (k * c - xi * d - T.sum()) / EA

    def tip(self, T: Array, method: str = "DOP853", rtol: float = 1e-8) -> Array:
        """Return the tip position, integrating base to tip segment by segment."""
        x = np.concatenate([self.base.T.ravel(), self.arm.base_position])
        for start, end in pairwise(self.breaks):
            args = (self._crossing(T, end),)
            run = solve_ivp(self._rate, (start, end), x, method, args=args, rtol=rtol, atol=rtol)
            self.rhs += run.nfev
            x = run.y[:, -1]
        return np.asarray(x[9:])

    def _rate(self, s: float, x: Array, T: Array) -> Array:
        xi, k, q = self.strains(s, T)
        t = x[:3]
        n = x[3:6]
        b = x[6:9]
        rate = np.empty(12)
        rate[:3], rate[3:6], rate[6:9], rate[9:] = k * n - xi * b, -k * t, xi * t, t
        return (1 + q) * rate

    def least_stretch(self, T: Array) -> float:
        """Return the least stretch 1 + q, evaluated at the ends of the segments.

        On a tapered arm the minimum over each segment is at one of the ends.
        """
        pairs = list(pairwise(self.breaks))
        return min(1 + self.strains(s, self._crossing(T, p[1]))[2] for p in pairs for s in p)

    def tip_jacobian(self, T: Array, rtol: float, steps: Array, central: bool) -> Array:
        """Return the tip Jacobian (3, n) [m/N] from finite differences with `steps` [N]."""
        here = None if central else self.tip(T, rtol=rtol)
        columns = []
        for change, step in zip(np.diag(steps), steps, strict=True):
            ahead = self.tip(T + change, rtol=rtol)
            if here is None:
                columns.append((ahead - self.tip(T - change, rtol=rtol)) / (2 * step))
            else:
                columns.append((ahead - here) / step)
        return np.array(columns).T

    def plan_tip(
        self,
        point: Array,
        upper: float,
        start: Array,
        ftol: float = 1e-6,
        rtol: float = 1e-8,
        within: float = 1e-6,
    ) -> tuple[Array, float, bool]:
        """Return (tensions, distance to the point [m], success) from SLSQP with finite differences.

        Success requires that SLSQP reports convergence, that the distance is less than `within`
        times L, and that no cross-section is crushed.
        """
        L = self.arm.length
        result: Any = minimize(
            lambda T: T @ T,
            start,
            method="SLSQP",
            bounds=[(0.0, upper)] * len(start),
            constraints={"type": "eq", "fun": lambda T: (self.tip(T, rtol=rtol) - point) / L},
            options={"maxiter": 200, "eps": 1e-6, "ftol": ftol},
        )
        gap = float(np.linalg.norm(self.tip(result.x) - point))
        solved = result.success and gap < within * L and self.least_stretch(result.x) > 0
        return result.x, gap, bool(solved)

    def plan_tip_from(
        self, point: Array, upper: float, starts: Iterable[Array]
    ) -> tuple[Array, bool]:
        """Return (tensions, success) of the first start from which SLSQP reaches the point."""
        for start in starts:
            T, _, solved = self.plan_tip(point, upper, start)
            if solved:
                break
        return T, solved


class ScipyLoadedArm(ScipyCone):
    """A conical arm under tensions, a tip force [N] and gravity [m/s2].

    The loads are applied in `steps` load steps. A state contains the frame (9, by rows), the moment
    of the loads towards the tip (3) and the position (3), in the base frame.
    """

    def __init__(
        self, arm: Arm, force: Array, gravity: Array, fluid: float = 0.0, steps: int = 1
    ) -> None:
        super().__init__(arm)
        self.force = force
        self.steps = steps
        self.spread = np.pi * (arm.material.density - fluid) * gravity

    def rate(self, s: Any, x: Array, T: Array, share: float) -> Array:
        """Return the derivative of the states (15, N) at arc lengths s (N,).

        T are the tensions at s: zero for tendons that end before s.
        """
        self.rhs += np.size(s)
        E = self.arm.material.E
        G = self.arm.material.G
        r, c = self.radius(s)
        frame = x[:9].reshape(3, 3, -1)
        M = x[9:12]
        volume = (self.R1**3 - r**3) / (3 * c)
        F = share * (self.force[:, None] + self.spread[:, None] * volume)
        m = np.einsum("ijn,in->jn", frame, M)
        F_t = np.einsum("in,in->n", frame[:, 0], F)
        y = self.y0[:, None] + self.slope[:, None] * np.asarray(s)
        cos = self.cos[:, None]
        sin = self.sin[:, None]
        pull = y * T[:, None]
        EJ = E * np.pi * r**4 / 4
        lever, (a, b) = pull * y, ((pull * cos).sum(0), (pull * sin).sum(0))
        A = EJ + (lever * sin**2).sum(0)
        B = EJ + (lever * cos**2).sum(0)
        C = -(lever * sin * cos).sum(0)
        m_n = m[1] - b
        m_b = m[2] + a
        det = A * B - C * C
        tau = m[0] / (G * np.pi * r**4 / 2 + lever.sum(0))
        xi = (B * m_n - C * m_b) / det
        k = (A * m_b - C * m_n) / det
        grow = 1 + (k * a - xi * b - T.sum() + F_t) / (E * np.pi * r**2)
        t = frame[:, 0]
        n = frame[:, 1]
        b_ = frame[:, 2]
        turned = np.stack([k * n - xi * b_, tau * b_ - k * t, xi * t - tau * n], axis=1)
        u = grow * t
        moment = np.stack(
            [F[1] * u[2] - F[2] * u[1], F[2] * u[0] - F[0] * u[2], F[0] * u[1] - F[1] * u[0]]
        )
        return np.concatenate([(grow * turned).reshape(9, -1), moment, u])

    def _sweep(self, tip: Array, T: Array, share: float, rtol: float, method: str) -> Array:
        """Return the state (15,) at the base, integrated from a tip frame at the origin."""
        x = np.concatenate([tip.ravel(), np.zeros(6)])

        def rate(s: float, x: Array, crossing: Array) -> Array:
            return self.rate(s, x[:, None], crossing, share)[:, 0]

        for high, low in pairwise(self.breaks[::-1]):
            args = (self._crossing(T, high),)
            run: Any = solve_ivp(rate, (high, low), x, method, args=args, rtol=rtol, atol=rtol)
            x = run.y[:, -1]
        return np.asarray(x)

    def shoot(self, T: Array, rtol: float, method: str = "DOP853") -> Array:
        """Return the tip position (3,) [m].

        Shooting solves for the tip frame that yields the clamped frame at the base.
        """
        free = self._sweep(np.eye(3), T, 0.0, rtol, method)[:9].reshape(3, 3)
        tip = self.base @ free.T
        for share in np.linspace(0, 1, self.steps + 1)[1:]:

            def off(w: Array, tip: Array = tip, share: float = share) -> Array:
                turned = Rotation.from_rotvec(w).as_matrix() @ tip
                result = self._sweep(turned, T, share, rtol, method)[:9].reshape(3, 3)
                return Rotation.from_matrix(result @ self.base.T).as_rotvec()

            result: Any = root(off, np.zeros(3), tol=rtol, options={"eps": rtol**0.5})
            tip = Rotation.from_rotvec(result.x).as_matrix() @ tip
        end = self._sweep(tip, T, 1.0, rtol, method)
        return np.asarray(np.array(self.arm.base_position) - end[12:])


# Largest number of Newton steps for a cross-section.
_STEPS = 60
# Largest Newton step of a solved cross-section, relative to the stretch.
_STEP_TOL = 1e-12
# Largest Newton step, as a share of the stretch. Longer steps are shortened.
_MAX_STEP = 0.3


class ScipySiliconeArm(ScipyLoadedArm):
    """A conical arm of silicone. See ScipyLoadedArm."""

    def rate(self, s: Any, x: Array, T: Array, share: float) -> Array:
        """See ScipyLoadedArm.rate."""
        self.rhs += np.size(s)
        r, slope = self.radius(s)
        frame = x[:9].reshape(3, 3, -1)
        M = x[9:12]
        volume = (self.R1**3 - r**3) / (3 * slope)
        F = share * (self.force[:, None] + self.spread[:, None] * volume)
        m = np.einsum("ijn,in->jn", frame, M)
        F_t = np.einsum("in,in->n", frame[:, 0], F)
        z = self._solve_sections(np.atleast_1d(s), np.broadcast_to(r, F_t.shape), m, F_t, T)
        kappa = z[:, :3].T * np.sqrt(z[:, 3])
        t = frame[:, 0]
        n = frame[:, 1]
        b = frame[:, 2]
        turned = np.stack(
            [kappa[2] * n - kappa[1] * b, kappa[0] * b - kappa[2] * t, kappa[1] * t - kappa[0] * n],
            axis=1,
        )
        u = z[:, 3] * t
        return np.concatenate([turned.reshape(9, -1), np.cross(F.T, u.T).T, u])

    def _solve_sections(self, s: Array, r: Array, m: Array, F_t: Array, T: Array) -> Array:
        """Return b (3,) and the stretch l of each cross-section (N, 4)."""
        E = self.arm.material.E
        G = self.arm.material.G
        EA = E * np.pi * r**2
        EJ = E * np.pi * r**4 / 4
        GI = G * np.pi * r**4 / 2
        z = np.zeros((len(r), 4))
        z[:, 3] = 1 / np.sqrt(1 + 2 * T.sum() / EA)
        unit = np.array([1.0, 1.0, 1.0, 0.0]) * r[:, None] + np.array([0.0, 0.0, 0.0, 1.0])
        for _ in range(_STEPS):
            stretch = z[:, 3]
            bend = z[:, 1] ** 2 + z[:, 2] ** 2
            root = np.sqrt(stretch)
            soft = EJ * (1 + 2 / stretch**3) / 3
            g, H = self._tendons(z, s, T)
            g[:, :3] += np.stack([GI, soft, soft], 1) * z[:, :3] - root[:, None] * m.T
            work = (m.T * z[:, :3]).sum(1)
            g[:, 3] += EA * (stretch - stretch**-2) / 3 - EJ * bend / stretch**4
            g[:, 3] -= work / (2 * root) + F_t
            H[:, [0, 1, 2], [0, 1, 2]] += np.stack([GI, soft, soft], 1)
            across = -2 * EJ[:, None] / stretch[:, None] ** 4 * z[:, :3] * [0, 1, 1]
            across -= m.T / (2 * root[:, None])
            H[:, :3, 3] += across
            H[:, 3, :3] += across
            H[:, 3, 3] += EA * (1 + 2 / stretch**3) / 3 + 4 * EJ * bend / stretch**5
            H[:, 3, 3] += work / (4 * stretch * root)
            step = -np.linalg.solve(H, g[:, :, None])[:, :, 0]
            size = np.abs(step * unit).max(1)
            z += step * np.minimum(1.0, _MAX_STEP * stretch / np.maximum(size, 1e-300))[:, None]
            if size.max() < _STEP_TOL:
                return z
        raise RuntimeError("Newton's method did not converge for a cross-section")

    def _tendons(self, z: Array, s: Array, T: Array) -> tuple[Array, Array]:
        """Return the gradient (N, 4) and the Hessian (N, 4, 4) of sum T |c| at z (N, 4)."""
        y = self.y0 + self.slope * s[:, None]
        rate = np.broadcast_to(self.slope, (len(s), T.size))
        one = np.ones_like(y)
        zero = np.zeros_like(y)
        stretch = z[:, 3, None]
        along = np.stack([zero, y * self.sin, -y * self.cos, one], 2)
        a = (along * z[:, None, :]).sum(2)
        length = np.sqrt(a**2 + rate**2 / stretch + (y * z[:, :1]) ** 2)
        p = a[:, :, None] * along
        p[:, :, 0] += y**2 * z[:, :1]
        p[:, :, 3] -= rate**2 / (2 * stretch**2)
        q = along[:, :, :, None] * along[:, :, None, :]
        q[:, :, 0, 0] += y**2
        q[:, :, 3, 3] += rate**2 / stretch**3
        unit = p / length[:, :, None]
        bent = (q - unit[:, :, :, None] * unit[:, :, None, :]) / length[:, :, None, None]
        return np.einsum("i,nij->nj", T, unit), np.einsum("i,nijk->njk", T, bent)


# Strains of the SoRoMoX segments: torsion, two bending curvatures and extension.
_STRAINS = ("kappa_x", "kappa_y", "kappa_z", "sigma_x")
# Largest number of Newton steps with SoRoMoX.
_NEWTON = 30


def soromox_tip(arm: Arm, order: int) -> Callable[[Array], Array]:
    """Return the compiled map (tensions (n,)) -> tip (3,) [m] of a conical arm with SoRoMoX.

    SoRoMoX (`pip install -e ".[soromox]"`) models piecewise polynomial strains of a given order in
    JAX. Tendons follow their unit tangent and the cross-section is linear, so that the statics are
    those of `Scene(Extension(), ExactTendons())`. Newton's method solves for the generalised
    forces. Raise ImportError if SoRoMoX is not installed. Source: A. T. Mathew et al., "Reduced
    order modeling of hybrid soft-rigid robots", Int. J. Robotics Research 44 (2025).
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

        def is_iterating(state: Any) -> Any:
            return (state[1] > 1e-11) & (state[2] < _NEWTON)

        start = (jnp.zeros(robot.num_internal_dofs), jnp.inf, 0)
        q, _, _ = jax.lax.while_loop(is_iterating, step, start)
        return robot.forward_kinematics_tips(q)[-1][:3, 3]

    frame = np.array(arm.base_frame)
    origin = np.array(arm.base_position)
    return lambda T: origin + frame @ np.asarray(settle(T))


def _robot(arm: Arm, order: int) -> Any:
    """Return the arm in its own base frame, with one segment between two anchorages."""
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
    intercepts = []
    jacobian = []
    last = []
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
