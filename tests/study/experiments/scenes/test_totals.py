"""Guaranteed total errors over the true ones: bounds on stored solutions, and what is no bound."""

import numpy as np
import pytest
import xarray as xr
from conftest import load

from study.experiments.scenes import numbers as error_tables
from study.experiments.scenes.measure import solve_on_partitions
from study.experiments.scenes.totals import tabulate_indices
from unilateral.geometry import partition as partitions
from unilateral.geometry.polygon import square
from unilateral.geometry.structured import make_structured_mesh
from unilateral.norms.dual import build_dual_norm


@pytest.fixture(scope="module")
def totals_data():
    """All that `totals` is given, of two cases on two partitions of which one counts."""
    mesh = make_structured_mesh(square(), 1 / 8)
    cases = [load(name) for name in ("natural", "no_contact")]
    cells = [partitions.make_uniform_partition(square(), H) for H in (1 / 2, 1 / 4)]
    gram = build_dual_norm(cells[1], cases).gram(cases)
    return mesh, cells, cases, solve_on_partitions(mesh, cases, cells, gram, (2.0, 2.0))[0], 2.0


@pytest.fixture(scope="module")
def indices(totals_data):
    return tabulate_indices(*totals_data)


def test_the_bounds_hold_and_are_sharp(indices):
    """natural is resolved at h = 1/8; 1.5 is what a user may expect of a smooth problem."""
    row = indices.sel(case="natural")
    assert float(indices["H"][0]) == 0.25
    for name in ("total_index_u", "total_index_lambda", "local_index_u"):
        assert 1 <= float(row[name][0]) <= 1.5


def test_the_bound_of_another_function_is_none(indices):
    """v is of second order, so its distance to u is below that of u_h."""
    assert np.all(indices["total_index_v"] < 1)


def test_an_exact_multiplier_has_no_index(indices):
    assert np.isnan(float(indices["total_index_lambda"].sel(case="no_contact")[0]))
    assert float(indices["total_index_u"].sel(case="no_contact")[0]) >= 1


def test_the_table_names_both_ends(indices):
    pair = xr.concat([indices, indices.assign_coords(h=("mesh", [1 / 64]))], "mesh")
    table = error_tables.tabulate_totals({"square": pair})
    assert list(table)[:4] == ["scene", "case", "cheap, $H^1$, h = 1/8", "cheap, $H^1$, h = 1/64"]
    assert list(table)[4:6] == ["sharp, $H^1$, h = 1/8", "sharp, $H^1$, h = 1/64"]
    assert table.iloc[-1].tolist()[:2] == ["square", "`no_contact`"]
    assert table.iloc[-1].tolist()[-2:] == ["λ_H exact", "λ_H exact"]


def test_how_fast_the_index_falls_is_told_beside_the_proved_rate():
    """By hand: index - 1 falls like h^2, or grows like 1/h. Control: where no rate is proved."""
    table = xr.Dataset(
        {
            "total_index_u": (("case", "mesh"), [[9.0, 2.0, 1.5, 1 + 1 / 16], [9.0, 1.25, 1.5, 2.0]]),
            "total_index_v": (("case", "mesh"), 2 * [[9.0, 2.0, 1.5, 1 / 8]]),
        },
        coords={"case": ["natural", "violates_jj"], "h": ("mesh", [1 / 2, 1 / 4, 1 / 8, 1 / 16])},
    )
    claimed = {"scenes": ["square"], "orders": {"natural": 1.5, "violates_jj": 1}}
    exactness = error_tables.tabulate_exactness({"square": table, "lshape": table}, claimed)
    assert list(exactness)[2:] == [
        "proved rate",
        "observed rate",
        "index − 1, h = 1/16",
        "η over the error, h = 1/16",
    ]
    assert exactness.values.tolist() == [
        ["square", "`natural`", "1.00", "2.00", "0.0625", "0.125"],
        ["square", "`violates_jj`", "falls to 0", "−1.00", "1.0000", "0.125"],
        ["lshape", "`natural`", "–", "2.00", "0.0625", "0.125"],
        ["lshape", "`violates_jj`", "–", "−1.00", "1.0000", "0.125"],
    ]
