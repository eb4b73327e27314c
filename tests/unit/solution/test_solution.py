"""What a solution shows: its contact set, its values at points and along sides, and its files."""

import json

import meshio
import numpy as np
import pandas as pd
import pytest
import sentences
import skfem
import xarray as xr
from conftest import ROOT

import unilateral as ul
from unilateral.bounds.boundary_flux import EDGE_REACTION_RATIO
from unilateral.geometry.partition import make_uniform_partition
from unilateral.geometry.polygon import square
from unilateral.solution.contact import Contact
from unilateral.solution.shortfalls import MAX_CHEAP_BOUND_ASPECT, explain_flat_triangles

pytestmark = pytest.mark.usefixtures("shared_cases")

SQUARE = [(0, 0), (1, 0), (1, 1), (0, 1)]
SIZES = {"h": 1 / 16, "H": 1 / 8}


@pytest.fixture(scope="module")
def shelter():
    """A pentagon with a slanted side, partly in contact."""
    return ul.solve(ul.load(ROOT / "examples/shelter.yaml"), **SIZES)


def test_contact_intervals_are_runs_of_cells_on_one_side():
    """By hand: cells of 1/4 on the square; a run that passes a vertex is cut there."""
    lambda_H = np.zeros(16)
    lambda_H[[1, 2, 3, 4, 15]] = 1, 2, 1, 3, 1
    contact = Contact(make_uniform_partition(square(), 1 / 4), lambda_H)
    assert [interval[:3] for interval in contact.intervals] == [(0, 0.25, 1), (1, 0, 0.25), (3, 0.75, 1)]
    assert [interval[3:] for interval in contact.intervals] == [
        ((0.25, 0), (1, 0)), ((1, 0), (1, 0.25)), ((0, 0.25), (0, 0)),
    ]  # fmt: skip
    assert (contact.lengths.tolist(), contact.length, contact.full) == ([0.75, 0.25, 0, 0.25], 1.25, False)


def test_u_at_points_is_nodal_linear_between_nodes_and_nan_outside(shelter):
    """u_h is its nodal values at nodes, and linear: their mean at centroids.."""
    mesh = shelter.mesh
    np.testing.assert_allclose(shelter.u_at(mesh.points), shelter.u, rtol=0, atol=1e-12)
    centroids = mesh.points[mesh.triangles].mean(axis=1)
    expected = shelter.u[mesh.triangles].mean(axis=1)
    np.testing.assert_allclose(shelter.u_at(centroids), expected, rtol=0, atol=1e-12)
    assert np.isnan(shelter.u_at([(-0.1, 0.5), (3, 3), (np.nan, 0)])).all()


def test_u_at_any_point_of_the_boundary_is_its_trace(shelter):
    """Round-off puts points of slanted sides a little outside; they belong to the polygon."""
    mesh = shelter.mesh
    s = np.linspace(0, mesh.polygon.perimeter, 1000, endpoint=False)
    side = mesh.polygon.sides_of(s)
    points = mesh.polygon.at(side, s - mesh.polygon.starts[side])
    trace = np.interp(s, mesh.s, np.append(shelter.u[mesh.boundary], shelter.u[mesh.boundary[0]]))
    np.testing.assert_allclose(shelter.u_at(points), trace, rtol=0, atol=1e-9)


def test_points_beside_the_boundary_are_on_it_or_outside(shelter):
    """On it up to 1e-10 of the diameter; at twice that they are outside, whichever side it is."""
    polygon = shelter.mesh.polygon
    middles = 0.5 * (polygon.vertices + np.roll(polygon.vertices, -1, axis=0))
    normals = polygon.normals
    near = middles + 0.9 * 1e-10 * polygon.diameter * normals
    far = middles + 2.0 * 1e-10 * polygon.diameter * normals
    np.testing.assert_allclose(shelter.u_at(near), shelter.u_at(middles), rtol=0, atol=1e-8)
    assert np.isnan(shelter.u_at(far)).all()


def test_lambda_along_a_side_is_that_of_its_cells(shelter):
    """The values of the cells that `cells` lists; NaN beyond the ends."""
    cells_of_side = shelter.cells().query("side == 1")
    starts = cells_of_side["start"].to_numpy() - shelter.mesh.polygon.starts[1]
    np.testing.assert_array_equal(shelter.lambda_at(1, starts), cells_of_side["multiplier"])
    end = shelter.mesh.polygon.lengths[1]
    assert shelter.lambda_at(1, end) == cells_of_side["multiplier"].iloc[-1]
    assert np.isnan(shelter.lambda_at(1, [-0.1, end + 0.1])).all()


def test_what_cannot_be_evaluated_is_refused(shelter):
    for point, shape in ((0, "()"), ((0, 0, 0), "(3,)"), (np.ones((2, 5)), "(2, 5)")):
        with sentences.raises(ul.InputError, shape):
            shelter.u_at(point)
    for point in ("a", [("a", "b")], [(1j, 0)], [(0, 0), (1,)], {}):
        for evaluate in (shelter.u_at, shelter.grad_at, shelter.flux_at):
            with sentences.raises(ul.InputError):
                evaluate(point)
    for side in ("a", None, 1.5, True, [0, 1]):
        with sentences.raises(ul.InputError):
            shelter.lambda_at(side, 0)
    for t in ("a", 1j, [[0], [0, 1]]):
        with sentences.raises(ul.InputError):
            shelter.lambda_at(0, t)
    with sentences.raises(ul.InputError):
        shelter.lambda_at(5, 0)


def test_files_hold_the_solution(tmp_path):
    s = ul.solve(ul.Problem(SQUARE, f=-1, g=["-x*y/2", 0, None, 0], free_sides=[2]), **SIZES)
    for name in ("s.vtu", "s.nc", "s.csv"):
        s.save(tmp_path / name)
    stored = meshio.read(tmp_path / "s.vtu")
    np.testing.assert_array_equal(stored.point_data["u"], s.u)
    lines = [k for k, block in enumerate(stored.cells) if block.type == "line"]
    on_edges = np.concatenate([stored.cell_data["multiplier"][k] for k in lines])
    assert on_edges @ np.diff(s.mesh.s) == pytest.approx(s.partition.lengths @ s.multiplier)
    cells = pd.read_csv(tmp_path / "s.csv")
    np.testing.assert_allclose(cells["multiplier"], s.multiplier)
    assert np.isnan(cells["gap"][cells["side"] == 2]).all()
    assert np.all(cells["gap"][cells["side"] != 2] > -1e-3)
    with xr.open_dataset(tmp_path / "s.nc") as table:
        np.testing.assert_array_equal(table["u"], s.u)
        np.testing.assert_array_equal(table["triangles"], s.mesh.triangles)
    with sentences.raises(ul.InputError):
        s.save(tmp_path / "s.txt")
    assert sorted(file.name for file in tmp_path.iterdir()) == ["s.csv", "s.nc", "s.vtu"]


def test_netcdf_follows_the_conventions(tmp_path):
    """CF 1.8: Conventions and title, units, no _FillValue on coordinates; indices are of 32 bits."""
    ul.solve(ul.case("natural"), **SIZES).save(tmp_path / "s.nc")
    with xr.open_dataset(tmp_path / "s.nc") as table:
        assert table.attrs["Conventions"] == "CF-1.8"
        assert table.attrs["title"]
        assert all(
            variable.attrs["units"] == "1" and variable.attrs["long_name"]
            for variable in table.variables.values()
        )
        assert {*table.coords} == {"x", "y"}
        assert not any("_FillValue" in coord.encoding for coord in table.coords.values())
        assert {table[name].dtype for name in ("triangles", "side")} == {np.dtype("int32")}


def test_the_certificate_is_a_file(tmp_path):
    """As the solution says it; NaN, which JSON has not, is null; the problem has no known errors."""
    problem = ul.Problem(SQUARE, f=-1, g="-x*y/2")
    s = ul.solve(problem, accuracy=0.3)
    single_solution = ul.solve(problem, **SIZES)
    s.save(tmp_path / "s.json")
    document = json.loads((tmp_path / "s.json").read_text())
    assert document["goal"] == {"accuracy": 0.3, "norm": "h1", "absolute": False}
    assert document["certified"]
    assert document["h1_relative_bound"] <= 0.3
    bounds = s.bounds
    assert (document["h1_bound"], document["hm12_bound"]) == (bounds.u, bounds.multiplier)
    relative = document["h1_relative_bound"], document["hm12_relative_bound"]
    assert relative == (bounds.relative_u, bounds.relative_multiplier)
    assert document["enclosure"] == bounds.unknown
    assert document["h1_error"] is None
    assert [level["unknowns"] for level in document["levels"]] == [
        level.unknowns for level in s.search.levels
    ]
    assert document["contact"]["length"] == s.contact.length
    assert document["versions"]["unilateral"] == ul.__version__
    certificate = single_solution.certificate()
    assert (certificate["goal"], certificate["certified"], certificate["levels"]) == (None, False, [])
    assert [record[key] for record in (document, certificate) for key in ("ended", "reach")] == [None] * 4


def test_values_and_gradients_are_those_of_scikit_fem(shelter):
    """Its interpolation on the same triangles, at points inside of them."""
    mesh = shelter.mesh
    rng = np.random.default_rng(2)
    weights = rng.dirichlet(np.ones(3), len(mesh.triangles))
    points = np.einsum("mi,mid->md", weights, mesh.points[mesh.triangles])
    theirs = skfem.MeshTri(mesh.points.T.copy(), mesh.triangles.T.copy())
    basis = skfem.CellBasis(theirs, skfem.ElementTriP1())
    np.testing.assert_allclose(shelter.u_at(points), basis.probes(points.T) @ shelter.u, rtol=0, atol=1e-13)
    slopes = basis.interpolate(shelter.u).grad.mean(axis=2).T
    np.testing.assert_allclose(shelter.grad_at(points), slopes, rtol=0, atol=1e-11)


def test_one_point_is_a_row_of_many(shelter):
    """Arrays without the first dimension; outside they are NaN."""
    points = [(0.3, 0.4), (0.5, 0.2), (9, 9)]
    for evaluate, shape in ((shelter.u_at, ()), (shelter.grad_at, (2,)), (shelter.flux_at, (2,))):
        many = evaluate(points)
        assert many.shape == (3, *shape)
        assert np.isfinite(many[:2]).all()
        assert np.isnan(many[2]).all()
        for point, row in zip(points, many, strict=True):
            assert evaluate(point).shape == shape
            np.testing.assert_array_equal(evaluate(point), row)


def test_a_gradient_on_an_edge_is_that_of_the_triangle_with_the_least_number(shelter):
    """At the middles of edges and at nodes; on sides too, where points may be a little outside."""
    mesh = shelter.mesh
    triangulation = mesh.triangulation
    slopes = shelter.grad_at(mesh.points[mesh.triangles].mean(axis=1))
    middles = mesh.points[triangulation.ends].mean(axis=1)
    minimum = np.where(
        triangulation.edge_triangles[:, 1] < 0,
        triangulation.edge_triangles[:, 0],
        triangulation.edge_triangles.min(axis=1),
    )
    minimum = np.where(triangulation.edge_triangles[:, 0] < 0, triangulation.edge_triangles[:, 1], minimum)
    np.testing.assert_array_equal(shelter.grad_at(middles), slopes[minimum])
    first = np.array(
        [np.flatnonzero((mesh.triangles == node).any(axis=1))[0] for node in range(mesh.n_nodes)]
    )
    np.testing.assert_array_equal(shelter.grad_at(mesh.points), slopes[first])


@pytest.mark.parametrize("name", ["natural", "thirds"])
def test_the_flux_is_nearer_than_the_gradient(name):
    """Its error in L2, by a rule of degree 2. No bound on it is promised; here both bounds are above it."""
    s = ul.solve(name, **SIZES)
    mesh = s.mesh
    position = np.array([[4, 1, 1], [1, 4, 1], [1, 1, 4]]) / 6
    points = np.einsum("qi,mid->mqd", position, mesh.points[mesh.triangles]).reshape(-1, 2)
    exact = s.problem.exact.value_and_gradient(points)[1]
    weights = np.repeat(mesh.areas / 3, 3)
    flux_error = np.sqrt(weights @ np.sum((s.flux_at(points) - exact) ** 2, axis=1))
    gradient_error = np.sqrt(weights @ np.sum((s.grad_at(points) - exact) ** 2, axis=1))
    assert flux_error < gradient_error < s.bounds.u
    assert flux_error < s.bounds.multiplier


@pytest.mark.parametrize("k", [1, 4])
def test_the_flux_is_balanced(k):
    """q.n has no jumps, and is lambda_H on the boundary and q on free sides; div q is c u_h - f in the mean.

    Here H = 2h, so lambda_H is constant on edges, and q is linear. As c is not 0, q.n may be less than
    lambda_H, by at most a part of (c |e|^2 / (EDGE_BALANCE k))^2.
    """
    fields = {
        "f": "1 - 3*x",
        "g": ["-x*y/2", 0, None, 0],
        "free_sides": [2],
        "q": "x - 2",
        "k": k,
        "c": "1/4",
    }
    s = ul.solve(ul.Problem(SQUARE, **fields), **SIZES)
    mesh = s.mesh
    triangulation = s.mesh.triangulation
    smaller = (0.25 * SIZES["h"] ** 2 / (EDGE_REACTION_RATIO * k)) ** 2
    ends = mesh.points[triangulation.ends]
    along = ends[:, 1] - ends[:, 0]
    normals = np.column_stack([along[:, 1], -along[:, 0]]) / np.hypot(*along.T)[:, None]
    inside = (triangulation.edge_triangles >= 0).all(axis=1)
    near = 1e-7 * normals[inside]
    for share in (0.25, 0.5):
        position = ends[inside, 0] + share * along[inside]
        remaining = np.sum(s.flux_at(position + (-near)) * normals[inside], axis=1)
        right = np.sum(s.flux_at(position + near) * normals[inside], axis=1)
        np.testing.assert_allclose(remaining, right, rtol=0, atol=1e-5)
    for side in range(4):
        t = (np.arange(16) + 0.5) / 16
        outward = s.flux_at(mesh.polygon.at(np.full(16, side), t)) @ mesh.polygon.normals[side]
        expected = (1 - t) - 2 if side == 2 else s.lambda_at(side, t)
        np.testing.assert_allclose(outward, expected, rtol=smaller, atol=1e-10)
    corners = mesh.points[mesh.triangles]
    flow = 0.0
    for i in range(3):
        a = corners[:, i]
        b = corners[:, (i + 1) % 3]
        inner = corners.mean(axis=1)
        middle = 0.5 * (a + b) + 1e-9 * (inner - 0.5 * (a + b))
        flow += np.sum(s.flux_at(middle) * np.column_stack([(b - a)[:, 1], (a - b)[:, 0]]), axis=1)
    mean_f = 1 - 3 * corners.mean(axis=1)[:, 0]
    expected = s.u[mesh.triangles].mean(axis=1) / 4 - mean_f
    np.testing.assert_allclose(flow / mesh.areas, expected, rtol=0, atol=2e-5)


def rows_of_needles(n):
    """n rectangles above each other in the unit square, each cut in two."""
    y = np.repeat(np.linspace(0, 1, n + 1), 2)
    points = np.column_stack([np.tile([0.0, 1.0], n + 1), y])
    i = 2 * np.arange(n)
    triangles = [np.stack(corners, axis=1) for corners in ((i, i + 1, i + 3), (i, i + 3, i + 2))]
    return ul.mesh(points, np.concatenate(triangles), polygon=square())


@pytest.mark.parametrize(("n", "report"), [(2, False), (9, False), (40, True)])
def test_flat_triangles_are_told_where_the_cheap_bound_is_loose(n, report):
    """u = y - y^2 / 2 on triangles that are 1 long and 1 / n high: |u - u_h|_1^2 = |u|_1^2 - |u_h|_1^2.

    The cheap bound becomes n / 6 times as large, as docs/accuracy.md says, while the sharp one follows the
    error.
    """
    mesh = rows_of_needles(n)
    s = ul.solve(ul.Problem(mesh, 1, [None] * 4, [1, 2, 3], c=0, u={0: 0}, q=0), mesh=mesh, H=1)
    error = np.sqrt(1 / 3 - s.solved.u_norm**2)
    text = explain_flat_triangles(s.solved)
    assert error <= s.sharp_bounds.u <= 1.1 * error
    assert (s.bounds.u > 2 * error) == report
    assert n < MAX_CHEAP_BOUND_ASPECT or s.bounds.u == pytest.approx(n / 6 * error, rel=0.1)
    assert (f"up to {n} times as long as high" in text) == report
    assert bool(text) == report
    assert (n > MAX_CHEAP_BOUND_ASPECT) == report


def test_there_is_no_multiplier_on_clamped_sides(tmp_path):
    """Neither in the arrays nor in any file, where 0 would be read as a reaction of 0: it is about 2.8.

    f = -4 on the unit square with c = 0, so that the force on side 0 and the reaction on side 3 add up to 4.
    """
    problem = ul.Problem(SQUARE, -4, [0, None, None, None], free_sides=[1, 2], u={3: 0.5}, c=0)
    s = ul.solve(problem, h=1 / 8, H=1 / 4)
    clamped = s.partition.side == 3
    np.testing.assert_array_equal(np.isnan(s.multiplier), clamped)
    assert np.isnan(s.lambda_at(3, [0.1, 0.9])).all()
    assert s.lambda_at(0, 0.9) > 0
    assert s.forces().reactions[3,].value == pytest.approx(4 - s.forces().whole.value, abs=1e-3)
    for name in ("s.nc", "s.csv", "s.vtu"):
        s.save(tmp_path / name)
    cells = pd.read_csv(tmp_path / "s.csv")
    np.testing.assert_array_equal(cells["multiplier"].isna(), clamped)
    with xr.open_dataset(tmp_path / "s.nc") as table:
        np.testing.assert_array_equal(np.isnan(table["multiplier"]), clamped)
    on_edges = meshio.read(tmp_path / "s.vtu").cell_data["multiplier"][1]
    np.testing.assert_array_equal(np.isnan(on_edges), s.mesh.side == 3)
    on_side = s.mesh.side == 0
    full = on_edges[on_side] @ np.diff(s.mesh.s)[on_side]
    assert full == pytest.approx(s.forces().whole.value)
    assert not np.isnan(ul.solve("natural", h=1 / 8, H=1 / 4).multiplier).any()
