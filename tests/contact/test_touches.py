"""Factors are kept between equilibria whose nodes touch alike."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from model.contact.touches import Touches


def test_points_that_may_move_are_not_like_nodes_that_stay() -> None:
    """Their equations differ; they were taken for the same, and places stayed where they were."""
    point = np.array([[False], [True], [False]])
    stays = Touches.at_points(point)
    moves = replace(stays, curve=np.where(point, 1.0, np.nan))
    assert not stays.like(moves)
    assert moves.like(replace(moves, curve=np.where(point, 2.0, np.nan)))
    assert not stays.like(Touches.at_points(np.roll(point, 1)))
