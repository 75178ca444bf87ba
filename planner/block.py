"""Interface of a program block: unknowns and rows in addition to tensions and equilibrium.

A block adds to the program (octoplan.planner.program) any of

    decisions      unknowns without equations: slacks, the largest tension
    dependents     unknowns with as many equations, which are placed kernels: responses, a mode
    measurements   quantities of the arm, taken from the unknowns on the mesh of the program; the
                   program adds the defect of the mesh (octoplan.planner.solve.refine)
    rows           expressions of all unknowns and measurements, between bounds
    misses         expressions whose squares the modes closest and nearest minimise
    objectives     expressions whose sum, plus the weight times the effort, is the cost

A new constraint is a subclass of Block. `Strategy.constraints` (octoplan.planner.plan) returns
the Constraints that add its blocks to all programs of a search. A strategy has an entry in
octoplan.planner.entry_points, and the first effect or target with a `plan_strategy` selects the
strategy of a plan: strategies do not combine. The solution keeps the constraints in `avoidance`, so
that the plan states the same program again. A target needs no block:
octoplan.planner.targets.target_set states the rows of all targets. Joints that move the base are a
`Placement` of the planning problem, whose blocks are part of every program of the problem.

A block is a frozen dataclass. The compared fields are the structure: two equal blocks add the same
expressions to a program. Fields with `compare=False` are numbers, which a program never reads.

Rows keep their bounds. An equation with a bounded unknown for each inequality would be the same
program: ipopt itself adds a slack to each inequality, with the same linear system. However, the
defect is added to rows, not to bounds of unknowns, and expressions of targets have no kernels.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple, Protocol

import casadi as ca
import numpy as np

from octoplan.model.arm import Arm
from octoplan.model.equilibrium.linearised import Equilibrium
from octoplan.model.paths import Array
from octoplan.model.rod.discrete_rod import DiscreteRod
from octoplan.model.rod.equations import ParameterValues, PlacedKernel
from octoplan.model.rod.kernels import Places
from octoplan.model.shape import Shape

if TYPE_CHECKING:
    from octoplan.planner.certificate import Check
    from octoplan.planner.planning_problem import PlanningProblem

# Smallest multiplier of an active limit [-].
ACTIVE = 1e-9


class Rows(NamedTuple):
    """Rows of one kind: lower <= value (n,) <= upper.

    Bounds and multipliers are found by the kind, so that each block has kinds of its own.
    """

    kind: str
    value: ca.MX
    lower: float = 0.0
    upper: float = np.inf


class Parts(NamedTuple):
    """Columns of expressions that a block adds to rows and objective.

    `effort` replaces the norm of the tensions unless None.
    """

    rows: Sequence[Rows] = ()
    misses: Sequence[ca.MX] = ()
    objectives: Sequence[ca.MX] = ()
    effort: ca.MX | None = None


class ProgramView(NamedTuple):
    """Symbols of a program that blocks use.

    Attributes
    ----------
    T : (n_tendons,)
        Tensions over `T_ref`.
    T_ref : scalar
        Reference tension [N].
    poses : dict of (7,)
        Pose at each station, by its arc length [m]; the defect is added.
    compliances : (n,)
        Compliances from all blocks, matrix by matrix and column by column [m/N]; with defect.
    decisions, measured, parameters : (n,)
        Decisions, measurements and parameters of the block; the defect is added to `measured`.
    effort : scalar
        The effort with the changes of all blocks before.
    """

    T: ca.MX
    T_ref: ca.MX
    poses: Mapping[float, ca.MX]
    compliances: ca.MX
    decisions: ca.MX
    measured: ca.MX
    parameters: ca.MX
    effort: ca.MX


class Block:
    """Additional unknowns and rows of a program; every default adds nothing.

    Attributes
    ----------
    is_linear : bool
        Whether the equations of the dependents are linear in the dependents.
    mesh_reduces_defect : bool
        Whether a finer mesh of the program reduces the defect of the measurements. The stability of
        a settled shape is evaluated on the mesh of this shape, so that its defect remains.
    """

    is_linear: ClassVar[bool] = True
    mesh_reduces_defect: ClassVar[bool] = True

    @property
    def n_decisions(self) -> int:
        """The number of decisions."""
        return 0

    @property
    def n_dependents(self) -> int:
        """The number of dependents."""
        return 0

    @property
    def n_measured(self) -> int:
        """The number of measurements."""
        return 0

    @property
    def n_parameters(self) -> int:
        """The number of parameters of the rows."""
        return 0

    # Symbols: only compared fields are used.

    def stations(self) -> tuple[float, ...]:
        """Return the arc lengths whose poses the rows use [m]."""
        return ()

    @property
    def n_controls(self) -> int:
        """The number of decisions that help to meet targets, as tensions do."""
        return 0

    def equations(self, rod: Places, unknown: int, row: int) -> list[PlacedKernel]:
        """Return the equations of the dependents, as placed kernels.

        Parameters
        ----------
        rod : (n_x,)
            Places of the rod's tensions, load factor and states among all unknowns.
        unknown, row : int
            Place of the first dependent and of the first equation.
        """
        return []

    def shares(self, decision: int) -> list[PlacedKernel]:
        """Return shares of the decisions in the equations of the rod, as placed kernels.

        `decision` is the place of the first decision. An equation of the rod has the index of the
        state that it determines, see octoplan.model.rod.layout.
        """
        return []

    def measure(self, states: ca.MX, dependents: ca.MX, parameters: ca.MX) -> ca.MX:
        """Return the measurements (n_measured,), from unknowns in SI units."""
        return ca.MX(0, 1)

    def compliances(self, measured: ca.MX) -> ca.MX:
        """Return the measurements that are compliances for targets (n,) [m/N], with defect."""
        return ca.MX(0, 1)

    def parts(self, view: ProgramView) -> Parts:
        """Return rows, misses, objectives and effort."""
        return Parts()

    # Numbers.

    def parameters(self) -> Array:
        """Return the parameters of the rows (n_parameters,)."""
        return np.zeros(0)

    def bounds(self) -> Mapping[str, tuple[Array | float, Array | float]]:
        """Return lower and upper bounds by kind of row, if the block has such numbers."""
        return {}

    def active_limits(
        self, arm: Arm, multipliers: Callable[[str], Array]
    ) -> list[tuple[float, str]]:
        """Return priority and name of each active limit, for the outcome of a plan.

        `multipliers` returns the multipliers of the rows of a kind.
        """
        return []

    def kernel_parameters(self, rod: DiscreteRod) -> list[Array]:
        """Return the parameters (n_c, N) of each placed kernel, in the order of `equations`."""
        return []

    def share_parameters(self, rod: DiscreteRod) -> list[Array]:
        """Return the parameters (n_c, N) of each placed kernel, in the order of `shares`."""
        return []

    def kernel_updates(self, rod: DiscreteRod, dependents: Array) -> ParameterValues:
        """Return parameters by kernel and name that follow the iterate at which a solve starts.

        `dependents` (n_dependents,) are in SI units.
        """
        return {}

    def scales(self, rod: DiscreteRod) -> tuple[Array, Array]:
        """Return the scales of dependents and equations (n_dependents,)."""
        return np.ones(self.n_dependents), np.ones(self.n_dependents)

    def slack_rows(self) -> tuple[str, list[int]]:
        """Return kind and numbers of the rows whose slacks are the decisions, if any.

        The initial value of a slack is the violation of the row.
        """
        return "", []

    def initial_decisions(self, T: Array, states: Array) -> Array:
        """Return initial values of the decisions.

        For tensions (n_tendons,) over T_ref and states (n_states,) of the rod in SI units.
        """
        return np.zeros(self.n_decisions)

    def base_joints(self, decisions: Array) -> tuple[float, ...]:
        """Return the values of the base joints for decisions; empty for other blocks."""
        return ()

    def initial_dependents(self, equilibrium: Equilibrium) -> Array:
        """Return initial values of the dependents in SI units, unless the equations are linear.

        The problem solves linear equations.
        """
        raise NotImplementedError

    def measure_shape(self, shape: Shape, on_mesh: Array) -> Array:
        """Return the measurements (n_measured,) of a settled shape, from the values on the mesh."""
        return on_mesh

    def measurement_scales(self, arm: Arm) -> Array:
        """Return the change of each measurement that counts as 1 (n_measured,)."""
        return np.ones(self.n_measured)


class Constraints(Protocol):
    """Constraints of an extension, such as clearance, that the search adds to a program."""

    def blocks(self, arm: Arm) -> tuple[Block, ...]:
        """Return the blocks of the constraints."""


class Placement(Protocol):
    """Joints that move the base of an arm: unknowns of every program of a planning problem.

    The arm of the problem has its base at the joint values `values`; see
    octoplan.planner.extensions.base_joints.
    """

    @property
    def home(self) -> Arm:
        """The arm at joint values 0, to which targets refer."""

    @property
    def arm(self) -> Arm:
        """The arm at the joint values."""

    @property
    def joints(self) -> Any:
        """The limits of the joints, as passed to `plan`."""

    @property
    def values(self) -> tuple[float, ...]:
        """The joint values: insertion [m] and rotation [rad]."""

    @property
    def position(self) -> Any:
        """The joint values by name."""

    def at(self, values: tuple[float, ...]) -> Placement:
        """Return the placement at other joint values; at 0 for no values."""

    def blocks(self, norm: str) -> tuple[Block, ...]:
        """Return the blocks of the joints, for the norm of the tensions that is minimised."""

    def guesses(self, problem: PlanningProblem, missed: bool) -> Iterator[Array]:
        """Yield initial tensions and joint values (n_tendons + n_joints,)."""

    def checks(self) -> Mapping[str, Check]:
        """Return the checks of the joint values for a certificate."""

    def remark(self) -> str:
        """Return a sentence about the joint values."""
