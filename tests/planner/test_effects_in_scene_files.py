"""Effects in scene files: which table is which effect, and which mistakes are told."""

from __future__ import annotations

from typing import Any

import pytest

from model import InputError, Scene
from model.effects import (
    Buoyancy,
    Current,
    Effect,
    ExactTendons,
    Extension,
    Friction,
    NeoHookean,
    PointLoad,
    PointMass,
    PrintedStatics,
    Shear,
    TipLoad,
    Weight,
)
from planner.io.scene_file import read

TABLE_2 = "[arm]\npreset = 'table-2'\n[effects]\n"

TABLES: dict[str, tuple[str, tuple[Effect, ...]]] = {
    "nothing": ("", ()),
    "extension": ("extension = true", (Extension(),)),
    "extension not enabled": ("extension = false", ()),
    "exact tendons": ("exact_tendons = true", (ExactTendons(),)),
    "rubber": (
        "extension = true\nexact_tendons = true\nneo_hookean = true",
        (Extension(), ExactTendons(), NeoHookean()),
    ),
    "rubber, anticlastic": (
        "extension = true\nexact_tendons = true\nneo_hookean = true\nanticlastic = true",
        (Extension(), ExactTendons(), NeoHookean(True)),
    ),
    "as printed": ("as_printed = true", (Extension(), PrintedStatics())),
    "shear": ("shear = {}", (Shear(),)),
    "shear, corrected": ("shear = { k_s = 0.9 }", (Shear(0.9),)),
    "weight": ("weight = {}", (Weight(),)),
    "weight elsewhere": ("weight = { g = [0, -1.62, 0] }", (Weight((0.0, -1.62, 0.0)),)),
    "buoyancy": ("weight = {}\nbuoyancy = {}", (Weight(), Buoyancy())),
    "buoyancy in brine": (
        "weight = {}\nbuoyancy = { density = 1025 }",
        (Weight(), Buoyancy(1025.0)),
    ),
    "tip load": (
        "tip_load = { force = [0.001, 0, -0.002], moment = [0, 1e-5, 0] }",
        (TipLoad((0.001, 0.0, -0.002), (0.0, 1e-5, 0.0)),),
    ),
    "follower": (
        "tip_load = { force = [0, 0.001, 0], follower = true }",
        (TipLoad((0.0, 0.001, 0.0), follower=True),),
    ),
    "point loads": (
        "[[effects.point_loads]]\ns_mm = 225\nforce = [0, 0, -0.005]\n"
        "[[effects.point_loads]]\ns_mm = 100.5\nforce = [0.001, 0, 0]",
        (PointLoad(0.225, (0.0, 0.0, -0.005)), PointLoad(0.1005, (0.001, 0.0, 0.0))),
    ),
    "a mass": (
        "weight = {}\n[[effects.point_masses]]\ns_mm = 225\nmass_g = 2\n"
        "[[effects.point_masses]]\ns_mm = 225\nmass_g = 3\noffset_mm = [0, 12, -1]",
        (Weight(), PointMass(0.225, 0.002), PointMass(0.225, 0.003, (0.0, 0.012, -0.001))),
    ),
    "current": ("current = { velocity = [0, 0, 0.1] }", (Current((0.0, 0.0, 0.1)),)),
    "current of air": (
        "[effects.current]\nvelocity = [0, 3, 0]\ndensity = 1.2\ncoefficient = 1.0",
        (Current((0.0, 3.0, 0.0), 1.2, 1.0),),
    ),
    "friction": ("friction = { mu = 0.1 }", (Friction(0.1),)),
    "friction, paying out": ("friction = { mu = 0.1, direction = -1 }", (Friction(0.1, -1),)),
    "friction, each its own": (
        "friction = { mu = 0.1, direction = [1, -1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1] }",
        (Friction(0.1, (1, -1, *([1] * 10))),),
    ),
}


@pytest.mark.parametrize(("table", "effects"), TABLES.values(), ids=TABLES)
def test_a_table_of_a_scene_file_is_an_effect(table: str, effects: tuple[Effect, ...]) -> None:
    assert read((TABLE_2 + table).encode()).scene == Scene(*effects)


def test_tables_of_all_effects_together_are_a_scene() -> None:
    loads = ("shear", "buoyancy in brine", "tip load", "current", "friction", "rubber")
    text = "\n".join(TABLES[name][0] for name in (*loads, "point loads"))
    wanted = [effect for name in (*loads, "point loads") for effect in TABLES[name][1]]
    assert read((TABLE_2 + text).encode()).scene == Scene(*wanted)


REFUSED: dict[str, tuple[str, str]] = {
    "unknown effect": ("wieght = {}", 'effects.wieght: no such key; did you mean "weight"?'),
    "unknown key": ("weight = { gravity = [0, 0, 1] }", "effects.weight"),
    "unknown key of a point load": (
        "point_loads = [{ s = 0.1, force = [0, 0, 1] }]",
        "effects.point_loads[0]",
    ),
    "switch in place of a table": ("weight = true", "effects.weight"),
    "table in place of a switch": ("extension = {}", "effects.extension"),
    "number in place of a table": ("friction = 0.1", "effects.friction"),
    "number in place of a switch": ("exact_tendons = 1", "effects.exact_tendons"),
    "number in place of a vector": ("weight = { g = 9.81 }", "effects.weight.g"),
    "words in place of a number": (
        "weight = {}\nbuoyancy = { density = 'brine' }",
        "effects.buoyancy.density",
    ),
    "words in a vector": (
        "tip_load = { force = [0, 0, 'down'] }",
        "effects.tip_load.force[2]",
    ),
    "number in place of a truth": (
        "tip_load = { force = [0, 0, 1], follower = 1 }",
        "effects.tip_load.follower",
    ),
    "table in place of a list": (
        "point_loads = { s_mm = 1, force = [0, 0, 1] }",
        "effects.point_loads",
    ),
    "a way between in and out": ("friction = { mu = 0.1, direction = 0.5 }", "effects.friction"),
    "no velocity": ("current = { density = 1.2 }", "effects.current"),
    "no roughness": ("friction = {}", "effects.friction"),
    "no place": ("point_loads = [{ force = [0, 0, 1] }]", "effects.point_loads[0]"),
    "no force": (
        "point_loads = [{ s_mm = 1, force = [0, 0, 1] }, { s_mm = 2 }]",
        "effects.point_loads[1]",
    ),
    "negative density of a fluid": (
        "weight = {}\nbuoyancy = { density = -1 }",
        "effects.buoyancy.density: got -1",
    ),
    "negative density of a stream": (
        "current = { velocity = [0, 0, 1], density = -1 }",
        "effects.current.density: got -1",
    ),
    "negative drag": (
        "current = { velocity = [0, 0, 1], coefficient = -0.1 }",
        "effects.current.coefficient: got -0.1",
    ),
    "negative roughness": ("friction = { mu = -0.1 }", "effects.friction.mu: got -0.1"),
    "a direction of 2": (
        "friction = { mu = 0.1, direction = 2 }",
        "effects.friction.direction: got 2, allowed is one of 1, -1",
    ),
    "no shear stiffness": ("shear = { k_s = 0 }", "effects.shear.k_s: got 0"),
    "a plane vector": (
        "weight = { g = [0, -9.81] }",
        "effects.weight.g: got [0, -9.81], allowed is a list of 3",
    ),
    "a vector not finite": (
        "tip_load = { moment = [0, nan, 0] }",
        "effects.tip_load.moment: got [0, nan, 0]",
    ),
    "a velocity not finite": (
        "current = { velocity = [0, inf, 0] }",
        "effects.current.velocity: got [0, inf, 0]",
    ),
    "a place before the base": (
        "point_loads = [{ s_mm = -1, force = [0, 0, 1] }]",
        "effects.point_loads[0].s_mm: got -1",
    ),
    "two loads at a place": (
        "point_loads = [{ s_mm = 1, force = [0, 0, 1] }, { s_mm = 1, force = [0, 1, 0] }]",
        "once at a place",
    ),
    "buoyancy without weight": ("buoyancy = {}", "Buoyancy with Weight"),
    "rubber without extension": ("exact_tendons = true\nneo_hookean = true", "with Extension"),
    "shift without rubber": ("anticlastic = true", "effects.anticlastic"),
    "a load as printed": ("as_printed = true\nweight = {}", "written without loads"),
    "a place beyond the arm": (
        "point_loads = [{ s_mm = 310.1, force = [0, 0, 1] }]",
        "effects.point_loads[0].s_mm: got 310.1, allowed",
    ),
    "directions of another arm": (
        "friction = { mu = 0.1, direction = [1, -1] }",
        "effects.friction.direction: got [1, -1]",
    ),
}


@pytest.mark.parametrize(("table", "told"), REFUSED.values(), ids=REFUSED)
def test_a_mistake_in_a_table_is_told_by_file_and_key(table: str, told: str) -> None:
    with pytest.raises(InputError) as caught:
        read((TABLE_2 + table).encode(), "mine.toml")
    assert caught.value.field.startswith("mine.toml")
    assert told in str(caught.value)


@pytest.mark.parametrize("text", ["[effects.weight]\n", "effects = {}\n", ""], ids=repr)
def test_an_arm_is_needed_besides_effects(text: Any) -> None:
    with pytest.raises(InputError, match="arm"):
        read(text.encode())
