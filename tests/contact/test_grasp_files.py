"""Wraps and holds in scene files."""

import pytest

from model.errors import FileError
from model.obstacles import Box, Capsule, HalfSpace, Obstacle, Sphere
from planner.io.codec import table_of
from planner.io.scene_file import read
from planner.targets import Hold, Target, Wrap

ROD = Capsule((0.25, -0.15, -0.045), (0.25, 0.15, -0.045), 0.02)
BODIES: dict[str, Obstacle] = {
    "capsule": ROD,
    "sphere": Sphere((0.2, 0.0, -0.04), 0.02),
    "box": Box((0.2, 0.0, -0.04), (0.02, 0.03, 0.04), ((0, -1, 0), (1, 0, 0), (0, 0, 1))),
    "half-space": HalfSpace((0.0, 0.0, -0.05), (0.0, 0.0, 2.0)),
}
TARGETS: dict[str, Target] = {
    "length": Wrap(ROD, length=0.15, start=0.25, tolerance=0.3),
    "turns": Wrap(ROD, turns=0.75),
    "force": Hold(ROD, (0.0, 0.0, 0.02), 0.5),
    "wrench": Hold(ROD, (0.0, 0.0, 0.02, 0.001, 0.0, 0.0)),
    **{name: Wrap(body, length=0.1) for name, body in BODIES.items()},
}
SCENE = b"""
[arm]
preset = "table-4"
[effects]
contacts = [{ type = "sphere", center_mm = [200, 0, -40], radius_mm = 20 }]
[target]
type = "hold"
force = [0, 0, 0.02]
friction = %s
obstacle = { type = "sphere", center_mm = [200, 0, -40], radius_mm = 20 }
[limits]
tension_max = 20
"""


@pytest.mark.parametrize("name", TARGETS)
def test_tables_of_targets_read_back_as_they_were(name: str) -> None:
    table = table_of(TARGETS[name])
    keys = "\n".join(f"{key} = {_toml(own)}" for key, own in table.items())
    text = f'[arm]\npreset = "table-4"\n[target]\n{keys}\n[limits]\ntension_max = 20\n'
    [found] = read(text.encode()).targets
    assert found == TARGETS[name]


def _toml(value: object) -> str:
    if isinstance(value, dict):
        return "{ " + ", ".join(f"{key} = {_toml(own)}" for key, own in value.items()) + " }"
    return repr(value).replace("'", '"')


def test_a_scene_file_asks_for_a_hold_and_its_mistakes_are_named() -> None:
    [hold] = read(SCENE % b"0.5").targets
    assert hold == Hold(BODIES["sphere"], (0.0, 0.0, 0.02), 0.5)
    with pytest.raises(FileError, match="friction"):
        read(SCENE % b"-0.5")
