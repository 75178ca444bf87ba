"""Compliance of a settled shape to a relative accuracy, and the response to tendon lengths."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from octoplan.model.cross_section.law import cross_section_of
from octoplan.model.cross_section.sections import Sections, strains_of
from octoplan.model.equilibrium.explicit import ExplicitEquilibrium, ExplicitMap
from octoplan.model.equilibrium.explicit_sensitivities import ExplicitSensitivities
from octoplan.model.equilibrium.linearised import AnyEquilibrium, Equilibrium, Index
from octoplan.model.equilibrium.sensitivities import Sensitivities
from octoplan.model.forward import FINEST, ORDER, forward_maps, pair_for, refined
from octoplan.model.loads import check_responses, convergence_order
from octoplan.model.paths import Array
from octoplan.model.shape import Shape
from octoplan.model.support.checks import kind
from octoplan.model.tendons import is_taut, least_compliance

Response = Sensitivities | ExplicitSensitivities
# Expected ratio of the relative error of the compliance to that of the tip: 4 for table 2, 80 for
# table 4 with its slender tip. A small value costs a third mesh, a large value a finer mesh.
_ERROR_RATIO = 80.0


def compliance_of(shape: Shape, at: float, accuracy: float) -> tuple[Response, int, float]:
    """Return the sensitivities at arc length `at`, the refinement of the mesh, and the error.

    Tensions are constant. The relative error of the compliance is at most `accuracy`. Raises
    ConvergenceError.
    """
    size = np.repeat([shape.arm.length, 1.0], 3)

    def gap(now: Response, before: Response) -> float:
        scaled = [point.pose_wrench / np.outer(size, size) for point in (now, before)]
        return float(np.abs(scaled[0] - scaled[1]).max() / np.abs(scaled[0]).max())

    # The first refinement is that of the shape; the second is chosen by the error of the shape.
    harder = (_ERROR_RATIO * shape.error / accuracy) ** (1 / ORDER)
    coarse, fine = pair_for(shape.refinement * harder, FINEST / 2)
    pair = (shape.refinement if shape.refinement < fine else coarse), fine
    order = convergence_order(shape.scene, ORDER, derivatives=True)
    return refined(pair, accuracy, order, lambda mesh: sensitivities(shape, at, mesh), gap)


def sensitivities(shape: Shape, at: float, refinement: int) -> Response:
    """Return the sensitivities of a shape at arc length `at` on the mesh of a refinement."""
    places = () if at == shape.arm.length else (at,)
    maps = forward_maps(shape.arm, shape.scene, shape.machine_code)
    point = shape.equilibrium
    forward = maps.on(refinement, places)
    is_same_kind = isinstance(forward, ExplicitMap) == isinstance(point, ExplicitEquilibrium)
    if places or refinement != shape.refinement or not is_same_kind:
        point = forward.solve(shape.tensions, shape.collocated)
    if isinstance(point, Equilibrium):
        # Derivatives at a nearby state have an error that is independent of the mesh.
        point = point.relinearised()
    return at_node(point, forward.mesh.node(at))


def at_node(point: AnyEquilibrium, node: int) -> Response:
    """Return the sensitivities of an equilibrium at a node of its mesh."""
    kind = ExplicitSensitivities if isinstance(point, ExplicitEquilibrium) else Sensitivities
    return kind(point, node)  # type: ignore[arg-type]


def section_stiffness(shape: Shape, s: Array) -> Array:
    """Return torsional, flexural about n and b, and axial stiffness (N, 4) at s (N,).

    The result is the diagonal of d(wrench) / d(strain) at constant tensions: moments per curvature
    [N m2] and force per stretch [N], infinite without extension. Curvature is per unit deformed
    length with the paper's tangent, and per unit reference length with exact tendons. At an
    anchorage the result is that on the base side.
    """
    law = cross_section_of(shape.scene, shape.arm.is_curved)
    active = np.array([sum(section.at >= place for section in shape.arm.sections) for place in s])
    sections = Sections(shape.arm, shape.scene, law, s, active)
    v = strains_of(law, shape.strains(s))
    at = sections.balance(v, shape.tensions[sections.tendon])
    diagonal = np.einsum("nii->ni", at.jacobian)
    axial = diagonal[:, 3:4] if law.extension else np.full((s.size, 1), np.inf)
    return np.hstack([diagonal[:, :3], axial])


@dataclass(frozen=True, eq=False)
class LengthResponse:
    """The derivatives of a shape by the lengths of its tendons.

    Attributes
    ----------
    taut : (n_tendons,)
        Whether the tendon has a given length and is taut. Columns of other tendons are zero.
    tension : (n_tendons, n_tendons)
        Tensions per metre of each tendon that is paid out [N/m].
    tip : (3, n_tendons)
        Displacement of the tip [-].
    rotation : (3, n_tendons)
        Rotation of the tip [rad/m], base frame.
    """

    taut: NDArray[np.bool_]
    tension: Array
    tip: Array
    rotation: Array


def length_response(shape: Shape) -> LengthResponse:
    """Return the derivatives of a shape by the lengths of its taut tendons.

    With the lengths l(T) in equilibrium, taut tendons satisfy length + stretch T - l(T) = 0; the
    implicit function theorem gives the derivatives. If the shape was settled under tensions, all
    taut tendons count as having given lengths. The derivatives are valid for small changes, in
    which slack tendons stay slack and taut tendons taut.

    Raises
    ------
    InputError
        If `shape` is not a shape, or its scene has the statics as printed.
    """
    kind("shape", shape, Shape, "a Shape, as settle returns it")
    check_responses(shape.scene)
    result = sensitivities(shape, shape.arm.length, shape.refinement)
    T = shape.tensions
    winches = shape.winches
    taut = is_taut(shape.arm, T)
    if winches is not None:
        taut &= winches.held
    longer = 1 + T / (np.inf if winches is None else winches.tendon_EA)
    tension = np.zeros((T.size, T.size))
    ix = np.flatnonzero(taut)
    tension[np.ix_(ix, ix)] = -by_lengths(shape, result, ix, np.diag(longer[ix]))
    pose = result.pose_tension @ tension
    return LengthResponse(taut, tension, pose[:3], pose[3:])


def length_error(shape: Shape) -> dict[str, float]:
    """Return the displacement of the tip per error of a tendon length [-], by taut tendon."""
    response = length_response(shape)
    taut = np.flatnonzero(response.taut)
    each = np.linalg.norm(response.tip[:, taut], axis=0)
    names = (shape.arm.tendon_name(int(j)) for j in taut)
    return dict(zip(names, each.tolist(), strict=True))


def by_lengths(
    shape: Shape, point: Response, held: Index, longer: Array, EA: float = np.inf
) -> Array:
    """Return the changes of tensions (k, m) of tendons with given lengths.

    Parameters
    ----------
    held : (k,)
        The tendons with given lengths.
    longer : (k, m)
        Elongations of their paths at constant tensions [m].
    EA : float
        Stiffness of the tendons [N]; without effect if the shape has winches.
    """
    stretch = point.lengths / (EA + shape.tensions)
    if shape.winches is not None:
        stretch = shape.winches.stretch
    yields = np.diag(stretch[held] + least_compliance(shape.arm))
    M = yields - point.length_tension[np.ix_(held, held)]
    return np.asarray(np.linalg.solve(M, longer))
