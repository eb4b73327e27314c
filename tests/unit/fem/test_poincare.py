"""Friedrichs' constant against eigenvalues in closed form and by other elements, and its rounding."""

import math
import sys
from fractions import Fraction

import mpmath
import numpy as np
import pytest
import scipy.sparse as sp
import sentences
import skfem
from scipy.linalg import cholesky_banded
from scipy.sparse.linalg import eigsh
from skfem.models import laplace, mass

from unilateral.errors import InputError
from unilateral.fem import poincare
from unilateral.fem.poincare import friedrichs_constant
from unilateral.geometry.mesh import from_arrays, make_unstructured_mesh, refine_uniformly
from unilateral.geometry.partition import balance_cells, make_uniform_partition
from unilateral.geometry.polygon import Polygon, find_polygon, square
from unilateral.geometry.structured import make_structured_mesh

LONG = Polygon(np.array([[0.0, 0.0], [3.0, 0.0], [3.0, 1.0], [0.0, 1.0]]), "long")
TRIANGLE = Polygon(np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]]), "triangle")
EQUILATERAL = Polygon(np.array([[0.0, 0.0], [1.0, 0.0], [0.5, math.sqrt(0.75)]]), "equilateral")
RECTANGLES = [
    (square(), (3,), 2 / math.pi),
    (square(), (0, 2), 1 / math.pi),
    (square(), (0, 1, 2, 3), 1 / (math.pi * math.sqrt(2))),
    (LONG, (3,), 6 / math.pi),
    (LONG, (2, 3), 1 / (math.pi * math.hypot(1 / 2, 1 / 6))),
]
OTHERS = [
    # by reflection: 5 pi^2; that of the unit square; that of a square with the diagonal 2
    (TRIANGLE, (0, 1, 2), 1 / (math.pi * math.sqrt(5))),
    (TRIANGLE, (0, 2), 1 / (math.pi * math.sqrt(2))),
    (TRIANGLE, (1,), 1 / math.pi),
    # Lame's 16 pi^2 / 3
    (EQUILATERAL, (0, 1, 2), math.sqrt(3) / (4 * math.pi)),
    # T. Betcke and L. N. Trefethen, SIAM Rev. 47, 2005
    (find_polygon("lshape"), tuple(range(6)), 9.6397238440219**-0.5),
]


@pytest.mark.parametrize(("polygon", "clamped", "exact"), RECTANGLES)
@pytest.mark.parametrize("h", [1, 1 / 8])
def test_the_constant_is_a_little_above_the_best_one_on_rectangles(polygon, clamped, exact, h):
    for mesh in (make_structured_mesh(polygon, h), make_unstructured_mesh(polygon, h)):
        assert exact <= friedrichs_constant(mesh, clamped) <= 1.03 * exact


@pytest.mark.parametrize(("polygon", "clamped", "exact"), OTHERS)
@pytest.mark.parametrize("h", [1 / 2, 1 / 8])
def test_the_constant_is_a_little_above_the_best_one(polygon, clamped, exact, h):
    assert exact <= friedrichs_constant(make_unstructured_mesh(polygon, h), clamped) <= 1.04 * exact


def test_a_larger_eigenvalue_is_refused(monkeypatch):
    """Control: no number above the least eigenvalue passes for a lower bound."""
    monkeypatch.setattr(poincare, "EIGENVALUE_SHARE", 1.001)
    with sentences.raises(InputError):
        friedrichs_constant(make_structured_mesh(square(), 1 / 8), (0,))


# Short sides and thin polygons


def make_split_square(d):
    """The unit square, whose left side has a part of length d at the lower vertex; it is the side 4."""
    return Polygon(np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0], [0.0, d]]), "beside")


def grade_to_short_sides(polygon):
    """A mesh that is graded to short sides."""
    return poincare.triangulate_from_boundary(
        polygon, balance_cells(make_uniform_partition(polygon, polygon.diameter / 8)).points[:-1], 0.3
    )


def constant_of_p2(mesh, clamped):
    """A constant that is not above the best one, by scikit-fem's quadratic elements."""
    skfem_mesh = skfem.MeshTri(mesh.points.T.copy(), mesh.triangles.T.copy())
    start = mesh.boundary
    end = np.roll(mesh.boundary, -1)
    edges = np.sort([start, end], axis=0)[:, np.isin(mesh.side, clamped)]
    number = {tuple(ends): k for k, ends in enumerate(skfem_mesh.facets.T.tolist())}
    facets = np.array([number[tuple(ends)] for ends in edges.T.tolist()])
    basis = skfem.Basis(skfem_mesh, skfem.ElementTriP2())
    K = laplace.assemble(basis)
    M = mass.assemble(basis)
    inside = basis.complement_dofs(basis.get_dofs(facets))
    K = K[inside][:, inside].tocsc()
    M = M[inside][:, inside].tocsc()
    return eigsh(K, M=M, k=1, sigma=0.0, return_eigenvectors=False)[0] ** -0.5


@pytest.mark.parametrize("d", [1e-2, 1e-4, 1e-6, 1e-8])
def test_a_short_clamped_side_has_a_mesh_that_is_graded_to_it(d):
    """Between that of P2 and 1.05 times that. Control: without one it is larger by a quarter or more."""
    polygon = make_split_square(d)
    min_constant = constant_of_p2(grade_to_short_sides(polygon), (4,))
    mesh = make_unstructured_mesh(polygon, 1 / 8)
    assert min_constant <= friedrichs_constant(mesh, (4,)) <= 1.05 * min_constant
    assert poincare.crouzeix_raviart_constant(mesh, (4,)) > 1.25 * min_constant


def test_short_sides_anywhere_have_a_constant_that_is_near_the_best_one():
    """Of 20 random quadrilaterals, on a side of which a part of length 1e-7 to 1e-1 is clamped, alone or not.

    The constant of P2 on a graded mesh is at most the best one, and less by a few hundredths.
    """
    rng = np.random.default_rng(23)
    for _ in range(20):
        angle = 0.5 * np.pi * (np.arange(4) + rng.uniform(-0.3, 0.3, 4))
        v = np.column_stack([np.cos(angle), np.sin(angle)])
        d = 10 ** rng.uniform(-7, -1)
        along = v[1] - v[0]
        polygon = Polygon(np.insert(v, 1, v[0] + d * along / np.hypot(*along), axis=0), "short")
        clamped = (0,) if rng.random() < 0.5 else (0, 3)
        min_constant = constant_of_p2(grade_to_short_sides(polygon), clamped)
        assert (
            min_constant
            <= friedrichs_constant(make_unstructured_mesh(polygon, 1 / 4), clamped)
            <= 1.1 * min_constant
        )


def test_sides_of_random_polygons_have_a_constant_that_is_near_the_best_one():
    """Of 20 star-shaped polygons with 3 to 8 sides, some of them clamped, on coarse and on fine meshes."""
    rng = np.random.default_rng(7)
    for _ in range(20):
        n = rng.integers(3, 9)
        angle = 2 * np.pi * (np.arange(n) + rng.uniform(-0.4, 0.4, n)) / n
        radius = rng.uniform(0.4, 1, n)
        polygon = Polygon(np.column_stack([radius * np.cos(angle), radius * np.sin(angle)]), "star")
        clamped = tuple(rng.permutation(n)[: rng.integers(1, n + 1)].tolist())
        min_constant = constant_of_p2(refine_uniformly(grade_to_short_sides(polygon)), clamped)
        for h in (1, 1 / 8):
            assert (
                min_constant
                <= friedrichs_constant(make_unstructured_mesh(polygon, h), clamped)
                <= 1.1 * min_constant
            )


STRIP = 2 / math.pi
TAPERED = 1 / 1.3607765
WEDGE = 1 / 2.4048256
"""Constants for the interval [0, 1] with v(1) = 0, and widths that are constant, 2 - x, and x.

With v'' + v' w'/w + k^2 v = 0 the inverses are zeros of cos(k), of J_0(k) Y_1(2k) - Y_0(k) J_1(2k), and of
J_0(k). Functions of x alone show that those of thin polygons with such widths are not smaller.
"""


def test_the_constants_of_intervals_are_zeros_of_bessel_functions():
    J = mpmath.besselj
    Y = mpmath.bessely
    k = mpmath.findroot(lambda k: J(0, k) * Y(1, 2 * k) - Y(0, k) * J(1, 2 * k), 1.3)
    assert float(1 / k) == pytest.approx(TAPERED, rel=1e-6)
    assert float(1 / mpmath.besseljzero(0, 1)) == pytest.approx(WEDGE, rel=1e-6)


@pytest.mark.parametrize("h", [1, 1 / 8, 1 / 20])
@pytest.mark.parametrize("e", [1e-2, 1e-3, 1e-4, 1e-5])
def test_thin_polygons_hide_nothing(h, e):
    """A strip, along the axes and turned, one whose width is twice as large at the free end, and a wedge."""
    strip = np.array([[0, 0], [1, 0], [1, e], [0, e]])
    turned = strip @ np.array([[0.8, 0.6], [-0.6, 0.8]])
    tapered = np.array([[0, 0], [1, 0], [1, e], [0, 2 * e]])
    wedge = np.array([[0, 0], [1, 0], [1, e]])
    for vertices, exact in ((strip, STRIP), (turned, STRIP), (tapered, TAPERED), (wedge, WEDGE)):
        constant = friedrichs_constant(make_unstructured_mesh(Polygon(vertices, "thin"), h), (1,))
        assert (1 - 1e-6) * exact <= constant <= 1.03 * exact


@pytest.mark.parametrize("h", [1 / 20, 1 / 8])
@pytest.mark.parametrize("d", [1e-4, 1e-6, 1e-10])
def test_short_free_sides_hide_nothing(h, d):
    """2 / pi where all of x = 0 is clamped; a free part of d changes less than one in a thousand of it."""
    assert STRIP <= friedrichs_constant(make_unstructured_mesh(make_split_square(d), h), (3,)) <= 1.03 * STRIP


def test_what_rounding_hides_is_said():
    """The wedge is a thousandth of the thinnest one above."""
    mesh = make_unstructured_mesh(Polygon(np.array([[0, 0], [1, 0], [1, 1e-8]]), "needle"), 1 / 8)
    with sentences.raises(InputError, "needle", "rounding"):
        friedrichs_constant(mesh, (1,))


# Which mesh serves


def test_another_mesh_serves_where_rounding_hides_the_eigenvalue(monkeypatch):
    """As on a mesh that is graded to a point, whose least triangles have huge numbers."""
    mesh = make_structured_mesh(find_polygon("lshape"), 1 / 8)
    constant = friedrichs_constant(mesh, (1,))
    constant_on = poincare.crouzeix_raviart_constant

    def hidden(second, clamped):
        return math.inf if second is mesh.coarse else constant_on(second, clamped)

    monkeypatch.setattr(poincare, "crouzeix_raviart_constant", hidden)
    assert friedrichs_constant(mesh, (1,)) == pytest.approx(constant, rel=0.02)


def test_a_large_mesh_is_not_used(monkeypatch):
    """Another one has almost the same constant. Control: the constant is no other if the mesh is small."""
    mesh = make_unstructured_mesh(TRIANGLE, 1 / 32)
    constant = friedrichs_constant(mesh, (1,))
    assert constant == mesh.exact_mesh_factor * poincare.crouzeix_raviart_constant(mesh, (1,))
    monkeypatch.setattr(poincare, "MAX_FRIEDRICHS_NODES", mesh.n_nodes - 1)
    assert friedrichs_constant(mesh, (1,)) != constant
    assert friedrichs_constant(mesh, (1,)) == pytest.approx(constant, rel=0.02)


def test_without_gmsh_the_mesh_itself_serves(monkeypatch):
    """If it is small, even if it is coarse beside a clamped side. Else gmsh is asked for."""
    mesh = make_unstructured_mesh(make_split_square(1e-3), 1 / 8)
    constant = friedrichs_constant(mesh, (4,))
    monkeypatch.setitem(sys.modules, "gmsh", None)
    assert (
        constant
        < friedrichs_constant(mesh, (4,))
        == mesh.exact_mesh_factor * poincare.crouzeix_raviart_constant(mesh, (4,))
    )
    monkeypatch.setattr(poincare, "MAX_FRIEDRICHS_NODES", mesh.n_nodes - 1)
    with sentences.raises(InputError, f"{mesh.n_nodes} nodes", "gmsh"):
        friedrichs_constant(mesh, (4,))


def test_a_mesh_of_one_triangle_is_halved():
    """All its edges are clamped, or all but one, for which there is nothing to compute before."""
    mesh = from_arrays(TRIANGLE, TRIANGLE.vertices, [[0, 1, 2]])
    for clamped, exact in (((0, 1, 2), 1 / math.sqrt(5)), ((0, 2), 1 / math.sqrt(2))):
        assert exact <= math.pi * friedrichs_constant(mesh, clamped) <= 1.04 * exact


def test_flat_triangles_are_halved_only_where_rounding_lets_them():
    """The wedge needs no halving. Control: halved often, it has a constant that is larger by a tenth."""
    mesh = make_unstructured_mesh(Polygon(np.array([[0, 0], [1, 0], [1, 1e-5]]), "wedge"), 1 / 8)
    assert poincare.crouzeix_raviart_constant(mesh, (1,)) <= 1.03 * WEDGE
    assert poincare.crouzeix_raviart_constant(refine_uniformly(mesh, 3), (1,)) > 1.1 * WEDGE


# Rounding


def test_no_eigenvalue_is_below_the_bound_whatever_is_rounded(monkeypatch):
    """Of small matrices of numbers of 1 to 1e12, the least eigenvalue of some of which rounding hides.

    Against mpmath with 60 digits. Control: without the shift some bounds are too large.
    """
    rng = np.random.default_rng(3)
    matrices = [nearly_singular(rng, 10 ** -rng.uniform(6, 15.5)) for _ in range(60)]
    with mpmath.workdps(60):
        minimum = [min(mpmath.eigsy(mpmath.matrix(B.toarray()), eigvals_only=True)) for B in matrices]
    bounds = [poincare.bound_eigenvalue(B) for B in matrices]
    assert all(mu == 0 or mu <= exact for mu, exact in zip(bounds, minimum, strict=True))
    assert 10 < np.count_nonzero(bounds) < 55
    monkeypatch.setattr(poincare, "EPS", 0.0)
    without = [poincare.bound_eigenvalue(B) for B in matrices]
    assert any(mu > exact for mu, exact in zip(without, minimum, strict=True))


def nearly_singular(rng, minimum):
    """A matrix (6, 6) with the eigenvalue `least` and others up to 1, its rows and columns then scaled."""
    Q, _ = np.linalg.qr(rng.standard_normal((6, 6)))
    scale = 10 ** rng.uniform(0, 6, 6)
    B = scale[:, None] * ((Q * np.append(minimum, rng.uniform(0.1, 1, 5))) @ Q.T) * scale
    return sp.csr_array(0.5 * (B + B.T))


def test_an_indefinite_matrix_has_no_bound():
    """Control: a number is added to the diagonal by which the least eigenvalue is 1."""
    B = np.array([[1.0, 2, 0], [2, 1, 2], [0, 2, 1]])
    shift = math.sqrt(8) - 1
    assert poincare.bound_eigenvalue(sp.csr_array(B)) == 0
    assert poincare.bound_eigenvalue(sp.csr_array(B + (shift + 1) * np.eye(3))) == pytest.approx(1, rel=1e-5)


def exact(array):
    """Its numbers as fractions."""
    return np.array([Fraction(x) for x in array.ravel().tolist()]).reshape(array.shape)


def test_factors_of_band_matrices_are_as_near_as_the_shift_supposes():
    """(b + 4) units of roundoff, without rounding: for 12 matrices with numbers of 1 to 1e12.

    Control: some are not a quarter of a unit near.
    """
    rng = np.random.default_rng(11)
    nearest = 0.0
    for b in [1, 2, 5, 9] * 3:
        n = 24
        scale = 10 ** rng.uniform(0, 6, 24)
        factor = np.tril(np.triu(rng.standard_normal((n, n)), -b))
        A = scale[:, None] * (factor @ factor.T + 1e-6 * np.eye(n)) * scale
        A = 0.5 * (A + A.T)
        band = np.array([np.append(np.diag(A, -k), np.zeros(k)) for k in range(b + 1)])
        R = cholesky_banded(band, lower=True)
        L = sum(np.diag(R[k][: n - k], -k) for k in range(b + 1))
        E = np.abs((exact(L) @ exact(L).T - exact(A)).astype(float))
        units = E / (poincare.EPS / 2 * np.sqrt(np.outer(np.diag(A), np.diag(A))))
        assert units.max() <= b + 4
        nearest = max(nearest, units.max())
    assert nearest > 0.25


def test_entries_of_the_matrix_are_as_near_as_the_shift_supposes():
    """20 units of roundoff, against 40 digits, on triangles that are not flat."""
    mesh = make_unstructured_mesh(find_polygon("lshape"), 1 / 3)
    B, _ = poincare.crouzeix_raviart_matrix(mesh)
    with mpmath.workdps(40):
        points = [[mpmath.mpf(x) for x in point] for point in mesh.points.tolist()]
        K = {}
        M = {}
        for nodes, edges in zip(mesh.triangles, mesh.opposite_edges, strict=True):
            X = [points[k] for k in nodes]
            opposite = [[X[(k + 2) % 3][z] - X[(k + 1) % 3][z] for z in (0, 1)] for k in range(3)]
            area = (opposite[0][0] * opposite[1][1] - opposite[0][1] * opposite[1][0]) / 2
            for i in range(3):
                M[edges[i]] = M.get(edges[i], 0) + area / 3
                for j in range(3):
                    # the gradients are edges, turned, over the area
                    entry = sum(p * q for p, q in zip(opposite[i], opposite[j], strict=True)) / area
                    K[edges[i], edges[j]] = K.get((edges[i], edges[j]), 0) + entry
        worst = 0.0
        for (i, j), entry in K.items():
            error = abs(B[i, j] - entry / mpmath.sqrt(M[i] * M[j]))
            worst = max(worst, float(error / mpmath.sqrt(K[i, i] / M[i] * K[j, j] / M[j])))
    assert 0 < worst <= 20 * poincare.EPS / 2


# Each term on two right triangles, where the matrix has four unknowns


@pytest.fixture
def two_triangles(monkeypatch):
    """The unit square cut from lower left to upper right, not refined."""
    monkeypatch.setattr(poincare, "MIN_FRIEDRICHS_NODES", 0)
    mesh = make_structured_mesh(square(), 1)
    assert len(mesh.triangles) == 2
    return mesh


LEAST = 18 - math.sqrt(252)
"""The least eigenvalue of Crouzeix and Raviart's elements on them, v = 0 on the left side.

A right triangle with legs 1 has the stiffness 2 grad_i . grad_j, with barycentric gradients: 4 for the
hypotenuse, 2 for a leg, -2 between both, 0 between legs; each edge has the mass 1/6. B has 24 for the shared
hypotenuse, 12 for each of three legs, and -6 sqrt(2) between. For equal values on legs it has the rows
24, -6 sqrt(6) and -6 sqrt(6), 12.
"""


def test_the_constant_is_that_of_the_matrix_and_what_the_means_miss(two_triangles):
    """C^2 = 1/lambda_h + (KAPPA d)^2, d the hypotenuse; a part of 1e-6 of lambda_h is not used."""
    exact = 1 / LEAST + 2 * poincare.KAPPA**2
    assert exact <= friedrichs_constant(two_triangles, (3,)) ** 2 <= exact * (1 + 1e-5)
    assert exact >= (2 / math.pi) ** 2


def test_the_rounding_of_the_matrix_is_taken_from_its_eigenvalue(two_triangles, monkeypatch):
    """At least (b + 22)/2 units of the least diagonal entry, 12, with b >= 1; as if a unit were 1e-6."""
    monkeypatch.setattr(poincare, "EPS", 1e-6)
    rounded = LEAST - 23 / 2 * 1e-6 * 12
    assert friedrichs_constant(two_triangles, (3,)) ** 2 >= 1 / rounded + 2 * poincare.KAPPA**2


@pytest.mark.parametrize("nodes", [0, 10_000])
def test_the_constant_grows_with_the_exact_mesh(two_triangles, nodes, monkeypatch):
    """Once from the mesh of the matrix to the exact domain, once for norms on the mesh that uses it.

    Both for a mesh that serves itself and for one that is too large, in whose place gmsh makes another one.
    """
    monkeypatch.setattr(poincare, "MAX_FRIEDRICHS_NODES", nodes)
    before = friedrichs_constant(two_triangles, (3,))
    monkeypatch.setattr(type(two_triangles), "exact_mesh_factor", property(lambda _: 1.5))
    assert friedrichs_constant(two_triangles, (3,)) == pytest.approx(1.5**2 * before)


@pytest.mark.parametrize("side", [1e-9, 1e-6, 1e6])
def test_the_constant_is_a_length(side):
    """What rounding may hide is in units of the inverse squared diameter."""
    small = Polygon(side * square().vertices, "scaled")
    constant = friedrichs_constant(make_structured_mesh(small, side / 8), (3,))
    assert constant == pytest.approx(
        side * friedrichs_constant(make_structured_mesh(square(), 1 / 8), (3,)), rel=1e-6
    )
