"""The cross-sections of an arm in numbers: strains under tensions, wrenches, tendon lengths."""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property
from typing import NamedTuple

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from octoplan.model.arm import Arm
from octoplan.model.cross_section.law import (
    CrossSection,
    EnergySection,
    body_parameters,
    body_size,
    components,
    size,
)
from octoplan.model.cross_section.statics import ClosedStatics, PaperStatics, closed_statics
from octoplan.model.mesh import Counts, crossing, stations, tendon_paths
from octoplan.model.paths import Array
from octoplan.model.scene import Scene
from octoplan.model.support.errors import CollapsedError, UnsettledSectionError
from octoplan.model.support.machine.functions import BatchFunction, cached

# Smallest stretch of a cross-section. Exact tendons keep a crushed section from inverting; its
# remaining length is an artefact of TINY, see octoplan.model.cross_section.law.
LEAST_STRETCH = 1e-7
# Largest number of Newton steps for the strains of a cross-section without loads.
_STEPS = 40
# Number of cross-sections above which converged ones are excluded from further steps.
_MANY = 256


class Balance(NamedTuple):
    """The wrenches of N cross-sections' bodies and tendons at strains, with P crossings.

    Attributes
    ----------
    wrench : (N, n)
        Local moments [N m] and forces [N]; 0 in equilibrium without loads.
    jacobian : (N, n, n)
        Derivatives of the wrench by the strains.
    units : (P, n)
        Wrench of the tendon of each crossing under 1 N.
    """

    wrench: Array
    jacobian: Array
    units: Array


class Sections:
    """Cross-sections at s (N,), crossed by the tendons of `active` (N,) anchorages.

    Tendons that run straight between guides load the guides alone; they are no crossings. Strains
    without loads assume that all tendons are guided continuously.

    Attributes
    ----------
    place : (P,)
        Cross-section of each crossing of a tendon through a cross-section.
    tendon : (P,)
        Tendon of each crossing.
    stations : Stations
        Geometry of the cross-sections.
    body : (n, N)
        Numbers of the body, see CrossSection.
    paths : (4, P)
        Offset along n and b, and its derivative, at each crossing.
    machine_code : bool
        Whether the kernels of the law are compiled.
    """

    def __init__(
        self,
        arm: Arm,
        scene: Scene,
        law: CrossSection,
        s: Array,
        active: Counts,
        machine_code: bool = False,
    ) -> None:
        self.law = law
        self.s = s
        self.machine_code = machine_code
        self._arm = arm
        self._scene = scene
        self.stations = stations(arm, s, active)
        is_continuous = np.array([guides is None for guides in arm.guides])
        self.place, self.tendon = np.nonzero(crossing(arm, self.stations) * is_continuous)
        self.body = body_parameters(arm, scene, self.stations)
        self.paths = tendon_paths(arm, self.stations, self.place, self.tendon)

    @property
    def body_rates(self) -> Array:
        """The derivatives along s (n, N) of what the law takes of the body."""
        return body_parameters(self._arm, self._scene, self.stations, rates=True)

    @cached_property
    def _closed_form(self) -> tuple[ClosedStatics, Array, Array, Array]:
        """The statics without loads, maps from tensions to pull, data, and map of the strains."""
        statics = closed_statics(self._scene, self._arm)
        maps = statics.resultant_maps(self._arm, self.stations)
        data = statics.data(self._arm, self._scene, self.stations)
        same = np.equal.outer(components(statics.law), components(self.law)).astype(float)
        return statics, maps, data, same

    def strains(self, tensions: Array) -> Array:
        """Return the strains (N, n) without loads under tensions (n_tendons,).

        Raises UnsettledSectionError.
        """
        (v,) = self.unloaded(tensions[None])
        lost = np.isnan(v).any(axis=1)
        if lost.any():
            raise UnsettledSectionError(float(self.s[np.argmax(lost)]))
        return np.asarray(v)

    def unloaded(self, tensions: Array) -> Array:
        """Return the strains (M, N, n) without loads under tensions (M, n_tendons).

        Strains of cross-sections without an equilibrium are NaN.
        """
        statics, maps, data, same = self._closed_form
        pull = (tensions @ maps.reshape(-1, maps.shape[-1]).T).reshape(-1, maps.shape[1])
        v = solve_sections(statics, pull, data, self.machine_code)
        return np.asarray((v @ same).reshape(len(tensions), *self.s.shape, same.shape[1]))

    def crushed(self, strains: Array) -> CollapsedError | None:
        """Return the error of the first section in which a tendon has no length; otherwise None.

        `strains` are (N, n). Only exact tendons can have no length.
        """
        short = self.place[self.folds(strains[None])[0]]
        if not short.size:
            return None
        i = int(short.min())
        stretch = 1 + reported(self.law, strains[i : i + 1])[0, 3]
        return CollapsedError(float(self.s[i]), float(stretch))

    def folds(self, strains: Array) -> NDArray[np.bool_]:
        """Return whether tendons have no length at their crossings (M, P).

        `strains` (M, N, n) are those of many arms. Only exact tendons can have no length.
        """
        if not isinstance(self.law, EnergySection):
            return np.zeros((len(strains), self.place.size), dtype=bool)
        v = strains[:, self.place].reshape(-1, strains.shape[-1])
        lengths = self._kernel(_path_rate, v, self.paths.T)[:, 0].reshape(len(strains), -1)
        return np.asarray(lengths <= LEAST_STRETCH)

    def balance(self, v: Array, tensions: Array) -> Balance:
        """Return the wrenches of body and tendons, and their derivatives, at strains v (N, n).

        `tensions` (P,) are those of the crossings.
        """
        N, n = v.shape
        units = np.zeros((0, n))
        rows = self._kernel(_body, v, self.body.T)
        if self.place.size:
            tendons = self._kernel(_tendon, v[self.place], self.paths.T)
            first = np.flatnonzero(np.diff(self.place, prepend=-1))
            units = tendons[:, :n]
            rows[self.place[first]] += np.add.reduceat(tendons * tensions[:, None], first)
        jacobian = rows[:, n:].reshape(N, n, n).transpose(0, 2, 1)
        return Balance(rows[:, :n], jacobian, units)

    def by_tensions(self, at: Balance) -> Array:
        """Return the derivatives (N, n, n_tendons) of strains in equilibrium by each tension."""
        rows = np.zeros((*at.wrench.shape, self._arm.n_tendons))
        rows[self.place, :, self.tendon] = at.units
        return np.asarray(-np.linalg.solve(at.jacobian, rows))

    def lengths(self, v: Array, weights: Array) -> tuple[Array, Array]:
        """Return the tendon lengths (n_tendons,) [m], and their derivatives (n_tendons, N, n).

        The lengths are integrals of the rates by quadrature with weights (N,). The derivatives are
        by the strains v (N, n).
        """
        n_tendons = self._arm.n_tendons
        rows = self.length_rates(v) * weights[self.place, None]
        lengths = np.bincount(self.tendon, rows[:, 0], n_tendons)
        jacobian = np.zeros((n_tendons, *v.shape))
        jacobian[self.tendon, self.place] = rows[:, 1:]
        return lengths.astype(float), jacobian

    def length_rates(self, v: Array) -> Array:
        """Return the tendon length per arm length at each crossing, and its derivatives (P, 1 + n).

        The rate is |u_c'| of eq. (6), or |c| with exact tendons. The derivatives are by the strains
        v (N, n).
        """
        return self._kernel(_path_rate, v[self.place], self.paths.T)

    def _kernel(self, kernel_of: Callable[[CrossSection], ca.Function], *value: Array) -> Array:
        """Return the values of a kernel of the law for arguments (N, n), one row each."""
        return cached(BatchFunction, cached(kernel_of, self.law), self.machine_code)(*value)[0]


def _path_rate(law: CrossSection) -> ca.Function:
    """Return strains, path -> |u_c'| of a tendon, then its derivatives."""
    v = ca.SX.sym("v", size(law))
    path = ca.SX.sym("path", 4)
    return _with_jacobian("tendon_rate", ca.norm_2(law.tendon_rate(v, path)), v, path)


def _body(law: CrossSection) -> ca.Function:
    """Return strains, body numbers -> wrench of the body, then its derivatives column by column."""
    v = ca.SX.sym("v", size(law))
    numbers = ca.SX.sym("body", body_size(law))
    return _with_jacobian("body", law.body(v, numbers), v, numbers)


def _tendon(law: CrossSection) -> ca.Function:
    """Return strains, path -> wrench of a tendon per newton, then its Jacobian column by column."""
    v = ca.SX.sym("v", size(law))
    path = ca.SX.sym("path", 4)
    return _with_jacobian("tendon", law.tendon(v, path), v, path)


def _with_jacobian(name: str, value: ca.SX, v: ca.SX, *numbers: ca.SX) -> ca.Function:
    both = ca.densify(ca.vertcat(value, ca.vec(ca.densify(ca.jacobian(value, v)))))
    return ca.Function(name, [v, *numbers], [both], {"cse": True})


class Extremes(NamedTuple):
    """Extremes of stretch and curvature along an arm, which the equations do not limit.

    Attributes
    ----------
    s : float
        Arc length of the least stretch 1 + q, or of the first NaN [m].
    stretch : float
        The least stretch, or NaN.
    bent_at : float
        Arc length of the largest product of curvature and radius [m].
    radius : float
        Radius of the body there [m].
    bend : float
        The largest product.
    long_at : float
        Arc length of the largest stretch [m].
    longest : float
        The largest stretch.
    jump : float or None
        Arc length of the largest jump of the strains inside an element [m], if any.
    """

    s: float
    stretch: float
    bent_at: float
    radius: float
    bend: float
    long_at: float
    longest: float
    jump: float | None = None

    @classmethod
    def of(
        cls, s: Array, q: Array, curvature: Array, radius: Array, jump: float | None = None
    ) -> Extremes:
        """Return the extremes of q (N,) at s (N,), and of curvature and radius at the first s."""
        bend = curvature * radius
        least = int(q.argmin())
        longest = int(q.argmax())
        bent = int(bend.argmax())
        return cls(
            s=float(s[least]),
            stretch=float(1 + q[least]),
            bent_at=float(s[bent]),
            radius=float(radius[bent]),
            bend=float(bend[bent]),
            long_at=float(s[longest]),
            longest=float(1 + q[longest]),
            jump=jump,
        )


def _kernels(statics: ClosedStatics, machine_code: bool) -> list[BatchFunction]:
    """Return (pull, data) -> strains, or the initial values and a Newton step; see functions."""
    return [BatchFunction(each, machine_code) for each in statics.functions()]


def solve_sections(
    statics: ClosedStatics, pull: Array, data: Array, machine_code: bool = False
) -> Array:
    """Return the strains (N, n) of cross-sections under pull (N, n_pull); NaN without solution.

    Fewer rows of data repeat.
    """
    begin, *step = cached(_kernels, statics, machine_code)
    u, *w = begin(pull, data)
    if isinstance(statics, PaperStatics):
        return u
    strains = np.full(u.shape, np.nan)
    left = np.arange(len(u))
    for _ in range(_STEPS):
        u, *w, last, v = step[0](u, *w, pull, data)
        done = last[:, 0] < statics.settled
        strains[left[done]] = v[done]
        going = last[:, 0] >= statics.settled  # excludes NaN
        if not going.any():
            break
        if len(left) > _MANY and not going.all():
            data = data[np.flatnonzero(going) % len(data)]
            left = left[going]
            u, *w, pull = (part[going] for part in (u, *w, pull))
    return strains


def reported(law: CrossSection, v: Array) -> Array:
    """Return tau, xi, k, q (N, 4), with shear nu_n, nu_b (N, 6), of a law's strains v (N, n).

    Curvature per unit deformed length [1/m], eq. (1).
    """
    return cached(BatchFunction, cached(_paper_strains, law))(v)[0]


def strains_of(law: CrossSection, rows: Array) -> Array:
    """Return a law's strains (N, n) of tau, xi, k, q, and nu_n, nu_b if given (N, 4 or 6)."""
    padded = np.hstack([rows, np.zeros((len(rows), 6 - rows.shape[1]))])
    return cached(BatchFunction, cached(_law_strains, law))(padded)[0]


def kinematics(law: CrossSection, v: Array) -> tuple[Array, Array]:
    """Return kappa and nu (N, 3) per unit reference length of a law's strains v (N, n)."""
    twist = cached(BatchFunction, cached(_kinematics, law))(v)[0]
    return twist[:, :3], twist[:, 3:]


def _paper_strains(law: CrossSection) -> ca.Function:
    v = ca.SX.sym("v", size(law))
    slide = law.twist(v)[1][1:] if law.shear else ca.SX(0, 1)
    rows = ca.densify(ca.vertcat(law.reported(v), slide))
    return ca.Function("reported", [v], [rows], {"cse": True})


def _kinematics(law: CrossSection) -> ca.Function:
    v = ca.SX.sym("v", size(law))
    return ca.Function("twist", [v], [ca.densify(ca.vertcat(*law.twist(v)))], {"cse": True})


def _law_strains(law: CrossSection) -> ca.Function:
    e = ca.SX.sym("e", 6)
    kappa = (1 + e[3]) * e[:3]
    nu = ca.vertcat(1 + e[3], e[4:])
    return ca.Function("strains", [e], [ca.densify(law.strains(kappa, nu))])
