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
from model.transcription.layout import POSE
from planner.contact.equilibria import Equilibria
from planner.contact.grasp_terms import GraspTerms, grasp_terms
from planner.contact.pieces import piece_margins
from planner.contact.standing import standing
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
    """Settles an arm, and evaluates targets.

    Attributes
    ----------
    equilibria : Equilibria
        Of the arm, on meshes with the targets' stations.
    targets
        What is asked.
    least : float
        The stability that is asked for, the last inequality of the targets; 0 where the arm only
        has to stand.
    """

    equilibria: Equilibria
    targets: tuple[Target, ...]
    least: float = 0.0
    pressed: float = 0.0

    @property
    def _arm(self) -> Arm:
        return self.equilibria.arm

    @cached_property
    def _force(self) -> float:
        """A unit of contact forces [N]."""
        return float(natural_tensions(self._arm).min())

    @cached_property
    def _terms(self) -> tuple[ca.Function, ca.Function]:
        """(poses, numbers -> terms by kind), and their derivatives by the poses."""
        terms = terms_function(self._arm, self.targets)
        poses = ca.MX.sym("poses", *terms.size_in(0))
        numbers = ca.MX.sym("numbers", *terms.size_in(1))
        found = list(terms(poses, numbers, ca.MX(0, 1)))
        # Contact keeps gaps open by itself; where it does they do not move with the tensions.
        inequalities = term_names(self._arm, self.targets)[KINDS.index("inequality")]
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
        here, snaps = self.equilibria.at(tensions, before)
        grasps = self._grasps(here, near, tangential)
        z = np.cumsum([0, *(own.tangential.size for own in grasps)]).tolist()
        rows = _Rows(*self._of_poses(here), z[-1])
        for own, first in zip(grasps, z[:-1], strict=True):
            rows.add("equality", own.equality, own.equality_jacobian, first)
            rows.add("inequality", own.inequality, own.inequality_jacobian, first)
        if self.least:
            units = natural_tensions(self._arm)
            rows.add("inequality", *standing(self.equilibria, (here, snaps), self.least, units))
        inequalities = rows.values["inequality"].size
        rows.add("inequality", *piece_margins(here, self._force, self.pressed))
        return SettledTerms(here, snaps, rows.values, rows.jacobian, inequalities, grasps)

    def _of_poses(self, here: Linearised) -> tuple[dict[str, Array], dict[str, Array]]:
        """Return the terms of poses, and their derivatives by the tensions."""
        mesh, of = here.system.mesh, here.system.of
        nodes = [mesh.node(s) for s in stations_of(self._arm, self.targets)]
        places = of.nodes[nodes, :POSE]
        poses = here.states[places]
        numbers = np.concatenate([target.parameters(self._arm) for target in self.targets])
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


class _Rows:
    """Terms (n,) and their derivatives (n, n_tendons + n_z), by kind."""

    def __init__(self, values: dict[str, Array], by_tensions: dict[str, Array], n_z: int) -> None:
        self.values, self.jacobian = values, dict[str, Array]()
        for kind, rows in by_tensions.items():
            self.n = rows.shape[1]
            self.jacobian[kind] = np.hstack([rows, np.zeros((len(rows), n_z))])

    def add(self, kind: str, values: Array, jacobian: Array, first: int = 0) -> None:
        """Append terms (k,), and derivatives by tensions and by numbers z from the first on."""
        wide = np.zeros((values.size, self.jacobian[kind].shape[1]))
        wide[:, : self.n] = jacobian[:, : self.n]
        beyond = jacobian[:, self.n :]
        wide[:, self.n + first : self.n + first + beyond.shape[1]] = beyond
        self.values[kind] = np.append(self.values[kind], values)
        self.jacobian[kind] = np.vstack([self.jacobian[kind], wide])
