"""What data cannot tell is named, with what it trades."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from planner import Unknown, calibrate
from planner.fit.covariance import information
from tests.calibrate.cases import HANGING, small_arm, synthetic

SCALE = tuple(f"tension_scale[{j}]" for j in range(3))
E = Unknown("arm.E_kPa", 50, 300)
DENSITY = Unknown("arm.density", 500, 2000)


def test_the_unit_of_tension_trades_with_modulus_and_density() -> None:
    shapes = synthetic(small_arm(), HANGING, 1e-3, 0)
    scale = Unknown(SCALE, 0.5, 2)
    found = calibrate(small_arm(), HANGING, shapes, [E, DENSITY, scale])
    (direction,) = found.unidentified
    assert set(direction.names) == {"arm.E_kPa", "arm.density", " = ".join(SCALE)}
    changes = dict(zip(direction.names, direction.changes, strict=True))
    ratios = [changes[own.name] / found.values[k] for k, own in enumerate(found.unknowns)]
    assert ratios == pytest.approx([ratios[0]] * 3, rel=1e-4)
    assert np.all(np.isinf(found.std))
    assert "trades with" in found.outcome


def test_what_changes_nothing_is_named_alone() -> None:
    hidden = Unknown("arm.sections[0].angles_deg[1]", 60, 180)
    pulls = [[T[0], 0.0, T[2]] for T in ([1, 0, 0.2], [0, 0, 1], [2, 0, 0])]
    shapes = synthetic(small_arm(), HANGING, 1e-3, 0, pulls)
    found = calibrate(small_arm(), HANGING, shapes, [E, hidden])
    (direction,) = found.unidentified
    assert direction.names == (hidden.name,)
    assert np.isfinite(found.std[0])
    assert np.isinf(found.std[1])


@pytest.mark.parametrize("seed", range(5))
def test_covariance_and_null_space_are_those_of_linear_algebra(seed: int) -> None:
    rng = np.random.default_rng(seed)
    J = rng.normal(size=(30, 5)) * 10.0 ** rng.uniform(-1, 3, 5)
    whole = information(J)
    assert np.allclose(whole.covariance, np.linalg.inv(J.T @ J), rtol=1e-6)
    J[:, 3] = 2 * J[:, 1]
    part = information(J)
    (v,) = [v for v, std in part.directions if np.isinf(std)]
    assert np.allclose(J @ v, 0, atol=1e-6 * np.abs(J).max())
    assert np.isinf(np.diag(part.covariance)).tolist() == [False, True, False, True, False]
    kept = [0, 2, 4]
    seen = np.linalg.inv(J[:, [0, 1, 2, 4]].T @ J[:, [0, 1, 2, 4]])[np.ix_([0, 2, 3], [0, 2, 3])]
    assert np.allclose(part.covariance[np.ix_(kept, kept)], seen, rtol=1e-6)


def test_the_next_shapes_are_those_that_tell_most() -> None:
    shapes = synthetic(small_arm(), HANGING, 1e-3, 0)[:2]
    found = calibrate(small_arm(), HANGING, shapes, [E, DENSITY])
    ranked = found.next([[0.01, 0, 0], [2.5, 0, 0], [0.5, 0.5, 0.5]])
    assert ranked[0].place == 1
    assert ranked[0].gain > ranked[-1].gain >= 0
    more = synthetic(small_arm(), HANGING, 1e-3, 7, [[2.5, 0, 0]])
    more = [replace(shape, name=f"more {i}") for i, shape in enumerate(more)]
    again = calibrate(small_arm(), HANGING, [*shapes, *more], [E, DENSITY])
    assert again.std[0] / again.noise < found.std[0] / found.noise
