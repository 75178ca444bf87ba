"""Rod terms of the loads: weight, loads at places and along the arm, followers and currents."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

import casadi as ca
import numpy as np

from octoplan.model.arm import Arm
from octoplan.model.mesh import Counts, Mesh, volume
from octoplan.model.paths import SAME, Array
from octoplan.model.rod.rod_term import NodeView, RodTerm, SectionView, Sizes, Values
from octoplan.model.rotations import norm
from octoplan.model.support.checks import LARGEST

if TYPE_CHECKING:
    from octoplan.model.rod.structure import RodPoints

Vector = tuple[float, ...]
# Number of arc lengths at which the largest radius is sought.
_RADIUS_SAMPLES = 65


@dataclass(frozen=True)
class CouplingTerm(RodTerm):
    """Coupling and torsion of the cross-sections without a load, as the law of shear requires."""

    couples_sections = True
    bends = False


@dataclass(frozen=True)
class WeightTerm(RodTerm):
    """Weight of the arm minus the weight of the displaced fluid, (rho - rho_fluid) A g.

    Attributes
    ----------
    g : (3,)
        Acceleration of gravity [m/s2].
    fluid_density : float
        [kg/m3], 0 in air.
    """

    g: Vector
    fluid_density: float
    couples_sections = True

    def specific_weight(self, arm: Arm) -> Array:
        """Return the weight per volume of the body minus the weight of the fluid (3,) [N/m3]."""
        return (arm.material.density - self.fluid_density) * np.array(self.g)

    def dead_resultant(self, arm: Arm, s: Array, end: Array) -> Array:
        """Return the weight of the arm between s and the tip."""
        specific_weight = self.specific_weight(arm)
        if not specific_weight.any():
            return np.zeros((3, s.size))
        return np.outer(specific_weight, volume(arm, s))

    def dead_load_per_length(self, arm: Arm, s: Array) -> Array:
        """Return the weight per length."""
        return np.outer(self.specific_weight(arm), arm.area(s))

    def force_bound(self, arm: Arm, s: Array) -> Array:
        """Return the size of the weight between s and the tip."""
        return _capped_norm(self.specific_weight(arm)) * volume(arm, s)

    def turning_bounds(self, arm: Arm) -> tuple[tuple[float, float], ...]:
        """Return no moment: weight is a dead force on the midline."""
        return ()


@dataclass(frozen=True)
class DeadTipTerm(RodTerm):
    """A force [N] and a moment [N m] on the tip, constant in the base frame."""

    force: Vector
    moment: Vector
    couples_sections = True
    node_parameters: ClassVar[Sizes] = {"moment": 3}

    @property
    def is_conservative(self) -> bool:
        """Whether there is no moment: a dead moment has no potential."""
        return not any(self.moment)

    def nodes(self, mesh: Mesh) -> tuple[int, ...]:
        """Return the tip."""
        return (mesh.elements,)

    def dead_resultant(self, arm: Arm, s: Array, end: Array) -> Array:
        """Return the force, everywhere."""
        return np.outer(self.force, np.ones(s.size))

    def node_moment(self, node: NodeView) -> ca.SX:
        """Return the moment."""
        return node.parameters["moment"]

    def node_values(self, arm: Arm, mesh: Mesh, nodes: Counts) -> Values:
        """Return the moment."""
        return {"moment": np.array(self.moment)[:, None]}

    def force_bound(self, arm: Arm, s: Array) -> Array:
        """Return the size of the force."""
        return np.full(s.size, _capped_norm(self.force))

    def turning_bounds(self, arm: Arm) -> tuple[tuple[float, float], ...]:
        """Return |moment| / 2 at the tip."""
        return ((arm.length, 0.5 * _capped_norm(self.moment)),)


@dataclass(frozen=True)
class FollowerTerm(RodTerm):
    """A force [N] and a moment [N m] on the tip, constant in the frame of the tip."""

    force: Vector
    moment: Vector
    couples_sections = True
    depends_on_shape = True
    node_parameters: ClassVar[Sizes] = {"force": 3, "moment": 3}

    @property
    def is_conservative(self) -> bool:
        """False: the work depends on the path."""
        return False

    def nodes(self, mesh: Mesh) -> tuple[int, ...]:
        """Return the tip."""
        return (mesh.elements,)

    def node_force(self, node: NodeView) -> ca.SX:
        """Return R force."""
        return node.frame @ node.parameters["force"]

    def node_moment(self, node: NodeView) -> ca.SX:
        """Return R moment."""
        return node.frame @ node.parameters["moment"]

    def node_values(self, arm: Arm, mesh: Mesh, nodes: Counts) -> Values:
        """Return force and moment in the frame of the tip."""
        return {"force": np.array(self.force)[:, None], "moment": np.array(self.moment)[:, None]}

    def force_bound(self, arm: Arm, s: Array) -> Array:
        """Return the size of the force."""
        return np.full(s.size, _capped_norm(self.force))

    def turning_bounds(self, arm: Arm) -> tuple[tuple[float, float], ...]:
        """Return 1.5 |moment| + |force| L at the tip."""
        moment = 1.5 * _capped_norm(self.moment) + _capped_norm(self.force) * arm.length
        return ((arm.length, moment),)


@dataclass(frozen=True)
class PointForceTerm(RodTerm):
    """A dead force and moment on a cross-section.

    The force is part of the dead resultant D and adds no jump of the node states. A force off the
    midline adds the moment (R offset) x force at its node.

    Attributes
    ----------
    s : float
        Arc length [m].
    force : (3,)
        In the base frame [N].
    offset : (3,) or None
        From the midline in the local frame [m].
    moment : (3,) or None
        In the base frame [N m].
    """

    s: float
    force: Vector
    offset: Vector | None = None
    moment: Vector | None = None
    couples_sections = True
    node_parameters: ClassVar[Sizes] = {"offset": 3, "force": 3, "moment": 3}

    @property
    def is_conservative(self) -> bool:
        """Whether there is no moment: a dead moment has no potential."""
        return not any(self.moment or ())

    def required_arc_lengths(self, arm: Arm) -> tuple[float, ...]:
        """Return the place of the force."""
        return (self.s,) if 0 < self.s < arm.length else ()

    def nodes(self, mesh: Mesh) -> tuple[int, ...]:
        """Return the node of a moment, or of a force off the midline."""
        return (mesh.node(self.s),) if self.offset or self.moment else ()

    def dead_resultant(self, arm: Arm, s: Array, end: Array) -> Array:
        """Return the force on its base side."""
        return np.outer(self.force, self.s >= end - SAME * arm.length)

    def node_moment(self, node: NodeView) -> ca.SX:
        """Return (R offset) x force + moment."""
        lever_arm = node.frame @ node.parameters["offset"]
        return ca.cross(lever_arm, node.parameters["force"]) + node.parameters["moment"]

    def node_values(self, arm: Arm, mesh: Mesh, nodes: Counts) -> Values:
        """Return offset, force and moment."""
        none = (0.0, 0.0, 0.0)
        values = {"offset": self.offset or none, "force": self.force, "moment": self.moment or none}
        return {name: np.array(each)[:, None] for name, each in values.items()}

    def force_bound(self, arm: Arm, s: Array) -> Array:
        """Return the size of the force on its base side."""
        return np.where(s <= self.s, _capped_norm(self.force), 0.0)

    def turning_bounds(self, arm: Arm) -> tuple[tuple[float, float], ...]:
        """Return the moment of a force off the midline, and |moment| / 2."""
        if not self.offset and not self.moment:
            return ()
        bound = float(np.linalg.norm(self.offset or 0.0)) * _capped_norm(self.force)
        return ((self.s, bound + 0.5 * _capped_norm(self.moment or 0.0)),)


@dataclass(frozen=True)
class LineTerm(RodTerm):
    """A force and a moment per unit reference length between two arc lengths.

    Attributes
    ----------
    force, moment : (3,)
        [N/m], [N m/m].
    begin, end : float
        Arc lengths [m]; the tip is the end of a load with a larger `end`.
    """

    force: Vector
    moment: Vector
    begin: float
    end: float
    couples_sections = True
    uniform_parameters: ClassVar[Sizes] = {"moment": 3}
    section_parameters: ClassVar[Sizes] = {"is_loaded": 1}

    def required_arc_lengths(self, arm: Arm) -> tuple[float, ...]:
        """Return both ends."""
        return tuple(s for s in (self.begin, self.end) if 0 < s < arm.length)

    def is_loaded(self, s: Array) -> Array:
        """Return 1 between both ends, otherwise 0 (n,)."""
        return ((s > self.begin) & (s <= self.end)).astype(float)

    def loaded_beyond(self, arm: Arm, s: Array) -> Array:
        """Return the length of the loaded part between s (n,) and the tip [m]."""
        end = min(self.end, arm.length)
        return np.asarray(end - np.clip(s, self.begin, end))

    def uniform_values(self, arm: Arm) -> Values:
        """Return the moment per length."""
        return {"moment": np.array(self.moment)}

    def section_values(self, points: RodPoints) -> Values:
        """Return 1 between both ends, otherwise 0."""
        return {"is_loaded": self.is_loaded(points.stations.s)[None]}

    def force_bound(self, arm: Arm, s: Array) -> Array:
        """Return the size of the force beyond s."""
        return _capped_norm(self.force) * self.loaded_beyond(arm, s)


@dataclass(frozen=True)
class DeadLineTerm(LineTerm):
    """A load along the arm that is constant in the base frame; see LineTerm."""

    @property
    def is_conservative(self) -> bool:
        """Whether there is no moment: a dead moment has no potential."""
        return not any(self.moment)

    def dead_resultant(self, arm: Arm, s: Array, end: Array) -> Array:
        """Return the force between s and the tip."""
        return np.outer(self.force, self.loaded_beyond(arm, s))

    def dead_load_per_length(self, arm: Arm, s: Array) -> Array:
        """Return the force per length."""
        return np.outer(self.force, self.is_loaded(s))

    def moment_per_length(self, section: SectionView) -> ca.SX:
        """Return the moment per length."""
        return section.parameters["is_loaded"] * section.from_base(section.parameters["moment"])

    def turning_bounds(self, arm: Arm) -> tuple[tuple[float, float], ...]:
        """Return half of the whole moment, at the end of the load."""
        moment = 0.5 * _capped_norm(self.moment) * float(self.loaded_beyond(arm, np.zeros(1))[0])
        return ((min(self.end, arm.length), moment),)


@dataclass(frozen=True)
class FollowerLineTerm(LineTerm):
    """A load along the arm that is constant in the frames of the cross-sections; see LineTerm."""

    depends_on_shape = True
    uniform_parameters: ClassVar[Sizes] = {"force": 3, "moment": 3}

    @property
    def is_conservative(self) -> bool:
        """False: the work depends on the path."""
        return False

    def load_per_length(self, section: SectionView) -> ca.SX:
        """Return R force."""
        return section.parameters["is_loaded"] * section.frame @ section.parameters["force"]

    def moment_per_length(self, section: SectionView) -> ca.SX:
        """Return R moment."""
        return section.parameters["is_loaded"] * section.frame @ section.parameters["moment"]

    def uniform_values(self, arm: Arm) -> Values:
        """Return force and moment per length."""
        return {"force": np.array(self.force), "moment": np.array(self.moment)}

    def turning_bounds(self, arm: Arm) -> tuple[tuple[float, float], ...]:
        """Return (1.5 |moment| + |force| L) times the loaded length, at the end of the load."""
        load = 1.5 * _capped_norm(self.moment) + _capped_norm(self.force) * arm.length
        return ((min(self.end, arm.length), load * float(self.loaded_beyond(arm, np.zeros(1))[0])),)


@dataclass(frozen=True)
class DragTerm(RodTerm):
    """Drag of a steady current, rho C R |v_n| v_n per unit deformed length, v_n normal to t.

    Attributes
    ----------
    velocity : (3,)
        Of the fluid, in the base frame [m/s].
    density, coefficient : float
        rho of the fluid [kg/m3], and C [-].
    """

    velocity: Vector
    density: float
    coefficient: float
    couples_sections = True
    depends_on_shape = True
    uniform_parameters: ClassVar[Sizes] = {"velocity": 3}
    section_parameters: ClassVar[Sizes] = {"drag": 1}

    @property
    def is_conservative(self) -> bool:
        """False: the work depends on the path."""
        return False

    def convergence_order(self, order: int, derivatives: bool, is_bent: bool) -> int:
        """Return 3: the derivative of |v_n| v_n has a kink at v_n = 0."""
        return min(order, 1 if derivatives else 3)

    def load_per_length(self, section: SectionView) -> ca.SX:
        """Return rho C R |v_n| v_n times the stretch."""
        velocity = section.from_base(section.parameters["velocity"])
        t = section.frame[:, 0]
        normal = velocity - t * ca.dot(t, velocity)
        return section.parameters["drag"] * section.nu[0] * norm(normal) * normal

    def uniform_values(self, arm: Arm) -> Values:
        """Return the velocity."""
        return {"velocity": np.array(self.velocity)}

    def section_values(self, points: RodPoints) -> Values:
        """Return rho C R."""
        return {"drag": self.density * self.coefficient * points.stations.radius[None]}

    def force_bound(self, arm: Arm, s: Array) -> Array:
        """Return the largest drag per length times the length beyond s."""
        # Rounding may put the last arc length beyond the tip.
        return self._load_bound(arm) * np.maximum(arm.length - s, 0.0)

    def turning_bounds(self, arm: Arm) -> tuple[tuple[float, float], ...]:
        """Return the drag per length times L^2, at the tip."""
        return ((arm.length, self._load_bound(arm) * arm.length**2),)

    def _load_bound(self, arm: Arm) -> float:
        """Return a bound of the load per length [N/m]."""
        s = np.linspace(0.0, arm.length, _RADIUS_SAMPLES)
        radius = arm.radius.evaluate(s, arm.length)[0]
        drag = min(self.density * self.coefficient * radius.max(), LARGEST)
        return float(drag * _capped_norm(self.velocity) ** 2)


def _capped_norm(vector: Any) -> float:
    """Return the norm of a vector; components are clipped so that the square is finite."""
    return float(np.linalg.norm(np.clip(vector, -LARGEST, LARGEST)))
