"""The stored study of adapted meshes: what theory says of every level. Nothing is solved here."""

import numpy as np
import pytest
from conftest import config, read_stored_table

from unilateral.formulas.formula import parse_real
from unilateral.norms.resolution import RULE

STUDY = config("study")["adaptive"]
CASES = [case for scene in STUDY["scenes"] for case in scene["cases"]]


def levels(case, kind):
    """Those that there are."""
    return read_stored_table("adaptive/errors").sel(case=case, kind=kind).dropna("level", subset=["unknowns"])


@pytest.mark.parametrize("kind", ["uniform", "adapted"])
@pytest.mark.parametrize("case", [*CASES, *STUDY["examples"]])
def test_unknowns_grow_up_to_the_limit_and_bounds_fall(case, kind):
    """On uniform meshes h is halved, so there are nearly four times the unknowns."""
    rows = levels(case, kind)
    unknowns = rows["unknowns"].values
    shortest = rows["shortest_edge"].values
    assert unknowns[-1] <= STUDY["most"]["unknowns"]
    assert np.all(rows["converged"] == 1)
    assert np.all(np.diff(rows["h1_bound"]) < 0)
    growth = unknowns[1:] / unknowns[:-1]
    if kind == "uniform":
        assert np.all((growth > 3.5) & (growth < 4))
        np.testing.assert_allclose(shortest[1:] / shortest[:-1], 0.5, rtol=1e-9)
    else:
        assert np.all((growth > 1) & (growth < 4))
        assert shortest[-1] < levels(case, "uniform")["shortest_edge"].values[-1]


def test_both_kinds_start_from_one_mesh():
    first = read_stored_table("adaptive/errors").isel(level=0)
    for name in ("unknowns", "h1_bound", "shortest_edge"):
        assert np.array_equal(first[name].sel(kind="uniform"), first[name].sel(kind="adapted"))
    on_square = first["shortest_edge"].sel(case=CASES, kind="adapted")
    np.testing.assert_allclose(on_square, parse_real(STUDY["h"], ""), rtol=1e-12)


def test_errors_are_known_of_cases_only():
    """And fall with every level."""
    for case in CASES:
        for kind in ("uniform", "adapted"):
            assert np.all(np.diff(levels(case, kind)["h1_error"]) < 0)
    assert read_stored_table("adaptive/errors")["h1_error"].sel(case=STUDY["examples"]).isnull().all()


@pytest.mark.parametrize("case", [*CASES, *STUDY["examples"]])
def test_beta_is_known_to_half_a_percent_on_all_small_adapted_meshes(case):
    """The rule is kept; with one edge in each cell beta is 0 or, of an odd number, like its inverse.

    A cell is a dyadic interval whose halves hold whole edges, so its middle is a node: delta = 1/2.
    """
    small = levels(case, "adapted")
    small = small.isel(level=small["unknowns"].values <= STUDY["most"]["of_beta"])
    row = (
        read_stored_table("adaptive/infsup")
        .sel(case=case, kind="adapted")
        .dropna("level", subset=["beta_lower"])
    )
    assert np.array_equal(row["level"], small["level"])
    assert row.sizes["level"] > 4
    lower = row["beta_lower"].values
    upper = row["beta_upper"].values
    assert np.all((lower > 0) & (lower <= upper) & (upper <= 1.005 * lower))
    assert np.all(row["cell_over_edge"] >= RULE.cell_over_edge * (1 - 1e-9))
    np.testing.assert_allclose(row["delta"], 0.5, rtol=1e-9)
    assert np.all(row["beta_of_edges"] < 0.1)


def test_the_cases_rate_on_uniform_meshes_is_half_that_of_their_regularity():
    """u is like r^(2/3) at the re-entrant vertex: h^(2/3), so N^(-1/3), from above on these levels."""
    rates = read_stored_table("adaptive/rates")["error_rate"].sel(
        kind="uniform", case=["reentrant", "violates_j"]
    )
    for case in rates["case"].values:
        row = rates.sel(case=case).dropna("level").values
        assert len(row) >= 2
        assert np.all(np.diff(row) < 0)
        assert np.all((row > 1 / 3) & (row < 0.47))
