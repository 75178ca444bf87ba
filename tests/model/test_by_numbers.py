"""Derivatives of settled shapes by numbers of arm and scene, against shapes settled afresh."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from model import Anchorage, Arm, InputError, Linear, RestCurvature, Scene, settle
from model.effects import (
    Buoyancy,
    ExactTendons,
    Extension,
    Friction,
    NeoHookean,
    PointLoad,
    PointMass,
    TipLoad,
    Weight,
)
from model.equilibrium.linearised import Linearised
from model.equilibrium.newton import STAGES, Collocation
from model.equilibrium.sensitivities import ByNumbers, NumberDerivatives, along
from model.rotations import matrices
from model.transcription.layout import POSE
from model.transcription.system import neighbour
from tests.differences import fourth_order
from tests.oracles import Array

Change = Callable[[Arm, Scene, float], tuple[Arm, Scene]]
T = np.array([0.2, 0.0, 0.1, 0.0, 0.0, 0.9, 0.0, 0.0])
S = 0.11


def _arm() -> Arm:
    sections = (Anchorage(0.2, Linear(0.007, 0.003)), Anchorage(0.09, Linear(0.006, 0.006)))
    return Arm(0.2, Linear(0.01, 0.005), sections)


def _material(name: str) -> Change:
    def change(arm: Arm, scene: Scene, x: float) -> tuple[Arm, Scene]:
        return replace(
            arm, material=replace(arm.material, **{name: getattr(arm.material, name) * (1 + x)})
        ), scene

    return change


def _tip_radius(arm: Arm, scene: Scene, x: float) -> tuple[Arm, Scene]:
    return replace(arm, radius=Linear(0.01, 0.005 * (1 + x))), scene


def _anchorage(arm: Arm, scene: Scene, x: float) -> tuple[Arm, Scene]:
    outer, inner = arm.sections
    return replace(arm, sections=(outer, replace(inner, at=inner.at * (1 + x)))), scene


def _angle(arm: Arm, scene: Scene, x: float) -> tuple[Arm, Scene]:
    outer, inner = arm.sections
    turned = replace(inner, angles=(*inner.angles[:1], inner.angles[1] + x, *inner.angles[2:]))
    return replace(arm, sections=(outer, turned)), scene


def _base(arm: Arm, scene: Scene, x: float) -> tuple[Arm, Scene]:
    turned = np.array(arm.base_frame) @ Rotation.from_rotvec([0.03 * x, 0.1 * x, 0]).as_matrix()
    frame = tuple(tuple(row) for row in turned.tolist())
    return replace(arm, base_frame=frame, base_position=(0.0, 0.1 * x, 0.0)), scene


def _rest_curvature(arm: Arm, scene: Scene, x: float) -> tuple[Arm, Scene]:
    return replace(arm, rest_curvature=RestCurvature(Linear(x, 1.0), Linear(-2.0, 1 + x))), scene


def _offset_of_one(arm: Arm, scene: Scene, x: float) -> tuple[Arm, Scene]:
    outer, inner = arm.sections
    offsets = (Linear(0.007 * (1 + x), 0.003), *[outer.offsets[-1]] * 3)
    return replace(arm, sections=(replace(outer, offset=offsets), inner)), scene


def _turn_of_one(arm: Arm, scene: Scene, x: float) -> tuple[Arm, Scene]:
    outer, inner = arm.sections
    turns = (Linear(0.0, 0.3 + x), *[Linear(0.0, 0.0)] * 3)
    return replace(arm, sections=(replace(outer, turn=turns), inner)), scene


def _effect(kind: type, new: Callable[[float], object]) -> Change:
    def change(arm: Arm, scene: Scene, x: float) -> tuple[Arm, Scene]:
        others = [effect for effect in scene.effects if not isinstance(effect, kind)]
        return arm, Scene(*others, new(x))  # type: ignore[arg-type]

    return change


LOADED = Scene(
    Extension(),
    ExactTendons(),
    NeoHookean(),
    Weight(),
    Buoyancy(800.0),
    PointLoad(0.15, (0.0, 0.005, 0.0)),
    TipLoad((0.0, 0.002, 0.001)),
)
RUBBED = Scene(Extension(), ExactTendons(), Weight(), Friction(0.1))
OFF = (0.0, 0.02, -0.01)
LADEN = Scene(Extension(), ExactTendons(), Weight((0.0, 0.0, -3.0)), PointMass(0.15, 0.001, OFF))


def _mass_offset(arm: Arm, scene: Scene, x: float) -> tuple[Arm, Scene]:
    others = [effect for effect in scene.effects if not isinstance(effect, PointMass)]
    return arm, Scene(*others, PointMass(0.15, 0.001, (x, 0.02, -0.01)))


CASES: list[tuple[str, Scene, Change]] = [
    ("modulus", LOADED, _material("E")),
    ("density", LOADED, _material("density")),
    ("tip radius", LOADED, _tip_radius),
    ("anchorage", LOADED, _anchorage),
    ("angle", LOADED, _angle),
    ("base", LOADED, _base),
    ("place of a load", LOADED, _effect(PointLoad, lambda x: PointLoad(0.15 + x, (0, 0.005, 0)))),
    ("tip load", LOADED, _effect(TipLoad, lambda x: TipLoad((0.02 * x, 0.002, 0.001)))),
    ("rest curvature", LOADED, _rest_curvature),
    ("rest curvature, with friction", RUBBED, _rest_curvature),
    ("rest curvature, no loads", Scene(Extension()), _rest_curvature),
    ("offset of one tendon", LOADED, _offset_of_one),
    ("offset of one tendon, no loads", Scene(Extension(), ExactTendons()), _offset_of_one),
    ("turn of one tendon", LOADED, _turn_of_one),
    ("a mass", LADEN, _effect(PointMass, lambda x: PointMass(0.15, 0.005 + 0.1 * x, OFF))),
    ("the offset of a mass", LADEN, _mass_offset),
    ("friction", RUBBED, _effect(Friction, lambda x: Friction(0.1 + x))),
    ("anchorage, with friction", RUBBED, _anchorage),
    ("modulus, no loads", Scene(Extension()), _material("E")),
    ("anchorage, bare", Scene(), _anchorage),
]


def _seen(arm: Arm, scene: Scene) -> Array:
    """Position and frame columns at S, and the lengths of the tendons."""
    shape = settle(arm, T, scene, accuracy=1e-11 if not scene.has(Friction) else 1e-9)
    return np.concatenate([shape.position(S), shape.frame(S).ravel("F"), shape.tendon_lengths])


@pytest.mark.quick("modulus", "anchorage", "place of a load", "friction", "modulus, no loads")
@pytest.mark.parametrize(("name", "scene", "change"), CASES, ids=[case[0] for case in CASES])
def test_shapes_move_with_a_number_as_shapes_settled_afresh_do(
    name: str, scene: Scene, change: Change
) -> None:
    (arm, scene), h = change(_arm(), scene, 0.0), 1e-3
    forward = Collocation(arm, scene, STAGES, 6 if scene.has(Friction) else 4, (S,))
    here = Linearised(forward.system, forward.solve(T).x)
    high, low = (neighbour(forward.system, *change(arm, scene, h)) for h in (1e-5, -1e-5))
    columns = [
        (high.p, low.p),
        (high.length_numbers, low.length_numbers),
        (high.mesh.s, low.mesh.s),
    ]
    jacobian = NumberDerivatives(*((above - below)[:, None] / 2e-5 for above, below in columns))
    by = ByNumbers(here, jacobian, np.zeros((T.size, 1)))
    node = forward.mesh.node(S)
    places, slip = forward.system.of.nodes[node, :POSE], jacobian.s[node, 0]
    q = here.states[places][:4]
    moved = by.states[places, 0] - slip * along(here, np.array([node]))[0]
    dq = moved[:4]
    turn = 2 * (q[0] * dq[1:] - dq[0] * q[1:] - np.cross(dq[1:], q[1:]))
    turned = np.cross(turn, matrices(q).T).ravel()
    found = np.concatenate([moved[4:], turned, by.lengths[:, 0]])
    wanted = fourth_order(lambda x: _seen(*change(arm, scene, x)), h)
    assert np.abs(found - wanted).max() <= 1e-6 * np.abs(wanted).max()


def test_places_that_coincide_do_not_part() -> None:
    arm = _arm()

    def longer(x: float) -> Arm:
        return replace(arm, length=0.2 + x, radius=arm.radius)

    forward = Collocation(arm, LOADED, STAGES, 2)
    with pytest.raises(InputError, match="tie their keys"):
        neighbour(forward.system, longer(1e-5), LOADED)
