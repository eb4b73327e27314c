"""P2 in its hierarchical basis: products against scikit-fem's, and the functions that vanish in contact."""

import numpy as np
import pytest
import skfem
from skfem.helpers import dot, grad

from unilateral.fem.form import Form
from unilateral.fem.p2 import boundary_layer, linear_square_norms, quadratic_space, quadratic_square_norms
from unilateral.geometry import mesh as meshes
from unilateral.geometry.polygon import find_polygon


@pytest.fixture(scope="module", params=["refined", "gmsh"])
def spaces(request):
    mesh = meshes.make_unstructured_mesh(find_polygon("lshape"), 0.6)
    return quadratic_space(meshes.refine_uniformly(mesh) if request.param == "refined" else mesh)


def integrate_by_scikit_fem(spaces, v, f):
    """||grad v||^2, ||v||^2, (f, v) and ((2 f, f), curl v), f (m, 3) linear on triangles."""
    mesh = spaces.mesh
    p2 = skfem.Basis(
        skfem.MeshTri(mesh.points.T.copy(), mesh.triangles.T.copy()), skfem.ElementTriP2(), intorder=6
    )
    value = np.zeros(p2.N)
    value[p2.nodal_dofs[0]] = v[: mesh.n_nodes]
    ends = np.sort(mesh.triangulation.ends, axis=1)
    edge = np.lexsort(ends.T[::-1])
    facet = np.lexsort(np.sort(p2.mesh.facets, axis=0)[::-1])
    value[p2.facet_dofs[0, facet]] = v[ends[edge]].mean(axis=1) + v[mesh.n_nodes + edge]
    dg = p2.with_element(skfem.ElementDG(skfem.ElementTriP1()))
    linear = np.empty(dg.N)
    linear[dg.element_dofs] = np.take_along_axis(f, np.argsort(mesh.triangles, axis=1), axis=1).T
    forms = (
        lambda w: dot(grad(w.of), grad(w.of)),
        lambda w: w.of**2,
        lambda w: w.f * w.of,
        lambda w: w.f * (2 * grad(w.of)[1] - grad(w.of)[0]),
    )
    fields = {"of": p2.interpolate(value), "f": dg.interpolate(linear)}
    return [skfem.Functional(form).assemble(p2, **fields) for form in forms]


def test_products_are_those_of_P2(spaces):
    rng = np.random.default_rng(1)
    v = rng.standard_normal(spaces.size)
    f = rng.standard_normal(spaces.mesh.triangles.shape)
    energy, mass, load, along = integrate_by_scikit_fem(spaces, v, f)
    field = f[..., None] * np.array([2.0, 1.0])
    for form in (Form(), Form(2.0, 0.0), Form(2.0, 3.0)):
        product = form.k * energy + form.c * mass
        assert v @ spaces.quadratic_form(form).apply(v) == pytest.approx(product, rel=1e-12)
    assert v @ spaces.load(f) == pytest.approx(load, rel=1e-12)
    assert v @ spaces.curl_load(field, 0 * field) == pytest.approx(along, rel=1e-12)


def test_products_with_a_field_of_bubbles_follow_from_norms(spaces):
    """By ||curl v + b||^2 - ||curl v - b||^2 = 4 (curl v, b)."""
    rng = np.random.default_rng(2)
    v = rng.standard_normal(spaces.size)
    areas = spaces.mesh.areas
    field = rng.standard_normal((len(areas), 3, 2))
    slope = spaces.gradient(v)[..., ::-1] * np.array([1.0, -1.0])
    extra_square_norms = quadratic_square_norms(areas, slope, 1 * field).sum()
    square_norms = quadratic_square_norms(areas, slope, (-1) * field).sum()
    assert v @ spaces.curl_load(0 * field, field) == pytest.approx(
        (extra_square_norms - square_norms) / 4, rel=1e-12
    )


def test_a_flux_is_integrated_along_the_boundary_edges(spaces):
    """By Simpson's rule, which is exact for linear times quadratic functions."""
    rng = np.random.default_rng(5)
    mesh = spaces.mesh
    v = rng.standard_normal(spaces.size)
    flux = rng.standard_normal((len(mesh.boundary), 2))
    nodal, bubbles = np.split(v[spaces.boundary_unknowns], 2)
    ends = np.column_stack([nodal, np.roll(nodal, -1)])
    middle = (ends.mean(axis=1) + bubbles) * flux.mean(axis=1)
    exact = np.diff(mesh.s) @ (np.sum(ends * flux, axis=1) + 4 * middle) / 6
    assert v @ spaces.edge_load(flux) == pytest.approx(exact, rel=1e-12)


def test_the_form_is_symmetric_and_has_the_squares_of_nodal_functions(spaces):
    """Squares by products with themselves of functions that are 1 at one node or midpoint."""
    rng = np.random.default_rng(8)
    v, w = rng.standard_normal((2, spaces.size))
    form = spaces.quadratic_form(Form(2.0, 300.0))
    assert v @ form.apply(w) == pytest.approx(w @ form.apply(v), rel=1e-12)
    for unknown in (0, 5, spaces.mesh.n_nodes, spaces.size - 1):
        values = np.zeros(spaces.size)
        values[unknown] = 1
        function = spaces.subtract_hats(values)
        assert form.nodal_squares[unknown] == pytest.approx(function @ form.apply(function), rel=1e-12)


def test_coefficients_follow_from_values_at_nodes_and_midpoints(spaces):
    """And functionals on functions with one value 1 from those on hats and bubbles: the transposed map."""
    values, r = np.random.default_rng(9).standard_normal((2, spaces.size))
    v = spaces.subtract_hats(values.copy())
    middle = v[spaces.mesh.triangulation.ends].mean(axis=1) + v[spaces.mesh.n_nodes :]
    np.testing.assert_allclose(np.append(v[: spaces.mesh.n_nodes], middle), values, rtol=0, atol=1e-14)
    assert r @ v == pytest.approx(spaces.subtract_bubbles(r) @ values, rel=1e-12)


def add_random_hats(spaces, functions):
    """A sum of hats, 0 at fixed nodes, as `add_hats` adds them to 0; and the hats themselves."""
    n = spaces.mesh.n_nodes
    h = np.where(functions.is_fixed[:n], 0.0, np.random.default_rng(4).standard_normal(n))
    v = np.zeros(spaces.size)
    functions.add_hats(v, h)
    return v, h


def test_sums_of_hats_vanish_in_contact_and_are_linear_on_other_edges(spaces):
    nodes = spaces.boundary_unknowns[: len(spaces.mesh.boundary)]
    nb = len(spaces.mesh.boundary)
    contact = np.random.default_rng(3).random(2 * nb) < 0.5
    functions = spaces.vanishing_functions(contact)
    v, h = add_random_hats(spaces, functions)
    middle = 0.5 * (v[nodes] + v[np.roll(nodes, -1)]) + v[spaces.boundary_unknowns[nb:]]
    np.testing.assert_allclose(np.append(v[nodes], middle)[contact], 0, rtol=0, atol=1e-15)
    assert np.count_nonzero(functions.is_fixed) == contact.sum()
    assert np.array_equal(v[: len(h)], h)
    assert np.all(v[np.flatnonzero(~functions.is_fixed[len(h) :]) + len(h)] == 0)


def test_functionals_on_sums_of_hats_are_those_on_all_functions(spaces):
    """<r, E h> = <E^T r, h> for the map E from hats to what is added for them."""
    contact = np.random.default_rng(3).random(len(spaces.boundary_unknowns)) < 0.5
    functions = spaces.vanishing_functions(contact)
    v, h = add_random_hats(spaces, functions)
    r = np.random.default_rng(5).standard_normal(spaces.size)
    assert r @ v == pytest.approx(functions.restrict_to_hats(r) @ h, rel=1e-12)


def test_functions_may_vanish_at_other_places_besides(spaces):
    """At the nodes and midpoints of a triangle."""
    contact = np.random.default_rng(3).random(len(spaces.boundary_unknowns)) < 0.5
    other_unknowns = spaces.unknowns[0]
    functions = spaces.vanishing_functions(contact, other_unknowns)
    assert np.all(add_random_hats(spaces, functions)[0][other_unknowns] == 0)
    fixed = np.union1d(spaces.boundary_unknowns[contact], other_unknowns)
    assert np.array_equal(np.flatnonzero(functions.is_fixed), fixed)


def test_the_norm_on_the_layer_is_that_of_functions_of_the_boundary_unknowns(spaces):
    rng = np.random.default_rng(7)
    v = np.zeros(spaces.size)
    v[spaces.boundary_unknowns] = rng.standard_normal(len(spaces.boundary_unknowns))
    for form in (Form(), Form(2.0, 0.0), Form(2.0, 3.0)):
        norm = boundary_layer(spaces.mesh).norm(form, *np.split(v[spaces.boundary_unknowns], 2))
        assert norm**2 == pytest.approx(v @ spaces.quadratic_form(form).apply(v), rel=1e-12)


@pytest.mark.parametrize("shape", [(0, 3), (0, 3, 2), (4, 3), (4, 3, 2)])
def test_norms_of_linear_functions_are_those_by_edge_midpoints(shape):
    """By the rule of edge midpoints, which is exact for squares; on none there are none."""
    rng = np.random.default_rng(6)
    areas = rng.uniform(0.1, 1, shape[0])
    values = rng.standard_normal(shape)
    middle = 0.5 * (values + np.roll(values, 1, axis=1))
    exact = areas * np.sum((middle**2).reshape(shape[0], int(np.prod(shape[1:]))), axis=1) / 3
    np.testing.assert_allclose(linear_square_norms(areas, values), exact, rtol=1e-12)
