"""How tensions fall by friction, and how long tendons are, along a loaded arm: SX expressions."""

from __future__ import annotations

import casadi as ca

from model.loaded.state import LoadState

# Under square roots whose argument may vanish, so that their slopes are not NaN there.
TINY = 1e-30


def tension_rate(
    of: LoadState, x: ca.SX, strain_rate: ca.SX, kappa: ca.SX, numbers: ca.SX
) -> ca.SX:
    """Return T' = -direction mu T |d(c/|c|)/ds| (n_tendons,) [N/m]; see Friction."""
    _, strain, _, tensions = of.split(x)
    named = of.numbers(numbers)
    rates = []
    for j, way in enumerate(of.form.friction or ()):
        y, y_rate, y_curve = of.path(j, named["paths"])
        e, s = ca.SX.sym("e", of.statics.size), ca.SX.sym("path", 2)
        c = of.statics.tangent(j, e, s[0], s[1])
        moved = ca.jtimes(c, e, strain_rate) + ca.jtimes(c, s, ca.vertcat(y_rate, y_curve))
        unit, rate = ca.substitute(
            [c / ca.norm_2(c), moved / ca.norm_2(c)], [e, s], [strain, ca.vertcat(y, y_rate)]
        )
        turning = rate - unit * ca.dot(unit, rate) + ca.cross(kappa, unit)
        bend = ca.sqrt(ca.sumsqr(turning) + TINY) * named["crosses"][j]
        rates.append(-way * named["mu"] * tensions[j] * bend)
    return ca.vertcat(*rates)


def slip(of: LoadState, strain: ca.SX, inner: ca.SX, outer_n: ca.SX, inner_n: ca.SX) -> ca.SX:
    """Return T on the base side over T on the tip side (n_tendons,), where strains jump to `inner`.

    exp(direction mu angle), by the angle between the tendon's tangents; of what goes on beyond.
    """
    beyond, named = of.numbers(outer_n), of.numbers(inner_n)
    factors = []
    for j, way in enumerate(of.form.friction or ()):
        y, y_rate, _ = of.path(j, named["paths"])
        units = [of.statics.tangent(j, e, y, y_rate) for e in (strain, inner)]
        a, b = (c / ca.norm_2(c) for c in units)
        angle = 2 * ca.asin(ca.fmin(ca.sqrt(ca.sumsqr(a - b) + TINY) / 2, 1))
        factors.append(ca.exp(way * named["mu"] * angle * beyond["crosses"][j]))
    return ca.vertcat(*factors)


def length_rate(of: LoadState, strain: ca.SX, kappa: ca.SX, nu: ca.SX, numbers: ca.SX) -> ca.SX:
    """Return the derivative of the tendons' lengths beyond a section (n_length,): -|c| of each."""
    rates, named = [], of.numbers(numbers)
    for j in range(of.n_length):
        y, y_rate, _ = of.path(j, named["paths"])
        c = of.statics.run(j, strain, kappa, nu, y, y_rate)
        rates.append(-ca.norm_2(c) * named["crosses"][j])
    return ca.vertcat(*rates)
