"""The centrelines of an arm under one set of tensions after another, and on its way."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from functools import cached_property
from typing import Any

import numpy as np

from octoplan.model.arm import Arm
from octoplan.model.centreline import Centreline, Counts
from octoplan.model.cross_section.law import cross_section_of
from octoplan.model.cross_section.sections import Sections, strains_of
from octoplan.model.equilibrium.collocation_map import CollocationMap
from octoplan.model.equilibrium.explicit import ClosedForm
from octoplan.model.equilibrium.linearised import Equilibrium
from octoplan.model.equilibrium.newton import STAGES, Start, newton
from octoplan.model.equilibrium.stability import is_stable
from octoplan.model.extensions.clearance.pieces import DeviationBound
from octoplan.model.extensions.printed import PrintedStatics
from octoplan.model.loads import is_coupled
from octoplan.model.paths import Array
from octoplan.model.rod.collocation import MAGNUS6
from octoplan.model.rod.discrete_rod import system
from octoplan.model.scene import Scene
from octoplan.model.support.checks import SMALLEST
from octoplan.model.support.errors import Described, InputError, OctoplanError
from octoplan.model.tendons import tendon_lengths
from octoplan.planner.extensions.avoidance.strain_bounds import estimated, proven

# Which stretches (K,) and shares of them (K,) -> tensions (K, n_tendons), on a straight line each.
Tensions = Callable[[Counts, Array], Array]


class Lines:
    """Tensions to centrelines, on one mesh that has given arc lengths as nodes.

    Without loads the shape is a closed form of the tensions. Under loads the equilibrium is solved
    near the known equilibria, and from rest if this fails. Raises InputError for printed statics,
    whose equations differ.
    """

    def __init__(
        self, arm: Arm, scene: Scene, refinement: int, at: tuple[float, ...], machine_code: bool
    ) -> None:
        if scene.has(PrintedStatics):
            allowed = "a scene whose statics are consistent: motions as printed are not cleared"
            raise InputError("scene", Described("a scene as printed"), allowed)
        self.arm, self.scene, self.loaded = arm, scene, is_coupled(arm, scene)
        self._machine_code = machine_code
        self._forward: Any = (
            CollocationMap(system(arm, scene, STAGES, refinement, at, True, machine_code))
            if self.loaded
            else ClosedForm(arm, scene, MAGNUS6, refinement, at, machine_code)
        )
        self._controls, self._states = np.zeros((0, arm.n_tendons)), list[Array]()

    def __call__(self, tensions: Array) -> Centreline | None:
        """Return the centreline under tensions (n_tendons,); None without an equilibrium."""
        forward = self._forward
        if self.loaded:
            point = self._equilibrium(tensions)
            return None if point is None else Centreline.at_states(point.system, point.states)
        poses, strains = forward.run(tensions)
        if np.isnan(poses[-1]).any():
            return None
        law, inner = self.sections.law, strains[: forward.mesh.elements * STAGES]
        at = self.arm, self.scene, forward.mesh.s
        return Centreline.at_strains(*at, poses, law, strains_of(law, inner))

    def lengths(self, tensions: Array) -> Array:
        """Return the lengths of the tendons (n_tendons,) [m]; NaN where the arm does not stand."""
        if not self.loaded:
            return tendon_lengths(self.arm, self.scene, self._machine_code)(tensions).lengths
        point = self._equilibrium(tensions)
        if point is None or not is_stable(point):
            return np.full(self.arm.n_tendons, np.nan)
        return point.lengths

    @cached_property
    def sections(self) -> Sections:
        """The cross-sections at the stages, of a scene without loads."""
        at, _, active = self._forward.mesh.points(STAGES)
        law = cross_section_of(self.scene, self.arm.is_curved, twisted=False)
        return Sections(self.arm, self.scene, law, at, active)

    def _equilibrium(self, tensions: Array) -> Equilibrium | None:
        """Return the equilibrium under tensions (n_tendons,), or None.

        The start is interpolated between the equilibria of the two nearest tensions. If this fails,
        the arm starts at rest.
        """
        return self._near(self._forward, tensions, tensions)

    def _near(
        self, forward: CollocationMap, tensions: Array, controls: Array
    ) -> Equilibrium | None:
        """Return the equilibrium of a forward map, from the known ones with the nearest controls.

        Controls are the tensions, and further numbers if the map has any.
        """
        point = None
        if self._states:
            far = np.linalg.norm(self._controls - controls, axis=1)
            a, b = np.argsort(far, kind="stable")[:2][[0, -1]]
            way = self._controls[b] - self._controls[a]
            share = (controls - self._controls[a]) @ way / max(float(way @ way), SMALLEST)
            guess = self._states[a] + np.clip(share, 0, 1) * (self._states[b] - self._states[a])
            (point,) = newton(forward.system, [Start(tensions, 1.0, guess)])
        with suppress(OctoplanError):
            point = point or forward.solve(tensions)
        if point is None:
            return None
        self._controls = np.vstack([self._controls.reshape(-1, controls.size), controls])
        self._states.append(point.states)
        return point


class Moving:
    """The way of an arm whose tensions change steadily.

    See octoplan.model.extensions.clearance.bisection.Motion.
    """

    def __init__(self, lines: Lines, tensions: Tensions) -> None:
        self._lines, self._tensions = lines, tensions
        self._known: dict[tuple[int, float], Centreline | None] = {}

    def lines(self, stretch: Counts, share: Array) -> list[Centreline | None]:
        """See Motion.lines."""
        keys = list(zip(stretch.tolist(), share.tolist(), strict=True))
        for key, T in zip(keys, self._tensions(stretch, share), strict=True):
            if key not in self._known:
                self._known[key] = self._lines(T)
        return [self._known[key] for key in keys]

    def deviation_bound(self, stretch: Counts, start: Array, end: Array) -> DeviationBound:
        """Return how far strains are from straight lines from shares (P,) to others.

        Proven without loads, estimated under loads; see
        octoplan.planner.extensions.avoidance.strain_bounds.
        """
        ends = np.array([_strains(self.lines(stretch, share)) for share in (start, end)])
        if not self._lines.loaded:
            T = np.array([self._tensions(stretch, share) for share in (start, end)])
            return proven(self._lines.sections, T, ends[..., 1:4])
        halfway = _strains(self.lines(stretch, (start + end) / 2))
        return estimated(ends, halfway, self._lines.arm.length)


def _strains(lines: list[Centreline | None]) -> Array:
    """Return kappa and nu (K, N, 6) at the stages of arms; NaN, or (K, 1, 6), without them."""
    none = np.full((1, 6), np.nan)
    rows = [
        none if line is None else np.concatenate([line.kappa, line.nu], axis=2).reshape(-1, 6)
        for line in lines
    ]
    return np.array(np.broadcast_arrays(*rows))
