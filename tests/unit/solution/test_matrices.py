"""The matrices of the discrete problem, against scikit-fem's and by what they are defined to be."""

import numpy as np
import pytest
import skfem
from skfem.helpers import dot, grad

import unilateral as ul

G = "x/9 - 1/5"
KITE = [(0, 0), (1.1, -0.3), (1.4, 1.2), (0.2, 0.8)]
EXACTLY = ul.Stop(algorithm="active_set")
COEFFICIENTS = [{}, {"k": 3, "c": "1/7"}, {"k": "1/50", "c": 4}]


def solver(free=(), **options):
    """On a mesh and cells that do not fit each other."""
    options = options | ({"free_sides": free, "q": "(x - y)/9"} if free else {})
    return ul.Solver(ul.Problem(KITE, "x*y - 1", G, **options), h=1 / 7, H=0.3, stop=EXACTLY)


def assemble_by_scikit_fem(mesh, k, c):
    """scikit-fem's A, the load of f = xy - 1 and that of q = (x - y)/9 on side 1, all of them exact."""
    mesh_tri = skfem.MeshTri(mesh.points.T.copy(), mesh.triangles.T.astype(np.int64).copy(), validate=False)
    basis = skfem.Basis(mesh_tri, skfem.ElementTriP1(), intorder=4)
    form = skfem.BilinearForm(lambda u, v, w: k * dot(grad(u), grad(v)) + c * u * v)
    load = skfem.LinearForm(lambda v, w: (w.x[0] * w.x[1] - 1) * v).assemble(basis)
    a = np.array(KITE[1])
    b = np.array(KITE[2])
    subset = mesh_tri.facets_satisfying(
        lambda x: np.abs((x[0] - a[0]) * (b - a)[1] - (x[1] - a[1]) * (b - a)[0]) < 1e-9, boundaries_only=True
    )
    facets = skfem.FacetBasis(mesh_tri, skfem.ElementTriP1(), facets=subset, intorder=4)
    flux = skfem.LinearForm(lambda v, w: (w.x[0] - w.x[1]) / 9 * v).assemble(facets)
    return form.assemble(basis), load, flux


@pytest.mark.parametrize("data", COEFFICIENTS)
@pytest.mark.parametrize("free", [(), (1,)])
def test_matrices_are_those_of_scikit_fem(data, free):
    """All integrands are polynomials that both integrate exactly: they agree but for rounding."""
    matrix_solver = solver(free, **data)
    matrices = matrix_solver.matrices()
    k = eval(str(data.get("k", 1)))
    c = eval(str(data.get("c", 1)))
    A, load, flux = assemble_by_scikit_fem(matrix_solver.mesh, k, c)
    assert abs(matrices.A - A).max() < 1e-13 * abs(A).max()
    np.testing.assert_allclose(matrices.F, load + flux if free else load, rtol=0, atol=1e-14)
    assert np.abs(flux).max() > 1e-3


@pytest.mark.parametrize("data", COEFFICIENTS)
@pytest.mark.parametrize("free", [(), (1,)])
def test_the_solution_fulfils_the_discrete_problem(data, free):
    """(2.1) and (2.2) up to rounding, by an active set; control: without the load it does not."""
    matrix_solver = solver(free, **data)
    s = matrix_solver()
    matrices = matrix_solver.matrices()
    lambda_H = s.multiplier[matrices.cells]
    gap = matrices.B @ s.u - matrices.H * matrices.g
    remaining = matrices.A @ s.u - matrices.B.T @ lambda_H
    assert np.abs(remaining - matrices.F).max() < 1e-13
    assert np.abs(remaining).max() > 1e-3
    assert lambda_H.min() >= 0
    assert lambda_H.max() > 0
    assert gap.min() > -1e-14
    assert gap.max() > 0
    assert np.abs(lambda_H * gap).max() < 1e-14
    np.testing.assert_allclose(gap / matrices.H, s.gap[matrices.cells], rtol=0, atol=1e-14)


@pytest.mark.parametrize("data", COEFFICIENTS)
def test_B_has_integrals_over_cells(data):
    """Of 1 the cells' lengths; of x, which V_h contains, the lengths times the cells' middles."""
    matrix_solver = solver((1,), **data)
    matrices = matrix_solver.matrices()
    cells = matrix_solver.partition
    np.testing.assert_array_equal(matrices.cells, np.flatnonzero(cells.side != 1))
    np.testing.assert_allclose(matrices.B @ np.ones(matrix_solver.mesh.n_nodes), matrices.H, rtol=1e-13)
    middles = 0.5 * (cells.ends[0] + cells.ends[1])[matrices.cells]
    np.testing.assert_allclose(
        matrices.B @ matrix_solver.mesh.points, matrices.H[:, None] * middles, rtol=0, atol=1e-14
    )
    np.testing.assert_allclose(matrices.g, middles[:, 0] / 9 - 0.2, rtol=0, atol=1e-14)


@pytest.mark.parametrize("data", COEFFICIENTS)
@pytest.mark.parametrize("algorithm", ["auto", "multigrid"])
def test_D_and_S_are_those_of_A_and_B(data, algorithm):
    """By dense algebra. They are made when asked for, also where multigrid solves."""
    problem = ul.Problem(KITE, "x*y - 1", G, free_sides=[1], **data)
    matrices = ul.Solver(problem, h=1 / 8, H=1 / 4, stop=ul.Stop(algorithm=algorithm)).matrices()
    D = matrices.B @ np.linalg.solve(matrices.A.toarray(), matrices.B.T.toarray())
    np.testing.assert_allclose(matrices.D, D, rtol=0, atol=1e-12 * np.abs(D).max())
    np.testing.assert_allclose(
        matrices.S * np.sqrt(np.outer(matrices.H, matrices.H)), D, rtol=0, atol=1e-12 * D.max()
    )


def test_matrices_follow_the_load():
    matrix_solver = solver()
    matrices = matrix_solver.matrices(f="1", g=lambda x, y: x)
    assert matrices.F.sum() == pytest.approx(matrix_solver.mesh.areas.sum(), rel=1e-13)
    assert (matrices.H * matrices.g).sum() == pytest.approx(
        float(
            matrix_solver.partition.lengths
            @ (0.5 * (matrix_solver.partition.ends[0] + matrix_solver.partition.ends[1]))[:, 0]
        ),
        rel=1e-13,
    )
