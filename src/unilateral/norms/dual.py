"""||mu||_{-1/2} between bounds, up to rounding: a supremum over P2 below, an energy over BDM1 above.

For every v in H^1 and every flux q with q.n = mu on the boundary,

    <mu, v> / ||v||_1 <= ||mu||_{-1/2} <= (||q||^2 + ||div q||^2)^{1/2},

with equality for q = grad v and v as in (3.5). The spaces are those of `reference`. A flux of BDM1 carries
Pi_1 mu, the part of mu that is linear on the edges of the reference mesh; a bound on what is left,
`oscillation`, is added; where lambda is not in L2 that and the upper bound are NaN. All of it holds
up to rounding, which is not added: 1e-9 of the norm for polygons of a diameter of about 1, like 1/L^2
for smaller ones of diameter L; where it reaches 1e-8 the polygon is refused. Where lambda has a fractional
power the upper bound on lambda - Pi_H lambda is a difference of large numbers: up to 2e-6 of it is rounding
where lambda is like s^(-1/4).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import scipy.sparse as sp

from unilateral.arrays import Array, Index
from unilateral.fem.form import H1, Form
from unilateral.formulas.decimals import format_interval
from unilateral.geometry.mesh import Mesh
from unilateral.geometry.partition import Partition
from unilateral.norms.exact_errors import cell_means
from unilateral.norms.functionals import (
    Functionals,
    cellwise_functionals,
    difference_functionals,
    indicator_functionals,
)
from unilateral.norms.grading import EDGES_PER_CELL
from unilateral.norms.ritz import h1_distance
from unilateral.system.optional import require

if TYPE_CHECKING:
    import xarray as xr

    from unilateral.norms.reference import ReferenceSpaces
    from unilateral.problems.case import ExactSolution

GRAM_VARIABLES = ("points", "lambda_means", "norm_lower", "norm_upper", "oscillation")


class Bracket(NamedTuple):
    """Lower and upper bounds, up to rounding, of equal shapes."""

    lower: Array
    upper: Array


@dataclass(frozen=True, eq=False)
class Gram:
    """Matrices (m + c, m + c) of forms that bound ||.||_{-1/2}^2, and the `oscillation` (c,) of each case.

    The first m columns belong to the cells between `points` (m + 1,), the others to lambda - Pi_H lambda of
    c cases, whose cell means are `means` (c, m).
    """

    points: Array
    means: Array
    lower: Array
    upper: Array
    oscillation: Array

    @classmethod
    def from_table(cls, table: xr.Dataset) -> Gram:
        """The `Gram` from the table that `table` makes."""
        return cls(*(table[name].values for name in GRAM_VARIABLES))

    def table(self, cases: Sequence[ExactSolution]) -> xr.Dataset:
        """The forms, the ends of their cells and what belongs to the cases, with the names of all."""
        import xarray as xr

        form = ("functional", "functional_too")
        dimensions = (("point",), ("case", "cell"), form, form, ("case",))
        values = (self.points, self.means, self.lower, self.upper, self.oscillation)
        variables = dict(zip(GRAM_VARIABLES, zip(dimensions, values, strict=True), strict=True))
        polygon = xr.DataArray(cases[0].polygon.name)
        return xr.Dataset(variables, coords={"case": [case.name for case in cases]}).assign(polygon=polygon)

    @property
    def n_cells(self) -> int:
        """The number of cells."""
        return len(self.points) - 1

    def coarsen(self, partition: Partition) -> Gram:
        """The forms on P0 of a coarser partition and on lambda - Pi_H lambda there.

        P0 of the coarser one is a subspace, so nothing is lost. Raises InputError if it is none.
        """
        cell = partition.cells_of(self.points)
        m = partition.n_cells
        c = len(self.means)
        # Pi_H lambda of the coarser partition: means of means, weighted with the lengths
        shares = np.diff(self.points) / partition.lengths[cell]
        to_means = sp.csr_array((shares, (cell, np.arange(len(cell)))), shape=(m, len(cell)))
        prolong = sp.csr_array((np.ones(len(cell)), (np.arange(len(cell)), cell)), shape=(len(cell), m))
        means = self.means @ to_means.T
        # lambda - Pi_H lambda = (lambda - Pi_h lambda) + (Pi_h lambda - Pi_H lambda), h for the finer one
        to_finer = sp.block_array(
            [[prolong, sp.csr_array(self.means - means[:, cell]).T], [None, sp.eye_array(c)]], format="csr"
        )
        lower = to_finer.T @ (self.lower @ to_finer)
        upper = to_finer.T @ (self.upper @ to_finer)
        return Gram(partition.points, means, lower, upper, self.oscillation)

    @property
    def cells(self) -> Index:
        """The cells that are not on clamped sides, where functionals are 0, (k,)."""
        return np.flatnonzero(np.diag(self.lower)[: self.n_cells])

    @property
    def p0(self) -> Bracket:
        """The Gram matrices of P0 of the cells, the true one between them as quadratic forms, (k, k)."""
        chosen = np.ix_(self.cells, self.cells)
        return Bracket(self.lower[chosen], self.upper[chosen])

    def error_bounds(self, case: int, difference: Array) -> Bracket:
        """Bounds (k,) on ||lambda - mu_H||_{-1/2} of case c from Pi_H lambda - mu_H (k, m)."""
        # lambda - mu_H = (lambda - Pi_H lambda) + (Pi_H lambda - mu_H)
        x = np.zeros((len(difference), len(self.lower)))
        x[:, : self.n_cells] = difference
        x[:, self.n_cells + case] = 1.0
        lower = np.sum((x @ self.lower) * x, axis=1)
        upper = np.sum((x @ self.upper) * x, axis=1)
        return Bracket(_nonnegative_root(lower), _nonnegative_root(upper) + self.oscillation[case])

    @cached_property
    def best_approximations(self) -> Array:
        """Lower bounds on the distance of each case's lambda from P0(T_H) in ||.||_{-1/2}, (c,)."""
        # the least of the form over P0(T_H): c - b^T A^{-1} b, the Schur complement
        m = self.n_cells
        mixed = self.lower[self.cells, m:]
        squares = np.diag(self.lower)[m:]
        return _nonnegative_root(squares - np.sum(mixed * np.linalg.solve(self.p0.lower, mixed), axis=0))


@dataclass(frozen=True, eq=False)
class DualNorm:
    """||.||_{-1/2} on the boundary of a polygon, by reference spaces made for the partition T_H."""

    partition: Partition
    spaces: ReferenceSpaces

    def bound_p0(self, mu_H: Array, partition: Partition | None = None) -> Bracket:
        """Bounds (k,) on ||mu_H||_{-1/2} for functions mu_H (k, m) constant on the cells of T_H.

        Another partition may be given; its points need not be nodes of the reference mesh.
        """
        return self._bracket(cellwise_functionals(self.spaces, partition or self.partition, mu_H))

    def bound_error(self, case: ExactSolution, mu_H: Array, partition: Partition | None = None) -> Bracket:
        """Bounds (k,) on ||lambda - mu_H||_{-1/2} for functions mu_H (k, m) constant on the cells.

        mu_H may also be linear on the cells, with the values (k, m, 2) at their ends.
        """
        return self._bracket(difference_functionals(self.spaces, partition or self.partition, case, mu_H))

    def gram(self, cases: Sequence[ExactSolution] = ()) -> Gram:
        """The bounds' quadratic forms on P0(T_H) and on lambda - Pi_H lambda of the cases."""
        means = [cell_means(case, self.partition).lambda_means for case in cases]
        case_functionals = [
            difference_functionals(self.spaces, self.partition, case, mean[None])
            for case, mean in zip(cases, means, strict=True)
        ]
        functionals = [indicator_functionals(self.spaces, self.partition), *case_functionals]
        loads = sp.hstack([item.loads for item in functionals], format="csc")
        fluxes = sp.hstack([item.fluxes for item in functionals], format="csc")
        return Gram(
            self.partition.points,
            np.array(means).reshape(len(means), self.partition.n_cells),
            self.spaces.suprema(loads),
            self.spaces.least_fluxes(fluxes),
            np.concatenate([item.oscillation for item in case_functionals] or [np.empty(0)]),
        )

    def _bracket(self, mu: Functionals) -> Bracket:
        lower = np.diag(self.spaces.suprema(mu.loads))
        upper = np.diag(self.spaces.least_fluxes(mu.fluxes))
        return Bracket(_nonnegative_root(lower), _nonnegative_root(upper) + mu.oscillation)


def build_dual_norm(
    partition: Partition,
    cases: Sequence[ExactSolution] = (),
    edges_per_cell: int = EDGES_PER_CELL,
    form: Form | None = None,
) -> DualNorm:
    """The norm by reference spaces made for T_H, re-entrant vertices and the cases' singular points.

    It is dual to the norm of a form, by default the form of the cases, which all clamp the same sides.
    """
    require("errors in H^(-1/2) and the constant beta need", "gmsh")
    from unilateral.norms.reference import build_reference_spaces  # for true errors only

    polygon = partition.polygon
    singular = [polygon.arc_length(p.side, p.t) for case in cases for p in case.flux_singular_points()]
    # at re-entrant vertices functions of least norm are singular, whatever the cases are
    singular += polygon.starts[:-1][polygon.angles > math.pi * (1 + 1e-9)].tolist()
    norm_form = form or (Form(c=cases[0].c, clamped=cases[0].clamped_sides) if cases else H1)
    spaces = build_reference_spaces(partition, singular, edges_per_cell, norm_form)
    return DualNorm(partition, spaces)


class Errors(NamedTuple):
    """||u - u_h||_1, bounds on ||lambda - lambda_H||_{-1/2}, ||lambda - lambda_H||_0; NaN where not judged.

    lambda is not judged where beta is 0; its L2 error is NaN where lambda is not in L2.
    """

    h1: float
    hm12_lower: float
    hm12_upper: float
    l2: float

    def __repr__(self) -> str:
        """Bounds are rounded so that they stay bounds.

        >>> Errors(0.123456, 0.111111, 0.222222, 0.3)
        Errors: ||u - u_h||_1 = 0.1235, ||lambda - lambda_H||_-1/2 between 0.1111 and 0.2223, in L2 0.3
        """
        dual = f"||lambda - lambda_H||_-1/2 {format_interval(self.hm12_lower, self.hm12_upper)}"
        return f"Errors: ||u - u_h||_1 = {self.h1:.4g}, {dual}, in L2 {self.l2:.4g}"


class ErrorsWithoutReaction(Errors):
    """Errors where c = 0, of cases, which have k = 1: that of u is in the norm |v|_1."""

    def __repr__(self) -> str:
        return super().__repr__().replace("||u - u_h||_1", "|u - u_h|_1")


def true_errors(
    case: ExactSolution,
    mesh: Mesh,
    u_h: Array,
    partition: Partition,
    lambda_H: Array,
    unique: bool,
    judge_dual: bool,
) -> Errors:
    """The errors of u_h (n,) and lambda_H (m,), which is constant on the cells.

    The error in H^{-1/2} is judged only if `judge_dual`, and errors of lambda only if lambda_H is `unique`.
    """
    h1 = h1_distance(case, mesh, u_h)
    l2 = math.nan
    lower = upper = math.nan
    if unique:
        l2 = cell_means(case, partition).l2_error(lambda_H)
    if unique and judge_dual:
        bounds = build_dual_norm(partition, [case]).bound_error(case, lambda_H[None])
        lower = float(bounds.lower[0])
        upper = float(bounds.upper[0])
    errors = Errors if case.c else ErrorsWithoutReaction
    return errors(h1=h1, hm12_lower=lower, hm12_upper=upper, l2=l2)


def _nonnegative_root(squares: Array) -> Array:
    return np.sqrt(np.maximum(squares, 0.0))
