"""Polygons, cells and meshes for tests of ||.||_{-1/2}, and numbers that it is known to lie between."""

from dataclasses import dataclass
from fractions import Fraction
from functools import cache
from math import pi, sqrt

import numpy as np
import skfem
from conftest import couple_structured_mesh
from scipy.sparse.linalg import splu
from skfem.models.poisson import laplace, mass, unit_load

from unilateral.fem.condense import condense
from unilateral.fem.spaces import mixed_spaces
from unilateral.geometry import mesh as meshes
from unilateral.geometry import partition as partitions
from unilateral.geometry.curves import SingularPoint
from unilateral.geometry.polygon import Polygon, find_polygon, square
from unilateral.geometry.structured import make_structured_mesh
from unilateral.norms.dual import build_dual_norm

TEN_DEGREES = np.radians(10)
POLYGONS = {
    "square": square(),
    "lshape": find_polygon("lshape"),
    "30-60-90": Polygon(np.array([[0, 0], [sqrt(3), 0], [sqrt(3), 1]]), "triangle"),
    "10 degrees": Polygon(np.array([[0, 0], [1, 0], [np.cos(TEN_DEGREES), np.sin(TEN_DEGREES)]]), "thin"),
    "re-entrant": Polygon(np.array([[0, 0], [2, 0], [2, 1], [0.9, 0.4], [0, 1.5]]), "dart"),
}
CELLS = {
    "square": partitions.make_uniform_partition(square(), 1 / 12),
    "shifted": partitions.make_shifted_partition(square(), 1 / 4, 0.3),
    "lshape": partitions.make_uniform_partition(find_polygon("lshape"), 1 / 2),
    "dart": partitions.make_uniform_partition(POLYGONS["re-entrant"], 0.7),
}
RECTANGLE = Polygon(np.array([[0, 0], [1.7, 0], [1.7, 1], [0, 1]]), "rectangle")
EQUAL_POINTS = {
    "square": lambda: make_structured_mesh(square(), 1 / 8),
    "lshape": lambda: make_structured_mesh(find_polygon("lshape"), 1 / 4),
    "gmsh lshape": lambda: mesh_with_nodes(find_polygon("lshape"), [3, 4, 5, 3, 8, 7]),
    "gmsh rectangle": lambda: meshes.make_unstructured_mesh(RECTANGLE, 0.15),
}
"""Meshes with an even number of boundary edges, which are the cells, too."""
P2 = skfem.ElementTriP2()
ROUNDING = 1e-9  # of energies that are differences of larger ones


@dataclass(frozen=True)
class Flux:
    """What the norm asks of a case: lambda = sin 5s, and |s - position|^alpha added on side 0."""

    polygon: Polygon
    position: float
    alpha: Fraction
    clamped_sides = ()
    c = 1.0

    def singular_points(self):
        return [SingularPoint(0, self.position / self.polygon.lengths[0], self.alpha.denominator)]

    flux_singular_points = singular_points

    @property
    def flux_in_L2(self):
        return self.alpha > Fraction(-1, 2)

    def transitions(self):
        return np.zeros(0)

    def trace_flux_and_gap(self, side, s, near=None):
        with np.errstate(divide="ignore"):
            power = np.where(side == 0, np.abs(s - self.position) ** float(self.alpha), 0)
        return 0 * s, np.sin(5 * s) + power, 0 * s


@cache
def norm_on(name, m, edges_per_cell=8):
    return build_dual_norm(partitions.make_uniform_partition(POLYGONS[name], 1 / m), (), edges_per_cell)


def alternating(cells):
    return np.where(np.arange(cells.n_cells) % 2, -1.0, 1.0)


def brackets(computed, below, above, gap):
    """Whether the bounds bracket what lies between `below` and `above`, themselves within `gap`."""
    not_above = computed.lower <= above * (1 + ROUNDING)
    not_below = below <= computed.upper * (1 + ROUNDING)
    return np.all(not_above & not_below & (computed.upper <= (1 + gap) * computed.lower))


def one_on_a_square(L):
    """||1||_{-1/2} on a square of the side L, whose square is 8 + 4 L coth(L/2).

    u = a (cosh x + cosh y), x and y from the centre, solves -Delta u + u = 0 with the flux 1.
    """
    a = 1 / np.sinh(L / 2)
    return np.sqrt(4 * a * (L * np.cosh(L / 2) + 2 * np.sinh(L / 2)))


def agree_to_half_percent(computed):
    """Whether bounds are in order, and as close as they are to be for P0 functions."""
    return np.all((computed.lower <= computed.upper) & (computed.upper <= 1.005 * computed.lower))


def bound_by_series(a, variation):
    """Bounds of ||mu||_{-1/2}, mu = sum a_k c_k on one side of the square, from the first a_k.

    ||mu||^2 = sum a_k^2 coth(q_k) / q_k, q_k^2 = 1 + (k pi)^2; |a_k| <= 2^{1/2} V / (k pi), V the variation.
    """
    q = np.sqrt(1 + (pi * np.arange(len(a))) ** 2)
    square = np.sum(a**2 / (q * np.tanh(q)))
    return sqrt(square), sqrt(square + variation**2 / (pi**3 * (len(a) - 1) ** 2))


def p0_coefficients(points, mu, n):
    """a_0 ... a_n of the function on (0, 1) with the values mu between the points."""
    k = np.arange(1, n + 1)
    ends = np.sin(pi * np.outer(k, points)) / (pi * k[:, None])
    return np.concatenate([[np.diff(points) @ mu], sqrt(2) * np.diff(ends, axis=1) @ mu])


def bound_p0_on_bottom(points, mu):
    return bound_by_series(p0_coefficients(points, mu, 20000), np.abs(np.diff(mu)).sum())


def p2_gram(cells, n):
    """(m, m) the form of ||.||_{-1/2}^2 on P0(T_H) from below: P2 on squares of side 1/n, each cut in two."""
    on_lshape = cells.polygon.name == "lshape"
    ticks = np.linspace(-1, 1, 2 * n + 1)[0 if on_lshape else n :]
    mesh = skfem.MeshTri.init_tensor(ticks, ticks)
    if on_lshape:
        x, y = mesh.p[:, mesh.t].mean(axis=1)
        mesh = mesh.remove_elements(np.flatnonzero((x > 0) & (y < 0)))
    basis = skfem.Basis(mesh, P2)
    boundary = mesh.boundary_facets()
    cell = cell_at(cells, mesh.p[:, mesh.facets[:, boundary]].mean(axis=1).T)
    cell_bases = [skfem.FacetBasis(mesh, P2, facets=boundary[cell == i]) for i in range(cells.n_cells)]
    loads = np.stack([unit_load.assemble(cell) for cell in cell_bases])
    A = laplace.assemble(basis) + mass.assemble(basis)
    return loads @ splu(A.tocsc()).solve(loads.T)


def cell_at(cells, points):
    """The cells in which the boundary points (k, 2) lie."""
    polygon = cells.polygon
    offset = points[:, None] - polygon.vertices
    s = np.sum(offset * polygon.tangents, axis=2)
    displaced = np.abs(np.sum(offset * polygon.normals, axis=2))
    side = np.where((s >= 0) & (s <= polygon.lengths), displaced, np.inf).argmin(axis=1)
    return np.searchsorted(cells.points, polygon.starts[side] + s[np.arange(len(s)), side]) - 1


def mesh_with_nodes(polygon, counts):
    """The mesh with so many equal boundary edges on the sides."""
    return meshes.triangulate_from_boundary(polygon, polygon.divided(np.array(counts))[:-1])


def own_cells(mesh):
    """The boundary edges themselves: H = h."""
    return partitions.from_points(mesh.polygon, mesh.s)


def operator(mesh, cells):
    return mixed_spaces(condense(mesh), cells).operator


@cache
def gram(cells, edges_per_cell=8):
    """The bounds' Gram matrices of P0(T_H)."""
    return build_dual_norm(cells, (), edges_per_cell).gram().p0


@cache
def uniform(polygon, m):
    return partitions.make_uniform_partition(find_polygon(polygon), 1 / m)


def make_operator_and_gram(polygon, n, m):
    """The dual operator and the Gram matrices for structured h = 1/n and H = 1/m."""
    return couple_structured_mesh(polygon, n, m).operator, gram(uniform(polygon, m))
