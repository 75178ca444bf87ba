"""Deferred correction: what a settled shape differs by from the mesh of a program.

A program on a coarse mesh has its optimum at a shape whose poses are off by the mesh's error d.
With d, which the shape settled to the accuracy asked for tells, added to what the program measures
(poses at the stations, compliances, eigenvalues, lengths), it is solved once more, warm; then the
settled shape meets the targets. d changes little from one solution to the next, so that one or two
corrections do. What is left of the mesh's error is in derivatives: the effort is off by its square.
Source: Stetter, "The defect correction principle and discretization methods", Numer. Math. 29
(1978).
"""

from __future__ import annotations

import numpy as np

from model.paths import Array
from model.shape import Shape
from planner.measure import compliances_along
from planner.program.problem import Problem
from planner.targets.base import Target


def defect(problem: Problem, x: Array, targets: tuple[Target, ...], shape: Shape) -> Array:
    """Return what is measured of the shape less what is of unknowns x: see Program.measured."""
    blocks, here = problem.program.blocks, problem.poses(x)
    there = shape.poses(np.array(problem.stations))
    there[:, :4] *= np.where((there * here)[:, :4].sum(axis=1) < 0, -1.0, 1.0)[:, None]
    softer = compliances_along(problem.arm, targets, shape)
    softer = softer - problem.compliances(x, problem.directions(targets))
    parts = [(there - here).ravel(), softer]
    if blocks.modes:
        parts.append(shape.stability - x[blocks.eigenvalues])
    if blocks.wound:
        parts.append(shape.tendon_lengths / problem.arm.length - x[blocks.lengths])
    return np.concatenate(parts)


def size(problem: Problem, defect: Array) -> float:
    """Return the largest part of a defect, lengths over the arm's, angles in rad."""
    poses, compliances, modes, lengths = problem.program.measured
    L = problem.arm.length
    each = [
        np.tile([1.0] * 4 + [L] * 3, poses // 7),
        np.full(compliances, L / problem.states.force),
    ]
    scale = np.concatenate([*each, np.ones(modes + lengths)])
    return float(np.abs(defect / scale).max(initial=0.0))
