"""Many arms in one sweep over a coarse mesh: tensions by the bends of sections, what they miss.

A section has two bends and a squeeze. Without loads; also where the arms are between their nodes.
"""

from __future__ import annotations

from functools import lru_cache

import casadi as ca
import numpy as np

from model.arm import Arm
from model.forward import explicit_map, schemes_of
from model.machine.buffered import Mapped
from model.paths import Array
from model.rotations import matrices
from model.scene import Scene
from planner.program.limits import Limits, natural_tensions
from planner.program.terms import TargetTerms, stations_of, target_numbers, terms_of
from planner.solve.task import Task

_FEASIBLE = 0.05
# No shape is farther off; what is no number is.
_FAR = 1e3


def residuals(task: Task, tensions: Array) -> Array:
    """Return the residuals of tensions (m, n_tendons) [N] in the scene without its loads (m, k).

    Those of the targets, violations of inequalities, and last by how much the arm is crushed.
    Stiffness is left out: compliances are taken to be those that are wanted.
    """
    arm, scene, targets = task.arm, task.bare, task.targets
    scheme, at = "magnus4" if "magnus4" in schemes_of(scene) else "rk4", stations_of(arm, targets)
    forward = explicit_map(arm, scene, scheme, 1, at, task.machine_code)
    numbers = target_numbers(arm, targets)
    poses, least = forward.many(tensions, [forward.mesh.node(s) for s in at])
    seen = poses.reshape(len(tensions), -1)
    (gaps,) = _residuals_of(terms_of(arm, targets))(seen, np.tile(numbers, (len(tensions), 1)))
    crushed = _bounded(_FEASIBLE - least, 0.0)
    return np.hstack([_bounded(gaps, -_FAR), 10 * crushed[:, None]])


def _bounded(values: Array, low: float) -> Array:
    return np.asarray(np.where(np.isnan(values), _FAR, np.clip(values, low, _FAR)))


@lru_cache(maxsize=16)
def _residuals_of(terms: TargetTerms) -> Mapped:
    """Return (poses (7 K,), target numbers) -> residuals (k,), as one list of instructions."""
    poses, numbers = (ca.MX.sym("given", *terms.function.size_in(i)) for i in range(2))
    compliances = ca.vertcat(
        ca.DM(0, 1), *(ca.vec(ca.DM.eye(request.width)) for request in terms.requests)
    )
    equality, soft_residual, inequality, _ = terms.function(poses, numbers, compliances)
    gaps = ca.densify(ca.vertcat(equality, soft_residual, ca.fmin(inequality, 0)))
    function = ca.Function("gaps", [poses, numbers], [gaps])
    arguments = function.sx_in()
    return Mapped(ca.Function("gaps", arguments, function.call(arguments), {"cse": True}))


# Where between two nodes an arm is looked at.
_SHARES = (0.25, 0.5, 0.75, 1.0)


def many_places(arm: Arm, scene: Scene, tensions: Array, machine_code: bool) -> tuple[Array, Array]:
    """Return places (m, K, 3) of an arm under tensions (m, n_tendons), and radii (K,) there [m].

    Between the nodes they are on cubics.
    """
    m = len(tensions)
    scheme = "magnus6" if "magnus6" in schemes_of(scene) else "rk4"
    forward = explicit_map(arm, scene, scheme, 1, (), machine_code)
    poses, _ = forward.many(tensions, range(forward.mesh.steps + 1))
    u, t = poses[:, :, 4:], matrices(poses[:, :, :4].reshape(-1, 4))[:, :, 0].reshape(m, -1, 3)
    h = np.diff(forward.mesh.s)
    parts, places = [], []
    for x in _SHARES:
        rise, size = x * x * (3 - 2 * x), np.linalg.norm(np.diff(u, axis=1), axis=2)[..., None]
        ends = (1 - rise) * u[:, :-1] + rise * u[:, 1:]
        slopes = x * (1 - x) ** 2 * t[:, :-1] - x * x * (1 - x) * t[:, 1:]
        parts.append(ends + size * slopes)
        places.append(forward.mesh.s[:-1] + x * h)
    radius = arm.radius.evaluate(np.concatenate(places), arm.length)[0]
    return np.concatenate(parts, axis=1), radius


# At the tip and at the base, in units of what bends the arm by about 1 rad. A slender tip takes
# many: it saturates. The best plans for poses and fetches of a slender arm are between these.
_LEAST, _MOST = (0.5, 0.2), (60.0, 4.0)


class BendCoordinates:
    """The pulls of the sections as a function of their bends, and of how hard they are squeezed.

    Attributes
    ----------
    sections : list of int
        The sections with tendons that may pull, tip first.
    width : int
        How many bends there are, 2 n.
    """

    def __init__(self, arm: Arm, tendons: frozenset[int], limits: Limits) -> None:
        self._limits = limits
        self.sections = sorted({arm.tendons[j][0] for j in tendons})
        self.width = 2 * len(self.sections)
        phi, unit = np.array([angle for _, angle in arm.tendons]), natural_tensions(arm)
        pulls = np.isin(np.arange(arm.n_tendons), list(tendons))
        section = np.array([i for i, _ in arm.tendons])
        of_section = pulls & (section == np.array(self.sections)[:, None])
        # Tensions (2 n, 2, n_tendons) that bend each section by about 1 rad along an axis, there
        # and back: the tendons on that side share the pull as the law of section 6.1 has it for
        # four of them.
        axes = np.array([[0.0, np.pi], [np.pi / 2, -np.pi / 2]])
        sides = np.exp(1j * (phi - axes[:, :, None]))
        shares = of_section[:, None, None] * np.maximum(sides.real, 0.0)
        reach = np.abs((shares * sides).sum(axis=-1, keepdims=True))
        bent = shares * unit / np.where(reach > 0, reach, 1.0)
        self._sides = bent.reshape(-1, 2, phi.size)
        # Tensions (n, n_tendons) by which all tendons of a section pull.
        self._squeezes = of_section * unit

    def tensions(self, bends: Array) -> Array:
        """Return tensions (m, n_tendons) of bends (m, 2 n), within the limits.

        Of bends and squeezes if they are (m, 3 n).
        """
        bends, squeezes = bends[:, : self.width], bends[:, self.width :]
        T = np.maximum(bends, 0) @ self._sides[:, 0] + np.maximum(-bends, 0) @ self._sides[:, 1]
        if squeezes.size:
            T += np.maximum(squeezes, 0) @ self._squeezes
        T, low = np.clip(T, self._limits.lower, self._limits.upper), np.array(self._limits.lower)
        if self._limits.total is not None:
            most = max(self._limits.total - float(low.sum()), 0.0)
            T = low + (T - low) * (most / (T - low).sum(axis=1).clip(max(most, 1e-300)))[:, None]
        return np.asarray(T)

    def draw(self, count: int) -> Array:
        """Return bends (count, 2 n) in all directions, as many small as large; always the same."""
        rng, n = np.random.default_rng(0), len(self.sections)
        low, high = np.geomspace(*_LEAST, n), np.geomspace(*_MOST, n)
        size = low * (high / low) ** rng.uniform(size=(count, n))
        angle = rng.uniform(0, 2 * np.pi, size=(count, n))
        bends = np.stack([size * np.cos(angle), size * np.sin(angle)], axis=2)
        return np.asarray(bends.reshape(count, -1))
