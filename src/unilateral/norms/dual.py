"""||mu||_{-1/2} between guaranteed bounds: a supremum over P2 below, an energy over BDM1 above.

For every v in H^1 and every flux q with q.n = mu on the boundary,

    <mu, v> / ||v||_1 <= ||mu||_{-1/2} <= (||q||^2 + ||div q||^2)^{1/2},

with equality for q = grad v and v as in (3.5). The spaces are those of `reference`. A flux of BDM1 carries
Pi_1 mu, the part of mu that is linear on the edges of the reference mesh; a bound of what is left,
`oscillation`, is added; where lambda is not in L2 that is infinite and the upper bound NaN. All of it is
guaranteed up to rounding: 1e-9 of the norm for polygons of a diameter of about 1, like 1/L^2 for smaller
ones of diameter L; where it reaches 1e-8 the polygon is refused.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import scipy.sparse as sp
import xarray as xr

from unilateral.arrays import Array, Index
from unilateral.fem.quadrature import BoundaryRule, boundary_rule
from unilateral.geometry.partition import Partition, overlay
from unilateral.norms.exact import cell_means
from unilateral.norms.oscillation import oscillation_bound
from unilateral.norms.reference import EDGES_PER_CELL, ReferenceSpaces, reference_spaces
from unilateral.problems.case import Case

TABLE = ("points", "lambda_means", "norm_lower", "norm_upper", "oscillation")


class Bounds(NamedTuple):
    """Guaranteed lower and upper bounds, of equal shapes."""

    lower: Array
    upper: Array


class Functionals(NamedTuple):
    """What the reference spaces see of k functions mu on the boundary.

    `loads` (n_p2, k) are <mu, psi_i>; `fluxes` (2 nb, k) are Pi_1 mu at the ends of the boundary edges;
    `oscillation` (k,) bounds ||mu - Pi_1 mu||_{-1/2}.
    """

    loads: sp.csc_array
    fluxes: sp.csc_array
    oscillation: Array


@dataclass(frozen=True, eq=False)
class Gram:
    """Matrices (m + c, m + c) of the forms that bound ||.||_{-1/2}^2, and what oscillates of each case (c,).

    The first m columns belong to the cells between `points` (m + 1,), the others to lambda - Pi_H lambda of
    c cases, whose cell means are `means` (c, m).
    """

    points: Array
    means: Array
    lower: Array
    upper: Array
    oscillation: Array

    @classmethod
    def of_table(cls, table: xr.Dataset) -> Gram:
        """From the table that `table` makes."""
        return cls(*(table[name].values for name in TABLE))

    def table(self, cases: Sequence[Case]) -> xr.Dataset:
        """The forms, the ends of their cells and what belongs to the cases, with the names of all."""
        form = ("functional", "functional_too")
        dimensions = (("point",), ("case", "cell"), form, form, ("case",))
        values = (self.points, self.means, self.lower, self.upper, self.oscillation)
        variables = dict(zip(TABLE, zip(dimensions, values, strict=True), strict=True))
        polygon = xr.DataArray(cases[0].polygon.name)
        return xr.Dataset(variables, coords={"case": [case.name for case in cases]}).assign(polygon=polygon)

    @property
    def n_cells(self) -> int:
        return len(self.points) - 1

    def on(self, partition: Partition) -> Gram:
        """The same forms on P0 of a coarser partition and on lambda - Pi_H lambda there.

        P0 of the coarser one is a subspace, so nothing is lost. Raises InputError if it is none.
        """
        cell = partition.cells_of(self.points)
        m, c = partition.n_cells, len(self.means)
        shares = np.diff(self.points) / partition.lengths[cell]
        to_means = sp.csr_array((shares, (cell, np.arange(len(cell)))), shape=(m, len(cell)))
        prolong = sp.csr_array((np.ones(len(cell)), (np.arange(len(cell)), cell)), shape=(len(cell), m))
        means = self.means @ to_means.T
        to_finer = sp.block_array(
            [[prolong, sp.csr_array(self.means - means[:, cell]).T], [None, sp.eye_array(c)]], format="csr"
        )
        lower, upper = (to_finer.T @ (form @ to_finer) for form in (self.lower, self.upper))
        return Gram(partition.points, means, lower, upper, self.oscillation)

    @property
    def p0(self) -> Bounds:
        """(m, m) each: Gram matrices of P0(T_H), the true one between them as quadratic forms."""
        m = self.n_cells
        return Bounds(self.lower[:m, :m], self.upper[:m, :m])

    def error(self, c: int, difference: Array) -> Bounds:
        """Bounds (k,) of ||lambda - mu_H||_{-1/2} of case c from Pi_H lambda - mu_H (k, m)."""
        x = np.zeros((len(difference), len(self.lower)))
        x[:, : self.n_cells] = difference
        x[:, self.n_cells + c] = 1.0
        lower, upper = (np.einsum("ki,ij,kj->k", x, form, x) for form in (self.lower, self.upper))
        return Bounds(_root(lower), _root(upper) + self.oscillation[c])

    def best_approximation(self, c: int) -> float:
        """A lower bound of the distance of lambda of case c from P0(T_H) in ||.||_{-1/2}."""
        m = self.n_cells
        mixed = self.lower[:m, m + c]
        square = self.lower[m + c, m + c] - mixed @ np.linalg.solve(self.p0.lower, mixed)
        return math.sqrt(max(float(square), 0.0))


@dataclass(frozen=True, eq=False)
class DualNorm:
    """||.||_{-1/2} on the boundary of a polygon, by reference spaces made for the partition T_H."""

    partition: Partition
    spaces: ReferenceSpaces

    def of_p0(self, mu_H: Array, partition: Partition | None = None) -> Bounds:
        """Bounds (k,) of ||mu_H||_{-1/2} for functions mu_H (k, m) constant on the cells of T_H.

        Another partition may be given; its points need not be nodes of the reference mesh.
        """
        cells = partition or self.partition
        rule, cell = self._rule(cells, None)
        return self._bounds(self._functionals(rule, mu_H.T[cell]))

    def of_error(self, case: Case, mu_H: Array, partition: Partition | None = None) -> Bounds:
        """Bounds (k,) of ||lambda - mu_H||_{-1/2} for functions mu_H (k, m) constant on the cells."""
        return self._bounds(self._differences(case, mu_H, partition or self.partition))

    def gram(self, cases: Sequence[Case] = ()) -> Gram:
        """The bounds' quadratic forms on P0(T_H) and on lambda - Pi_H lambda of the cases."""
        means = [cell_means(case, self.partition).lambda_means for case in cases]
        pairs = zip(cases, means, strict=True)
        of_cases = [self._differences(case, mean[None], self.partition) for case, mean in pairs]
        parts = [self._indicators(), *of_cases]
        loads = sp.hstack([part.loads for part in parts], format="csc")
        fluxes = sp.hstack([part.fluxes for part in parts], format="csc")
        return Gram(
            self.partition.points,
            np.array(means).reshape(len(means), self.partition.n_cells),
            self.spaces.suprema(loads),
            self.spaces.least_fluxes(fluxes),
            np.concatenate([part.oscillation for part in of_cases] or [np.empty(0)]),
        )

    def _bounds(self, mu: Functionals) -> Bounds:
        lower = np.diag(self.spaces.suprema(mu.loads))
        upper = np.diag(self.spaces.least_fluxes(mu.fluxes))
        return Bounds(_root(lower), _root(upper) + mu.oscillation)

    def _differences(self, case: Case, mu_H: Array, partition: Partition) -> Functionals:
        """Of lambda - mu_H; what oscillates of a lambda outside L2 has no bound here."""
        rule, cell = self._rule(partition, case)
        flux = case.boundary(rule.side, rule.s, rule.near)[1]
        found = self._functionals(rule, flux[:, None] - mu_H.T[cell])
        return found if case.flux_in_L2 else found._replace(oscillation=np.full(len(mu_H), math.nan))

    def _rule(self, partition: Partition, case: Case | None) -> tuple[BoundaryRule, Index]:
        """Quadrature whose intervals are the reference mesh's edges, and the cell (Q,) of every point."""
        cuts, edge, cell = overlay(self.spaces.mesh.s, partition.points)
        rule = boundary_rule(partition.polygon, cuts, case.singular() if case else ())
        return rule._replace(interval=edge[rule.interval]), cell[rule.interval]

    def _functionals(self, rule: BoundaryRule, values: Array) -> Functionals:
        """Of functions with the values (Q, k) at the points of the rule."""
        mesh, edge = self.spaces.mesh, rule.interval
        lengths = np.diff(mesh.s)
        x = (rule.s - (mesh.s[edge] - mesh.polygon.starts[rule.side])) / lengths[edge]
        weighted = rule.weight[:, None] * values

        def moments(shape: Array) -> Array:
            found = np.zeros((len(lengths), values.shape[1]))
            np.add.at(found, edge, shape[:, None] * weighted)
            return found

        start, end = moments(1 - x), moments(x)
        bubble = moments(4 * x * (1 - x))
        loads = np.zeros((self.spaces.n_p2, values.shape[1]))
        shapes = np.stack([start - bubble / 2, end - bubble / 2, bubble], axis=1)
        np.add.at(loads, self.spaces.nodes.ravel(), shapes.reshape(-1, values.shape[1]))
        at_start, at_end = ((4 * a - 2 * b) / lengths[:, None] for a, b in ((start, end), (end, start)))
        rest = values - (1 - x)[:, None] * at_start[edge] - x[:, None] * at_end[edge]
        squares = np.zeros_like(start)
        np.add.at(squares, edge, rule.weight[:, None] * rest**2)
        fluxes = np.stack([at_start, at_end], axis=1).reshape(-1, values.shape[1])
        left_over = oscillation_bound(mesh, self.spaces.triangle, squares)
        return Functionals(sp.csc_array(loads), sp.csc_array(fluxes), left_over)

    def _indicators(self) -> Functionals:
        """Of the cells of T_H, each the union of edges of the reference mesh."""
        s, m = self.spaces.mesh.s, self.partition.n_cells
        lengths = np.diff(s)
        cell = np.searchsorted(self.partition.points, 0.5 * (s[1:] + s[:-1])) - 1
        shares = (lengths[:, None] * np.array([1.0, 1.0, 4.0]) / 6).ravel()
        where = (self.spaces.nodes.ravel(), np.repeat(cell, 3))
        loads = sp.coo_array((shares, where), shape=(self.spaces.n_p2, m)).tocsc()
        ends = (np.arange(2 * len(cell)), np.repeat(cell, 2))
        fluxes = sp.coo_array((np.ones(2 * len(cell)), ends), shape=(2 * len(cell), m)).tocsc()
        return Functionals(loads, fluxes, np.zeros(m))


def dual_norm(
    partition: Partition, cases: Iterable[Case] = (), edges_per_cell: int = EDGES_PER_CELL
) -> DualNorm:
    """The norm by reference spaces made for T_H, re-entrant vertices and the cases' singular points."""
    polygon = partition.polygon
    singular = [polygon.arc_length(p.side, p.t) for case in cases for p in case.flux_singular()]
    singular += polygon.starts[:-1][polygon.angles > math.pi * (1 + 1e-9)].tolist()
    return DualNorm(partition, reference_spaces(partition, singular, edges_per_cell))


def _root(squares: Array) -> Array:
    return np.sqrt(np.maximum(squares, 0.0))
