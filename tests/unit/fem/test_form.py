"""Forms with clamped sides, and without a reaction, by elimination of the nodes in dense algebra."""

import numpy as np
import pytest
from scipy.linalg import eigh

from unilateral.fem import edge_matrix
from unilateral.fem.condense import condense, form_matrix
from unilateral.fem.form import Form
from unilateral.fem.functional_norm import multilevel_dual_norm_bound
from unilateral.fem.hierarchy import build_hierarchy
from unilateral.fem.p1 import stiffness_and_mass, subtract_lift_from_load
from unilateral.fem.poincare import friedrichs_constant
from unilateral.fem.spaces import mixed_spaces
from unilateral.geometry import mesh as meshes
from unilateral.geometry.mesh import refine_triangles, refine_uniformly
from unilateral.geometry.partition import make_uniform_partition
from unilateral.geometry.polygon import Polygon, find_polygon, square
from unilateral.geometry.structured import make_structured_mesh
from unilateral.norms.fortin import beta_lower_bound

FORMS = [
    Form(clamped=(3,)),
    Form(c=0.0, clamped=(1,), friedrichs=2.0),
    Form(c=0.0, clamped=(0, 1), friedrichs=2.0),
    Form(clamped=(2,)),
]


def dense(mesh, form):
    """A on the nodes that are not fixed, and these."""
    K, M = stiffness_and_mass(mesh)
    free = np.flatnonzero(~form.clamped_nodes(mesh))
    return (K + form.c * M).toarray()[np.ix_(free, free)], free


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("h", [1 / 4, 1 / 16])
def test_solving_is_elimination_of_the_fixed_nodes(form, h):
    """By sparse elimination and by macro-elements."""
    mesh = make_structured_mesh(find_polygon("lshape"), h)
    A, free = dense(mesh, form)
    load = np.random.default_rng(1).normal(size=mesh.n_nodes)
    load[form.clamped_nodes(mesh)] = 0.0
    exact = np.zeros_like(load)
    exact[free] = np.linalg.solve(A, load[free])
    condensed = condense(mesh, form)
    assert np.allclose(condensed.solve(load), exact, rtol=0, atol=1e-11 * np.abs(exact).max())
    products, sums = condensed.matrix_and_row_sums
    assert np.allclose(products.sum(axis=1), sums, rtol=0, atol=1e-12)
    assert abs(products - form_matrix(mesh, form)).max() < 1e-12


@pytest.mark.parametrize("form", FORMS)
def test_the_load_of_what_is_left_has_the_given_values(form):
    """A v = load for v with given values at fixed nodes, which need not be 0 elsewhere."""
    mesh = make_structured_mesh(square(), 1 / 8)
    rng = np.random.default_rng(2)
    fixed = form.clamped_nodes(mesh)
    clamped_values, load = rng.normal(size=(2, mesh.n_nodes))
    v = clamped_values + condense(mesh, form).solve(subtract_lift_from_load(mesh, form, load, clamped_values))
    K, M = stiffness_and_mass(mesh)
    remaining = (K + form.c * M) @ v - load
    assert np.abs(remaining[~fixed]).max() < 1e-10
    assert np.array_equal(v[fixed], clamped_values[fixed])


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("adapted", [False, True])
def test_all_levels_are_decoupled_and_functionals_are_bounded(form, adapted):
    """The rows of every level are those of its mesh. The bound on a norm is above the exact one."""
    mesh = make_structured_mesh(square(), 1 / 2)
    rng = np.random.default_rng(3)
    for _ in range(4):
        chosen = np.flatnonzero(mesh.areas == mesh.areas.max())[:2] if adapted else None
        before = mesh
        mesh = refine_triangles(mesh, chosen)
    hierarchy = build_hierarchy(mesh, form=form)
    assert abs(hierarchy.A - form_matrix(mesh, form)).max() < 1e-12
    assert np.allclose(hierarchy.A.sum(axis=1), hierarchy.row_sums, atol=1e-12)
    level = hierarchy.levels[-2]
    assert level.rows is not None
    full_form_matrix = form_matrix(before, form)
    rows = (
        full_form_matrix
        if level.smoothed_nodes is None
        else full_form_matrix[level.smoothed_nodes][:, level.columns]
    )
    assert abs(level.rows - rows).max() < 1e-12
    A, free = dense(mesh, form)
    form = form._replace(friedrichs=1.0 if form.c else friedrichs_constant(mesh, form.clamped))
    hierarchy = build_hierarchy(mesh, form=form)
    for _ in range(5):
        R = np.zeros(mesh.n_nodes)
        R[free] = rng.normal(size=len(free))
        exact = np.sqrt(R[free] @ np.linalg.solve(A, R[free]))
        assert exact <= multilevel_dual_norm_bound(hierarchy, R) <= 8 * exact


def test_a_level_that_is_not_decoupled_is_noticed():
    mesh = refine_uniformly(make_structured_mesh(square(), 1 / 4))
    full_by_edge = edge_matrix.assemble_by_edges(mesh.triangulation, mesh.points)[0]
    assert abs(full_by_edge - form_matrix(mesh, FORMS[0])).max() > 0.1


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("kind", ["structured", "unstructured"])
def test_beta_is_at_least_its_bound(form, kind):
    """beta in the norm of V_h/4 in place of that of V, which is at least as large: the supremum is."""
    polygon = square()
    mesh = (
        meshes.make_unstructured_mesh(polygon, 1 / 8)
        if kind == "unstructured"
        else make_structured_mesh(polygon, 1 / 8)
    )
    cells = make_uniform_partition(polygon, 1 / 4)
    form = form._replace(friedrichs=1.0)
    coarse = mixed_spaces(condense(mesh, form), cells)
    fine = mixed_spaces(condense(refine_uniformly(mesh, 2), form), cells)
    square_of_beta = np.linalg.eigvals(np.linalg.solve(fine.operator.D, coarse.operator.D)).real.min()
    bound = beta_lower_bound(mesh, cells, form)
    assert 0.1 < bound <= np.sqrt(square_of_beta)


@pytest.mark.parametrize(("k", "c"), [(1.0, 0.0), (1.0, 1.0), (1e-6, 3.0), (2.0, 1e-30)])
def test_the_energy_norm_bounds_that_in_L2(k, c):
    """v = sin(pi x / 2) on the unit square, clamped at x = 0, attains ||v||_0 = 2/pi |v|_1."""
    form = Form(k, c, clamped=(3,), friedrichs=2 / np.pi)
    assert form.value_constant**2 == pytest.approx(0.5 / (k * np.pi**2 / 8 + c / 2), rel=1e-14)
    assert Form(k, 1.0).value_constant == 1.0


@pytest.mark.parametrize("constant", [1 / 4, 4.0])
def test_the_mass_of_a_hierarchy_is_divided_by_the_square_of_friedrichs_constant(constant):
    """sum m_i v_i^2 <= 4 ||v||_0^2 / C^2, for m_i thirds of the areas at a node, over C^2."""
    mesh = refine_uniformly(make_structured_mesh(square(), 1 / 2))
    thirds = np.bincount(mesh.triangles.ravel(), np.repeat(mesh.areas / 3, 3))
    nodal_weights = build_hierarchy(mesh, form=Form(c=0.0, clamped=(3,), friedrichs=constant)).nodal_weights
    assert nodal_weights == pytest.approx(thirds / constant**2)


@pytest.mark.parametrize("length", [1.0, 20.0])
def test_the_mass_of_a_hierarchy_is_at_most_four_times_the_energy(length):
    """For all functions on the mesh that vanish on the left, by the largest eigenvalue; c = 0."""
    polygon = Polygon(square().vertices * [length, 1], "long")
    mesh = refine_uniformly(make_structured_mesh(polygon, 1))
    form = Form(c=0.0, clamped=(3,), friedrichs=friedrichs_constant(mesh, (3,)))
    A, free = dense(mesh, form)
    mass = np.diag(build_hierarchy(mesh, form=form).nodal_weights[free])
    assert eigh(mass, A, eigvals_only=True)[-1] <= 4


def test_fixed_nodes_are_those_of_clamped_edges():
    """Both ends of a clamped side among them. On the square with h = 1/2, nodes by their places."""
    mesh = make_structured_mesh(square(), 1 / 2)
    x, y = mesh.points.T
    assert np.array_equal(Form(c=0.0, clamped=(3,)).clamped_nodes(mesh), x == 0)
    assert np.array_equal(Form(c=0.0, clamped=(0, 3)).clamped_nodes(mesh), (x == 0) | (y == 0))
    assert not Form().clamped_nodes(mesh).any()


def test_multipliers_are_on_sides_that_are_neither_clamped_nor_free():
    assert Form(clamped=(3,), free=(1,)).has_multiplier(np.array([0, 1, 2, 3])).tolist() == [
        True,
        False,
        True,
        False,
    ]
