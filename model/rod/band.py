"""Band storage of the Jacobian of the equilibrium."""

from __future__ import annotations

import numpy as np

from octoplan.model.rod.kernels import Places


class Band:
    """Indices of the nonzeros of the Jacobian, and their places in LAPACK's band storage.

    Attributes
    ----------
    rows, columns : (nnz,)
        Equation and unknown of each nonzero; unknowns are tensions, load factor, states.
    inside : (n,)
        Indices of the nonzeros in the columns of the states.
    below, above : int
        Numbers of diagonals below and above the main diagonal.
    height : int
        Number of rows of the storage, with the rows that pivoting fills.
    states, equations : (n_states,)
        Order of states and equations in the storage. The quaternion of a node, on which its whole
        element depends, is the last of the states of the node, and equations have the order of
        their first states. This order makes the band narrow. The cost of a factorisation is
        proportional to its width times the number of diagonals below the main diagonal.
    stored : (n,)
        Place in the storage of each nonzero in `inside`, column by column.
    """

    def __init__(
        self,
        rows: Places,
        columns: Places,
        n_states: int,
        n_before_states: int,
        nodes: Places,
    ) -> None:
        """Choose the order.

        Parameters
        ----------
        rows, columns : (nnz,)
        n_states, n_before_states : int
        nodes : (N + 1, node_size)
            Places of the unknowns of each node among the states; the quaternion first.
        """
        self.rows = rows
        self.columns = columns
        self.inside = np.flatnonzero(columns >= n_before_states)
        self.states = np.arange(n_states)
        self.states[nodes] = np.roll(nodes, -4, axis=1)
        column = np.argsort(self.states)[columns[self.inside] - n_before_states]
        earliest = np.full(n_states, n_states)
        np.minimum.at(earliest, rows[self.inside], column)
        self.equations = np.argsort(earliest, kind="stable")
        row = np.argsort(self.equations)[rows[self.inside]]
        self.below = int((row - column).max())
        self.above = int((column - row).max())
        self.height = 2 * self.below + self.above + 1
        self.stored = column * self.height + self.below + self.above + row - column
