"""The centreline between the nodes: positions, lengths, turned angles and outer radii.

Inside an element the strains are the polynomial through the stages. A part of an element is an
element itself, with the kinematics of octoplan.model.rod.element.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Protocol, runtime_checkable

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from octoplan.model.arm import Arm
from octoplan.model.cross_section.law import CrossSection, RubberSection
from octoplan.model.cross_section.sections import kinematics
from octoplan.model.effects.sections import NeoHookean
from octoplan.model.equilibrium.newton import STAGES
from octoplan.model.paths import SAME, Array
from octoplan.model.rod.collocation import gauss, rotation_vectors
from octoplan.model.rod.discrete_rod import DiscreteRod
from octoplan.model.rotations import half_turn, multiply, unit_matrix
from octoplan.model.scene import Scene
from octoplan.model.support.machine.functions import BatchFunction, cached

Counts = NDArray[np.int64]


@runtime_checkable
class Settled(Protocol):
    """A value with a settled centreline; see octoplan.model.shape.Shape."""

    def centreline(self) -> Centreline:
        """Return the centreline."""


@dataclass(frozen=True, eq=False)
class Centreline:
    """The settled centreline of an arm: a polynomial of strains in each element of a mesh.

    Attributes
    ----------
    arm : Arm
    scene : Scene
    s : (N + 1,)
        Arc lengths of the nodes [m].
    poses : (N + 1, 7)
        Quaternion and position [m] at the nodes.
    kappa, nu : (N, 3, 3)
        Curvature [1/m] and tangent [-] per unit reference length in (t, n, b), by element and
        stage.
    machine_code : bool
        Whether the kernel is compiled.
    """

    arm: Arm
    scene: Scene
    s: Array
    poses: Array
    kappa: Array
    nu: Array
    machine_code: bool = False

    @classmethod
    def at_states(cls, system: DiscreteRod, states: Array) -> Centreline:
        """Return the centreline of states (n_states,) with three stages per element."""
        structure = system.layout.structure
        result = cls.at_strains(
            system.arm,
            system.scene,
            system.mesh.s,
            system.poses(states),
            structure.law,
            states[system.layout.stages],
        )
        return replace(result, machine_code=structure.machine_code)

    @classmethod
    def at_strains(
        cls, arm: Arm, scene: Scene, s: Array, poses: Array, law: CrossSection, v: Array
    ) -> Centreline:
        """Return the centreline of strains v (N stages, n) of a law, and poses at the nodes."""
        kappa, nu = (values.reshape(-1, STAGES, 3) for values in kinematics(law, v))
        return cls(arm, scene, s, poses, kappa, nu)

    @classmethod
    def joined(cls, lines: Sequence[Centreline]) -> Centreline:
        """Return the centrelines of one arm and mesh in one, with N + 1 elements for each.

        The last element of each centreline connects to the next centreline and has no meaning.
        """
        first = lines[0]

        def padded(parts: list[Array]) -> Array:
            return np.concatenate([np.concatenate([part, part[-1:]]) for part in parts])

        kappa = padded([line.kappa for line in lines])
        nu = padded([line.nu for line in lines])
        s = np.tile(first.s, len(lines))
        poses = np.concatenate([line.poses for line in lines])
        return cls(first.arm, first.scene, s, poses, kappa, nu, first.machine_code)

    @cached_property
    def sizes(self) -> tuple[Array, Array]:
        """The length [m] and turned angle [rad] of each element (N,)."""
        weights = gauss(STAGES).b
        h = np.diff(self.s)
        kappa = self.kappa[: h.size]
        nu = self.nu[: h.size]
        lengths = h * (np.linalg.norm(nu, axis=2) @ weights)
        angles = h * (np.hypot(kappa[..., 1], kappa[..., 2]) @ weights)
        return lengths, angles

    def at(self, s: Array) -> tuple[Array, Array]:
        """Return positions (K, 3) and outer radii (K,) [m] at arc lengths (K,) [m]."""
        element, share = self._shares(s)
        return self.along(element, np.zeros(s.size), share)[0], self.radius(element, share)

    def turned(self, s: Array) -> Array:
        """Return the angle by which the tangent turns from the base to arc lengths (K,) [rad]."""
        element, share = self._shares(s)
        before = np.append(0.0, np.cumsum(self.sizes[1]))[element]
        return np.asarray(before + self.along(element, np.zeros(s.size), share)[2])

    def length(self, a: float, b: float) -> float:
        """Return the deformed length [m] between the arc lengths of two nodes [m]."""
        close = SAME * self.arm.length
        inside = np.flatnonzero((self.s[:-1] >= a - close) & (self.s[1:] <= b + close))
        return float(self.along(inside, np.zeros(inside.size), np.ones(inside.size))[1].sum())

    def _shares(self, s: Array) -> tuple[Counts, Array]:
        """Return the elements of arc lengths (K,), and the fractions of the elements before s."""
        element = np.clip(np.searchsorted(self.s, s, side="left") - 1, 0, self.s.size - 2)
        return element, (s - self.s[element]) / np.diff(self.s)[element]

    def along(self, element: Counts, start: Array, end: Array) -> tuple[Array, Array, Array]:
        """Return positions (K, 3) [m] at `end`; lengths [m] and angles [rad] (K,) from `start`.

        `start` and `end` are fractions from 0 to 1 of the elements (K,).
        """
        if not element.size:
            return np.zeros((0, 3)), np.zeros(0), np.zeros(0)
        h = np.diff(self.s)[element]
        part = cached(_part, self.machine_code)
        position, length, turn = part(
            self.poses[element], self.kappa[element], self.nu[element], h, start, end
        )
        return position, length[:, 0], turn[:, 0]

    def radius(self, element: Counts, share: Array) -> Array:
        """Return the outer radius of the arm (K,) [m] at fractions of elements.

        A body of constant volume and stretch lambda swells by lambda^(-1/2).
        """
        s = self.s[element] + share * np.diff(self.s)[element]
        outer = self.arm.outer_radius(s)[0]
        if not self.scene.has(NeoHookean):
            return np.asarray(outer)
        stretch = np.einsum("km,km->k", gauss(STAGES).at(share), self.nu[element, :, 0])
        return np.asarray(outer / np.sqrt(np.maximum(stretch, 1e-3)))


def stretch_beside(system: DiscreteRod, strains: Array) -> tuple[Array, Array]:
    """Return the stretch (N,) on both sides of all nodes except the base.

    The base side first. `strains` (N stages, strains) are at the stages.
    """
    method = gauss(system.layout.structure.stages)
    _, nu = kinematics(system.layout.structure.law, strains)
    stretch = nu[:, 0].reshape(system.mesh.elements, -1)
    before = stretch @ method.at(1.0)
    beyond = np.roll(stretch @ method.at(0.0), -1)
    beyond[-1] = before[-1]
    return before, beyond


def outer_radii(system: DiscreteRod, strains: Array) -> Array:
    """Return the outer radii (N,) [m] of all nodes except the base.

    A body of constant volume swells by lambda^(-1/2) if it is shortened to lambda. If the strains
    (N stages, strains) jump at a node, the larger radius of both sides is returned.
    """
    radii = system.arm.outer_radius(system.mesh.s[1:])[0]
    if not isinstance(system.layout.structure.law, RubberSection):
        return radii
    return np.asarray(radii / np.sqrt(np.minimum(*stretch_beside(system, strains))))


def _part(machine_code: bool) -> BatchFunction:
    """Return pose, kappa, nu by stage, h, fractions a, b -> position at b; length, angle from a."""
    g = ca.SX.sym("g", 7)
    h = ca.SX.sym("h")
    kappa = ca.SX.sym("kappa", 3, STAGES)
    nu = ca.SX.sym("nu", 3, STAGES)
    a = ca.SX.sym("a")
    b = ca.SX.sym("b")
    method = gauss(STAGES)

    def strains(share: ca.SX) -> tuple[ca.SX, ca.SX]:
        powers = ca.vertcat(*(share**p for p in range(STAGES)))
        weights = ca.DM(method.powers).T @ powers
        return kappa @ weights, nu @ weights

    inside = [strains(b * c) for c in method.c.tolist()]
    turns = rotation_vectors([k for k, _ in inside], h * b)[:-1]
    frames = [unit_matrix(multiply(g[:4], half_turn(turn))) for turn in turns]
    position = g[4:]
    length = ca.SX(0)
    turned = ca.SX(0)
    for weight, c, R, (_, v) in zip(
        method.b.tolist(), method.c.tolist(), frames, inside, strict=True
    ):
        position += h * b * weight * (R @ v)
        k, v = strains(a + (b - a) * c)
        length += h * (b - a) * weight * ca.norm_2(v)
        turned += h * (b - a) * weight * ca.sqrt(k[1] ** 2 + k[2] ** 2)
    arguments = [g, ca.vec(kappa), ca.vec(nu), h, a, b]
    result = ca.Function("part", arguments, [position, length, turned], {"cse": True})
    return BatchFunction(result, machine_code)
