"""Settle an arm: tensions or lengths of tendons to shape, to the accuracy asked for."""

from __future__ import annotations

import logging
import math
import time
from contextlib import nullcontext
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from octoplan.model.arm import Arm
from octoplan.model.equilibrium.linearised import AnyEquilibrium, Equilibrium, check_stretch
from octoplan.model.equilibrium.load_changes import with_loads_of
from octoplan.model.equilibrium.load_steps import ROUGHEST
from octoplan.model.equilibrium.newton import SETTLED
from octoplan.model.extensions.contact.effects import SelfContact, contacts, without_friction
from octoplan.model.extensions.contact.gaps import THROUGH
from octoplan.model.extensions.contact.path import ContactEquilibrium
from octoplan.model.extensions.contact.self_contact import pressed_on_itself
from octoplan.model.extensions.lengths.by_lengths import GivenLengths
from octoplan.model.extensions.lengths.shortest import UnknownLeastError, too_short
from octoplan.model.extensions.printed import PrintedStatics
from octoplan.model.forward import (
    COARSE,
    FINEST,
    Maps,
    check_scheme,
    checked_accuracy,
    first_pair,
    larger_estimate,
    maps_of,
    next_refinement,
    no_estimate,
)
from octoplan.model.loads import check_loads, is_loaded
from octoplan.model.paths import Array
from octoplan.model.scene import Scene
from octoplan.model.shape import Shape, sharp, stretched
from octoplan.model.support.checks import finite, kind
from octoplan.model.support.errors import (
    CollapsedError,
    ConvergenceError,
    InputError,
    ShapeWarning,
    SnapError,
    UnsettledContactError,
    UnsettledSectionError,
)
from octoplan.model.support.machine.compiled import Compile, checked_compile
from octoplan.model.support.progress import (
    PATIENCE,
    check_time,
    limited,
    timeout,
    with_progress,
)
from octoplan.model.support.units import TENDONS, called_by_a_script, warn, warn_unusual
from octoplan.model.winches import Winches

LOG = logging.getLogger(__name__)
ACCURACY = 1e-6
# A mesh up to this one may be too coarse to say that the arm snaps.
_COARSE = 16
# Texts of ShapeWarning, the same for all shapes, so that Python shows them once for each line.
BENT = "the arm bends sharper than its own radius; see `remarks` of the shape"
STRETCHED = "the arm is stretched beyond the law of its body; see `remarks` of the shape"
# The remedy if the strains jump, so that the finest mesh is foreseen to be too coarse.
SMOOTHER = (
    "its strains jump at s = {:.6g} m, where tendons have two equilibria; lower the tensions that "
    "cross this section or ask for less accuracy"
)
# How accurate shapes are that tell whether lengths are too short.
_ROUGHLY = 1e-3


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
    arm : Arm
    tensions : (n_sections, n) or (n_tendons,)
        [N], tip section first; None or nan for tendons that are held by length.
    scene : Scene
        The effects enabled; the bare arm `Scene()` unless given.
    accuracy : float
        Tip error over arm length that is accepted, from 1e-12 to 0.1: meshes are refined until two
        differ by as little. With loads it holds for points a base radius off the tip too.
    scheme : str
        The integrator; the scene's fastest unless given.
    compile : bool or "auto"
        Whether to work by machine code: the same digits, several times sooner. A C compiler builds
        it in seconds for each kind of scene, kept in the user's cache folder; "auto" goes on
        without, and warns, where none works.
    lengths : (n_sections, n) or (n_tendons,)
        What each winch leaves of its tendon, without tension, from base to anchorage [m]; None or
        nan for tendons that are held by tension.
    tendon_EA : float
        Stiffness E A of tendons held by length [N]; they do not stretch unless given.
    tendon_outside : float
        How much more of each tendon there is between its winch and the base [m], which stretches.
        Friction in the arm is left out of how much it stretches.
    near : Shape
        A shape of the same arm that the arm moves from: first the loads change in a straight line
        to those of `scene`, then the tensions change in a straight line to `tensions`. The scene
        of `near` is the same but for the strength of its loads; it may lack some of them, such as a
        payload that the arm picks up in its bent shape. If the branch ends on the way, the arm
        settles from rest (`Shape.history`). With contact both scenes have the same loads; friction
        may differ.
    time_limit : float
        How long it may take [s]; with contact 20 s for the equilibrium on a mesh in any case.
    progress : bool
        Whether a line tells how far it is: by default after two seconds, where someone watches.

    Raises
    ------
    InputError
        For what is not allowed; for lengths that no shape of the arm has, or that crush it, naming
        the tendon that is farthest from it and what is the least; for friction of an arm that
        touches something, and comes from nowhere.
    CollapsedError, SnapError
        Where 1 + q reaches 0; if the arm snaps, folds or buckles before the loads are in full.
    ConvergenceError
        If the finest mesh is not as accurate as asked; UnsettledSectionError if a cross-section
        has no equilibrium that is found, UnsettledContactError if the arm in contact has none.
    CompilerError, TimeLimitError
        If `compile` is True and no compiler works; if `time_limit` is reached.

    Warns
    -----
    ShapeWarning
        If the arm bends sharper than its own radius, or is stretched beyond the law of its body.
        The text is the same for all shapes; `details` of the warning has the numbers, as
        Shape.remarks.
    """
    with nullcontext() if time_limit is None else limited(time_limit):
        accuracy, machine_code = checked_accuracy(accuracy), checked_compile(compile)
        scene = scene_of(arm, scene)
        if scene.find(SelfContact):
            for name, value in (("lengths", lengths), ("near", near), ("scheme", scheme)):
                if value is not None:
                    allowed = "none in a scene with SelfContact"
                    raise InputError(name, "given with SelfContact", allowed)
            shape = _on_itself(arm, tensions, scene, accuracy, machine_code)
        else:
            if scheme is not None:
                check_scheme(scene, scheme)  # before maps are looked up by it: it may be a list
            maps, begin = maps_of(arm, scene, scheme, machine_code), None
            if near is not None:
                kind("near", near, Shape, "a Shape of the same arm and scene, or None")
                alike = without_friction(near.scene) == without_friction(scene)
                if near.arm != arm or not (alike or with_loads_of(scene, near.scene)):
                    allowed = "a shape of the same arm and scene, which may lack some of the loads"
                    raise InputError("near", "a shape of another arm or scene", allowed)
                begin = near.equilibrium
            if lengths is not None:
                held = _winches(arm, scene, tensions, lengths, tendon_EA, tendon_outside)
                shape = _by_lengths(maps, held, accuracy, begin)
            elif tendon_EA is not None or finite("tendon_outside", tendon_outside):
                name = "tendon_outside" if tendon_EA is None else "tendon_EA"
                value = tendon_outside if tendon_EA is None else tendon_EA
                raise InputError(name, value, "none where no lengths are given")
            else:
                shape = _settled(maps, arm.flat(tensions), accuracy, begin)
    if called_by_a_script():
        for text, details in ((BENT, sharp(shape)), (STRETCHED, stretched(shape))):
            if details:
                warn(text, ShapeWarning, details)
    return shape


def _winches(arm: Arm, scene: Scene, tensions: Any, lengths: Any, EA: Any, outside: Any) -> Winches:
    """Return what holds the tendons where lengths are given; InputError."""
    if scene.has(PrintedStatics):
        raise InputError("lengths", "given as printed", "tensions in a scene as printed")
    if any(contact.friction for contact in contacts(scene)):
        allowed = "tensions in a scene whose contacts have friction"
        raise InputError("lengths", "given with friction of contacts", allowed)
    winches = Winches.of(arm, tensions, lengths, EA, outside)
    shares = np.sort(winches.lengths[winches.held] / arm.length)
    warn_unusual("lengths", shares[shares.size // 2 :][:1].tolist(), TENDONS)
    return winches


def _by_lengths(
    maps: Maps, winches: Winches, accuracy: float, near: AnyEquilibrium | None
) -> Shape:
    """Return the shape by lengths; InputError names the tendon that no shape has so short."""

    def settled(held: Winches, accuracy: float, near: AnyEquilibrium | None = None) -> Shape:
        given = GivenLengths(maps, held, None if near is None else near.tensions)
        shape = _settled(maps, given, accuracy, near)
        end = given.finished(maps.on(shape.refinement), shape.equilibrium)
        check_stretch(end)
        return replace(shape, equilibrium=end, winches=held)

    try:
        return settled(winches, accuracy, near)
    except (CollapsedError, UnsettledSectionError, UnknownLeastError) as problem:
        raise too_short(maps.arm, winches, problem, partial(settled, accuracy=_ROUGHLY)) from None


def _on_itself(arm: Arm, tensions: Any, scene: Scene, accuracy: float, machine_code: bool) -> Shape:
    """Return the shape of an arm that may press on itself; tensions grow from none.

    All that is settled on the way is as accurate as gaps are closed.
    """
    alone = Scene(*(effect for effect in scene.effects if not isinstance(effect, SelfContact)))
    check_loads(arm, alone)

    def at(T: Array, loaded: Scene, near: Shape | None) -> Shape:
        alike = near is not None and is_loaded(loaded) and is_loaded(near.scene)
        begin = near.equilibrium if near is not None and alike else None
        return _settled(maps_of(arm, loaded, None, machine_code), T, min(accuracy, THROUGH), begin)

    return pressed_on_itself(arm.flat(tensions), alone, at)


def _settled(
    maps: Maps, value: Array | GivenLengths, accuracy: float, near: AnyEquilibrium | None
) -> Shape:
    """Return the shape on the first mesh that is accurate enough."""
    # A first mesh is as good in any scene; what it gains by refinement may be less.
    refinement, fine = first_pair(accuracy, maps.order)
    looser = loosest(accuracy)
    coarse, before, error, snaps = 0, list[float](), np.inf, tuple[float, ...]()
    known, by_jumps = no_estimate(maps.least_order), no_estimate(1)
    begun = time.process_time() if maps.contacts else 0.0
    snapped: SnapError | None = None
    while refinement:
        check_time()
        forward = maps.on(refinement)
        try:
            with timeout() if maps.contacts else nullcontext():
                if isinstance(value, GivenLengths):
                    point = value.on(forward, near)
                else:
                    point = forward.solve(value, near, 1.0 if coarse else looser)
            tip = point.poses[-1].tolist()
            if math.isnan(tip[4]):
                check_stretch(point)
        except (SnapError, UnsettledContactError, UnsettledSectionError) as problem:
            # As printed strains may be no numbers where a step is too long.
            printed = maps.scene.has(PrintedStatics)
            in_closed_form = isinstance(problem, UnsettledSectionError) and not printed
            slow = bool(maps.contacts) and time.process_time() - begun > PATIENCE
            sure = isinstance(problem, SnapError) and problem.agrees(snapped)
            if refinement >= _COARSE or in_closed_form or slow or sure:
                raise
            snapped = problem if isinstance(problem, SnapError) else None
            # Nor does a coarser one that did bear the loads tell how accurate a finer one is.
            coarse, fine, error = 0, 0, np.inf
            refinement = next_refinement(refinement, error, accuracy, maps.order)
            continue
        if isinstance(point, ContactEquilibrium):
            begun, snaps = time.process_time(), snaps + point.snaps
        near = point
        if coarse:
            turned = 2 * maps.lever * math.dist(tip[:4], before[:4])
            gap = max(math.dist(tip[4:], before[4:]), turned) / maps.arm.length
            pair = coarse, refinement
            error, known = larger_estimate(known, gap, *pair, maps.least_order, maps.rounding)
            jumpy, by_jumps = larger_estimate(by_jumps, gap, *pair, 1, maps.rounding)
            if isinstance(point, Equilibrium) and point.jump is not None:
                error = jumpy
                if by_jumps * refinement > accuracy * FINEST:
                    check_stretch(point)
                    raise ConvergenceError(accuracy, by_jumps, SMOOTHER.format(point.jump))
            LOG.debug("%s, mesh %d: estimated tip error %.1e of L", maps.scheme, refinement, error)
            if error <= accuracy:
                check_stretch(point)
                shape = Shape(maps.arm, maps.scene, float(error), point, refinement, snaps=snaps)
                if point.extremes.bend <= 1 or shape.folded is None:
                    return shape
                # Strains jump along the arm.
                error = jumpy
                if error <= accuracy:
                    return replace(shape, error=float(error))
        before, coarse = tip, refinement
        refinement = max(fine, refinement)
        if refinement == coarse:
            refinement = next_refinement(coarse, error, accuracy, maps.least_order)
    check_stretch(point)
    raise ConvergenceError(accuracy, error, COARSE)


def loosest(accuracy: float) -> float:
    """Return how many times larger last steps on a first mesh may be, which is only near."""
    return min(max(10 * accuracy / SETTLED, 1.0), ROUGHEST)


def scene_of(arm: Arm, scene: Scene | None) -> Scene:
    """Return the scene, the bare one for None; refuse what is not an arm or a scene."""
    kind("arm", arm, Arm, "an Arm, such as Arm.from_paper(...)")
    scene = Scene() if scene is None else scene
    kind("scene", scene, Scene, "a Scene, such as Scene()")
    return scene


def checked_scene(arm: Arm, scene: Scene | None, contact: bool = False) -> Scene:
    """Return the scene, as scene_of; refuse loads that the arm cannot have, see check_loads."""
    scene = scene_of(arm, scene)
    check_loads(arm, scene, contact)
    return scene
