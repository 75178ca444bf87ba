"""Plans and shapes in files: files are read as written, and bad files are refused."""

from __future__ import annotations

import csv
import io
import json
import pickle
from dataclasses import replace
from functools import reduce
from operator import getitem
from pathlib import Path
from typing import Any

import jsonschema
import numpy as np
import pytest

from octoplan.model import (
    Anchorage,
    Arm,
    InputError,
    Linear,
    Material,
    Sampled,
    Scene,
    settle,
)
from octoplan.model.effects import (
    Extension,
)
from octoplan.model.support.errors import FileError
from octoplan.planner import Plan, load_plan, plan
from octoplan.planner.frontends.commands.files import schema_of
from octoplan.planner.frontends.io.csv_files import save_shape, shape_csv
from octoplan.planner.limits import Limits
from octoplan.planner.targets import BendingPlane, TipPosition
from tests.core.planner.cases import changed

OWN = Arm(
    0.3,
    Sampled((0.0, 0.1, 0.2, 0.3), (0.012, 0.0105, 0.009, 0.007)),
    (Anchorage(0.3, Linear(0.006, 0.002), (0.1, 2.2, 4.3)), Anchorage(0.13, Linear(0.005, 0.005))),
    Material(9.9e4, 0.45, 1070.0),
    base_position=(0.1, 0.2, 1 / 3),
    hull=Linear(0.02, 0.02),
)


@pytest.fixture(scope="module")
def reached() -> Plan:
    target = BendingPlane(np.radians(135.0), np.radians(60.0))
    return plan(Arm.from_paper("table-2"), target, Scene(Extension()), 20.0)


@pytest.fixture(scope="module")
def unlimited() -> Plan:
    """Sections differ in number of tendons; maxima are infinite, the least pull is not."""
    return plan(OWN, TipPosition((0.3, 0.25, 0.3)), limits=Limits(tension_min=1e-3), accuracy=1e-5)


def stopped(after: float) -> Plan:
    scene, target = Scene.silicone(), TipPosition((0.2, 0.1, 0.1))
    return plan(Arm.from_paper("table-4"), target, scene, 20.0, time_limit=after).certify()


@pytest.fixture(scope="module")
def elsewhere(reached: Plan) -> Plan:
    """One that left the branch of the plan before."""
    return changed(reached, jump=1.13)


@pytest.mark.parametrize("which", ["reached", "unlimited", 1e-9, 0.3, "elsewhere"])
def test_a_plan_is_loaded_equal_and_certified_anew(
    which: str | float, tmp_path: Path, request: pytest.FixtureRequest
) -> None:
    p: Plan = request.getfixturevalue(which) if isinstance(which, str) else stopped(which)
    path = p.save(tmp_path / "a plan.json")
    assert [path.name for path in tmp_path.iterdir()] == ["a plan.json"]
    jsonschema.validate(json.loads(path.read_text()), schema_of("plan"))
    loaded = load_plan(path)
    assert loaded == p
    assert loaded.problem.limits == p.problem.limits
    assert loaded.certificate == p.certificate
    assert loaded.outcome == p.outcome
    assert ("tensions jump by 113 %" in loaded.outcome) == (which == "elsewhere")
    assert pickle.loads(pickle.dumps(loaded)) == p


def test_a_plan_that_does_not_settle_is_saved_as_well(reached: Plan, tmp_path: Path) -> None:
    crushing = changed(reached, tensions=np.full((3, 4), 500.0))
    assert not crushing.certificate.passed
    path = crushing.save(tmp_path / "crushed.json")
    assert json.loads(path.read_text())["tip_m"] is None
    assert load_plan(path) == crushing


def test_multipliers_of_another_problem_leave_the_outcome_a_sentence(reached: Plan) -> None:
    other = changed(reached, lam_g=reached.solution.lam_g[:-1])
    assert not other.certificate.optimal
    assert "optimality residual" in other.outcome


def test_certificates_in_files_are_not_believed(reached: Plan, tmp_path: Path) -> None:
    path = reached.save(tmp_path / "plan.json")
    table = json.loads(path.read_text())
    table["answer"]["tensions"][0] += 0.5
    path.write_text(json.dumps(table))
    assert not load_plan(path).certificate.passed


MISSING = object()
# Place and content of a fault in a plan's file, and the message.
BROKEN: dict[str, tuple[tuple[Any, ...], Any, str]] = {
    "another file": (("schema",), "octoplan shape 1", "schema = 'octoplan sh"),
    "another version": (("schema",), "octoplan plan 2", "use the version of octoplan that saved"),
    "no question": (("question",), MISSING, "question: missing; the file needs it"),
    "no arm": (("question", "arm"), MISSING, "question.arm: missing"),
    "no length": (("question", "arm", "length"), MISSING, "question.arm.length"),
    "a key more": (("question", "arm", "mass"), 1, "question.arm.mass: no such"),
    "negative length": (("question", "arm", "length"), -1.0, "Arm.length"),
    "words": (("question", "arm", "length"), "long", "question.arm"),
    "a list for a function of arc length": (
        ("question", "arm", "sections", 0, "offset"),
        [],
        "question.arm: Anchorage.offset = 0 paths",
    ),
    "another kind": (
        ("question", "scene", "effects", 0, "kind"),
        "Extention",
        "question.scene.effects[0].kind = 'Extention'",
    ),
    "arm in place of scene": (
        ("question", "scene", "kind"),
        "Arm",
        "question.scene.kind = 'Arm': must be one of Scene",
    ),
    "a tension less": (("answer", "tensions", 3), MISSING, "answer.tensions"),
    "a tension below 0": (("answer", "tensions", 3), -1.0, "answer.tensions"),
    "a tension in words": (("answer", "tensions", 3), "much", "answer.tensions[3] = 'much'"),
    "limits crossed": (("question", "limits", "lower", 1), 30.0, "T_12"),
    "no such norm": (
        ("answer", "options", "norm"),
        "3",
        "answer.options.norm = '3'",
    ),
    "a key more in an answer": (("answer", "options", "solver"), "", "options.solver: no such"),
    "a key more in limits": (("question", "limits", "middle"), [], "limits.middle: no such"),
    "a key more in a question": (("question", "clearence"), 0.0, "question.clearence: no such"),
    "no mesh": (("answer", "options", "refinement"), 0, "refinement = 0"),
    "no accuracy": (("question", "accuracy"), 0.0, "question.accuracy"),
    "a list for a kind": (
        ("question", "arm", "kind"),
        [],
        "question.arm.kind = []: must be one of",
    ),
    "a table for a kind": (
        ("question", "targets", 0, "kind"),
        {},
        "question.targets[0].kind = {}: must be one of",
    ),
    "a multiplier less": (
        ("answer", "lam_g", 0),
        MISSING,
        "answer.lam_x and answer.lam_g: must be empty or have",
    ),
    "a multiplier more": (("answer", "lam_x"), [0.0] * 13, "not 13 and"),
    "a multiplier that is none": (
        ("answer", "lam_x", 2),
        "nan",
        "answer.lam_x: must be finite numbers",
    ),
    "steps below 0": (("answer", "starts", 0, "iterations"), -1, "answer.starts[0].iterations"),
    "a jump below 0": (("answer", "jump"), -1.0, "answer.jump"),
    "no targets": (("question", "targets"), [], "question.targets"),
}


@pytest.mark.parametrize(("place", "new", "told"), BROKEN.values(), ids=BROKEN)
def test_a_spoilt_plan_is_told_with_its_place(
    place: tuple[Any, ...], new: Any, told: str, reached: Plan, tmp_path: Path
) -> None:
    path = reached.save(tmp_path / "plan.json")
    table = json.loads(path.read_text())
    *keys, last = place
    inner = reduce(getitem, keys, table)
    if new is MISSING:
        del inner[last]
    else:
        inner[last] = new
    path.write_text(json.dumps(table))
    with pytest.raises(FileError) as caught:
        load_plan(path)
    assert str(caught.value).startswith(f"{path}: ")
    assert told in str(caught.value)
    assert str(pickle.loads(pickle.dumps(caught.value))) == str(caught.value)


@pytest.mark.parametrize("content", [b"", b"{", b"[]", b"\xff\xfe", b"{}", b"[" * 100_000])
def test_what_is_no_plan_is_told(content: bytes, tmp_path: Path) -> None:
    path = tmp_path / "plan.json"
    path.write_bytes(content)
    with pytest.raises(FileError, match=r"plan\.json"):
        load_plan(path)


def test_places_that_cannot_be_written_or_read_are_told(reached: Plan, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"ends in \.json"):
        reached.save(tmp_path / "plan.txt")
    with pytest.raises(InputError, match="no such file"):
        reached.save(tmp_path / "nowhere" / "plan.json")
    with pytest.raises(FileError, match="no such file"):
        load_plan(tmp_path / "nowhere.json")
    assert list(tmp_path.iterdir()) == []


def test_what_could_not_be_read_back_is_not_saved(reached: Plan, tmp_path: Path) -> None:
    class Narrower(Linear):
        pass

    arm = replace(reached.arm, radius=Narrower(0.015, 0.0065))
    with pytest.raises(InputError, match="to save"):
        changed(reached, arm=arm).save(tmp_path / "plan.json")
    assert list(tmp_path.iterdir()) == []


def test_a_shape_as_csv_holds_the_shape_in_full(tmp_path: Path) -> None:
    shape = settle(OWN, [0.1, 0.0, 0.2, 0.0, 0.3, 0.0, 0.0], Scene(Extension()), 1e-8)
    path = save_shape(shape, tmp_path / "shape.csv", 11)
    rows = list(csv.DictReader(io.StringIO(path.read_text())))
    s = np.array([float(row["s_m"]) for row in rows])
    assert np.array_equal(s, np.linspace(0.0, 0.3, 11))
    position = [[float(row[f"{axis}_m"]) for axis in "xyz"] for row in rows]
    assert np.array_equal(position, shape.position(s))
    b = [[float(row[f"b_{axis}"]) for axis in "xyz"] for row in rows]
    assert np.array_equal(b, shape.frame(s)[:, :, 2])
    assert np.array_equal([float(row["k_1_m"]) for row in rows], shape.strain(s)[:, 2])
    assert np.array_equal([float(row["q"]) for row in rows], shape.strain(s)[:, 3])
    with pytest.raises(InputError, match="points"):
        shape_csv(shape, 1)
    with pytest.raises(InputError, match=r"ends in \.csv"):
        save_shape(shape, tmp_path / "shape.xls")
