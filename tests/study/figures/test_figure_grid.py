"""The maps over (h, H): their table from a made-up study, and their numbers."""

import re
from itertools import product

import numpy as np
from conftest import texts

from examples import drawn_from, grid_table, study_errors
from unilateral.study import tables
from unilateral.study.figures import grid


def test_the_table(tmp_path):
    tables.save(study_errors(), tmp_path / "errors.nc", "scene")
    frame = grid.table(tmp_path / "errors.nc", ["made_up"])
    assert len(frame) == 3 * 3 * 4
    np.testing.assert_allclose(frame["h_over_H"], frame["h"] / frame["H"], rtol=1e-15)
    beta_zero = (frame["h"] == frame["H"]).astype(int)
    assert frame["beta_zero"].tolist() == beta_zero.tolist()
    solved = (frame["H"] == 2 * frame["h"]) | ((frame["norm"] == "h1") & (frame["H"] == frame["h"]))
    assert frame["error"].notna().tolist() == solved.tolist()
    kept = frame[solved]
    np.testing.assert_allclose(kept["error"], 10 * kept["h"] + kept["H"], rtol=1e-15)


def test_every_error_stands_in_its_cell(tmp_path, drawn):
    drawn_from("grid", tmp_path)
    said = [text.get_text() for text in texts(drawn[0][0])]
    errors = grid_table()["error"].dropna()
    numbers = [float(text) for text in said if re.fullmatch(r"\d\.\de-\d", text)]
    assert sorted(numbers) == sorted(float(f"{error:.1e}") for error in errors)
    unjudged = 2 * 2 * sum(h / H in (1, 2) for h, H in product((1 / 8, 1 / 16), (1 / 8, 1 / 16, 1 / 32)))
    assert said.count("$\\beta=0$") == unjudged  # two cases, the two norms of lambda
