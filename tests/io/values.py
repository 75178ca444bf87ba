"""Random values of every public effect, target and obstacle, found by the exports.

Each argument is drawn by its annotation, or by its name if the annotation is not sufficient.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable
from types import UnionType
from typing import Any, Literal, Union, get_args, get_origin, get_type_hints

import numpy as np
import scipy
from hypothesis import strategies as st
from hypothesis.strategies import SearchStrategy

import octoplan.model.effects
import octoplan.model.extensions.obstacles
import octoplan.planner.targets
from octoplan.model import (
    Anchorage,
    Arm,
    InputError,
    Linear,
    Material,
    PiecewiseLinear,
    RestCurvature,
    Sampled,
    Scene,
)
from octoplan.model.effects.base import Effect
from octoplan.model.extensions.obstacles.base import Obstacle

PARTS = ("Bend", "Target")


def _public(module: Any) -> list[type]:
    return [own for own in map(vars(module).get, module.__all__) if isinstance(own, type)]


EFFECTS = [own for own in _public(octoplan.model.effects) if own is not Effect]
OBSTACLES = [own for own in _public(octoplan.model.extensions.obstacles) if own is not Obstacle]
TARGETS = [own for own in _public(octoplan.planner.targets) if own.__name__ not in PARTS]


def _numbers(low: float, high: float) -> SearchStrategy[float]:
    return st.floats(low, high, allow_subnormal=False).filter(lambda x: x == 0 or abs(x) > 1e-6)


_POSITIVE = _numbers(0.01, 0.3)
_GUIDES = st.tuples(_numbers(0.02, 0.04), _numbers(0.05, 0.09))
_VECTOR = st.tuples(*[_numbers(-0.3, 0.3)] * 3).filter(lambda v: np.linalg.norm(v) > 0.05)


def _matrix(rotation: tuple[float, ...]) -> tuple[tuple[float, ...], ...]:
    found = scipy.spatial.transform.Rotation.from_rotvec(rotation).as_matrix()
    return tuple(map(tuple, found.tolist()))


_FRAME = st.tuples(*[_numbers(-3, 3)] * 3).map(_matrix)
_CORNERS = ((0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1))
_FACES = ((0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3))
_SIGN = st.sampled_from((1, -1))
_POINTS = st.lists(_VECTOR, min_size=2, max_size=2).map(tuple)
BY_NAME: dict[tuple[str, str], SearchStrategy[Any]] = {
    ("Friction", "direction"): st.one_of(_SIGN, st.tuples(*[_SIGN] * 12)),
    ("Backbone", "points"): _POINTS,
    ("Backbone", "s"): st.none() | st.just((0.1, 0.2)),
    ("Backbone", "weights"): st.none() | st.tuples(_POSITIVE, _POSITIVE),
    ("Hold", "wrench"): _VECTOR | st.tuples(_VECTOR, _VECTOR).map(lambda own: (*own[0], *own[1])),
    ("MinimumStiffness", "direction"): _VECTOR
    | st.just(((2.0, 0.5, 0.0), (0.5, 1.0, 0.0), (0.0, 0.0, 1.0))),
    ("Mesh", "vertices"): _POSITIVE.map(lambda x: (x * np.array(_CORNERS)).tolist()),
    ("Mesh", "faces"): st.just(_FACES),
    ("Moving", "times"): st.just((0.0, 1.5)),
    ("Moving", "path"): _POINTS,
    ("TipPointing", "weights"): st.tuples(_POSITIVE, _POSITIVE),
    ("TipPose", "weights"): st.tuples(_POSITIVE, _POSITIVE),
    ("BendingPlane", "section"): st.integers(1, 3),
}


def _by_type(name: str, hint: Any) -> SearchStrategy[Any]:
    if name == "frame":
        return _FRAME
    if get_origin(hint) in (Union, UnionType):
        return st.one_of(*(_by_type(name, own) for own in get_args(hint)))
    if get_origin(hint) is Literal:
        return st.sampled_from(get_args(hint))
    plain: dict[Any, SearchStrategy[Any]] = {
        type(None): st.none(),
        bool: st.booleans(),
        float: _POSITIVE,
        tuple[float, ...]: _VECTOR,
    }
    if hint in plain:
        return plain[hint]
    if isinstance(hint, type) and issubclass(hint, Obstacle):
        kinds = [own for own in OBSTACLES if issubclass(own, hint)]
        return st.one_of(*map(values_of, kinds))
    if hint is octoplan.planner.targets.Bend:
        return st.tuples(_POSITIVE, _numbers(-3, 3))
    raise TypeError(f"how is {name}: {hint} to be drawn? Say so in BY_NAME")


def _drawn(kind: type, name: str, hint: Any) -> SearchStrategy[Any]:
    own = BY_NAME.get((kind.__name__, name))
    return _by_type(name, hint) if own is None else own


def values_of(kind: type) -> SearchStrategy[Any]:
    """Return a strategy for valid values of a class."""
    hints = get_type_hints(kind)
    names = list(inspect.signature(kind).parameters)
    drawn = [_drawn(kind, name, hints[name]) for name in names]

    def made(given: tuple[Any, ...]) -> Any:
        try:
            return kind(**dict(zip(names, given, strict=True)))
        except InputError:
            return None

    return st.tuples(*drawn).map(made).filter(lambda own: own is not None)


_PATHS: SearchStrategy[Any] = st.one_of(
    st.tuples(_numbers(0.005, 0.01), _numbers(0.004, 0.01)).map(lambda own: Linear(*own)),
    st.lists(_numbers(0.004, 0.01), min_size=4, max_size=4).map(
        lambda own: Sampled((0.0, 0.1, 0.2, 0.3), tuple(own))
    ),
    st.lists(_numbers(0.004, 0.01), min_size=3, max_size=3).map(
        lambda own: PiecewiseLinear((0.0, 0.08, 0.3), tuple(own))
    ),
)


@st.composite
def arms(draw: Callable[[SearchStrategy[Any]], Any]) -> Arm:
    """Draw an arm of every form of radius, tendons and curvature."""
    length = 0.3
    angles = tuple(draw(st.lists(_numbers(0, 6), min_size=1, max_size=4, unique=True)))
    each = tuple(draw(_PATHS) for _ in angles)
    turn = draw(st.none() | st.just(Linear(0.0, 0.5)) | st.just((Linear(0.0, 0.1),) * len(angles)))
    sections = (
        Anchorage(length, draw(st.sampled_from([each, each[0]])), angles, turn),
        Anchorage(
            draw(_numbers(0.1, 0.2)),
            Linear(0.005, draw(_numbers(0.001, 0.005))),
            guides=draw(st.none() | st.just(()) | _GUIDES),
        ),
    )
    bent = st.just(Sampled((0.0, 0.1, 0.2, 0.3), (0.0, 1.0, 2.0, 1.0))) | st.just(Linear(0.1, 2.0))
    return Arm(
        length,
        Linear(draw(_numbers(0.011, 0.02)), draw(_numbers(0.011, 0.02))),
        sections,
        Material(draw(_numbers(2e4, 1e6)), draw(_numbers(0.0, 0.5)), draw(_numbers(500, 2000))),
        draw(_FRAME),
        draw(_VECTOR),
        draw(st.none() | st.just(Linear(0.021, 0.021))),
        draw(st.none() | st.tuples(bent, bent).map(lambda own: RestCurvature(*own))),
    )


@st.composite
def scenes(draw: Callable[[SearchStrategy[Any]], Any]) -> Scene:
    """Draw a scene of as many random effects as go together."""
    scene = Scene()
    for kind in draw(st.permutations(EFFECTS)):
        for own in draw(st.lists(values_of(kind), max_size=2)):
            try:
                scene = scene + own
            except InputError:
                continue
    return scene
