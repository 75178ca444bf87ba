"""The check of a plan by another integrator than the one that found it."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial

import numpy as np

from model.centreline import Centreline
from model.clearance import KINDS, Clearance, clearances
from model.equilibrium.integration import SCHEME
from model.equilibrium.newton import LEAST_STEP, STAGES, Collocation, Followed, follow_on
from model.equilibrium.stability import stability
from model.equilibrium.verification import verified
from model.errors import OctoplanError
from model.forward import by_collocation
from model.loads import contacts, is_loaded
from model.obstacles import distances, numbers_of
from model.paths import Array
from model.progress import tell
from model.shape import Shape
from model.time_limit import OutOfTime
from planner.avoidance.surroundings import NOTHING, Surroundings
from planner.certificate import MOST_LOADS, Certificate
from planner.contact.grasp import Grasp
from planner.measure import compliances_along, measure, strokes
from planner.program.terms import stations_of, terms_of
from planner.question import Limits
from planner.solve.refine import sharper
from planner.solve.task import Task
from planner.targets.hold import WRENCH, Hold


def certify(
    task: Task,
    tensions: Array,
    settled: Callable[[], Shape],
    kkt: float,
    surroundings: Surroundings = NOTHING,
) -> Certificate:
    """Verify the settled tensions by initial value integration, and evaluate targets and limits.

    `settled` returns the shape, ten times as accurate as the task.
    """
    arm, scene, targets, tolerance = task.arm, task.scene, task.targets, task.accuracy
    excess, scheme = tension_excess(tensions, task.limits), SCHEME.name
    tell("verifying by initial value integration")
    try:
        shape = settled()
        stations, sharp = stations_of(arm, targets), sharper(tolerance)
        poses, tip, error, least, line = _integrated(shape, stations, sharp)
        least_gaps, gaps = surroundings.least, dict[str, Clearance]()
        if least_gaps:
            gaps |= clearances(line(), surroundings.obstacles, least_gaps)
    except (OctoplanError, OutOfTime) as reason:
        why = str(reason)
        if isinstance(reason, OutOfTime):
            why = "the time limit was reached before it was verified"
        return Certificate(bounds=excess, scheme=scheme, tolerance=tolerance, problem=why)
    equality, soft_residual, inequality = measure(
        arm, targets, poses, compliances_along(arm, targets, shape)
    )
    # What is left of the wrenches that are held, over their sizes.
    holds = [target for target in targets if isinstance(target, Hold)]
    if holds:
        grasps = [Grasp.of(arm, shape.contacts, hold).least for hold in holds]
        equality[WRENCH] = np.concatenate(grasps)
    over, limits = 0.0, task.limits
    if limits.strokes is not None:
        (low, high), taken = limits.strokes, strokes(shape, limits.stroke_zero)
        over = max(float((low - taken).max()), float((taken - high).max()), 0.0) / arm.length
    return Certificate(
        {name: float(np.abs(values).max()) for name, values in equality.items()},
        {name: float(np.linalg.norm(values)) for name, values in soft_residual.items()},
        {name: float(np.min(values)) for name, values in inequality.items()},
        excess,
        kkt,
        math.dist(tip, shape.tip) / arm.length,
        error,
        least,
        task.statement.margin,
        scheme,
        tolerance,
        gaps_asked={name: clear.gap for name, clear in gaps.items()},
        least_gaps=least_gaps,
        clearances_of=lambda: (
            gaps | clearances(line(), surroundings.obstacles, KINDS - gaps.keys())
        ),
        load_factor_of=lambda: _load_factor(shape),
        units=terms_of(arm, targets).units,
        strokes=over,
        complementarity=_violation(shape, line()) if contacts(scene) else None,
    )


def tension_excess(tensions: Array, limits: Limits) -> float:
    """Return the largest violation of a limit of tensions [N]."""
    low, high = np.array(limits.lower), np.array(limits.upper)
    excess = max(float((low - tensions).max()), float((tensions - high).max()), 0.0)
    if limits.total is not None:
        excess = max(excess, float(tensions.sum()) - limits.total * (1 + 1e-9))
    return excess


# Poses at the stations (K, 7), the tip (3,), its estimated error, stability, midline.
Checked = tuple[Array, Array, float, float, Callable[[], Centreline]]


def _integrated(shape: Shape, stations: tuple[float, ...], accuracy: float) -> Checked:
    """Return what initial value integration makes of a shape.

    It begins from a mesh half as fine as the shape's: what wrenches lack there is corrected to
    first order. Where that leaves the tip's pose farther off than ten times its accuracy, from that
    of the shape.
    """
    arm, scene, touching = shape.arm, shape.scene, bool(contacts(shape.scene))
    coarser = min(shape.refinement, max(2, shape.refinement // 2))
    meshes = {shape.refinement} if touching else {coarser, shape.refinement}
    scale = np.repeat([1.0, arm.length], [4, 3])
    for mesh in sorted(meshes):
        form = (STAGES, mesh, stations, is_loaded(scene), shape.machine_code)
        equilibrium = by_collocation(arm, scene, *form).solve(shape.tensions, shape.known)
        check, system = verified(equilibrium, accuracy), equilibrium.system
        poses = system.poses(check.point.states)
        gap = np.abs(poses[-1] - shape.poses(arm.length)) / scale
        if gap.max() <= 10 * accuracy:
            break
    places = [system.mesh.node(s) for s in stations]
    line = partial(Centreline.at_states, system, check.point.states)
    # The point does not tell which contacts are closed.
    least = stability(equilibrium if touching else check.point)
    return poses[places], poses[-1, 4:], check.error, least, line


def _violation(shape: Shape, line: Centreline) -> float:
    """Return by how much gap >= 0 [m], force >= 0 [N] and their product = 0 [N m] are missed."""
    bodies = numbers_of([contact.obstacle for contact in contacts(shape.scene)])
    s = np.linspace(0.0, shape.arm.length, 2001)[1:]
    places, radii = line.at(s)
    worst = float((radii[:, None] - distances(bodies, places)[0]).max(initial=-np.inf))
    for touch in shape.contacts:
        out = shape.position(touch.s) - touch.point
        force = float(touch.force @ out) / float(np.linalg.norm(out))
        worst = max(worst, -force, abs(force * touch.gap))
    return max(worst, 0.0)


def _load_factor(shape: Shape) -> float | None:
    """Return how many times its loads an arm bears, infinite if more than it is followed.

    None without loads, and of an arm in contact.
    """
    if not is_loaded(shape.scene) or contacts(shape.scene):
        return None
    coarsest = Collocation(shape.arm, shape.scene, STAGES, 1, (), True, shape.machine_code)
    begin = Followed(coarsest.solve(shape.tensions, shape.known), 1.0, "")
    end = follow_on(begin, MOST_LOADS, LEAST_STEP)
    return end.load if end.why else np.inf
