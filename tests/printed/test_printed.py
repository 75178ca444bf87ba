"""The equations that the paper prints, and their differences from the consistent equations."""

from __future__ import annotations

import numpy as np
import pytest

from octoplan.model import Arm, Scene, settle
from octoplan.model.extensions.printed import PrintedStatics
from tests.core.model.cases import paper_tensions
from tests.oracles import (
    Array,
    balance,
    body_stiffness,
    paper_rod,
    printed_rate,
    printed_states,
)

ROD, ARM = paper_rod("table-4"), Arm.from_paper("table-4")
PRINTED = Scene.as_printed()
SEEDS = range(20)


def drawn(seed: int) -> tuple[Array, float, Array]:
    """Return random tensions, arc length and (tau, xi, k)."""
    rng = np.random.default_rng(seed)
    T = paper_tensions(rng, "table-4")
    return T, float(rng.uniform(0, ROD.length)), rng.uniform(-20, 20, 3)


@pytest.mark.parametrize("torsion", [True, False], ids=["torsion", "bending"])
@pytest.mark.parametrize("seed", SEEDS)
def test_printed_moments_lack_the_turning_of_the_frame(seed: int, torsion: bool) -> None:
    """The moments of the oracle, which the printed scene must match below, are right without
    torsion.
    """
    T, s, omega = drawn(seed)
    omega = omega * [torsion, 1, 1]
    h, active = 1e-2, ROD.active(s)
    # Quartic in s at most, so that five points are exact.
    rows = [balance(ROD, T, s + i * h, active) for i in (-2, -1, 0, 1, 2)]
    D, m = (np.array(own) for own in zip(*rows, strict=True))
    D_slope, m_slope = (np.tensordot([1, -8, 0, 8, -1], own, 1) / (12 * h) for own in (D, m))
    consistent = m_slope - D_slope @ omega + np.cross(omega, m[2] - D[2] @ omega)
    found = D[2] @ printed_rate(ROD, T, s, omega, active)
    turning = np.cross(omega, body_stiffness(ROD, s) * omega)
    bends = slice(None) if torsion else slice(1, None)
    assert np.linalg.norm((found - consistent - turning)[bends]) <= 1e-9 * np.linalg.norm(found)
    assert (np.linalg.norm(turning[1:]) > 1e-5 * np.linalg.norm(found)) == torsion


@pytest.mark.quick("0", "1", "2")
@pytest.mark.parametrize("seed", SEEDS)
def test_printed_scene_settles_to_what_its_equations_integrate_to(seed: int) -> None:
    T, _, _ = drawn(seed)
    s = np.unique([0.0, 0.05, 0.135, 0.2, 0.315, 0.4, 0.45])
    shape = settle(ARM, T, PRINTED, accuracy=1e-10)
    strains, position, frame = printed_states(ROD, T, s)
    gap = np.linalg.norm((shape.strain(s) - strains)[:, :3], axis=1)
    assert np.abs(strains[:-1, 0]).max() > 1e-3
    assert np.all(gap <= 1e-7 * np.linalg.norm(strains[:, :3], axis=1))
    assert np.abs(shape.strain(s)[:, 3] - strains[:, 3]).max() <= 1e-8
    assert np.linalg.norm(shape.position(s) - position, axis=1).max() <= 1e-9 * ROD.length
    assert np.abs(shape.frame(s) - frame).max() <= 1e-8


def test_printed_statics_without_extension_bend_alike_and_shorten_nothing() -> None:
    T, _, _ = drawn(0)
    s = np.linspace(0, ROD.length, 9)
    with_q = settle(ARM, T, PRINTED, accuracy=1e-9)
    without = settle(ARM, T, Scene(PrintedStatics()), accuracy=1e-9)
    assert np.all(without.strain(s)[:, 3] == 0)
    assert np.all(with_q.strain(s)[:, 3] < -0.02)
    gap = np.linalg.norm((without.strain(s) - with_q.strain(s))[:, :3], axis=1)
    assert np.all(gap <= 1e-5 * np.linalg.norm(with_q.strain(s)[:, :3], axis=1))
    assert np.any(without.strain(s)[:, 0] != 0)
