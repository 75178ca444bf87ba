"""A settled shape: numbers, and what can be read off them anywhere along the arm."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from model.arm import Arm
from model.checks import finite_array
from model.contact.contacts import Touch, touches_of
from model.contact.forward import TouchingMap
from model.contact.stability import held_stability
from model.cross_section import cross_section_of
from model.cross_section.reported import strains_of
from model.cross_section.sections import Sections
from model.effects import PrintedStatics
from model.equilibrium.complementarity import unfelt
from model.equilibrium.forward import STAGES, Collocation
from model.equilibrium.stability import stability
from model.errors import InputError
from model.forward import ForwardMap, by_collocation, forward_map
from model.loads import contacts, is_loaded
from model.paths import Array
from model.report import shape_text, tendon_table
from model.rotations import matrices
from model.scene import Scene
from model.text import in_notebook, plotted
from model.transcription.collocation import gauss
from model.unloaded.folded import folded
from model.unloaded.tendon_lengths import tendon_lengths
from model.winches import Winches, pulls

# What is left of a tendon, over the arm's length, from which on it is slack.
_LEFT = 1e-10
# Combinations of tensions that change lengths by less than this share of what others do, and which
# part in one counts.
_FELT, _PART = 1e-9, 1e-3


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
    machine_code : bool
        Whether compiled kernels settled it; what is read off it is found by them too.
    winches : Winches or None
        What held the tendons, if lengths were given.
    left : (n_tendons,) or None
        What is left then of tendons held by length, beyond their paths [m]; nan of others.
    snaps : tuple of float
        With contact, at which shares of tensions and loads the arm jumped on its way from rest.
    on_itself : tuple of Touch
        Where the arm presses on itself: two of each pair of places, from base to tip. The shape is
        that of the scene with these forces as point loads; so is its stability.
    before : (tensions, states) or None
        With friction of contacts, of the equilibrium before its last step: what has slipped since.
    """

    arm: Arm
    scene: Scene
    tensions: Array
    error: float
    scheme: str
    refinement: int
    states: Array
    machine_code: bool = False
    winches: Winches | None = None
    left: Array | None = None
    snaps: tuple[float, ...] = ()
    on_itself: tuple[Touch, ...] = ()
    before: tuple[Array, Array] | None = None

    @property
    def slack(self) -> NDArray[np.bool_]:
        """Whether each tendon is slack (n_sections, n), or (n_tendons,) where sections differ.

        One held by length that does not pull and has some of it left; one held by tension that does
        not pull. What pulls is decided by model.winches.pulls.
        """
        none = ~pulls(self.arm, self.tensions)
        if self.left is not None:
            none &= ~(self.left <= _LEFT * self.arm.length)
        return self.arm.by_section(none.astype(float)) > 0

    @cached_property
    def undetermined(self) -> tuple[str, ...]:
        """Names of the tendons that may pull otherwise while the lengths are the same; see settle.

        Such as two against each other where neither bends nor shortens the arm. Empty where no
        lengths were given.
        """
        if self.winches is None:
            return ()
        loaded = is_loaded(self.scene)
        mesh = STAGES, self.refinement, (), loaded, self.machine_code
        here = by_collocation(self.arm, self.scene, *mesh).found(self.tensions, self.known)
        taut = np.flatnonzero(self.winches.held & ~self.slack.ravel())
        found = here.length_tension[np.ix_(taut, taut)]
        idle = unfelt(np.diag(self.winches.stretch[taut]) - found, _FELT)
        return tuple(
            self.arm.tendon_name(int(j)) for j in taut[np.abs(idle).max(axis=0, initial=0) > _PART]
        )

    @cached_property
    def folded(self) -> float | None:
        """Where from the base a tendon has no length left [m], None where all have some.

        An arm does not bend so far: its body would be folded into itself. Exact tendons settle
        there without loads; with loads such tensions are refused.
        """
        asked = (self.arm, self.scene, self.tensions, self.refinement, self.machine_code)
        return folded(*asked)

    @property
    def lengths(self) -> Array:
        """Tendon lengths [m], a row a section as `Plan.lengths`, flat where sections differ."""
        return self.arm.by_section(self.tendon_lengths)

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

    def __repr__(self) -> str:
        own, lengths = self.arm.tendons_by_section, 1e3 * self.tendon_lengths
        tables = [
            tendon_table("tensions [N]", own, self.tensions),
            tendon_table("tendon lengths [mm]", own, lengths),
        ]
        return shape_text(tables, self.tip, self.tip_frame, self.error, self.folded)

    def _repr_html_(self) -> str:
        return in_notebook(self)

    def plot(self, ax: Any = None) -> Any:
        """Draw the arm in 3-D; returns a new Figure, or the 3-D axes if given. See plot_shape."""
        return plotted(self, ax)

    def strains(self, s: Any) -> Array:
        """Return tau, xi, k, q, and nu_n, nu_b with shear, (N, 4 or 6), at arc length s [m]."""
        return self._at(s, lambda _, strain: strain, strains=True)

    def tension(self, s: float) -> Array:
        """Return the tension of each tendon (n_tendons,) at arc length s, 0 beyond its end [N].

        With friction it falls along the arm; at an anchorage it is that on the base side.
        """
        place, forward = finite_array("s", np.atleast_1d(s), (1,)), self._map
        crosses = np.array([self.arm.sections[i].at >= place[0] for i, _ in self.arm.tendons])
        tendons = np.flatnonzero(crosses)
        found = np.zeros(crosses.size)
        found[tendons] = self.tensions[tendons]
        if isinstance(forward, Collocation):
            given = (place, np.zeros(tendons.size, dtype=int), tendons)
            found[tendons] = forward.pulls(self.tensions, self.states, *given)
        return found

    @cached_property
    def tendon_lengths(self) -> Array:
        """Length of each tendon from base to anchorage (n_tendons,) [m], tendon order.

        By collocation that of the stages, to which settles by lengths hold the tendons; otherwise
        the integral of ``|du_c/ds|`` by Gauss quadrature.
        """
        if isinstance(self._map, Collocation):
            return self._map.lengths(self.tensions, self.states)
        if not self.scene.has(PrintedStatics):
            return tendon_lengths(self.arm, self.scene, self.machine_code)(self.tensions).lengths
        mesh = self._map.mesh
        law = cross_section_of(self.scene, self.arm.is_curved)
        method, h = gauss(STAGES), np.diff(mesh.s)[:, None]
        s, weight = (mesh.s[:-1, None] + h * method.c).ravel(), (h * method.b).ravel()
        sections = Sections(self.arm, self.scene, law, s, np.repeat(mesh.active, STAGES))
        return sections.lengths(strains_of(law, self.strains(s)), weight)

    @cached_property
    def stability(self) -> float:
        """The least eigenvalue of the scaled Hessian of its energy; below 0 it does not stand.

        1 at rest without loads; see model.equilibrium.stability. Raises InputError as printed,
        where there is no energy.
        """
        if self.scene.has(PrintedStatics):
            raise InputError("scene", "as printed", "a scene whose equations hold under loads")
        mesh = (STAGES, self.refinement, (), True)
        forward = by_collocation(self.arm, self.scene, *mesh, self.machine_code)
        here = forward.found(self.tensions, self.known)
        return held_stability(here) if contacts(self.scene) else stability(here)

    @property
    def contacts(self) -> tuple[Touch, ...]:
        """What it leans on, from base to tip: obstacle, s [m], force (3,) [N] on it, gap [m]."""
        forward = self._map
        if not isinstance(forward, Collocation) or not contacts(self.scene):
            return self.on_itself
        known = self.known
        return touches_of(known.system, known.states, known.history)

    @property
    def known(self) -> Any:
        """The same equilibrium as another mesh takes it; None where the shape is explicit."""
        mesh = (self.scheme, self.refinement, ())
        forward = forward_map(self.arm, self.scene, *mesh, self.machine_code)
        if isinstance(forward, TouchingMap):
            return forward.known(self.states, self.before)
        return forward.known(self.states)

    @property
    def _map(self) -> ForwardMap:
        mesh = (self.scheme, self.refinement, ())
        forward = forward_map(self.arm, self.scene, *mesh, self.machine_code)
        return forward.settled(self.states) if isinstance(forward, TouchingMap) else forward

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
