"""Mistakes of the first ten minutes: each ends with code 2 and one line with the remedy."""

from __future__ import annotations

from pathlib import Path

import pytest

from octoplan.planner.frontends.cli import main

ARM = "[arm]\npreset = 'table-4'\n"
TARGET = "[target]\ntype = 'tip-position'\nposition_mm = [200, 150, -200]\n"
LIMITS = "[limits]\ntension_max = 20\n"
OWN = "[arm]\nlength_mm = 300\nradius_mm = [10, 5]\n"

# Contents of the file; parts of the message.
FILES: dict[str, tuple[str, str]] = {
    "empty": ("", "arm: missing; `octoplan new --kind plan FILE` writes"),
    "key misspelt": (
        "[arm]\nlenght_mm = 3",
        'arm.lenght_mm: no such key; did you mean "length_mm"?',
    ),
    "unit left out of a key": (
        "[arm]\nlength = 3",
        'arm.length: no such key; did you mean "length_mm',
    ),
    "a key like one of another table": (
        ARM + "[target]\ntype = 'backbone'\npoint_mm = [[200, 150, -200]]",
        'target.point_mm: no such key; did you mean "points_mm"?',
    ),
    "an angle of another table": (
        OWN + "[[arm.sections]]\nat_mm = 300\nangle_deg = [0, 120]",
        'arm.sections[0].angle_deg: no such key; did you mean "angles_deg"?',
    ),
    "a key of another type of target": (
        ARM + "[target]\ntype = 'fetch'\nangle_deg = 30",
        "target.angle_deg: no such key (allowed here: type, proximal_deg",
    ),
    "one obstacle": (ARM + "[obstacle]", 'obstacle: no such key; did you mean "obstacles"?'),
    "table misspelt": (ARM + "[limit]\ntension_max = 3", 'did you mean "limits"?'),
    "accuracy after a table": (
        ARM + LIMITS + "accuracy = 1e-5",
        "limits.accuracy: no such key; it belongs at the top of the file, above the first [table]",
    ),
    "a key in another table": (
        ARM + "mu = 0.1",
        "arm.mu: no such key; it belongs in [effects.friction]",
    ),
    "a limit in words": (
        ARM + TARGET + "[limits]\ntension_max = '20 N'",
        "limits.tension_max = '20 N': must be a number or a list",
    ),
    "no quotes": (
        "[arm]\npreset = table-4",
        "line 2: not valid TOML: invalid value: preset = table-4; text",
    ),
    "a decimal comma": ("[arm]\nlength_mm = 300,5", "300,5; decimal numbers have a point"),
    "a unit": ("[arm]\nlength_mm = 300 mm", "its unit is in the key"),
    "no zero before the point": ("[arm]\nnu = .5", "digits on both sides of a point"),
    "a colon": ("[arm]\npreset: 'table-4'", "joined by ="),
    "a table not closed": ("[arm\npreset = 'table-4'", "line 1: not valid TOML"),
    "a table twice": (ARM + ARM, "twice: [arm]"),
    "an end in the middle": ("[arm]\npreset = 'table-4", "not valid TOML"),
    "an unknown preset": ("[arm]\npreset = 'table4'", 'table-4; did you mean "table-4"?'),
    "a preset and a length": (
        ARM + "length_mm = 300",
        "must be omitted if length_mm, radius_mm",
    ),
    "half an arm": ("[arm]\nlength_mm = 300", "no radius_mm, no sections"),
    "a negative length": (
        "[arm]\nlength_mm = -300",
        "length_mm = -300: must be a number above 0",
    ),
    "tendons outside of the body": (
        OWN + "sections = [{ at_mm = 300, offset_mm = [5, 8] }]",
        "arm.sections[0].offset_mm = [5, 8]: must be up to the radius of the body, "
        "5 mm at s = 300 mm",
    ),
    "no offset": (
        OWN + "sections = [{ at_mm = 300, offset_mm = [] }]",
        "must be [base, end] or { s_mm = [...], values_mm = [...] }",
    ),
    "one offset": (
        OWN + "sections = [{ at_mm = 300, offset_mm = 5 }]",
        "offset_mm = 5: must be a list [...] or a table { ... } of the keys s_mm, ",
    ),
    "a modulus past all numbers": (
        OWN + "sections = [{ at_mm = 300, offset_mm = [5, 4] }]\nE_kPa = 1e307",
        "E_kPa = 1e+307: must be a finite number",
    ),
    "sections from base to tip": (
        OWN
        + "sections = [{ at_mm = 100, offset_mm = [5, 5] }, { at_mm = 300, offset_mm = [5, 5] }]",
        "arm.sections[1].at_mm = 300: must be below 100 mm, tip to base",
    ),
    "rows too few": (
        "tensions = [[0, 0, 0.5, 0], [4, 0, 0, 0]]\n" + ARM,
        "tensions = 2 rows of 4, 4 numbers: must be 12 numbers, flat or a row per section",
    ),
    "numbers too few": ("tensions = [1, 2]\n" + ARM, " = 2 numbers: must be 12 numbers"),
    "a tension below 0": ("tensions = [0, 0, -1, 0, 0, 0, 0, 0, 0, 0, 0, 0]\n" + ARM, "T_13"),
    "one tension": ("tensions = 3\n" + ARM, "tensions = 3: must be a list"),
    "target of no type": (
        ARM + "[target]\nposition_mm = [1, 2, 3]",
        "target.type: missing: must be one of",
    ),
    "target type misspelt": (
        ARM + "[target]\ntype = 'tip_position'",
        'did you mean "tip-position"?',
    ),
    "a point in a plane": (
        ARM + "[target]\ntype = 'tip-position'\nposition_mm = [1, 2]",
        "target.position_mm = [1, 2]: must be a list of 3",
    ),
    "a bend of a whole turn": (
        "target = { type = 'fetch-reach', mouth_mm = [1, 2, 3], bend_deg = 200 }\n" + ARM,
        "target.bend_deg = 200: must be a number below 180",
    ),
    "a point beyond the arm": (
        ARM + "[target]\ntype = 'backbone'\ns_mm = [100, 500]\npoints_mm = [[1, 2, 3], [4, 5, 6]]",
        "target.s_mm = [100, 500]: must be up to the arm's length, 450 mm",
    ),
    "a load beyond the arm": (
        ARM + "[effects]\npoint_loads = [{ s_mm = 500, force = [0, 0, 1] }]",
        "effects.point_loads[0].s_mm = 500: must be from 0 to the arm's length, 450 mm",
    ),
    "a radius that ends in nothing": (
        OWN.replace("5]", "0]") + "sections = [{ at_mm = 300, offset_mm = [5, 0] }]",
        "arm.radius_mm = [10, 0]: must be above 0; see s = 300 mm",
    ),
    "samples that end too early": (
        "[arm]\nlength_mm = 300\nsections = [{ at_mm = 300, offset_mm = [5, 4] }]\n"
        "radius_mm = { s_mm = [0, 100, 200, 290], values_mm = [10, 9, 8, 7] }",
        "arm.radius_mm.s_mm = [0, 100, 200, 290]: must be samples from 0 to 300 mm",
    ),
    "two targets that contradict": (
        ARM + TARGET.replace("[target]", "[[targets]]") + TARGET.replace("[target]", "[[targets]]"),
        "targets[1] = a tip position: must be the only target that prescribes it; "
        "targets[0] does, too",
    ),
    **{
        f"an angle of {angle}": (
            ARM
            + f"[target]\ntype = 'bending-plane'\nangle_deg = {angle}\nbend_deg = 30\n"
            + LIMITS,
            "angle",
        )
        for angle in ("inf", "-inf", "nan", "1e308")
    },
    "a section that is not there": (
        ARM + "[target]\ntype = 'bending-plane'\nangle_deg = 1\nbend_deg = 2\nsection = 4",
        " = 4: must be a whole number from 1 to 3",
    ),
    "a frame that is none": (
        ARM + "[target]\ntype = 'tip-pose'\nposition_mm = [1, 2, 3]\ntangent = [1, 0, 0]\n"
        "normal = [0.6, 0.8, 0]",
        "normal = [0.6, 0.8, 0.0]: must be a vector at right angles to tangent = [1.0, 0.0, 0.0]",
    ),
    "an accuracy of 1": ("accuracy = 1\n" + ARM, "accuracy = 1: must be a number up to 0.1"),
    "a time limit below 0": (
        "time_limit_s = -3\n" + ARM,
        "time_limit_s = -3: must be a number above 0",
    ),
    "limits crossed": (ARM + TARGET + LIMITS + "tension_min = 30", "T_11"),
    "an effect by another name": (ARM + "[effects]\ngravity = true", "shear, tip_load, weight"),
    "a switch in place of a table": (
        ARM + "[effects]\nweight = true",
        "effects.weight = true: must be {} for the defaults, or a table of the keys g",
    ),
    "a list of effects": (ARM + "[effects]\n" + "[[effects.weight]]", "effects.weight = [{}]"),
    "an unknown norm": ("norm = 3\n" + ARM, "norm = 3: must be one of 1, 2, inf"),
    "a mesh that is not there": (
        ARM + "[[obstacles]]\ntype = 'mesh'\nfile = 'none.stl'",
        "obstacles[0].file = 'none.stl': must be a file of a closed mesh: ",
    ),
    "an arm in an obstacle from the first": (
        ARM + TARGET + LIMITS + "[effects]\nextension = true\nexact_tendons = true\n"
        "[[effects.contacts]]\ntype = 'sphere'\ncenter_mm = [100, 0, 0]\nradius_mm = 30",
        "Contact.obstacle = Sphere(center=(0.1, 0.0, 0.0), radius=0.03): must be one that",
    ),
    "no target": (
        ARM + LIMITS,
        "target: missing: must be a [target] table, such as [target] type",
    ),
    "no limits": (ARM + TARGET, "limits: missing: must be a [limits] table, such as [limits]"),
}


EFFECTS: dict[str, tuple[str, str]] = {
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
        "effects.buoyancy.density = -1",
    ),
    "negative density of a stream": (
        "current = { velocity = [0, 0, 1], density = -1 }",
        "effects.current.density = -1",
    ),
    "negative drag": (
        "current = { velocity = [0, 0, 1], coefficient = -0.1 }",
        "effects.current.coefficient = -0.1",
    ),
    "negative roughness": ("friction = { mu = -0.1 }", "effects.friction.mu = -0.1"),
    "a direction of 2": (
        "friction = { mu = 0.1, direction = 2 }",
        "effects.friction.direction = 2: must be one of -1, 1",
    ),
    "no shear stiffness": ("shear = { k_s = 0 }", "effects.shear.k_s = 0"),
    "a plane vector": (
        "weight = { g = [0, -9.81] }",
        "effects.weight.g = [0, -9.81]: must be a list of 3",
    ),
    "a vector not finite": (
        "tip_load = { moment = [0, nan, 0] }",
        "effects.tip_load.moment = [0, nan, 0]",
    ),
    "a velocity not finite": (
        "current = { velocity = [0, inf, 0] }",
        "effects.current.velocity = [0, inf, 0]",
    ),
    "a place before the base": (
        "point_loads = [{ s_mm = -1, force = [0, 0, 1] }]",
        "effects.point_loads[0].s_mm = -1",
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
        "effects.point_loads[0].s_mm = 310.1: must be",
    ),
    "directions of another arm": (
        "friction = { mu = 0.1, direction = [1, -1] }",
        "effects.friction.direction = [1, -1]",
    ),
}
TABLE_2 = "[arm]\npreset = 'table-2'\n[effects]\n"
FILES |= {f"effects: {name}": (TABLE_2 + table, told) for name, (table, told) in EFFECTS.items()}


@pytest.mark.parametrize(("text", "told"), FILES.values(), ids=FILES)
def test_a_mistake_in_a_file_is_told_in_a_line(
    text: str, told: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "mine.toml"
    path.write_text(text)
    assert main(["plan", str(path)]) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    assert captured.err.startswith(f"octoplan: {path}: ")
    assert told in captured.err
    assert captured.err.count("\n") == 1


LINES: dict[str, tuple[list[str], str]] = {
    "nothing": ([], "no command; to start: octoplan new"),
    "a command misspelt": (["paln", "mine.toml"], 'command "paln". Did you mean "plan"?'),
    "a file alone": (["mine.toml"], "for example: octoplan plan mine.toml"),
    "no file": (["plan"], "parameter SCENE requires an argument. (see octoplan plan --help)"),
    "two files": (["plan", "mine.toml", "other.toml"], "Unused Tokens: ['other.toml']"),
    "an option misspelt": (
        ["plan", "mine.toml", "--acuracy=1e-3"],
        "Unknown option: --acuracy. Did you mean --accuracy?",
    ),
    "an accuracy in words": (
        ["plan", "mine.toml", "--accuracy", "fine"],
        '--accuracy: unable to convert "fine"',
    ),
    "an accuracy out of range": (
        ["plan", "mine.toml", "--accuracy", "2"],
        '"2.0" for --accuracy. Must be <= 0.1',
    ),
    "a file that is not there": (["plan", "mien.toml"], 'did you mean "mine.toml"?'),
    "a file quite unlike": (["plan", "nowhere.toml"], "`octoplan new FILE` writes one"),
    "a folder": (["plan", "."], "is a directory"),
    "a result in place of a scene": (["plan", "plan.json"], "name ends in .toml"),
    "a file in place of a folder": (
        ["plan", "mine.toml", "--out", "plan.json"],
        "a folder, existing or new",
    ),
    "tensions that are not there": (
        ["settle", "mine.toml"],
        "mine.toml: tensions: missing: must be tensions = [[0.0, 0.0, 0.0, 0.0], [0.0, 0.0",
    ),
    "stiffness without tensions": (["stiffness", "mine.toml"], "tensions: missing"),
    "effects without tensions": (["effects", "mine.toml"], "tensions: missing"),
    "a scene written over": (["new", "mine.toml"], "a file that does not exist yet"),
    "a schema misspelt": (["schema", "scen"], 'Did you mean "scene"?'),
    "jobs in words": (["sweep", "mine.toml", "--jobs", "two"], 'unable to convert "two" into int'),
    "no folder": (["plan", "mine.toml", "--out"], "--out requires an argument"),
    "a figure without a folder": (
        ["settle", "mine.toml", "--figure", "pdf"],
        "with --figure pdf",
    ),
    "a figure of svg": (
        ["settle", "mine.toml", "--figure", "svg"],
        '"svg" for --figure. Choose from: "png", "pdf"',
    ),
    **{
        f"a time limit of {limit}": (
            ["plan", "mine.toml", "--time-limit", limit],
            "for --time-limit. Must be > 0",
        )
        for limit in ("0", "-1", "nan")
    },
    "a time limit in words": (["plan", "mine.toml", "--time-limit", "soon"], "unable to convert"),
    **{
        f"an ablation to {accuracy}": (
            ["effects", "mine.toml", f"--accuracy={accuracy}"],
            "accuracy",
        )
        for accuracy in ("0", "-1", "1", "nan")
    },
    "a schema of nothing": (
        ["schema", "tables"],
        '"tables" for WHAT. Choose from: "scene", "plan", ',
    ),
}


@pytest.mark.parametrize(("argv", "told"), LINES.values(), ids=LINES)
def test_a_mistake_on_the_command_line_is_told_in_a_line(
    argv: list[str],
    told: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    (tmp_path / "mine.toml").write_text(ARM + TARGET + LIMITS)
    (tmp_path / "plan.json").write_text("{}")
    monkeypatch.chdir(tmp_path)
    assert main(argv) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    assert captured.err.startswith("octoplan: ")
    assert told in captured.err
    assert captured.err.count("\n") == 1
    assert {path.name for path in tmp_path.iterdir()} == {"mine.toml", "plan.json"}


def test_rounded_frames_are_frames(tmp_path: Path) -> None:
    text = "[target]\ntype = 'tip-pose'\nposition_mm = [1, 2, 3]\ntangent = [0, 0.707, 0.707]\n"
    path = tmp_path / "mine.toml"
    path.write_text("tensions = [0,0,0,0,0,0,0,0,0,0,0,0]\n" + ARM + text + "normal = [1, 0, 0]\n")
    assert main(["settle", str(path)]) == 0


@pytest.mark.quick("type = 'stiffest'")
@pytest.mark.parametrize("table", ["type = 'minimum-stiffness'\nvalue = 0.45", "type = 'stiffest'"])
def test_a_stiffness_can_be_asked_for_without_a_shape(
    table: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The call ended in an error of CasADi: the target had no place on the arm."""
    path = tmp_path / "mine.toml"
    path.write_text(
        "accuracy = 1e-4\n[arm]\npreset = 'section-5.2'\n[effects]\nextension = true\n[limits]\n"
        f"tension_max = 1\n[target]\ndirection = [0, 0, 1]\n{table}\n"
    )
    assert main(["plan", str(path)]) == 0
    assert "PASSED" in capsys.readouterr().out
