"""The spaces of the hypercircle on V_h's own mesh, P2 and RT1: a potential v and the best flux q.

q minimises ||grad v - q||^2 + ||v - f - div q||^2 among the fluxes of RT1 with given q.n on the boundary; it
does not depend on v, for (grad v, q) + (v, div q) = <q.n, v>. Its matrix depends on the mesh alone.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
import scipy.sparse as sp
import skfem
from skfem.helpers import div, dot, grad

from unilateral.arrays import Array, Index, Mask
from unilateral.geometry.mesh import Mesh
from unilateral.norms.reference import Factor, boundary_facets, hdiv, normal_fluxes, ranks

DEGREE = 4
"""Of the products of two functions of P2 or RT1."""
ROUNDING = 2.0**-45
"""Of the sizes of the terms of a sum: 64 units in the last place, for some 20 operations each."""


class Linear(NamedTuple):
    """f_h, linear on each triangle: its values (m, 3) at the vertices, as a field, and P2's load (n,)."""

    values: Array
    field: skfem.DiscreteField
    load: Array


class Fluxes(NamedTuple):
    """RT1's matrix of (q, r) + (div q, div r), the unknowns (k,) off the boundary, and their part of it."""

    matrix: sp.csr_array
    inner: Index
    factor: Factor


@dataclass(frozen=True, eq=False)
class Hypercircle:
    """P2 with the matrix A (n, n) of (., .)_1, and RT1, for any f_h and lambda_H on the mesh.

    `on_edges` (nb, 3) are P2's unknowns at the start, the end and the midpoint of every boundary edge;
    `facet` (nb,) is the edge in scikit-fem's numbering, `triangle` (nb,) the one at it. `rank` (n,) says in
    which order P2's unknowns are eliminated.
    """

    mesh: Mesh
    p2: skfem.Basis
    rt: skfem.Basis
    A: sp.csr_array
    on_edges: Index
    facet: Index
    triangle: Index
    rank: Array

    def linear(self, values: Array) -> Linear:
        """f_h by its values (m, 3) at the triangles' vertices."""
        in_order_of_nodes = np.take_along_axis(values, np.argsort(self.mesh.triangles, axis=1), axis=1)
        linear = self.p2.with_element(skfem.ElementDG(skfem.ElementTriP1()))
        source = np.empty(linear.N)
        source[linear.element_dofs] = in_order_of_nodes.T
        field = linear.interpolate(source)
        return Linear(values, field, _load.assemble(self.p2, f=field))

    def of_p1(self, v_h: Array) -> Array:
        """(n,) the values in P2 of a function of V_h."""
        v = np.empty(self.p2.N)
        v[self.p2.nodal_dofs[0]] = v_h
        v[self.p2.facet_dofs[0]] = v_h[self.p2.mesh.facets].mean(axis=0)
        return v

    def norm(self, v: Array) -> float:
        """||v||_1, triangle by triangle: in v . A v the gradient of a constant would not cancel."""
        return math.sqrt(float(_square.assemble(self.p2, potential=self.p2.interpolate(v))))

    def product(self, d: Array, load: Array, v: Array) -> float:
        """d . (load - A v), not below that without rounding."""
        sizes = np.abs(d) @ (np.abs(load) + abs(self.A) @ np.abs(v))
        return float(d @ (load - self.A @ v)) + ROUNDING * float(sizes)

    def rounding(self, f: Linear, v: Array, defect: float) -> float:
        """What rounding adds to the root of `defect`: that of derivatives is v's and q's over a height.

        ||q|| is at most ||grad v|| and the defect.
        """
        flat = 2 * self.mesh.areas / self.mesh.longest_edges
        source = math.sqrt(float(self.mesh.areas @ np.max(f.values**2, axis=1)))
        steep = 1 / float(flat.min())
        return ROUNDING * (self.norm(v) * (1 + steep) + defect * steep + source)

    def extension(self, v: Array, edges: Mask) -> Array:
        """(n,) the function that is v (n,) on those boundary edges (nb,), with 0 for all other unknowns."""
        found, kept = np.zeros(self.p2.N), self.on_edges[edges]
        found[kept] = v[kept]
        return found

    def boundary_load(self, flux: Array) -> Array:
        """(n,) values <q.n, psi_i> of a linear q.n with the values (nb, 2) at the edges' ends."""
        at_points = np.column_stack([flux, 4 * flux.mean(axis=1)]) * np.diff(self.mesh.s)[:, None] / 6
        return np.bincount(self.on_edges.ravel(), at_points.ravel(), self.p2.N).astype(float)

    def potential(self, f: Linear, given: Mask, values: Array) -> Array:
        """v (n,): the `values` where `given` (n,), and (v, w)_1 = (f_h, w) for all w that vanish there."""
        v, inner = np.where(given, values, 0.0), np.flatnonzero(~given)
        inner = inner[np.argsort(self.rank[inner], kind="stable")]
        factor = Factor(self.A[inner][:, inner].tocsr(), np.arange(len(inner)))
        v[inner] = factor.solve((f.load - self.A @ v)[inner])
        return v

    @cached_property
    def fluxes(self) -> Fluxes:
        """What every best flux on the mesh is found from, factorised at the first of them.

        The unknowns inside a triangle are eliminated just before the first of those on its edges.
        """
        rt, of_edges, rank = self.rt, self.rank[self.p2.facet_dofs[0]], np.empty(self.rt.N)
        rank[rt.facet_dofs] = of_edges
        rank[rt.interior_dofs] = of_edges[rt.mesh.t2f].min(axis=0) - 0.25
        inner = np.setdiff1d(np.arange(rt.N), rt.facet_dofs[:, self.facet])
        inner = inner[np.argsort(rank[inner], kind="stable")]
        matrix = sp.csr_array(hdiv.assemble(rt))
        return Fluxes(matrix, inner, Factor(matrix[inner][:, inner].tocsr(), np.arange(len(inner))))

    def best_flux(self, f: Linear, flux: Array) -> Array:
        """q (n_rt,) with the q.n that has the values (nb, 2) at the edges' ends."""
        rt, (matrix, inner, factor) = self.rt, self.fluxes
        q = normal_fluxes(rt, self.mesh, self.facet) @ flux.ravel()
        q[inner] = factor.solve((_divergence_load.assemble(rt, f=f.field) - matrix @ q)[inner])
        return q

    def defect(self, f: Linear, v: Array, q: Array) -> float:
        """||grad v - q||^2 + ||v - f_h - div q||^2."""
        fields = {"potential": self.p2.interpolate(v), "flux": self.rt.interpolate(q)}
        return float(_defect.assemble(self.p2, f=f.field, **fields))


def hypercircle(mesh: Mesh) -> Hypercircle:
    """The spaces on a mesh."""
    of_skfem = skfem.MeshTri(mesh.points.T.copy(), mesh.triangles.T.copy())
    p2 = skfem.Basis(of_skfem, skfem.ElementTriP2(), intorder=DEGREE)
    facet = boundary_facets(of_skfem, mesh)
    start, end = mesh.boundary, np.roll(mesh.boundary, -1)
    A = sp.csr_array(_h1.assemble(p2))
    return Hypercircle(
        mesh,
        p2,
        rt=p2.with_element(skfem.ElementTriRT2()),
        A=A,
        on_edges=np.column_stack([p2.nodal_dofs[0][start], p2.nodal_dofs[0][end], p2.facet_dofs[0][facet]]),
        facet=facet,
        triangle=of_skfem.f2t[0, facet],
        rank=ranks(p2, A),
    )


@skfem.BilinearForm
def _h1(v, w, _):  # type: ignore[no-untyped-def]
    return dot(grad(v), grad(w)) + v * w


@skfem.LinearForm
def _load(v, data):  # type: ignore[no-untyped-def]
    return data.f * v


@skfem.LinearForm
def _divergence_load(q, data):  # type: ignore[no-untyped-def]
    return -data.f * div(q)


@skfem.Functional
def _square(data):  # type: ignore[no-untyped-def]
    v = data.potential
    return dot(grad(v), grad(v)) + v**2


@skfem.Functional
def _defect(data):  # type: ignore[no-untyped-def]
    slope = grad(data.potential) - data.flux
    return dot(slope, slope) + (data.potential - data.f - div(data.flux)) ** 2
