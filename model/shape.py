"""A settled shape: numbers, and what can be read off them anywhere along the arm."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from model.arm import Arm
from model.checks import finite_array
from model.errors import InputError
from model.forward import ForwardMap, forward_map
from model.integrators.magnus import MAGNUS6
from model.paths import Array
from model.response.tendon_lengths import tendon_lengths
from model.rotations import matrices
from model.scene import Scene
from model.unloaded.closed_form import nodes_of


@dataclass(frozen=True, eq=False)
class Shape:
    """The shape that an arm takes under given tensions.

    Attributes
    ----------
    arm, scene
        What was settled.
    tensions : (n_tendons,)
        [N], tendon order.
    error : float
        Estimated tip error over arm length [-].
    scheme, refinement
        The integrator and mesh that were used.
    states : (S + 1, 7 or more)
        Poses (quaternion, position [m]) at the nodes of that mesh, then what else it carries.
    """

    arm: Arm
    scene: Scene
    tensions: Array
    error: float
    scheme: str
    refinement: int
    states: Array

    @property
    def tip(self) -> Array:
        """Position of the tip (3,) in the base frame [m]."""
        return self.states[-1, 4:7].copy()

    @property
    def tip_frame(self) -> Array:
        """Frame of the tip (3, 3): columns t, n, b."""
        return matrices(self.states[-1, :4])

    @property
    def s(self) -> Array:
        """Arc lengths of the mesh's nodes (S + 1,) [m]."""
        return self._map.mesh.s.copy()

    def position(self, s: Any) -> Array:
        """Return positions [m], (3,) or (N, 3), at arc length s [m], a scalar or (N,)."""
        return self._at(s, lambda pose, _: pose[:, 4:7])

    def frame(self, s: Any) -> Array:
        """Return frames, (3, 3) or (N, 3, 3), columns t, n, b, at arc length s [m]."""
        return self._at(s, lambda pose, _: matrices(pose[:, :4]))

    def poses(self, s: Any) -> Array:
        """Return poses (quaternion, position [m]), (7,) or (N, 7), at arc length s [m]."""
        return self._at(s, lambda pose, _: pose)

    def strain(self, s: Any) -> Array:
        """Return strains (tau, xi, k, q), (4,) or (N, 4), at arc length s [m].

        Curvatures are about t, n, b per unit deformed length [1/m], q is the longitudinal strain
        [-]; at an anchorage, those on its base side (the paper's half-open domains).
        """
        return self._at(s, lambda _, strain: strain[:, :4], strains=True)

    @cached_property
    def tendon_lengths(self) -> Array:
        """Length of each tendon from base to anchorage (n_tendons,) [m], tendon order.

        The integral of ``|du_c/ds|`` by Gauss quadrature on the mesh; see response.tendon_lengths.
        """
        mesh = self._map.mesh
        s = nodes_of(MAGNUS6, mesh.s[:-1], mesh.s[1:])
        weight = (np.diff(mesh.s)[:, None] * np.array(MAGNUS6.weights)).ravel()
        return tendon_lengths(
            self.arm, self.scene, s, weight, self._at(s, lambda _, e: e, strains=True)
        )

    @property
    def _map(self) -> ForwardMap:
        return forward_map(self.arm, self.scene, self.scheme, self.refinement)

    def _at(self, s: Any, read: Any, strains: bool = False) -> Array:
        wanted = finite_array("s", np.atleast_1d(s), (None,))
        L = self.arm.length
        if wanted.size and (wanted.min() < 0 or wanted.max() > L * (1 + 1e-12)):
            raise InputError("s", s, f"arc lengths from 0 to {L:g} m")
        if not wanted.size:
            return np.asarray(read(np.ones((0, 7)), np.ones((0, 4))))
        pose, strain = self._read(np.minimum(wanted, L), strains)
        values = np.asarray(read(pose, strain))
        return values[0] if np.ndim(s) == 0 else values

    def _read(self, s: Array, strains: bool) -> tuple[Array, Array]:
        """Return poses and strains at s; poses alone where all of s are nodes of the mesh."""
        nodes = self._map.mesh.s
        near = np.minimum(np.searchsorted(nodes, s), nodes.size - 1)
        if not strains and np.array_equal(nodes[near], s):
            return self.states[near, :7], np.zeros((s.size, 4))
        return self._map.dense(self.tensions, self.states, s)
