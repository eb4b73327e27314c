"""`python workflow/compare.py A B` sees every difference of two trees of results, and says no more."""

import json
import sys

import numpy as np
import pytest
import xarray as xr

from workflow import compare


@pytest.fixture
def trees(tmp_path):
    """Two trees with the same values, whose attributes and timings differ."""
    for name, seconds in (("before", 1.0), ("after", 2.0)):
        folder = tmp_path / name / "results" / "square"
        folder.mkdir(parents=True)
        (tmp_path / name / "figures").mkdir()
        errors = xr.Dataset({"h1_error": ("mesh", [2.0, 1.0, np.nan]), "case": ("mesh", ["a", "b", ""])})
        errors.assign_attrs(history=name).to_netcdf(folder / "errors.nc")
        xr.Dataset({"seconds": seconds}).to_netcdf(folder / "timings.nc")
        claims = [{"id": "4.11", "verdict": "holds", "margin": 0.5}, {"id": "5.A", "verdict": "holds"}]
        (folder.parent / "claims.json").write_text(json.dumps(claims))
        (folder.parent / "numbers.json").write_text(json.dumps({"study.h": "1/8", "rate": 1.5}))
        (tmp_path / name / "figures" / "rates.csv").write_text("case,error\nnatural,0.25\n")
    return tmp_path / "before", tmp_path / "after"


@pytest.fixture
def run(monkeypatch, capsys):
    """The exit code with these arguments, and what is printed on standard output and error."""

    def run_compare(*arguments):
        monkeypatch.setattr(sys, "argv", ["compare.py", *map(str, arguments)])
        try:
            code = compare.main()
        except SystemExit as end:
            code = end.code
        return code, *capsys.readouterr()

    return run_compare


def test_equal_values_are_equal_whatever_attributes_and_timings_say(run, trees):
    assert run(*trees) == (0, "4 files compared: all are equal\n", "")


def test_every_kind_of_difference_is_named_with_its_file(run, trees):
    before, after = trees
    table = after / "results" / "square" / "errors.nc"
    xr.Dataset(
        {"h1_error": ("mesh", [2.0, 1.0 + 1e-12, np.nan]), "case": ("mesh", ["a", "c", ""])}
    ).to_netcdf(table)
    (after / "results" / "claims.json").write_text(json.dumps([{"id": "4.11", "verdict": "fails"}]))
    (after / "results" / "numbers.json").write_text(json.dumps({"study.h": "1/8", "rate": 1.5, "more": 1}))
    (after / "figures" / "rates.csv").unlink()
    code, out, _ = run(*trees)
    assert code == 1
    for line in (
        f"figures/rates.csv: is only in {before}",
        "results/claims.json: 4.11.verdict is 'fails' instead of 'holds'",
        "results/claims.json: 4.11.margin is gone",
        "results/claims.json: 5.A.id is gone",
        "results/numbers.json: more is new",
        "results/square/errors.nc: h1_error(mesh) differs in 1 of 3 numbers, by at most 5e-13 of the "
        "largest one",
        "results/square/errors.nc: case(mesh) is 'c' instead of 'b'",
        "4 files compared: 4 differ",
    ):
        assert line in out.splitlines()


@pytest.mark.parametrize(("tolerance", "code"), [("1e-13", 1), ("1e-12", 0)])
def test_a_tolerance_is_relative_to_the_largest_number(run, trees, tolerance, code):
    table = xr.Dataset({"h1_error": ("mesh", [2.0, 1.0 + 1e-12, np.nan]), "case": ("mesh", ["a", "b", ""])})
    table.to_netcdf(trees[1] / "results" / "square" / "errors.nc")
    assert run(*trees, "--within", tolerance)[0] == code


def test_a_number_that_is_no_longer_computed_is_no_small_difference(run, trees):
    table = xr.Dataset({"h1_error": ("mesh", [2.0, np.nan, np.nan]), "case": ("mesh", ["a", "b", ""])})
    table.to_netcdf(trees[1] / "results" / "square" / "errors.nc")
    assert run(*trees, "--within", "1")[0] == 1


def test_the_same_numbers_along_another_dimension_are_no_equal_table(run, trees):
    table = xr.Dataset({"h1_error": ("cell", [2.0, 1.0, np.nan]), "case": ("mesh", ["a", "b", ""])})
    table.to_netcdf(trees[1] / "results" / "square" / "errors.nc")
    code, out, _ = run(*trees, "--within", "1")
    assert code == 1
    assert "results/square/errors.nc: h1_error(mesh) is gone" in out.splitlines()


def test_a_folder_without_results_is_bad_input(run, tmp_path):
    code, _, err = run(tmp_path, tmp_path)
    assert code == 2
    assert "has no results/ or figures/" in err
