"""Settle an arm: solve its static equilibrium, on meshes that are refined to an accuracy."""

from __future__ import annotations

import logging
import math
import time
from collections.abc import Callable
from contextlib import nullcontext
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from octoplan.model.arm import Arm
from octoplan.model.equilibrium.continuation import MAX_TOLERANCE_FACTOR
from octoplan.model.equilibrium.linearised import AnyEquilibrium, check_stretch
from octoplan.model.equilibrium.newton import STEP_TOL
from octoplan.model.forward import (
    FINEST,
    ORDER,
    REMEDY,
    ForwardMap,
    ForwardMaps,
    checked_accuracy,
    first_pair,
    forward_maps,
    initial_estimate,
    next_refinement,
    updated_estimate,
)
from octoplan.model.loads import check_loads, with_loads_of
from octoplan.model.scene import Scene
from octoplan.model.shape import Shape, guide_remark, sharp, stretched
from octoplan.model.support.checks import finite, kind
from octoplan.model.support.errors import (
    ConvergenceError,
    Described,
    InputError,
    ShapeWarning,
    SnapError,
    UnsettledSectionError,
)
from octoplan.model.support.machine.compiled import Compile, checked_compile
from octoplan.model.support.progress import check_time, limited, timeout, with_progress
from octoplan.model.support.units import called_by_a_script, warn

LOG = logging.getLogger(__name__)

# The default tip error over arm length.
ACCURACY = 1e-6
# Refinement below which a mesh may be too coarse to decide that the arm snaps.
_DECISIVE_REFINEMENT = 16
# Text of the warning about sharp bends: constant, so that Python shows it once per line.
BENT = "the arm bends sharper than its own radius; see `remarks` of the shape"
# Text of the warning about stretch: constant, so that Python shows it once per line.
STRETCHED = "the arm is stretched beyond the law of its body; see `remarks` of the shape"
# Text of the warning about discs: constant, so that Python shows it once per line.
FEW_DISCS = "discs may be too few for continuous guides; see `remarks` of the shape"
# The remedy if the strains jump and even the finest mesh will be too coarse.
SMOOTHER = (
    "its strains jump at s = {:.6g} m, where tendons have two equilibria; lower the tensions that "
    "cross this section or ask for less accuracy"
)

# The limit of the time of a mesh in scenes without one.
_NO_LIMIT = nullcontext()

# Forward map, nearby equilibrium, factor of Newton's tolerance -> equilibrium.
Solve = Callable[[ForwardMap, AnyEquilibrium | None, float], AnyEquilibrium]


class SettlingProblem(NamedTuple):
    """The arguments of `settle`; effects may solve the problem in their own way.

    Attributes
    ----------
    arm : Arm
    scene : Scene
    accuracy : float
    machine_code : bool
        Whether kernels are compiled.
    tensions, lengths, tendon_EA, tendon_outside
        As given to `settle`.
    near : Shape or None
    """

    arm: Arm
    scene: Scene
    accuracy: float
    machine_code: bool
    tensions: Any
    lengths: Any
    tendon_EA: Any
    tendon_outside: Any
    near: Shape | None


@with_progress
def settle(
    arm: Arm,
    tensions: Any = None,
    scene: Scene | None = None,
    accuracy: float = ACCURACY,
    compile: Compile = False,  # noqa: A002  (the name that scripts use)
    *,
    lengths: Any = None,
    tendon_EA: float | None = None,
    tendon_outside: float = 0.0,
    near: Shape | None = None,
    time_limit: float | None = None,
    progress: bool | None = None,
) -> Shape:
    """Return the shape of an arm in static equilibrium under tensions or with tendon lengths.

    With lengths, the shape has the least energy among the shapes whose tendons are no longer than
    given. Each tendon is taut and pulls, or is slack; see `Shape.tensions` and `Shape.slack`.
    Inextensible tendons may leave tensions undetermined (`Shape.undetermined`); then the tensions
    have the least norm. The paper's tangent has no energy: several shapes may have the same
    lengths.

    Parameters
    ----------
    arm : Arm
    tensions : (n_sections, n) or (n_tendons,)
        [N], tip section first. Pass None or NaN for tendons with a given length.
    scene : Scene
        The enabled effects. The default is `Scene()`, bending only.
    accuracy : float
        Accepted tip error over arm length, from 1e-12 to 0.1. Meshes are refined until the tips on
        two meshes agree. Under loads, the accuracy also holds for points one base radius off the
        tip.
    compile : bool or "auto"
        Whether to use compiled code, which has the same digits and is several times faster. A C
        compiler builds the code of each kind of scene in seconds, once per user. "auto" warns and
        uses interpreted code if no compiler works.
    lengths : (n_sections, n) or (n_tendons,)
        Length of each tendon between base and anchorage without tension, set by a winch [m]. Pass
        None or NaN for tendons with a given tension.
    tendon_EA : float
        Stiffness E A of the tendons with given lengths [N]; the default is inextensible tendons.
    tendon_outside : float
        Length of each tendon between winch and base, which also stretches [m]. The stretch ignores
        friction in the arm.
    near : Shape
        A shape of the same arm from which the arm moves: first the loads change linearly to the
        loads of `scene`, then the tensions change linearly to `tensions`. Both scenes have the same
        effects. Loads may differ in strength, and the scene of `near` may lack loads, such as a
        payload that the bent arm picks up. If the branch ends on the way, the arm settles from rest
        (`Shape.history`). With contact, both scenes have the same loads; friction may differ.
    time_limit : float
        Time limit [s]. With contact, the equilibrium on a mesh is also limited to 20 s.
    progress : bool
        Whether to show a progress line. The default shows a line on terminals and in notebooks,
        after 2 s.

    Raises
    ------
    InputError
        If an argument is not allowed. If no shape has the lengths, or the lengths crush the arm;
        the message names a tendon. If an arm without history touches an obstacle with friction.
    CollapsedError
        If 1 + q reaches 0.
    SnapError
        If the arm snaps, folds or buckles before the loads act in full.
    ConvergenceError
        If the finest mesh is not accurate enough. The subclasses are UnsettledSectionError, if a
        cross-section has no equilibrium, and UnsettledContactError, if no equilibrium with contact
        is found.
    CompilerError
        If `compile` is True and no compiler works.
    TimeLimitError
        If the time limit is reached.

    Warns
    -----
    ShapeWarning
        If the arm bends sharper than its own radius, is stretched beyond the law of its body, or
        has a hull with too few discs for continuous guides. The text is the same for all shapes;
        `details` of the warning has the numbers, see `Shape.remarks`.
    """
    with _NO_LIMIT if time_limit is None else limited(time_limit):
        accuracy = checked_accuracy(accuracy)
        machine_code = checked_compile(compile)
        problem = SettlingProblem(
            arm=arm,
            scene=scene_of(arm, scene),
            accuracy=accuracy,
            machine_code=machine_code,
            tensions=tensions,
            lengths=lengths,
            tendon_EA=tendon_EA,
            tendon_outside=tendon_outside,
            near=near,
        )
        shape = _solve(problem)
    remarks = (
        (BENT, sharp(shape)),
        (STRETCHED, stretched(shape)),
        (FEW_DISCS, guide_remark(shape.arm, shape.equilibrium.tensions)),
    )
    for text, details in remarks:
        if details and called_by_a_script():
            warn(text, ShapeWarning, details)
    return shape


def _solve(problem: SettlingProblem) -> Shape:
    """Return the shape that solves a problem."""
    for effect in problem.scene.effects:
        if effect.settles_scene:
            return effect.settle(problem)
    maps = forward_maps(problem.arm, problem.scene, problem.machine_code)
    near = None if problem.near is None else _checked_near(problem)
    if problem.lengths is not None:
        from octoplan.model.extensions.lengths.settling import settle_lengths

        return settle_lengths(problem, maps, near)
    if problem.tendon_EA is not None:
        raise InputError("tendon_EA", problem.tendon_EA, "none where no lengths are given")
    if finite("tendon_outside", problem.tendon_outside):
        given = problem.tendon_outside
        raise InputError("tendon_outside", given, "none where no lengths are given")
    T = problem.arm.flat(problem.tensions)

    def solve(
        forward: ForwardMap, near: AnyEquilibrium | None, tolerance_factor: float
    ) -> AnyEquilibrium:
        return forward.solve(T, near, tolerance_factor)

    return settle_on_meshes(maps, solve, problem.accuracy, near)


def _checked_near(problem: SettlingProblem) -> AnyEquilibrium:
    """Return the equilibrium of `near`; raise InputError if it is of another arm or scene."""
    near = problem.near
    scene = problem.scene
    kind("near", near, Shape, "a Shape of this arm and scene, or None")
    assert near is not None
    comparable = _comparable(near.scene) == _comparable(scene) or with_loads_of(scene, near.scene)
    if near.arm != problem.arm or not comparable:
        allowed = "a shape of this arm and scene; some of the loads may be absent"
        raise InputError("near", Described("a shape of another arm or scene"), allowed)
    return near.equilibrium


def _comparable(scene: Scene) -> Scene:
    """Return a scene without the values that may differ between two shapes of a motion."""
    return Scene(*(effect.comparable() for effect in scene.effects))


def settle_on_meshes(
    maps: ForwardMaps, solve: Solve, accuracy: float, near: AnyEquilibrium | None
) -> Shape:
    """Return the shape on the first mesh that is accurate enough.

    Parameters
    ----------
    maps : ForwardMaps
    solve : callable
        Returns the equilibrium on the mesh of a forward map near another one, with a factor of the
        tolerance of Newton's method.
    accuracy : float
        Tip error over arm length.
    near : AnyEquilibrium or None
        An equilibrium for the first mesh to start from.

    Raises
    ------
    ConvergenceError
        If the finest mesh is not accurate enough; and errors of `solve`.
    """
    # The first mesh is chosen by the order of smooth solutions; refinement may gain less.
    refinement, fine = first_pair(accuracy)
    tolerance_factor = initial_tolerance_factor(accuracy)
    coarse = 0
    before = list[float]()
    error = np.inf
    known = initial_estimate(maps.order)
    known_with_jumps = initial_estimate(1)
    snaps = tuple[float, ...]()
    snapped: SnapError | None = None
    begun = None
    while refinement:
        check_time()
        forward = maps.on(refinement)
        is_limited = forward.patience < math.inf
        if is_limited and begun is None:
            begun = time.process_time()
        try:
            with timeout() if is_limited else _NO_LIMIT:
                point = solve(forward, near, 1.0 if coarse else tolerance_factor)
            tip = point.poses[-1].tolist()
            if math.isnan(tip[4]):
                check_stretch(point)
        except (SnapError, ConvergenceError) as problem:
            is_section = isinstance(problem, UnsettledSectionError)
            is_final = is_section and forward.sections_are_exact
            is_late = begun is not None and time.process_time() - begun > forward.patience
            is_confirmed = isinstance(problem, SnapError) and problem.agrees(snapped)
            if refinement >= _DECISIVE_REFINEMENT or is_final or is_late or is_confirmed:
                raise
            snapped = problem if isinstance(problem, SnapError) else None
            # An equilibrium on a coarser mesh is no evidence for the error of a finer one.
            coarse = 0
            fine = 0
            error = np.inf
            refinement = next_refinement(refinement, error, accuracy, ORDER)
            continue
        begun = None
        snaps += point.snaps
        near = point
        if coarse:
            rotation = 2 * maps.lever * math.dist(tip[:4], before[:4])
            gap = max(math.dist(tip[4:], before[4:]), rotation) / maps.arm.length
            rounding = forward.rounding
            error, known = updated_estimate(known, gap, coarse, refinement, maps.order, rounding)
            error_with_jumps, known_with_jumps = updated_estimate(
                known_with_jumps, gap, coarse, refinement, 1, rounding
            )
            if point.extremes.jump is not None:
                error = error_with_jumps
                if known_with_jumps * refinement > accuracy * FINEST:
                    check_stretch(point)
                    remedy = SMOOTHER.format(point.extremes.jump)
                    raise ConvergenceError(accuracy, known_with_jumps, remedy)
            LOG.debug("mesh %d: estimated tip error %.1e of L", refinement, error)
            if error <= accuracy:
                check_stretch(point)
                shape = Shape(maps.arm, maps.scene, float(error), point, refinement, snaps=snaps)
                if point.extremes.bend <= 1 or shape.folded is None:
                    return shape
                # The strains of a folded arm jump along the arm.
                error = error_with_jumps
                if error <= accuracy:
                    return replace(shape, error=float(error))
        before = tip
        coarse = refinement
        refinement = max(fine, refinement)
        if refinement == coarse:
            refinement = next_refinement(coarse, error, accuracy, maps.order)
    check_stretch(point)
    raise ConvergenceError(accuracy, error, REMEDY)


def initial_tolerance_factor(accuracy: float) -> float:
    """Return the factor of Newton's tolerance on a first mesh, whose result is approximate."""
    return min(max(10 * accuracy / STEP_TOL, 1.0), MAX_TOLERANCE_FACTOR)


def scene_of(arm: Arm, scene: Scene | None) -> Scene:
    """Return the scene, `Scene()` for None; raise InputError for other types of arm or scene."""
    kind("arm", arm, Arm, "an Arm, such as Arm.from_paper(...)")
    scene = Scene() if scene is None else scene
    kind("scene", scene, Scene, "a Scene, such as Scene()")
    return scene


def checked_scene(arm: Arm, scene: Scene | None, contact: bool = False) -> Scene:
    """Return the scene; raise InputError for loads that the arm cannot have, see check_loads."""
    scene = scene_of(arm, scene)
    check_loads(arm, scene, contact)
    return scene
