"""||mu||_{-1/2} measured: a lower bound by a reference solve in P2 on a mesh graded to the boundary.

For every conforming v, <mu, v> / ||v||_1 <= ||mu||_{-1/2}; the v taken here solves
(v, w)_1 = <mu, w> in P2 on a mesh made for T_H alone: its boundary edges are nested in the cells of T_H,
at most an eighth of the longest cell and halved eight times towards each singular point of lambda, and
the triangles grow with the distance from the boundary. The pairing uses mu itself, so the bound is
guaranteed up to round-off.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
import skfem
import xarray as xr
from numpy.typing import NDArray
from scipy.sparse.linalg import SuperLU, splu
from skfem.models.poisson import laplace, mass

from unilateral import mesh as meshes
from unilateral.atoms import Singular
from unilateral.case import Case
from unilateral.condense import elimination_order
from unilateral.mesh import Mesh
from unilateral.partition import Partition
from unilateral.quadrature import boundary_rule

Array = NDArray[np.float64]
EDGES_PER_CELL = 8
HALVINGS = 8
GROWTH = 0.3


@dataclass(frozen=True, eq=False)
class ReferenceSpace:
    """P2 on the reference mesh of a partition, its matrix of (., .)_1 factorised.

    `dofs` (nb, 3) are the unknowns of each boundary edge: its start, its end, its midpoint; `cell` (nb,) the
    cell of T_H it lies in.
    """

    partition: Partition
    mesh: Mesh
    dofs: NDArray[np.intp]
    cell: NDArray[np.intp]
    n_dofs: int
    lu: SuperLU
    order: NDArray[np.intp]

    def error_lower(self, case: Case, lambda_H: Array) -> Array:
        """(k,) lower bounds of ||lambda - lambda_H||_{-1/2} for the multipliers lambda_H (k, m)."""
        return self._norms(self._flux_load(case)[:, None] - self._cell_load(lambda_H))

    def norm_lower(self, mu_H: Array) -> Array:
        """(k,) lower bounds of ||mu_H||_{-1/2} for P0 functions mu_H (k, m) on T_H."""
        return self._norms(self._cell_load(mu_H))

    def _norms(self, loads: Array) -> Array:
        solutions = self.lu.solve(loads[self.order])
        return np.sqrt(np.maximum(np.sum(loads[self.order] * solutions, axis=0), 0.0))

    def _cell_load(self, mu_H: Array) -> Array:
        """(n_dofs, k): <mu_H, psi_i>, by Simpson's weights on every boundary edge."""
        per_edge = (np.diff(self.mesh.s)[:, None] * mu_H.T[self.cell])[:, None] / 6
        return self._scatter(per_edge * np.array([1.0, 1.0, 4.0])[:, None])

    def _flux_load(self, case: Case) -> Array:
        """(n_dofs,): <lambda, psi_i>, to round-off."""
        rule = boundary_rule(case, self.mesh.s)
        _, flux, _ = case.boundary(rule.side, rule.s)
        start = self.mesh.s[rule.interval] - self.mesh.polygon.starts[rule.side]
        x = (rule.s - start) / np.diff(self.mesh.s)[rule.interval]
        shapes = ((1 - x) * (1 - 2 * x), x * (2 * x - 1), 4 * x * (1 - x))
        moments = [rule.integrate(flux * shape, len(self.cell)) for shape in shapes]
        return self._scatter(np.stack(moments, axis=1)[..., None])[:, 0]

    def _scatter(self, per_edge: Array) -> Array:
        """(n_dofs, k) from values (nb, 3, k) on the boundary edges."""
        load = np.zeros((self.n_dofs, per_edge.shape[2]))
        np.add.at(load, self.dofs.ravel(), per_edge.reshape(-1, per_edge.shape[2]))
        return load


def reference_space(
    partition: Partition, singular: Iterable[Singular] = (), edges_per_cell: int = EDGES_PER_CELL
) -> ReferenceSpace:
    """The reference space of a partition, its mesh refined towards the singular points of lambda too."""
    from unilateral.triangulate import triangulate

    polygon = partition.polygon
    s, fine = _boundary_nodes(
        partition,
        sorted({polygon.arc_length(p.side, p.t) % polygon.perimeter for p in singular}),
        edges_per_cell,
    )
    mesh = meshes.from_arrays(polygon, *triangulate(polygon, s, GROWTH, fine), "reference mesh")
    basis = skfem.Basis(skfem.MeshTri(mesh.points.T.copy(), mesh.triangles.T.copy()), skfem.ElementTriP2())
    A = sp.csr_array(laplace.assemble(basis) + mass.assemble(basis))
    order = elimination_order(A, np.empty(0, dtype=np.intp))
    lu = splu(
        A[order][:, order].tocsc(),
        permc_spec="NATURAL",
        diag_pivot_thresh=0.0,
        options={"SymmetricMode": True},
    )
    middle = 0.5 * (mesh.s[1:] + mesh.s[:-1])
    cell = np.searchsorted(partition.points, middle, side="right") - 1
    return ReferenceSpace(partition, mesh, _boundary_dofs(basis, mesh), cell, basis.N, lu, order)


def dual_errors(runs: xr.Dataset, cases: Sequence[Case], partition: Partition) -> xr.Dataset:
    """Bounds of ||lambda - lambda_H||_{-1/2} for the table `runs` of one partition, for its cases and meshes.

    NaN where lambda_H is not judged. The discrete norm, a supremum over V_h, is a lower bound too; no upper
    bound is known here, and it stays NaN.
    """
    lower = np.full((len(cases), runs.sizes["mesh"], 1), np.nan)
    judged = np.isfinite(runs["hm12_discrete"].transpose("case", "mesh", "partition").values[..., 0])
    if judged.any():
        space = reference_space(partition, [p for case in cases for p in case.flux_singular()])
    for c in np.flatnonzero(judged.any(axis=1)).tolist():
        lambda_H = runs["lambda_H"].sel(case=cases[c].name).isel(partition=0).values
        lower[c, judged[c], 0] = space.error_lower(cases[c], lambda_H[judged[c], : partition.n_cells])
    lower = np.fmax(lower, runs["hm12_discrete"].transpose("case", "mesh", "partition").values)
    run = ("case", "mesh", "partition")
    variables = {"hm12_error_lower": (run, lower), "hm12_error_upper": (run, np.full_like(lower, np.nan))}
    return xr.Dataset(variables, coords={name: runs[name] for name in ("case", "h", "H")})


def _boundary_nodes(
    partition: Partition, singular: list[float], per_cell: int
) -> tuple[Array, dict[float, float]]:
    """Arc lengths (nb,) of the boundary nodes, and the edge length at each singular point."""
    cuts = np.union1d(partition.points, singular)
    counts = np.ceil(np.diff(cuts) / (partition.H / per_cell) - 1e-9).astype(int)
    steps = np.diff(cuts) / counts
    offsets = np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts)
    uniform = np.repeat(cuts[:-1], counts) + offsets * np.repeat(steps, counts)
    halves = 0.5 ** np.arange(1, HALVINGS + 1)
    graded, fine = [uniform], {}
    for p in singular:
        i = int(np.searchsorted(cuts, p))
        graded += [p + steps[i] * halves, p - steps[i - 1] * halves]
        fine[p] = float(min(steps[i], steps[i - 1]) * halves[-1])
    return np.unique(np.concatenate(graded) % partition.polygon.perimeter), fine


def _boundary_dofs(basis: skfem.Basis, mesh: Mesh) -> NDArray[np.intp]:
    start, end = mesh.boundary, np.roll(mesh.boundary, -1)
    n = mesh.n_nodes
    facets = basis.mesh.facets
    keys = facets.min(axis=0) * n + facets.max(axis=0)
    order = np.argsort(keys)
    wanted = np.minimum(start, end) * n + np.maximum(start, end)
    facet = order[np.searchsorted(keys, wanted, sorter=order)]
    return np.column_stack([basis.nodal_dofs[0][start], basis.nodal_dofs[0][end], basis.facet_dofs[0][facet]])
