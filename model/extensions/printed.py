"""The paper's equations (10) and (11) to the letter: strains and pose from the tip to the base.

A state x is the pose (7,), then tau, xi, k. Sums are the tendons' resultants (6,), see
octoplan.model.cross_section.law; body is E A, E J, G I. Steps are explicit Runge-Kutta steps
between the nodes of a mesh, and at each anchorage the strains jump. The equations carry an error
made at the tip to the base multiplied by D(tip) / D(base), which for a tapered arm is small; from
base to tip the error would grow by the inverse. The length of quaternions drifts by the order of
the scheme, and all results divide by this length.
"""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np

from octoplan.model.arm import Arm
from octoplan.model.cross_section.law import PaperSection, cross_section_of, resultants
from octoplan.model.cross_section.sections import Sections, strains_of
from octoplan.model.effects import Extension
from octoplan.model.effects.base import Effect, Rules
from octoplan.model.equilibrium.explicit import ExplicitEquilibrium, ExplicitMap
from octoplan.model.equilibrium.runge_kutta import RungeKutta
from octoplan.model.mesh import Counts, base_pose, crossing, graded, stations, tendon_offsets
from octoplan.model.paths import Array
from octoplan.model.rotations import compose, inverse, multiply, rotate
from octoplan.model.scene import Scene
from octoplan.model.support.errors import Described, InputError
from octoplan.model.support.machine.compiled import kernel
from octoplan.model.support.machine.functions import BufferedFunction
from octoplan.model.support.value import value
from octoplan.model.tendons import LENGTH_POINTS

__all__ = ["PrintedStatics"]

# J. C. Butcher, "On Runge-Kutta processes of high order", J. Austral. Math. Soc. 4 (1964): order 6
# in seven stages.
RK6 = RungeKutta(
    "rk6",
    6,
    (0, 1 / 3, 2 / 3, 1 / 3, 1 / 2, 1 / 2, 1),
    (11 / 120, 0, 27 / 40, 27 / 40, -4 / 15, -4 / 15, 11 / 120),
    (
        (),
        (1 / 3,),
        (0, 2 / 3),
        (1 / 12, 1 / 3, -1 / 12),
        (-1 / 16, 9 / 8, -3 / 16, -3 / 8),
        (0, 9 / 8, -3 / 8, -3 / 4, 1 / 2),
        (9 / 44, -9 / 11, 63 / 44, 18 / 11, 0, -16 / 11),
    ),
)

# Names of the effects that the printed equations exclude besides statics and friction.
_LOADS = (
    "Contact",
    "Current",
    "LineLoad",
    "PointLoad",
    "PointMass",
    "SelfContact",
    "Shear",
    "TipLoad",
    "Weight",
)


@value
class PrintedStatics(Effect):
    """Equations (10) and (11) exactly as printed, for reproducing the paper and nothing else.

    They leave out the turning of the frame, omega x K omega, and add the share of an anchorage's
    own tendons to the curvature as if no other tendon crossed the section. Adds the torsion tau as
    a state, and has no closed form. Stated for tendons on the axes n, b, -n, -b only.
    """

    @classmethod
    def excludes(cls) -> Rules:
        """See Effect."""
        tendons = "eqs. (10) and (11) are written for the reference tangent"
        material = "eqs. (10) and (11) are written for a linear material"
        friction = "eqs. (10) and (11) are written for tensions that do not vary along a tendon"
        loads = "eqs. (10) and (11) are written without loads or shear"
        return (
            ("ExactTendons", tendons),
            ("NeoHookean", material),
            ("Friction", friction),
            *((load, loads) for load in _LOADS),
        )

    def check_arm(self, arm: Arm) -> None:
        """See Effect."""
        if arm.is_curved:
            allowed = "an arm that is straight at rest: eqs. (10) and (11) are written for that"
            raise InputError("Arm.rest_curvature", arm.rest_curvature, allowed)
        if any(arm.angle_paths):
            allowed = "tendons at constant angles: eqs. (10) and (11) are written for these"
            raise InputError("Anchorage.turn", Described("helical tendons"), allowed)
        if arm.is_guided:
            allowed = "None, continuous guides, for the statics as printed"
            raise InputError("Anchorage.guides", Described("spacer discs"), allowed)
        if arm.cross_section is not None:
            allowed = "the solid circle: eqs. (10) and (11) are written for that"
            raise InputError("Arm.cross_section", arm.cross_section, allowed)

    def check_planned(self) -> None:
        """See Effect."""
        allowed = (
            "a scene whose statics are consistent, such as Scene(Extension()); settle takes it"
        )
        raise InputError("scene", Described("a scene as printed"), allowed)

    def check_responses(self) -> None:
        """See Effect."""
        raise InputError(
            "scene", Described("a scene as printed"), "a scene whose equations hold under loads"
        )

    def forward_map(
        self, arm: Arm, scene: Scene, refinement: int, at: tuple[float, ...], machine_code: bool
    ) -> PrintedMap:
        """See Effect."""
        return PrintedMap(arm, scene, RK6, refinement, at, machine_code)


def strain_rate(
    strain: ca.SX, sums: ca.SX, sums_rate: ca.SX, body: ca.SX, body_rate: ca.SX
) -> ca.SX:
    """Return the derivative of (tau, xi, k) along s: eq. (10), without omega x K omega."""
    tau, xi, k = ca.vertsplit(strain)
    _, c, s, cc, _, ss = ca.vertsplit(sums)
    _, c_rate, s_rate, cc_rate, _, ss_rate = ca.vertsplit(sums_rate)
    _, EJ, GI = ca.vertsplit(body)
    _, EJ_rate, GI_rate = ca.vertsplit(body_rate)
    twist = -tau * (GI_rate + cc_rate + ss_rate) - k * xi * (cc - ss) + k * s + xi * c
    about_n = -xi * (EJ_rate + ss_rate) - tau * k * ss - tau * c - s_rate
    about_b = -k * (EJ_rate + cc_rate) + tau * xi * cc - tau * s + c_rate
    return ca.vertcat(twist / (GI + cc + ss), about_n / (EJ + ss), about_b / (EJ + cc))


def stretch(extension: bool, strain: ca.SX, sums: ca.SX, body: ca.SX) -> ca.SX:
    """Return 1 + q: E A q = - sum T t . c, eqs. (3b), (9a)."""
    if not extension:
        return ca.SX(1)
    _, force = PaperSection(extension).tendons(ca.vertcat(strain, 0), sums)
    return 1 - force[0] / body[0]


def _slope(extension: bool, x: ca.SX, d: ca.SX) -> ca.SX:
    """Return the derivative of x along s, eqs. (1) and (10), from a cross-section's numbers d."""
    sums, sums_rate, body, body_rate = (d[i:j] for i, j in ((0, 6), (6, 12), (12, 15), (15, 18)))
    along = stretch(extension, x[7:], sums, body)
    turn = multiply(x[:4], ca.vertcat(0, along * x[7:])) / 2
    moved = rotate(x[:4] / ca.norm_2(x[:4]), ca.vertcat(along, 0, 0))
    return ca.vertcat(turn, moved, strain_rate(x[7:], sums, sums_rate, body, body_rate))


def _across(extension: bool, scheme: RungeKutta) -> ca.Function:
    """Return (x on a node's tip side, sums there, numbers (18, m) at the scheme's samples, h) ->.

    x after a step, x on the node's base side, and 1 + q at both of these, the node first.
    """
    x = ca.SX.sym("x", 10)
    outer = ca.SX.sym("outer", 6)
    h = ca.SX.sym("h")
    d = ca.SX.sym("d", 18, len(scheme.samples))
    first = d[:, 0]
    last = d[:, -1]
    # The jump of eq. (11), whatever other tendons cross the anchorage.
    _, cos, sin, cos2, _, sin2 = ca.vertsplit(first[:6] - outer)
    jump = ca.vertcat(0, -sin / (sin2 + first[13]), cos / (cos2 + first[13]))
    start = ca.vertcat(x[:7], x[7:] + jump)
    at = [scheme.samples.index(node) for node in scheme.nodes]
    after = scheme.step(lambda stage, x: _slope(extension, x, d[:, at[stage]]), start, h)
    along = [
        stretch(extension, start[7:], first[:6], first[12:15]),
        stretch(extension, after[7:], last[:6], last[12:15]),
    ]
    results = [after, start, ca.vertcat(*along)]
    return ca.Function("across", [x, outer, d, h], results, {"cse": True})


def section_numbers(arm: Arm, s: Array, active: Counts, T: Any) -> Any:
    """Return the numbers (18, N) of cross-sections: sums, body, each with its rate behind it."""
    at = stations(arm, s, active)
    (n, b), (n_rate, b_rate), _ = tendon_offsets(arm, at)
    rates = [0 * n, n_rate, b_rate, 2 * n * n_rate, n_rate * b + n * b_rate, 2 * b * b_rate]
    maps = np.stack([crossing(arm, at), *resultants(n, b, n_rate, b_rate)[1:6], *rates], axis=1)
    # E A, E J and G I of the solid circle.
    body = ca.DM(arm.section_stiffness(s)[:, [0, 1, 3]].reshape(6, -1))
    sums = ca.reshape(ca.sparsify(ca.DM(maps.reshape(-1, arm.n_tendons))) @ T, 12, s.size)
    return ca.vertcat(sums, body)


class PrintedMap(ExplicitMap):
    """The forward map of a scene as printed, on one mesh.

    `stretch_at` contains the nodes from tip to base, on their base side, then the tip side of the
    next node towards the base.
    """

    scheme: RungeKutta
    # A long step may leave strains that are not a number.
    sections_are_exact = False

    def __init__(
        self,
        arm: Arm,
        scene: Scene,
        scheme: RungeKutta,
        refinement: int,
        at: tuple[float, ...] = (),
        machine_code: bool = False,
    ) -> None:
        self.refinement = refinement
        self.machine_code = machine_code
        self.arm = arm
        self.scene = scene
        self.scheme = scheme
        self.mesh = mesh = graded(arm, refinement, at)
        self._across = kernel(_across(scene.has(Extension), scheme), machine_code)
        T = ca.MX.sym("T", arm.n_tendons)
        x = ca.MX(ca.DM([1, *[0] * 9]))
        # Begin at the tip: no tendons cross beyond the first node.
        start = mesh.s[:0:-1]
        h = -np.diff(mesh.s)[::-1]
        active = mesh.active[::-1]
        outer = section_numbers(arm, start, np.append(0, active[:-1]), T)[:6, :]
        samples = self._samples(start, h, active, T)
        integrator = self._across.mapaccum(mesh.elements)
        after, begun, along = integrator(x, outer, samples, ca.DM(h).T)
        poses = ca.horzcat(begun, after[:, -1])[:7, ::-1]
        # Convert poses from the frame of the tip to the base frame.
        first = ca.SX.sym("first", 7)
        point = ca.SX.sym("point", 7)
        tip = ca.vertcat(first[:4] / ca.norm_2(first[:4]), first[4:])
        pose = compose(compose(ca.SX(ca.DM(base_pose(arm))), inverse(tip)), point)
        anchor = ca.Function("anchor", [first, point], [pose]).map(poses.shape[1])
        self.stretch_at = np.concatenate([start, start + h])
        self.radius = arm.radius.evaluate(self.stretch_at, arm.length)[0]
        results = [anchor(poses[:, 0], poses), ca.vec(along.T).T, ca.horzcat(begun, after)[7:, :]]
        self._function = ca.Function("printed", [T], results)
        self._called = BufferedFunction(self._function)

    @property
    def function(self) -> ca.Function:
        """See ExplicitMap; the third result is tau, xi, k (3, K) at `stretch_at`."""
        return self._function

    def _samples(self, start: Array, h: Array, active: Counts, T: Any) -> Any:
        samples = np.array(self.scheme.samples)
        first = np.nextafter(start + h, np.inf)
        s = np.clip(start[:, None] + h[:, None] * samples, first[:, None], start[:, None]).ravel()
        return section_numbers(self.arm, s, np.repeat(active, samples.size), T)

    def run(self, tensions: Array) -> tuple[Array, Array]:
        """See ExplicitMap.run."""
        poses, along, strains = self._called(tensions)
        return poses, np.hstack([strains, along - 1])

    def dense(self, tensions: Array, poses: Array, strains: Array, s: Array) -> tuple[Array, Array]:
        """Return poses (N, 7) and strains (N, 4) at arc lengths s, a step from the nodes above."""
        step = np.clip(np.searchsorted(self.mesh.s, s, side="left") - 1, 0, self.mesh.elements - 1)
        active = self.mesh.active[step]
        start = self.mesh.s[step + 1]
        there = strains[self.mesh.elements - 1 - step, :3]
        x = ca.DM(np.hstack([poses[step + 1], there]).T)
        h = s - start
        d = self._samples(start, h, active, ca.DM(tensions))
        across = self._across.map(s.size)
        after, _, along = across(x, d[:6, :: len(self.scheme.samples)], d, ca.DM(h).T)
        rows = np.array(after).T
        return rows[:, :7], np.column_stack([rows[:, 7:], np.array(along)[1] - 1])

    def tendon_lengths(self, point: ExplicitEquilibrium) -> Array:
        """See ExplicitMap: strains are integrated along the arm."""
        law = cross_section_of(self.scene, self.arm.is_curved)
        s, weights, active = self.mesh.points(LENGTH_POINTS)
        sections = Sections(self.arm, self.scene, law, s, active)
        return sections.lengths(strains_of(law, point.at(s)[1]), weights)[0]
