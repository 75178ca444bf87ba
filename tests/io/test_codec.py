"""Every public effect, target and obstacle is written and read again the same."""

from __future__ import annotations

import json
import math
from typing import Any

import jsonschema
import pytest
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st

from model import Arm, InputError, Scene
from model.effects import Effect
from planner.io.codec import table, table_of, value_of
from planner.io.exact import exact, identity, plain
from planner.io.files import to_json
from planner.io.mistakes import checked
from planner.io.obstacle_tables import ObstacleTable
from planner.io.scene_file import question_of, scene_table
from planner.io.schemas import scene_schema
from tests.io.values import EFFECTS, OBSTACLES, TARGETS, arms, scenes, values_of

ARM = Arm.from_paper("table-4")
FEW = settings(
    max_examples=5,
    deadline=None,
    phases=[Phase.explicit, Phase.generate],
    suppress_health_check=list(HealthCheck),
)
MANY = settings(FEW, max_examples=100)
SCHEMA = jsonschema.Draft202012Validator(scene_schema())


def same(a: Any, b: Any) -> bool:
    """Whether values are the same but for the last digit, which a change of units may take."""
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


def check_plain(own: Any) -> None:
    """Check that a value in a saved file is read as the same to the last bit."""
    again = value_of(checked(json.loads(to_json(plain(own))), exact(type(own)), "file"))
    assert plain(again) == plain(own)
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
    assert same(plain(found), plain(target))


@pytest.mark.parametrize("kind", OBSTACLES, ids=lambda kind: kind.__name__)
@FEW
@given(data=st.data())
def test_an_obstacle_is_written_and_read_again(kind: type, data: st.DataObject) -> None:
    obstacle = data.draw(values_of(kind))
    check_plain(obstacle)
    found = value_of(checked(table_of(obstacle), ObstacleTable, "file"))
    assert same(plain(found), plain(obstacle))


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
    """Check that a scene is read again, in a file and in a plan."""
    check_plain(scene)
    assert same(plain(read_again(scene_table(ARM, scene)).scene), plain(scene))


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
    found = read_again(scene_table(arm, Scene(*_GRAVITY))).arm
    assert same(plain(found), plain(arm))


def test_an_argument_without_a_key_is_an_error_at_import() -> None:
    class Magnet(Effect):
        """An effect that nobody said how to write."""

        def __init__(self, field: complex) -> None:
            pass

        field: complex

    with pytest.raises(TypeError, match=r"Magnet\.field has no key"):
        table(Magnet)
    with pytest.raises(InputError, match="others have no keys"):
        table_of(Magnet(1.0))
