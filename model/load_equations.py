"""The tip-to-base equations of a loaded arm, its jumps, and what holds at the tip: SX expressions.

A state x is the pose (7,), the strains of the statics, then the part of the force beyond the
section that depends on the shape (3,), the tensions of tendons with friction (n_tendons,), and the
lengths of the tendons beyond the section (n_tendons,), where these are called for. With F and M
the loads beyond s, kappa and nu the strains per unit reference length, and L the wrench that
strains and tendons balance,

    F' = -f        M' = -u' x F        L(strain; T, s) = (M, F)

so that in local components

    L_strain strain' = (-kappa x M - nu x F, -kappa x F - f) - L_T T' - L_s
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import casadi as ca

from model.loads import LoadForm
from model.rotations import multiply, rotate
from model.runge_kutta import RungeKutta
from model.statics import LoadedStatics
from model.statics.algebra import solve_symmetric

# Sweeps of the fixed point T' -> strain' -> T', which contracts by mu T y y' / EJ or so: 0.05, or
# 0.3 where tendons pull hard along a steep taper.
_SWEEPS = 16
_TINY = 1e-30


@dataclass(frozen=True)
class LoadEquations:
    """The equations of one form of loads on one statics.

    Attributes
    ----------
    statics : LoadedStatics
    form : LoadForm
    section, cos, sin
        Section index and direction (n, b) of each tendon.
    """

    statics: LoadedStatics
    form: LoadForm
    section: tuple[int, ...]

    @property
    def n_force(self) -> int:
        """Size of the force that is a state."""
        return 3 * self.form.moving

    @property
    def n_tension(self) -> int:
        """Number of tensions that are states."""
        return len(self.form.friction or ())

    @property
    def n_length(self) -> int:
        """Number of tendon lengths that are states."""
        return self.form.n_tendons * self.form.lengths

    @property
    def n_x(self) -> int:
        """Size of a state."""
        return 7 + self.statics.size + self.n_force + self.n_tension + self.n_length

    @property
    def n_pull(self) -> int:
        """Size of pull; with friction its map from the tensions, column by column."""
        return self.statics.n_pull * max(self.n_tension, 1)

    @property
    def pull_varies(self) -> bool:
        """Whether pull changes along a segment at constant tensions."""
        return self.statics.pull_varies

    @property
    def n_numbers(self) -> int:
        """Size of the numbers of the loads."""
        return sum(self.form.rows.values())

    def split(self, x: ca.SX) -> tuple[ca.SX, ca.SX, ca.SX, ca.SX]:
        """Return pose, strain, force and tensions of a state; what is left are the lengths."""
        strain = 7 + self.statics.size
        force = strain + self.n_force
        return x[:7], x[7:strain], x[strain:force], x[force : force + self.n_tension]

    def lengths(self, x: ca.SX) -> ca.SX:
        """Return the lengths of the tendons beyond a section."""
        return x[self.n_x - self.n_length :]

    def symbols(self, columns: int = 1) -> list[ca.SX]:
        """Return pull, data, pull rate, data rate and numbers of cross-sections."""
        sizes = (self.n_pull, self.statics.n_data, self.n_pull, self.statics.n_data, self.n_numbers)
        names = ("pull", "data", "pull_rate", "data_rate", "numbers")
        return [ca.SX.sym(name, size, columns) for name, size in zip(names, sizes, strict=True)]

    def pulled(self, pull: ca.SX, tensions: ca.SX) -> ca.SX:
        """Return the pull that the statics take, of tensions that vary along the arm or not."""
        return ca.reshape(pull, -1, self.n_tension) @ tensions if self.n_tension else pull

    def force(self, x: ca.SX, numbers: ca.SX) -> ca.SX:
        """Return the force of the loads beyond a section in local components (3,)."""
        if not self.form.force:
            return ca.SX.zeros(3)
        pose, _, moving, _ = self.split(x)
        total = self._numbers(numbers)["force"]
        return rotate(_back(pose), total + moving if self.n_force else total)

    def twist(self, x: ca.SX, pull: ca.SX, data: ca.SX, numbers: ca.SX) -> tuple[ca.SX, ca.SX]:
        """Return kappa and nu (3,) of a state."""
        _, strain, _, tensions = self.split(x)
        force = self.force(x, numbers)
        return self.statics.twist(strain, self.pulled(pull, tensions), data, force)

    def rate(
        self, x: ca.SX, pull: ca.SX, data: ca.SX, pull_rate: ca.SX, data_rate: ca.SX, numbers: ca.SX
    ) -> ca.SX:
        """Return the derivative of the state along s.

        With friction the tensions fall with the turning of the tendons, which depends on the
        strains' rates, which depend on the tensions' rates: a fixed point, found by sweeps.
        """
        args = [pull, data, pull_rate, data_rate, numbers]
        found = self.swept(x, args, None)
        for _ in range(_SWEEPS * (self.n_tension > 0)):
            found = self.swept(x, args, found[self.strains])
        return found

    @property
    def strains(self) -> slice:
        """Where the strains are in a state."""
        return slice(7, 7 + self.statics.size)

    def swept(self, x: ca.SX, args: list[ca.SX], strain_rate: ca.SX | None) -> ca.SX:
        """Return the derivative of the state, friction by a guess of that of the strains."""
        pull, data, pull_rate, data_rate, numbers = args
        pose, strain, _, tensions = self.split(x)
        kappa, nu = self.twist(x, pull, data, numbers)
        drag = self._drag(pose, nu, numbers)
        at = (strain, self.pulled(pull, tensions), data)
        sides = self._wrench_rate(x, at, kappa, nu, drag, numbers)
        tension_rate = ca.SX.zeros(self.n_tension)
        varied = self.pulled(pull_rate, tensions)
        if strain_rate is not None and self.n_tension:
            tension_rate = self._tension_rate(x, strain_rate, kappa, numbers)
            varied = varied + self.pulled(pull, tension_rate)
        own_rate = self._strain_rate(at, varied, data_rate, sides)
        turn = multiply(pose[:4], ca.vertcat(0, kappa)) / 2
        force_rate = -drag if self.n_force else ca.SX.zeros(0)
        spooled = self._length_rate(strain, kappa, nu, numbers)
        shape_rate = ca.vertcat(turn, rotate(pose[:4], nu), own_rate)
        return ca.vertcat(shape_rate, force_rate, tension_rate, spooled)

    def jump(
        self, x: ca.SX, outer: list[ca.SX], y: ca.SX, inner: list[ca.SX], probe: ca.SX
    ) -> ca.SX:
        """Return what vanishes across an anchorage or a load (n_x,).

        x, y are the states on the tip and the base side; `outer`, `inner` pull, data and numbers;
        `probe` (3,) a moment that acts there, or nothing. The moment is continuous but for it, the
        force is what lies beyond, and a tendon that goes on bends by the angle between its
        tangents.
        """
        pose, strain, force, tensions = self.split(x)
        inner_pose, inner_strain, inner_force, inner_tensions = self.split(y)
        moment = self.statics.wrench(strain, self.pulled(outer[0], tensions), outer[1])[:3]
        if self.form.probed:
            moment = moment + rotate(_back(pose), probe)
        wrench = self._with_forces(moment, self.force(y, inner[2]))
        at = (inner_strain, self.pulled(inner[0], inner_tensions), inner[1])
        rows = [inner_pose - pose, self._balance(at, wrench), inner_force - force]
        if self.n_tension:
            slip = self._slip(strain, inner_strain, outer[2], inner[2])
            rows.append(inner_tensions - tensions * slip)
        rows.append(self.lengths(y) - self.lengths(x))
        return ca.vertcat(*rows)

    def tip(self, y: ca.SX, inner: list[ca.SX], load: ca.SX, probe: ca.SX) -> ca.SX:
        """Return what vanishes at the tip, for its strains, force, and lengths that are states.

        `load` (6,) is the force and moment of the load at the tip, in the base frame or the tip's;
        `probe` (3,) a further moment in the base frame, or nothing.
        """
        pose, strain, force, tensions = self.split(y)
        moment = load[3:] if self.form.follower else rotate(_back(pose), load[3:])
        if self.form.probed:
            moment = moment + rotate(_back(pose), probe)
        at = (strain, self.pulled(inner[0], tensions), inner[1])
        rows = [self._balance(at, self._with_forces(moment, self.force(y, inner[2])))]
        if self.n_force:
            known = rotate(pose[:4], load[:3]) if self.form.follower else ca.SX.zeros(3)
            rows.append(force - known)
        return ca.vertcat(*rows, self.lengths(y))

    def _balance(self, at: tuple[ca.SX, ca.SX, ca.SX], wrench: ca.SX) -> ca.SX:
        """Return L less the wrench as strains: moments over E J, forces over E A."""
        EA, EJ = at[2][0], at[2][1]
        gap = self.statics.wrench(*at) - wrench
        return ca.vertcat(gap[:3] / EJ, gap[3:] / EA)

    def _with_forces(self, moment: ca.SX, force: ca.SX) -> ca.SX:
        return ca.vertcat(moment, *(force[i] for i in self.statics.forces))

    def _numbers(self, numbers: ca.SX) -> dict[str, ca.SX]:
        found, start = {}, 0
        for name, size in self.form.rows.items():
            found[name] = numbers[start : start + size]
            start += size
        return found

    def _drag(self, pose: ca.SX, nu: ca.SX, numbers: ca.SX) -> ca.SX:
        """Return the drag per unit reference length in the base frame (3,); see Current."""
        if self.form.velocity is None:
            return ca.SX.zeros(3)
        v, t = ca.SX(ca.DM(self.form.velocity)), rotate(pose[:4], ca.SX([1, 0, 0]))
        across = v - t * ca.dot(t, v)
        speed = ca.sqrt(ca.sumsqr(across) + _TINY)
        return self._numbers(numbers)["drag"] * nu[0] * speed * across

    def _wrench_rate(
        self,
        x: ca.SX,
        at: tuple[ca.SX, ca.SX, ca.SX],
        kappa: ca.SX,
        nu: ca.SX,
        drag: ca.SX,
        numbers: ca.SX,
    ) -> ca.SX:
        """Return the derivative along s of the local wrench of the loads beyond."""
        moment = self.statics.wrench(*at)[:3]
        if not self.form.force:
            return self._with_forces(-ca.cross(kappa, moment), ca.SX.zeros(3))
        force = self.force(x, numbers)
        spread = drag + self._numbers(numbers)["density"] if self.form.weight else drag
        turned = -ca.cross(kappa, force) - rotate(_back(x), spread)
        return self._with_forces(-ca.cross(kappa, moment) - ca.cross(nu, force), turned)

    def _strain_rate(
        self,
        at: tuple[ca.SX, ca.SX, ca.SX],
        pull_rate: ca.SX,
        data_rate: ca.SX,
        wrench_rate: ca.SX,
    ) -> ca.SX:
        strain, pull, data = (ca.SX.sym("at", *v.shape) for v in at)
        wrench = self.statics.wrench(strain, pull, data)
        along = ca.jtimes(wrench, pull, pull_rate) + ca.jtimes(wrench, data, data_rate)
        rate = solve_symmetric(ca.jacobian(wrench, strain), wrench_rate - along)
        return ca.substitute([rate], [strain, pull, data], list(at))[0]

    def _tension_rate(self, x: ca.SX, strain_rate: ca.SX, kappa: ca.SX, numbers: ca.SX) -> ca.SX:
        """Return T' = -direction mu T |d(c/|c|)/ds|; see Friction."""
        _, strain, _, tensions = self.split(x)
        named = self._numbers(numbers)
        rates = []
        for j, way in enumerate(self.form.friction or ()):
            y, y_rate, y_curve = self._path(j, named["paths"])
            e, s = ca.SX.sym("e", self.statics.size), ca.SX.sym("path", 2)
            c = self.statics.tangent(j, e, s[0], s[1])
            moved = ca.jtimes(c, e, strain_rate) + ca.jtimes(c, s, ca.vertcat(y_rate, y_curve))
            unit, rate = ca.substitute(
                [c / ca.norm_2(c), moved / ca.norm_2(c)], [e, s], [strain, ca.vertcat(y, y_rate)]
            )
            turning = rate - unit * ca.dot(unit, rate) + ca.cross(kappa, unit)
            bend = ca.sqrt(ca.sumsqr(turning) + _TINY) * named["crosses"][j]
            rates.append(-way * named["mu"] * tensions[j] * bend)
        return ca.vertcat(*rates)

    def _length_rate(self, strain: ca.SX, kappa: ca.SX, nu: ca.SX, numbers: ca.SX) -> ca.SX:
        """Return the derivative of the tendons' lengths beyond a section: -|c| of each."""
        rates, named = [], self._numbers(numbers)
        for j in range(self.n_length):
            y, y_rate, _ = self._path(j, named["paths"])
            c = self.statics.run(j, strain, kappa, nu, y, y_rate)
            rates.append(-ca.norm_2(c) * named["crosses"][j])
        return ca.vertcat(*rates)

    def _slip(self, strain: ca.SX, inner: ca.SX, outer_n: ca.SX, inner_n: ca.SX) -> ca.SX:
        """Return T on the base side over T on the tip side (n_tendons,)."""
        beyond, named = self._numbers(outer_n), self._numbers(inner_n)
        factors = []
        for j, way in enumerate(self.form.friction or ()):
            y, y_rate, _ = self._path(j, named["paths"])
            units = [self.statics.tangent(j, e, y, y_rate) for e in (strain, inner)]
            a, b = (c / ca.norm_2(c) for c in units)
            angle = 2 * ca.asin(ca.fmin(ca.sqrt(ca.sumsqr(a - b) + _TINY) / 2, 1))
            factors.append(ca.exp(way * named["mu"] * angle * beyond["crosses"][j]))
        return ca.vertcat(*factors)

    def _path(self, j: int, paths: ca.SX) -> tuple[ca.SX, ca.SX, ca.SX]:
        i, n = self.section[j], self.form.n_sections
        return paths[i], paths[n + i], paths[2 * n + i]


def _back(pose: ca.SX) -> ca.SX:
    """Return the quaternion that turns the base frame's components into local ones."""
    return ca.vertcat(pose[0], -pose[1:4])


@lru_cache(maxsize=64)
def rate_function(equations: LoadEquations) -> ca.Function:
    """Return (x, pull, data, pull rate, data rate, numbers) -> derivative of x along s."""
    x, args = ca.SX.sym("x", equations.n_x), equations.symbols()
    return ca.Function("rate", [x, *args], [equations.rate(x, *args)], {"cse": True})


@lru_cache(maxsize=64)
def load_step(equations: LoadEquations, scheme: RungeKutta) -> ca.Function:
    """Return (x, pulls, datas, pull rates, data rates, numbers, h) -> x across one step.

    All but x and h have a column for each distinct node of the scheme.
    """
    nodes = sorted(set(scheme.nodes))
    x, h, args = ca.SX.sym("x", equations.n_x), ca.SX.sym("h"), equations.symbols(len(nodes))
    slope = rate_function(equations)

    def rate(stage: int, x: ca.SX) -> ca.SX:
        i = nodes.index(scheme.nodes[stage])
        return slope(x, *(values[:, i] for values in args))

    return ca.Function("step", [x, *args, h], [scheme.step(rate, x, h)], {"cse": True})


@lru_cache(maxsize=64)
def jump_function(equations: LoadEquations) -> ca.Function:
    """Return (x, pull, data, numbers outside, y, the same inside, probe) -> residual."""
    x, y = ca.SX.sym("x", equations.n_x), ca.SX.sym("y", equations.n_x)
    outer, inner = ([s[0], s[1], s[4]] for s in (equations.symbols(), equations.symbols()))
    probe = ca.SX.sym("probe", 3 * equations.form.probed)
    residual = equations.jump(x, outer, y, inner, probe)
    return ca.Function("jump", [x, *outer, y, *inner, probe], [residual], {"cse": True})


@lru_cache(maxsize=64)
def tip_function(equations: LoadEquations) -> ca.Function:
    """Return (y, pull, data, numbers, load (6,), probe) -> residual at the tip."""
    y, load, s = ca.SX.sym("y", equations.n_x), ca.SX.sym("load", 6), equations.symbols()
    inner, probe = [s[0], s[1], s[4]], ca.SX.sym("probe", 3 * equations.form.probed)
    residual = equations.tip(y, inner, load, probe)
    return ca.Function("tip", [y, *inner, load, probe], [residual], {"cse": True})


@lru_cache(maxsize=64)
def strain_reader(equations: LoadEquations) -> ca.Function:
    """Return (x, pull, data, numbers) -> (tau, xi, k, q, nu_n, nu_b)."""
    x, s = ca.SX.sym("x", equations.n_x), equations.symbols()
    kappa, nu = equations.twist(x, s[0], s[1], s[4])
    full = ca.vertcat(kappa / nu[0], nu[0] - 1, nu[1:])
    return ca.Function("strain", [x, s[0], s[1], s[4]], [full], {"cse": True})


@lru_cache(maxsize=64)
def state_reader(equations: LoadEquations) -> ca.Function:
    """Return (tau, xi, k, q) without loads -> the strains that are states."""
    e = ca.SX.sym("e", 4)
    kappa, nu = (1 + e[3]) * e[:3], ca.vertcat(1 + e[3], 0, 0)
    return ca.Function("state", [e], [equations.statics.state(kappa, nu)])
