"""Scene files: each argument of a script has a key, and the schema has the same keys."""

from __future__ import annotations

import dataclasses
import json
import tomllib
from pathlib import Path
from typing import Any

import jsonschema
import numpy as np
import pytest

from octoplan.model import (
    Anchorage,
    Arm,
    Linear,
    Material,
    PiecewiseLinear,
    RestCurvature,
    Sampled,
    Scene,
    settle,
)
from octoplan.model.arm import PAPER_ARMS
from octoplan.model.effects import (
    Buoyancy,
    Current,
    ExactTendons,
    Extension,
    LineLoad,
    NeoHookean,
    PointLoad,
    PointMass,
    Shear,
    TipLoad,
    Weight,
)
from octoplan.model.effects.base import Effect
from octoplan.model.extensions.friction import Friction
from octoplan.model.extensions.obstacles import Sphere
from octoplan.model.extensions.printed import PrintedStatics
from octoplan.model.support.errors import FileError
from octoplan.planner import plan
from octoplan.planner.extensions.contact import Hold
from octoplan.planner.frontends.commands.files import schema_of
from octoplan.planner.frontends.io.object_tables import ArmTable
from octoplan.planner.frontends.io.scene_file import load, read
from octoplan.planner.frontends.io.scene_tables import SceneTable
from octoplan.planner.limits import Limits
from octoplan.planner.targets import (
    Backbone,
    Bend,
    BendingPlane,
    Fetch,
    MinimumStiffness,
    Softest,
    Stiffest,
    Target,
    TipPointing,
    TipPose,
    TipPosition,
)

SCENES = sorted((Path(__file__).parents[2] / "studies" / "scenes").glob("*.toml"))
TABLE_2 = "[arm]\npreset = 'table-2'\n"
SCHEMA: dict[str, Any] = json.loads(json.dumps(schema_of("scene")))
VALIDATOR = jsonschema.Draft202012Validator(SCHEMA)

TARGETS: dict[str, tuple[str, Target]] = {
    "plane": (
        "type = 'bending-plane'\nangle_deg = 30\nbend_deg = 60\nsection = 2",
        BendingPlane(np.radians(30.0), np.radians(60.0), 2),
    ),
    "position": ("type = 'tip-position'\nposition_mm = [1, 2, 4]", TipPosition((1e-3, 2e-3, 4e-3))),
    "pose": (
        "type = 'tip-pose'\nposition_mm = [0, 0, 1]\ntangent = [0, 1, 0]\nnormal = [1, 0, 0]",
        TipPose((0.0, 0.0, 1e-3), ((0, 1, 0), (1, 0, 0), (0, 0, -1))),
    ),
    "pointing": (
        "type = 'tip-pointing'\nposition_mm = [1, 2, 4]\ndirection = [3, 0, -4]\nweights = [2, 1]",
        TipPointing((1e-3, 2e-3, 4e-3), (0.6, 0, -0.8), (2.0, 1.0)),
    ),
    "backbone": (
        "type = 'backbone'\npoints_mm = [[100, 0, 0], [200, 0, 8]]\ns_mm = [125, 250]\n"
        "weights = [1, 2]",
        Backbone(((0.1, 0, 0), (0.2, 0, 0.008)), (0.125, 0.25), (1.0, 2.0)),
    ),
    "fetch": (
        "type = 'fetch'\nproximal_deg = [60, 0]\nmedial_deg = [0, 0]\ndistal_deg = [30, 90]",
        Fetch(
            Bend(np.radians(60.0), 0.0), Bend(0.0, 0.0), Bend(np.radians(30.0), np.radians(90.0))
        ),
    ),
    "reach": (
        "type = 'fetch-reach'\nmouth_mm = [0, 0, -50]\nbend_deg = 45\nplane_deg = 180",
        Fetch.reach((0.0, 0.0, -0.05), np.radians(45.0), np.pi),
    ),
    "hold": (
        "type = 'hold'\nforce = [0, 0, 0.02]\nfriction = 0.5\n"
        "obstacle = { type = 'sphere', center_mm = [200, 0, -40], radius_mm = 20 }",
        Hold(Sphere((0.2, 0.0, -0.04), 0.02), (0.0, 0.0, 0.02), 0.5),
    ),
    "stiff": (
        "type = 'minimum-stiffness'\ndirection = [0, 0, 2]\nvalue = 0.5\nhold = 'length'\n"
        "tendon_EA = 100",
        MinimumStiffness((0, 0, 1), 0.5, "length", 100.0),
    ),
    "stiff all round": (
        "type = 'minimum-stiffness'\nmatrix = [[2, 0, 0], [0, 1, 0], [0, 0, 1]]\nvalue = 0.5",
        MinimumStiffness(((2, 0, 0), (0, 1, 0), (0, 0, 1)), 0.5),
    ),
    "stiffest": ("type = 'stiffest'\ndirection = [0, 1, 0]", Stiffest((0, 1, 0))),
    "softest": (
        "type = 'softest'\ndirection = [1, 0, 0]\nhold = 'length'",
        Softest((1, 0, 0), hold="length"),
    ),
}


@pytest.mark.parametrize(("table", "target"), TARGETS.values(), ids=TARGETS)
def test_a_target_table_is_a_target(table: str, target: Target) -> None:
    text = f"{TABLE_2}[target]\n{table}"
    assert read(text.encode()).targets == (target,)
    VALIDATOR.validate(tomllib.loads(text))


EFFECTS: dict[str, tuple[str, tuple[Effect, ...]]] = {
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
    "silicone": ("silicone = true\nweight = {}", Scene.silicone(Weight()).effects),
    "silicone, anticlastic": (
        "silicone = true\nanticlastic = true",
        Scene.silicone(NeoHookean(anticlastic=True)).effects,
    ),
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
    "moment": (
        "[[effects.point_loads]]\ns_mm = 225\nforce = [0, 0, -0.005]\nmoment = [0, 0, 1e-4]",
        (PointLoad(0.225, (0.0, 0.0, -0.005), (0.0, 0.0, 1e-4)),),
    ),
    "line loads": (
        "[[effects.line_loads]]\nforce = [0, 0.1, 0]\nmoment = [0, 0, 1e-3]\nbegin_mm = 100\n"
        "end_mm = 200\nfollower = true\n[[effects.line_loads]]\nforce = [0, 0, -0.2]",
        (
            LineLoad((0.0, 0.1, 0.0), (0.0, 0.0, 1e-3), 0.1, 0.2, True),
            LineLoad((0.0, 0.0, -0.2)),
        ),
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


@pytest.mark.parametrize(("table", "effects"), EFFECTS.values(), ids=EFFECTS)
def test_a_table_of_a_scene_file_is_an_effect(table: str, effects: tuple[Effect, ...]) -> None:
    assert read((TABLE_2 + "[effects]\n" + table).encode()).scene == Scene(*effects)


def test_targets_combine() -> None:
    both = "".join(f"[[targets]]\n{TARGETS[name][0]}\n" for name in ("position", "stiff"))
    targets = read((TABLE_2 + both).encode()).targets
    assert targets == (TARGETS["position"][1], TARGETS["stiff"][1])


def test_every_field_of_an_arm_has_a_key() -> None:
    text = """
    [arm]
    length_mm = 250
    radius_mm = { s_mm = [0, 50, 125, 250], values_mm = [8, 7, 6, 4] }
    E_kPa = 125
    nu = 0.25
    density = 1000
    base_frame = { tangent = [0, 0, 1], normal = [1, 0, 0] }
    base_position_mm = [125, 0, 250]
    hull_mm = [16, 16]
    sections = [
      { at_mm = 250, offset_mm = [16, 8], angles_deg = [0, 180] },
      { at_mm = 125, offset_mm = { interpolation = "linear", s_mm = [
        0, 100, 125], values_mm = [8, 8, 4] } },
      { at_mm = 100, angles_deg = [0, 180], turn_deg = [[0, 90], [0, -180]], offset_mm = [
        [8, 4], { s_mm = [0, 50, 75, 100], values_mm = [8, 8, 8, 4] }] },
      { at_mm = 75, angles_deg = [0, 180], turn_deg = [0, 90], offset_mm = [
        4, 4], guides_mm = [25, 50] },
    ]
    rest_curvature = { b = { s_mm = [0, 50, 125, 250], values = [0, 1, 2, 1] } }
    [effects]
    weight = {}
    """
    mm = 1e-3
    arm = Arm(
        0.25,
        Sampled((0, 50 * mm, 0.125, 0.25), (8 * mm, 7 * mm, 6 * mm, 4 * mm)),
        (
            Anchorage(0.25, Linear(16 * mm, 8 * mm), (0.0, np.pi)),
            Anchorage(0.125, PiecewiseLinear((0, 0.1, 0.125), (8 * mm, 8 * mm, 4 * mm))),
            Anchorage(
                0.1,
                (
                    Linear(8 * mm, 4 * mm),
                    Sampled((0, 50 * mm, 75 * mm, 0.1), (8 * mm, 8 * mm, 8 * mm, 4 * mm)),
                ),
                (0.0, np.pi),
                (Linear(0.0, np.pi / 2), Linear(0.0, -np.pi)),
            ),
            Anchorage(
                75 * mm,
                Linear(4 * mm, 4 * mm),
                (0.0, np.pi),
                Linear(0.0, np.pi / 2),
                (25 * mm, 50 * mm),
            ),
        ),
        Material(125e3, 0.25, 1000.0),
        ((0, 1, 0), (0, 0, 1), (1, 0, 0)),
        (0.125, 0, 0.25),
        Linear(16 * mm, 16 * mm),
        RestCurvature(b=Sampled((0, 50 * mm, 0.125, 0.25), (0.0, 1.0, 2.0, 1.0))),
    )
    assert read(text.encode()).arm == arm
    keys = {key.split("_mm")[0] for key in ArmTable.__struct_fields__}
    fields = {f.name for f in dataclasses.fields(Arm)} - {"material"}
    assert fields | {"E_kPa", "nu", "density", "preset", "base_rotation_deg"} == keys


@pytest.mark.parametrize("name", PAPER_ARMS)
def test_a_preset_is_an_arm_of_the_paper_of_another_material_if_wanted(name: str) -> None:
    assert read(f"[arm]\npreset = '{name}'".encode()).arm == Arm.from_paper(name)
    soft = read(f"[arm]\npreset = '{name}'\nE_kPa = 55".encode()).arm
    assert soft == dataclasses.replace(Arm.from_paper(name), material=Material(55e3))


def test_limits_and_what_is_asked_of_stiffness_are_read() -> None:
    text = (
        "norm = 1\naccuracy = 1e-4\ncompile = 'auto'\n"
        "tensions = [1,2,3,4,5,6,7,8,9,1,2,3]\n"
        + TABLE_2
        + "[limits]\ntension_max = [[1, 2, 3, 4], [5, 6, 7, 8], [9, 10, 11, 12]]\n"
        "tension_min = 0.5\ntotal_pull = 30\n"
        "[stiffness]\nhold = 'length'\nat_mm = 250\ntendon_EA = 1000\nrelease = true"
    )
    question = read(text.encode())
    assert question.tensions == [1, 2, 3, 4, 5, 6, 7, 8, 9, 1, 2, 3]
    assert question.of(plan) == {
        "accuracy": 1e-4,
        "compile": "auto",
        "norm": 1,
        "clearance": 0.0,
        "self_clearance": False,
        "obstacles": [],
        "stroke_zero": "straight",
        "limits": Limits(((1, 2, 3, 4), (5, 6, 7, 8), (9, 10, 11, 12)), 0.5, 30),
    }
    assert question.of(settle) == {"accuracy": 1e-4, "compile": "auto", "tendon_outside": 0.0}
    assert question.stiffness == {"hold": "length", "at": 0.25, "tendon_EA": 1e3, "release": True}
    VALIDATOR.validate(tomllib.loads(text))


@pytest.mark.parametrize("path", SCENES, ids=lambda path: path.stem)
def test_every_scene_of_the_studies_is_read_and_valid(path: Path) -> None:
    load(path)
    VALIDATOR.validate(tomllib.loads(path.read_text()))


def test_the_schema_is_one() -> None:
    jsonschema.Draft202012Validator.check_schema(SCHEMA)
    top = SCHEMA["$defs"]["SceneTable"]
    assert set(top["properties"]) == set(SceneTable.__struct_fields__)
    assert top["required"] == ["arm"]


BROKEN = {
    "unknown key": "[arm]\npreset = 'table-2'\nlength = 3",
    "unknown preset": "[arm]\npreset = 'table-9'",
    "compile by another word": "compile = 'try'\n" + TABLE_2,
    "wrong type": "accuracy = 'fine'\n" + TABLE_2,
    "accuracy out of range": "accuracy = 0.5\n" + TABLE_2,
    "negative length": "[arm]\nlength_mm = -300",
    "no arm": "accuracy = 1e-6",
    "no type of target": TABLE_2 + "[target]\nposition_mm = [1, 2, 3]",
    "a position in a plane": TABLE_2 + "[target]\ntype = 'tip-position'\nposition_mm = [1, 2]",
    "no density": TABLE_2 + "[effects]\nweight = {}\nbuoyancy = { density = -1 }",
    "a grip without friction": TABLE_2 + f"[target]\n{TARGETS['hold'][0]}".replace("0.5", "-0.5"),
    "a way between": TABLE_2 + "[effects]\nfriction = { mu = 0.1, direction = 0.5 }",
}


@pytest.mark.parametrize("text", BROKEN.values(), ids=BROKEN)
def test_what_the_schema_refuses_is_refused(text: str) -> None:
    with pytest.raises(jsonschema.ValidationError):
        VALIDATOR.validate(tomllib.loads(text))
    with pytest.raises(FileError):
        read(text.encode())


def test_of_two_places_of_one_value_the_one_that_is_wrong_is_told() -> None:
    rows = ", ".join(f"{{ at_mm = {at}, offset_mm = [5, 3] }}" for at in (300, 200, 200))
    text = f"[arm]\nlength_mm = 300\nradius_mm = [10, 5]\nsections = [{rows}]"
    with pytest.raises(FileError) as caught:
        read(text.encode())
    assert caught.value.where == "arm.sections[2].at_mm"
