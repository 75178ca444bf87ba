"""The block of the base joints: the clamp moves with decisions of the program.

    unknowns d / L, a:    (R_0, u_0) = (R_c exp((a - a_c) e_1), u_c + (d - d_c) R_c e_1)

d is the insertion, a the rotation, and (R_c, u_c) the clamp of the rod at the joint values d_c and
a_c. The block adds the difference of both poses to the base condition of the rod, and the joints to
the effort; see octoplan.planner.extensions.base_joints.joints.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import casadi as ca
import numpy as np

from octoplan.model.arm import Arm
from octoplan.model.mesh import base_pose
from octoplan.model.paths import Array
from octoplan.model.rod.discrete_rod import DiscreteRod
from octoplan.model.rod.equations import PlacedKernel
from octoplan.model.rod.kernels import Kernel
from octoplan.model.rotations import POSE, multiply, unit_matrix
from octoplan.model.support.machine.functions import cached
from octoplan.planner.block import ACTIVE, Block, Parts, ProgramView, Rows
from octoplan.planner.extensions.base_joints.joints import BaseJoints, BasePosition
from octoplan.planner.limits import natural_tensions

# Kind of the rows of the limits.
BASE_JOINTS = "base joints"
# Rotation that costs as much as an insertion by the arm's length [rad].
HALF_TURN = np.pi


@dataclass(frozen=True)
class JointBlock(Block):
    """The joints of the base: decisions d / L and a, each if the joint exists.

    Attributes
    ----------
    has_insertion, has_rotation : bool
    norm : "2", "1" or "inf"
        Norm of the tensions that is the effort.
    arm : Arm
        The arm with its base at the reference.
    joints : BaseJoints
    reference : BasePosition
        Joint values at which the base of the rod is clamped.
    """

    has_insertion: bool
    has_rotation: bool
    norm: str
    arm: Arm = field(compare=False)
    joints: BaseJoints = field(compare=False)
    reference: BasePosition = field(compare=False)
    n_parameters = 2

    @property
    def n_decisions(self) -> int:
        """See Block."""
        return self.has_insertion + self.has_rotation

    @property
    def n_controls(self) -> int:
        """The number of joints that can move."""
        low, high = self.joints.limits
        return int(np.less(low, high).sum())

    @property
    def _scales(self) -> Array:
        """The units of insertion [m] and rotation [rad] in the program (2,)."""
        return np.array([self.arm.length, 1.0])

    @property
    def _exists(self) -> Array:
        """Whether each joint exists (2,)."""
        return np.array([self.has_insertion, self.has_rotation])

    def scaled(self, values: tuple[float, ...]) -> Array:
        """Return joint values in the units of the decisions (n_decisions,)."""
        return np.asarray((np.array(values) / self._scales)[self._exists])

    # Symbols

    def shares(self, decision: int) -> list[PlacedKernel]:
        """Return minus the motion of the clamp, in the equations of the base's pose."""
        kernel = cached(_clamp_motion, self.has_insertion, self.has_rotation)
        unknowns = decision + np.arange(self.n_decisions)[:, None]
        return [PlacedKernel(kernel, unknowns, np.arange(POSE)[:, None])]

    def parts(self, view: ProgramView) -> Parts:
        """Return the limits, and the effort with the cost of the joints."""
        weight, unit = ca.vertsplit(view.parameters)
        share = unit / view.T_ref
        scale = ca.DM(np.array([1.0, HALF_TURN])[self._exists])
        cost = weight * ca.sumsqr(view.decisions / scale) / 2
        cost *= share**2 if self.norm == "2" else share
        return Parts([Rows(BASE_JOINTS, view.decisions)], effort=view.effort + cost)

    # Numbers

    def parameters(self) -> Array:
        """Return the weight, and the tension that bends the arm by about 1 rad [N]."""
        return np.array([self.joints.weight, natural_tensions(self.arm).max()])

    def share_parameters(self, rod: DiscreteRod) -> list[Array]:
        """Return clamp, reference and length of the arm."""
        values = [base_pose(self.arm), self.scaled(self.reference)]
        values += [self._scales[:1]] * self.has_insertion
        return [np.concatenate(values)[:, None]]

    def bounds(self) -> Mapping[str, tuple[Array | float, Array | float]]:
        """Return the limits of the joints."""
        low, high = self.joints.limits
        return {BASE_JOINTS: (self.scaled(low), self.scaled(high))}

    def initial_decisions(self, T: Array, states: Array) -> Array:
        """Return the joint values of the base's pose in the states."""
        clamp, pose = base_pose(self.arm), states[:POSE]
        shift = (pose[4:] - clamp[4:]) @ np.array(self.arm.base_frame)[:, 0]
        # The first two components of the relative quaternion.
        real = clamp[:4] @ pose[:4]
        w, x, y, z = clamp[:4]
        along = np.array([-x, w, z, -y]) @ pose[:4]
        angle = 2 * np.arctan2(along, real)
        values = np.array(self.reference) + np.array([shift, angle])
        return np.asarray((values / self._scales)[self._exists])

    def base_joints(self, decisions: Array) -> tuple[float, ...]:
        """Return insertion and rotation, exactly within the limits."""
        values = np.zeros(2)
        values[self._exists] = decisions
        return tuple(np.clip(values * self._scales, *self.joints.limits).tolist())

    def active_limits(
        self, arm: Arm, multipliers: Callable[[str], Array]
    ) -> list[tuple[float, str]]:
        """Return each limit of a joint whose multiplier is not zero."""
        lam = multipliers(BASE_JOINTS)
        names = [name for name, on in zip(BasePosition._fields, self._exists, strict=True) if on]
        each = zip(lam.tolist(), names, strict=False)
        low, high = self.joints.limits
        return [
            (abs(size), limit_text(name, high if size > 0 else low, "maximum" * (size > 0)))
            for size, name in each
            if abs(size) > ACTIVE
        ]


def limit_text(name: str, values: BasePosition, end: str) -> str:
    """Return the name of a limit of a joint."""
    return f"the {name} of the base at its {end or 'minimum'} of {joint_text(name, values)}"


def joint_text(name: str, values: BasePosition) -> str:
    """Return the value of a joint, in mm or degrees."""
    # Three decimals; 0.0 has no sign.
    if name == "insertion":
        return f"{round(1e3 * values.insertion, 3) + 0.0:.6g} mm"
    return f"{round(float(np.degrees(values.rotation)), 3) + 0.0:.6g} deg"


def _clamp_motion(has_insertion: bool, has_rotation: bool) -> Kernel:
    """Return the kernel of the pose of the clamp minus the pose of the moved base.

    Unknowns: the joints. Parameters: pose of the clamp, its joint values, length of the arm if the
    base is inserted.
    """
    joints = ca.SX.sym("joints", has_insertion + has_rotation)
    pose = ca.SX.sym("pose", POSE)
    reference = ca.SX.sym("reference", joints.numel())
    parameters = {"pose": pose, "reference": reference}
    change = joints - reference
    quaternion = pose[:4]
    position = pose[4:]
    if has_rotation:
        half = change[-1] / 2
        quaternion = multiply(quaternion, ca.vertcat(ca.cos(half), ca.sin(half), 0, 0))
    if has_insertion:
        length = ca.SX.sym("length")
        parameters["length"] = length
        position = position + length * change[0] * unit_matrix(pose[:4])[:, 0]
    return Kernel("clamp_motion", joints, parameters, pose - ca.vertcat(quaternion, position))
