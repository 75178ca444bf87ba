"""Contact in space against springs that grow, by SciPy alone: both come to the same."""

import numpy as np
import pytest

from model import Scene, settle
from model.effects import Contact, TipLoad
from model.obstacles import HalfSpace, Sphere
from tests.contact.cases import bar
from tests.contact.penalty_rod import Ball, PenaltyRod, Wall
from tests.oracles import Array

LENGTH, RADIUS, E = 0.3, 0.006, 2e7


def _limit(values: list[Array]) -> Array:
    """Return what a sequence comes to whose steps shrink in proportion (Aitken)."""
    first, second, third = values
    before, after = second - first, third - second
    safe = np.where(np.abs(before - after) > 1e-12, before - after, 1.0)
    return np.asarray(third + after**2 / safe)


@pytest.mark.quick("a ball, and a wall at the tip")
@pytest.mark.parametrize(
    ("force", "ball", "wall"),
    [
        pytest.param(
            (0.0, 0.12, -0.25),
            Ball((0.15, 0.0, -0.05), 0.03),
            Wall((0.3, 0.03, 0.0), (0.0, -1.0, 0.0)),
            id="a ball, and a wall at the tip",
        ),
        pytest.param(
            (0.0, -0.2, 0.1),
            Ball((0.12, -0.08, 0.01), 0.06),
            Wall((0.3, 0.0, 0.02), (0.0, 0.0, -1.0)),
            id="a wide ball from the side, and a ceiling",
        ),
    ],
)
def test_springs_that_grow_come_to_contact(
    force: tuple[float, float, float], ball: Ball, wall: Wall
) -> None:
    bodies = Sphere(ball.center, ball.radius), HalfSpace(wall.point, wall.normal)
    scene = Scene(TipLoad(force=force), *map(Contact, bodies))
    shape = settle(bar(LENGTH, RADIUS, E), np.zeros(4), scene, 1e-8)
    wanted = [
        sum((t.force for t in shape.contacts if t.obstacle == body), np.zeros(3)) for body in bodies
    ]
    assert all(np.linalg.norm(own) > 0.01 for own in wanted)
    rod = PenaltyRod(LENGTH, RADIUS, E, 0.5, force, (ball, wall))
    found = [rod.settle(k) for k in (1e6, 1e7, 1e8)]
    off = [float(np.linalg.norm(tip - shape.tip)) for tip, _ in found]
    assert off[1] < 0.5 * off[0]
    assert off[2] < 0.5 * off[1]
    tip = _limit([own for own, _ in found])
    assert np.linalg.norm(tip - shape.tip) < 1e-3 * LENGTH
    for j, own in enumerate(wanted):
        loads = [load[j] for _, load in found]
        off = [float(np.linalg.norm(load - own)) for load in loads]
        assert off[2] < 0.6 * off[1] < 0.36 * off[0]
        assert np.linalg.norm(_limit(loads) - own) < min(off[2], 0.03 * np.linalg.norm(own))
