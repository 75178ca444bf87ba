"""The cross-sections of an arm in numbers: strains under tensions, wrenches, tendons' lengths."""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property
from typing import NamedTuple

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from octoplan.model.arm import Arm
from octoplan.model.cross_section.energy import EnergySection
from octoplan.model.cross_section.law import CrossSection, body_size, components, size
from octoplan.model.cross_section.of_scene import body_numbers
from octoplan.model.cross_section.statics import ClosedStatics, PaperStatics, closed_statics
from octoplan.model.paths import Array
from octoplan.model.scene import Scene
from octoplan.model.stations import (
    Counts,
    crossing,
    stations,
    tendon_paths,
)
from octoplan.model.support.errors import CollapsedError, UnsettledSectionError
from octoplan.model.support.machine.functions import BatchFunction, cached

# Exact tendons keep a crushed section from turning inside out: what is left of its length then is
# the width that keeps their roots smooth (see octoplan.model.cross_section.law), and no shape.
LEAST_STRETCH = 1e-7
# Newton steps at most that lead to the strains of a section without loads; of more sections than
# this those that are in equilibrium are left out of further steps.
_STEPS, _MANY = 40, 256


class Balance(NamedTuple):
    """The wrenches of N cross-sections' bodies and tendons at strains, with P crossings.

    Attributes
    ----------
    wrench : (N, n)
        Local moments [N m] and forces [N]; 0 in equilibrium without loads.
    jacobian : (N, n, n)
        Its derivatives by the strains.
    units : (P, n)
        The wrench per newton of the tendon of each crossing.
    """

    wrench: Array
    jacobian: Array
    units: Array


class Sections:
    """Cross-sections at s (N,), which the tendons of `active` anchorages cross.

    Attributes
    ----------
    place, tendon : (P,)
        Cross-section and tendon of each crossing of a tendon through a cross-section.
    stations : Stations
        Their numbers.
    body : (n, N)
        What the law takes of the body.
    paths : (4, P)
        Offset along n and b, and its derivative, at each crossing.
    machine_code : bool
        Whether the law's kernels are compiled.
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
        self.law, self.s, self.machine_code = law, s, machine_code
        self._arm, self._scene = arm, scene
        self.stations = stations(arm, s, active)
        self.place, self.tendon = np.nonzero(crossing(arm, self.stations))
        self.body = body_numbers(arm, scene, self.stations)
        self.paths = tendon_paths(arm, self.stations, self.place, self.tendon)

    @property
    def body_rates(self) -> Array:
        """The derivatives along s (n, N) of what the law takes of the body."""
        return body_numbers(self._arm, self._scene, self.stations, rates=True)

    @cached_property
    def _closed_form(self) -> tuple[ClosedStatics, Array, Array, Array]:
        """The statics without loads, maps from tensions to pull, data, map of their strains."""
        arm, scene, at = self._arm, self._scene, self.stations
        statics = closed_statics(scene, arm)
        same = np.equal.outer(components(statics.law), components(self.law)).astype(float)
        return statics, statics.pulls(arm, at), statics.data(arm, scene, at), same

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
        """Return the strains (M, N, n) without loads under tensions (M, n_tendons), NaN for none.

        See `strains`.
        """
        statics, maps, data, same = self._closed_form
        pull = (tensions @ maps.reshape(-1, maps.shape[-1]).T).reshape(-1, maps.shape[1])
        v = settled(statics, pull, data, self.machine_code)
        return np.asarray((v @ same).reshape(len(tensions), *self.s.shape, same.shape[1]))

    def crushed(self, strains: Array) -> CollapsedError | None:
        """Return what to tell of the first section where strains (N, n) leave a tendon no length.

        None where they do so nowhere: only exact tendons come to that.
        """
        short = self.place[self.folds(strains[None])[0]]
        if not short.size:
            return None
        i = int(short.min())
        stretch = 1 + reported(self.law, strains[i : i + 1])[0, 3]
        return CollapsedError(float(self.s[i]), float(stretch))

    def folds(self, strains: Array) -> NDArray[np.bool_]:
        """Return whether tendons have no length left at their crossings (M, P).

        By strains (M, N, n) of many arms. Only exact tendons come to that.
        """
        if not isinstance(self.law, EnergySection):
            return np.zeros((len(strains), self.place.size), dtype=bool)
        v = strains[:, self.place].reshape(-1, strains.shape[-1])
        lengths = self._kernel(_path_rate, v, self.paths.T)[:, 0].reshape(len(strains), -1)
        return np.asarray(lengths <= LEAST_STRETCH)

    def balance(self, v: Array, tensions: Array) -> Balance:
        """Return the wrenches of body and tendons at strains v (N, n), and their derivatives.

        `tensions` (P,) are those of the crossings.
        """
        (N, n), units = v.shape, np.zeros((0, v.shape[1]))
        rows = self._kernel(_body, v, self.body.T)
        if self.place.size:
            tendons = self._kernel(_tendon, v[self.place], self.paths.T)
            first, units = np.flatnonzero(np.diff(self.place, prepend=-1)), tendons[:, :n]
            rows[self.place[first]] += np.add.reduceat(tendons * tensions[:, None], first)
        jacobian = rows[:, n:].reshape(N, n, n).transpose(0, 2, 1)
        return Balance(rows[:, :n], jacobian, units)

    def by_tensions(self, at: Balance) -> Array:
        """Return the derivatives (N, n, n_tendons) of strains in equilibrium by each tension."""
        rows = np.zeros((*at.wrench.shape, self._arm.n_tendons))
        rows[self.place, :, self.tendon] = at.units
        return np.asarray(-np.linalg.solve(at.jacobian, rows))

    def lengths(self, v: Array, weights: Array) -> tuple[Array, Array]:
        """Return the lengths of the tendons (n_tendons,) by quadrature with weights (N,) [m].

        And their Jacobian (n_tendons, N, n) in the strains v (N, n). They are of |u_c'| with u_c of
        eq. (6), or of the tangent of the energy with exact tendons.
        """
        rows, n_tendons = self.speeds(v) * weights[self.place, None], self._arm.n_tendons
        lengths = np.bincount(self.tendon, rows[:, 0], n_tendons)
        jacobian = np.zeros((n_tendons, *v.shape))
        jacobian[self.tendon, self.place] = rows[:, 1:]
        return lengths.astype(float), jacobian

    def speeds(self, v: Array) -> Array:
        """Return the length of tendon per length of arm (P, 1 + n) at each crossing, strains v.

        And its derivatives by the strains (N, n).
        """
        return self._kernel(_path_rate, v[self.place], self.paths.T)

    def _kernel(self, kernel_of: Callable[[CrossSection], ca.Function], *value: Array) -> Array:
        """Return what a kernel of the law has of arguments (N, n), a row each."""
        return cached(BatchFunction, cached(kernel_of, self.law), self.machine_code)(*value)[0]


def _path_rate(law: CrossSection) -> ca.Function:
    """Return strains, path -> |u_c'| of a tendon, then its derivatives."""
    v, path = ca.SX.sym("v", size(law)), ca.SX.sym("path", 4)
    return _with_jacobian("run", ca.norm_2(law.run(v, path)), v, path)


def _body(law: CrossSection) -> ca.Function:
    """Return strains, body numbers -> wrench of the body, then its derivatives column by column."""
    v, numbers = ca.SX.sym("v", size(law)), ca.SX.sym("body", body_size(law))
    return _with_jacobian("body", law.body(v, numbers), v, numbers)


def _tendon(law: CrossSection) -> ca.Function:
    """Return strains, path -> wrench of a tendon per newton, then its Jacobian column by column."""
    v, path = ca.SX.sym("v", size(law)), ca.SX.sym("path", 4)
    return _with_jacobian("tendon", law.tendon(v, path), v, path)


def _with_jacobian(name: str, value: ca.SX, v: ca.SX, *numbers: ca.SX) -> ca.Function:
    both = ca.densify(ca.vertcat(value, ca.vec(ca.densify(ca.jacobian(value, v)))))
    return ca.Function(name, [v, *numbers], [both], {"cse": True})


class Extremes(NamedTuple):
    """Where an arm is shortest and how it bends most: what the equations do not keep from a body.

    Attributes
    ----------
    s, stretch : float
        Where 1 + q is least, or the first place where it is no number [m], and its value there.
    bent_at, radius, bend : float
        Where curvature times the body's radius is largest [m], that radius [m], the product.
    long_at, longest : float
        Where 1 + q is largest [m], and its value there.
    """

    s: float
    stretch: float
    bent_at: float
    radius: float
    bend: float
    long_at: float
    longest: float

    @classmethod
    def of(cls, s: Array, q: Array, curvature: Array, radius: Array) -> Extremes:
        """Return those of q at arc lengths s [m], the first of which have the others too."""
        worst, longest, bend = int(q.argmin()), int(q.argmax()), curvature * radius
        i = int(bend.argmax())
        values = s[worst], 1 + q[worst], s[i], radius[i], bend[i], s[longest], 1 + q[longest]
        return cls(*map(float, values))


def _kernels(statics: ClosedStatics, machine_code: bool) -> list[BatchFunction]:
    """Return (pull, data) -> strains; or what steps to these begin with, and such a step."""
    return [BatchFunction(each, machine_code) for each in statics.functions()]


def settled(statics: ClosedStatics, pull: Array, data: Array, machine_code: bool = False) -> Array:
    """Return the strains (N, n) of cross-sections under pull (N, n_pull), NaN for none.

    Data may have fewer rows, which are taken again and again.
    """
    begin, *step = cached(_kernels, statics, machine_code)
    u, *w = begin(pull, data)
    if isinstance(statics, PaperStatics):
        return u
    strains, left = np.full(u.shape, np.nan), np.arange(len(u))
    for _ in range(_STEPS):
        u, *w, last, v = step[0](u, *w, pull, data)
        done = last[:, 0] < statics.settled
        strains[left[done]] = v[done]
        going = last[:, 0] >= statics.settled  # what is no number stays so
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
    kappa, nu = (1 + e[3]) * e[:3], ca.vertcat(1 + e[3], e[4:])
    return ca.Function("strains", [e], [ca.densify(law.strains(kappa, nu))])
