"""Marked blocks, the table of rates, and the README that holds it."""

import numpy as np
import pandas as pd
import pytest
import xarray as xr
import yaml
from conftest import ROOT

from unilateral.errors import InputError
from unilateral.formulas.formula import real
from unilateral.study import tables
from unilateral.study.text import documents

BEGIN, END = "<!-- rates: begin -->", "<!-- rates: end -->"
OTHER = "<!-- cost: begin -->\nb\n<!-- cost: end -->\n"


def made_up():
    """Two cases at h/H = 1/2, three pairs of which the last two count."""
    index = ("case", "norm", "h_over_H")
    rate = np.full((2, 3, 1, 3), [0.5, 1.125, 0.997])
    rate[1, 0] = [2.0, 0.9, 1.0]
    asymptotic = np.broadcast_to([0.0, 1.0, 1.0], rate.shape)
    verdict = [[["holds"], ["holds"], ["holds"]], [["fails"], ["exact"], ["not judged"]]]
    return xr.Dataset(
        {
            "rate": ((*index, "pair"), rate),
            "asymptotic": ((*index, "pair"), asymptotic),
            "proved": (index, np.broadcast_to([[[1.0], [1.0], [0.5]]], (2, 3, 1))),
            "expected": (index, np.broadcast_to([[[1.0], [1.5], [1.0]]], (2, 3, 1))),
            "verdict": (index, np.array(verdict, dtype=object)),
        },
        coords={"case": ["first", "second"], "norm": ["h1", "hm12", "l2"], "h_over_H": [0.5]},
    )


def test_only_what_stands_between_the_marks_is_replaced(tmp_path):
    file = tmp_path / "page.md"
    file.write_text(f"above\n\n{BEGIN}\nold\nlines\n{END}\n\nbelow `{BEGIN}` λ\n{OTHER}", encoding="utf-8")
    documents.fill(file, {"rates": r"new \1", "cost": "c\nd"})
    other = OTHER.replace("\nb\n", "\nc\nd\n")
    expected = f"above\n\n{BEGIN}\nnew \\1\n{END}\n\nbelow `{BEGIN}` λ\n{other}"
    assert file.read_text(encoding="utf-8") == expected


def test_filling_twice_is_filling_once(tmp_path):
    file = tmp_path / "page.md"
    file.write_text(f"{BEGIN}\n{END}\n")
    documents.fill(file, {"rates": "a"})
    once = file.read_text()
    documents.fill(file, {"rates": "a"})
    assert file.read_text() == once == f"{BEGIN}\na\n{END}\n"
    assert list(tmp_path.iterdir()) == [file]


@pytest.mark.parametrize(
    "text",
    [
        "no marks\n",
        f"{BEGIN}\n",
        f"{END}\n",
        f"{END}\n{BEGIN}\n",
        f"{BEGIN}\n{BEGIN}\n{END}\n",
        f"{BEGIN}\n{END}\n{END}\n",
        f"{BEGIN}\n{END}\n{BEGIN}\n{END}\n",
        f"{BEGIN}\n{END}\n{OTHER}",
        f"{OTHER}",
        f"{BEGIN} \n{END}\n",
    ],
    ids=[
        "none",
        "no end",
        "no begin",
        "reversed",
        "two begins",
        "two ends",
        "twice",
        "extra",
        "other",
        "not alone",
    ],
)
def test_marks_that_do_not_fit_are_refused_and_the_file_is_kept(tmp_path, text):
    file = tmp_path / "page.md"
    file.write_text(text)
    with pytest.raises(InputError, match=r"^[^\n]*page\.md: [^\n]+$"):
        documents.fill(file, {"rates": "new"})
    assert file.read_text() == text
    assert list(tmp_path.iterdir()) == [file]


def test_the_table_of_rates():
    table = documents.rates_table({"square": made_up(), "again": made_up().isel(case=[0])}, 0.5)
    lines = table.splitlines()
    assert lines[0].startswith("| scene | case | u in H¹ (proved 1) | ")
    assert "(proved 0.5)" in lines[0].split("|")[5]
    assert lines[1] == "|---|---|---|---|---|"
    first = "`first` | 1.00 of 1 (2 pairs) | 1.00 of 1.5 (2 pairs) | 1.00 of 1 (2 pairs) |"
    second = "`second` | 0.90 of 1 (2 pairs), **fails** | error 0, as exact "
    second += "| not judged |"
    assert lines[2:] == [f"| square | {first}", f"| square | {second}", f"| again | {first}"]


def test_the_readme_holds_the_table_of_the_stored_results():
    study = yaml.safe_load((ROOT / "workflow/config/study.yaml").read_text())
    expected = yaml.safe_load((ROOT / "workflow/config/rates.yaml").read_text())["rates"]
    scenes = [name for name, scene in study["scenes"].items() if scene.get("judged", True)]
    try:
        found = {name: tables.load(ROOT / "results" / name / "rates.nc") for name in scenes}
    except InputError as missing:
        pytest.fail(str(missing).replace(f"{ROOT}/", ""), pytrace=False)
    table = documents.rates_table(found, real(expected["judged_ratio"], "judged_ratio"))
    assert table.count("\n") == 1 + sum(len(study["scenes"][name]["cases"]) for name in scenes)
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    assert f"\n{BEGIN}\n{table}\n{END}\n" in readme, "README.md is not up to date; run 'make'"


def made_up_pairs():
    """Two families at H/h = 2 and 4, and three other pairs, two of them with flat triangles."""
    rows = [
        ["square", "uniform", 0.5, 2.0, 2.0, 45.0, 0.7349, 0.74],
        ["square", "uniform", 0.25, 4.0, 4.0, 45.0, 0.92, 0.93],
        ["gmsh", "uniform", 0.5, 2.0, 2.0, 40.0, 0.77, 0.78],
        ["gmsh", "uniform", 0.25, 4.0, 4.0, 40.0, 0.95, 0.96],
        ["graded", "local", 0.5, 2.0, 2.0, 10.0, 0.5, 0.508],
        ["random", "local", 0.7, 3.0, 1.5, 25.0, 0.8, 0.81],
        ["found", "worst", 0.6, 2.0, 1.0, 1.14, 0.18, 0.187],
    ]
    columns = ["label", "kind", "h_over_H", "edges_per_cell", "cell_over_edge", "smallest_angle"]
    return pd.DataFrame(rows, columns=[*columns, "beta_lower", "beta_upper"])


def test_lower_bounds_of_beta_are_rounded_down():
    lines = documents.infsup_table(made_up_pairs(), [2, 4]).splitlines()
    assert lines[0] == "| β ≥ ... at H/h = | 2 | 4 |"
    assert lines[2:] == ["| square | 0.73 | 0.92 |", "| gmsh | 0.77 | 0.95 |"]


def test_the_rule_for_beta_counts_the_pairs_that_keep_it():
    """By hand: four pairs keep it; the ranks of h/H, of the edges and of H_i/edge against those of beta."""
    text = " ".join(documents.infsup_rule(made_up_pairs(), 2, 20).split())
    assert "β ≥ 0.73 in all 4 such pairs" in text
    assert "With smaller angles it is down to 0.51 (graded)." in text
    assert "leave 0.19 (found, angles down to 1.1°)" in text
    assert "| 3 pairs that are not uniform | 0.50 | 0.87 | 0.50 |" in text


def test_the_rule_follows_its_parameters():
    """Control."""
    assert "in all 2 such pairs" in documents.infsup_rule(made_up_pairs(), 2, 42).replace("\n", " ")


def test_exceptions_are_named_with_what_they_lack():
    """By hand: of four places one misses its rate, and one without alpha > 0 does not count."""
    rate = np.array([[[1.0, 1.3]], [[1.5, 1.5]]])  # (alpha, pair, gamma)
    rates = xr.Dataset(
        {
            "predicted": (("norm", "alpha"), [[1.5, 1.5]]),
            "rate": (("norm", "pair", "alpha", "gamma"), rate.swapaxes(0, 1)[None]),
        },
        coords={"norm": ["hm12"], "alpha": [-0.25, 0.5], "gamma": [1.0, 2.0]},
    )
    assert documents.exceptions(rates, {"hm12": 0.1}).endswith("the tolerance nowhere.")
    rates["rate"][0, -1, 1, 0] = 1.25
    found = " ".join(documents.exceptions(rates, {"hm12": 0.1}).split())
    assert found.endswith(r"at $(\alpha,\gamma)=(0.5,1)$, by 0.25 in H^(−1/2).")
