"""An arm without loads verified by initial value integration from its base.

Nothing couples its cross-sections: their strains balance what the tendons pull, tendon by tendon,
by a Newton step from those that settle them, and eq. (1) of the pose is integrated by an explicit
Runge-Kutta scheme. Steps are halved until two of them differ by less than an accuracy.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise

import casadi as ca
import numpy as np

from model.arm import Arm
from model.centreline import Centreline
from model.cross_section.law import CrossSection, size
from model.equilibrium.forward import STAGES
from model.equilibrium.integration_step import SCHEME
from model.equilibrium.stability import least_of_sections
from model.equilibrium.verification import SUBSTEPS
from model.errors import ConvergenceError
from model.machine.buffered import Buffered
from model.machine.compiled import kernel
from model.mesh import Mesh, graded
from model.mesh_refinement import estimate
from model.paths import Array
from model.rotations import multiply, unit_matrix
from model.scene import Scene
from model.stations import base_pose
from model.time_limit import check_time
from model.transcription.collocation import gauss
from model.transcription.system import form_of
from model.unloaded.settled_sections import SettledSections

# Strains that change by less in a Newton step, relative to their size and 1, balance: what is left
# is its square.
_LINEAR, _PASSES = 1e-5, 8


@dataclass(frozen=True, eq=False)
class Integrated:
    """An arm without loads as an initial value integrator has it.

    Attributes
    ----------
    poses : (N + 1, 7)
        At the nodes of a mesh.
    error : float
        Estimated error of the tip, over arm length.
    stability : float
        The least eigenvalue of the scaled Hessians of the cross-sections' energies.
    """

    arm: Arm
    scene: Scene
    mesh: Mesh
    tensions: Array
    poses: Array
    error: float
    stability: float
    machine_code: bool

    def centreline(self) -> Centreline:
        """Return the midline, whose strains are settled at the stages of the elements."""
        mesh = self.mesh
        inside = mesh.s[:-1, None] + np.diff(mesh.s)[:, None] * gauss(STAGES).c
        sections = _settled(self.arm, self.scene, mesh, inside, self.machine_code)
        parts = (self.arm, self.scene, mesh.s, self.poses, sections.sections.law)
        return Centreline.at_strains(*parts, sections.strains(self.tensions))


def integrated(
    arm: Arm,
    scene: Scene,
    tensions: Array,
    stations: tuple[float, ...],
    accuracy: float,
    refinement: int,
    machine_code: bool,
) -> Integrated:
    """Return the arm under tensions (n_tendons,), with `stations` among the nodes.

    `refinement` is that of the mesh whose steps are halved.

    Raises ConvergenceError where halved steps do not come to the accuracy, and
    UnsettledSectionError where a section does not settle.
    """
    scale, error = np.repeat([1.0, arm.length], [4, 3]), np.inf
    for pair in pairwise(SUBSTEPS):
        check_time()
        steps = _steps(arm, scene, stations, refinement, pair, machine_code)
        (rough, fine), stability = steps.poses(tensions)
        error = estimate(float(np.abs((fine - rough) / scale).max()), 1, 2, SCHEME.order)
        if error <= accuracy:
            of = (arm, scene, steps.mesh, tensions, fine, error, stability, machine_code)
            return Integrated(*of)
    raise ConvergenceError(accuracy, error, f"its check by {SCHEME.name} does not converge")


class _Steps:
    """The places of the scheme's nodes in each element's steps: of few, then of more of them."""

    def __init__(
        self,
        arm: Arm,
        scene: Scene,
        stations: tuple[float, ...],
        refinement: int,
        pair: tuple[int, int],
        machine_code: bool,
    ) -> None:
        self.mesh, self.pair, self.base = graded(arm, refinement, stations), pair, base_pose(arm)
        s, h = self.mesh.s, np.diff(self.mesh.s)
        shares = [(np.arange(k)[:, None] + np.array(SCHEME.samples)) / k for k in pair]
        inside = np.hstack([s[:-1, None] + h[:, None] * share.ravel() for share in shares])
        self.settled = _settled(arm, scene, self.mesh, inside, machine_code)
        law, self.lengths = self.settled.sections.law, [np.repeat(h / k, k) for k in pair]
        self.marches = [_march(law, own.size, machine_code) for own in self.lengths]

    def poses(self, tensions: Array) -> tuple[list[Array], float]:
        """Return the poses at the nodes of the mesh (N + 1, 7) by each, and the stability."""
        v, stability = self._strains(tensions)
        by_element, found, first = v.reshape(self.mesh.steps, -1, v.shape[1]), [], 0
        for k, h, march in zip(self.pair, self.lengths, self.marches, strict=True):
            last = first + k * len(SCHEME.samples)
            (after,) = march(self.base, by_element[:, first:last].ravel(), h)
            found.append(np.vstack([self.base, after[k - 1 :: k]]))
            first = last
        return found, stability

    def _strains(self, tensions: Array) -> tuple[Array, float]:
        """Return the strains that balance (places, n), NaN where none do, and the stability."""
        sections = self.settled.sections
        v, pulls = self.settled.strains(tensions), sections.pulls(tensions)
        for _ in range(_PASSES):
            wrench, jacobian = sections.wrench(v, pulls)
            try:
                step = np.linalg.solve(jacobian, wrench[:, :, None])[:, :, 0]
            except np.linalg.LinAlgError:
                break
            v = v - step
            if not float((np.abs(step) / (1 + np.abs(v))).max()) > _LINEAR:
                return v, least_of_sections(sections, jacobian, np.s_[::2])
        return np.full_like(v, np.nan), np.nan


def _settled(
    arm: Arm, scene: Scene, mesh: Mesh, inside: Array, machine_code: bool
) -> SettledSections:
    """Return the cross-sections inside of elements at s (N, places)."""
    law = form_of(scene, arm.is_curved, STAGES, True, machine_code).law
    active = np.repeat(mesh.active, inside.shape[1])
    return SettledSections(arm, scene, law, inside.ravel(), active, machine_code)


@lru_cache(maxsize=32)
def _steps(
    arm: Arm,
    scene: Scene,
    stations: tuple[float, ...],
    refinement: int,
    pair: tuple[int, int],
    machine_code: bool,
) -> _Steps:
    return _Steps(arm, scene, stations, refinement, pair, machine_code)


@lru_cache(maxsize=32)
def _march(law: CrossSection, count: int, machine_code: bool) -> Buffered:
    """Return (pose, strains at the scheme's nodes of each of so many steps, h) -> poses after."""
    n, nodes = size(law), len(SCHEME.samples)
    g, v, h = ca.SX.sym("g", 7), ca.SX.sym("v", n * nodes), ca.SX.sym("h")
    twists = [law.twist(own) for own in ca.vertsplit(v, n)]

    def rate(i: int, y: ca.SX) -> ca.SX:
        kappa, nu = twists[SCHEME.samples.index(SCHEME.nodes[i])]
        return ca.vertcat(multiply(y[:4], ca.vertcat(0, kappa)) / 2, unit_matrix(y[:4]) @ nu)

    step = ca.Function("marched", [g, v, h], [SCHEME.step(rate, g, h)], {"cse": True})
    return Buffered(kernel(step, machine_code).mapaccum(count))
