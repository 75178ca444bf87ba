"""Unknown parameters: keys in scene files, bounds and priors, and the arms of given values."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray

from octoplan.model import Arm, InputError, Scene
from octoplan.model.extensions.lengths.winches import PLAIN_WINCHES, WinchSettings
from octoplan.model.loads import required_arc_lengths
from octoplan.model.mesh import Mesh, landmarks
from octoplan.model.paths import SAME, Array
from octoplan.model.rod.discrete_rod import DiscreteRod
from octoplan.model.support.checks import kind, whole
from octoplan.model.support.value import Rule, value
from octoplan.planner.frontends.io.varied import Setting

# Key of the stiffness of tendons, which has no value in measurements with inextensible tendons.
_TENDON_EA = "winches.tendon_EA_N"
# Steps of difference quotients, over the range of the bounds.
_STEP = 2e-8
# Distance from a bound, over the range of the bounds, below which an unknown is at the bound.
AT_BOUND = 1e-6
# Relative difference from the smallest cost above which another optimum counts as worse.
WORSE = 1e-3


def _each_once(name: str, keys: str | tuple[str, ...]) -> str | tuple[str, ...]:
    """Return distinct keys, and a single key as a string."""
    if not keys:
        raise InputError(name, keys, "a key path such as arm.E_kPa, or several")
    if isinstance(keys, tuple) and len(set(keys)) < len(keys):
        raise InputError(name, keys, "each key once")
    return keys[0] if isinstance(keys, tuple) and len(keys) == 1 else keys


@value
class Unknown:
    """A parameter to be estimated or chosen, in the unit of its key.

    Attributes
    ----------
    key : str or tuple of str
        Path in a scene file, such as "arm.E_kPa", "arm.sections[0].angles_deg[1]" or
        "effects.friction.mu". A calibration also accepts "points[1].s_mm" and
        "points[1].offset_mm[2]" (the second point of each shape), "tension_scale[0]", the factor by
        which the tensions of the first tendon are multiplied, "winches.zero_mm[0]", which is added
        to the strokes of the first tendon, and "winches.tendon_EA_N". Several keys share one value.
    lower, upper : float
        Bounds.
    prior : (mean, standard deviation), optional
        Normal prior distribution.
    session : str, optional
        Session of the measurements that the unknown affects; all sessions unless given.
    """

    key: Annotated[str | tuple[str, ...], Rule(_each_once)]
    lower: float
    upper: float
    prior: tuple[float, float] | None = None
    session: str | None = None

    def __post_init__(self) -> None:
        low = self.lower
        high = self.upper
        if not low < high:
            raise InputError(f"{self.name}: upper", high, f"above lower, {low:g}")
        if self.prior is not None:
            mean, std = self.prior
            if not (std > 0 and low <= mean <= high):
                allowed = f"a mean within the bounds, {low:g} to {high:g}, and a standard deviation"
                raise InputError(f"{self.name}: prior", self.prior, f"{allowed} above 0")

    @property
    def keys(self) -> tuple[str, ...]:
        """All keys."""
        return self.key if isinstance(self.key, tuple) else (self.key,)

    @property
    def name(self) -> str:
        """Keys, and the session if the unknown has one."""
        return " = ".join(self.keys) + (f" [{self.session}]" if self.session else "")

    @property
    def range(self) -> float:
        """Upper bound minus lower bound."""
        return self.upper - self.lower

    def belongs(self, session: str) -> bool:
        """Return whether shapes of a session depend on the unknown."""
        return self.session is None or self.session == session


@dataclass(frozen=True)
class Parameters:
    """Unknowns of an arm, a scene and measurements.

    Attributes
    ----------
    given : Setting
        Arm, scene and points that contain all parameters, including the unknown ones.
    unknowns : tuple of Unknown
        Unknown parameters, in the order of the values (K,).
    """

    given: Setting
    unknowns: tuple[Unknown, ...]

    @classmethod
    def of(
        cls,
        arm: Arm,
        scene: Scene,
        unknowns: Iterable[Unknown],
        points: Iterable[Any] = (),
        sessions: Sequence[str] = (),
        winches: WinchSettings = PLAIN_WINCHES,
    ) -> Parameters:
        """Return the unknowns, or raise InputError for unsuitable keys, sessions or bounds."""
        allowed = 'at least one, such as Unknown("arm.E_kPa", 50, 1000)'
        checked = tuple(kind("unknowns", unknowns, Iterable, f"a sequence of {allowed}"))
        if not checked or not all(isinstance(unknown, Unknown) for unknown in checked):
            raise InputError("unknowns", checked, allowed)
        for unknown in checked:
            if _TENDON_EA in unknown.keys and winches.tendon_EA is None:
                winches = replace(winches, tendon_EA=_initial_EA(unknown))
        parameters = cls(Setting.of(arm, scene, points, winches), checked)
        for unknown in checked:
            parameters._check(unknown, sessions)
        pairs = [(key, unknown.session) for unknown in checked for key in unknown.keys]
        for key, session in pairs:
            others = [of for name, of in pairs if name == key]
            if len(others) > 1 and (None in others or others.count(session) > 1):
                raise InputError("unknowns", key, "each key once, or once for each session")
        return parameters

    def _check(self, unknown: Unknown, sessions: Sequence[str]) -> None:
        if unknown.session is not None and unknown.session not in sessions:
            allowed = (
                f"one of {', '.join(sessions)}" if sessions else "none: no shape has a session"
            )
            raise InputError(f"{unknown.name}: session", unknown.session, allowed)
        for key in unknown.keys:
            self.given.check_number(key)
        start = self.given.number(unknown.keys[0])
        if not unknown.lower <= start <= unknown.upper:
            has = f"{start:g} {self.unit(unknown)}".rstrip()
            allowed = f"bounds that hold what arm or scene has, {has}"
            slips = {1e-3: "are they 1000 times too large", 1e3: "are they 1000 times too small"}
            slips |= {math.degrees(1): "are they in radians"} if has.endswith("deg") else {}
            for factor, slip in slips.items():
                low = factor * unknown.lower
                high = factor * unknown.upper
                if low <= start <= high:
                    allowed += f"; {slip}? Then give {low:g} to {high:g}"
            raise InputError(unknown.name, (unknown.lower, unknown.upper), allowed)

    def unit(self, unknown: Unknown) -> str:
        """Return the unit of an unknown's value."""
        return self.given.unit(unknown.keys[0])

    @property
    def start(self) -> Array:
        """The values of the given arm and scene (K,)."""
        return np.array([self.given.number(unknown.keys[0]) for unknown in self.unknowns])

    @property
    def lower(self) -> Array:
        """Lower bounds (K,)."""
        return np.array([unknown.lower for unknown in self.unknowns])

    @property
    def range(self) -> Array:
        """Upper minus lower bounds (K,)."""
        return np.array([unknown.range for unknown in self.unknowns])

    def from_fractions(self, fractions: Array) -> Array:
        """Return the values (K,) at fractions of the bounds' ranges, 0 at the lower bound."""
        return np.asarray(self.lower + self.range * fractions)

    def fractions(self, values: Array) -> Array:
        """Return values (K,) as fractions of the bounds' ranges, 0 at the lower bound."""
        return np.asarray((values - self.lower) / self.range)

    def at_bounds(self, values: Array) -> NDArray[np.bool_]:
        """Return a mask of the unknowns that are at a bound (K,)."""
        fractions = self.fractions(values)
        return np.asarray(np.minimum(fractions, 1 - fractions) < AT_BOUND)

    def names_at_bounds(self, values: Array) -> tuple[str, ...]:
        """Return the names of the unknowns that are at a bound."""
        return tuple(self.unknowns[k].name for k in np.flatnonzero(self.at_bounds(values)))

    def priors(self, values: Array) -> tuple[Array, Array]:
        """Return residuals (m,) of priors, and the derivatives (m, K) for unknowns in [0, 1]."""
        rows = [(k, *unknown.prior) for k, unknown in enumerate(self.unknowns) if unknown.prior]
        indices = [k for k, *_ in rows]
        mean, std = np.array([row[1:] for row in rows]).reshape(-1, 2).T
        return (values[indices] - mean) / std, np.diag(self.range)[indices] / std[:, None]

    def setting(self, values: Array, session: str = "", near: Setting | None = None) -> Setting:
        """Return the setting for values (K,) of the unknowns that belong to a session.

        `near` is a setting whose unchanged objects are reused; see Setting.at. Raises InputError
        if the values are invalid for an arm.
        """
        pairs = [
            (key, value)
            for unknown, value in zip(self.unknowns, values.tolist(), strict=True)
            if unknown.belongs(session)
            for key in unknown.keys
        ]
        return self.given.at([key for key, _ in pairs], [value for _, value in pairs], near)

    def derivatives(
        self,
        function: Callable[[Array], Sequence[Array]],
        at_values: Sequence[Array],
        values: Array,
        session: str = "",
    ) -> list[Array]:
        """Return the derivatives (..., K) of arrays that are functions of values (K,).

        Difference quotients step away from the nearer bound. The result has at least seven correct
        digits for functions that are low powers of the unknowns and solve no equations.
        """
        columns = []
        steps = np.where(self.fractions(values) < 0.5, _STEP, -_STEP) * self.range
        for k, unknown in enumerate(self.unknowns):
            if not unknown.belongs(session):
                columns.append([np.zeros_like(part) for part in at_values])
                continue
            there = function(values + steps * (np.arange(len(values)) == k))
            columns.append([(b - a) / steps[k] for a, b in zip(at_values, there, strict=True)])
        return [np.stack(parts, axis=-1) for parts in zip(*columns, strict=True)]

    def multistart(self, count: int, seed: int) -> list[Array]:
        """Return the given values (K,), then values that are spread evenly over the bounds."""
        seed = whole("seed", seed, 0)
        if count == 1:
            return [self.start]
        from scipy.stats import qmc  # slow to import: as long as the rest of a plan's imports

        draws = qmc.Halton(len(self.unknowns), seed=seed).random(count - 1)
        return [self.start, *map(self.from_fractions, draws)]


def _initial_EA(unknown: Unknown) -> float:
    """Return the initial stiffness of tendons if none is given: the geometric mean of the bounds.

    Raises InputError for bounds that a stiffness cannot have.
    """
    if unknown.lower <= 0:
        raise InputError(f"{unknown.name}: lower", unknown.lower, "a number above 0")
    return math.sqrt(unknown.lower * unknown.upper)


def neighbour(
    system: DiscreteRod,
    arm: Arm,
    scene: Scene,
    before: Sequence[float] = (),
    after: Sequence[float] = (),
) -> DiscreteRod:
    """Return the equations of an arm in a scene on the deformed mesh of another arm's equations.

    Nodes at arc lengths `before` move to `after` [m]. Raises InputError if coincident places
    separate or if places pass each other.
    """
    now = *required_arc_lengths(arm, scene), *after
    old = landmarks(system.arm, (*required_arc_lengths(system.arm, system.scene), *before))
    mesh = _stretched_mesh(system.mesh, old, landmarks(arm, now))
    result = system.on_mesh(mesh, scene, arm)
    # A quaternion and its negative are the same rotation: keep the sign of the other arm.
    if result.base[:4] @ system.base[:4] < 0:
        result.base[:4] *= -1
    return result


def _stretched_mesh(mesh: Mesh, before: Array, new: Array) -> Mesh:
    """Return a mesh whose landmarks (n,) [m] have moved to new places, with the same nodes.

    Raises InputError if coincident landmarks separate or if landmarks pass each other.
    """
    if np.array_equal(before, new):
        return mesh
    if before.size != new.size:
        allowed = f"as many knots and loads as before, {before.size}"
        raise InputError("places along the arm", new.size, allowed)
    order = np.argsort(before, kind="stable")
    tolerance = SAME * mesh.s[-1]
    before = before[order]
    after = new[order]
    apart = np.diff(before) > tolerance
    ahead = np.diff(after)
    parted = ~apart & (np.abs(ahead) > 2 * tolerance)
    passed = apart & (ahead <= tolerance)
    for wrong, allowed in (
        (parted, "to move all that is there together: tie their keys in one unknown"),
        (passed, "to stay on its side of its neighbour"),
    ):
        if wrong.any():
            raise InputError("a place along the arm", float(before[:-1][wrong][0]), allowed)
    kept = np.concatenate([[True], apart])
    return Mesh(np.interp(mesh.s, before[kept], after[kept]), mesh.active)
