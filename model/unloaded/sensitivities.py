"""How an arm without loads answers to a force and moment on its midline, and to its tendons.

Without loads no wrench bends the arm but its tendons' own, so that a small one changes strains
where it acts and nowhere else: what moves is an integral along the arm (the principle of virtual
work). With K the derivative of a cross-section's wrench in its strains v, twist' that of (kappa,
nu), and A the local moment and force of a force and moment at the point,

    dv = K^-1 A (f, m),        d(pose) = integral of A^T twist' dv ds.

The quadrature is collocation's, stage for stage, so that its order is that of the loaded equations.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache

import casadi as ca
import numpy as np

from model.cross_section.law import CrossSection, forces, moments, size
from model.cross_section.sections import Sections
from model.machine.buffered import Buffered
from model.machine.compiled import kernel
from model.paths import Array
from model.rotations import half_turn, multiply, unit_matrix
from model.transcription.collocation import gauss, rotation_vectors, weighted_sum
from model.transcription.layout import POSE
from model.transcription.system import System
from model.unloaded.settled_sections import settled_sections

_ROUNDING = 4 * np.finfo(float).eps


@dataclass(frozen=True, eq=False)
class UnloadedSensitivities:
    """See Sensitivities, which has the same for arms with loads.

    Attributes
    ----------
    system : System
    tensions : (n_tendons,)
        [N].
    strains : (P, n)
        Those at the stages under these tensions.
    node : int
        The node that is pushed and watched.
    """

    system: System
    tensions: Array
    strains: Array
    node: int

    @cached_property
    def pose_wrench(self) -> Array:
        """Displacement [m] and rotation [rad] per force [N] and moment [N m] (6, 6), base frame."""
        return self._pose(self._by_wrench)

    @cached_property
    def pose_tension(self) -> Array:
        """The same per newton in each tendon (6, n_tendons)."""
        return self._pose(self._by_tensions)

    @property
    def lengths(self) -> Array:
        """The lengths of the tendons (n_tendons,) [m]."""
        return self._lengths[0]

    @cached_property
    def length_wrench(self) -> Array:
        """Lengths of the tendons per force and moment (n_tendons, 6)."""
        return np.asarray(np.einsum("tpn,pnk->tk", self._lengths[1], self._by_wrench))

    @cached_property
    def length_tension(self) -> Array:
        """Lengths of the tendons per newton (n_tendons, n_tendons) [m/N]."""
        return np.asarray(np.einsum("tpn,pnk->tk", self._lengths[1], self._by_tensions))

    @cached_property
    def stable(self) -> bool:
        """Whether each cross-section is at a minimum of its energy, tensions held."""
        K = self._stiffness
        values = np.linalg.eigvalsh((K + K.transpose(0, 2, 1)) / 2)
        # Where a tendon has no length left it is stiff beyond all digits of the rest.
        return bool(np.all(values[:, 0] > -_ROUNDING * values[:, -1]))

    @property
    def _law(self) -> CrossSection:
        return self.system.of.form.law

    @cached_property
    def _weights(self) -> Array:
        """Those of the quadrature (P,) [m]."""
        return np.outer(np.diff(self.system.mesh.s), gauss(self.system.of.form.stages).b).ravel()

    @property
    def _sections(self) -> Sections:
        return settled_sections(self.system).sections

    @cached_property
    def _pulls(self) -> Array:
        return self._sections.pulls(self.tensions)

    @cached_property
    def _stiffness(self) -> Array:
        """How the wrench of cross-sections changes with their strains (P, n, n)."""
        return self._sections.wrench(self.strains, self._pulls)[1]

    @cached_property
    def _by_tensions(self) -> Array:
        return self._sections.by_tensions(self.strains, self._pulls)

    @cached_property
    def _by_wrench(self) -> Array:
        """How strains change with a force and moment at the node (P, n, 6)."""
        return np.asarray(np.linalg.solve(self._stiffness, self._reach[0]))

    @cached_property
    def _lengths(self) -> tuple[Array, Array]:
        return self._sections.length_jacobian(self.strains, self._weights)

    @cached_property
    def _reach(self) -> tuple[Array, Array]:
        """What a force and moment at the node work on at the stages, and how strains move it.

        (P, n, 6) both, 0 beyond the node: the second is A^T twist' above, transposed, times the
        weights of the quadrature.
        """
        of, mesh, P = self.system.of, self.system.mesh, len(self.strains)
        poses = self.system.marched(self.strains)
        call = _reach(self._law, of.form.stages, mesh.steps, of.form.machine_code)
        point = poses[self.node, 4:]
        found = call(poses[:-1].ravel(), self.strains.ravel(), np.diff(mesh.s), point)
        works, moves = (part.reshape(P, 6, -1).transpose(0, 2, 1) for part in found)
        beyond = self.node * of.form.stages
        works[beyond:] = moves[beyond:] = 0.0
        return works, moves * self._weights[:, None, None]

    def _pose(self, strains: Array) -> Array:
        """Return displacement and rotation (6, k) of the node that changes of strains are."""
        moves = self._reach[1].reshape(-1, 6)
        return np.asarray(moves.T @ strains.reshape(len(moves), -1))


@lru_cache(maxsize=32)
def _reach(law: CrossSection, stages: int, elements: int, machine_code: bool) -> Buffered:
    """Return (pose at the first node, strains, h, point) -> what `_reach` is told of, by columns.

    For all elements, whose stages follow each other; the point is the same for all.
    """
    g, h, point = ca.SX.sym("g", POSE), ca.SX.sym("h"), ca.SX.sym("point", 3)
    v = ca.SX.sym("v", size(law), stages)
    twists = [law.twist(one) for one in ca.horzsplit(v)]
    *turns, _ = rotation_vectors([kappa for kappa, _ in twists], h)
    frames = [unit_matrix(multiply(g[:4], half_turn(turn))) for turn in turns]
    along = [R @ nu for R, (_, nu) in zip(frames, twists, strict=True)]
    places = [g[4:] + h * weighted_sum(row, along) for row in gauss(stages).a]
    own, works, moves = [*moments(law), *(3 + k for k in forces(law))], [], []
    for R, u, one, twist in zip(frames, places, ca.horzsplit(v), twists, strict=True):
        A = ca.blockcat([[R.T @ ca.skew(point - u), R.T], [R.T, ca.SX(3, 3)]])
        works.append(A[own, :])
        moves.append(ca.jacobian(ca.vertcat(*twist), one).T @ A)
    found = [ca.densify(ca.horzcat(*map(ca.vec, part))) for part in (works, moves)]
    reach = ca.Function("reach", [g, ca.vec(v), h, point], found, {"cse": True})
    return Buffered(kernel(reach, machine_code).map("reach", "serial", elements, [3], []))
