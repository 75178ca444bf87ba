"""What targets ask of the settled arm, contact included, and how that moves with the tensions.

By the implicit function theorem through the equations of equilibrium, what touches held shut. Where
contact comes or goes the derivatives jump; the values do not.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import casadi as ca
import numpy as np

from model.arm import Arm
from model.equilibrium.linearised import Linearised
from model.paths import Array
from model.scene import Scene
from model.transcription.layout import POSE
from planner.contact.equilibria import Equilibria, equilibria
from planner.contact.grasp_terms import GraspTerms, grasp_terms
from planner.contact.pieces import piece_margins
from planner.program.limits import natural_tensions
from planner.program.terms import KINDS, stations_of, term_names, terms_function
from planner.targets.base import Target
from planner.targets.hold import Hold
from planner.targets.wrap import CLEAR


@dataclass(frozen=True, eq=False)
class SettledTerms:
    """The terms of targets at tensions.

    Attributes
    ----------
    here : Linearised
        The equilibrium.
    snaps : tuple of float
        The shares of the load path at which the arm jumped.
    values, jacobian : by kind
        Terms (n,), and their derivatives by the tensions (n, n_tendons). Behind the inequalities of
        targets are those of the piece, see planner.contact.pieces.
    inequalities : int
        How many are the targets'.
    grasps : tuple of GraspTerms
        Of the targets that hold, in their order; their terms come behind those of poses.
    """

    here: Linearised
    snaps: tuple[float, ...]
    values: dict[str, Array]
    jacobian: dict[str, Array]
    inequalities: int
    grasps: tuple[GraspTerms, ...] = ()

    @property
    def tangential(self) -> Array:
        """Tangential forces (n_z,), over what is held."""
        return np.concatenate([np.zeros(0), *(own.tangential for own in self.grasps)])

    @property
    def tensions(self) -> Array:
        """[N] (n_tendons,)."""
        return self.here.tensions


@dataclass(frozen=True, eq=False)
class Settling:
    """Settles an arm on meshes of a refinement, and evaluates targets.

    Attributes
    ----------
    arm, scene, targets
        What is asked.
    refinement : int
    machine_code : bool
    history : tuple of (n_tendons,)
        With friction the load path from whose end the arm moves, in a straight line of tensions.
    """

    arm: Arm
    scene: Scene
    targets: tuple[Target, ...]
    refinement: int
    machine_code: bool = False
    history: tuple[tuple[float, ...], ...] = ()

    @cached_property
    def _equilibria(self) -> Equilibria:
        mesh = stations_of(self.arm, self.targets), self.refinement
        return equilibria(self.arm, self.scene, *mesh, self.machine_code, self.history)

    @cached_property
    def _force(self) -> float:
        """A unit of contact forces [N]."""
        return float(natural_tensions(self.arm).min())

    @cached_property
    def _terms(self) -> tuple[ca.Function, ca.Function]:
        """(poses, numbers -> terms by kind), and their derivatives by the poses."""
        terms = terms_function(self.arm, self.targets)
        poses = ca.MX.sym("poses", *terms.size_in(0))
        numbers = ca.MX.sym("numbers", *terms.size_in(1))
        found = list(terms(poses, numbers, ca.MX(0, 1)))
        # Contact keeps gaps open by itself; where it does they do not move with the tensions.
        inequalities = term_names(self.arm, self.targets)[KINDS.index("inequality")]
        kept = [i for i, name in enumerate(inequalities) if name != CLEAR]
        found[KINDS.index("inequality")] = found[KINDS.index("inequality")][kept]
        jacobian = [ca.densify(ca.jacobian(value, poses)) for value in found]
        given, values = [poses, numbers], found
        return ca.Function("terms", given, values), ca.Function("jacobian", given, jacobian)

    def at(
        self, tensions: Array, near: SettledTerms | None = None, tangential: Array | None = None
    ) -> SettledTerms:
        """Return the terms where the arm comes to, from rest or from another equilibrium.

        With tangential forces (n_z,) of holds; the best ones unless given. Raises SnapError where
        it comes to none, and near another where it would jump.
        """
        before = None if near is None else (near.here, near.snaps)
        here, snaps = self._equilibria.at(tensions, before)
        values, jacobian = self._of_poses(here)
        grasps = self._grasps(here, near, tangential)
        z = np.cumsum([0, *(own.tangential.size for own in grasps)])
        for kind in values:
            jacobian[kind] = np.hstack([jacobian[kind], np.zeros((values[kind].size, z[-1]))])
        for own, first, last in zip(grasps, z[:-1], z[1:], strict=True):
            for kind, value, slope in (
                ("equality", own.equality, own.equality_jacobian),
                ("inequality", own.inequality, own.inequality_jacobian),
            ):
                wide = np.zeros((value.size, jacobian[kind].shape[1]))
                wide[:, : tensions.size] = slope[:, : tensions.size]
                wide[:, tensions.size + first : tensions.size + last] = slope[:, tensions.size :]
                values[kind] = np.append(values[kind], value)
                jacobian[kind] = np.vstack([jacobian[kind], wide])
        inequalities = values["inequality"].size
        own_values, own_jacobian = piece_margins(here, self._force)
        values["inequality"] = np.append(values["inequality"], own_values)
        none = np.zeros((own_values.size, z[-1]))
        jacobian["inequality"] = np.vstack(
            [jacobian["inequality"], np.hstack([own_jacobian, none])]
        )
        return SettledTerms(here, snaps, values, jacobian, inequalities, grasps)

    def _of_poses(self, here: Linearised) -> tuple[dict[str, Array], dict[str, Array]]:
        """Return the terms of poses, and their derivatives by the tensions."""
        mesh, of = here.system.mesh, here.system.of
        nodes = [mesh.node(s) for s in stations_of(self.arm, self.targets)]
        places = of.nodes[nodes, :POSE]
        poses = here.states[places]
        numbers = np.concatenate([target.parameters(self.arm) for target in self.targets])
        moved = here.by_tensions[places.ravel()]
        values, jacobian = (function(poses.T, numbers) for function in self._terms)
        found = {kind: np.array(v).ravel() for kind, v in zip(KINDS, values, strict=True)}
        rates = {
            kind: np.array(J).reshape(-1, places.size) @ moved
            for kind, J in zip(KINDS, jacobian, strict=True)
        }
        return found, rates

    def _grasps(
        self, here: Linearised, near: SettledTerms | None, tangential: Array | None
    ) -> tuple[GraspTerms, ...]:
        """Return the terms of what is held."""
        found, first = list[GraspTerms](), 0
        holds = [target for target in self.targets if isinstance(target, Hold)]
        for i, hold in enumerate(holds):
            before = near.grasps[i] if near is not None else None
            own = None
            if before is not None and tangential is not None:
                own = tangential[first : first + before.tangential.size]
                first += before.tangential.size
            found.append(grasp_terms(here, hold, before, own))
        return tuple(found)
