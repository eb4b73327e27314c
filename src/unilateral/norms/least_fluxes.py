"""The least energy of fluxes whose normal components are given: an upper bound on ||.||_{-1/2}.

A `LeastFluxes` takes values (2 nb, k) of q.n at the starts and ends of the boundary edges, edge by edge, to
the matrix (k, k) of the form min (||q||^2 + ||div q||^2) over BDM1, or, if c = 0, min ||q||^2 over its fluxes
without divergence. On clamped edges q.n is free.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import scipy.sparse as sp
import skfem
from skfem.helpers import div, dot

from unilateral.arrays import Array, Index, Mask
from unilateral.fem.form import H1, Form
from unilateral.fem.linear_systems import OrderedMatrix
from unilateral.geometry.mesh import Mesh

LeastFluxes = Callable[[sp.csc_array], Array]


class CondensedEnergy(NamedTuple):
    """The form of a symmetric matrix (n, n) that is positive definite on the unknowns `inner`."""

    matrix: sp.csr_array
    inner: Index
    inner_factor: OrderedMatrix

    @classmethod
    def from_matrix(cls, matrix: sp.csr_array, fixed: Index, rank: Array) -> CondensedEnergy:
        """The unknowns that are not `fixed` are inner ones, and eliminated in the order of their `rank`."""
        inner = np.setdiff1d(np.arange(matrix.shape[0]), fixed)
        order = np.argsort(rank[inner], kind="stable")
        return cls(matrix, inner, OrderedMatrix(matrix[inner][:, inner].tocsr(), order))

    def minimise(self, q: sp.csc_array) -> Array:
        """The matrix of the form that is the least energy of unknowns that differ from q inside, (k, k)."""
        # with x inside: min (q + x)^T A (q + x) = q^T A q - (A q)_i^T A_ii^{-1} (A q)_i
        response = (self.matrix @ q).tocsc()
        direct = (q.T @ response).toarray()
        return 0.5 * (direct + direct.T) - self.inner_factor.inverse_products(
            response.tocsr()[self.inner].tocsc()
        )


def least_bdm1_fluxes(
    mesh: Mesh, facet: Index, has_flux: Mask, p2: skfem.Basis, rank: Array, form: Form = H1
) -> LeastFluxes:
    """The least energies of fluxes of BDM1 whose normal components are given on some edges."""
    bdm1 = skfem.Basis(p2.mesh, skfem.ElementTriBDM1())
    bdm1_rank = np.empty(bdm1.N)
    bdm1_rank[bdm1.facet_dofs] = rank[p2.facet_dofs]
    normal = normal_flux_matrix(bdm1, mesh, facet)
    matrix = sp.csr_array(hdiv.assemble(bdm1, k=form.k, c=form.c))
    energy = CondensedEnergy.from_matrix(matrix, bdm1.facet_dofs[:, facet[has_flux]], bdm1_rank)
    return lambda fluxes: energy.minimise((normal @ fluxes).tocsc())


def least_divergence_free_fluxes(
    mesh: Mesh, edge_unknowns: Index, has_flux: Mask, K: sp.csr_array, rank: Array
) -> LeastFluxes:
    """The least energies of fluxes of BDM1 without divergence: rotated gradients of functions in P2.

    q.n is the derivative of psi along the boundary. So it gives psi on every arc of edges that are not
    clamped, up to a constant. On the first arc this is 0; the others are unknowns after those of P2, whose
    matrix of (grad v, grad w) / k is K (n, n). `edge_unknowns` (nb, 3) are those of `ReferenceSpaces`. Some
    edge has to be clamped, as it is where c = 0.
    """
    # the arcs of edges that are not clamped, numbered from an edge behind a clamped one
    from_one = np.roll(np.arange(len(has_flux)), -int(np.argmax(has_flux & ~np.roll(has_flux, 1))))
    edges = from_one[has_flux[from_one]]
    arc = np.cumsum(np.diff(edges, prepend=edges[0] - 1) % len(has_flux) != 1)
    shifts = np.zeros((len(rank), arc[-1] + 1))
    shifts[edge_unknowns[edges], arc[:, None]] = 1.0
    psi = sp.hstack([sp.eye_array(len(rank)), sp.csr_array(shifts[:, 1:])], format="csr")
    energy = CondensedEnergy.from_matrix(
        (psi.T @ K @ psi).tocsr(), edge_unknowns[edges], np.append(rank, np.full(arc[-1], np.inf))
    )
    psi_unknowns = np.unique(edge_unknowns[edges])
    places = np.searchsorted(psi_unknowns, edge_unknowns[edges]).T
    to_psi = sp.eye_array(psi.shape[1], format="csc")[:, psi_unknowns]

    def minimise_energy(fluxes: sp.csc_array) -> Array:
        """The matrix (k, k) of the least energies for the fluxes (2 nb, k)."""
        ends = (np.diff(mesh.s)[edges, None] * fluxes[2 * edges + i].toarray() for i in (0, 1))
        # psi runs on from arc to arc: the constants, which are free, take up the difference
        values = np.zeros((len(psi_unknowns), fluxes.shape[1]))
        local, sums = _localise_columns(_integrate_stream_function(values, places, *ends), places[1, -1])
        return sums.T @ energy.minimise((to_psi @ sp.csc_array(local)).tocsc()) @ sums

    return minimise_energy


def _integrate_stream_function(values: Array, places: Index, start: Array, end: Array) -> Array:
    """psi in `values` (n, k) from the fluxes, times lengths, at the edges' starts and ends, (e, k) each.

    `places` (3, e) are the places of psi at the starts, ends and midpoints of the edges.
    """
    # psi rises by the integral of the linear q.n: (start + end) / 2, up to the midpoint (3 start + end) / 8
    values[places[1]] = np.cumsum((start + end) / 2, axis=0)
    values[places[0]] = values[places[1]] - (start + end) / 2
    values[places[2]] = values[places[0]] + (3 * start + end) / 8
    return values


def _localise_columns(psi: Array, last: np.intp) -> tuple[Array, Array]:
    """Local columns (n, k) and `sums` (k, k) with psi (n, k) = local @ sums."""
    # beyond a cell on which q.n is 1 psi is constant, up to the `last` place. Differences of two such columns
    # over these constants are 0 beyond both cells, which saves most of the work
    beyond = psi[last].copy()
    sums = np.eye(psi.shape[1])
    steps = np.flatnonzero(2 * np.abs(beyond) > np.abs(psi).max(axis=0))
    psi[:, steps] /= beyond[steps]
    psi[:, steps[:-1]] -= psi[:, steps[1:]]
    sums[np.ix_(steps, steps)] = np.tri(len(steps)) * beyond[steps]
    return psi, sums


@skfem.BilinearForm
def hdiv(q, r, form):  # type: ignore[no-untyped-def]
    """The integrand of (q, r) / k + (div q, div r) / c."""
    return dot(q, r) / form.k + div(q) * div(r) / form.c


def normal_flux_matrix(space: skfem.Basis, mesh: Mesh, facet: Index) -> sp.csr_array:
    """The matrix (n, 2 nb) from q.n at the ends of the boundary edges to the unknowns of BDM1 or RT1."""
    ends = (np.array([[0.0, 1.0]]), np.array([0.5, 0.5]))
    basis = skfem.FacetBasis(space.mesh, space.elem, facets=facet, quadrature=ends)
    unknowns = space.facet_dofs[:, facet]
    values = np.stack(
        [np.sum(np.asarray(shape[0]) * np.asarray(basis.normals), axis=0) for shape in basis.basis]
    )
    local = basis.element_dofs[:, None] == unknowns
    traces = np.einsum("lnp,ldn->npd", values, local.astype(float))
    first = np.asarray(basis.global_coordinates())[:, :, 0].T
    flipped = np.any(np.abs(first - mesh.points[mesh.boundary]) > 0.5 * np.diff(mesh.s)[:, None], axis=1)
    # where scikit-fem runs along the facet the other way the two ends change places
    traces[flipped] = traces[flipped, ::-1]
    # on each edge two unknowns and two values of q.n determine each other
    to_unknowns = np.linalg.inv(traces)
    rows, columns = np.broadcast_arrays(
        unknowns.T[:, :, None], (2 * np.arange(len(facet))[:, None] + np.arange(2))[:, None, :]
    )
    shape = (space.N, 2 * len(facet))
    return sp.coo_array((to_unknowns.ravel(), (rows.ravel(), columns.ravel())), shape=shape).tocsr()
