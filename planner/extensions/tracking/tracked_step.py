"""The result of a tracking step: tensions, residuals, distances to limits, and the outcome."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from octoplan.model.paths import Array
from octoplan.model.shape import Shape

# Number of reasons that an outcome names.
_REASONS = 3


@dataclass(frozen=True, eq=False)
class TrackedStep:
    """The result of a step of a Tracker.

    Attributes
    ----------
    tensions : (n_sections, n), or (n_tendons,) if sections differ in their number of tendons
        [N].
    shape : Shape
        The arm under the tensions, settled on the branch of the last step.
    residuals : dict
        Distance from each term of the targets by name: [m] for positions, [rad] for angles,
        otherwise [-].
    reached : bool
        Whether all residuals are within the accuracy of the plan.
    tension_reserve : array like `tensions`
        Distance of each tension from its maximum [N]; inf without a maximum.
    pull_reserve : float
        Distance of the sum of tensions from the total pull [N]; inf without a limit.
    stroke_reserve : array like `tensions`, or None
        Distance of each stroke from the nearer one of its limits [m]; None without limits.
    reasons : tuple of str
        The limits that hold the arm back from the target, by decreasing influence. Empty if the
        target is reached, or if no limit is active.
    optimal : bool
        Whether the iterations converged to tensions of least effort near those of the last step.
        If not, repeat the target to decrease the effort further.
    jump : float
        Relative change of the tensions in this step if the change exceeds a quarter, otherwise 0.
    iterations : int
        Number of iterations of the step.
    units : dict
        Unit of residuals by name: "L" for lengths, "rad" for angles.
    """

    tensions: Array
    shape: Shape
    residuals: Mapping[str, float]
    reached: bool
    tension_reserve: Array
    pull_reserve: float
    stroke_reserve: Array | None
    reasons: tuple[str, ...]
    optimal: bool
    jump: float
    iterations: int
    units: Mapping[str, str]

    @property
    def residual(self) -> float:
        """The largest residual: lengths over the arm's length, angles [rad]."""
        sizes = {"L": self.shape.arm.length}
        parts = self.residuals.items()
        return max(
            (size / sizes.get(self.units.get(name, ""), 1.0) for name, size in parts), default=0.0
        )

    @property
    def stability(self) -> float:
        """The stability of the shape, computed at the first reading; see `Shape.stability`.

        Steps under loads end at stable shapes, also if this value is not read.
        """
        return self.shape.stability

    @property
    def held_back(self) -> str:
        """The limits that hold the arm back from the target; empty if the target is reached."""
        if self.reached:
            return ""
        if not self.reasons:
            return "no change of the tensions brings the arm nearer"
        return f"held back by {', '.join(self.reasons[:_REASONS])}"

    @property
    def outcome(self) -> str:
        """The result of the step: a sentence."""
        units = self.units
        distances = ", ".join(
            f"{name} {_size(value, units.get(name, ''))}" for name, value in self.residuals.items()
        )
        text = f"Reached: {distances} off" if self.reached else f"Not reached: {distances} off"
        if not self.reached:
            text += f"; {self.held_back}"
        if self.jump:
            text += f"; tensions change by {100 * self.jump:.0f} % in this step"
        return f"{text}."

    def __str__(self) -> str:
        return self.outcome


def _size(value: float, unit: str) -> str:
    """Return a residual with its unit."""
    if unit == "L":
        return f"{1e3 * value:.3g} mm"
    return f"{value:.3g} rad" if unit == "rad" else f"{value:.3g}"
