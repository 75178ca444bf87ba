"""Multiple shooting: a state at the tip side of each segment, joined by jumps, closed at the base.

The unknowns are x_1 .. x_m, one for each anchorage segment from tip to base: the pose and strains
where the tip-to-base integration of that segment starts. The constraints are as many:

    strains of x_1     = jump at the tip from no strain
    strains of x_i+1   = jump(strains at the end of segment i)
    pose of x_i+1      = pose at the end of segment i
    the base's pose    = pose at the end of segment m
"""

from __future__ import annotations

import casadi as ca
import numpy as np

from model.arm import Arm
from model.closed_form import base_pose
from model.errors import NotSettledError
from model.mesh import Mesh
from model.paths import Array
from model.runge_kutta import RungeKutta
from model.scene import Scene
from model.statics import statics_of
from model.strain_ode import StrainOde, segments


class Shooting:
    """The shooting constraints of a scene on one mesh.

    Attributes
    ----------
    n_x, n_segments : int
        Size of a state and number of segments.
    scale : (n_x,)
        What one unit of each state's component is worth: 1 for quaternions, L for positions,
        1/L for curvatures. Unknowns and residuals are divided by it.
    """

    def __init__(self, arm: Arm, scene: Scene, mesh: Mesh, scheme: RungeKutta) -> None:
        self.arm, self.scene, self.mesh, self.scheme = arm, scene, mesh, scheme
        self.segments = segments(arm, scene, mesh, scheme)
        self.n_strains = len(statics_of(scene, arm).names)
        self.n_x, self.n_segments = 7 + self.n_strains, len(self.segments)
        L = arm.length
        self.scale = np.array([1.0] * 4 + [L] * 3 + [1 / L] * self.n_strains)

    def trajectories(self, X: ca.MX, T: ca.MX) -> list[ca.MX]:
        """Return the states at each segment's nodes, tip side first, from scaled unknowns X."""
        scale = ca.DM(self.scale)
        starts = [scale * X[:, i] for i in range(self.n_segments)]
        return [
            ca.horzcat(x, segment.map(x, T))
            for x, segment in zip(starts, self.segments, strict=True)
        ]

    def residual(self, X: ca.MX, T: ca.MX, trajectories: list[ca.MX]) -> ca.MX:
        """Return the scaled constraints (n_x n_segments,), zero at equilibrium."""
        rows = []
        strain = ca.MX.zeros(self.n_strains)
        for i, segment in enumerate(self.segments):
            rows.append(trajectories[i][7:, 0] - segment.jump(strain, T))
            strain = trajectories[i][7:, -1]
        ends = [trajectory[:7, -1] for trajectory in trajectories]
        starts = [trajectory[:7, 0] for trajectory in trajectories[1:]] + [base_pose(self.arm)]
        poses = [start - end for start, end in zip(starts, ends, strict=True)]
        pose_scale, strain_scale = ca.DM(self.scale[:7]), ca.DM(self.scale[7:])
        return ca.vertcat(*(r / strain_scale for r in rows), *(p / pose_scale for p in poses))

    def guess(self, tensions: Array) -> Array:
        """Return scaled unknowns (n_x, n_segments) by single shooting."""
        states = StrainOde(self.arm, self.scene, self.mesh, self.scheme).run(tensions)
        starts = [self.mesh.node(segment.nodes[0]) for segment in self.segments]
        return np.asarray((states[starts] / self.scale).T)

    def solve(self, tensions: Array, start: Array) -> Array:
        """Return the unknowns that settle the arm at fixed tensions, by Newton's method.

        Raises NotSettledError if Newton's method does not converge.
        """
        X = ca.MX.sym("X", self.n_x, self.n_segments)
        T = ca.MX.sym("T", self.arm.n_tendons)
        residual = self.residual(X, T, self.trajectories(X, T))
        problem = {"x": ca.vec(X), "p": T, "g": residual}
        options = {"abstol": 1e-13, "error_on_fail": False}
        newton = ca.rootfinder("settle", "newton", problem, options)
        found = np.array(newton(start.T.ravel(), tensions)).reshape(self.n_segments, self.n_x).T
        if not newton.stats()["success"]:
            raise NotSettledError(1e-13, np.inf, "Newton's method did not converge from this start")
        return found
