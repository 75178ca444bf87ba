"""Kernels of the cross-sections and of the tendons, with the tendon states of the rod terms.

The tension of a tendon without states is constant, and its wrench is a kernel of one stage.
With states y of a term,

    T(s) = T(0) tension_ratio(y)        y' = tendon_state_rate(v, ...)        y = 0 at the motor

and y jumps where other tendons end or have kinks, because the strains jump there.
"""

from __future__ import annotations

from dataclasses import replace

import casadi as ca

from octoplan.model.cross_section.law import CrossSection, body_size, size
from octoplan.model.rod.collocation import gauss, weighted_sum
from octoplan.model.rod.kernels import Intermediates, Kernel
from octoplan.model.rod.rod_term import SectionView, TendonView
from octoplan.model.rod.structure import RodStructure, of_term


def body(structure: RodStructure) -> Kernel:
    """Return the kernel of the body of a cross-section.

    Unknowns: strains and further stage variables. Rows: wrench of the body, then the shares of the
    terms in their stage equations.
    """
    law = structure.law
    z = ca.SX.sym("v", structure.n_stage)
    body_parameters = ca.SX.sym("body", body_size(law))
    v = z[: structure.n_strains]
    of_terms = structure.symbols("section", stage_variables=True)
    parameters = {"body": body_parameters} | of_terms
    rate = ca.SX.sym("body_rate", body_size(law))
    if structure.n_stage > structure.n_strains:
        parameters["body_rate"] = rate
    rows = [law.body(v, body_parameters)]
    for i, term in enumerate(structure.terms):
        if term.n_stage_variables(law):
            view = SectionView(
                strains=v,
                variables=z[structure.variable_slices[i]],
                parameters=of_term(structure, i, of_terms),
                body=body_parameters,
                body_rate=rate,
            )
            rows.append(term.body_equations(law, view))
    return Kernel("body", z, parameters, ca.vertcat(*rows))


def tendon(law: CrossSection) -> Kernel:
    """Return the kernel of a tendon without states at a stage: its wrench.

    Unknowns: tension, strains.
    """
    T = ca.SX.sym("T")
    v = ca.SX.sym("v", size(law))
    path = ca.SX.sym("path", 4)
    intermediates = Intermediates()
    wrench = T * law.tendon(v, path, intermediates.define)
    return Kernel("tendon", ca.vertcat(T, v), {"path": path}, wrench, intermediates)


def tendon_length(law: CrossSection) -> Kernel:
    """Return the kernel of a tendon's length at a stage: weight |u_c'|. Unknowns: strains."""
    v = ca.SX.sym("v", size(law))
    path = ca.SX.sym("path", 4)
    weight = ca.SX.sym("weight")
    length = weight * ca.norm_2(law.tendon_rate(v, path))
    return Kernel("tendon_length", v, {"path": path, "weight": weight}, length)


class TendonSymbols:
    """Unknowns and parameters of one tendon with states in one element of m stages.

    Unknowns: load factor, tension at the motor, states at both nodes, strains and further variables
    by stage. Parameters: h, the paths (4, m), and the parameters of the terms.
    """

    def __init__(self, structure: RodStructure) -> None:
        m = structure.stages
        self._structure = structure
        self.load_factor = ca.SX.sym("load")
        self.T = ca.SX.sym("T")
        self.y = ca.SX.sym("y", structure.n_tendon_states)
        self.y_next = ca.SX.sym("y_next", structure.n_tendon_states)
        z = ca.SX.sym("z", structure.n_stage, m)
        self.v = z[: structure.n_strains, :]
        self.z = z
        self.unknowns = ca.vertcat(self.load_factor, self.T, self.y, self.y_next, ca.vec(z))
        self.h = ca.SX.sym("h")
        self.path = ca.SX.sym("path", 4, m)
        self.of_terms = structure.symbols("tendon", m)
        self.parameters = {"h": self.h, "path": self.path} | self.of_terms

    def view(self, i: int, stage: int) -> TendonView:
        """Return the tendon at a stage for term i, without states."""
        return TendonView(
            strains=self.v[:, stage],
            variables=self.z[self._structure.variable_slices[i], stage],
            path=self.path[:, stage],
            parameters=of_term(self._structure, i, self.of_terms, stage),
            load_factor=self.load_factor,
        )


def tendon_in_element(structure: RodStructure) -> Kernel:
    """Return the kernel of a tendon with states in an element; see TendonSymbols.

    Rows: by stage the wrench, then the shares of the terms in their stage equations; the residual
    of the states at the far node.
    """
    x = TendonSymbols(structure)
    law = structure.law
    method = gauss(structure.stages)
    intermediates = Intermediates()
    of_stages = [Intermediates() for _ in range(structure.stages)]
    views = [
        [replace(x.view(i, stage), define=inner.define_once) for i in _terms(structure)]
        for stage, inner in enumerate(of_stages)
    ]
    rates = [
        intermediates.define(state_rates(structure, view), inner)
        for view, inner in zip(views, of_stages, strict=True)
    ]
    rows = []
    for stage, inner in enumerate(of_stages):
        states = x.y + x.h * weighted_sum(method.a[stage], rates)
        T, T_rate = _tension(structure, views[stage], x.T, states, rates[stage])
        T = intermediates.define(T)
        T_rate = intermediates.define(T_rate)
        wrench = law.tendon(x.v[:, stage], x.path[:, stage], inner.define_once)
        extended = [
            (term, view)
            for term, view in zip(structure.terms, views[stage], strict=True)
            if term.n_stage_variables(law)
        ]
        shares = [term.tendon_equations(law, view) for term, view in extended]
        defined = intermediates.define(ca.vertcat(wrench, *shares), inner)
        wrench = defined[: structure.n_strains]
        of_rate = [term.tension_rate_equations(law, wrench) for term, _ in extended]
        rows.append(T * defined + T_rate * ca.vertcat(ca.SX(structure.n_strains, 1), *of_rate))
    rows.append(x.y_next - x.y - x.h * weighted_sum(method.b, rates))
    residuals = ca.vertcat(*rows)
    return Kernel("tendon_in_element", x.unknowns, x.parameters, residuals, intermediates)


def _tension(
    structure: RodStructure, views: list[TendonView], T: ca.SX, states: ca.SX, rates: ca.SX
) -> tuple[ca.SX, ca.SX]:
    """Return the tension at a stage and its derivative along s, from the tension at the motor."""
    y = ca.SX.sym("y", structure.n_tendon_states)
    at = [
        replace(view, states=y[part])
        for view, part in zip(views, structure.state_slices, strict=True)
    ]
    tension = T * tension_ratio(structure, at)
    rate = ca.jtimes(tension, y, rates)
    tension, rate = ca.substitute([tension, rate], [y], [states])
    return tension, rate


def state_rates(structure: RodStructure, views: list[TendonView]) -> ca.SX:
    """Return the derivatives (n_tendon_states,) of a tendon's states, by its view for each term."""
    pairs = zip(structure.terms, views, strict=True)
    return ca.vertcat(*(term.tendon_state_rate(structure.law, view) for term, view in pairs))


def tension_ratio(structure: RodStructure, views: list[TendonView]) -> ca.SX:
    """Return the tension over the tension at the motor, by the tendon's view for each term."""
    ratio = ca.SX(1)
    for term, view in zip(structure.terms, views, strict=True):
        ratio *= term.tension_ratio(view)
    return ratio


def tendon_jump(structure: RodStructure) -> Kernel:
    """Return the kernel of a tendon between two elements where other tendons end or have kinks.

    Unknowns: strains and further variables by stage of the element before and of the element
    beyond. Parameters: h of both, the tendon's path on both sides of the node. Rows: minus the
    jump of its states.
    """
    before = ca.SX.sym("before", structure.n_stage, structure.stages)
    after = ca.SX.sym("after", structure.n_stage, structure.stages)
    h = ca.SX.sym("h", 2)
    paths = [ca.SX.sym(f"path_{side}", 4) for side in ("before", "after")]
    intermediates = Intermediates()
    jumps = []
    for i, term in enumerate(structure.terms):
        views_before, views_after = (
            [
                TendonView(
                    strains=v[: structure.n_strains],
                    variables=v[structure.variable_slices[i]],
                    path=path,
                    parameters={},
                    define=intermediates.define,
                )
                for v in ca.horzsplit(side)
            ]
            for side, path in zip((before, after), paths, strict=True)
        )
        jumps.append(term.tendon_jump(structure.law, views_before, views_after, h))
    y = ca.vertcat(ca.vec(before), ca.vec(after))
    parameters = {"h": h, "path_before": paths[0], "path_after": paths[1]}
    return Kernel("tendon_jump", y, parameters, -ca.vertcat(*jumps), intermediates)


def idle_tendon() -> Kernel:
    """Return the kernel of a tendon's state beyond its end, which stays the same."""
    before = ca.SX.sym("before")
    after = ca.SX.sym("after")
    return Kernel("idle_tendon", ca.vertcat(before, after), {}, after - before)


# Functions of the continuous rod, by which integrators verify the kernels


def state_rate_function(structure: RodStructure) -> ca.Function:
    """Return (z, path, parameters) -> tendon states' rates, then their Jacobian by the strains.

    At one cross-section, z (n_stage,) the strains and further variables, parameters those of the
    tendon of all terms behind each other.
    """
    z = ca.SX.sym("z", structure.n_stage)
    path = ca.SX.sym("path", 4)
    symbols = structure.symbols("tendon")
    v = ca.SX.sym("v", structure.n_strains)
    views = [
        TendonView(
            strains=v,
            variables=z[structure.variable_slices[i]],
            path=path,
            parameters=of_term(structure, i, symbols),
        )
        for i in _terms(structure)
    ]
    rates = state_rates(structure, views)
    values = ca.vertcat(rates, ca.vec(ca.densify(ca.jacobian(rates, v))))
    values = ca.densify(ca.substitute(values, v, z[: structure.n_strains]))
    parameters = ca.vertcat(ca.SX(0, 1), *symbols.values())
    return ca.Function("state_rate", [z, path, parameters], [values], {"cse": True})


def tension_ratio_function(structure: RodStructure) -> ca.Function:
    """Return (y, load factor, parameters) -> tension over the tension at the motor.

    See state_rate_function.
    """
    y = ca.SX.sym("y", structure.n_tendon_states)
    load_factor = ca.SX.sym("load")
    symbols = structure.symbols("tendon")
    undefined = ca.SX.nan(structure.n_stage)
    views = [
        TendonView(
            strains=undefined[: structure.n_strains],
            variables=undefined[structure.variable_slices[i]],
            path=ca.SX.nan(4),
            parameters=of_term(structure, i, symbols),
            load_factor=load_factor,
            states=y[structure.state_slices[i]],
        )
        for i in _terms(structure)
    ]
    parameters = ca.vertcat(ca.SX(0, 1), *symbols.values())
    ratio = tension_ratio(structure, views)
    return ca.Function("tension_ratio", [y, load_factor, parameters], [ratio], {"cse": True})


def _terms(structure: RodStructure) -> range:
    """Return the indices of the terms."""
    return range(len(structure.terms))
