"""What a state of a loaded arm holds, and what a cross-section's numbers are: SX expressions.

A state x is the pose (7,), the strains of the statics, then the part of the force beyond the
section that depends on the shape (3,), the tensions of tendons with friction (n_tendons,), and the
lengths of the tendons beyond the section (n_tendons,), where these are called for.
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca

from model.loaded.loads import LoadForm
from model.rotations import conjugate, rotate
from model.statics import LoadedStatics


@dataclass(frozen=True)
class LoadState:
    """The states of one form of loads on one statics.

    Attributes
    ----------
    statics : LoadedStatics
    form : LoadForm
    section : (n_tendons,)
        Index of the section that each tendon ends at, 0 at the tip.
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
    def strains(self) -> slice:
        """Where the strains are in a state."""
        return slice(7, 7 + self.statics.size)

    @property
    def tensions(self) -> slice:
        """Where the tensions are in a state."""
        start = 7 + self.statics.size + self.n_force
        return slice(start, start + self.n_tension)

    @property
    def n_pull(self) -> int:
        """Size of pull; with friction its map from the tensions, column by column."""
        return self.statics.n_pull * max(self.n_tension, 1)

    @property
    def n_numbers(self) -> int:
        """Size of the numbers of the loads."""
        return sum(self.form.rows.values())

    def split(self, x: ca.SX) -> tuple[ca.SX, ca.SX, ca.SX, ca.SX]:
        """Return pose, strain, force and tensions of a state; what is left are the lengths."""
        force = slice(self.strains.stop, self.tensions.start)
        return x[:7], x[self.strains], x[force], x[self.tensions]

    def lengths(self, x: ca.SX) -> ca.SX:
        """Return the lengths of the tendons beyond a section (n_length,)."""
        return x[self.tensions.stop :]

    def symbols(self, columns: int = 1) -> list[ca.SX]:
        """Return pull, data, pull rate, data rate and numbers of cross-sections."""
        sizes = (self.n_pull, self.statics.n_data, self.n_pull, self.statics.n_data, self.n_numbers)
        names = ("pull", "data", "pull_rate", "data_rate", "numbers")
        return [ca.SX.sym(name, size, columns) for name, size in zip(names, sizes, strict=True)]

    def numbers(self, numbers: ca.SX) -> dict[str, ca.SX]:
        """Return the numbers of the loads at a cross-section by the names of LoadForm.rows."""
        found, start = {}, 0
        for name, size in self.form.rows.items():
            found[name] = numbers[start : start + size]
            start += size
        return found

    def path(self, j: int, paths: ca.SX) -> tuple[ca.SX, ca.SX, ca.SX]:
        """Return a tendon's offset y [m] and its derivatives y', y'' [1, 1/m], of all sections'."""
        i, n = self.section[j], self.form.n_sections
        return paths[i], paths[n + i], paths[2 * n + i]

    def pulled(self, pull: ca.SX, tensions: ca.SX) -> ca.SX:
        """Return the pull that the statics take, of tensions that vary along the arm or not."""
        return ca.reshape(pull, -1, self.n_tension) @ tensions if self.n_tension else pull

    def force(self, x: ca.SX, numbers: ca.SX) -> ca.SX:
        """Return the force of the loads beyond a section in local components (3,) [N]."""
        if not self.form.force:
            return ca.SX.zeros(3)
        pose, _, moving, _ = self.split(x)
        total = self.numbers(numbers)["force"]
        return to_local(pose, total + moving if self.n_force else total)

    def wrench(self, moment: ca.SX, force: ca.SX) -> ca.SX:
        """Return a local moment, then those components of the force that work on the strains."""
        return ca.vertcat(moment, *(force[i] for i in self.statics.forces))

    def twist(self, x: ca.SX, pull: ca.SX, data: ca.SX, numbers: ca.SX) -> tuple[ca.SX, ca.SX]:
        """Return kappa and nu (3,) of a state."""
        _, strain, _, tensions = self.split(x)
        force = self.force(x, numbers)
        return self.statics.twist(strain, self.pulled(pull, tensions), data, force)


def to_local(pose: ca.SX, v: ca.SX) -> ca.SX:
    """Return the local components of a vector (3,) of the base frame."""
    return rotate(conjugate(pose[:4]), v)
