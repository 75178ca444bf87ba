"""Spacer discs: tendons that run straight between guides, against an energy model of discs."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import casadi as ca
import numpy as np
import pytest

from octoplan.model import (
    Anchorage,
    Arm,
    InputError,
    Linear,
    Material,
    RestCurvature,
    Scene,
    SnapError,
    settle,
    settle_many,
)
from octoplan.model.effects import ExactTendons, Extension, TipLoad
from octoplan.model.effects.base import Effect
from octoplan.model.extensions.contact.effects import Contact
from octoplan.model.extensions.friction import Friction
from octoplan.model.extensions.obstacles import Sphere
from octoplan.model.stiffness import stiffness
from octoplan.model.support.errors import ShapeWarning
from octoplan.model.tendons import rest_lengths
from octoplan.planner import load_plan
from octoplan.planner.frontends.bodies.mjcf import mjcf
from octoplan.planner.frontends.bodies.surface import along, tendon_lines
from octoplan.planner.limits import Limits
from octoplan.planner.plan import plan
from octoplan.planner.targets import TipPosition

Array = np.ndarray[Any, Any]

L, E, NU = 0.3, 60e9, 0.3
RADIUS = Linear(0.9e-3, 0.7e-3)
THREE = (0.2, 0.2 + 2 * np.pi / 3, 0.2 + 4 * np.pi / 3)
EXACT = Scene(Extension(), ExactTendons())
# Degree of the polynomials of the strains in each span of the energy model.
DEGREE = 5
# Exponentials in each span of the energy model.
STEPS = 20


def _outer(guides: tuple[float, ...] | None) -> Anchorage:
    return Anchorage(L, Linear(8e-3, 6e-3), THREE, Linear(0.0, 0.5), guides)


def _arm(guides: tuple[float, ...] | None = (0.08, 0.17, 0.25)) -> Arm:
    inner = Anchorage(0.17, Linear(7e-3, 7e-3), (1.0, 1.0 + np.pi / 2), None, guides and (0.08,))
    hull = Linear(9e-3, 9e-3)
    return Arm(L, RADIUS, (_outer(guides), inner), Material(E, NU, 7800.0), hull=hull)


def _evenly(n: int | None) -> Arm:
    """Return a cylinder with n straight spans of equal length, or with a continuous guide."""
    guides = None if n is None else tuple(L * k / n for k in range(1, n))
    anchorage = Anchorage(L, Linear(8e-3, 8e-3), THREE, guides=guides)
    material = Material(E, NU, 7800.0)
    return Arm(L, Linear(8e-4, 8e-4), (anchorage,), material, hull=Linear(9e-3, 9e-3))


def _exponential(turn: ca.SX, shift: ca.SX) -> tuple[ca.SX, ca.SX]:
    """Return rotation and translation of the exponential of a small twist, by series."""
    z = ca.sumsqr(turn)
    a = 1 - z / 6 + z**2 / 120 - z**3 / 5040
    b = 1 / 2 - z / 24 + z**2 / 720 - z**3 / 40320
    c = 1 / 6 - z / 120 + z**2 / 5040 - z**3 / 362880
    W = ca.skew(turn)
    return ca.SX.eye(3) + a * W + b * W @ W, shift + b * W @ shift + c * W @ (W @ shift)


class Discs:
    """The energy of an arm with discs: polynomial strains in each span, exponentials in between.

    E = sum of the integrals of (EA q^2 + EJ |kappa_n, kappa_b|^2 + GI kappa_t^2) / 2
        + sum T (chords between discs) - F . u(L).

    With friction, the tensions of the spans are constants that the capstan law gives at the shape.
    """

    def __init__(
        self, arm: Arm, tensions: list[float], force: tuple[float, ...] = (0, 0, 0), mu: float = 0.0
    ):
        self.arm = arm
        discs = sorted(
            {0.0, *(s for each in arm.sections for s in (*(each.guides or ()), each.at))}
        )
        nodes = np.array([-1, 1]) / np.sqrt(12)
        at = (np.arange(STEPS)[:, None] + 0.5 + nodes) / STEPS
        basis = np.polynomial.legendre.legvander(2 * at - 1, DEGREE)
        n = len(discs) - 1
        self.x = ca.SX.sym("x", n * (DEGREE + 1) * 4)
        unit = ca.DM([1 / L, 1 / L, 1 / L, 1e-3])
        frame = ca.SX(np.array(arm.base_frame))
        place = ca.SX.zeros(3)
        energy = ca.SX(0)
        poses = {0.0: (frame, place)}
        for k, part in enumerate(ca.vertsplit(self.x, 4 * (DEGREE + 1))):
            modes = ca.reshape(part, 4, DEGREE + 1)
            begin, length = discs[k], discs[k + 1] - discs[k]
            h = length / STEPS
            for t in range(STEPS):
                v = [unit * (modes @ ca.DM(basis[t, g])) for g in (0, 1)]
                for g in (0, 1):
                    R = float(arm.radius.evaluate(np.array([begin + length * at[t, g]]), L)[0][0])
                    EA = E * np.pi * R**2
                    EJ = EA * R**2 / 4
                    energy += h / 4 * ca.dot(ca.DM([EJ / (1 + NU), EJ, EJ, EA]), v[g] ** 2)
                a, b = ([each[:3], ca.vertcat(1 + each[3], 0, 0)] for each in v)
                weight = np.sqrt(3) * h**2 / 12
                turn = h / 2 * (a[0] + b[0]) + weight * ca.cross(a[0], b[0])
                shift = ca.cross(a[0], b[1]) - ca.cross(b[0], a[1])
                rotation, step = _exponential(turn, h / 2 * (a[1] + b[1]) + weight * shift)
                place += frame @ step
                frame = frame @ rotation
            poses[discs[k + 1]] = frame, place
        chords, angles = self._chords(poses)
        counts = [each.numel() for each in chords]
        lengths = ca.vertcat(*(ca.sum1(each) for each in chords))
        self.pull = ca.SX.sym("pull", sum(counts))
        energy += ca.dot(self.pull, ca.vertcat(*chords)) - ca.dot(ca.DM(force), place)
        gradient = ca.gradient(energy, self.x)
        along = ca.SX.sym("along", self.x.numel())
        change = ca.jtimes(gradient, self.x, along)
        motor = np.repeat(tensions, counts)
        capstan = ca.DM(motor) * ca.exp(-mu * ca.vertcat(*angles))
        known = [self.x, self.pull]
        self.gradient = ca.Function("gradient", known, [gradient], {"cse": True})
        self.change = ca.Function("change", [*known, along], [change], {"cse": True})
        self.results = ca.Function("results", [self.x], [place, lengths, capstan], {"cse": True})

    def _chords(self, poses: dict[float, tuple[ca.SX, ca.SX]]) -> tuple[list[ca.SX], list[ca.SX]]:
        """Return the chords of each tendon, and the angles by which it has turned before them."""
        lengths = []
        angles = []
        for section in self.arm.sections:
            offset, turn = section.offset, section.turn
            assert isinstance(offset, Linear)
            for phi in section.angles:
                points = []
                for s in (0.0, *(section.guides or ()), section.at):
                    y = offset.base + s / section.at * (offset.end - offset.base)
                    angle = phi + (s / section.at * turn.end if isinstance(turn, Linear) else 0.0)
                    local = ca.DM([0.0, y * np.cos(angle), y * np.sin(angle)])
                    points.append(poses[s][1] + poses[s][0] @ local)
                chords = [b - a for a, b in pairwise(points)]
                lengths.append(ca.vertcat(*(ca.norm_2(each) for each in chords)))
                turned = [ca.SX(0)]
                for a, b in pairwise(chords):
                    sine = ca.norm_2(ca.cross(a, b))
                    turned.append(turned[-1] + ca.atan2(sine, ca.dot(a, b)))
                angles.append(ca.vertcat(*turned))
        return lengths, angles

    def settled(self) -> tuple[Array, Array, Array]:
        """Return the tip (3,), the tendon lengths and the Hessian at least energy, by Newton."""
        n = self.x.numel()
        x = np.zeros(n)
        hessian = np.eye(n)
        for _ in range(100):
            pull = self.results(x)[2]
            known = ca.repmat(x, 1, n), ca.repmat(pull, 1, n)
            hessian = np.array(self.change.map(n)(*known, np.eye(n)))
            g = np.array(self.gradient(x, pull)).ravel()
            step = -np.linalg.solve(hessian, g)
            x = x + step * min(1.0, 0.5 / np.abs(step).max())
            if np.abs(step).max() < 1e-8:
                break
        tip, lengths, self.tensions = (np.array(each).ravel() for each in self.results(x))
        return tip, lengths, hessian


@pytest.mark.parametrize(
    "force",
    [pytest.param((0.0, 0.0, 0.0), marks=pytest.mark.slow), (0.0, 0.05, -0.2)],
)
def test_arm_with_discs_takes_the_shape_of_least_energy(
    force: tuple[float, ...], deviation: Callable[..., float]
) -> None:
    T = [6.0, 1.0, 0.0, 0.0, 3.0]
    tip, lengths, hessian = Discs(_arm(), T, force).settled()
    assert np.linalg.eigvalsh((hessian + hessian.T) / 2).min() > 0
    loads: tuple[Effect, ...] = (TipLoad(force),) if any(force) else ()
    shape = settle(_arm(), T, Scene(*EXACT.effects, *loads), accuracy=1e-8)
    assert deviation(shape.tip, tip, L) < 2e-7
    assert deviation(shape.tendon_lengths, lengths, L) < 1e-7
    straight = settle(_arm(None), T, Scene(*EXACT.effects, *loads), accuracy=1e-7)
    assert np.linalg.norm(straight.tip - tip) > 0.01 * L


def test_friction_at_discs_follows_the_capstan_law(deviation: Callable[..., float]) -> None:
    T = [2.0, 0.5, 0.0]
    discs = Discs(_evenly(3), T, mu=0.15)
    tip, lengths, _ = discs.settled()
    shape = settle(_evenly(3), T, Scene(*EXACT.effects, Friction(0.15)), accuracy=1e-8)
    assert deviation(shape.tip, tip, L) < 2e-7
    assert deviation(shape.tendon_lengths, lengths, L) < 1e-7
    # Tensions of the first tendon in its three spans.
    spans = [shape.tension(s)[0] for s in (0.05, 0.15, 0.3)]
    assert np.allclose(spans, discs.tensions[:3], rtol=1e-6)
    assert spans[2] < 0.98 * spans[0]


@pytest.mark.parametrize("mu", [0.0, 0.15])
def test_lengths_give_the_shape_of_least_energy(mu: float) -> None:
    """The lengths are those of the energy model; the third tendon is slack by 1 mm."""
    T = np.array([2.0, 0.5, 0.0])
    tip, lengths, _ = Discs(_evenly(3), T.tolist(), mu=mu).settled()
    scene = Scene(*EXACT.effects, Friction(mu)) if mu else EXACT
    shape = settle(_evenly(3), lengths=lengths + 1e-3 * (T == 0), scene=scene, accuracy=1e-7)
    assert np.abs(shape.tip - tip).max() < 2e-7 * L
    assert np.allclose(shape.tensions, T, rtol=0, atol=1e-6)
    assert np.ravel(shape.slack).tolist() == [False, False, True]


def test_equal_lengths_shorten_the_arm_below_the_load_of_its_spans() -> None:
    """Spans of L / 3 bear pi^2 EJ / (L / 3)^2; equal pulls below shorten the arm by P L / EA."""
    area = np.pi * (8e-4) ** 2
    euler = np.pi**2 * E * area * (8e-4) ** 2 / 4 / (L / 3) ** 2
    short = 0.7 * euler * L / (E * area)
    shape = settle(_evenly(3), lengths=[L - short] * 3, scene=EXACT)
    assert shape.tensions.sum() == pytest.approx(0.7 * euler, rel=1e-6)


def test_plan_with_discs_keeps_its_strokes() -> None:
    free = settle(_evenly(3), [2.0, 0.5, 0.3], EXACT, 1e-8)
    strokes = rest_lengths(_evenly(3)) - free.tendon_lengths
    found = plan(
        _evenly(3),
        TipPosition(tuple(free.tip)),
        EXACT,
        limits=Limits(tension_max=12.0, stroke_max=1.001 * float(strokes.max())),
    )
    assert found.certificate.passed, found.outcome
    assert found.strokes.max() <= 1.001 * strokes.max() * (1 + 1e-9)


def test_plan_with_friction_at_discs_is_certified() -> None:
    scene = Scene(*EXACT.effects, Friction(0.1))
    tip = settle(_evenly(3), [2.0, 0.5, 0.0], scene, 1e-8).tip
    found = plan(_evenly(3), TipPosition(tuple(tip)), scene, tension_max=12.0)
    assert found.certificate.passed, found.outcome
    assert np.allclose(found.tensions.ravel(), [2.0, 0.5, 0.0], rtol=0, atol=1e-3)


def test_discs_converge_to_the_continuous_guide() -> None:
    T = [3.3, 0.0, 0.0]
    continuous = settle(_evenly(None), T, EXACT, 1e-8).tip
    misses = [
        np.linalg.norm(settle(_evenly(n), T, EXACT, 1e-8).tip - continuous) / L
        for n in (3, 6, 12, 24)
    ]
    assert misses[0] > 0.01
    # The error falls with the square of the number of spans.
    assert misses[0] / misses[1] > 4
    assert misses[1] / misses[2] == pytest.approx(4, rel=0.05)
    assert misses[2] / misses[3] == pytest.approx(4, rel=0.02)


def test_one_straight_span_pulls_the_tip_towards_the_base() -> None:
    """An eccentric column: curvature k^2 (u - u_c) with k^2 = T / EJ; Timoshenko's secant formula.

    The line of the tendon passes both guides; small deflections, inextensible.
    """
    T, y = 0.02, 8e-3
    arm = _evenly(1)
    shape = settle(arm, [T, 0.0, 0.0], Scene(ExactTendons()), 1e-9)
    EJ = E * np.pi * (8e-4) ** 4 / 4
    k = np.sqrt(T / EJ)
    # w'' = k^2 (line - w), the line from y at the base to w(L) + y at the tip, w(0) = w'(0) = 0:
    # w = y + c s - y cos(k s) - c sin(k s) / k, with c = w(L) / L.
    c = y * (1 - np.cos(k * L)) / (np.sin(k * L) / k)
    deflection = np.linalg.norm(shape.tip[1:])
    assert deflection == pytest.approx(c * L, rel=2e-3)


def test_rest_lengths_are_sums_of_chords() -> None:
    s = np.array([0.0, 0.08, 0.17, 0.25, L])
    angle = THREE[1] + 0.5 * s / L
    y = 8e-3 - 2e-3 * s / L
    points = np.column_stack([s, y * np.cos(angle), y * np.sin(angle)])
    chords = np.linalg.norm(np.diff(points, axis=0), axis=1).sum()
    assert rest_lengths(_arm())[1] == pytest.approx(chords, rel=1e-12)
    assert settle(_arm(), [0.0] * 5, EXACT, 1e-8).tendon_lengths[1] == pytest.approx(
        chords, rel=1e-10
    )
    curved = replace(_evenly(4), rest_curvature=RestCurvature(b=Linear(4.0, 4.0)))
    # Tendons of a circular arc, by the distance of the tendon from its centre.
    offset = 8e-3 * np.cos(np.array(THREE))
    arcs = 4 * 2 * (1 / 4.0 - offset) * np.sin(L * 4.0 / 8)
    assert np.allclose(rest_lengths(curved), arcs, rtol=1e-9)


def test_compliance_with_discs_is_that_of_differences() -> None:
    T = [6.0, 1.0, 0.0, 0.0, 3.0]
    result = stiffness(_arm(), T, EXACT, accuracy=1e-6)
    assert result.stable
    step = 1e-3
    tips = [
        settle(_arm(), T, Scene(*EXACT.effects, TipLoad((0.0, x, 0.0))), 1e-8).tip
        for x in (step, -step)
    ]
    column = (tips[0] - tips[1]) / (2 * step)
    assert np.allclose(result.compliance[:3, 1], column, rtol=0, atol=1e-5 * np.abs(column).max())
    pulled = [settle(_arm(), [6.0 + x, *T[1:]], EXACT, 1e-8) for x in (1e-3, -1e-3)]
    change = (pulled[0].tendon_lengths - pulled[1].tendon_lengths) / 2e-3
    assert np.allclose(
        result.length_tension[:, 0], change, rtol=0, atol=1e-5 * np.abs(change).max()
    )
    # A frictionless tendon has a potential.
    assert np.allclose(result.compliance, result.compliance.T, rtol=0, atol=1e-5)
    locked = stiffness(_arm(), T, EXACT, hold="length")
    assert (
        np.linalg.eigvalsh(locked.compliance[:3, :3]).max()
        < np.linalg.eigvalsh(result.compliance[:3, :3]).max()
    )


def test_one_span_buckles_under_a_pull_through_the_base() -> None:
    """w'' = -k^2 (w - c s), w(0) = w'(0) = 0, w(L) = c L: sin(k L) = 0, P = pi^2 EJ / L^2."""
    anchorage = Anchorage(L, Linear(1e-7, 1e-7), THREE, guides=())
    arm = Arm(L, Linear(8e-4, 8e-4), (anchorage,), Material(E, NU, 7800.0))
    critical = np.pi**2 * E * np.pi * (8e-4) ** 4 / 4 / L**2
    below = [settle(arm, [x * critical / 3] * 3, Scene(), 1e-6).stability for x in (0.5, 0.98)]
    assert below[0] > below[1] > 0
    with pytest.raises(SnapError):
        settle(arm, [1.02 * critical / 3] * 3, Scene(), 1e-6)


def test_settle_many_solves_arms_with_discs() -> None:
    T = [[6.0, 1.0, 0.0, 0.0, 3.0], [0.0, 2.0, 1.0, 1.0, 0.0]]
    many = settle_many(_arm(), T, EXACT, 1e-7)
    for tip, row in zip(many.tip, T, strict=True):
        assert np.allclose(tip, settle(_arm(), row, EXACT, 1e-7).tip, rtol=0, atol=1e-7 * L)


def test_plan_with_discs_reaches_its_target_with_a_certificate() -> None:
    tip = settle(_arm(), [6.0, 1.0, 0.0, 0.0, 3.0], EXACT, 1e-8).tip
    found = plan(_arm(), TipPosition(tuple(tip)), EXACT, tension_max=12.0)
    assert found.certificate.passed, found.outcome
    reached, lengths, _ = Discs(_arm(), found.tensions.ravel().tolist()).settled()
    assert np.abs(reached - tip).max() < 2e-6 * L
    assert np.allclose(found.shape.tendon_lengths, lengths, rtol=0, atol=1e-6 * L)


def test_settle_warns_of_few_discs_in_a_hull() -> None:
    """The ratio of total pull and Euler load, by hand."""
    pull = 3.0
    ratio = pull * L**2 / (np.pi**2 * E * np.pi * (8e-4) ** 4 / 4)
    with pytest.warns(ShapeWarning, match="discs may be too few"):
        shape = settle(_evenly(None), [pull, 0.0, 0.0], EXACT)
    assert f"{ratio:.2g} times the Euler load" in shape.remarks[0]
    assert not settle(_evenly(3), [pull, 0.0, 0.0], EXACT).remarks


def test_drawn_tendons_are_straight_between_discs() -> None:
    arm = _arm()
    s = along(arm, 41)
    shape = settle(arm, [6.0, 1.0, 0.0, 0.0, 3.0], EXACT)
    lines = tendon_lines(arm, s, shape.poses(s))
    for line, length in zip(lines, shape.tendon_lengths, strict=True):
        drawn = np.linalg.norm(np.diff(line, axis=0), axis=1).sum()
        assert drawn == pytest.approx(length, rel=1e-9)


def test_exported_tendons_pass_sites_at_the_discs() -> None:
    shape = settle(_arm(), [6.0, 1.0, 0.0, 0.0, 3.0], EXACT)
    root = ElementTree.fromstring(mjcf(shape, links=12))
    counts = [len(tendon.findall("site")) for tendon in root.iter("spatial")]
    assert counts == [5, 5, 5, 3, 3]


def test_saved_plan_with_discs_is_the_same(tmp_path: Path) -> None:
    tip = settle(_evenly(3), [2.0, 0.5, 0.0], EXACT, 1e-8).tip
    found = plan(_evenly(3), TipPosition(tuple(tip)), EXACT, tension_max=12.0)
    found.save(tmp_path / "plan.json")
    again = load_plan(tmp_path / "plan.json")
    assert again.arm == found.arm
    assert np.array_equal(again.tensions, found.tensions)


BAD: dict[str, tuple[Callable[[], Any], str]] = {
    "beyond the tendon": (lambda: _outer((0.1, 0.35)), "guides[1]"),
    "at the anchorage": (lambda: _outer((0.1, L)), "guides[1]"),
    "at the base": (lambda: _outer((0.0, 0.1)), "guides[0]"),
    "before the base": (lambda: _outer((-0.1, 0.1)), "guides"),
    "twice": (lambda: _outer((0.1, 0.1)), "guides[1]"),
    "decreasing": (lambda: _outer((0.2, 0.1)), "guides[1]"),
    "as printed": (
        lambda: settle(_evenly(3), [0.0] * 3, Scene.as_printed()),
        "guides",
    ),
    "contact": (
        lambda: settle(_arm(), [0.0] * 5, Scene(Contact(Sphere((1, 1, 1), 0.1)))),
        "guides",
    ),
    "lengths that buckle spans": (
        lambda: settle(_evenly(3), lengths=[0.2999] * 3, scene=EXACT),
        "between its guides",
    ),
}


@pytest.mark.parametrize("name", BAD)
def test_bad_guides_are_refused_by_name(name: str) -> None:
    call, field = BAD[name]
    with pytest.raises(InputError) as error:
        call()
    assert field in str(error.value)
