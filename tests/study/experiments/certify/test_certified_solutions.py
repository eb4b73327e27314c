"""The table of bounds and errors, and what documents show of it."""

import numpy as np
import pytest
import skfem
import xarray as xr
from conftest import load

import unilateral as ul
from study import tables
from study.experiments.certify import measure, numbers
from unilateral.geometry.polygon import square
from unilateral.geometry.structured import make_structured_mesh

GIVEN = {"penalties": [10, 1000], "sweeps": 10}
SCHEMES = [
    "mixed method",
    "nodal constraints",
    "P2, interpolated",
    "penalty 10/h",
    "penalty 1000/h",
    "stopped early",
    "half the load",
]


@pytest.fixture(scope="module")
def measured_table():
    return measure.measure(load("natural"), make_structured_mesh(square(), 1 / 8), GIVEN)


def test_bounds_are_those_that_users_get_and_errors_are_those_of_the_functions(measured_table):
    """The error by scikit-fem's quadrature on a mesh that is refined twice, to 1 %: grad u is like r^(1/2).

    Controls: the bound for another function differs, and so does its error.
    """
    case = load("natural")
    mesh = make_structured_mesh(square(), 1 / 8)
    errors_by_scheme = measure.solve_by_others(case, mesh, **GIVEN)
    assert list(measured_table["scheme"].values) == SCHEMES
    assert list(errors_by_scheme) == SCHEMES[1:]
    skfem_mesh = skfem.MeshTri(mesh.points.T.copy(), mesh.triangles.T.copy())
    coarse = skfem.Basis(skfem_mesh, skfem.ElementTriP1())
    fine = skfem.Basis(skfem_mesh.refined(2), skfem.ElementTriP1(), intorder=6)

    @skfem.Functional
    def square_of_error(w):
        places = w.x.reshape(2, -1)
        u, slope = case.value_and_gradient(places.T)
        u = u.reshape(*w.x.shape[1:], -1)
        slope = slope.reshape(*w.x.shape[1:], -1)
        v = w["v_h"]
        grad = w["v_h"].grad
        return (u[..., 0] - v) ** 2 + (slope[..., 0] - grad[0]) ** 2 + (slope[..., 1] - grad[1]) ** 2

    for scheme in ("nodal constraints", "half the load"):
        row = measured_table.sel(scheme=scheme)
        certified = ul.certify(case.problem, mesh, errors_by_scheme[scheme]).bounds.u
        assert float(row["certified_bound"]) == pytest.approx(certified, rel=1e-12)
        v = fine.project(coarse.interpolator(errors_by_scheme[scheme]))
        error = np.sqrt(square_of_error.assemble(fine, v_h=fine.interpolate(v)))
        assert float(row["certified_error"]) == pytest.approx(error, rel=0.01)
    assert float(measured_table["certified_bound"][1]) < 0.5 * float(measured_table["certified_bound"][-1])
    assert float(measured_table["certified_error"][1]) < 0.5 * float(measured_table["certified_error"][-1])


def test_no_bound_is_below_its_error(measured_table):
    """Theorem 8. Control: the bound for nodal constraints is below the error with half the load."""
    assert np.all(measured_table["certified_bound"] >= measured_table["certified_error"])
    bound = measured_table["certified_bound"].sel(scheme="nodal constraints")
    assert float(bound) < float(measured_table["certified_error"].sel(scheme="half the load"))


def test_a_table_of_two_cases_and_sizes_is_stored(tmp_path, monkeypatch):
    """By the names of cases, sizes and methods; the values are numbered in the order of measurement."""
    count = iter(range(100))

    def measure_by_number(case, mesh, study):
        values = {f"certified_{name}": ("scheme", [float(next(count))]) for name in ("error", "bound")}
        return xr.Dataset(values, coords={"scheme": ["only"]})

    monkeypatch.setattr(measure, "measure", measure_by_number)
    scenes = [{"polygon": "square", "side": 0, "cases": [name]} for name in ("natural", "clamped")]
    path = tmp_path / "results/certify/solutions.nc"
    path.parent.mkdir(parents=True)
    measure.measure_certify({"scenes": scenes, "h": ["1/2", "1/4"], **GIVEN}, str(path))
    stored = tables.load_table(path)
    assert stored["case"].values.tolist() == ["natural", "clamped"]
    assert stored["h"].values.tolist() == [0.5, 0.25]
    assert stored["certified_error"].sel(scheme="only").values.tolist() == [[0, 2], [4, 6]]


def test_documents_show_errors_and_bounds_over_them():
    """Errors 1, 2, .. and bounds twice or three times as large; by hand."""
    error = np.arange(1.0, 1 + 2 * 2 * 7).reshape(2, 2, 7)
    factor = np.where(np.arange(2)[:, None] == 0, 2.0, 3.0)
    dims = ("case", "mesh", "scheme")
    table = xr.Dataset(
        {"certified_error": (dims, error), "certified_bound": (dims, factor * error)},
        coords={"case": ["natural", "clamped"], "scheme": SCHEMES, "h": ("mesh", [1 / 16, 1 / 64])},
    )
    displayed = numbers.blocks({"certify/solutions": table}, {})["certify"]
    assert len(displayed) == 14
    assert displayed.iloc[8].tolist() == ["`clamped`", "nodal constraints", "16", "2.00", "23", "3.00"]
    assert displayed.columns[-1] == "bound/error, h = 1/64"
    document_numbers = numbers.numbers({"certify/solutions": table}, {"certify": GIVEN})["certify"]
    assert document_numbers == {"penalty": {"coarsest": 2.0, "finest": 3.0}, "half": 21 / 15, "sweeps": 10}
