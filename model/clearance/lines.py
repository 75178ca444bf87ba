"""The centrelines of an arm under one set of tensions after another."""

from __future__ import annotations

from typing import Any

import numpy as np

from model.arm import Arm
from model.centreline import Centreline
from model.effects import PrintedStatics
from model.equilibrium.forward import STAGES, Collocation
from model.equilibrium.linearised import Linearised
from model.equilibrium.newton import NEAR, newton, newton_many, step_size
from model.errors import InputError, OctoplanError
from model.forward import explicit_map
from model.loads import is_loaded
from model.paths import Array
from model.scene import Scene
from model.unloaded.tendon_lengths import tendon_lengths

# Closed forms whose nodes in a step are the stages of an element.
_SCHEME = "magnus6"
# The equations are linearised anew where shapes have changed by so much; see step_size.
_FAR = 0.05
# Of shapes on a way one in so many is followed; those between are settled side by side.
_APART = 4


class Lines:
    """Tensions to centrelines, on one mesh that has given arc lengths as nodes.

    Without loads the shape is a closed form of the tensions; under loads it is looked for near the
    one before. Raises InputError as printed, where other equations would tell of another shape.
    """

    def __init__(
        self, arm: Arm, scene: Scene, refinement: int, at: tuple[float, ...], machine_code: bool
    ) -> None:
        if scene.has(PrintedStatics):
            allowed = "a scene whose statics are consistent: motions as printed are not cleared"
            raise InputError("scene", "written as printed", allowed)
        self.arm = arm
        self._asked = (arm, scene, refinement, at, machine_code)
        self._last: Linearised | None = None

    def __call__(self, tensions: Array) -> Centreline | None:
        """Return the centreline under tensions (n_tendons,); None where the arm does not settle."""
        return self.many(tensions[None])[0]

    def many(self, tensions: Array) -> list[Centreline | None]:
        """Return the centrelines under tensions (K, n_tendons), None where one does not settle."""
        arm, scene, refinement, at, machine_code = self._asked
        if is_loaded(scene):
            stages = (STAGES, refinement, at, True, machine_code)
            return self._implicit(Collocation(arm, scene, *stages), tensions)
        forward: Any = explicit_map(arm, scene, _SCHEME, refinement, at, machine_code)
        law, own = forward.law, slice(forward.mesh.steps * STAGES)
        return [
            None
            if np.isnan(v[own]).any()
            else Centreline.at_strains(arm, scene, forward.mesh.s, forward.poses(v), law, v[own])
            for v in forward.strains_of_many(tensions)
        ]

    def lengths(self, tensions: Array) -> Array:
        """Return the lengths of the tendons (n_tendons,) [m] under tensions; NaN if unsettled."""
        arm, scene, refinement, at, machine_code = self._asked
        if not is_loaded(scene):
            return tendon_lengths(arm, scene, machine_code)(tensions).lengths
        stages = (STAGES, refinement, at, True, machine_code)
        here = self._followed(Collocation(arm, scene, *stages), tensions)
        return np.full(arm.n_tendons, np.nan) if here is None else here.lengths

    def _implicit(self, forward: Collocation, tensions: Array) -> list[Centreline | None]:
        """Return the centrelines one after the other; what is between them side by side."""
        system, states = forward.system, dict[int, Array]()
        for i in range(0, len(tensions), _APART):
            here = self._followed(forward, tensions[i])
            if here is not None:
                states[i] = here.states
        left = [i for i in range(len(tensions)) if i % _APART]
        between = [i for i in left if {i - i % _APART, i - i % _APART + _APART} <= states.keys()]
        if between:
            guesses = _between(tensions, between, states)
            heres = newton_many(system, tensions[between], 1.0, guesses, NEAR).solutions
            own = zip(between, heres, strict=True)
            states |= {i: here.states for i, here in own if here is not None}
        for i in left:
            here = None if i in states else self._followed(forward, tensions[i])
            if here is not None:
                states[i] = here.states
        return [
            Centreline.at_states(system, states[i]) if i in states else None
            for i in range(len(tensions))
        ]

    def _followed(self, forward: Collocation, tensions: Array) -> Linearised | None:
        """Return the equilibrium under tensions near the last one; None if there is none."""
        here, system, last, far = None, forward.system, self._last, True
        try:
            if last is not None and last.system is system:
                change = last.by_tensions @ (tensions - last.tensions)
                far = step_size(system, change, last.states) > _FAR
                here = newton(system, tensions, 1.0, last.states + change, kept=last)
            here = here or forward.found(tensions)
        except OctoplanError:
            return None
        if far:
            self._last = here
        return here


def _between(tensions: Array, numbers: list[int], states: dict[int, Array]) -> Array:
    """Return states (K, n_states) for some of tensions on their way, between known ones.

    By the share of the way, in tensions, that is behind them.
    """
    way = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(tensions, axis=0), axis=1)))
    at = np.array(numbers)
    first = at - at % _APART
    share = (way[at] - way[first]) / np.maximum(way[first + _APART] - way[first], 1e-300)
    before, after = (np.array([states[i] for i in e.tolist()]) for e in (first, first + _APART))
    return np.asarray(before + share[:, None] * (after - before))
