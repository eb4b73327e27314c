"""V_h x Lambda_H on one mesh and one partition: the coupling B, and the dual operator D = B A_3^{-1} B^T.

D, and S = H^{-1/2} D H^{-1/2}, are matrices on the cells here; in `bounds` D and S are numbers. B v has the
integrals of v over the cells; in `bounds` B is a number, too.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.sparse as sp
from scipy.linalg import eigvalsh, solve_triangular

from unilateral.arrays import Array, Index
from unilateral.fem.condense import CondensedMatrix
from unilateral.fem.p1 import coupling, energy_norm
from unilateral.formulas.taylor import EPS
from unilateral.geometry.mesh import Mesh
from unilateral.geometry.partition import Partition

SINGULAR_EIGENVALUE_RATIO = 1e-12
"""beta counts as 0 if lambda_min / lambda_max of S is at most this."""
FORM_ROUNDING = 1e-6
"""At most this fraction of a quadratic form of A_3 or S is rounding: 100 times MAX_CONSTANT_ERROR."""
STEKLOV_SHARE = 0.5
"""sigma_1 is known from above, by its Ritz value; this fraction of it is taken where beta is not known."""


@dataclass(frozen=True, eq=False)
class DualOperator:
    """D = D_factor^T D_factor (m, m) of a mesh and a partition, the cells' lengths H_i (m,), and w in V_h.

    mu . D mu is the squared discrete norm ||mu||_{-1/2,h} = sup over V_h of <mu, v> / ||v||; column i of
    `D_factor` (nb, m) is the boundary response to a unit load on cell i, measured in (A_3)^{1/2}. w is 1 at
    all nodes that are not clamped. `shift_norm` is ||w||, and `shift_means` (m,) are its means on the cells.
    """

    D_factor: Array
    H_i: Array
    shift_norm: float
    shift_means: Array | float = 1.0

    @cached_property
    def D(self) -> Array:
        """The symmetric and semidefinite matrix D = B A_3^{-1} B^T on the cells."""
        return self.D_factor.T @ self.D_factor

    @cached_property
    def S(self) -> Array:
        """The matrix D on the unknowns H_i^{1/2} mu_i, whose Euclidean norm is ||mu||_0; shape (m, m)."""
        scaling = np.sqrt(self.H_i)
        return self.D / scaling[:, None] / scaling

    @cached_property
    def spectrum(self) -> Array:
        """The eigenvalues of S, ascending; shape (m,)."""
        return eigvalsh(self.S)

    @property
    def lambda_min(self) -> float:
        """The smallest eigenvalue of S."""
        return float(self.spectrum[0])

    @property
    def lambda_max(self) -> float:
        """The largest eigenvalue of S."""
        return float(self.spectrum[-1])

    @property
    def lambda_min_lower(self) -> float:
        """A lower bound on lambda_min: forming S and its spectrum rounds each by some EPS tr(S)."""
        rounding = EPS * sum(self.D_factor.shape) * float(self.spectrum.sum())
        return (1 - FORM_ROUNDING) * self.lambda_min - rounding

    @property
    def is_singular(self) -> bool:
        """Whether S, and with it beta, is zero on some mu, to rounding."""
        return len(self.H_i) > 0 and self.lambda_min <= SINGULAR_EIGENVALUE_RATIO * self.lambda_max

    def gap(self, mu: Array, offset: Array) -> Array:
        """F (m,): the cell means of u(mu) - g, the offset being F(0); one application of D."""
        return self.D @ mu / self.H_i + offset

    def required_shift(self, gap: Array) -> float:
        """The least t >= 0 with which no mean of u + t w - g is below 0, those of u - g being the gap (m,).

        It is infinite where such a mean cannot be raised, as all nodes of its cell are clamped.
        """
        # t times the mean of w has to make up for the mean of u - g, where that is below 0. On a cell whose
        # nodes are all clamped the mean of w is 0, and t is infinite; 0 / 0, where u = g, is left out
        with np.errstate(divide="ignore", invalid="ignore"):
            return float(np.fmax.reduce(-gap / self.shift_means, initial=0.0))


@dataclass(frozen=True, eq=False)
class MixedSpaces:
    """A condensed mesh and a partition, coupled by B (m, nb).

    B and the dual operator belong to the m `cells` of the partition, those that have a multiplier. At nodes
    that are clamped B is 0.
    """

    condensed: CondensedMatrix
    partition: Partition
    cells: Index
    B: sp.csr_array
    operator: DualOperator

    @property
    def mesh(self) -> Mesh:
        """The mesh of V_h."""
        return self.condensed.mesh

    @cached_property
    def beta(self) -> float:
        """A number in place of beta of (3.4), without a Gram matrix: (sigma_1 lambda_min / 2)^{1/2}."""
        if not len(self.cells):
            return 1.0
        # ||mu||_{-1/2,h}^2 >= lambda_min ||mu||_0^2, and ||mu||_{-1/2}^2 <= ||mu||_0^2 / sigma_1
        return math.sqrt(STEKLOV_SHARE * self.condensed.sigma_1 * max(self.operator.lambda_min, 0.0))

    def extend_by_zero(self, lambda_H: Array) -> Array:
        """lambda_H (m,) as a function on all cells, 0 on free sides."""
        extended = np.zeros(self.partition.n_cells)
        extended[self.cells] = lambda_H
        return extended

    def response(self, load: Array, mu: Array) -> Array:
        """u(mu) (n,) of (5.1), for the values (f, phi_i) (n,) and mu (m,), or (n, k) of k at once."""
        total = load.copy()
        total[self.mesh.boundary] += self.B.T @ mu
        return self.condensed.solve(total)


def mixed_spaces(condensed: CondensedMatrix, partition: Partition) -> MixedSpaces:
    """The spaces on a mesh and a partition, with multipliers where the form has them.

    Raises InputError if the partition belongs to another polygon than the mesh.
    """
    cells = np.flatnonzero(condensed.form.has_multiplier(partition.side))
    B = coupling(condensed.mesh, partition)[cells]
    B.data[condensed.clamped_nodes[condensed.mesh.boundary[B.indices]]] = 0.0
    operator = dual_operator(condensed, B, H_i=partition.lengths[cells])
    return MixedSpaces(condensed, partition, cells=cells, B=B, operator=operator)


def dual_operator(condensed: CondensedMatrix, B: sp.csr_array, H_i: Array) -> DualOperator:
    """The dual operator for B (m, nb) of `coupling`, or of some cells, whose lengths are H_i (m,).

    Columns of B at clamped nodes count as 0, for functions of V_h vanish there.
    """
    loads = B.T.toarray()
    loads[condensed.clamped_nodes[condensed.mesh.boundary]] = 0.0
    # D = B A_3^{-1} B^T = D_factor^T D_factor with D_factor = R^{-T} B^T, as A_3 = R^T R
    D_factor = solve_triangular(condensed.cholesky, loads, trans="T", check_finite=False)
    # w is 1 at all nodes that are not clamped; the integral of w over cell i is the sum of B[i]
    shift_norm = energy_norm(condensed.mesh, np.where(condensed.clamped_nodes, 0.0, 1.0), condensed.form)
    return DualOperator(D_factor, H_i, shift_norm=shift_norm, shift_means=loads.sum(axis=0) / H_i)
