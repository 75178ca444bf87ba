"""The certificate: a plan checked by means that did not make it."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from model.arm import Arm
from model.centreline import Centreline
from model.clearance import clearances
from model.contact.stability import held_stability
from model.effects import PrintedStatics
from model.equilibrium.forward import STAGES, Collocation
from model.equilibrium.linearised import Linearised
from model.equilibrium.load_stepping import Followed, follow_on
from model.equilibrium.stability import least_eigenvalue, stability
from model.equilibrium.verification import SCHEME, verified
from model.errors import OctoplanError
from model.forward import by_collocation
from model.loads import contacts, is_loaded
from model.mesh_refinement import FINEST_ACCURACY
from model.obstacles import distances, numbers_of
from model.paths import Array
from model.progress import tell
from model.scene import Scene
from model.settle import settle
from model.shape import Shape
from model.stiffness import stiffness
from model.text import columns
from model.time_limit import OutOfTime
from planner.avoidance.asked import NOTHING, Surroundings, told
from planner.program.limits import Limits
from planner.program.terms import (
    compliance_requests,
    directions_function,
    stations_of,
    term_names,
    term_units,
    terms_function,
)
from planner.targets.base import Target
from planner.tendon_lengths import strokes

# How accurate the check is: two digits more than what it has to judge.
_SHARPER, _PRINTED = 1e-2, "rk8"
# The mesh whose wrenches it begins from: what these lack is corrected to first order. Where that
# leaves the tip's pose farther off than so many times what is asked of it, that of the shape.
_MESH, _CLOSE = 3, 10
KKT_TOLERANCE = 1e-6
# Of the least eigenvalue, which another mesh has with other digits.
STABILITY_TOLERANCE = 1e-4
# As many times its loads an arm is followed; relative error of the factor at which it yields.
MOST_LOADS, _YIELDS = 3.0, 0.01
# Of gaps and forces, and where along the arm gaps are looked at.
COMPLEMENTARY, _LOOKS = 1e-8, 2001
_LATE = "the time limit was reached before it was verified"
STIFF_ACCURACY = 1e-8


@dataclass(frozen=True)
class Certificate:
    """What the check of a plan found. Lengths are over the arm's length, angles in rad.

    Attributes
    ----------
    match : largest residual of each thing that has to be met
    approach : size of each thing that was to be made as small as the limits allow
    margin : least value of each thing that has to be 0 or above
    bounds : largest violation of a tension limit [N]
    complementarity : by how much gap >= 0 [m], force >= 0 [N] and their product = 0 [N m] are
        missed with contact, None without
    strokes : largest violation of a limit of strokes
    kkt : residual of the first-order conditions, scaled; their multipliers are the plan's
    agreement : distance of the settled tip from the check's, over L
    error : estimated tip error of the check, over L
    stability : least eigenvalue of the scaled Hessian of the energy; below 0 the arm does not stand
    stability_margin : the least that is accepted
    load_factor : times its loads at which the arm yields, tensions held: infinite if that is
        more than MOST_LOADS, None without loads
    scheme : the integrator of the check
    tolerance : what match, margin and agreement are held to
    problem : why the check could not be made, if so
    gaps : least distance of the arm's surface from each thing it can meet [m]; see model.clearance
    least_gaps : the distance asked for of some of them [m]
    nearest : the nearest of them, in words
    units : of match, approach and margin by name: "L" of lengths over the arm's, "rad"
    """

    match: Mapping[str, float] = field(default_factory=dict)
    approach: Mapping[str, float] = field(default_factory=dict)
    margin: Mapping[str, float] = field(default_factory=dict)
    bounds: float = np.inf
    kkt: float = np.inf
    agreement: float = np.inf
    error: float = np.inf
    stability: float = np.inf
    stability_margin: float = 0.0
    load_factor: float | None = None
    scheme: str = ""
    tolerance: float = 1e-6
    problem: str = ""
    gaps: Mapping[str, float] = field(default_factory=dict)
    least_gaps: Mapping[str, float] = field(default_factory=dict)
    nearest: str = ""
    units: Mapping[str, str] = field(default_factory=dict)
    strokes: float = 0.0
    complementarity: float | None = None

    @property
    def clearance(self) -> float:
        """The least distance of the arm's surface from obstacles, from behind its base, itself [m].

        A lower bound; below 0 the arm passes through, infinite where it can meet nothing.
        """
        return min(self.gaps.values(), default=np.inf)

    @property
    def too_near(self) -> Mapping[str, float]:
        """By how much less than asked the arm is clear of things that were asked about [m]."""
        lacks = {name: least - self.gaps[name] for name, least in self.least_gaps.items()}
        return {name: lack for name, lack in lacks.items() if lack > 0}

    @property
    def warnings(self) -> tuple[str, ...]:
        """What was not asked about and yet cannot be, a sentence each."""
        found = [name for name, gap in self.gaps.items() if gap < 0 and name not in self.least_gaps]
        return tuple(
            f"the arm passes through {name} by {-1e3 * self.gaps[name]:.3g} mm" for name in found
        )

    @property
    def residual(self) -> float:
        """The largest residual of what has to be met."""
        return max(self.match.values(), default=0.0)

    @property
    def reached(self) -> bool:
        """Whether everything that has to be met is met."""
        return not self.problem and self.residual <= self.tolerance

    @property
    def attained(self) -> bool:
        """Whether everything asked for is there: what has to be met, and the margins."""
        return self.reached and min(self.margin.values(), default=0.0) >= -self.tolerance

    @property
    def failures(self) -> tuple[str, ...]:
        """What did not pass, a sentence each."""
        if self.problem:
            return (self.problem,)
        checks = [
            (max(self.match.values(), default=0.0), self.tolerance, "target residual"),
            (-min(self.margin.values(), default=0.0), self.tolerance, "margin below 0 by"),
            (self.bounds, 0.0, "tension limit violated by [N]"),
            (self.strokes, self.tolerance, "stroke limit violated by [L]"),
            (self.kkt, KKT_TOLERANCE, "optimality residual"),
            (self.agreement, self.tolerance, "integrators differ by"),
            (self.stability_margin - self.stability, self._stable, self._unstable),
        ]
        if self.complementarity is not None:
            checks.append((self.complementarity, COMPLEMENTARY, "complementarity missed by"))
        near = self.too_near.items()
        checks += [(1e3 * lack, 0.0, f"too near {name} by [mm]") for name, lack in near]
        failed = [check for check in checks if not check[0] <= check[1]]
        return tuple(f"{name} {value:.2g}, allowed {limit:.2g}" for value, limit, name in failed)

    @property
    def lacks_stability(self) -> bool:
        """Whether the arm stands, but less well than asked."""
        return self.stability >= 0 and self.stability_margin - self.stability > self._stable

    @property
    def _stable(self) -> float:
        """What the stability may lack: digits of a mesh, nothing where the arm has to stand."""
        return STABILITY_TOLERANCE if self.stability_margin > 0 else 0.0

    @property
    def _unstable(self) -> str:
        if self.stability < 0:
            return "the arm does not stand; stability below 0 by"
        return f"stability below its margin of {self.stability_margin:g} by"

    @property
    def bears(self) -> str:
        """How many times its loads the arm bears, in words; empty without loads."""
        if self.load_factor is None:
            return ""
        if np.isinf(self.load_factor):
            return f"bears {MOST_LOADS:g} times its loads"
        return f"yields at {self.load_factor:.3g} times its loads"

    @property
    def passed(self) -> bool:
        """Whether target, limits and first-order optimality are verified to the tolerances."""
        return not self.failures

    def __str__(self) -> str:
        head = f"certificate: {'PASSED' if self.passed else 'FAILED'} (checked by {self.scheme})"
        lines = columns([["  " + name, told, note] for name, told, note in self._rows()], left=3)
        lines += [f"  beware: {warning}" for warning in self.warnings]
        return "\n".join([head, *lines, *(f"  failed: {failure}" for failure in self.failures)])

    def _rows(self) -> list[tuple[str, str, str]]:
        """Return what was checked: name with unit, value, what is allowed."""
        most = f"at most {self.tolerance:.0e}"
        found = [(name, value, most) for name, value in self.match.items()]
        least = "as small as the limits allow"
        found += [(name, value, least) for name, value in self.approach.items()]
        found += [(name, value, "at least 0") for name, value in self.margin.items()]
        rows = [(f"{name} [{self.units.get(name, '-')}]", v, told) for name, v, told in found]
        rows += [
            ("limits violated by [N]", self.bounds, "at most 0"),
            ("optimality residual [-]", self.kkt, f"at most {KKT_TOLERANCE:.0e}"),
            ("integrators differ by [L]", self.agreement, most),
            ("estimated tip error [L]", self.error, ""),
            ("stability [-]", self.stability, f"at least {self.stability_margin:g}; 1 at rest"),
        ]
        if self.load_factor is not None:
            rows.append(("load factor [-]", min(self.load_factor, MOST_LOADS), self.bears))
        if self.complementarity is not None:
            rows.append(("complementarity missed by", self.complementarity, ""))
        nearest = self.nearest or "can meet nothing"
        rows.append(("clearance [mm]", 1e3 * self.clearance, nearest))
        return [(name, _digits(value), told) for name, value, told in rows]


def _digits(value: float) -> str:
    """Return a number with three digits: as people write it, a small one with its exponent."""
    return f"{value:.3g}" if value == 0 or 1e-2 <= abs(value) < 1e5 else f"{value:.2e}"


def certify(
    arm: Arm,
    scene: Scene,
    targets: tuple[Target, ...],
    limits: Limits,
    tensions: Array,
    kkt: float,
    tolerance: float,
    stability_margin: float = 0.0,
    machine_code: bool = False,
    surroundings: Surroundings = NOTHING,
) -> Certificate:
    """Verify the settled tensions by initial value integration, and look at everything anew."""
    low, high = np.array(limits.lower), np.array(limits.upper)
    excess = max(float((low - tensions).max()), float((tensions - high).max()), 0.0)
    if limits.total is not None:
        excess = max(excess, float(tensions.sum()) - limits.total * (1 + 1e-9))
    printed = scene.has(PrintedStatics)
    scheme = _PRINTED if printed else SCHEME
    tell("verifying by initial value integration")
    try:
        fine = max(tolerance / 10, FINEST_ACCURACY)
        shape = settle(arm, tensions, scene, fine, compile=machine_code)
        stations, sharp = stations_of(arm, targets), max(_SHARPER * tolerance, FINEST_ACCURACY)
        check = _printed if printed else _integrated
        poses, tip, error, stands, load_factor, line = check(shape, stations, sharp)
        gaps = clearances(line, surroundings.obstacles)
    except (OctoplanError, OutOfTime) as reason:
        why = _LATE if isinstance(reason, OutOfTime) else str(reason)
        return Certificate(bounds=excess, scheme=scheme, tolerance=tolerance, problem=why)
    match, approach, margin = measure(arm, targets, poses, gives(arm, targets, shape))
    return Certificate(
        {name: float(np.abs(values).max()) for name, values in match.items()},
        {name: float(np.linalg.norm(values)) for name, values in approach.items()},
        {name: float(np.min(values)) for name, values in margin.items()},
        excess,
        kkt,
        math.dist(tip, shape.tip) / arm.length,
        error,
        stands,
        stability_margin,
        load_factor,
        scheme,
        tolerance,
        gaps={name: clear.gap for name, clear in gaps.items()},
        least_gaps=surroundings.least,
        nearest=told(gaps),
        units=term_units(arm, targets),
        strokes=_stroke_excess(shape, limits),
        complementarity=_violation(shape, line) if contacts(scene) else None,
    )


def _stroke_excess(shape: Shape, limits: Limits) -> float:
    """Return the largest violation of a limit of strokes, over the arm's length."""
    if limits.strokes is None:
        return 0.0
    (least, most), found = limits.strokes, strokes(shape)
    over = max(float((least - found).max()), float((found - most).max()), 0.0)
    return over / shape.arm.length


# Poses at the stations (K, 7), the tip (3,), its estimated error, stability, load factor, midline.
Checked = tuple[Array, Array, float, float, float | None, Centreline]


def _integrated(shape: Shape, stations: tuple[float, ...], accuracy: float) -> Checked:
    """Return what initial value integration makes of a shape."""
    if contacts(shape.scene):
        return _leaning(shape, stations, accuracy)
    scale = np.repeat([1.0, shape.arm.length], [4, 3])
    for mesh in sorted({min(shape.refinement, _MESH), shape.refinement}):
        form = (STAGES, mesh, stations, True, shape.machine_code)
        forward = Collocation(shape.arm, shape.scene, *form)
        here = forward.found(shape.tensions, shape.known)
        found = verified(here, accuracy)
        poses = forward.system.poses(found.here.states)
        gap = np.abs(poses[-1] - shape.poses(shape.arm.length)) / scale
        if gap.max() <= _CLOSE * accuracy:
            break
    places = [forward.mesh.node(s) for s in stations]
    # Whether it stands does not take a fine mesh, how well it does takes one.
    form = (STAGES, 1, (), True, shape.machine_code)
    rough = Collocation(shape.arm, shape.scene, *form).found(shape.tensions, shape.known)
    least = stability(rough)
    line = Centreline.at_states(forward.system, found.here.states)
    if not is_loaded(shape.scene):
        return poses[places], poses[-1, 4:], found.error, least, None, line
    stands = least_eigenvalue(found.here) if least > 0 else least
    bears = _load_factor(rough, shape)
    return poses[places], poses[-1, 4:], found.error, stands, bears, line


def _leaning(shape: Shape, stations: tuple[float, ...], accuracy: float) -> Checked:
    """Return what initial value integration makes of a shape that leans on things."""
    form = (STAGES, shape.refinement, stations, True, shape.machine_code)
    here = by_collocation(shape.arm, shape.scene, *form).found(shape.tensions, shape.known)
    found = verified(here, accuracy)
    system, states = here.system, found.here.states
    poses, line = system.poses(states), Centreline.at_states(system, states)
    places = [system.mesh.node(s) for s in stations]
    return poses[places], poses[-1, 4:], found.error, held_stability(here), None, line


def _violation(shape: Shape, line: Centreline) -> float:
    """Return by how much gap >= 0 [m], force >= 0 [N] and their product = 0 [N m] are missed."""
    bodies = numbers_of([contact.obstacle for contact in contacts(shape.scene)])
    s = np.linspace(0.0, shape.arm.length, _LOOKS)[1:]
    places, radii = line.at(s)
    worst = float((radii[:, None] - distances(bodies, places)[0]).max(initial=-np.inf))
    for touch in shape.contacts:
        out = shape.position(touch.s) - touch.point
        force = float(touch.force @ out) / float(np.linalg.norm(out))
        worst = max(worst, -force, abs(force * touch.gap))
    return max(worst, 0.0)


def _load_factor(here: Linearised, shape: Shape) -> float:
    """Return how many times its loads an arm bears, infinite if more than it is followed."""
    end = follow_on(Followed(here, 1.0, ""), MOST_LOADS, _YIELDS)
    return end.load if end.why else np.inf


def _printed(shape: Shape, stations: tuple[float, ...], accuracy: float) -> Checked:
    """Return what another integrator makes of a scene as printed."""
    asked = (shape.arm, shape.tensions, shape.scene, accuracy, _PRINTED)
    check = settle(*asked, compile=shape.machine_code)
    poses, line = check.poses(np.array(stations)), Centreline.of(check)
    return poses, check.tip, check.error, np.inf, None, line


def measure(
    arm: Arm, targets: tuple[Target, ...], poses: Array, given: Array
) -> tuple[dict[str, Array], dict[str, Array], dict[str, Array]]:
    """Return the targets' match, approach and margin terms by name.

    Of poses (K, 7) at the targets' stations, and of what `gives` returns.
    """
    numbers = np.concatenate([target.parameters(arm) for target in targets])
    values = terms_function(arm, targets)(poses.T, numbers, given)
    names = term_names(arm, targets)
    found: list[dict[str, Array]] = []
    for kind, value in zip(names, values, strict=True):
        flat = np.array(value).ravel()
        own = np.array(kind)
        found.append({name: flat[own == name] for name in dict.fromkeys(kind)})
    return found[0], found[1], found[2]


def gives(arm: Arm, targets: tuple[Target, ...], shape: Shape) -> Array:
    """Return the tip's compliances along the directions of the targets' requests, stacked."""
    requests = compliance_requests(targets)
    numbers = np.concatenate([target.parameters(arm) for target in targets])
    found = [np.zeros(0)]
    for request, along in zip(
        requests, directions_function(arm, targets).call([numbers]), strict=True
    ):
        k = stiffness(
            arm,
            shape.tensions,
            shape.scene,
            request.hold,
            accuracy=STIFF_ACCURACY,
            tendon_EA=request.tendon_EA,
            compile=shape.machine_code,
        )
        D = np.array(along)
        found.append((D.T @ k.compliance[:3, :3] @ D).ravel("F"))
    return np.concatenate(found)
