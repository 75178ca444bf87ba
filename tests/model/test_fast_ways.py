"""Buffered, batched and compiled: each gives the digits of the plain interpreter."""

from __future__ import annotations

import pickle
import shutil
from concurrent.futures import ThreadPoolExecutor

import casadi as ca
import numpy as np
import pytest

from model import Anchorage, Arm, Linear, Material, Scene, conical
from model.effects import ExactTendons, Extension, PrintedStatics
from model.forward import explicit_map
from model.machine.batch import Batch
from model.machine.buffered import Buffered
from model.machine.program import OPERATIONS, Program
from model.many_poses import many_poses
from model.mesh_refinement import REFINEMENTS, first_pair, next_refinement
from model.unloaded.closed_form import ClosedForm, pull_at
from model.unloaded.pulls import PullPolynomials
from model.unloaded.statics import closed_statics
from tests.model.cases import paper_tensions
from tests.oracles import Array

SCENES = {
    "bare": Scene(),
    "extension": Scene(Extension()),
    "exact": Scene(Extension(), ExactTendons()),
    "silicone": Scene.silicone(),
}
ARM = Arm.from_paper("table-4")
# A needle, and anchorages as near to the base and to each other as can be.
NEEDLE = conical(1.0, (1e-2, 1e-5), [(1.0, 9e-3, 9e-6), (0.999999, 9e-3, 9e-6), (1e-6, 9e-3, 1e-3)])
SHORT = Arm(0.3, Linear(8e-3, 4e-3), (Anchorage(0.2, Linear(5e-3, 3e-3), (0.3, 2.0)),), Material())


def batch(
    scene: Scene, arm: Arm = ARM, scheme: str = "magnus6", machine_code: bool = False
) -> Batch:
    forward = explicit_map(arm, scene, scheme, 2, (), machine_code)
    assert isinstance(forward, ClosedForm)
    polynomials = PullPolynomials.of(arm, closed_statics(scene, arm))
    assert polynomials is not None
    return Batch(forward, polynomials)


def tensions(count: int) -> Array:
    sets = [paper_tensions(np.random.default_rng(i), "table-4") for i in range(count)]
    return 0.3 * np.array(sets).T


@pytest.mark.quick("1-bare", "1-exact", "40-extension", "40-silicone")
@pytest.mark.parametrize("scene", SCENES)
@pytest.mark.parametrize("count", [1, 40, 130])
def test_batches_are_one_by_one_to_rounding(scene: str, count: int) -> None:
    tables, T = batch(SCENES[scene]), tensions(count)
    nodes = np.array([0, 3, 3, tables.h.size], np.int32)
    poses, least = tables.poses(T, nodes)
    for i in range(0, count, 13):
        states, stretch = tables.forward.run(T[:, i])
        assert np.allclose(poses[:, :, i], states[nodes], rtol=0, atol=1e-14)
        assert np.isclose(least[i], stretch.min(), rtol=0, atol=1e-14)


@pytest.mark.parametrize(
    ("scene", "scheme"), [(Scene(Extension()), "magnus4"), (Scene(PrintedStatics()), "rk4")]
)
def test_poses_of_many_arms_are_those_of_each(scene: Scene, scheme: str) -> None:
    forward, T = explicit_map(ARM, scene, scheme, 2, (0.1, 0.3)), 0.2 * tensions(37)
    nodes = [forward.mesh.node(s) for s in (0.1, 0.3, 0.45)]
    poses, least = many_poses(forward, nodes)(T)
    for i in range(0, 37, 6):
        states, stretch = forward.run(T[:, i])
        assert np.allclose(poses[:, :, i], states[nodes, :7], rtol=0, atol=1e-13)
        assert np.isclose(least[i], stretch.min(), rtol=0, atol=1e-13)


@pytest.mark.skipif(shutil.which("cc") is None, reason="no C compiler")
@pytest.mark.parametrize("scheme", ["magnus6", "magnus4", "magnus2"])
@pytest.mark.parametrize("arm", [ARM, SHORT], ids=["table 4", "tendons end before the tip"])
def test_machine_code_has_the_digits_of_the_interpreter(scheme: str, arm: Arm) -> None:
    rng = np.random.default_rng(1)
    T = rng.uniform(0, 0.2, (arm.n_tendons, 67))
    given = SCENES["extension"], arm, scheme
    nodes = np.array([0, 1, 1, batch(*given).h.size], np.int32)
    plain, fast = (batch(*given, machine_code).poses(T, nodes) for machine_code in (False, True))
    assert np.array_equal(plain[0], fast[0])
    assert np.array_equal(plain[1], fast[1])


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("cc") is None, reason="no C compiler")
def test_machine_code_says_where_sections_have_no_equilibrium() -> None:
    T = np.repeat(tensions(1), 3, axis=1) * np.array([1.0, 7.0, 0.0])
    tip, scene = np.array([batch(SCENES["exact"]).h.size], np.int32), SCENES["exact"]
    plain, fast = (batch(scene, machine_code=by).poses(T, tip)[1] for by in (False, True))
    assert np.array_equal(np.isnan(plain), [False, True, False])
    assert np.array_equal(plain, fast, equal_nan=True)


@pytest.mark.parametrize("arm", [ARM, NEEDLE, SHORT], ids=["table 4", "needle", "short"])
@pytest.mark.parametrize("scene", ["bare", "exact"])
def test_pull_carried_on_is_the_sum_over_tendons(arm: Arm, scene: str) -> None:
    statics = closed_statics(SCENES[scene], arm)
    polynomials = PullPolynomials.of(arm, statics)
    assert polynomials is not None
    s = np.sort(arm.length * np.concatenate([np.linspace(0, 1, 40), 1e-6 * np.linspace(0, 1, 9)]))
    active = np.array([sum(section.at >= place for section in arm.sections) for place in s])
    T = ca.MX.sym("T", arm.n_tendons)
    sums, _ = pull_at(arm, statics, s, active, T)
    both = ca.Function("both", [T], [polynomials.pull(T, s, active), sums])
    found, wanted = (
        np.array(v) for v in both(np.random.default_rng(0).uniform(size=arm.n_tendons))
    )
    assert np.abs(found - wanted).max() <= 1e-12 * np.abs(wanted).max()
    assert np.abs((found - wanted)[wanted != 0] / wanted[wanted != 0]).max() <= 1e-11


@pytest.mark.parametrize("name", ["<", "<=", "min", "max", "abs", "not", "trig", "where", "powers"])
def test_every_operation_does_what_casadi_does(name: str) -> None:
    x, y = ca.SX.sym("x"), ca.SX.sym("y")
    written = {
        "<": x < y,
        "<=": x <= y,
        "min": ca.fmin(x, y),
        "max": ca.fmax(x, y),
        "abs": ca.fabs(x) - 2 * y,
        "not": ca.logic_not(x),
        "trig": ca.sin(x) / ca.cos(y) - x,
        "where": ca.if_else(x < y, x, ca.sqrt(y)),
        "powers": x**2 + 1 / y - (-x),
    }[name]
    function = ca.Function("f", [x, y], [written])
    a, b = (v.ravel() for v in np.meshgrid([-2.0, -0.0, 0.5, 3.0, 1e9], [0.5, 3.0, 1e-9, 7.5]))
    program, result = Program(function), np.empty((1, a.size))
    program.run([a[None], b[None]], [result], np.empty((program.n_registers, a.size)))
    wanted = np.array(function(a[None], b[None])).ravel()
    assert np.array_equal(result[0], wanted, equal_nan=True)


def test_an_operation_that_is_not_known_is_refused() -> None:
    x = ca.SX.sym("x")
    assert ca.OP_ERF not in OPERATIONS
    with pytest.raises(NotImplementedError):
        Program(ca.Function("f", [x], [ca.erf(x)]))


def test_buffered_functions_may_be_called_from_many_threads() -> None:
    x = ca.MX.sym("x", 3)
    call = Buffered(ca.Function("f", [x], [ca.densify(x @ x.T), x.T]))
    points = np.random.default_rng(0).uniform(size=(400, 3))
    with ThreadPoolExecutor(8) as pool:
        found = list(pool.map(call, points))
    for point, (square, row) in zip(points, found, strict=True):
        assert np.array_equal(square, np.outer(point, point))
        assert np.array_equal(row[:, 0], point)


def test_a_hash_that_was_kept_stays_behind_when_a_value_travels() -> None:
    arm, scene = Arm.from_paper("table-4"), Scene(Extension())
    assert (hash(arm), hash(scene)) == (hash(Arm.from_paper("table-4")), hash(Scene(Extension())))
    for value in (arm, scene):
        packed = pickle.loads(pickle.dumps(value))
        assert packed == value
        assert "_hash" not in packed.__dict__
        assert hash(packed) == hash(value)


@pytest.mark.parametrize("accuracy", [1e-1, 1e-4, 1e-6, 1e-9, 1e-12])
@pytest.mark.parametrize("order", [2, 4, 6, 8])
def test_meshes_begin_coarser_for_less_accuracy(accuracy: float, order: int) -> None:
    coarse, fine = first_pair(accuracy, order)
    assert 2 * coarse <= fine <= 4 * coarse
    assert fine >= first_pair(min(1e-1, 10 * accuracy), order)[1]
    assert {coarse, fine} <= {*REFINEMENTS}


@pytest.mark.parametrize("error", [1e-30, 2e-6, 1e-3, 1.0, np.inf, np.nan])
@pytest.mark.parametrize("refinement", REFINEMENTS)
def test_the_next_mesh_is_finer_but_not_by_far(refinement: int, error: float) -> None:
    found = next_refinement(refinement, error, 1e-6, 6)
    if refinement == REFINEMENTS[-1]:
        assert found == 0
    else:
        assert refinement < found <= 4 * refinement
