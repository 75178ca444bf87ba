"""Integration of elements of an equilibrium, or of parts of elements, as initial value problems.

An explicit Runge-Kutta scheme integrates eqs. (1), (3) of pose, moment and force, and the states of
the tendons, from the values of collocation at the first node of the element. At each stage of the
scheme the strains follow from the wrench by the law of the cross-section, linearised about given
strains v_0 with the wrench w_0,

    v = v_0 + K (w - w_0),        K the inverse of dw/dv at v_0,

and linearised again about the result until the square of the change is rounding. Poses and strains
between the nodes are therefore as accurate as at the nodes.
"""

from __future__ import annotations

from functools import lru_cache, partial
from typing import NamedTuple

import casadi as ca
import numpy as np

from octoplan.model.cross_section.law import join
from octoplan.model.cross_section.sections import Sections
from octoplan.model.equilibrium.runge_kutta import RK8
from octoplan.model.loads import dead_resultant
from octoplan.model.mesh import stations
from octoplan.model.paths import Array
from octoplan.model.rod.collocation import gauss
from octoplan.model.rod.discrete_rod import DiscreteRod
from octoplan.model.rod.kernels import Places
from octoplan.model.rod.rod_term import ElementLoad, SectionView
from octoplan.model.rod.structure import (
    RodPoints,
    RodStructure,
    of_term,
    section_values,
    tendon_values,
    uniform_values,
)
from octoplan.model.rod.tendons import state_rate_function, tension_ratio_function
from octoplan.model.rotations import POSE, multiply, unit_matrix
from octoplan.model.support.machine.functions import BatchFunction, cached

SCHEME = RK8
# Largest change of the strains, relative to 1 plus their size, after the last linearisation: the
# error is its square.
_LINEAR = 1e-5
# Largest number of linearisations.
_PASSES = 8
# Places of the evaluations in a step, from 0 to 1.
_SAMPLES = np.array(SCHEME.samples)


class Integration:
    """Parts of elements (P,), each integrated from the first node of its element.

    Arrays (..., P) are (substeps, nodes of the scheme, P).

    Parameters
    ----------
    x : (n_x,)
        Tensions, load factor and states.
    parts : (P,), (P,)
        Elements, and the fraction of each element that is integrated; by default whole elements.
    """

    def __init__(
        self,
        system: DiscreteRod,
        x: Array,
        substeps: int = 1,
        parts: tuple[Places, Array] | None = None,
    ) -> None:
        layout = system.layout
        self._system = system
        self._x = x
        self._states = x[layout.n_before_states :]
        self._structure = layout.structure
        self._load_factor = x[layout.n_tendons]
        self._elements, reach = parts or (np.arange(layout.elements), np.ones(layout.elements))
        known = _known(system, substeps, *parts) if parts else _whole(system, substeps)
        self._known = known
        self._share = known.share
        self._sections = known.sections
        self._length = np.diff(system.mesh.s)[self._elements][:, None]
        self._h = reach[:, None] * self._length / substeps
        self._shape = self._share.shape
        self._dead = self._load_factor * known.dead
        if self._structure.couples_stages:
            self._variables = self._stage_variables()
        self._loads = self._element_loads()

    def _stage_variables(self) -> Array:
        """Return the stage variables (n, n_variables) of all terms at all places."""
        layout = self._system.layout
        h = self._length[:, 0]
        strains = self._by_element(layout.stages)
        parts = [
            term.interpolated_variables(self._share, strains, self._by_element(places), h)
            for term, places in zip(self._system.section_terms, layout.stage_variables, strict=True)
        ]
        variables = np.concatenate(parts, axis=-1)
        return variables.reshape(-1, variables.shape[-1])

    def _by_element(self, places: Places) -> Array:
        """Return states at the stages of each part's element (P, m, n)."""
        rows = self._states[places]
        rows = rows.reshape(self._system.layout.elements, self._structure.stages, rows.shape[1])
        return np.asarray(rows[self._elements])

    def _through_stages(self, weights: Array, places: Places) -> Array:
        """Return weighted sums (..., P, n) of the states at the stages of each element."""
        return np.asarray(np.einsum("...pm,pmn->...pn", weights, self._by_element(places)))

    def begin(self, before: Array | None = None) -> Array:
        """Return initial strains (..., P, n).

        If the cross-sections are not coupled, return the solution of each cross-section: near a
        crushed cross-section no polynomial is accurate enough. Otherwise interpolate the stages of
        collocation, or the strains `before` (nodes, P, n) of a single step.
        """
        layout = self._system.layout
        if not self._structure.has_moment:
            alone = self._sections.unloaded(self._x[None, : layout.n_tendons])
            return alone.reshape(*self._shape, -1)
        if before is None:
            return self._through_stages(
                gauss(self._structure.stages).at(self._share), layout.stages
            )
        powers = np.arange(len(before))
        basis = self._share[:, :, :1] ** powers @ np.linalg.inv(_SAMPLES[:, None] ** powers)
        return np.asarray(np.tensordot(basis, before, 1))

    def run(self, v: Array, known: Array | None = None) -> tuple[Array, Array]:
        """Return the states at the ends of the parts (P, n), and the strains (..., P, n).

        States are pose, wrench and tendon states. The results are NaN without convergence.

        Parameters
        ----------
        v : (..., P, n)
            Strains of the first linearisation.
        known : (P, n)
            Pose and wrench at the ends, which replace the integrated values; NaN if unknown.
        """
        layout = self._system.layout
        states = self._states
        w = POSE + self._structure.n_wrench
        begin = np.hstack(
            [
                states[layout.nodes[self._elements, :w]],
                states[layout.tendon_states[self._elements].reshape(len(self._elements), -1)],
            ]
        )
        wrenches = slice(POSE, w)
        begin[:, wrenches] = self._system.wrenches_beyond(self._x)[self._elements]
        for _ in range(_PASSES):
            self._linearise(v)
            y = begin
            result = np.empty_like(v)
            for step, strains in enumerate(result):
                y = SCHEME.step(partial(self._rate, step, strains), y, self._h)
            if known is not None:
                w = known.shape[1]
                y[:, :w] = np.where(np.isnan(known), y[:, :w], known)
            self._rate(len(result) - 1, result[-1], SCHEME.nodes.index(1.0), y)
            change = np.abs(result - v) / (1 + np.abs(v))
            if not np.all(np.isfinite(change)) or change.max(initial=0.0) <= _LINEAR:
                return y, result
            v = result
        return np.full_like(begin, np.nan), np.full_like(v, np.nan)

    def _linearise(self, v: Array) -> None:
        """Linearise the law of all cross-sections about strains (..., P, n)."""
        sections = self._sections
        flat = v.reshape(-1, v.shape[-1])
        place = sections.place
        tendon = sections.tendon
        tensions = tendon_tensions(self._system, self._x, sections.s, place, tendon)
        at = sections.balance(flat, tensions)
        self._v = v
        self._wrench = at.wrench.reshape(v.shape)
        try:
            inverse = np.linalg.inv(at.jacobian)
        except np.linalg.LinAlgError:
            inverse = np.full_like(at.jacobian, np.nan)
        self._inverse = inverse.reshape(*v.shape, v.shape[-1])
        if self._structure.n_tendon_states:
            self._linearise_tendons(flat, tensions, at.units)

    def _linearise_tendons(self, flat: Array, tensions: Array, units: Array) -> None:
        """Linearise the rates of the tendon states about strains (n, n_strains).

        `tensions` (P,) and `units` (P, n_strains) are the tensions and the wrenches per newton of
        all crossings.
        """
        sections = self._sections
        n_tendons = self._system.layout.n_tendons
        K = self._structure.n_tendon_states
        z = np.hstack([flat, self._variables])[sections.place]
        function = cached(state_rate_function, self._structure)
        values = _batch(function, self._structure)(z, sections.paths.T, self._known.tendons)[0]

        def by_tendon(rows: Array) -> Array:
            """Return rows (P, ...) of crossings as (steps, nodes, parts, n_tendons, ...)."""
            whole = np.zeros((len(flat), n_tendons, *rows.shape[1:]))
            whole[sections.place, sections.tendon] = rows
            return whole.reshape(*self._shape, n_tendons, *rows.shape[1:])

        self._units = by_tendon(units)
        self._tensions = by_tendon(tensions)
        self._state_rates = by_tendon(values[:, :K])
        slopes = values[:, K:].reshape(len(values), flat.shape[1], K)
        self._rate_slopes = by_tendon(slopes)

    def _rate(self, step: int, strains: Array, stage: int, y: Array) -> Array:
        """Return y' (P, n) at a stage of a step, and store the strains there."""
        k = SCHEME.samples.index(SCHEME.nodes[stage])
        at = (step, k)
        structure = self._structure
        w = POSE + structure.n_wrench
        wrench = self._wrench[at]
        if structure.n_tendon_states:
            change = self._tension(at, y[:, w:]) - self._tensions[at]
            wrench = wrench + np.einsum("pmn,pm->pn", self._units[at], change)
        inputs = [y[:, :w], self._v[at], wrench, self._inverse[at], self._dead[at]]
        inputs += [np.full((len(y), 1), self._load_factor), self._known.parameters[at]]
        if self._loads:
            pairs = [load(at, y[:, 4:POSE]) for load in self._loads]
            inputs += [np.sum([pair[i] for pair in pairs], axis=0) for i in (0, 1)]
        rates, strains[k] = cached(_rates, structure, bool(self._loads))(*inputs)
        if not structure.n_tendon_states:
            return np.asarray(rates)
        change = strains[k] - self._v[at]
        of_states = self._state_rates[at] + np.einsum("pmnk,pn->pmk", self._rate_slopes[at], change)
        return np.hstack([rates, of_states.reshape(len(y), -1)])

    def _tension(self, at: tuple[int, int], y: Array) -> Array:
        """Return the tensions (P, n_tendons) for the tendon states (P, n)."""
        n_tendons = self._system.layout.n_tendons
        states = y.reshape(len(y) * n_tendons, -1)
        parameters = self._known.by_tendon[at].reshape(len(states), -1)
        function = cached(tension_ratio_function, self._structure)
        call = _batch(function, self._structure)
        ratio = call(states, np.full((len(states), 1), self._load_factor), parameters)[0]
        return np.asarray(self._x[:n_tendons] * ratio.reshape(len(y), n_tendons))

    def _element_loads(self) -> list[ElementLoad]:
        """Return the loads on elements that terms add by their own kernels."""
        system = self._system
        loads = list[ElementLoad]()
        for terms, groups in zip(system.node_terms, system.layout.node_variables, strict=True):
            for term, places in zip(terms, groups, strict=True):
                values = self._states[places]
                load = term.element_load(values, system.parameters, self._elements, self._share)
                if load is not None:
                    loads.append(load)
        return loads


class _Known(NamedTuple):
    """Quantities that do not depend on states, by step, node of the scheme and part.

    Attributes
    ----------
    share : (substeps, nodes, P)
        Places in the elements, from 0 to 1.
    sections : Sections
        The cross-sections.
    dead : (substeps, nodes, P, 3)
        Resultants of the dead forces [N].
    parameters : (substeps, nodes, P, n)
        Uniform and section parameters of the terms.
    tendons : (P, n)
        Tendon parameters of the terms, of the crossings.
    by_tendon : (substeps, nodes, P, n_tendons, n)
        Tendon parameters for each tendon; 0 beyond its end.
    """

    share: Array
    sections: Sections
    dead: Array
    parameters: Array
    tendons: Array
    by_tendon: Array


@lru_cache(maxsize=32)
def _whole(system: DiscreteRod, substeps: int) -> _Known:
    """Return the known quantities of whole elements."""
    return _known(system, substeps, np.arange(system.mesh.elements), np.ones(system.mesh.elements))


def _known(system: DiscreteRod, substeps: int, elements: Places, reach: Array) -> _Known:
    """Return the known quantities of parts of elements."""
    arm = system.arm
    mesh = system.mesh
    structure = system.layout.structure
    share = (np.arange(substeps)[:, None] + _SAMPLES)[:, :, None] / substeps * reach
    s = mesh.s[elements] + share * np.diff(mesh.s)[elements]
    s = mesh.inside(np.broadcast_to(elements, s.shape), s).ravel()
    active = np.broadcast_to(mesh.active[elements], share.shape).ravel()
    end = np.broadcast_to(mesh.s[1:][elements], share.shape).ravel()
    sections = Sections(arm, system.scene, structure.law, s, active, structure.machine_code)
    dead = dead_resultant(arm, system.scene, s, end).T.reshape(*share.shape, 3)
    points = RodPoints(arm, sections.stations, system.terms)
    uniform = {
        name: np.repeat(value[:, None], s.size, axis=1)
        for name, value in uniform_values(arm, system.section_terms).items()
    }
    parts = [
        structure.stacked("uniform", uniform, s.size),
        structure.stacked("section", section_values(points), s.size),
    ]
    parameters = np.hstack(parts).reshape(*share.shape, -1)
    values = tendon_values(points, sections.place, sections.tendon)
    tendons = structure.stacked("tendon", values, sections.place.size)
    by_tendon = np.zeros((s.size, arm.n_tendons, tendons.shape[1]))
    by_tendon[sections.place, sections.tendon] = tendons
    by_tendon = by_tendon.reshape(*share.shape, *by_tendon.shape[1:])
    return _Known(share, sections, dead, parameters, tendons, by_tendon)


def _batch(function: ca.Function, structure: RodStructure) -> BatchFunction:
    """Return a function for many sets of arguments."""
    return cached(BatchFunction, function, structure.machine_code)


def _rates(structure: RodStructure, loads: bool) -> BatchFunction:
    """Return the function pose and wrench -> their derivatives along s, and strains.

    Further arguments are v_0, w_0 and K (see above), the dead resultant, the load factor, the
    uniform and section parameters of the terms, and with `loads` the loads per length of elements
    in the base frame and in the local frame.
    """
    law = structure.law
    n = structure.n_strains
    y = ca.SX.sym("y", POSE + structure.n_wrench)
    known = ca.SX.sym("v", n)
    wrench = ca.SX.sym("w", n)
    inverse = ca.SX.sym("inverse", n, n)
    dead = ca.SX.sym("dead", 3)
    load_factor = ca.SX.sym("load")
    symbols = structure.symbols("uniform") | structure.symbols("section")
    parameters = ca.vertcat(ca.SX(0, 1), *symbols.values())
    in_base, in_local = (ca.SX.sym(name, 3 * loads) for name in ("base", "local"))
    q = y[:4]
    frame = unit_matrix(q)
    F = dead + y[POSE + 3 :] if structure.has_force else dead
    M = y[POSE : POSE + 3] if structure.has_moment else ca.SX.zeros(3)
    force = frame.T @ F
    v = known + inverse.T @ (join(law, frame.T @ M, force[0], force[1:]) - wrench)
    kappa, nu = law.twist(v)
    along = frame @ nu
    rates = [multiply(q, ca.vertcat(0, kappa)) / 2, along]
    sections = [
        SectionView(
            strains=v,
            variables=ca.SX.nan(term.n_stage_variables(law)),
            parameters=of_term(structure, i, symbols),
            load_factor=load_factor,
            frame=frame,
            kappa=kappa,
            nu=nu,
            from_base=lambda vector: vector,
        )
        for i, term in enumerate(structure.terms)
    ]
    views = list(zip(structure.terms, sections, strict=True))
    if structure.has_moment:
        m = ca.SX.zeros(3)
        for term, section in views:
            m += load_factor * term.moment_per_length(section)
        rates.append(-ca.cross(along, F) - m)
    if structure.has_force:
        f = in_base + frame @ in_local if loads else ca.SX.zeros(3)
        for term, section in views:
            f += load_factor * term.load_per_length(section)
        rates.append(-f)
    inputs = [y, known, wrench, ca.vec(inverse), dead, load_factor, parameters]
    inputs += [in_base, in_local] * loads
    function = ca.Function("rates", inputs, [ca.vertcat(*rates), v], {"cse": True})
    return BatchFunction(function, structure.machine_code)


def poses_and_strains(system: DiscreteRod, x: Array, s: Array) -> tuple[Array, Array]:
    """Return poses (N, 7), and strains (N, n) on the base side of arc lengths s (N,).

    Poses and wrenches at nodes are the node states. Strains balance the wrench by the law of the
    cross-section.
    """
    mesh = system.mesh
    elements = np.clip(np.searchsorted(mesh.s, s) - 1, 0, mesh.elements - 1)
    reach = (s - mesh.s[elements]) / np.diff(mesh.s)[elements]
    n_known = POSE + system.layout.structure.n_wrench
    at_nodes = x[system.layout.n_before_states + system.layout.nodes[elements + 1, :n_known]]
    known = np.where(reach[:, None] < 1, np.nan, at_nodes)
    parts = Integration(system, x, 1, (elements, reach))
    y, strains = parts.run(parts.begin(), known)
    return y[:, :POSE], strains[-1, -1]


def tendon_tensions(at: DiscreteRod, x: Array, s: Array, place: Places, tendon: Places) -> Array:
    """Return the tensions (P,) at P crossings: tendon[i] at the arc length s[place[i]]."""
    T = x[tendon]
    layout = at.layout
    states = x[layout.n_before_states :]
    load = float(x[layout.n_tendons])
    for terms, groups in zip(at.node_terms, layout.node_variables, strict=True):
        for term, places in zip(terms, groups, strict=True):
            T = T * term.tension_factors(states[places], load, at.mesh, s[place], tendon)
    structure = layout.structure
    if not structure.n_tendon_states:
        return np.asarray(T)
    m = structure.stages
    h = np.diff(at.mesh.s)
    points = RodPoints(at.arm, at.sections.stations, at.terms)
    stage, tendon_of_stage = layout.crossings
    values = tendon_values(points, stage, tendon_of_stage)
    parameters = structure.stacked("tendon", values, stage.size)
    inside = np.hstack(
        [
            states[layout.stages],
            *(states[places] for places in layout.stage_variables),
        ]
    )
    function = cached(state_rate_function, structure)
    rows = _batch(function, structure)(inside[stage], at.sections.paths.T, parameters)[0]
    K = structure.n_tendon_states
    at_stages = np.zeros((layout.elements * m, layout.n_tendons, K))
    at_stages[stage, tendon_of_stage] = rows[:, :K]
    rates = at_stages.reshape(layout.elements, m, layout.n_tendons, K)
    element_of_s = np.clip(np.searchsorted(at.mesh.s, s) - 1, 0, at.mesh.elements - 1)
    element = element_of_s[place]
    share = (s[place] - at.mesh.s[element]) / h[element]
    powers = np.arange(1, m + 1)
    weights = h[element, None] * (share[:, None] ** powers / powers @ gauss(m).powers)
    grown = np.einsum("pm,pmk->pk", weights, rates[element, :, tendon])
    tendon_states = states[layout.tendon_states[element, tendon]] + grown
    there = stations(at.arm, s, at.mesh.active[element_of_s])
    values = tendon_values(RodPoints(at.arm, there, at.terms), place, tendon)
    ratio = _batch(cached(tension_ratio_function, structure), structure)(
        tendon_states,
        np.full((len(tendon_states), 1), load),
        structure.stacked("tendon", values, tendon.size),
    )[0]
    return np.asarray(T * ratio[:, 0])
