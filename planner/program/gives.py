"""How the tip gives way along directions, inside a program of an arm without loads."""

from __future__ import annotations

from functools import lru_cache

import casadi as ca

from model.arm import Arm
from model.forward import SCHEMES
from model.integrators.magnus import MAGNUS6, Magnus
from model.loaded.small_systems import DENSE
from model.mesh import graded
from model.response.compliance import ClosedCompliance
from model.response.give import closed_give
from model.scene import Scene
from model.stiffness import least_give
from planner.targets.base import Look


@lru_cache(maxsize=64)
def tip_give(arm: Arm, scene: Scene, scheme: str, refinement: int, look: Look) -> ca.Function:
    """Return (tensions, D (3, m)) -> D^T C D (m, m) of an arm without loads.

    Where the poses are integrated by other schemes, this is still by the sixth-order Magnus one.
    """
    named = SCHEMES[scheme]
    method = named if isinstance(named, Magnus) else MAGNUS6
    T, D = ca.MX.sym("T", arm.n_tendons), ca.MX.sym("D", 3, look.width)
    find = _locked if look.hold == "length" else _free
    C = find(arm, scene, method, refinement, look, T)
    return ca.Function("give", [T, D], [ca.densify(D.T @ C[:3, :3] @ D)])


def _free(arm: Arm, scene: Scene, scheme: Magnus, refinement: int, _: Look, T: ca.MX) -> ca.MX:
    return closed_give(arm, scene, scheme, refinement, arm.length)(T)


def _locked(arm: Arm, scene: Scene, scheme: Magnus, refinement: int, look: Look, T: ca.MX) -> ca.MX:
    mesh = graded(arm, refinement)
    slopes = ClosedCompliance(arm, scene, mesh, scheme, arm.length, True).function
    C, pose_tension, lengths, drawn, spread = slopes(T)
    own = spread - least_give(arm) * ca.DM.eye(arm.n_tendons)
    if look.tendon_EA is not None:
        own -= ca.diag(lengths) / look.tendon_EA
    return C - pose_tension @ ca.solve(own, drawn, DENSE)
