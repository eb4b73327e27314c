"""What a solution shows: its contact set, its values at points and along sides, and its files."""

import json
from fractions import Fraction

import meshio
import numpy as np
import pandas as pd
import pytest
import xarray as xr
from conftest import ROOT

import unilateral as ul
from unilateral.bounds.forces import Force
from unilateral.formulas.expression import number as exact
from unilateral.geometry.partition import uniform
from unilateral.geometry.polygon import square
from unilateral.problems.units import Units
from unilateral.solution.contact import Contact
from unilateral.solution.solution import in_units

SQUARE = [(0, 0), (1, 0), (1, 1), (0, 1)]
SIZES = {"h": 1 / 16, "H": 1 / 8}


@pytest.mark.parametrize("k", [Fraction(2), Fraction(1, 3), Fraction(10) ** 9])
def test_forces_in_other_units_are_still_bounds(k):
    """By exact squares, for 1 of the computed ones is k^(1/2); by plain products some would be none."""
    unit = float(Units(k=exact(k)).force)
    plain = []
    for number in np.random.default_rng(0).uniform(0.1, 10, 200):
        square = k * Fraction(number) ** 2
        force = in_units(Force(number, number, number), unit)
        assert Fraction(force.lower) ** 2 <= square <= Fraction(force.upper) ** 2
        assert force.upper - force.lower <= 1e-14 * force.value
        plain.append(Fraction(unit * number) ** 2 >= square)
    assert {*plain} == {True, False}


@pytest.fixture(scope="module")
def shelter():
    """A pentagon with a slanted side, partly in contact."""
    return ul.solve(ul.load(ROOT / "examples/shelter.yaml"), **SIZES)


def test_contact_intervals_are_runs_of_cells_on_one_side():
    """By hand: cells of 1/4 on the square; a run that passes a vertex is cut there."""
    lambda_H = np.zeros(16)
    lambda_H[[1, 2, 3, 4, 15]] = 1, 2, 1, 3, 1
    contact = Contact(uniform(square(), 1 / 4), lambda_H)
    assert [each[:3] for each in contact.intervals] == [(0, 0.25, 1), (1, 0, 0.25), (3, 0.75, 1)]
    assert [each[3:] for each in contact.intervals] == [
        ((0.25, 0), (1, 0)), ((1, 0), (1, 0.25)), ((0, 0.25), (0, 0)),
    ]  # fmt: skip
    assert (contact.lengths.tolist(), contact.length, contact.full) == ([0.75, 0.25, 0, 0.25], 1.25, False)


def test_u_at_nodes_between_them_and_outside(shelter):
    """u_h is its nodal values at nodes, and linear: their mean at centroids.."""
    mesh = shelter.mesh
    np.testing.assert_allclose(shelter.u_at(mesh.points), shelter.u, rtol=0, atol=1e-12)
    centroids = mesh.points[mesh.triangles].mean(axis=1)
    expected = shelter.u[mesh.triangles].mean(axis=1)
    np.testing.assert_allclose(shelter.u_at(centroids), expected, rtol=0, atol=1e-12)
    assert np.isnan(shelter.u_at([(-0.1, 0.5), (3, 3), (np.nan, 0)])).all()


def test_u_at_any_point_of_the_boundary(shelter):
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
    middles, normals = 0.5 * (polygon.vertices + np.roll(polygon.vertices, -1, axis=0)), polygon.normals
    near, far = (middles + part * 1e-10 * polygon.diameter * normals for part in (0.9, 2.0))
    np.testing.assert_allclose(shelter.u_at(near), shelter.u_at(middles), rtol=0, atol=1e-8)
    assert np.isnan(shelter.u_at(far)).all()


def test_lambda_along_a_side(shelter):
    """The values of the cells that `cells` lists; NaN beyond the ends."""
    of = shelter.cells().query("side == 1")
    starts = of["start"].to_numpy() - shelter.mesh.polygon.starts[1]
    np.testing.assert_array_equal(shelter.lambda_at(1, starts), of["multiplier"])
    end = shelter.mesh.polygon.lengths[1]
    assert shelter.lambda_at(1, end) == of["multiplier"].iloc[-1]
    assert np.isnan(shelter.lambda_at(1, [-0.1, end + 0.1])).all()


def test_what_cannot_be_evaluated_is_refused(shelter):
    with pytest.raises(ul.InputError, match=r"points: their shape \(2,\) must be \(k, 2\)"):
        shelter.u_at((0, 0))
    with pytest.raises(ul.InputError, match="side 5: the sides of 'shelter' are 0 to 4"):
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
    with pytest.raises(ul.InputError, match=r"the ending must be \.vtu, \.csv, .* or \.html"):
        s.save(tmp_path / "s.txt")
    assert sorted(file.name for file in tmp_path.iterdir()) == ["s.csv", "s.nc", "s.vtu"]


def test_netcdf_follows_the_conventions(tmp_path):
    """CF 1.8: Conventions and title, units, no _FillValue on coordinates; indices are of 32 bits."""
    ul.solve(ul.case("natural"), **SIZES).save(tmp_path / "s.nc")
    with xr.open_dataset(tmp_path / "s.nc") as table:
        assert table.attrs["Conventions"] == "CF-1.8"
        assert table.attrs["title"]
        assert all(of.attrs["units"] == "1" and of.attrs["long_name"] for of in table.variables.values())
        assert {*table.coords} == {"x", "y"}
        assert not any("_FillValue" in of.encoding for of in table.coords.values())
        assert {table[name].dtype for name in ("triangles", "side")} == {np.dtype("int32")}


def test_the_certificate_is_a_file(tmp_path):
    """As the solution says it; NaN, which JSON has not, is null; the problem has no known errors."""
    problem = ul.Problem(SQUARE, f=-1, g="-x*y/2")
    s, alone = ul.solve(problem, accuracy=0.3), ul.solve(problem, **SIZES)
    s.save(tmp_path / "s.json")
    found = json.loads((tmp_path / "s.json").read_text())
    assert found["goal"] == {"accuracy": 0.3, "norm": "h1", "absolute": False}
    assert found["certified"]
    assert found["h1_relative_bound"] <= 0.3
    assert [found["h1_bound"], found["hm12_bound"], found["enclosure"]] == [*s.bounds]
    assert found["h1_error"] is None
    assert [level["unknowns"] for level in found["levels"]] == [level.unknowns for level in s.search.done]
    assert found["contact"]["length"] == s.contact.length
    assert found["versions"]["unilateral"] == ul.__version__
    given = alone.certificate()
    assert (given["goal"], given["certified"], given["levels"]) == (None, False, [])
    assert [each[key] for each in (found, given) for key in ("ended", "reach")] == [None] * 4
