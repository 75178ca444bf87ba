"""The bends of the sections, two numbers for each, and their squeezes: and tensions for them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np

from model.arm import Arm
from model.paths import Array
from planner.program.limits import Limits, natural_tensions

# At the tip and at the base, in units of what bends the arm by about 1 rad. A slender tip takes
# many: it saturates. The best plans for poses and fetches of a slender arm are between these.
_LEAST, _MOST = (0.5, 0.2), (60.0, 4.0)


@dataclass(frozen=True, eq=False)
class BendCoordinates:
    """The pulls of the sections as a function of their bends, and of how hard they are squeezed."""

    arm: Arm
    tendons: frozenset[int]
    limits: Limits

    @cached_property
    def sections(self) -> list[int]:
        """The sections with tendons that may pull, tip first."""
        return sorted({self.arm.tendons[j][0] for j in self.tendons})

    @property
    def width(self) -> int:
        """How many bends there are, 2 n."""
        return 2 * len(self.sections)

    @cached_property
    def sides(self) -> Array:
        """Tensions (2 n, 2, n_tendons) that bend each section along an axis, there and back."""
        angles = [(0.0, np.pi), (np.pi / 2, -np.pi / 2)]
        return np.array(
            [
                [section_tensions(self.arm, i, angle, self.tendons) for angle in axis]
                for i in self.sections
                for axis in angles
            ]
        )

    @cached_property
    def squeezes(self) -> Array:
        """Tensions (n, n_tendons) by which all tendons of a section pull."""
        unit = natural_tensions(self.arm)
        own = [[i == k for i, _ in self.arm.tendons] for k in self.sections]
        pulls = [j in self.tendons for j in range(self.arm.n_tendons)]
        return np.asarray(np.array(own) * np.array(pulls) * unit)

    def tensions(self, bends: Array) -> Array:
        """Return tensions (m, n_tendons) of bends (m, 2 n), within the limits of each tendon.

        Of bends and squeezes if they are (m, 3 n).
        """
        bends, squeezes = bends[:, : self.width], bends[:, self.width :]
        T = np.maximum(bends, 0) @ self.sides[:, 0] + np.maximum(-bends, 0) @ self.sides[:, 1]
        if squeezes.size:
            T += np.maximum(squeezes, 0) @ self.squeezes
        return np.asarray(np.clip(T, self.limits.lower, self.limits.upper))

    def draw(self, count: int) -> Array:
        """Return bends (count, 2 n) in all directions, as many small as large; always the same."""
        return _drawn(count, len(self.sections))


@lru_cache(maxsize=8)
def bend_coordinates(arm: Arm, tendons: frozenset[int], limits: Limits) -> BendCoordinates:
    """Return the bends of an arm whose `tendons` may pull, kept for the next target."""
    return BendCoordinates(arm, tendons, limits)


@lru_cache(maxsize=8)
def _drawn(count: int, n: int) -> Array:
    rng = np.random.default_rng(0)
    low, high = (np.geomspace(*ends, n) for ends in (_LEAST, _MOST))
    size = low * (high / low) ** rng.uniform(size=(count, n))
    angle = rng.uniform(0, 2 * np.pi, size=(count, n))
    drawn = np.stack([size * np.cos(angle), size * np.sin(angle)], axis=2).reshape(count, -1)
    drawn.setflags(write=False)
    return drawn


def section_tensions(arm: Arm, section: int, angle: float, tendons: frozenset[int]) -> Array:
    """Return the tensions of one section that bend the arm by about 1 rad towards an angle [N].

    The tendons on that side share the pull as the law of section 6.1 has it for four of them.
    """
    unit = natural_tensions(arm)
    sides = np.array([np.exp(1j * (phi - angle)) for _, phi in arm.tendons])
    own = np.array([i == section and j in tendons for j, (i, _) in enumerate(arm.tendons)])
    share = np.where(own, np.maximum(sides.real, 0.0), 0.0)
    reach = abs(np.sum(share * sides))
    return share * unit / reach if reach > 0 else share
