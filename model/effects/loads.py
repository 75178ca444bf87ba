"""Loads: weight and buoyancy, loads and masses at places and along the arm, and streams."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Annotated, Any

import numpy as np

from octoplan.model.arm import Arm
from octoplan.model.effects.base import Effect, EffectSet, Rules
from octoplan.model.paths import Array
from octoplan.model.rod.load_terms import (
    DeadLineTerm,
    DeadTipTerm,
    DragTerm,
    FollowerLineTerm,
    FollowerTerm,
    PointForceTerm,
    WeightTerm,
)
from octoplan.model.rod.rod_term import RodTerm
from octoplan.model.support.errors import InputError
from octoplan.model.support.units import FLUID, GRAVITY, SPEED, length_text, warn_unusual
from octoplan.model.support.value import (
    ArcLength,
    Density,
    Force,
    NotNegative,
    Place,
    Vector,
    unit,
    value,
)

_NONE = (0.0, 0.0, 0.0)


@value
class Weight(Effect):
    """The weight of the arm, rho A(s) g per unit reference length, with the material's density.

    F(s) is the weight of the arm beyond s, M' = -u' x F. The effect adds torsion and the moment at
    the nodes, and couples the cross-sections. An arm without weight differs from table 2 under
    figure 11(b) by 4 cm at the tip in water, and by half the length of the arm in air.

    Attributes
    ----------
    g : (3,)
        Acceleration of gravity in the base frame [m/s2].
    """

    g: Annotated[Vector, unit("m/s2")] = (0.0, 0.0, -9.81)

    def __post_init__(self) -> None:
        warn_unusual("Weight.g", [math.hypot(*self.g)], GRAVITY)

    def rod_term(self, scene: EffectSet) -> RodTerm:
        """Return the weight of the arm minus that of the displaced fluid."""
        fluid = scene.find(Buoyancy)
        return WeightTerm(self.g, fluid.density if fluid else 0.0)

    def without_force(self) -> Effect:
        """Return the weight without gravity."""
        return replace(self, g=_NONE)

    def rotated(self, rotation: Array) -> Effect:
        """Return the weight with rotated gravity."""
        return replace(self, g=rotate(rotation, self.g))


@value
class Buoyancy(Effect):
    """The buoyancy of the arm: the weight becomes (rho - rho_fluid) A(s) g.

    Needs Weight, and adds no state, unknown or time. The silicone of the paper weighs 13 times more
    in air than in water.

    Attributes
    ----------
    density : float
        Density of the fluid [kg/m3].
    """

    density: Density = 1000.0

    def __post_init__(self) -> None:
        warn_unusual("Buoyancy.density", [self.density], FLUID)

    @classmethod
    def needs(cls) -> Rules:
        """See Effect."""
        reason = "it is a weight, that of the fluid displaced, and acts against g"
        return (("Weight", reason),)

    def without_force(self) -> Effect:
        """Return the buoyancy of a fluid without density."""
        return replace(self, density=0.0)


@value
class TipLoad(Effect):
    """A force and a moment on the tip: dead in the base frame, or following the tip.

    F(L) = force and M(L) = moment, in the base frame or, with `follower`, in the frame of the tip
    (boundary conditions of F' = -f, M' = -u' x F). The effect adds torsion and the moment at the
    nodes; a follower also adds the force at the nodes. A payload of 2 mN (0.2 g) moves the tips in
    the figures of the paper by 4 to 10 mm.

    Attributes
    ----------
    force : (3,)
        [N].
    moment : (3,)
        [N m].
    follower : bool
        Whether force and moment turn with the tip frame (t, n, b).
    """

    force: Force = (0.0, 0.0, 0.0)
    moment: Annotated[Vector, unit("N m")] = (0.0, 0.0, 0.0)
    follower: bool = False

    def rod_term(self, scene: EffectSet) -> RodTerm:
        """Return the dead load, or the follower."""
        kind = FollowerTerm if self.follower else DeadTipTerm
        return kind(self.force, self.moment)

    def without_force(self) -> Effect:
        """Return the load without force and moment."""
        return replace(self, force=_NONE, moment=_NONE)

    def rotated(self, rotation: Array) -> Effect:
        """Return the rotated load; a follower has the tip frame."""
        if self.follower:
            return self
        force = rotate(rotation, self.force)
        return replace(self, force=force, moment=rotate(rotation, self.moment))


@value
class PointLoad(Effect):
    """A dead force and moment at arc length s; a scene may have several, at different places.

    Force and moment in the arm jump, F(s-) = F(s+) + force and M(s-) = M(s+) + moment. The effect
    adds torsion, the moment at the nodes, and a node at s.

    Attributes
    ----------
    s : float
        Arc length [m] on the arm.
    force : (3,)
        In the base frame [N].
    moment : (3,)
        In the base frame [N m], none by default.
    """

    s: ArcLength
    force: Force
    moment: Annotated[Vector, unit("N m")] | None = None

    @property
    def place(self) -> tuple[Any, ...]:
        """Its arc length."""
        return (self.s,)

    def check_arm(self, arm: Arm) -> None:
        """See Effect: the place must be on the arm."""
        _check_place("PointLoad.s", self.s, arm)

    def rod_term(self, scene: EffectSet) -> RodTerm:
        """Return force and moment at their arc length."""
        return PointForceTerm(self.s, self.force, moment=self.moment)

    def without_force(self) -> Effect:
        """Return the load without force and moment."""
        return replace(self, force=_NONE, moment=None if self.moment is None else _NONE)

    def rotated(self, rotation: Array) -> Effect:
        """Return the load with rotated force and moment."""
        moment = None if self.moment is None else rotate(rotation, self.moment)
        return replace(self, force=rotate(rotation, self.force), moment=moment)


@value
class LineLoad(Effect):
    """A force and a moment per unit length of the midline at rest, on a part of the arm.

    Fluids, magnets and pressure chambers load arms like this: F' = -force, M' = -u' x F - moment.
    A scene may have several, at different places. The effect adds torsion, the moment at the
    nodes, and nodes at both ends of the part; a follower also adds the force at the nodes.

    Attributes
    ----------
    force : (3,)
        [N/m].
    moment : (3,)
        [N m/m].
    begin, end : float
        Arc lengths [m] of the loaded part. The default is the whole arm.
    follower : bool
        Whether force and moment turn with the cross-sections (t, n, b); otherwise they are constant
        in the base frame.
    """

    force: Annotated[Vector, unit("N/m")] = (0.0, 0.0, 0.0)
    moment: Annotated[Vector, unit("N m/m")] = (0.0, 0.0, 0.0)
    begin: ArcLength = 0.0
    end: ArcLength | None = None
    follower: bool = False

    def __post_init__(self) -> None:
        if self.end is not None and self.end <= self.begin:
            allowed = f"above begin, {length_text(self.begin)}"
            raise InputError("LineLoad.end", self.end, allowed)

    @property
    def place(self) -> tuple[Any, ...]:
        """The loaded part, and whether the load is a follower."""
        return self.begin, math.inf if self.end is None else self.end, self.follower

    def check_arm(self, arm: Arm) -> None:
        """See Effect: the loaded part must be on the arm."""
        if self.begin >= arm.length:
            allowed = f"below the arm's length, {length_text(arm.length)}"
            raise InputError("LineLoad.begin", self.begin, allowed)
        if self.end is not None:
            _check_place("LineLoad.end", self.end, arm)

    def rod_term(self, scene: EffectSet) -> RodTerm:
        """Return the dead load, or the follower."""
        kind = FollowerLineTerm if self.follower else DeadLineTerm
        end = math.inf if self.end is None else self.end
        return kind(self.force, self.moment, self.begin, end)

    def without_force(self) -> Effect:
        """Return the load without force and moment."""
        return replace(self, force=_NONE, moment=_NONE)

    def rotated(self, rotation: Array) -> Effect:
        """Return the rotated load; a follower has the frames of the cross-sections."""
        if self.follower:
            return self
        force = rotate(rotation, self.force)
        return replace(self, force=force, moment=rotate(rotation, self.moment))


@value
class PointMass(Effect):
    """The weight of a mass that a cross-section carries, off the midline; needs Weight.

    The force in the arm jumps by m g, and the moment by (R o) x m g: the offset o rotates with the
    frame R of the cross-section. The buoyancy of the mass is neglected. The effect adds a node at
    s, and a moment if the mass is off the midline.

    Attributes
    ----------
    s : float
        Arc length [m] on the arm.
    mass : float
        [kg].
    offset : (3,)
        Offset from the midline in the local frame (t, n, b) [m]. The default is on the midline.
    """

    s: ArcLength
    mass: Annotated[NotNegative, unit("g")]
    offset: Place | None = None

    @property
    def place(self) -> tuple[Any, ...]:
        """The arc length and the offset."""
        return self.s, self.offset or ()

    @classmethod
    def needs(cls) -> Rules:
        """See Effect."""
        return (("Weight", "it is a mass that gravity acts on"),)

    def check_arm(self, arm: Arm) -> None:
        """See Effect: the place must be on the arm."""
        _check_place("PointMass.s", self.s, arm)

    def rod_term(self, scene: EffectSet) -> RodTerm:
        """Return the weight of the mass at its arc length."""
        weight = scene.find(Weight)
        g = weight.g if weight else _NONE
        x, y, z = (self.mass * part for part in g)
        return PointForceTerm(self.s, (x, y, z), self.offset or None)

    def without_force(self) -> Effect:
        """Return the place without a mass."""
        return replace(self, mass=0.0)


@value
class Current(Effect):
    """A steady stream pushes across the arm: ``rho C R |v_n| v_n`` per unit deformed length.

    v_n is the part of the stream's velocity that is normal to the arm's tangent t, so the load
    depends on the shape (Morison's drag term). Adds to the paper's scene torsion, and moment and
    force at the nodes, and couples the cross-sections in one system of equations.
    Without it an arm in flowing water stands as in still water: 0.1 m/s move the tips of the
    paper's figures by 3 to 4 % of the length.

    Attributes
    ----------
    velocity : (3,)
        Of the stream, in the base frame [m/s].
    density : float
        Density of the fluid [kg/m3].
    coefficient : float
        Drag coefficient of a cylinder across the stream, about 1.1 at the Reynolds numbers of an
        arm in water.
    """

    velocity: Annotated[Vector, unit("m/s")]
    density: Density = 1000.0
    coefficient: NotNegative = 1.1

    def __post_init__(self) -> None:
        warn_unusual("Current.density", [self.density], FLUID)
        warn_unusual("Current.velocity", [math.hypot(*self.velocity)], SPEED)

    def rod_term(self, scene: EffectSet) -> RodTerm:
        """Return the drag."""
        return DragTerm(self.velocity, self.density, self.coefficient)

    def without_force(self) -> Effect:
        """Return still water."""
        return replace(self, velocity=_NONE)

    def rotated(self, rotation: Array) -> Effect:
        """Return the current with rotated velocity."""
        return replace(self, velocity=rotate(rotation, self.velocity))


def rotate(rotation: Array, vector: tuple[float, ...]) -> tuple[float, float, float]:
    """Return a vector rotated by a matrix (3, 3)."""
    x, y, z = (rotation @ np.array(vector)).tolist()
    return x, y, z


def _check_place(field: str, s: float, arm: Arm) -> None:
    """Raise InputError for an arc length beyond the tip."""
    if s > arm.length * (1 + 1e-12):
        raise InputError(field, s, f"from 0 to the arm's length, {length_text(arm.length)}")
