"""Which statics a scene means."""

from __future__ import annotations

from model.arm import Arm
from model.effects import ExactTendons, Extension, NeoHookean, PrintedStatics
from model.scene import Scene
from model.statics.base import Statics
from model.statics.exact import Exact
from model.statics.printed import Printed
from model.statics.reference import ReferenceTangent
from model.stations import sides


def statics_of(scene: Scene, arm: Arm) -> Statics:
    """Return the statics that a scene calls for, for an arm's tendons."""
    extension = scene.has(Extension)
    if scene.has(PrintedStatics):
        return Printed(extension)
    if not scene.has(ExactTendons):
        return ReferenceTangent(extension)
    rubber = scene.find(NeoHookean)
    section = tuple(i for i, _ in arm.tendons)
    cos, sin = sides(arm)
    return Exact(
        section,
        tuple(cos.tolist()),
        tuple(sin.tolist()),
        extension,
        rubber is not None,
        rubber is not None and rubber.anticlastic,
    )
