"""Friedrichs' constant on domains whose eigenvalues are known in closed form, and where rounding hides it."""

import math

import mpmath
import numpy as np
import pytest
import scipy.sparse as sp
import sentences
from scipy.sparse.linalg import eigsh

from unilateral.errors import InputError
from unilateral.fem import p1, poincare
from unilateral.fem.poincare import friedrichs
from unilateral.geometry.mesh import refine, unstructured
from unilateral.geometry.partition import balanced, uniform
from unilateral.geometry.polygon import Polygon, named, square
from unilateral.geometry.structured import structured

THIRD = Polygon(np.array([[0.0, 0.0], [3.0, 0.0], [3.0, 1.0], [0.0, 1.0]]), "long")
KNOWN = [
    (square(), (3,), 2 / math.pi),
    (square(), (0, 2), 1 / math.pi),
    (square(), (0, 1, 2, 3), 1 / (math.pi * math.sqrt(2))),
    (THIRD, (3,), 6 / math.pi),
    (THIRD, (2, 3), 1 / (math.pi * math.hypot(1 / 2, 1 / 6))),
]


@pytest.mark.parametrize(("polygon", "clamped", "exact"), KNOWN)
@pytest.mark.parametrize("mesh", [structured, unstructured])
def test_it_is_a_little_above_the_best_one(polygon, clamped, exact, mesh):
    for h in (1, 1 / 8):
        assert exact <= friedrichs(mesh(polygon, h), clamped) <= 1.03 * exact


def test_a_larger_eigenvalue_is_refused(monkeypatch):
    """Control: no number above the least eigenvalue passes for a lower bound."""
    monkeypatch.setattr(poincare, "LESS", 1.001)
    with sentences.raises(InputError):
        friedrichs(structured(square(), 1 / 8), (0,))


def test_another_mesh_serves_where_rounding_hides_the_eigenvalue(monkeypatch):
    """As on a mesh that is graded to a point, whose least triangles have huge numbers."""
    found = friedrichs(structured(named("lshape"), 1 / 8), (1,))
    on, met = poincare._on, []

    def hidden(mesh, clamped):
        met.append(mesh)
        return math.inf if len(met) == 1 else on(mesh, clamped)

    monkeypatch.setattr(poincare, "_on", hidden)
    assert friedrichs(structured(named("lshape"), 1 / 8), (1,)) == pytest.approx(found, rel=0.05)
    assert len(met) == 2


def test_one_that_is_known_serves_where_it_is_smaller(monkeypatch):
    """Then no other mesh is made either."""
    mesh = structured(square(), 1 / 8)
    assert friedrichs(mesh, (3,), 1.0) == friedrichs(mesh, (3,))
    assert friedrichs(mesh, (3,), 0.5) == 0.5
    monkeypatch.setattr(poincare, "_on", lambda mesh, clamped: math.inf)
    monkeypatch.delattr(poincare, "with_boundary")
    assert friedrichs(mesh, (3,), 1.0) == 1.0


def beside(d):
    """The unit square, whose left side has a part of length d at the lower vertex; it is the side 4."""
    return Polygon(np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0], [0.0, d]]), "beside")


def conforming(mesh, clamped):
    """A constant of P1, which is not above the best one: by its least eigenvalue, and on a graded mesh."""
    inside = ~poincare.Form(c=0.0, clamped=clamped).fixed(mesh)
    K, M = (p1.stiffness_and_mass(mesh)[i][inside][:, inside] for i in (0, 1))
    return 1 / math.sqrt(eigsh(K.tocsc(), M=M.tocsc(), k=1, sigma=0.0, return_eigenvectors=False)[0])


@pytest.mark.parametrize("d", [1e-2, 1e-4, 1e-6])
def test_a_short_clamped_side_has_a_mesh_that_is_graded_to_it(d):
    """Between P1's constant and 1.1 times that. Control: without one it is larger by a third or more."""
    polygon = beside(d)
    graded = poincare.with_boundary(polygon, balanced(uniform(polygon, 1 / 8)).points[:-1], 0.3)
    least = conforming(refine(graded, 1), (4,))
    mesh = unstructured(polygon, 1 / 8)
    assert least <= friedrichs(mesh, (4,)) <= 1.1 * least
    assert poincare._on(mesh, (4,)) > 1.3 * least


def test_short_sides_anywhere_have_a_constant_that_is_near_the_best_one():
    """Of 10 random quadrilaterals with a part of a side of length 1e-7 to 1e-1 that is clamped, alone or not.

    It is not below P1's constant on a graded mesh, which proves that it is not too small, and at most 1.3
    times as large.
    """
    rng = np.random.default_rng(23)
    for _ in range(10):
        angle = 0.5 * np.pi * (np.arange(4) + rng.uniform(-0.3, 0.3, 4))
        v = np.column_stack([np.cos(angle), np.sin(angle)])
        d = 10 ** rng.uniform(-7, -1)
        along = v[1] - v[0]
        polygon = Polygon(np.insert(v, 1, v[0] + d * along / np.hypot(*along), axis=0), "short")
        clamped = (0,) if rng.random() < 0.5 else (0, 3)
        constant = friedrichs(unstructured(polygon, 1 / 4), clamped)
        graded = poincare.with_boundary(polygon, balanced(uniform(polygon, 1 / 4)).points[:-1], 0.4)
        least = conforming(graded, clamped)
        assert least <= constant <= 1.3 * least


@pytest.mark.parametrize(
    ("vertices", "clamped"),
    [
        (beside(1e-6).vertices, (3,)),
        ([[0.0, 0.0], [1.0, 0.0], [1.0, 1e-3], [0.0, 1e-3]], (3,)),
        ([[0.0, 0.0], [1.0, 0.0], [1.0, 1e-4], [0.0, 1e-4]], (3,)),
    ],
)
@pytest.mark.parametrize("h", [1 / 20, 1 / 8])
def test_short_free_sides_and_strips_hide_nothing(vertices, clamped, h):
    """2 / pi where all of x = 0 is clamped; a free part of 1e-6 changes less than one in a thousand of it."""
    found = friedrichs(unstructured(Polygon(np.array(vertices), "thin"), h), clamped)
    assert 2 / math.pi <= found <= 1.03 * 2 / math.pi


def test_no_eigenvalue_is_below_what_is_found_whatever_is_rounded(monkeypatch):
    """Of small matrices of numbers of 1 to 1e12, the least eigenvalue of some of which rounding hides.

    Against mpmath with 60 digits. Control: without the shift some numbers found are too large.
    """
    rng, without = np.random.default_rng(3), 0
    matrices = [nearly_singular(rng, 10 ** -rng.uniform(6, 15.5)) for _ in range(60)]
    with mpmath.workdps(60):
        least = [min(mpmath.eigsy(mpmath.matrix(B.toarray()), eigvals_only=True)) for B in matrices]
    found = [poincare._least(B) for B in matrices]
    assert all(mu == 0 or mu <= exact for mu, exact in zip(found, least, strict=True))
    assert 10 < np.count_nonzero(found) < 55
    monkeypatch.setattr(poincare, "EPS", 0.0)
    monkeypatch.setattr(poincare, "_skew", lambda factors, D: 0.0)
    without = [poincare._least(B) for B in matrices]
    assert any(mu > exact for mu, exact in zip(without, least, strict=True))


def nearly_singular(rng, least):
    """A matrix (6, 6) with the eigenvalue `least` and others up to 1, its rows and columns then scaled."""
    Q, _ = np.linalg.qr(rng.standard_normal((6, 6)))
    scale = 10 ** rng.uniform(0, 6, 6)
    B = scale[:, None] * ((Q * np.append(least, rng.uniform(0.1, 1, 5))) @ Q.T) * scale
    return sp.csr_array(0.5 * (B + B.T))


def test_places_whose_numbers_cancel_are_counted():
    """SuperLU leaves them out, but what cancels is rounded. By hand: the factor's column 1 has 3 places.

    Without pivoting row 2 gets 1/2 - 1 * 1/2 = 0 in column 1, and row 3 a place in column 2 by that.
    """
    B = sp.csr_array(np.array([[2.0, 1, 1, 0], [1, 2, 0.5, 1], [1, 0.5, 2, 0], [0, 1, 0, 2]]))
    assert poincare.factorise(B, np.arange(4)).L.nnz == 7
    assert poincare._most_in_rows(B, np.arange(4)) == (3, 5)


def test_factors_that_are_not_transposed_to_each_other_prove_nothing(monkeypatch):
    """Nor do positive pivots: [[1, 1/3], [-1/3, -1/20]] has 1 and 11/180, and -1/20 on its diagonal.

    W = U - P L^T has 2/3 in the corner, so that L W has 2/3 and -2/9 in the last column.
    """
    skew = sp.csr_array(np.array([[1.0, 1 / 3], [-1 / 3, -1 / 20]]))
    factors = poincare.factorise(skew, np.arange(2))
    assert factors.U.diagonal().min() > 0
    # half of the last row and the last column of |L W| with D = 1
    assert poincare._skew(factors, np.ones(2)) == pytest.approx(0.5 * (2 / 9 + 2 / 3 + 2 / 9))
    symmetric = poincare.factorise(sp.csr_array(np.array([[4.0, 2.0], [2.0, 3.0]])), np.arange(2))
    assert poincare._skew(symmetric, np.ones(2)) == 0
    B = sp.csr_array(np.diag([1.0, 2.0, 3.0]) + 0.1)
    assert poincare._least(B) > 0
    monkeypatch.setattr(poincare, "_skew", lambda factors, D: 1e-12)
    assert poincare._least(B) == 0


# Each term on two right triangles, where the matrix has four unknowns


@pytest.fixture
def two_triangles(monkeypatch):
    """The unit square cut from lower left to upper right, not refined."""
    monkeypatch.setattr(poincare, "FEW", 0)
    mesh = structured(square(), 1)
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
    assert exact <= friedrichs(two_triangles, (3,)) ** 2 <= exact * (1 + 1e-5)
    assert exact >= (2 / math.pi) ** 2


def test_the_rounding_of_the_matrix_is_taken_from_its_eigenvalue(two_triangles, monkeypatch):
    """At least (n + 2) units of the trace, which is 60, for n = 4; as if the unit were 1e-6."""
    monkeypatch.setattr(poincare, "EPS", 1e-6)
    rounded = LEAST - (4 + 2) * 1e-6 * 60
    assert friedrichs(two_triangles, (3,)) ** 2 >= 1 / rounded + 2 * poincare.KAPPA**2


def test_the_constant_grows_with_the_exact_mesh(two_triangles, monkeypatch):
    """Once from the mesh of the matrix to the exact domain, once for norms on the mesh that uses it."""
    before = friedrichs(two_triangles, (3,))
    monkeypatch.setattr(type(two_triangles), "growth", property(lambda _: 1.5))
    assert friedrichs(two_triangles, (3,)) == pytest.approx(1.5**2 * before)


@pytest.mark.parametrize("side", [1e-9, 1e-6, 1e6])
def test_the_constant_is_a_length(side):
    """What rounding may hide is in units of the inverse squared diameter."""
    small = Polygon(side * square().vertices, "scaled")
    found = friedrichs(structured(small, side / 8), (3,))
    assert found == pytest.approx(side * friedrichs(structured(square(), 1 / 8), (3,)), rel=1e-6)
