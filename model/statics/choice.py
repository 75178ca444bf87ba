"""Which statics a scene means."""

from __future__ import annotations

from typing import Any

from model.arm import Arm
from model.effects import ExactTendons, Extension, NeoHookean, PrintedStatics
from model.scene import Scene
from model.statics.base import Statics
from model.statics.exact import Exact
from model.statics.printed import Printed
from model.statics.reference import ReferenceTangent
from model.stations import sides


def statics_of(scene: Scene, arm: Arm) -> Statics:
    """Return the statics of a scene without loads, for an arm's tendons."""
    extension = scene.has(Extension)
    if scene.has(PrintedStatics):
        return Printed(extension)
    tendons = scene.find(ExactTendons)
    if tendons is None:
        return ReferenceTangent(extension)
    return Exact(**_energy(scene, arm), careful=tendons.careful)


def _energy(scene: Scene, arm: Arm) -> dict[str, Any]:
    """Return the fields of a section's energy."""
    rubber = scene.find(NeoHookean)
    cos, sin = sides(arm)
    return {
        "section": tuple(i for i, _ in arm.tendons),
        "cos": tuple(cos.tolist()),
        "sin": tuple(sin.tolist()),
        "extension": scene.has(Extension),
        "rubber": rubber is not None,
        "anticlastic": rubber is not None and rubber.anticlastic,
    }
