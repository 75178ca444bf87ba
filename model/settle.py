"""Settle an arm: tensions or lengths of tendons to shape, to the accuracy asked for."""

from __future__ import annotations

import logging
import math
import time
from dataclasses import replace
from typing import Any

import numpy as np

from model.arm import Arm
from model.checks import kind, positive
from model.contact.forward import Touching
from model.contact.self_contact import pressed_on_itself
from model.effects import PrintedStatics, SelfContact
from model.equilibrium.equilibrium import Equilibrium
from model.errors import (
    CollapsedError,
    ConvergenceError,
    InputError,
    OctoplanError,
    ShapeWarning,
    SnapError,
    UnsettledContactError,
    UnsettledSectionError,
)
from model.forward import COLLOCATIONS, ForwardMap, check_scheme, forward_map, order_of
from model.loads import check_loads, contacts, is_loaded, without_friction
from model.machine.compiled import Compile, checked_compile
from model.mesh_refinement import (
    IMPLICIT,
    ROUNDING,
    checked_accuracy,
    estimate,
    first_pair,
    next_refinement,
)
from model.on_mesh import GivenLengths, GivenTensions, OnMesh
from model.paths import Array
from model.progress import with_progress
from model.remarks import sharp
from model.scene import Scene
from model.shape import Shape
from model.shortest import UnknownLeastError, too_short
from model.time_limit import OutOfTime, check_time, limited, unless
from model.units import warn_of_lengths
from model.unloaded.stretch import check_sections, check_stretch
from model.warn import called_by_a_script, warn
from model.winches import Winches

LOG = logging.getLogger(__name__)
ACCURACY = 1e-6
# A mesh up to this one may be too coarse to say that the arm snaps.
_COARSE = 16
# How accurate shapes are that tell whether lengths are too short.
_ROUGHLY = 1e-3
# How accurate shapes are that press on themselves.
_CLOSE = 1e-9
# How long an equilibrium with contact may take on a mesh, in processor time [s].
_PATIENCE = 20.0


@with_progress
def settle(
    arm: Arm,
    tensions: Any = None,
    scene: Scene | None = None,
    accuracy: float = ACCURACY,
    scheme: str | None = None,
    compile: Compile = False,  # noqa: A002  (the name that scripts use)
    *,
    lengths: Any = None,
    tendon_EA: float | None = None,
    tendon_outside: float = 0.0,
    near: Shape | None = None,
    time_limit: float | None = None,
    progress: bool | None = None,
) -> Shape:
    """Return the shape that an arm takes under tensions, or by lengths that winches leave.

    By lengths it is the shape of least energy whose tendons are no longer than these: each is taut
    and pulls, or is slack. `Shape.tensions` and `Shape.slack` tell; where tendons that do not
    stretch leave tensions undetermined (`Shape.undetermined`), the least ones are found. With the
    paper's tangent, which has no energy, several shapes may have the same lengths.

    Parameters
    ----------
    tensions : (n_sections, n) or (n_tendons,)
        [N], tip section first; None or nan for tendons that are held by length.
    scene : Scene
        The effects enabled; the bare arm `Scene()` unless given.
    accuracy : float
        Tip error over arm length that is accepted, from 1e-12 to 0.1. The mesh is refined until
        the difference between two meshes says that the finer one is as good. With loads, which may
        twist the arm, it holds for points a base radius off the tip too.
    scheme : str
        The integrator; the scene's fastest unless given.
    compile : bool or "auto"
        Whether to work by machine code: the same digits, several times sooner. A C compiler builds
        it in some seconds for each kind of scene, and it is kept in the user's cache folder. "auto"
        goes on without, and warns, where there is no compiler that works.
    lengths : (n_sections, n) or (n_tendons,)
        What each winch leaves of its tendon, without tension, between base and anchorage [m]; None
        or nan for tendons that are held by tension.
    tendon_EA : float
        Stiffness E A of tendons held by length [N]; they do not stretch unless given.
    tendon_outside : float
        How much more of each tendon there is between its winch and the base [m], which stretches.
        Friction in the arm is left out of how much it stretches.
    near : Shape
        A shape of the same arm and scene nearby, whose tensions and branch are begun with. With
        friction of contacts the arm moves from it, in a straight line of tensions; its scene may
        have other friction there, or none.
    time_limit : float
        How long it may take [s]; none unless given. With contact an equilibrium on a mesh that is
        not found within 20 s is given up in any case.
    progress : bool
        Whether a line tells how far it is: unless given, after two seconds, on terminals and in
        notebooks.

    Raises
    ------
    InputError
        For tensions, lengths, accuracies and schemes that are not allowed; for lengths that no
        shape of the arm has, or that crush it, naming the tendon that is farthest from it and what
        is the least; for friction of an arm that touches something, and comes from nowhere.
    CollapsedError
        Where 1 + q reaches 0 under tensions.
    ConvergenceError
        If the finest mesh is not as accurate as asked; UnsettledSectionError if a cross-section
        has no equilibrium that is found;
        UnsettledContactError if none is found with contact.
    SnapError
        If the arm snaps, folds or buckles before the loads are in full.
    CompilerError
        If `compile` is True, and there is no compiler or it fails.
    TimeLimitError
        If `time_limit` is reached.

    Warns
    -----
    ShapeWarning
        Where the arm bends sharper than its own radius; see Shape.remarks.
    """
    winches = {"lengths": lengths, "tendon_EA": tendon_EA, "tendon_outside": tendon_outside}
    how: dict[str, Any] = {"scheme": scheme, "compile": compile, "near": near}
    limit = None if time_limit is None else positive("time_limit", time_limit)
    with limited(limit):
        shape = _checked(arm, tensions, scene, accuracy, **winches, **how)
    if called_by_a_script():
        bent = sharp(shape)
        if bent:
            warn(bent, ShapeWarning)
    return shape


def _checked(
    arm: Arm,
    tensions: Any,
    scene: Scene | None,
    accuracy: float,
    *,
    lengths: Any,
    tendon_EA: Any,
    tendon_outside: Any,
    scheme: str | None,
    compile: Compile,  # noqa: A002  (the name that scripts use)
    near: Shape | None,
) -> Shape:
    """Return what `settle` does, once all that is given is looked at."""
    accuracy = checked_accuracy(accuracy)
    if isinstance(scene, Scene) and scene.has(SelfContact):
        for name, value in (("lengths", lengths), ("near", near), ("scheme", scheme)):
            if value is not None:
                raise InputError(name, "given with SelfContact", "none in a scene with SelfContact")
        return _on_itself(arm, tensions, scene, accuracy, checked_compile(compile))
    scene = checked_scene(arm, scene, contact=True)
    begin = _near(near, arm, scene)
    machine_code = checked_compile(compile)
    given = _given(arm, scene, tensions, lengths, tendon_EA, tendon_outside)
    if isinstance(given, GivenLengths):
        given = replace(
            given, machine_code=machine_code, near=None if begin is None else begin.tensions
        )
    scheme = check_scheme(scene, scheme)
    try:
        return _settled(arm, given, scene, accuracy, scheme, machine_code, begin)
    except (CollapsedError, UnsettledSectionError, UnknownLeastError) as problem:
        if not isinstance(given, GivenLengths):
            raise
        told = _told(arm, given, scene, problem)
        raise told from None


def _told(arm: Arm, given: GivenLengths, scene: Scene, problem: OctoplanError) -> OctoplanError:
    """Return what to tell of lengths that the arm does not settle by."""
    scheme = check_scheme(scene, None)

    def problem_of(winches: Winches) -> OctoplanError | None:
        other = replace(given, winches=winches, near=None)
        try:
            _settled(arm, other, scene, _ROUGHLY, scheme, given.machine_code, None)
        except OctoplanError as error:
            return error
        return None

    return too_short(arm, given.winches, problem, problem_of)


def _on_itself(arm: Arm, tensions: Any, scene: Scene, accuracy: float, machine_code: bool) -> Shape:
    """Return the shape of an arm that may press on itself; tensions grow from none.

    All that is settled on the way is as accurate as gaps are closed.
    """
    alone = Scene(*(effect for effect in scene.effects if not isinstance(effect, SelfContact)))
    alone, close = checked_scene(arm, alone), min(accuracy, _CLOSE)

    def at(T: Array, loaded: Scene, near: Shape | None) -> Shape:
        alike = near is not None and is_loaded(loaded) and is_loaded(near.scene)
        begin = near.equilibrium if near is not None and alike else None
        given, scheme = GivenTensions(T), check_scheme(loaded, None)
        return _settled(arm, given, loaded, close, scheme, machine_code, begin)

    return pressed_on_itself(arm.flat(tensions), alone, at)


def _given(
    arm: Arm, scene: Scene, tensions: Any, lengths: Any, EA: Any, outside: Any
) -> GivenTensions | GivenLengths:
    """Return what holds the tendons; InputError."""
    if lengths is not None:
        if scene.has(PrintedStatics):
            raise InputError("lengths", "given as printed", "tensions in a scene as printed")
        if any(contact.friction for contact in contacts(scene)):
            allowed = "tensions in a scene whose contacts have friction"
            raise InputError("lengths", "given with friction of contacts", allowed)
        winches = Winches.of(arm, tensions, lengths, EA, outside)
        warn_of_lengths("lengths", (winches.lengths[winches.held] / arm.length).tolist())
        return GivenLengths(arm, scene, winches)
    for name, value in (("tendon_EA", EA), ("tendon_outside", outside)):
        if value:
            raise InputError(name, value, "none where no lengths are given")
    return GivenTensions(arm.flat(tensions))


def _near(near: Any, arm: Arm, scene: Scene) -> Equilibrium | None:
    if near is None:
        return None
    kind("near", near, Shape, "a Shape of the same arm and scene, or None")
    if near.arm != arm or _alike(near.scene) != _alike(scene):
        raise InputError("near", "a shape of another arm or scene", "one of the same")
    found: Equilibrium = near.equilibrium
    return found


def _alike(scene: Scene) -> Scene:
    """Return a scene that others share whose shapes may lead to it."""
    return without_friction(scene)


def _settled(
    arm: Arm,
    given: GivenTensions | GivenLengths,
    scene: Scene,
    accuracy: float,
    scheme: str,
    machine_code: bool,
    near: Equilibrium | None,
) -> Shape:
    order = order_of(scheme, scene)
    lever = float(arm.radius.evaluate(np.zeros(1), arm.length)[0][0]) if is_loaded(scene) else 0.0
    # As printed strains that are no numbers may be those of a step that is too long.
    by_sections = not scene.has(PrintedStatics)
    # Friction of a part that lies on an obstacle acts at nodes.
    least = 2 if any(contact.friction for contact in contacts(scene)) else order
    rounding = IMPLICIT if scheme in COLLOCATIONS else ROUNDING
    coarse, fine = first_pair(accuracy, order)
    refinement = coarse
    before: tuple[int, Array] | None = None
    snaps: tuple[float, ...] = ()
    begun = time.process_time()
    while refinement:
        check_time()
        forward = forward_map(arm, scene, scheme, refinement, (), machine_code)
        try:
            found = _soon(given, forward, near, scene)
            check_sections(found.equilibrium)
        except (SnapError, UnsettledContactError, UnsettledSectionError) as problem:
            in_closed_form = isinstance(problem, UnsettledSectionError) and by_sections
            slow = time.process_time() - begun > _PATIENCE
            if refinement >= _COARSE or in_closed_form or slow:
                raise
            # Nor does a coarser one that did bear the loads tell how accurate a finer one is.
            refinement, before = next_refinement(refinement, np.inf, accuracy, order), None
            continue
        begun = time.process_time()
        here = found.equilibrium
        if isinstance(here, Touching):
            snaps = (*snaps, *here.snaps)
        if not isinstance(here, Touching) or here.before is None:
            near = here
        tip, error = here.poses[-1], np.inf
        if before is not None:
            gap = _gap(tip, before[1], lever) / arm.length
            error = estimate(gap, before[0], refinement, least, rounding)
            LOG.debug("%s, mesh %d: estimated tip error %.1e of L", scheme, refinement, error)
            if error <= accuracy:
                found = given.finished(forward, found)
                check_stretch(found.equilibrium)
                held = given.winches, found.left, snaps
                return Shape(arm, scene, error, found.equilibrium, *held)
        before, last = (refinement, tip), refinement
        refinement = fine if last == coarse else next_refinement(last, error, accuracy, least)
    check_stretch(here)
    raise ConvergenceError(accuracy, error, "ask for less accuracy or a smoother arm")


def _soon(
    given: GivenTensions | GivenLengths,
    forward: ForwardMap,
    near: Equilibrium | None,
    scene: Scene,
) -> OnMesh:
    """Return the equilibrium on a mesh; with contact one that is found before long."""
    if not contacts(scene):
        return given.on(forward, near)
    end = time.process_time() + _PATIENCE
    try:
        with unless(lambda: time.process_time() > end):
            return given.on(forward, near)
    except OutOfTime:
        check_time()
        raise UnsettledContactError(1.0, f"none is found within {_PATIENCE:g} s") from None


def _gap(tip: Array, other: Array, lever: float) -> float:
    """Return how far two tip poses (7,) are apart, or points a lever off them [m].

    A load can twist a straight arm, of which the tip's position tells nothing.
    """
    shift = math.dist(tip[4:], other[4:])
    return max(shift, 2 * lever * math.dist(tip[:4], other[:4])) if lever else shift


def checked_scene(arm: Arm, scene: Scene | None, contact: bool = False) -> Scene:
    """Return the scene, the bare one for None; refuse what is not an arm or a scene."""
    kind("arm", arm, Arm, "an Arm, such as Arm.from_paper(...)")
    scene = Scene() if scene is None else scene
    kind("scene", scene, Scene, "a Scene, such as Scene()")
    check_loads(arm, scene, contact)
    return scene
