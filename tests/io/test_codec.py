"""Every public effect, target and obstacle is written and read again the same."""

from __future__ import annotations

import json
import math
import subprocess
import sys
from pathlib import Path
from typing import Any

import jsonschema
import pytest
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st

from octoplan.model import Arm, InputError, Scene
from octoplan.model.effects.base import Effect
from octoplan.model.extensions.obstacles import Moving
from octoplan.model.extensions.printed import PrintedStatics
from octoplan.planner.frontends.commands.files import schema_of
from octoplan.planner.frontends.io.codec import (
    encode_exact,
    identity,
    in_si,
    number_in,
    table_of,
    value_of,
)
from octoplan.planner.frontends.io.files import to_json
from octoplan.planner.frontends.io.mistakes import checked
from octoplan.planner.frontends.io.object_tables import ObstacleTable
from octoplan.planner.frontends.io.scene_file import question_of, scene_table
from octoplan.planner.frontends.io.tables import exact
from octoplan.planner.frontends.sweeps.definition import sweep_of
from octoplan.planner.targets import TipPosition
from tests.io.values import EFFECTS, OBSTACLES, TARGETS, arms, scenes, values_of

ARM, ROOT = Arm.from_paper("table-4"), Path(__file__).parents[2]
FEW = settings(
    max_examples=3,
    deadline=None,
    phases=[Phase.explicit, Phase.generate],
    suppress_health_check=list(HealthCheck),
)
MANY = settings(FEW, max_examples=100)
SCHEMA = jsonschema.Draft202012Validator(schema_of("scene"))


def same(a: Any, b: Any) -> bool:
    """Whether values are the same but for the last digit, which may change with the unit."""
    if isinstance(a, dict) and isinstance(b, dict):
        return a.keys() == b.keys() and all(same(own, b[key]) for key, own in a.items())
    if isinstance(a, list) and isinstance(b, list):
        return len(a) == len(b) and all(map(same, a, b))
    if isinstance(a, float) and isinstance(b, float):
        return math.isclose(a, b, rel_tol=4e-15, abs_tol=4e-16)
    return bool(a == b)


def read_again(raw: dict[str, Any]) -> Any:
    """Return the question of a scene file's tables, which the schema allows."""
    table = json.loads(json.dumps(raw))
    SCHEMA.validate(table)
    return question_of(table)


def swept(arm: Arm, scene: Scene, **more: Any) -> Any:
    """Return the question at the point of a sweep of one point, valid by its schema."""
    axes = {"arm.nu": [arm.material.nu]}
    sweep = sweep_of(arm, axes, scene, **more)
    SCHEMA.validate(json.loads(json.dumps(sweep.job.scene)))
    (point,) = sweep.points(0)
    return sweep.job.question(point)


def check_plain(own: Any) -> None:
    """Check that a value in a saved file is read as the same to the last bit."""
    again = value_of(checked(json.loads(to_json(encode_exact(own))), exact(type(own)), "file"))
    assert encode_exact(again) == encode_exact(own)
    assert identity(again) == identity(own)


@pytest.mark.parametrize("kind", TARGETS, ids=lambda kind: kind.__name__)
@FEW
@given(data=st.data())
def test_a_target_is_written_and_read_again(kind: type, data: st.DataObject) -> None:
    target: Any = data.draw(values_of(kind))
    check_plain(target)
    try:
        target.check(ARM)
    except InputError:
        return
    (found,) = read_again(scene_table(ARM, target=target)).targets
    assert same(encode_exact(found), encode_exact(target))
    (found,) = swept(ARM, Scene(), target=target, tension_max=5.0).targets
    assert found == target


@pytest.mark.parametrize("kind", OBSTACLES, ids=lambda kind: kind.__name__)
@FEW
@given(data=st.data())
def test_an_obstacle_is_written_and_read_again(kind: type, data: st.DataObject) -> None:
    obstacle = data.draw(values_of(kind))
    check_plain(obstacle)
    found = value_of(checked(table_of(obstacle), ObstacleTable, "file"))
    assert same(encode_exact(found), encode_exact(obstacle))
    target = TipPosition((0.3, 0.1, -0.1))
    given: dict[str, Any] = {"tension_max": 5.0, "obstacles": [obstacle]}
    if isinstance(obstacle, Moving):
        with pytest.raises(InputError, match="Moving obstacles only in a trajectory"):
            swept(ARM, Scene(), target=target, **given)
        given["waypoints"] = [table_of(target)]
    else:
        given["target"] = target
    try:
        questions = [read_again(scene_table(ARM, **given))]
        questions += [swept(ARM, Scene(), **given)] if "target" in given else []
    except InputError as reason:
        assert "obstacles" in str(reason)  # the obstacle covers the base or the target
        return
    for question in questions:
        (found,) = question.options["obstacles"]
        assert same(encode_exact(found), encode_exact(obstacle))


@FEW
@given(scene=scenes())
def test_a_scene_is_written_and_read_again(scene: Scene) -> None:
    check_scene(scene)


@pytest.mark.slow
@MANY
@given(scene=scenes())
def test_many_scenes_are_written_and_read_again(scene: Scene) -> None:
    check_scene(scene)


def check_scene(scene: Scene) -> None:
    """Check that a scene is read again, in a file, in a plan and in a sweep."""
    check_plain(scene)
    assert same(encode_exact(read_again(scene_table(ARM, scene)).scene), encode_exact(scene))
    if scene.has(PrintedStatics):
        with pytest.raises(InputError, match="without as_printed"):
            swept(ARM, scene, tensions=[0.0] * 12)
        return
    assert swept(ARM, scene, tensions=[0.0] * 12).scene == scene


@pytest.mark.parametrize("kind", EFFECTS, ids=lambda kind: kind.__name__)
@FEW
@given(data=st.data())
def test_an_effect_is_written_and_read_again(kind: type[Effect], data: st.DataObject) -> None:
    own = data.draw(values_of(kind))
    for others in (Scene(), Scene.silicone(), Scene.silicone(*_GRAVITY)):
        kept = (effect for effect in others.effects if not isinstance(effect, kind))
        try:
            scene = Scene(own, *kept)
        except InputError:
            continue
        check_scene(scene)
        return
    raise AssertionError(f"{own} goes with no scene")


_GRAVITY = tuple(kind() for kind in EFFECTS if kind.__name__ == "Weight")


@FEW
@given(arm=arms())
def test_an_arm_is_written_and_read_again(arm: Arm) -> None:
    check_plain(arm)
    scene = Scene(*_GRAVITY)
    found = read_again(scene_table(arm, scene)).arm
    assert same(encode_exact(found), encode_exact(arm))
    assert swept(arm, scene, tensions=[0.0] * arm.n_tendons).arm == arm


NEW = """
import octoplan.model.effects, octoplan.model.extensions.obstacles, octoplan.planner.targets
class Magnet({base}):
    "A value that nobody said how to write."
    field: complex
    def __init__(self, field: complex) -> None: ...
    def terms(self): ...
{package}.Magnet = Magnet
{package}.__all__.append("Magnet")
import octoplan.planner.frontends.io.scene_tables
"""
# Public names of each package, and their base classes.
PUBLIC = {
    "octoplan.model.effects": "octoplan.model.effects.base.Effect",
    "octoplan.model.extensions.obstacles": "octoplan.model.extensions.obstacles.base.Obstacle",
    "octoplan.planner.targets": "object",
}


@pytest.mark.quick("octoplan.model.effects")
@pytest.mark.parametrize("package", PUBLIC)
def test_a_public_value_that_cannot_be_written_is_an_error_at_import(package: str) -> None:
    """The packages export the value before the tables are made, which are then refused."""
    first = "import sys, types; root = types.ModuleType('octoplan.planner'); "
    first += f"root.__path__ = [{str(ROOT / 'planner')!r}]; sys.modules['octoplan.planner'] = root"
    code = f"{first}\n{NEW.format(base=PUBLIC[package], package=package)}"
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 1
    assert "TypeError: Magnet.field has no key" in done.stderr, done.stderr


@pytest.mark.parametrize(("unit", "over"), [("mm", 1e3), ("g", 1e3), ("kPa", 1e-3)])
def test_numbers_of_files_are_those_of_scripts(unit: str, over: float) -> None:
    """Used to differ in the last digit: 6.5 mm were 0.006500000000000001 m."""
    for digits in range(1, 3000):
        text = f"{digits / 10:.1f}"
        script = float(f"{text}e{-round(math.log10(over))}")
        assert in_si(float(text), unit) == script
        assert number_in(script, unit) == float(text)
