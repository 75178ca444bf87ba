"""Which statics a scene means."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

from model.arm import Arm
from model.effects import (
    Current,
    ExactTendons,
    Extension,
    Friction,
    NeoHookean,
    PointLoad,
    PrintedStatics,
    Shear,
    TipLoad,
    Weight,
)
from model.scene import Scene
from model.statics.base import Statics
from model.statics.exact import Exact
from model.statics.loaded import ExactLoaded, LoadedStatics, ReferenceLoaded
from model.statics.printed import Printed
from model.statics.reference import ReferenceTangent
from model.stations import sides

_LOADS = (Current, Friction, PointLoad, Shear, TipLoad, Weight)


@lru_cache(maxsize=256)
def is_loaded(scene: Scene) -> bool:
    """Return whether a scene has effects that couple sections, or turn them about t.

    Their states are integrated from tip to base and closed by shooting; in all other scenes the
    sections settle one by one.
    """
    return any(scene.has(kind) for kind in _LOADS)


def statics_of(scene: Scene, arm: Arm) -> Statics:
    """Return the statics of a scene without loads, for an arm's tendons."""
    extension = scene.has(Extension)
    if scene.has(PrintedStatics):
        return Printed(extension)
    tendons = scene.find(ExactTendons)
    if tendons is None:
        return ReferenceTangent(extension)
    return Exact(**_energy(scene, arm), careful=tendons.careful)


def loaded_statics_of(scene: Scene, arm: Arm) -> LoadedStatics:
    """Return the statics of a scene with loads, for an arm's tendons."""
    shear = scene.find(Shear)
    ratio = shear.k_s * arm.material.G / arm.material.E if shear else None
    if scene.has(ExactTendons):
        return ExactLoaded(**_energy(scene, arm), torsion=True, shear=ratio)
    cos, sin = sides(arm)
    return ReferenceLoaded(tuple(cos.tolist()), tuple(sin.tolist()), scene.has(Extension), ratio)


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
