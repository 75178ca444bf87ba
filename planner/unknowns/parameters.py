"""Values of unknowns to arms, scenes and numbers of the measurement, and their neighbours."""

from __future__ import annotations

import re
import warnings
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import msgspec
import numpy as np

from model import Arm, InputError, Scene, UnitWarning
from model.loads import check_loads
from model.paths import Array
from model.transcription.neighbours import Neighbour
from planner.fit.unknowns import Unknown
from planner.scenes.arm import ArmTable, arm_of
from planner.scenes.effects import EffectsTable, scene_of
from planner.scenes.places import steps, value_at
from planner.scenes.tables import SceneTable
from planner.sweeps.keys import changed, checked_key, unit_of, whole
from planner.unknowns.written import written

_SENSOR = re.compile(r"points\[\d+\]\.(s_mm|offset_mm\[[012]\])|tension_scale\[\d+\]")
_OF_ARM = ("arm.", "effects.")


@dataclass(frozen=True)
class Parameters:
    """Unknowns of an arm and a scene, and of what was measured on it.

    Attributes
    ----------
    table : dict
        The scene file that has arm and scene, with all its defaults, and beside them "points"
        (a dict of s_mm and offset_mm for each) and "tension_scale" (a number for each tendon).
    unknowns : tuple of Unknown
    """

    table: dict[str, Any]
    unknowns: tuple[Unknown, ...]

    @classmethod
    def of(
        cls,
        arm: Arm,
        scene: Scene,
        unknowns: Iterable[Unknown],
        points: Sequence[dict[str, Any]] = (),
        sessions: Sequence[str] = (),
    ) -> Parameters:
        """Return the parameters; InputError for unknown keys, sessions, and bounds that misfit."""
        given = tuple(unknowns)
        if not given or not all(isinstance(own, Unknown) for own in given):
            raise InputError(
                "unknowns", given, 'at least one, such as Unknown("arm.E_kPa", 50, 1000)'
            )
        scene_table = whole(msgspec.convert(written(arm, scene), SceneTable))
        table = scene_table | {"points": list(points), "tension_scale": [1.0] * arm.n_tendons}
        found = cls(table, given)
        found._check(sessions)
        return found

    def _check(self, sessions: Sequence[str]) -> None:
        seen: dict[str, set[str | None]] = {}
        for own in self.unknowns:
            if own.session is not None and own.session not in sessions:
                allowed = f"one of {', '.join(sessions) or 'none: no shape has a session'}"
                raise InputError(f"{own.name}: session", own.session, allowed)
            for key in own.keys:
                self._check_key(key)
                others = seen.setdefault(key, set())
                if others and (None in {*others, own.session} or own.session in others):
                    raise InputError("unknowns", key, "each key once, or once for each session")
                others.add(own.session)
            start = self.start_of(own)
            if not own.lower <= start <= own.upper:
                has = f"{start:g} {self.unit(own)}".rstrip()
                allowed = f"bounds that hold what arm or scene has, {has}{_thousands(own, start)}"
                raise InputError(own.name, (own.lower, own.upper), allowed)

    def _check_key(self, key: str) -> None:
        if key.startswith(("points", "tension_scale")):
            value = value_at(self.table, steps(key)) if _SENSOR.fullmatch(key) else None
            if value is None:
                below = len(self.table["points"])
                known = f"points[i].s_mm and points[i].offset_mm[0] to [2], i below {below}"
                raise InputError("key", key, f"{known}, or tension_scale[j] of a tendon")
            return
        checked_key(
            {k: v for k, v in self.table.items() if k not in ("points", "tension_scale")}, key
        )
        value = value_at(self.table, steps(key))
        whole_number = key.startswith("effects.friction.direction")
        number = isinstance(value, float | int) and not isinstance(value, bool)
        if not key.startswith(_OF_ARM) or whole_number or not number:
            raise InputError("key", key, "a number of arm, effects or measurement")

    def unit(self, own: Unknown) -> str:
        """Return the unit of an unknown's value."""
        if not own.keys[0].startswith(_OF_ARM):
            return "" if own.keys[0].startswith("tension_scale") else "mm"
        return unit_of(self.table, own.keys[0])

    def start_of(self, own: Unknown) -> float:
        """Return the value that arm or scene has already."""
        return float(value_at(self.table, steps(own.keys[0])))

    @cached_property
    def start(self) -> Array:
        """What arm and scene have already (K,)."""
        return np.array([self.start_of(own) for own in self.unknowns])

    @cached_property
    def lower(self) -> Array:
        """Lower bounds (K,)."""
        return np.array([own.lower for own in self.unknowns])

    @cached_property
    def range(self) -> Array:
        """From lower to upper bounds (K,)."""
        return np.array([own.range for own in self.unknowns])

    def belongs(self, own: Unknown, session: str) -> bool:
        """Return whether an unknown is one of a session."""
        return own.session is None or own.session == session

    def shared(self, session: str) -> str:
        """Return the session whose arm it has: "" unless it has unknowns of its own."""
        return session if any(own.session == session for own in self.unknowns) else ""

    def table_at(self, values: Array, session: str) -> dict[str, Any]:
        """Return the table with values (K,) of the unknowns that belong to a session."""
        keys, new = list[str](), list[float]()
        for own, value in zip(self.unknowns, values.tolist(), strict=True):
            if self.belongs(own, session):
                keys += own.keys
                new += [value] * len(own.keys)
        return changed(self.table, keys, new)

    def built(self, values: Array, session: str) -> tuple[Arm, Scene]:
        """Return arm and scene of values (K,); InputError where no such arm can be."""
        return _built(self.table_at(values, session))

    def stencils(self, values: Array, session: str) -> list[list[Neighbour]]:
        """Return the neighbours of which each unknown's derivative of arm and scene is made (K,).

        Central differences; to one side where the other is out of bounds or no arm.
        """
        return [
            self._stencil(values, k, session)
            if self.belongs(own, session) and any(key.startswith(_OF_ARM) for key in own.keys)
            else []
            for k, own in enumerate(self.unknowns)
        ]

    def _stencil(self, values: Array, k: int, session: str) -> list[Neighbour]:
        own, h = self.unknowns[k], _step(self.unknowns[k], values[k])

        def at(steps_off: int, weight: float) -> Neighbour:
            moved = values.copy()
            moved[k] += steps_off * h
            if not own.lower <= moved[k] <= own.upper:
                raise InputError(own.name, moved[k], "a value within the bounds")
            return Neighbour(weight / h, *self.built(moved, session))

        for weights in _STENCILS:
            try:
                return [at(off, weight) for off, weight in weights]
            except InputError as reason:
                problem = reason
        raise problem


# Central, then to either side, of second order: (steps off, weight times step).
_STENCILS = (
    ((1, 0.5), (-1, -0.5)),
    ((0, -1.5), (1, 2.0), (2, -0.5)),
    ((0, 1.5), (-1, -2.0), (-2, 0.5)),
)


def _step(own: Unknown, value: float) -> float:
    """Return the step of a difference quotient at a value."""
    small = 1e-4 * abs(value) if value else np.inf
    return float(max(min(1e-5 * own.range, small), 1e-8 * own.range))


def _thousands(own: Unknown, start: float) -> str:
    """Return a hint where bounds would hold the start but for a factor of 1000."""
    for factor, how in ((1e3, "large"), (1e-3, "small")):
        if own.lower <= factor * start <= own.upper:
            return f"; are they 1000 times too {how}? Check the unit"
    return ""


def _built(table: dict[str, Any]) -> tuple[Arm, Scene]:
    try:
        with warnings.catch_warnings():
            # Nobody gave these numbers: on its way a search passes any of them.
            warnings.simplefilter("ignore", UnitWarning)
            arm = arm_of(msgspec.convert(table["arm"], ArmTable))
            scene = scene_of(msgspec.convert(table["effects"], EffectsTable))
    except msgspec.ValidationError as reason:
        raise InputError("values", str(reason), "an arm that can be") from None
    check_loads(arm, scene)
    return arm, scene


def spread(parameters: Parameters, count: int, seed: int) -> list[Array]:
    """Return the given values (K,), and others spread evenly over the bounds: `count` in all."""
    if count == 1:
        return [parameters.start]
    from scipy.stats import qmc  # takes as long to load as all else that a plan needs

    draws = qmc.Halton(len(parameters.unknowns), seed=seed).random(count - 1)
    return [parameters.start, *(parameters.lower + parameters.range * draws)]
